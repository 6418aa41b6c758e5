"""Which way triangles look, and how large they are."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

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


def vertex_normals(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> NDArray[np.float64]:
    """(V, 3) unit means of the normals of the faces (F, 3) around vertices (V, 3), by area; length 0 where none are."""
    own = crossed(vertices[faces])
    sums = np.zeros_like(vertices)
    for corner in range(3):
        for k in range(3):
            sums[:, k] += np.bincount(faces[:, corner], own[:, k], len(vertices))
    return np.asarray(sums / np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), np.finfo(np.float64).tiny))
