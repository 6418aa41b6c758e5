"""Names for annotations of device code.

Mitsuba's own types belong to the variant that is active, and their stubs refuse sound arithmetic between them, so to a
type checker these are anything; to a reader they say what a value is.
"""

from __future__ import annotations

from typing import Any, TypeAlias

Bool: TypeAlias = Any
Float: TypeAlias = Any
UInt32: TypeAlias = Any
Point2f: TypeAlias = Any
Point3f: TypeAlias = Any
Vector2f: TypeAlias = Any
Vector3f: TypeAlias = Any  # a direction, and three channels of light
Vector4f: TypeAlias = Any
Ray3f: TypeAlias = Any
Hit: TypeAlias = Any  # Mitsuba's PreliminaryIntersection3f
MitsubaScene: TypeAlias = Any

Corners: TypeAlias = list[UInt32]  # a triangle's three vertices
Weights: TypeAlias = tuple[Float, Float, Float]  # barycentric, of those
# Unit way to a light, length of the shadow ray, irradiance (over the cosine where the text says so).
LightSample: TypeAlias = tuple[Vector3f, Float, Vector3f]
