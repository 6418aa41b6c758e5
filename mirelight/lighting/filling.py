"""Colours for vertices that no splat tells of: those of their neighbours, or of what lies nearest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirelight.model import F32, F64, ProxyMesh

STEPS = 256  # edges from a vertex with splats to the farthest without that takes its colour
NEAREST = 4  # vertices that tell the colour of one which no edges join to any splat

Int = NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Filling:
    """Where vertices without splats take their colours from."""

    steps: Sequence[Int]  # along edges, from vertices with splats outwards: (E, 2) one that is reached, one known
    apart: Int  # (U,) vertices that no step reaches: behind what was seen, and islands
    near: Int  # (U, NEAREST) the nearest that look the same way

    @staticmethod
    def of(mesh: ProxyMesh, way: Int, told: NDArray[np.bool_]) -> Filling:
        """Over a mesh whose vertices look along `way` (V,), 0 to 5, from those that splats tell of (V,)."""
        neighbours, known = _neighbours(mesh), told.copy()
        by_source = np.argsort(neighbours[:, 1], kind="stable")
        ends = np.searchsorted(neighbours[by_source, 1], np.arange(len(known) + 1))
        steps, front = list[Int](), np.flatnonzero(known)
        for _ in range(STEPS):
            count = ends[front + 1] - ends[front]
            own = np.arange(count.sum()) + np.repeat(ends[front] - np.cumsum(count) + count, count)
            reached = neighbours[np.sort(by_source[own])]
            reached = reached[~known[reached[:, 0]]]
            if not len(reached):
                break
            steps.append(reached)
            front = np.unique(reached[:, 0])
            known[front] = True
        return Filling(steps, *_nearest(mesh.vertices, way, known))

    def fill(self, values: F64) -> None:
        """Sets rows of values (V, C) whose last column is 1; those that nothing tells of stay."""
        for reached in self.steps:
            new, row = np.unique(reached[:, 0], return_inverse=True)
            found = np.zeros((len(new), values.shape[1]))
            add_rows(found, row, values[reached[:, 1]])
            values[new] = found / found[:, -1:]
        values[self.apart] = values[self.near].mean(axis=1)


def add_rows(sums: F64, rows: NDArray[np.integer], values: F64) -> None:
    """Adds values (N, C) to rows, those that meet in one row too."""
    for k in range(sums.shape[1]):
        sums[:, k] += np.bincount(rows, values[:, k], minlength=len(sums))


def _nearest(vertices: F32, way: Int, known: NDArray[np.bool_]) -> tuple[Int, Int]:
    """(U,) vertices that are not known but look a way that known ones do; (U, NEAREST) the nearest of those."""
    from scipy.spatial import cKDTree

    apart, near = [np.zeros(0, np.int64)], [np.zeros((0, NEAREST), np.int64)]
    for k in range(6):
        there, asked = np.flatnonzero(known & (way == k)), np.flatnonzero(~known & (way == k))
        if len(there) and len(asked):
            ranks = np.minimum(np.arange(NEAREST) + 1, len(there))
            _, found = cKDTree(vertices[there]).query(vertices[asked], k=ranks, workers=-1)
            apart.append(asked)
            near.append(there[found])
    return np.concatenate(apart), np.concatenate(near)


def _neighbours(mesh: ProxyMesh) -> Int:
    """(E, 2) pairs of vertices that share an edge or a place, both ways round."""
    f = mesh.faces.astype(np.int64)
    same = np.stack([np.arange(len(mesh.vertices)), _first_there(mesh.vertices)], axis=1)
    pairs = np.concatenate([f[:, [0, 1]], f[:, [1, 2]], f[:, [2, 0]], same])
    return np.concatenate([pairs, pairs[:, ::-1]])


def _first_there(vertices: F32) -> Int:
    """(V,) the first vertex in the same place as each."""
    x, y, z = (vertices + np.float32(0)).T.copy().view(np.uint32).astype(np.uint64)  # + 0: -0 becomes 0
    across = x << np.uint64(32) | y
    order = np.lexsort((z, across))
    across, z = across[order], z[order]
    new = np.concatenate([[True], (across[1:] != across[:-1]) | (z[1:] != z[:-1])])
    out = np.empty(len(order), np.int64)
    out[order] = order[new][np.cumsum(new) - 1]
    return out
