"""Lights that KHR_lights_punctual has no words for: suns with a disc, lamps with a size, spots of the engine's law.

Each is written as the punctual light nearest to it, which any viewer shows. What that one lacks stands in the light's
`extras`, under names that no other program uses and as plain values, which Blender shows as custom properties of the
light. Read back, the light is what it was.

| light | written as | extras |
|---|---|---|
| sun | directional, lux | mirelight_angular_diameter (degrees) |
| sphere of radiance L and diameter d | point of L pi d^2 / 4 candela | mirelight_shape, mirelight_size |
| rectangle or disk of radiance L and area A | spot of L A candela with a half angle of 90 degrees | the same |
| point or spot with a radius | itself | mirelight_radius (world units) |
| spot of the engine's law | itself | mirelight_cone |
| another glowing surface | point (or such a spot) of its brightest candela | mirelight_type, its fields |

Intensities are the punctual light's, so that what another program makes of them counts.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Literal, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from mirelight.base import conventions
from mirelight.io.gltf.fields import Fields
from mirelight.model import (
    AreaLight,
    DirectionalLight,
    Light,
    PointLight,
    PosedLight,
    PunctualLight,
    SpotLight,
    SunLight,
)
from mirelight.model.light_classes import punctual
from mirelight.model.surface_lights import DESCRIBED, described_light

Extras: TypeAlias = dict[str, Any]

_DIAMETER, _RADIUS, _CONE = "mirelight_angular_diameter", "mirelight_radius", "mirelight_cone"
_SHAPE, _SIZE = "mirelight_shape", "mirelight_size"
_KIND, _OURS = "mirelight_type", "mirelight_"
_SHAPES = ("rectangle", "disk", "sphere")


def written(light: Light) -> tuple[PunctualLight, Extras]:
    """The punctual light nearest to a light, and what that lacks."""
    plain = punctual(light)
    match light:
        case SunLight():
            return plain, {_DIAMETER: light.angular_diameter}
        case AreaLight():
            return plain, {_SHAPE: light.shape, _SIZE: [float(x) for x in light.size]}
        case PointLight() | SpotLight():
            extras: Extras = {_RADIUS: light.radius} if light.radius > 0 else {}
            if isinstance(light, SpotLight) and light.cone != "khr":
                extras[_CONE] = light.cone
            return plain, extras
        case PosedLight():
            own = {_OURS + x.name: float(getattr(light, x.name)) for x in light.KIND.fields}
            return plain, {_KIND: light.KIND.name, **own}
        case _:
            return plain, {}


def restored(plain: PunctualLight, light: Fields, world: NDArray[np.float64]) -> Light:
    """The light that was written as a punctual one; itself where its extras say nothing of it.

    Args:
        plain: as the specification has it.
        light: its entry in the file.
        world: (4, 4) of its node.

    Raises:
        InputError: a value that no light has.
    """
    values = light.values.get("extras")
    if not isinstance(values, dict):
        return plain
    extras = Fields(light.file, light.at("extras"), values)
    if _KIND in extras and not isinstance(plain, DirectionalLight):
        return _described(plain, extras, world)
    match plain:
        case DirectionalLight() if _DIAMETER in extras:
            degrees = extras.number(_DIAMETER)
            if wrong := SunLight.KIND.fields[0].wrong(degrees):
                raise extras.fail(_DIAMETER, f"{degrees:g}", f"{wrong} degrees")
            return SunLight(
                name=plain.name,
                direction=plain.direction,
                color=plain.color,
                intensity=plain.intensity,
                angular_diameter=degrees,
            )
        case PointLight() | SpotLight() if _SHAPE in extras:
            return _area(plain, extras, world)
        case PointLight() | SpotLight():
            return _lamp(plain, extras)
        case _:
            return plain


def _described(plain: PunctualLight, extras: Fields, world: NDArray[np.float64]) -> Light:
    """A light of a class that is written by its record alone."""
    name = extras.text(_KIND)
    known = [x.KIND for x in DESCRIBED]
    kind = next((x for x in known if x.name == name), None)
    if kind is None:
        raise extras.fail(_KIND, f"{name[:40]!r}", f"expected {', '.join(x.name for x in known)}")
    values: dict[str, float] = {}
    for one in kind.fields:
        values[one.name] = extras.number(_OURS + one.name)
        if wrong := one.wrong(values[one.name]):
            raise extras.fail(_OURS + one.name, f"{values[one.name]:g}", wrong)
    light = described_light(kind, plain.name, _rigid(extras, world), values, color=plain.color)
    return replace(light, intensity=plain.intensity / punctual(light).intensity)


def _area(plain: PointLight | SpotLight, extras: Fields, world: NDArray[np.float64]) -> AreaLight:
    shape = extras.text(_SHAPE)
    if shape not in _SHAPES:
        raise extras.fail(_SHAPE, f"{shape[:40]!r}", f"expected {', '.join(_SHAPES)}")
    width, height = extras.vector(_SIZE, 2).tolist()
    if not (width > 0 and height > 0):
        raise extras.fail(_SIZE, f"{width:g} by {height:g}", "both must be positive")
    size = (width, height) if shape == "rectangle" else (width, width)
    known = cast(Literal["rectangle", "disk", "sphere"], shape)
    own: dict[str, Any] = {"name": plain.name, "color": plain.color, "world_from_light": _rigid(extras, world)}
    light = AreaLight(shape=known, size=size, intensity=1.0, **own)
    return replace(light, intensity=plain.intensity / light.peak)


def _rigid(extras: Fields, world: NDArray[np.float64]) -> NDArray[np.float64]:
    try:
        return conventions.rigid_part(world)
    except ValueError:
        raise extras.fail("", "its node has no size, so the light has no direction") from None


def _lamp(plain: PointLight | SpotLight, extras: Fields) -> PointLight | SpotLight:
    radius = extras.number(_RADIUS, 0.0)
    if radius < 0:
        raise extras.fail(_RADIUS, f"{radius:g}", "it must not be negative")
    lamp = replace(plain, radius=radius)
    if not isinstance(lamp, SpotLight) or _CONE not in extras:
        return lamp
    law = extras.text(_CONE)
    if law not in ("khr", "playcanvas"):
        raise extras.fail(_CONE, f"{law[:40]!r}", "expected khr or playcanvas")
    return replace(lamp, cone=cast(Literal["khr", "playcanvas"], law))
