"""A mesh of the zero level of signed distances: naive surface nets (Gibson, 1998), on the known nodes alone."""

from __future__ import annotations

import numpy as np

from mirelight.model import F64
from mirelight.proxy.fusion import Grid
from mirelight.proxy.types import Int, Soup


def surface_of(grid: Grid) -> Soup:
    """Triangles where the distance passes zero between known nodes, facing where it grows.

    Each cube that the surface crosses has one vertex, the mean of the crossings on its edges; each crossed edge joins
    the four cubes around it.
    """
    ny, nz = grid.shape[1:]
    strides = np.array([ny * nz, nz, 1], np.int64)
    place = np.stack(np.unravel_index(grid.nodes, grid.shape), axis=1)
    value = grid.distance.astype(np.float64)
    cubes, crossings, quads = [], [], []
    if not len(value):
        return Soup(np.zeros((0, 3)), np.zeros((0, 3), np.int64))
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        inner = (place[:, axis] < grid.shape[axis] - 1) & (place[:, u] > 0) & (place[:, v] > 0)
        inner &= (place[:, u] < grid.shape[u] - 1) & (place[:, v] < grid.shape[v] - 1)
        first = np.flatnonzero(inner)
        wanted = grid.nodes[first] + strides[axis]
        other = np.minimum(np.searchsorted(grid.nodes, wanted), len(value) - 1)
        there = grid.nodes[other] == wanted
        first, other = first[there], other[there]
        crossed = (value[first] < 0) != (value[other] < 0)
        first, other = first[crossed], other[crossed]
        t = value[first] / (value[first] - value[other])
        at = place[first].astype(np.float64)
        at[:, axis] += t
        node = grid.nodes[first]
        around = np.stack([node - strides[u] - strides[v], node - strides[v], node, node - strides[u]], axis=1)
        outward = value[first] < 0
        quads.append(np.where(outward[:, None], around, around[:, ::-1]))
        cubes.append(around.ravel())
        crossings.append(np.repeat(at, 4, axis=0))
    cube, index = np.unique(np.concatenate(cubes), return_inverse=True)
    points, count = np.concatenate(crossings), np.bincount(index, minlength=len(cube))
    sums = np.stack([np.bincount(index, points[:, k], minlength=len(cube)) for k in range(3)], axis=1)
    vertices = sums / np.maximum(count, 1)[:, None] * grid.cell + grid.low
    return Soup(vertices, _split(vertices, np.searchsorted(cube, np.concatenate(quads))))


def _split(vertices: F64, quads: Int) -> Int:
    """Two triangles a quad, along its shorter diagonal."""
    a, b, c, d = quads.T
    other = np.linalg.norm(vertices[a] - vertices[c], axis=1) > np.linalg.norm(vertices[b] - vertices[d], axis=1)
    one = np.where(other[:, None], np.stack([a, b, d], axis=1), np.stack([a, b, c], axis=1))
    two = np.where(other[:, None], np.stack([b, c, d], axis=1), np.stack([a, c, d], axis=1))
    return np.concatenate([one, two])
