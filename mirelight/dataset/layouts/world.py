"""The world of a data set: Z up, and moved and scaled where its loaders have sizes of their own built in."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from mirelight.base.conventions import Matrix
from mirelight.io.cameras.transforms import Z_UP


def world_of(center: ArrayLike = (0, 0, 0), scale: float = 1.0) -> Matrix:
    """The matrix (4, 4) from mirelight's world (Y up) to a data set's.

    Lights of a scaled scene: candela are multiplied by scale², lux and candela per square metre stay.

    Args:
        center: (3,) in mirelight's world, what comes to lie at the origin.
        scale: of all lengths, positive.
    """
    to_center = np.eye(4)
    to_center[:3, 3] = -np.asarray(center, dtype=np.float64)
    return np.asarray(np.diag([scale, scale, scale, 1.0]) @ Z_UP @ to_center)


def scale_of(world: Matrix) -> float:
    """How a world's matrix scales lengths."""
    return float(np.cbrt(np.linalg.det(world[:3, :3])))
