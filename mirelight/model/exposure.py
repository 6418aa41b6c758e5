"""What a camera has beside a pinhole: a lens of some width, and a shutter that is open for a while."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mirelight.base import conventions
from mirelight.model.arrays import F64, ArrayHolder, freeze

_GOLDEN = math.pi * (3 - math.sqrt(5))  # rad between neighbours of Vogel's spiral


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Exposure(ArrayHolder):
    """A thin lens, and the poses that the camera takes while light comes in."""

    aperture_radius: float = 0.0  # of the lens, world units
    focus_distance: float = 1.0  # world units along the view axis, to the plane that is sharp
    poses: F64 | None = None  # (n, 4, 4) world_from_camera at equal steps while it is open; None: it stands still
    shutter: tuple[float, float] | None = None  # s after the camera's time that it opens and closes, where known
    frames: tuple[float, float] | None = None  # the same in frames of its path, where things move by it

    def __post_init__(self) -> None:
        freeze(self, "poses", (None, 4, 4), np.float64)
        if not (0 <= self.aperture_radius < math.inf and 0 < self.focus_distance < math.inf):
            raise ValueError("aperture_radius must be 0 or more, and focus_distance above 0")

    def __repr__(self) -> str:
        lens = f"aperture {self.aperture_radius:.4g}, sharp at {self.focus_distance:.4g}"
        parts = [lens] if self.aperture_radius > 0 else []
        is_open = self.poses is not None or self.frames is not None
        return ", ".join([*parts, *(["moving"] if is_open else [])]) or "a pinhole"

    def poses_at(self, plain: F64, count: int) -> list[F64]:
        """(4, 4) at `count` moments of the time that it is open; `plain` where it stands still."""
        if self.poses is None or len(self.poses) < 2:
            return [plain] * count
        return [conventions.pose_at(self.poses, x * (len(self.poses) - 1)) for x in _moments(count)]

    def frames_at(self, frame: float | None, count: int) -> list[float | None]:
        """The frames of the path at those moments; `frame` where none is known."""
        if frame is None or self.frames is None:
            return [frame] * count
        opens, closes = self.frames
        return [frame + opens + x * (closes - opens) for x in _moments(count)]

    def points(self, count: int) -> F64:
        """(count, 2) points of the lens to the right of its middle and above it, world units: Vogel's spiral, which
        covers a disc evenly whatever the count is, moved so that their mean is the middle."""
        k = np.arange(count)
        radius, angle = self.aperture_radius * np.sqrt((k + 0.5) / count), _GOLDEN * k
        found = radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        return np.asarray(found - found.mean(axis=0))


def _moments(count: int) -> list[float]:
    """The middles of `count` equal parts of 0..1, in an order (van der Corput's) that has nothing to do with that of
    points of a lens."""
    rank = np.argsort(np.argsort([_radical_inverse(k) for k in range(count)]))
    return [(int(r) + 0.5) / count for r in rank]


def _radical_inverse(k: int) -> float:
    """The bits of a whole number behind the point, in reverse."""
    return int(f"{k:b}"[::-1], 2) / 2 ** k.bit_length() if k else 0.0
