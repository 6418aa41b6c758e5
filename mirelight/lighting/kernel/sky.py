"""The environment on the device: radiance by direction, and importance sampling of its bright parts."""

from __future__ import annotations

import math

import drjit as dr
import mitsuba as mi
import numpy as np

from mirelight.lighting.environment import distribution, pixels_per_cell
from mirelight.lighting.kernel.memory import floats, integers
from mirelight.lighting.kernel.proxy import DeviceProxy, Point
from mirelight.lighting.kernel.rays import bounded_ray
from mirelight.lighting.kernel.scatter import Gloss, reflected, towards
from mirelight.lighting.kernel.see_through import tinted
from mirelight.lighting.kernel.types import Bool, Float, Point2f, UInt32, Vector3f, Vector4f
from mirelight.model import F32, Environment


class Sky:
    """An environment map in device memory. Its size, pixels and rotation are data, never compiled in."""

    def __init__(self, environment: Environment | None) -> None:
        """None is black. A constant one is sampled by reflection alone."""
        radiance = np.zeros((2, 2, 3), np.float32) if environment is None else environment.pixels
        intensity, rotation = (0.0, 0.0) if environment is None else (environment.intensity, environment.rotation)
        if radiance.shape[:2] == (1, 1):
            radiance = np.tile(radiance, (2, 2, 1))  # a single texel would be compiled in
        h, w = radiance.shape[:2]
        self.texels = _texels(radiance, intensity)
        drawn = distribution(_brightness(self.texels, h, w))
        rows, columns = drawn.density.shape
        self.slots = integers(drawn.slots)
        self.density = floats(drawn.density)
        self.size = dr.opaque(mi.UInt32, w), dr.opaque(mi.UInt32, h)
        self.cells = dr.opaque(mi.UInt32, columns), dr.opaque(mi.UInt32, rows)
        self.slot_count = dr.opaque(mi.UInt32, len(drawn.slots))
        self.is_sampled = len(drawn.slots) > 2
        self.sampled = dr.opaque(mi.Bool, self.is_sampled)
        self.present = dr.opaque(mi.Bool, environment is not None)
        angle = math.radians(rotation)
        self.sin, self.cos = dr.opaque(mi.Float, math.sin(angle)), dr.opaque(mi.Float, math.cos(angle))

    def uv(self, d: Vector3f) -> tuple[Float, Float]:
        """Map coordinates in [0, 1]² of a unit direction (conventions.py: u = 0.5 is +X, 0.75 is +Z, v = 0 is +Y)."""
        x = d.x * self.cos - d.z * self.sin
        z = d.x * self.sin + d.z * self.cos
        return 0.5 + dr.atan2(z, x) * dr.inv_two_pi, dr.safe_acos(d.y) * dr.inv_pi

    def direction(self, u: Float, v: Float) -> Vector3f:
        """The unit direction at map coordinates; the inverse of `uv`."""
        sin_phi, cos_phi = dr.sincos(dr.two_pi * (u - 0.5))
        sin_theta, cos_theta = dr.sincos(dr.pi * v)
        x, z = cos_phi * sin_theta, sin_phi * sin_theta
        return mi.Vector3f(x * self.cos + z * self.sin, cos_theta, z * self.cos - x * self.sin)

    def radiance(self, d: Vector3f, active: Bool) -> Vector3f:
        """Vector3f radiance arriving from direction d, bilinear between pixel centres."""
        w, h = self.size
        u, v = self.uv(d)
        x, y = u * mi.Float(w) + (mi.Float(w) - 0.5), dr.clip(v * mi.Float(h) - 0.5, 0, mi.Float(h) - 1)
        x_low, y_low = dr.floor(x), dr.floor(y)
        fx, fy = x - x_low, y - y_low
        x0 = mi.UInt32(x_low)
        x0 = dr.select(x0 >= w, x0 - w, x0)
        x0 = dr.select(x0 >= w, x0 - w, x0)
        x1 = dr.select(x0 + 1 >= w, 0, x0 + 1)
        y0 = mi.UInt32(y_low)
        y1 = dr.minimum(y0 + 1, h - 1)

        def texel(x: UInt32, y: UInt32) -> Vector4f:
            return dr.gather(mi.Vector4f, self.texels, y * w + x, active)

        value = dr.lerp(
            dr.lerp(texel(x0, y0), texel(x1, y0), fx),
            dr.lerp(texel(x0, y1), texel(x1, y1), fx),
            fy,
        )
        return mi.Vector3f(value.x, value.y, value.z)

    def _density(self, column: UInt32, row: UInt32, sin_theta: Float, active: Bool) -> Float:
        """Probability per solid angle of a cell's light samples."""
        flat = dr.gather(mi.Float, self.density, row * self.cells[0] + column, active)
        return dr.select(sin_theta > 1e-6, flat / (2 * dr.square(mi.Float(dr.pi)) * sin_theta), 0)

    def pdf(self, d: Vector3f, active: Bool) -> Float:
        """Density with which `sample` draws direction d; 0 where it never does."""
        columns, rows = self.cells
        u, v = self.uv(d)
        column = dr.minimum(mi.UInt32(u * mi.Float(columns)), columns - 1)
        row = dr.minimum(mi.UInt32(v * mi.Float(rows)), rows - 1)
        active = active & self.sampled
        return dr.select(active, self._density(column, row, dr.safe_sqrt(1 - d.y * d.y), active), 0)

    def sample(self, choice: Float, inside: Point2f, active: Bool) -> tuple[Vector3f, Float]:
        """(direction, density): a cell by `choice` in [0, 1), then a place `inside` it in [0, 1)²."""
        columns, rows = self.cells
        slot = dr.minimum(mi.UInt32(choice * mi.Float(self.slot_count)), self.slot_count - 1)
        cell = dr.gather(mi.UInt32, self.slots, slot, active)
        column, row = cell & 0xFFFF, cell >> 16
        u = (mi.Float(column) + inside.x) / mi.Float(columns)
        v = (mi.Float(row) + inside.y) / mi.Float(rows)
        d = self.direction(u, v)
        return d, self._density(column, row, dr.safe_sqrt(1 - d.y * d.y), active)


def _texels(radiance: F32, intensity: float) -> Float:
    """(h * w * 4) radiance times intensity, and 0: one packet gather reads a texel."""
    source, scale = floats(radiance), dr.opaque(mi.Float, intensity)
    pixel = dr.arange(mi.UInt32, radiance.shape[0] * radiance.shape[1])
    r, g, b = (dr.gather(mi.Float, source, pixel * 3 + k) * scale for k in range(3))
    texels = dr.empty(mi.Float, dr.width(pixel) * 4)
    dr.scatter(texels, mi.Vector4f(r, g, b, 0), pixel)
    dr.eval(texels)
    return texels


@dr.syntax
def _mean_brightness(
    texels: Float, cell: UInt32, columns: UInt32, block: UInt32, width: UInt32, height: UInt32
) -> Float:
    """Mean over a cell's pixels of the sum of their channels."""
    row = cell // columns
    top, left = row * block, (cell - row * columns) * block
    bottom, right = dr.minimum(top + block, height), dr.minimum(left + block, width)
    total, y = mi.Float(0), mi.UInt32(top)
    while y < bottom:
        x = mi.UInt32(left)
        while x < right:
            q = dr.gather(mi.Vector4f, texels, y * width + x)
            total += dr.maximum(q.x + q.y + q.z, 0)
            x += 1
        y += 1
    return total / mi.Float((bottom - top) * (right - left))


def _brightness(texels: Float, height: int, width: int) -> F32:
    """(rows, columns) of the sampling grid."""
    block = pixels_per_cell(height, width)
    rows, columns = -(-height // block), -(-width // block)
    cell = dr.arange(mi.UInt32, rows * columns)
    size = [dr.opaque(mi.UInt32, n) for n in (columns, block, width, height)]
    return np.asarray(_mean_brightness(texels, cell, *size).numpy().reshape(rows, columns))


def sky_irradiance(
    surface: DeviceProxy, sky: Sky, at: Point, gloss: Gloss | None, choice: Float, inside: Point2f, active: Bool
) -> Vector3f:
    """The environment's light on a point by one sample of its map, weighted against the reflected ray's density."""
    d, drawn = sky.sample(choice, inside, active)
    cosine = dr.dot(d, at.normal)
    lit = active & (cosine > 0) & (drawn > 0)
    reached, tint = surface.reached(bounded_ray(at.start, d, mi.Float(dr.inf)), lit)
    value, reflecting = towards(gloss, cosine, d)
    light = tinted(sky.radiance(d, lit) * (cosine / (drawn + reflecting)), tint)
    return dr.select(lit & reached, reflected(light, value), 0)
