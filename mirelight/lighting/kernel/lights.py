"""Sampling of the light table on the device: irradiance from one light at one point, before any shadow."""

from __future__ import annotations

from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from mirelight.lighting.grid import LightGrid
from mirelight.lighting.kernel.memory import floats, integers
from mirelight.lighting.kernel.rays import vector
from mirelight.lighting.kernel.samples import pair
from mirelight.lighting.kernel.types import Bool, Float, LightSample, Point2f, Point3f, UInt32, Vector3f
from mirelight.lighting.lights import ROW, Kind
from mirelight.model import F32
from mirelight.model.ies import AROUND, DOWN

_WIDE = 0.02  # sr; narrower rectangles are sampled by area: single precision fails the formula, and it is as good
SHADOW_END = (
    1.0 - 2.0**-10
)  # how far a shadow ray goes to its light, so that a lamp on a wall is not in the wall's shadow


class _Tube(NamedTuple):
    """A glowing tube as a point sees it."""

    axis: Vector3f
    radius: Float
    radiance: Vector3f
    toward: Vector3f  # unit, from the point to the axis, across it
    away: Float  # distance to the axis
    low: Float  # where the tube begins and ends along the axis, from the point
    high: Float

    def strip(self, sine: Float, cosine: Float) -> tuple[Float, Float, Float]:
        """Of the strip at an angle around the axis: its distance across the axis, the sines of its ends' elevations."""
        near = self.away * cosine - dr.safe_sqrt(dr.square(self.radius) - dr.square(self.away * sine))
        return near, self.low * dr.rsqrt(self.low**2 + near**2), self.high * dr.rsqrt(self.high**2 + near**2)


class LightSet:
    """The light table and the lists of who reaches where (`mirelight.lighting.lights`, `grid`) in device memory."""

    def __init__(
        self,
        table: F32,
        seeds: NDArray[np.uint32],
        grid: LightGrid,
        layer_of_light: NDArray[np.uint32],
        sun_shares: F32,
    ) -> None:
        self.table, self.seeds = floats(table), integers(seeds)
        self.count = dr.opaque(mi.UInt32, len(layer_of_light))
        self.layer_of_light = integers(layer_of_light)
        self.sun_shares = floats(sun_shares)
        self.starts = integers(grid.starts)
        self.items = integers(np.append(grid.lights, np.zeros(2, np.uint32)))
        self.low, self.cells_per_unit = vector(grid.low), vector(grid.cells_per_unit)
        self.resolution = [dr.opaque(mi.UInt32, n) for n in grid.resolution]
        self._picks = [dr.opaque(mi.UInt32, n) for n in grid.picks]

    def picks(self, depth: UInt32) -> UInt32:
        """Most lights that are sampled at a hit: at the first, the second, and each later one."""
        first, second, later = self._picks
        return dr.select(depth == 0, first, dr.select(depth == 1, second, later))

    def extended(self, light: UInt32) -> Bool:
        """Whether a light is more than a point or a direction, so that one ray to it tells little."""
        return dr.gather(mi.Float, self.table, light * ROW + 3) > float(Kind.SPOT)

    def list_at(self, p: Point3f, active: Bool) -> tuple[UInt32, UInt32]:
        """(start, count) of the list for a point: entries of `items`."""
        place = (mi.Vector3f(p) - self.low) * self.cells_per_unit
        x, y, z = (dr.minimum(mi.UInt32(dr.maximum(q, 0)), n - 1) for q, n in zip(place, self.resolution, strict=True))
        cell = (x * self.resolution[1] + y) * self.resolution[2] + z
        start = dr.gather(mi.UInt32, self.starts, cell, active)
        return start, dr.gather(mi.UInt32, self.starts, cell + 1, active) - start


def _group(table: Float, row: UInt32, group: int) -> tuple[Vector3f, Float]:
    """One group of four floats of a row, as (Vector3f, Float)."""
    v = dr.gather(mi.Vector4f, table, row * 6 + group)
    return mi.Vector3f(v.x, v.y, v.z), v.w


def _cone_direction(axis: Vector3f, one_minus_cos: Float, u: Point2f) -> Vector3f:
    """A direction drawn evenly over the solid angle of a cone about `axis`."""
    z = u.x * one_minus_cos  # 1 - cos
    r = dr.safe_sqrt(z * (2 - z))
    sin_phi, cos_phi = dr.sincos(dr.two_pi * u.y)
    s, t = mi.coordinate_system(axis)
    return s * (r * cos_phi) + t * (r * sin_phi) + axis * (1 - z)


def _punctual(table: Float, row: UInt32, position: Vector3f, kind: Float, p: Vector3f) -> LightSample:
    """(way to the light's centre, its distance, irradiance on a facing surface) by KHR_lights_punctual."""
    axis, _ = _group(table, row, 1)
    strength, inverse_range = _group(table, row, 2)
    cone, profile = _group(table, row, 5)
    far = (kind == float(Kind.DIRECTIONAL)) | (kind == float(Kind.SUN))
    to_light = dr.select(far, position, position - p)
    d2 = dr.squared_norm(to_light)
    inverse = dr.select(d2 > 0, dr.rsqrt(d2), 0)
    wi = to_light * inverse
    distance = dr.select(far, dr.inf, d2 * inverse)
    window = dr.clip(1 - dr.square(dr.square(distance * inverse_range)), 0, 1)
    t = dr.clip(dr.fma(dr.dot(axis, wi), -cone.x, cone.y), 0, 1)
    angular = dr.square(t) * dr.fma(cone.z, 2 - 2 * t, 1)  # t², or the smoothstep where cone.z is 1 (model.cones)
    angular = angular * _measured(table, row, profile, axis, wi)
    falloff = dr.select(far, 1, window * angular * dr.square(inverse))
    return wi, distance, strength * falloff


@dr.syntax
def _measured(table: Float, row: UInt32, profile: Float, nadir: Vector3f, wi: Vector3f) -> Float:
    """What a light's profile leaves of it in the direction -wi (`model.ies`); 1 without one."""
    share = mi.Float(1)
    if profile > 0:
        zero, _ = _group(table, row, 3)
        quarter, _ = _group(table, row, 4)
        x = dr.atan2(-dr.dot(quarter, wi), -dr.dot(zero, wi)) * (AROUND / (2 * dr.pi))
        x = dr.select(x < 0, x + AROUND, x)
        y = dr.safe_acos(-dr.dot(nadir, wi)) * ((DOWN - 1) / dr.pi)
        i, j = mi.UInt32(x), dr.minimum(mi.UInt32(y), DOWN - 2)
        fx, fy = x - mi.Float(i), y - mi.Float(j)
        first = mi.UInt32(profile) * ROW + j
        near = first + dr.select(i >= AROUND, 0, i) * DOWN
        far = first + dr.select(i + 1 >= AROUND, i + 1 - AROUND, i + 1) * DOWN
        low = dr.lerp(dr.gather(mi.Float, table, near), dr.gather(mi.Float, table, near + 1), fy)
        high = dr.lerp(dr.gather(mi.Float, table, far), dr.gather(mi.Float, table, far + 1), fy)
        share = dr.lerp(low, high, fx)
    return share


def _cone_sample(table: Float, row: UInt32, position: Vector3f, kind: Float, p: Vector3f, u: Point2f) -> LightSample:
    """A sun or a glowing ball, its cone of directions sampled evenly: (way, distance to its surface, irradiance / cos).

    A ball of I candela has radiance I / (pi r²) and fills the cone sin θ = r / d; the estimate L / pdf then is
    I / d² · 2 / (1 + cos θ), which tends to the point light's I / d². A sun of E lux the same with E.
    """
    _, radius = _group(table, row, 1)
    axis, distance, irradiance = _punctual(table, row, position, kind, p)
    sun = kind == float(Kind.SUN)
    sine2 = dr.square(dr.select(sun, radius, radius / distance))
    cosine = dr.safe_sqrt(1 - sine2)
    wi = _cone_direction(axis, sine2 / (1 + cosine), u)
    along = distance * dr.dot(wi, axis)
    surface = along - dr.safe_sqrt(dr.square(radius) - dr.square(distance) + dr.square(along))
    irradiance = dr.select(sine2 < 1, irradiance * (2 / (1 + cosine)), 0)  # nothing inside the ball
    return wi, dr.select(sun, dr.inf, surface), irradiance


def _rectangle_point(
    x0: Float, y0: Float, z0: Float, width: Float, height: Float, u: Point2f
) -> tuple[Float, Float, Float]:
    """(x, y, solid angle): a point of a rectangle, evenly over its solid angle, seen from the origin at depth z0 < 0.

    Ureña, Fajardo, King, "An Area-Preserving Parametrization for Spherical Rectangles" (EGSR 2013).
    """
    x1, y1 = x0 + width, y0 + height
    n0z, n1z = -y0 * dr.rsqrt(z0 * z0 + y0 * y0), x1 * dr.rsqrt(z0 * z0 + x1 * x1)
    n2z, n3z = y1 * dr.rsqrt(z0 * z0 + y1 * y1), -x0 * dr.rsqrt(z0 * z0 + x0 * x0)
    g0, g1 = dr.safe_acos(-n0z * n1z), dr.safe_acos(-n1z * n2z)
    g2, g3 = dr.safe_acos(-n2z * n3z), dr.safe_acos(-n3z * n0z)
    k = dr.two_pi - g2 - g3
    solid_angle = g0 + g1 - k

    sin_au, cos_au = dr.sincos(u.x * solid_angle + k)
    fu = (cos_au * n0z - n2z) / sin_au
    cu = dr.clip(dr.copysign(dr.rsqrt(fu * fu + n0z * n0z), fu), -1, 1)
    x = dr.clip(-(cu * z0) / dr.maximum(dr.safe_sqrt(1 - cu * cu), 1e-7), x0, x1)
    d2 = x * x + z0 * z0
    h0, h1 = y0 * dr.rsqrt(d2 + y0 * y0), y1 * dr.rsqrt(d2 + y1 * y1)
    hv = dr.lerp(h0, h1, u.y)
    y = dr.clip(hv * dr.sqrt(d2) * dr.rsqrt(dr.maximum(1 - hv * hv, 1e-7)), y0, y1)
    return x, y, solid_angle


def _area_sample(table: Float, row: UInt32, position: Vector3f, kind: Float, p: Vector3f, u: Point2f) -> LightSample:
    """A point on a glowing rectangle (by solid angle) or disk (by area): (way, distance, irradiance / cos)."""
    normal, _ = _group(table, row, 1)
    radiance, _ = _group(table, row, 2)
    x_axis, half_width = _group(table, row, 3)
    y_axis, half_height = _group(table, row, 4)
    disk = kind == float(Kind.DISK)
    to_centre = position - p
    z0 = dr.dot(to_centre, normal)  # below 0 where p is in front
    x0, y0 = dr.dot(to_centre, x_axis) - half_width, dr.dot(to_centre, y_axis) - half_height

    x_s, y_s, solid_angle = _rectangle_point(x0, y0, z0, 2 * half_width, 2 * half_height, u)
    by_angle = (~disk) & (solid_angle > _WIDE)
    on_disk = mi.warp.square_to_uniform_disk_concentric(u)
    flat_x = dr.select(disk, on_disk.x, 2 * u.x - 1)
    flat_y = dr.select(disk, on_disk.y, 2 * u.y - 1)
    x = dr.select(by_angle, x_s, x0 + half_width * (1 + flat_x))
    y = dr.select(by_angle, y_s, y0 + half_height * (1 + flat_y))

    d2 = x * x + y * y + z0 * z0
    inverse = dr.rsqrt(d2)
    area = dr.select(disk, dr.pi, 4) * half_width * half_height
    solid = dr.select(by_angle, solid_angle, area * -z0 * inverse * dr.square(inverse))
    way = x_axis * (x * inverse) + y_axis * (y * inverse) + normal * (z0 * inverse)
    return way, d2 * inverse, dr.select(z0 < 0, radiance * solid, 0)


def _cone_met(
    table: Float, row: UInt32, position: Vector3f, kind: Float, p: Vector3f, d: Vector3f
) -> tuple[Float, Vector3f, Float]:
    """`met` of a sun or a glowing ball: inside its cone of directions."""
    _, radius = _group(table, row, 1)
    axis, distance, irradiance = _punctual(table, row, position, kind, p)
    sun = kind == float(Kind.SUN)
    sine2 = dr.square(dr.select(sun, radius, radius / distance))
    apart2 = dr.squared_norm(dr.cross(axis, d))
    inside = (apart2 <= sine2) & (dr.dot(axis, d) > 0) & (sine2 < 1)
    along = distance * dr.dot(d, axis)
    surface = along - dr.safe_sqrt(dr.square(radius) - dr.square(distance) + dr.square(along))
    drawn = (1 + dr.safe_sqrt(1 - sine2)) / (dr.two_pi * sine2)
    return dr.select(sun, dr.inf, surface), irradiance / (dr.pi * sine2), dr.select(inside, drawn, 0)


def _area_met(
    table: Float, row: UInt32, position: Vector3f, kind: Float, p: Vector3f, d: Vector3f
) -> tuple[Float, Vector3f, Float]:
    """`met` of a glowing rectangle or disk."""
    normal, _ = _group(table, row, 1)
    radiance, _ = _group(table, row, 2)
    x_axis, half_width = _group(table, row, 3)
    y_axis, half_height = _group(table, row, 4)
    disk = kind == float(Kind.DISK)
    to_centre = position - p
    z0, slant = dr.dot(to_centre, normal), dr.dot(d, normal)
    distance = z0 / slant
    x = (distance * dr.dot(d, x_axis) - dr.dot(to_centre, x_axis)) / half_width
    y = (distance * dr.dot(d, y_axis) - dr.dot(to_centre, y_axis)) / half_height
    inside = dr.select(disk, dr.square(x) + dr.square(y) <= 1, dr.maximum(abs(x), abs(y)) <= 1)
    x0, y0 = dr.dot(to_centre, x_axis) - half_width, dr.dot(to_centre, y_axis) - half_height
    _, _, solid_angle = _rectangle_point(x0, y0, z0, 2 * half_width, 2 * half_height, mi.Point2f(0.5, 0.5))
    area = dr.select(disk, dr.pi, 4) * half_width * half_height
    by_area = area * abs(slant) / dr.square(distance)
    solid = dr.select((~disk) & (solid_angle > _WIDE), solid_angle, by_area)
    return distance, radiance, dr.select(inside & (z0 < 0) & (slant < -1e-6), 1 / solid, 0)


def _tube(table: Float, row: UInt32, position: Vector3f, p: Vector3f) -> _Tube:
    axis, radius = _group(table, row, 1)
    radiance, _ = _group(table, row, 2)
    _, half = _group(table, row, 3)
    to_centre = position - p
    along = dr.dot(to_centre, axis)
    across = to_centre - axis * along
    away = dr.norm(across)
    return _Tube(axis, radius, radiance, across / away, away, along - half, along + half)


def _tube_sample(table: Float, row: UInt32, position: Vector3f, p: Vector3f, u: Point2f) -> LightSample:
    """A direction to a glowing tube, drawn by its angle around the axis, then evenly over the solid angle of the strip
    of the tube that lies there: (way, distance, irradiance / cos).

    With alpha the angle in the plane across the axis and s the sine of the elevation from that plane, a solid angle is
    d alpha d s (Archimedes), so the estimate is radiance times the widths of both.
    """
    tube = _tube(table, row, position, p)
    widest = dr.safe_asin(tube.radius / tube.away)
    sine, cosine = dr.sincos((2 * u.x - 1) * widest)
    near, low, high = tube.strip(sine, cosine)
    s = dr.lerp(low, high, u.y)
    flat = dr.safe_sqrt(1 - s * s)
    way = (tube.toward * cosine + dr.cross(tube.axis, tube.toward) * sine) * flat + tube.axis * s
    solid = dr.select(tube.away > tube.radius, 2 * widest * (high - low), 0)  # nothing inside the tube
    return way, near / flat, tube.radiance * solid


def _tube_met(table: Float, row: UInt32, position: Vector3f, p: Vector3f, d: Vector3f) -> tuple[Float, Vector3f, Float]:
    """`met` of a glowing tube."""
    tube = _tube(table, row, position, p)
    s = dr.dot(d, tube.axis)
    flat = dr.safe_sqrt(1 - s * s)
    sine, cosine = dr.dot(d, dr.cross(tube.axis, tube.toward)) / flat, dr.dot(d, tube.toward) / flat
    near, low, high = tube.strip(sine, cosine)
    inside = (abs(sine) * tube.away <= tube.radius) & (cosine > 0) & (s >= low) & (s <= high)
    solid = 2 * dr.safe_asin(tube.radius / tube.away) * (high - low)
    return near / flat, tube.radiance, dr.select(inside & (tube.away > tube.radius), 1 / solid, 0)


@dr.syntax
def met(table: Float, row: UInt32, p: Vector3f, d: Vector3f) -> tuple[Float, Vector3f, Float]:
    """A light as a ray from p along unit d meets it.

    Returns:
        (distance, radiance, density per solid angle with which `sample` draws that way: 0 where the ray misses it, or
        it has no extent).
    """
    position, kind = _group(table, row, 0)
    p = mi.Vector3f(p)
    distance, radiance, drawn = mi.Float(0), mi.Vector3f(0), mi.Float(0)
    if kind > float(Kind.DISK):
        distance, radiance, drawn = _tube_met(table, row, position, p, d)
    elif kind > float(Kind.SPHERE):
        distance, radiance, drawn = _area_met(table, row, position, kind, p, d)
    elif kind > float(Kind.SPOT):
        distance, radiance, drawn = _cone_met(table, row, position, kind, p, d)
    return distance, radiance, drawn


@dr.syntax
def sample(table: Float, row: UInt32, p: Vector3f, n: Vector3f, index: UInt32, seed: UInt32) -> LightSample:
    """One light's unshadowed irradiance at a point.

    Args:
        table: the rows of `mirelight.lighting.lights.pack`, flat.
        row: UInt32 which light.
        p, n: Point3f and unit Vector3f of the surface (n on the side that is lit).
        index, seed: UInt32 which sample point to take where the light has an extent (`samples.pair`).

    Returns:
        (Vector3f unit way to the light, Float length of the shadow ray, Vector3f irradiance estimate; 0 below the
        horizon).
    """
    position, kind = _group(table, row, 0)
    p = mi.Vector3f(p)
    wi, distance, irradiance = mi.Vector3f(0), mi.Float(0), mi.Vector3f(0)
    if kind <= float(Kind.SPOT):
        wi, distance, irradiance = _punctual(table, row, position, kind, p)
    else:
        u = pair(index, seed)
        if kind <= float(Kind.SPHERE):
            wi, distance, irradiance = _cone_sample(table, row, position, kind, p, u)
        elif kind <= float(Kind.DISK):
            wi, distance, irradiance = _area_sample(table, row, position, kind, p, u)
        else:
            wi, distance, irradiance = _tube_sample(table, row, position, p, u)
    cosine = dr.dot(wi, n)  # not a number where the point lies on the light: no light then
    return wi, distance * SHADOW_END, dr.select(cosine > 0, irradiance * cosine, 0)
