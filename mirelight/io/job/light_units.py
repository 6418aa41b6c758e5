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
from mirelight.model import PosedLight

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


def _spelt(*names: str) -> BeforeValidator:
    """A unit in any of the ways that people write it, of which an editor is told these."""
    return BeforeValidator(_named, json_schema_input_type=Literal[names])


_LUMINOUS, _NITS = ("cd", "candelas", "lm", "lumens"), ("nits", "cd/m²", "cd/m2")
SunUnit: TypeAlias = Annotated[Literal["lux", "watt"], _spelt("lux", "watt", "lx", "watts", "W/m²", "W/m2")]
LampUnit: TypeAlias = Annotated[
    Literal["candela", "lumen", "watt"], _spelt("candela", "lumen", "watt", *_LUMINOUS, "W", "watts")
]
AreaUnit: TypeAlias = Annotated[
    Literal["nit", "candela", "lumen", "watt"],
    _spelt("nit", "candela", "lumen", "watt", *_NITS, *_LUMINOUS, "W", "watts"),
]
SurfaceUnit: TypeAlias = Annotated[
    Literal["nit", "candela", "lumen"], _spelt("nit", "candela", "lumen", *_NITS, *_LUMINOUS)
]


def candela(value: float, unit: LampUnit, solid_angle: float = 4 * math.pi) -> float:
    """Luminous intensity of a lamp on its axis; `solid_angle` (sr) is what its lumens go to."""
    if unit == "candela":
        return value
    return _shared_among(value, 4 * math.pi if unit == "watt" else solid_angle, "cd")


def nits(value: float, unit: AreaUnit, one: PosedLight) -> float:
    """Luminance (cd/m²) of a glowing surface, of which `one` has a luminance of 1."""
    return _shared_among(value, {"nit": 1.0, "candela": one.peak}.get(unit, one.flux), one.KIND.unit.symbol)


def _shared_among(value: float, among: float, unit: str) -> float:
    """An intensity that is shared among so many sr or square world units, in `unit`. Raises what `wrong` makes."""
    found = 0.0 if value == 0 else value / among if among > 0 else math.inf
    if found > BRIGHTEST:
        raise wrong(f"{found:.3g} {unit}, more than {BRIGHTEST:g}", "give less, or a larger light", at="intensity")
    return found
