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
MOST_CELLS = 1 << 17  # that its surface fills, about, on one side


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
    size = float(np.clip(thin / 2, FINEST * diagonal, COARSEST * diagonal))
    area = float(triangles.areas(proxy.vertices[proxy.faces].astype(np.float64)).sum())
    return max(size, float(np.sqrt(area / MOST_CELLS)))


def thicknesses(surface: DeviceProxy, proxy: ProxyMesh) -> F64:
    """Distances, world units, from points spread evenly over the proxy through it to its next face; (n,) n <= 2 RAYS.

    A mesh is lit from both sides, so either may be the wall's inside: both are looked along and the smaller counts.
    """
    from mirelight.lighting.kernel.cells import free_distance

    corners = proxy.vertices[proxy.faces].astype(np.float64)
    face, weights = triangles.strewn(corners, RAYS)
    if not len(face):
        return np.zeros(0)
    points = (corners[face] * weights[:, :, None]).sum(axis=1)
    normals = triangles.normals(corners[face])
    apart = np.minimum(*(free_distance(surface, points, side * normals) for side in (1.0, -1.0)))
    return np.asarray(apart[np.isfinite(apart)])
