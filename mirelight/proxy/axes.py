"""The axes of splats, thinnest first."""

from __future__ import annotations

import numpy as np

from mirelight.base import conventions
from mirelight.model import F64, SplatCloud


def axes_of(splats: SplatCloud) -> tuple[F64, F64]:
    """(N, 3, 3) axes as columns and (N, 3) scales, thinnest first."""
    order = np.argsort(splats.scales, axis=1, kind="stable")
    axes = np.take_along_axis(conventions.rotation_from_quaternion(splats.quats), order[:, None, :], axis=2)
    return axes, np.take_along_axis(splats.scales, order, axis=1).astype(np.float64)
