"""A vertex of a path: one hit of it on the surface, and the ray that came there."""

from __future__ import annotations

from typing import NamedTuple

from mirelight.lighting.kernel.proxy import Point
from mirelight.lighting.kernel.scatter import Gloss
from mirelight.lighting.kernel.types import Bool, Float, Point2f, UInt32, Vector3f


class Arrival(NamedTuple):
    """The ray that came to a vertex, and where it met the surface."""

    face: UInt32
    uv: Point2f  # barycentric coordinates there
    d: Vector3f  # unit way of the ray
    distance: Float  # its length; 0 of a camera's
    pdf: Float  # its density per solid angle when it was drawn; 0 of a camera's


class Vertex(NamedTuple):
    """One hit of a path."""

    sample: UInt32  # the path's number in its sequence
    spot: UInt32  # in the film's launch: the path's pass and pixel
    place: UInt32  # there, too: its batch and pixel
    salt: UInt32  # of this hit's random numbers
    at: Point
    depth: UInt32  # hits before this one
    indirect: Bool  # there are some
    throughput: Vector3f  # β, the albedo of every hit before
    albedo: Vector3f  # of this hit
    weight: Vector3f  # what irradiance here adds to the pixel, once it is `reflected`: β · albedo / π, or β
    gloss: Gloss | None  # where objects are inserted
