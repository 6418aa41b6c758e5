"""What a camera has beside a pinhole: a lens of some width, and a shutter that is open for a while."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mirelight.model.arrays import F64, ArrayHolder, freeze

_GOLDEN = math.pi * (3 - math.sqrt(5))  # rad between neighbours of Vogel's spiral


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Exposure(ArrayHolder):
    """A thin lens, and the poses that the camera takes while light comes in."""

    aperture_radius: float = 0.0  # of the lens, world units
    focus_distance: float = 1.0  # world units along the view axis, to the plane that is sharp
    poses: F64 | None = None  # (n, 4, 4) world_from_camera at equal steps while it is open; None: it stands still

    def __post_init__(self) -> None:
        freeze(self, "poses", (None, 4, 4), np.float64)
        if not (0 <= self.aperture_radius < math.inf and 0 < self.focus_distance < math.inf):
            raise ValueError("aperture_radius must be 0 or more, and focus_distance above 0")

    def points(self, count: int) -> F64:
        """(count, 2) points of the lens to the right of its middle and above it, world units: Vogel's spiral, which
        covers a disc evenly whatever the count is, moved so that their mean is the middle."""
        k = np.arange(count)
        radius, angle = self.aperture_radius * np.sqrt((k + 0.5) / count), _GOLDEN * k
        found = radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        return np.asarray(found - found.mean(axis=0))
