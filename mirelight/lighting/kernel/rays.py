"""Camera rays from `model.Camera`: off-centre, non-square pixels and orthographic alike, with every number as data."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from mirelight.lighting.kernel.memory import integers
from mirelight.lighting.kernel.mirrors import FirstHit, seen_first
from mirelight.lighting.kernel.samples import Tiles, mix, of_pixel, pair
from mirelight.lighting.kernel.types import Float, Point2f, Point3f, Ray3f, UInt32, Vector3f
from mirelight.model import F64, Camera

if TYPE_CHECKING:
    from mirelight.lighting.kernel.proxy import DeviceProxy


def bounded_ray(origin: Point3f, d: Vector3f, length: Float) -> Ray3f:
    """Mitsuba's Ray3f that ends after `length` times d."""
    make: Callable[..., Ray3f] = mi.Ray3f
    return make(origin, d, length, mi.Float(0), mi.Color0f())


class CameraRays:
    """A camera in device memory. A ray starts on the near plane, so `near` + its length is the depth along the axis."""

    def __init__(self, camera: Camera) -> None:
        m = camera.world_from_camera
        self.right, self.up, self.back, self.eye = (vector(m[:3, k]) for k in range(4))
        self.scale = _number(1 / camera.fx), _number(1 / camera.fy)
        self.centre = _number(camera.cx), _number(camera.cy)
        self.width = dr.opaque(mi.UInt32, camera.width)
        self.near = _number(camera.near)
        reach = camera.far - camera.near
        self.reach = _number(min(reach, float(2.0**126)))
        self.perspective = _number(1.0 if camera.projection == "perspective" else 0.0)

    def sequence(self, pixel: UInt32, sample: UInt32, tiles: Tiles, seed: UInt32) -> tuple[UInt32, UInt32]:
        """(index, stream) of a pixel's sample."""
        row = pixel // self.width
        first, tile = of_pixel(pixel - row * self.width, row, tiles)
        return first + sample, mix(tile, seed)

    def first_hit(self, surface: DeviceProxy, pixel: UInt32, sample: UInt32, stream: UInt32) -> FirstHit:
        """What a sample sees."""
        return seen_first(surface, self.ray(pixel, pair(sample, stream)))

    def ray(self, pixel: UInt32, jitter: Point2f) -> Ray3f:
        """Mitsuba's Ray3f through a pixel (row-major index) at `jitter` in [0, 1)² from its corner."""
        row = pixel // self.width
        column = pixel - row * self.width
        x = (mi.Float(column) + jitter.x - self.centre[0]) * self.scale[0]
        y = (self.centre[1] - mi.Float(row) - jitter.y) * self.scale[1]
        slope = self.perspective  # 1: rays spread from the eye; 0: they start spread and stay parallel
        spread = dr.select(slope > 0, self.near, 1)
        d = (self.right * x + self.up * y) * slope - self.back
        o = self.eye + (self.right * x + self.up * y) * spread - self.back * self.near
        return bounded_ray(mi.Point3f(o), d, self.reach)

    def depth(self, p: Point3f, far: Float | None) -> Float:
        """Distance along the view axis of a point, or of what is seen `far` behind mirrors."""
        return -dr.dot(mi.Vector3f(p) - self.eye, self.back) if far is None else self.near + far


class SomePixels:
    """Some pixels of a camera (n,) as if they were all."""

    def __init__(self, camera: Camera, pixels: NDArray[np.int64]) -> None:
        self.rays, self.pixels = CameraRays(camera), integers(np.append(pixels, [0, 0]))

    def sequence(self, pixel: UInt32, sample: UInt32, tiles: Tiles, seed: UInt32) -> tuple[UInt32, UInt32]:
        """(index, stream) of a sample: each pixel has a sequence of its own."""
        return sample, mix(pixel, seed)

    def first_hit(self, surface: DeviceProxy, pixel: UInt32, sample: UInt32, stream: UInt32) -> FirstHit:
        """As `CameraRays` does it, for these pixels."""
        return self.rays.first_hit(surface, dr.gather(mi.UInt32, self.pixels, pixel), sample, stream)

    def depth(self, p: Point3f, far: Float | None) -> Float:
        """As `CameraRays` does it, for these pixels."""
        return self.rays.depth(p, far)


def _number(value: float) -> Float:
    return dr.opaque(mi.Float, value)


def vector(value: F64) -> Vector3f:
    """Three numbers as an opaque Vector3f."""
    return mi.Vector3f(*(_number(float(x)) for x in value))
