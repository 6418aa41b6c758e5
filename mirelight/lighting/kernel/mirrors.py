"""What a camera sees in the proxy's mirrors: its rays go on from there.

A capture shows a room behind a mirror. Its splats lie where that room seems to be, so the depth of what is seen in a
mirror is the whole way there; their light is that of the place which is mirrored.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import drjit as dr
import mitsuba as mi

from mirelight.lighting.kernel.see_through import Passed
from mirelight.lighting.kernel.types import Bool, Float, Point2f, Ray3f, UInt32, Vector3f

if TYPE_CHECKING:
    from mirelight.lighting.kernel.proxy import DeviceProxy

MOST = 2  # mirrors on the way of a ray; what is behind more is seen as a matt surface


class FirstHit(NamedTuple):
    """What a sample sees first, mirrors apart."""

    there: Bool  # whether there is anything
    face: UInt32
    uv: Point2f  # barycentric coordinates there
    d: Vector3f  # unit way of the ray that met it
    passed: Passed | None = None  # what it went through
    far: Float | None = None  # how often the first ray goes into the whole way there; None: nothing mirrors


def seen_first(surface: DeviceProxy, ray: Ray3f) -> FirstHit:
    """What a camera's ray sees."""
    found, passed = surface.seen(ray, mi.Bool(True), coherent=True)
    there, face, uv = mi.Bool(found.is_valid()), mi.UInt32(found.prim_index), mi.Point2f(found.prim_uv)
    if surface.mirrors is None:
        return FirstHit(there, face, uv, dr.normalize(ray.d), passed)
    gone, o, d = mi.Float(found.t), mi.Point3f(ray.o), mi.Vector3f(ray.d)
    for _ in range(MOST):
        turned = there & surface.mirrors.are(face, there)
        at = surface.at(face, uv, d, turned)
        n = at.geometric_normal
        o, d = dr.select(turned, at.start, o), dr.select(turned, d - n * (2 * dr.dot(n, d)), d)
        onward = mi.Ray3f(ray)
        onward.o, onward.d, onward.maxt = o, d, ray.maxt - gone
        found, more = surface.seen(onward, turned)
        there = dr.select(turned, mi.Bool(found.is_valid()), there)
        face = dr.select(turned, mi.UInt32(found.prim_index), face)
        uv = dr.select(turned, mi.Point2f(found.prim_uv), uv)
        gone += dr.select(turned, mi.Float(found.t), 0)
        if passed is not None and more is not None:
            tint, cover = dr.select(turned, more.tint, 1), dr.select(turned, more.cover, 1)
            passed = Passed(passed.tint * tint, passed.cover * cover)
    return FirstHit(there, face, uv, dr.normalize(d), passed, gone)
