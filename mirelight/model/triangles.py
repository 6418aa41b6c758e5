"""Which way triangles look, and how large they are."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

_GOLDEN = np.array([0.7548776662466927, 0.5698402909980532])  # Roberts 2018: an even sequence of points in a square
_Float = TypeVar("_Float", np.float32, np.float64)


def crossed(corners: NDArray[_Float]) -> NDArray[_Float]:
    """(F, 3) normals of triangles (F, 3 corners, 3) by the winding, as long as twice their areas."""
    (ax, ay, az), (bx, by, bz) = (np.moveaxis(corners[:, k] - corners[:, 0], 1, 0) for k in (1, 2))
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=1)


def normals(corners: NDArray[_Float]) -> NDArray[_Float]:
    """(F, 3) unit normals of triangles (F, 3 corners, 3); of those without area they have length 0."""
    long = crossed(corners)
    size = np.linalg.norm(long, axis=1, keepdims=True)
    return np.asarray(long / np.maximum(size, np.finfo(long.dtype).tiny))


def areas(corners: NDArray[_Float]) -> NDArray[_Float]:
    """(F,) areas of triangles (F, 3 corners, 3)."""
    return np.asarray(np.linalg.norm(crossed(corners), axis=1) / 2)


def barycentric(corners: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float32]:
    """(F, 3) weights, 0 or more and of sum 1, of the corners (F, 3, 3) of triangles at points (F, 3) on them."""
    a, b, c = (corners[:, k] for k in range(3))
    along = crossed(corners)

    def part(first: NDArray[np.float64], second: NDArray[np.float64]) -> NDArray[np.float64]:
        """By the area between a point and the side opposite to a corner."""
        return np.asarray((crossed(np.stack([points, first, second], axis=1)) * along).sum(axis=1))

    weights = np.maximum(np.stack([part(b, c), part(c, a), part(a, b)], axis=1), 0)
    total = weights.sum(axis=1, keepdims=True)
    return np.where(total > 0, weights / np.maximum(total, 1e-300), 1 / 3).astype(np.float32)


def distances_to(corners: NDArray[np.float64], point: NDArray[np.float64]) -> NDArray[np.float64]:
    """(F,) from a point (3,) to the nearest of each triangle (F, 3 corners, 3)."""
    sides, to = np.roll(corners, -1, axis=1) - corners, point - corners
    along = np.einsum("fck,fck->fc", to, sides) / np.maximum(np.einsum("fck,fck->fc", sides, sides), 1e-300)
    to_sides = np.linalg.norm(to - np.clip(along, 0, 1)[..., None] * sides, axis=2).min(axis=1)
    long = crossed(corners)
    size = np.linalg.norm(long, axis=1)
    above = (np.einsum("fk,fck->fc", long, np.cross(sides, to)) >= 0).all(axis=1) & (size > 0)
    to_plane = np.abs(np.einsum("fk,fk->f", long, to[:, 0])) / np.where(above, size, 1)
    return np.asarray(np.where(above, to_plane, to_sides))


def vertex_normals(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> NDArray[np.float64]:
    """(V, 3) unit means of the normals of the faces (F, 3) around vertices (V, 3), by area; length 0 where none are."""
    own = crossed(vertices[faces])
    sums = np.zeros_like(vertices)
    for corner in range(3):
        for k in range(3):
            sums[:, k] += np.bincount(faces[:, corner], own[:, k], len(vertices))
    return np.asarray(sums / np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), np.finfo(np.float64).tiny))


def strewn(corners: NDArray[np.float64], count: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Places spread evenly over triangles (F, 3 corners, 3) by area, the same ones every time.

    Returns:
        (n,) triangle of each, n <= count; (n, 3) weights of its corners.
    """
    up_to = np.cumsum(areas(corners))
    if not len(up_to) or not up_to[-1] > 0:
        return np.zeros(0, np.int64), np.zeros((0, 3))
    i = np.arange(count)
    face = np.searchsorted(up_to, (i + 0.5) / count * up_to[-1], side="right")
    s, t = ((0.5 + (i[:, None] + 1) * _GOLDEN) % 1).T
    root = np.sqrt(s)  # uniform on a triangle
    return face, np.stack([1 - root, root * (1 - t), root * t], axis=1)
