"""Means over few samples leaned on those of wider surroundings.

A fine mesh has fewer splats than vertices, and what one splat tells of a colour is noisy, or nothing where it is
clipped. So each vertex takes some of the mean in the cell of a grid around it, that cell of the one
around it, and so on to the whole mesh: where there are many samples nothing changes, where there are none the nearest
ones speak (shrinkage: James and Stein, 1961, here up an octree).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mirelight.model import F64

PRIOR = 0.25  # samples that the mean around counts as: more of it mixes a thing's colours with those behind it
_MOST_CELLS = 1 << 18  # along an axis

Int = NDArray[np.int64]


def pooled(sums: F64, counts: F64, places: F64, ways: Int, size: float) -> F64:
    """Sums with `PRIOR` samples' worth of what is around added to each.

    Args:
        sums: (V, C) over the samples of each vertex.
        counts: (V,) how many those are; fractions where a sample is shared, or counts for little.
        places: (V, 3) of the vertices.
        ways: (V,) 0 to 5, which way the surface looks there; ways mix only at the very top.
        size: of the finest cells, in the unit of places.

    Returns:
        (V, C) of the same scale: of any two columns the quotient is what counts.
    """
    off = places - places.min(axis=0)
    size = max(size, float(off.max()) / _MOST_CELLS, 1e-300)
    cell, way, s, n = np.floor(off / size).astype(np.int64), ways.astype(np.int64), sums, counts
    levels: list[tuple[Int, F64, F64]] = []  # the cell of each row one level below, sums, counts
    while True:
        key = (((cell[:, 0] << 20 | cell[:, 1]) << 20) | cell[:, 2]) * 6 + way
        _, first, inside = np.unique(key, return_index=True, return_inverse=True)
        s = np.stack([np.bincount(inside, column) for column in s.T], axis=1)
        n = np.bincount(inside, n).astype(np.float64)
        levels.append((inside, s, n))
        if not cell.any():
            break
        cell, way = cell[first] >> 1, way[first]
    around = np.broadcast_to(s.sum(axis=0) / max(float(n.sum()), 1e-300), s.shape)
    for inside, s, n in reversed(levels):
        around = ((s + PRIOR * around) / (n + PRIOR)[:, None])[inside]
    return np.asarray(sums + PRIOR * around)
