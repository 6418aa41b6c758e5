"""Which surface points see which lights: one shadow ray each, without any shading; and what colour they are."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mirelight.base import backend
from mirelight.model import F64, ProxyMesh, Variant

if TYPE_CHECKING:
    from mirelight.lighting.kernel.proxy import DeviceProxy

Bool = NDArray[np.bool_]
_INSIDE = 2.0**-10  # smallest weight of a corner


class ShadowRays:
    """A proxy made ready for shadow rays.

    Args:
        proxy: world space.
        variant: where rays are traced.
        threads: as for tracing.

    Raises:
        BackendError: the variant cannot be used on this machine.
    """

    def __init__(self, proxy: ProxyMesh, variant: Variant = "llvm_ad_rgb", threads: int | None = None) -> None:
        backend.mitsuba(variant, threads)
        from mirelight.lighting.kernel.proxy import DeviceProxy

        self._proxy = proxy
        self._surface: DeviceProxy = DeviceProxy(proxy)

    def visible(self, face: NDArray[np.int32], position: F64, eye: F64, light: F64, offset: F64 | None = None) -> Bool:
        """(N,) True where nothing of the proxy lies between a point and a light.

        Rays start where the tracer's do, off the surface on the viewer's side.

        Args:
            face: (N,) triangle of each point.
            position: (N, 3) points on them, world space.
            eye: (3,) or (N, 3) the viewer's position, which tells the side.
            light: (4,) homogeneous: a position and 1, or the way towards a light at infinity and 0.
            offset: (N, 3) by which the rays' starts are moved; None: not at all.
        """
        import drjit as dr
        import mitsuba as mi

        from mirelight.lighting.kernel.lights import SHADOW_END
        from mirelight.lighting.kernel.memory import integers
        from mirelight.lighting.kernel.rays import bounded_ray

        if not len(face):
            return np.zeros(0, dtype=bool)
        active = mi.Bool(True)
        uv = _barycentric(self._proxy, face, position)
        at = self._surface.at(
            integers(face), mi.Point2f(*_columns(uv)), dr.normalize(_vector(position - eye, mi)), active
        )
        start = at.start if offset is None else at.start + _vector(offset, mi)
        if light[3] == 0:
            way, length = _vector(np.broadcast_to(light[:3], position.shape), mi), mi.Float(dr.inf)
        else:
            to_light = _vector(light[:3] - position - (0 if offset is None else offset), mi)
            length = dr.norm(to_light)
            way, length = to_light / length, length * SHADOW_END
        blocked = self._surface.blocked(bounded_ray(start, way, length), active)
        return np.asarray(~np.asarray(blocked.numpy(), dtype=bool))

    def albedo(self, face: NDArray[np.int32], position: F64) -> F64:
        """(N, 3) linear albedo of points (N, 3) on triangles (N,): the file's colours where the proxy shows them."""
        import mitsuba as mi

        from mirelight.lighting.kernel.memory import integers

        if not len(face):
            return np.zeros((0, 3))
        uv = mi.Point2f(*_columns(_barycentric(self._proxy, face, position)))
        at = self._surface.at(integers(face), uv, mi.Vector3f(0, 0, 1), mi.Bool(True))
        # a proxy of one colour gives a single row
        return np.broadcast_to(np.asarray(at.albedo.numpy().T, dtype=np.float64), position.shape)


def _vector(rows: F64, mi: Any) -> Any:
    return mi.Vector3f(*_columns(rows))


def _columns(rows: F64) -> list[Any]:
    from mirelight.lighting.kernel.memory import floats

    return [floats(column) for column in np.moveaxis(rows, -1, 0)]


def _barycentric(proxy: ProxyMesh, face: NDArray[np.int32], position: F64) -> F64:
    """(N, 2) weights of each triangle's second and third corner (Ericson 2004, section 3.4).

    A rasteriser's points may lie past the edge by a share of a pixel, so behind the next face of a concave fold: they
    are brought back inside.
    """
    a, b, c = np.moveaxis(proxy.vertices[proxy.faces[face]].astype(np.float64), 1, 0)
    e1, e2, p = b - a, c - a, position - a
    d11, d12, d22 = (np.einsum("ni,ni->n", x, y) for x, y in ((e1, e1), (e1, e2), (e2, e2)))
    d1, d2 = np.einsum("ni,ni->n", p, e1), np.einsum("ni,ni->n", p, e2)
    area = np.maximum(d11 * d22 - d12 * d12, 1e-300)
    second, third = (d22 * d1 - d12 * d2) / area, (d11 * d2 - d12 * d1) / area
    weights = np.maximum(np.stack([1 - second - third, second, third], axis=-1), _INSIDE)
    return np.asarray((weights / weights.sum(axis=1, keepdims=True))[:, 1:])
