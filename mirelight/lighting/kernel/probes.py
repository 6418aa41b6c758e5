"""A view whose pixels are points of the surface, and the surface point that lies nearest along given directions."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from mirelight.lighting.kernel.memory import floats, in_fours
from mirelight.lighting.kernel.mirrors import FirstHit
from mirelight.lighting.kernel.proxy import DeviceProxy
from mirelight.lighting.kernel.rays import bounded_ray
from mirelight.lighting.kernel.samples import Tiles, mix
from mirelight.lighting.kernel.types import Float, Point3f, UInt32, Vector3f
from mirelight.model import F32, F64, I32

LIFT = 2.0**-14  # of the largest coordinate: how far before its point a probe's ray starts


class PointRays:
    """Stands in for a camera: pixel k looks at point k of the surface from just before it, along its normal."""

    def __init__(self, points: F64, normals: F64) -> None:
        self.lift = float(np.abs(points).max(initial=1e-6)) * LIFT
        self._points = in_fours(np.asarray(points + normals * self.lift, np.float32))
        self._ways = in_fours(np.asarray(-normals, np.float32))
        self._reach = dr.opaque(mi.Float, 2 * self.lift)  # a literal would make a kernel for each set of points

    def sequence(self, pixel: UInt32, sample: UInt32, tiles: Tiles, seed: UInt32) -> tuple[UInt32, UInt32]:
        """(index, stream) of a sample: each point has a sequence of its own."""
        return sample, mix(pixel, seed)

    def first_hit(self, surface: DeviceProxy, pixel: UInt32, sample: UInt32, stream: UInt32) -> FirstHit:
        """The point, in any sample."""
        o, d = (dr.gather(mi.Vector4f, buffer, pixel) for buffer in (self._points, self._ways))
        way = mi.Vector3f(d.x, d.y, d.z)
        ray = bounded_ray(mi.Point3f(o.x, o.y, o.z), way, self._reach)
        found = surface.nearest(ray, mi.Bool(True), coherent=True)
        face, uv = mi.UInt32(found.prim_index), mi.Point2f(found.prim_uv)
        return FirstHit(mi.Bool(found.is_valid()), face, uv, dr.normalize(way))

    def depth(self, p: Point3f, far: None) -> Float:
        """Zero: points in space have no depth."""
        return mi.Float(p.x * 0)


def materials_at(surface: DeviceProxy, points: F64, normals: F64) -> tuple[F32, F32]:
    """(N, 3) albedo and (N, 3) radiance of points of the surface, each 0 where there is none; as for `PointRays`."""
    if not len(points):
        return np.zeros((0, 3), np.float32), np.zeros((0, 3), np.float32)
    pixel = dr.arange(mi.UInt32, len(points))
    there, face, uv, d, *_ = PointRays(points, normals).first_hit(surface, pixel, pixel, pixel)
    at = surface.at(face, uv, d, there)
    both = dr.select(there, at.albedo, 0), dr.select(there, at.emission, 0)
    dr.eval(both)
    albedo, emission = (np.stack([_numpy(x.x), _numpy(x.y), _numpy(x.z)], axis=1).astype(np.float32) for x in both)
    return albedo, emission


def nearest_along(surface: DeviceProxy, origins: F64, directions: F64, reach: float) -> tuple[I32, F32, F64]:
    """The nearest point of the surface on each line, both ways.

    Args:
        surface: the mesh.
        origins: (N, 3).
        directions: (N, 3) unit directions.
        reach: farthest distance, world units.

    Returns:
        (N,) face, -1 where there is none; (N, 3) barycentric weights of its corners; (N,) distance.
    """
    slack = 0.05 * reach  # rays start a little behind, for an origin that lies on the surface
    face, uv, distance = np.full(len(origins), -1, np.int32), np.zeros((len(origins), 2)), np.full(len(origins), np.inf)
    for d in (directions, -directions):
        ray = bounded_ray(_points(origins - d * slack), _vectors(d), dr.opaque(mi.Float, reach + slack))
        found = surface.nearest(ray, mi.Bool(True))
        hit = _numpy(found.is_valid())
        away = np.abs(np.where(hit, _numpy(found.t).astype(np.float64), np.inf) - slack)
        nearer = hit & (away < distance)
        face[nearer] = _numpy(found.prim_index)[nearer]
        uv[nearer] = np.stack([_numpy(found.prim_uv.x), _numpy(found.prim_uv.y)], axis=1)[nearer]
        distance[nearer] = away[nearer]
    weights = np.concatenate([1 - uv.sum(axis=1, keepdims=True), uv], axis=1)
    return face, weights.astype(np.float32), distance


def first_hits(surface: DeviceProxy, origins: F64, directions: F64) -> tuple[I32, F64]:
    """The nearest point of the surface along each ray.

    Args:
        surface: the mesh.
        origins: (N, 3).
        directions: (N, 3) directions of any length.

    Returns:
        (N,) face, -1 where there is none; (N,) how often the direction goes into the distance, infinite there.
    """
    ray = bounded_ray(_points(origins), _vectors(directions), mi.Float(float(2.0**126)))
    found = surface.nearest(ray, mi.Bool(True))
    hit = _numpy(found.is_valid())
    face = np.where(hit, _numpy(found.prim_index).astype(np.int64), -1)
    return face.astype(np.int32), np.where(hit, _numpy(found.t).astype(np.float64), np.inf)


def blocked(surface: DeviceProxy, origins: F64, directions: F64) -> NDArray[np.bool_]:
    """(N,) whether the surface lies on each ray; arguments as for `first_hits`."""
    ray = bounded_ray(_points(origins), _vectors(directions), mi.Float(float(2.0**126)))
    return np.asarray(_numpy(surface.blocked(ray, mi.Bool(True))), bool)


def _numpy(value: Any) -> NDArray[Any]:
    return np.asarray(value.numpy())


def _points(rows: F64) -> Point3f:
    return mi.Point3f(*(floats(rows[:, k]) for k in range(3)))


def _vectors(rows: F64) -> Vector3f:
    return mi.Vector3f(*(floats(rows[:, k]) for k in range(3)))
