"""What splats say around a place on a mesh, and where they say nothing: found along the surface.

A mesh is cut into patches about as large as the distance between splats that tell of it. From each, what was told goes
on to those that edges join to it, a few patches far: through the air it would mix things with what lies behind them.
Splats at a thing's outline, and on faces that cameras saw from the side, show too much: light bled from what is bright
behind them, and gloss. Next to them lies what no camera saw and takes its colour from them. Hence the mean over
patches is of 1 / albedo, weighted by the light: there the bright ones count little.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirelight.model import F32, F64, ProxyMesh

WALK = 8  # patches that what is told goes, at most
STEPS = 256  # patches from one that is told of to the farthest that takes its colour
NEAREST = 4  # vertices that tell the colour of one which no edges join to any splat
OFF_PLANE = 32.0  # times as far counts what lies before or behind that one: a wall goes on as the wall, not as its kerb
_DARKEST = 3e-3  # radiance per irradiance below which 1 / albedo would say nothing but that
_NO_LIGHT = 1e-9  # irradiance that is added, so that radiance without light is not lost

Int = NDArray[np.int64]
Bool = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Patches:
    """Pieces of a mesh: the vertices of one cell of a grid that edges join within it."""

    of_vertex: Int  # (V,) which of P patches
    pairs: Int  # (E, 2) patches that an edge joins, both ways round, each once
    walk: Any  # sparse (P, P): what part of each goes on to each in one step; columns sum to 1

    @staticmethod
    def of(mesh: ProxyMesh, size: float) -> Patches:
        """Of cells of `size`, in the unit of the vertices; edges longer than that pass on the less, by its square."""
        from scipy.sparse import coo_matrix
        from scipy.sparse.csgraph import connected_components

        places = mesh.vertices.astype(np.float64)
        edges, count = _edges(mesh), len(places)
        cell = np.floor((places - places.min(axis=0)) / size)
        inside = edges[(cell[edges[:, 0]] == cell[edges[:, 1]]).all(axis=1)]
        joined = coo_matrix((np.ones(len(inside), bool), (inside[:, 0], inside[:, 1])), shape=(count, count))
        total, number = connected_components(joined, directed=False)
        number = number.astype(np.int64)
        middle = np.stack([np.bincount(number, x) for x in places.T], axis=1) / np.bincount(number)[:, None]
        pairs = number[edges]
        pairs = np.unique(np.sort(pairs[pairs[:, 0] != pairs[:, 1]], axis=1), axis=0)
        pairs = np.concatenate([pairs, pairs[:, ::-1]])
        length = np.linalg.norm(middle[pairs[:, 0]] - middle[pairs[:, 1]], axis=1)
        share = (size / np.maximum(length, size)) ** 2
        whole = 1 + np.bincount(pairs[:, 1], share, minlength=total)
        rows, columns = np.append(pairs, np.tile(np.arange(total), (2, 1)).T, axis=0).T
        values = np.append(share, np.ones(total)) / whole[columns]
        return Patches(number, pairs, coo_matrix((values, (rows, columns)), shape=(total, total)).tocsr())


@dataclass(frozen=True, slots=True, eq=False)
class Filling:
    """What splats tell of all vertices of a mesh, those too that none lies at."""

    patches: Patches
    steps: Sequence[Int]  # along edges, from patches that are told of outwards: (E, 2) one that is reached, one known
    apart: Int  # (U,) vertices that no step reaches: behind what was seen, and islands
    near: Int  # (U, NEAREST) the nearest that look the same way, at one height along it sooner than beside

    @staticmethod
    def of(mesh: ProxyMesh, way: Int, told: Bool, size: float) -> Filling:
        """Over a mesh whose vertices look along `way` (V,), 0 to 5, from those that splats tell of (V,).

        `size` is that of patches, in the unit of the vertices.
        """
        patches = Patches.of(mesh, size)
        known = np.zeros(patches.walk.shape[0], bool)
        known[patches.of_vertex[told]] = True
        steps = _outwards(patches.pairs, known)
        for reached in steps:
            known[reached[:, 0]] = True
        return Filling(patches, steps, *_nearest(mesh.vertices, way, known[patches.of_vertex]))

    def around(self, met: Int, sums: F64) -> F64:
        """(V, 7) means around each vertex, where the weight's is 1, of what splats tell; of nothing, the mean of all.

        Args:
            met: (M,) vertices.
            sums: (M, 7) radiance and irradiance, three channels each, and weight, all times that weight.
        """
        radiance, light, weight = np.split(sums, [3, 6], axis=1)
        light = light + _NO_LIGHT * weight
        inverse = light**2 / np.maximum(radiance, _DARKEST * light + 1e-300)
        told = np.zeros((self.patches.walk.shape[0], 7))
        add_rows(told, self.patches.of_vertex[met], np.concatenate([inverse, light, weight], axis=1))
        for _ in range(WALK):
            told = self.patches.walk @ told
        inverse, light, weight = np.split(told, [3, 6], axis=1)
        values = np.concatenate([light**2 / np.maximum(inverse, 1e-300), light, weight], axis=1)
        known = weight[:, 0] > 0
        values[known] /= weight[known]
        values[~known] = sums.sum(axis=0) / sums[:, 6].sum()
        for reached in self.steps:
            new, row = np.unique(reached[:, 0], return_inverse=True)
            found = np.zeros((len(new), 7))
            add_rows(found, row, values[reached[:, 1]])
            values[new] = found / found[:, -1:]
        out = values[self.patches.of_vertex]
        out[self.apart] = out[self.near].mean(axis=1)
        return np.asarray(out)


def add_rows(sums: F64, rows: NDArray[np.integer], values: F64) -> None:
    """Adds values (N, C) to rows, those that meet in one row too."""
    for k in range(sums.shape[1]):
        sums[:, k] += np.bincount(rows, values[:, k], minlength=len(sums))


def _outwards(pairs: Int, known: Bool) -> Sequence[Int]:
    """Rings around what is known: those of pairs (E, 2), both ways round, that lead on from there, not known first."""
    known = known.copy()
    by_source = np.argsort(pairs[:, 1], kind="stable")
    ends = np.searchsorted(pairs[by_source, 1], np.arange(len(known) + 1))
    steps, front = list[Int](), np.flatnonzero(known)
    for _ in range(STEPS):
        count = ends[front + 1] - ends[front]
        own = np.arange(count.sum()) + np.repeat(ends[front] - np.cumsum(count) + count, count)
        reached = pairs[np.sort(by_source[own])]
        reached = reached[~known[reached[:, 0]]]
        if not len(reached):
            break
        steps.append(reached)
        front = np.unique(reached[:, 0])
        known[front] = True
    return steps


def _nearest(vertices: F32, way: Int, known: Bool) -> tuple[Int, Int]:
    """(U,) vertices that are not known but look a way that known ones do; (U, NEAREST) the nearest of those, as far as
    they lie in one plane."""
    from scipy.spatial import cKDTree

    apart, near = [np.zeros(0, np.int64)], [np.zeros((0, NEAREST), np.int64)]
    for k in range(6):
        there, asked = np.flatnonzero(known & (way == k)), np.flatnonzero(~known & (way == k))
        if len(there) and len(asked):
            ranks = np.minimum(np.arange(NEAREST) + 1, len(there))
            scale = np.where(np.arange(3) == k // 2, np.float32(OFF_PLANE), np.float32(1))
            _, found = cKDTree(vertices[there] * scale).query(vertices[asked] * scale, k=ranks, workers=-1)
            apart.append(asked)
            near.append(there[found])
    return np.concatenate(apart), np.concatenate(near)


def _edges(mesh: ProxyMesh) -> Int:
    """(E, 2) pairs of vertices that share an edge or a place."""
    f = mesh.faces.astype(np.int64)
    same = np.stack([np.arange(len(mesh.vertices)), _first_there(mesh.vertices)], axis=1)
    return np.concatenate([f[:, [0, 1]], f[:, [1, 2]], f[:, [2, 0]], same])


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
