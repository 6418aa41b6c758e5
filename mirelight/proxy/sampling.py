"""Points spread over the triangles of a mesh, and over others."""

from __future__ import annotations

import numpy as np

from mirelight.model import F64, triangles
from mirelight.proxy.types import Int


def spread(vertices: F64, faces: Int, count: int) -> F64:
    """(count, 3) points on triangles, by area, the same ones every time; corners where the mesh has no area."""
    return spread_on(vertices, faces, count)[0]


def spread_on(vertices: F64, faces: Int, count: int) -> tuple[F64, Int]:
    """As :func:`spread`, and (count,) the triangle that each lies on."""
    area = np.cumsum(triangles.areas(vertices[faces]))
    if not len(faces) or not area[-1] > 0:
        corners = faces.ravel()[:count]
        return vertices[corners], np.arange(len(corners)) // 3
    k = np.arange(count) + 0.5
    face = np.minimum(np.searchsorted(area, k / count * area[-1]), len(faces) - 1)
    u, v = np.sqrt(k * 0.7548776662 % 1), k * 0.5698402910 % 1  # Roberts' R2 sequence
    a, b, c = (vertices[faces[face, i]] for i in range(3))
    return a * (1 - u)[:, None] + b * (u * (1 - v))[:, None] + c * (u * v)[:, None], face


def far_apart(points: F64, first: int, count: int, worth: F64 | float = 0.0) -> Int:
    """(count,) rows of points (N, 3), from the first one on each the farthest from all before it; `worth` (N,) is added
    to how far each is."""
    chosen, apart = [first], np.linalg.norm(points - points[first], axis=1)
    while len(chosen) < count:
        chosen.append(int(np.argmax(apart + worth)))
        apart = np.minimum(apart, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return np.array(chosen, np.int64)
