"""The planes of a proxy's mirrors, and what lies behind them turned over: there it is what it shows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirelight.model import F64, ProxyMesh, triangles

_ALIKE, _NEAR = 0.999, 2e-3  # cosine between faces of one plane; how far they lie apart, of the bounds' diagonal


@dataclass(frozen=True, slots=True, eq=False)
class MirrorPlane:
    """The plane of one mirror or of several."""

    normal: F64  # (3,) unit, to the side that it mirrors
    offset: float

    def behind(self, points: F64) -> NDArray[np.bool_]:
        """(N,) which points (N, 3) lie behind it."""
        return self._before(points) < 0

    def points(self, points: F64) -> F64:
        """(N, 3) points turned over."""
        return points - 2 * self._before(points)[:, None] * self.normal

    def axes(self, axes: F64) -> F64:
        """(N, 3, 3) directions turned over, the columns."""
        return np.asarray(axes - 2 * self.normal[:, None] * np.einsum("i,nij->nj", self.normal, axes)[:, None, :])

    def _before(self, points: F64) -> F64:
        """(N,) how far points (N, 3) lie before it."""
        return np.asarray(np.einsum("nk,k->n", points, self.normal)) - self.offset


def planes_of(proxy: ProxyMesh) -> list[MirrorPlane]:
    """The planes in which a proxy's mirrors lie, the one with the largest face first."""
    if proxy.mirrors is None:
        return []
    corners = proxy.vertices[proxy.faces[proxy.mirrors]].astype(np.float64)
    low, high = proxy.bounds
    near = _NEAR * float(np.linalg.norm(high.astype(np.float64) - low))
    normals, middles = triangles.normals(corners), corners.mean(axis=1)
    left = np.argsort(-triangles.areas(corners), kind="stable")
    out = []
    while len(left):
        normal, offset = normals[left[0]], float(normals[left[0]] @ middles[left[0]])
        same = (normals[left] @ normal > _ALIKE) & (np.abs(middles[left] @ normal - offset) < near)
        same[0] = True
        out.append(MirrorPlane(normal, offset))
        left = left[~same]
    return out
