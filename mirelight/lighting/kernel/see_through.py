"""What a ray goes through: objects that are cut out or veiled by their alpha, and thin glass.

A ray that comes to such a face passes it by chance. Glass is KHR_materials_transmission, thin walled: what it does not
reflect goes straight on, tinted by its base colour, however rough it is.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import drjit as dr
import mitsuba as mi

from mirelight.lighting.kernel.samples import mix, number
from mirelight.lighting.kernel.types import Bool, Float, Hit, MitsubaScene, Point2f, Ray3f, UInt32, Vector3f

MOST = 0.75  # of rays pass glass: the others see what it mirrors, which is little, without much noise
# A ray starts this far off the surface, times the largest coordinate there plus the triangle's longest edge: 64 times
# the rounding of single precision, above the error of barycentric interpolation and of Embree's intersection.
OFFSET = 2.0**-18
_LAYERS = 64  # that a ray passes of what is not wholly there


class Surface(Protocol):
    """What is asked of a surface with objects (`proxy.DeviceProxy`)."""

    scene: MitsubaScene
    glassy: bool  # some of it is glass

    def is_inserted(self, face: UInt32) -> Bool:
        """Whether a face is an object's."""

    def alpha(self, face: UInt32, uv: Point2f, active: Bool) -> tuple[Float, Float]:
        """(how much of a point is there, below which alpha nothing is; 0: as much as alpha says)."""

    def through(self, face: UInt32, uv: Point2f, d: Vector3f, active: Bool) -> Vector3f:
        """What of light along d goes straight on behind a point of glass."""


class Passed(NamedTuple):
    """What a ray has gone through, or was chosen not to."""

    tint: Vector3f  # what its light is multiplied by
    cover: Float  # how much the sample counts where it covers a pixel


def tinted(light: Vector3f, tint: Vector3f | None) -> Vector3f:
    """Light that has gone through glass; None: it met none."""
    return light if tint is None else light * tint


@dr.syntax
def beyond(surface: Surface, found: Hit, ray: Ray3f, active: Bool, most: float) -> tuple[Hit, Passed]:
    """The hit, or the first one behind it that the ray does not pass."""
    passing, tint, cover = _passes(surface, found, ray, active, most)
    layers = mi.UInt32(0)
    while passing & (layers < _LAYERS):
        gone = mi.Float(found.t)
        step = mi.Ray3f(ray)
        start = ray.o + ray.d * gone
        lift = OFFSET * (dr.max(abs(start)) + gone * dr.max(abs(ray.d)))
        skipped = gone + lift / dr.norm(ray.d)
        step.o = ray.o + ray.d * skipped
        step.maxt = ray.maxt - skipped
        found = surface.scene.ray_intersect_preliminary(step, active=passing)
        found.t = found.t + skipped
        passing, more, counts = _passes(surface, found, ray, passing, most)
        tint *= more
        cover *= counts
        layers += 1
    return found, Passed(tint, cover)


def _passes(surface: Surface, found: Hit, ray: Ray3f, active: Bool, most: float) -> tuple[Bool, Vector3f, Float]:
    """(whether a ray goes on behind a hit, the tint of what it was chosen to do, how much it counts)."""
    face, uv = mi.UInt32(found.prim_index), mi.Point2f(found.prim_uv)
    hit = active & found.is_valid() & surface.is_inserted(face)
    alpha, cutoff = surface.alpha(face, uv, hit)
    salt = mix(mix(dr.reinterpret_array(mi.UInt32, uv.x), dr.reinterpret_array(mi.UInt32, uv.y)), face)
    salt = mix(salt, dr.reinterpret_array(mi.UInt32, ray.d.x))
    clear = hit & (alpha < dr.select(cutoff > 0, cutoff, number(salt, mi.UInt32(0))))
    if not surface.glassy:
        return clear, mi.Vector3f(1), mi.Float(1)
    through = surface.through(face, uv, dr.normalize(ray.d), hit & ~clear)
    largest = dr.max(through)
    chance = dr.minimum(largest, most)
    passes = hit & ~clear & (number(mix(salt, 1), mi.UInt32(0)) < chance)
    stays = hit & ~clear & ~passes & (chance < 1)
    left = 1 / dr.maximum(1 - chance, 1e-6)
    divisor = 1 / dr.maximum(chance, 1e-6)
    tint = dr.select(passes, through * divisor, dr.select(stays, mi.Vector3f(left), 1))
    cover = dr.select(passes, largest * divisor, dr.select(stays, (1 - largest) * left, 1))
    return clear | passes, tint, cover
