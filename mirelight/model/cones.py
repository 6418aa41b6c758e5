"""How a spot fades from its axis to the edge of its cone. NumPy only.

With t the way from the cosine of the outer half angle to that of the inner one, clamped to 0..1:

    khr         t²          KHR_lights_punctual, "Inner and Outer Cone Angles"
    playcanvas  t² (3 - 2t) the engine's shader chunk `spot`, a smoothstep

Blender's spot (size: the full angle; blend) is the second law with other parameters: Cycles takes the smoothstep of
(cos - cos outer) / (blend (1 - cos outer)) (`kernel/light/spot.h`), so blend says where the inner angle lies.
"""

from __future__ import annotations

import math
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

ConeLaw: TypeAlias = Literal["khr", "playcanvas"]

_LEAST = {"khr": 0.001, "playcanvas": 1e-5}  # of the two cosines' difference: KHR's own; what single precision resolves


def scale_and_offset(law: ConeLaw, inner: float, outer: float) -> tuple[float, float]:
    """(scale, offset) with t = clip(scale cos + offset, 0, 1); half angles in rad, inner <= outer <= pi / 2."""
    scale = 1.0 / max(_LEAST[law], math.cos(inner) - math.cos(outer))
    return scale, -math.cos(outer) * scale


def share(law: ConeLaw, inner: float, outer: float, cosine: ArrayLike) -> NDArray[np.float64]:
    """What is left of the light in directions of these cosines to the axis, 0 to 1, in their shape."""
    scale, offset = scale_and_offset(law, inner, outer)
    t = np.clip(np.asarray(cosine, dtype=np.float64) * scale + offset, 0, 1)
    return np.asarray(t**2 if law == "khr" else t**2 * (3 - 2 * t))


def solid_angle(law: ConeLaw, inner: float, outer: float) -> float:
    """The share integrated over all directions, in sr: a spot's lumens for each of its candela.

    2 pi times the integral over the cosine from that of the outer angle to 1: where t is 1 the share is 1, below it t²
    gives t³ / 3 of the width and the smoothstep t³ - t⁴ / 2. A cone thinner than the law's least width does not reach
    t = 1.
    """
    scale, offset = scale_and_offset(law, inner, outer)
    top = min(scale + offset, 1.0)  # t on the axis
    faded = top**3 / 3 if law == "khr" else top**3 - top**4 / 2
    return 2 * math.pi * (faded / scale + 1 - (top - offset) / scale)


def of_blender(outer: float, blend: float) -> float:
    """Inner half angle (rad) of the law "playcanvas" that is Blender's spot of size 2 `outer` (rad) and this blend."""
    cosine = math.cos(outer)
    return math.acos(min(cosine + (1 - cosine) * blend, 1.0))


def blend_of_export(inner: float, outer: float) -> float:
    """The blend of a spot that Blender's glTF exporter wrote: it makes the inner angle (1 - blend) outer."""
    return 1 - inner / outer
