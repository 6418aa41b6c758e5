"""How much light of an even sky comes to a surface.

What no splat shows is as bright as what lies beside it, but for how much less light comes there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mirelight.estimate.tuning import TUNING
from mirelight.lighting import Tracer
from mirelight.model import F64, Environment, Lighting, ProxyMesh

# what lies below the horizon is ground, beyond where the proxy ends
_RINGS = np.array([1.0, 1.0, TUNING.mean_albedo, TUNING.mean_albedo], np.float32)
_SKY = Lighting(
    name="even",
    environment=Environment(name="sky", radiance=np.broadcast_to(_RINGS[:, None, None], (4, 8, 3)).copy()),
)


@dataclass(frozen=True, slots=True, eq=False)
class Shade:
    """The light of an even sky of radiance 1, over gray ground, on a mesh that is all of one gray."""

    tracer: Tracer
    low: F64  # (3,) least corner of the mesh's bounds
    cell: float  # world units, of the cells that :meth:`of_cells` has one value for

    @staticmethod
    def of(tracer: Tracer, mesh: ProxyMesh) -> Shade:
        """Of a mesh, and its tracer."""
        low, high = (x.astype(np.float64) for x in mesh.bounds)
        return Shade(tracer, low, max(float(np.linalg.norm(high - low)) / TUNING.shade_cells, 1e-30))

    def at(self, points: F64, normals: F64) -> F64:
        """(N,) irradiance / pi at points (N, 3) of the mesh, on the side that normals (N, 3) point to."""
        made = self.tracer.point_layers(_SKY, points, normals, TUNING.shade_spp, emission=False)
        return np.asarray(made.total.mean(axis=1), np.float64) / np.pi

    def of_cells(self, points: F64, normals: F64) -> F64:
        """(N,) the same at points (N, 3), one value for all of a cell whose normals (N, 3) point along the same of the
        six main directions."""
        axis = np.abs(normals).argmax(axis=1)
        way = 2 * axis + (np.take_along_axis(normals, axis[:, None], axis=1)[:, 0] < 0)
        x, y, z = np.clip(np.floor((points - self.low) / self.cell), 0, 4095).astype(np.int64).T
        key = ((x << 12 | y) << 12 | z) * 6 + way
        _, first, of = np.unique(key, return_index=True, return_inverse=True)
        return self.at(points[first], normals[first])[of.ravel()]
