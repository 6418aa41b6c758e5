"""How large a cell of a surface may be: from how thick the proxy's walls are, found by short rays into them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mirelight.model import F64, ProxyMesh, triangles

if TYPE_CHECKING:
    from mirelight.lighting.kernel.proxy import DeviceProxy

RAYS = 1 << 14
THIN = 0.05  # this share of the surface may be thinner
FINEST, COARSEST = 1 / 128, 1 / 48  # of the proxy's diagonal


def cell_size(surface: DeviceProxy, proxy: ProxyMesh) -> float:
    """Half of what but a few walls are thicker than, within bounds that keep the number of cells in reason.

    A wall thinner than a cell does not leak, as cells lie on one side of it; a cell of its thickness only follows
    what the wall casts.
    """
    low, high = (x.astype(np.float64) for x in proxy.bounds)
    diagonal = float(np.linalg.norm(high - low))
    if not diagonal > 0:
        return 1.0
    found = thicknesses(surface, proxy)
    thin = float(np.quantile(found, THIN)) if len(found) else np.inf
    return float(np.clip(thin / 2, FINEST * diagonal, COARSEST * diagonal))


def thicknesses(surface: DeviceProxy, proxy: ProxyMesh, count: int = RAYS) -> F64:
    """Distances, world units, from points spread evenly over the proxy through it to its next face; (n,) n <= 2 count.

    A mesh is lit from both sides, so either may be the wall's inside: both are looked along and the smaller counts.
    """
    from mirelight.lighting.kernel.cells import free_distance

    corners = proxy.vertices[proxy.faces].astype(np.float64)
    e1, e2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    cross = triangles.crossed(corners)
    area = np.linalg.norm(cross, axis=1)
    if not area.sum() > 0:
        return np.zeros(0)
    spread = (np.arange(count) + 0.5) / count
    face = np.searchsorted(np.cumsum(area) / area.sum(), spread).clip(0, len(area) - 1)
    face = face[area[face] > 0]
    u, v = np.random.default_rng(0).random((2, len(face), 1))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    points = corners[face, 0] + u * e1[face] + v * e2[face]
    normals = cross[face] / area[face, None]
    apart = np.minimum(*(free_distance(surface, points, side * normals) for side in (1.0, -1.0)))
    return np.asarray(apart[np.isfinite(apart)])
