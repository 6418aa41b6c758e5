"""Intensities of a job's lights in other units, brought to what the light model counts in.

Luminous flux is intensity summed over directions, intensity is luminance summed over the area that is seen (CIE S 017,
International Lighting Vocabulary):

    point  4 pi lm a candela          spot  its cone's solid angle (model.cones)
    flat, one side  pi A lm a nit     ball  4 pi² r² lm a nit; A or pi r² cd a nit on the axis

"watt" is the power of a Blender light. Blender has no lumens: a lamp or spot of P watts shows what P / (4 pi) candela
show, an area light what P / (pi A) nits show, a sun of E W/m² what E lux show (rendered, docs/explanation/lighting.md).
"""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal, TypeAlias

from pydantic import BeforeValidator

from mirelight.io.job.fields import wrong
from mirelight.io.safety import BRIGHTEST

# What people write, and data sheets and programs, for the names below.
_NAMES = {
    **dict.fromkeys(("cd", "candelas"), "candela"),
    **dict.fromkeys(("lm", "lumens"), "lumen"),
    **dict.fromkeys(("lx",), "lux"),
    **dict.fromkeys(("cd/m²", "cd/m2", "nits"), "nit"),
    **dict.fromkeys(("W", "watts", "W/m²", "W/m2"), "watt"),
}


def _named(value: Any) -> Any:
    return _NAMES.get(value, value) if isinstance(value, str) else value


SunUnit: TypeAlias = Annotated[
    Literal["lux", "watt"],
    BeforeValidator(_named, json_schema_input_type=Literal["lux", "watt", "lx", "watts", "W/m²", "W/m2"]),
]
LampUnit: TypeAlias = Annotated[
    Literal["candela", "lumen", "watt"],
    BeforeValidator(
        _named,
        json_schema_input_type=Literal["candela", "lumen", "watt", "cd", "candelas", "lm", "lumens", "W", "watts"],
    ),
]
AreaUnit: TypeAlias = Annotated[
    Literal["nit", "candela", "lumen", "watt"],
    BeforeValidator(
        _named,
        json_schema_input_type=Literal[
            "nit", "candela", "lumen", "watt", "nits", "cd/m²", "cd/m2", "cd", "candelas", "lm", "lumens", "W", "watts"
        ],
    ),
]
SurfaceUnit: TypeAlias = Annotated[
    Literal["nit", "candela", "lumen"],
    BeforeValidator(
        _named,
        json_schema_input_type=Literal[
            "nit", "candela", "lumen", "nits", "cd/m²", "cd/m2", "cd", "candelas", "lm", "lumens"
        ],
    ),
]
Shape: TypeAlias = Literal["rectangle", "disk", "sphere"]


def candela(value: float, unit: LampUnit, solid_angle: float = 4 * math.pi) -> float:
    """Luminous intensity of a lamp on its axis; `solid_angle` (sr) is what its lumens go to."""
    if unit == "candela":
        return value
    return shared_among(value, 4 * math.pi if unit == "watt" else solid_angle, "cd")


def nits(value: float, unit: AreaUnit, shape: Shape, size: tuple[float, float]) -> float:
    """Luminance (cd/m²) of a glowing surface; `size` in world units as in the job."""
    if unit == "nit":
        return value
    area = size[0] * size[1] * (1.0 if shape == "rectangle" else math.pi / 4)  # of what is seen along the axis
    if unit != "candela":  # Lambert: pi times the whole surface, which of a ball is four times its silhouette
        area *= 4 * math.pi if shape == "sphere" else math.pi
    return shared_among(value, area, "cd/m²")


def shared_among(value: float, among: float, unit: str) -> float:
    """An intensity that is shared among so many sr or square world units, in `unit`. Raises what `wrong` makes."""
    found = 0.0 if value == 0 else value / among if among > 0 else math.inf
    if found > BRIGHTEST:
        raise wrong(f"{found:.3g} {unit}, more than {BRIGHTEST:g}", "give less, or a larger light", at="intensity")
    return found
