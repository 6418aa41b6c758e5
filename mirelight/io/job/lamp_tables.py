"""Tables of the job file for single lights. Names and units are those of KHR_lights_punctual; angles are in degrees."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal, Self, TypeAlias

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from mirelight.base.colour import blackbody
from mirelight.io.job.fields import (
    AssetPath,
    Color,
    Degrees,
    Direction,
    Elevation,
    Kelvin,
    LightName,
    NotNegative,
    Positive,
    Share,
    Table,
    Vec3,
    one_way,
    wrong,
)
from mirelight.io.job.light_units import AreaUnit, LampUnit, SunUnit, candela, nits
from mirelight.io.job.sun_position import SOUTH, to_sun
from mirelight.model import F64, AreaLight, cones

_DIRECTION = "[x, y, z], the way the light travels."
_POSITION = "[x, y, z] in world units."
TARGET = "[x, y, z], a point to shine at; instead of direction."
_RADIUS = "Radius of a glowing sphere of the same candela, in world units; 0: hard shadows."
_CANDELA = "Luminous intensity in candela, or what `unit` says."
_LAMP_UNIT = (
    "Of the intensity. lumen: all of its light; watt: the power of a Blender lamp. docs/reference/lights.md has both."
)
_SUN_UNIT = "Of the intensity. watt: W/m², the strength of a Blender sun; the same number."
_TURN = "With ies, in degrees: turns it about that, counter-clockwise seen from behind the lamp."
GROUP = "Lights of one group share a layer of this name. Default: a layer of its own."
_LUX = "Illuminance of a surface that faces the light, in lux, or what `unit` says."
_KELVIN = "Colour of a black body of this temperature, of luminance 1; instead of color."
CONE = (
    "How it fades between both angles. khr: squared, as in glTF; playcanvas: the engine's smoothstep; blender: as "
    "Blender's spot, see blend."
)
BLENDER_BLEND = 0.15  # of a new spot in Blender
ConeName: TypeAlias = Literal["khr", "playcanvas", "blender"]
_RANGE = "Distance in world units at which the light has faded to nothing (the window of KHR). Default: no end."


def _square(value: Any) -> Any:
    return [value] * 2 if isinstance(value, int | float) and not isinstance(value, bool) else value


_TwoSizes: TypeAlias = Annotated[list[Positive], Field(min_length=2, max_length=2)]
Size: TypeAlias = Annotated[_TwoSizes, BeforeValidator(_square, json_schema_input_type=Positive | _TwoSizes)]


def _not_taken(value: str) -> str:
    if value in ("environment", "sky", "emission"):
        raise wrong(f"{value!r} is the name of a layer that is no light's", "choose another name")
    return value


GroupName: TypeAlias = Annotated[LightName, AfterValidator(_not_taken)]


class LightTable(Table):
    """Keys that all lights have."""

    name: LightName | None = Field(default=None, description="Names the light's layer. Default: its type.")
    group: GroupName | None = Field(default=None, description=GROUP)


class ColouredTable(LightTable):
    """Lights with a linear colour, or that of a glowing body."""

    color: Color = Field(default=[1.0, 1.0, 1.0], description="Linear [r, g, b] that multiplies the intensity.")
    kelvin: Kelvin | None = Field(default=None, description=_KELVIN)

    @model_validator(mode="after")
    def _one_colour(self) -> Self:
        if self.kelvin is not None and "color" in self.model_fields_set:
            raise wrong("both color and kelvin are given", "keep one of them (color or kelvin)", at="kelvin")
        return self

    @property
    def rgb(self) -> F64:
        """(3,) linear colour of the light."""
        return np.asarray(self.color) if self.kelvin is None else blackbody(self.kelvin)


class ParallelTable(ColouredTable):
    """Lights so far away that they come from one direction: as a vector, or by where they stand in the sky."""

    direction: Direction | None = Field(default=None, description=_DIRECTION)
    elevation: Elevation | None = Field(
        default=None, description="Degrees above the horizon at which it stands; instead of direction."
    )
    azimuth: Degrees | None = Field(
        default=None,
        description="With elevation: degrees clockwise from north, seen from above. North is -Z, east (90) +X. "
        "Default: 180, south, +Z.",
    )
    intensity: NotNegative = Field(default=1.0, description=_LUX)
    unit: SunUnit = Field(default="lux", description=_SUN_UNIT)

    @model_validator(mode="after")
    def _placed(self) -> Self:
        if self.azimuth is not None and self.elevation is None and self.direction is None:
            raise wrong("an azimuth without an elevation", "add elevation", at="azimuth")
        one_way(self, ("direction",), ("elevation", "azimuth"), needed="add elevation and azimuth, or direction")
        return self

    @property
    def way(self) -> F64:
        """(3,) the way the light travels."""
        if self.direction is not None:
            return np.asarray(self.direction)
        assert self.elevation is not None
        return -to_sun(self.elevation, SOUTH if self.azimuth is None else self.azimuth)


class DirectionalTable(ParallelTable):
    """Parallel light with hard shadows (KHR directional)."""

    type: Literal["directional"]


class SunTable(ParallelTable):
    """A far disc: parallel light with soft shadow edges."""

    type: Literal["sun"]
    angular_diameter: float = Field(
        default=0.53, gt=0, le=90, allow_inf_nan=False, description="Size of the disc in the sky, in degrees."
    )


class PointTable(ColouredTable):
    """Light from one place in all directions (KHR point)."""

    type: Literal["point"]
    position: Vec3 = Field(description=_POSITION)
    intensity: NotNegative = Field(default=1.0, description=_CANDELA)
    unit: LampUnit = Field(default="candela", description=_LAMP_UNIT)
    range: Positive | None = Field(default=None, description=_RANGE)
    radius: NotNegative = Field(default=0.0, description=_RADIUS)
    ies: AssetPath | None = Field(
        default=None,
        description="A luminaire's measured light by direction (.ies, LM-63 type C); intensity, where it is given, is "
        "that of the brightest direction.",
    )
    direction: Direction | None = Field(
        default=None, description="[x, y, z], with ies: where its nadir points. Default: down."
    )
    turn: Degrees = Field(default=0.0, description=_TURN)

    @model_validator(mode="after")
    def _check(self) -> PointTable:
        if self.ies is None:
            for key in ("direction", "turn"):
                if key in self.model_fields_set:
                    raise wrong(f"{key} of a light that is the same all around", "leave it out, or add ies", at=key)
        elif self.unit == "watt":
            raise wrong("watt of a measured light", "give candela or lumen, or neither", at="unit")
        if self.ies is None:
            _ = self.candela
        return self

    @property
    def candela(self) -> float:
        """The intensity in candela, of a light that is the same all around."""
        return candela(self.intensity, self.unit)


class KhrConeTable(Table):
    """A spot's cone as KHR_lights_punctual writes it, in radians; for lights pasted from a glTF file."""

    innerConeAngle: float = Field(  # noqa: N815 (the extension's own name)
        default=0.0,
        ge=0,
        lt=math.pi / 2,
        allow_inf_nan=False,
        description="Half angle in radians at which the light starts to fade.",
    )
    outerConeAngle: float = Field(  # noqa: N815
        default=math.pi / 4,
        gt=0,
        le=math.pi / 2,
        allow_inf_nan=False,
        description="Half angle in radians at which it is gone; above the inner.",
    )

    @model_validator(mode="after")
    def _check(self) -> KhrConeTable:
        if self.innerConeAngle >= self.outerConeAngle:
            found = f"{self.innerConeAngle:g}, and outerConeAngle is {self.outerConeAngle:g}"
            raise wrong(found, "make the inner angle the smaller one", at="innerConeAngle")
        return self


class SpotTable(ColouredTable):
    """Light from one place into a cone (KHR spot)."""

    type: Literal["spot"]
    position: Vec3 = Field(description=_POSITION)
    direction: Direction | None = Field(default=None, description=_DIRECTION)
    target: Vec3 | None = Field(default=None, description=TARGET)
    intensity: NotNegative = Field(default=1.0, description=_CANDELA)
    unit: LampUnit = Field(default="candela", description=_LAMP_UNIT)
    range: Positive | None = Field(default=None, description=_RANGE)
    inner_cone_angle: float = Field(
        default=0.0,
        ge=0,
        lt=90,
        allow_inf_nan=False,
        description="Half angle in degrees at which the light starts to fade.",
    )
    outer_cone_angle: float = Field(
        default=45.0,
        gt=0,
        le=90,
        allow_inf_nan=False,
        description="Half angle in degrees at which it is gone; above the inner. Half of Blender's spot size.",
    )
    spot: KhrConeTable | None = Field(
        default=None,
        description="KHR's spelling of both angles, in radians: { innerConeAngle, outerConeAngle }; instead of them.",
    )
    cone: ConeName = Field(default="khr", description=CONE)
    blend: Share | None = Field(
        default=None, description="cone blender: Blender's blend, instead of an inner angle. Default: 0.15."
    )
    radius: NotNegative = Field(default=0.0, description=_RADIUS)
    ies: AssetPath | None = Field(
        default=None,
        description="A luminaire's measured light by direction, its nadir along the axis; the cone narrows it further. "
        "intensity, where it is given, is that of its brightest direction.",
    )
    turn: Degrees = Field(default=0.0, description=_TURN)

    @model_validator(mode="after")
    def _check(self) -> SpotTable:
        aimed(self, self.position, self.target)
        if self.ies is None and "turn" in self.model_fields_set:
            raise wrong("turn of a light that is the same around its axis", "leave it out, or add ies", at="turn")
        if self.ies is not None and self.unit == "watt":
            raise wrong("watt of a measured light", "give candela or lumen, or neither", at="unit")
        for key in ("inner_cone_angle", "outer_cone_angle"):
            if self.spot is not None and key in self.model_fields_set:
                raise wrong(f"both {key} and spot are given", f"keep one of them ({key} or spot)", at="spot")
        if self.cone == "blender":
            if "inner_cone_angle" in self.model_fields_set:
                raise wrong("an inner angle of Blender's cone", "give blend in its place", at="inner_cone_angle")
            if self.blend is not None and self.spot is not None:
                raise wrong("both blend and spot are given", "keep one of them (blend or spot)", at="blend")
        elif self.blend is not None:
            raise wrong("a blend without Blender's cone", 'add cone = "blender"', at="blend")
        elif self.inner_cone_angle >= self.outer_cone_angle:
            found = f"{self.inner_cone_angle:g}, and outer_cone_angle is {self.outer_cone_angle:g}"
            raise wrong(found, "make the inner angle the smaller one", at="inner_cone_angle")
        _ = self.candela
        return self

    @property
    def law(self) -> cones.ConeLaw:
        """The cone's law in the model; Blender's is the engine's smoothstep with an inner angle of its own."""
        return "khr" if self.cone == "khr" else "playcanvas"

    @property
    def angles(self) -> tuple[float, float]:
        """Inner and outer half angle in radians, of `law`."""
        inner, outer = math.radians(self.inner_cone_angle), math.radians(self.outer_cone_angle)
        if self.spot is not None:
            inner, outer = self.spot.innerConeAngle, self.spot.outerConeAngle
        if self.cone != "blender":
            return inner, outer
        blend = BLENDER_BLEND if self.blend is None else self.blend
        if self.spot is not None:
            blend = cones.blend_of_export(inner, outer)
        return cones.of_blender(outer, blend), outer

    @property
    def candela(self) -> float:
        """The intensity in candela on the axis."""
        return candela(self.intensity, self.unit, cones.solid_angle(self.law, *self.angles))


class AreaTable(ColouredTable):
    """A glowing rectangle, disk or sphere. It lights, but is not seen and blocks nothing."""

    type: Literal["area"]
    shape: Literal["rectangle", "disk", "sphere"] = Field(
        default="rectangle", description="Form of the glowing surface."
    )
    position: Vec3 = Field(description="[x, y, z] of its centre in world units.")
    direction: Direction | None = Field(default=None, description=_DIRECTION)
    target: Vec3 | None = Field(default=None, description=TARGET)
    up: Direction = Field(default=[0.0, 1.0, 0.0], description="[x, y, z], towards which a rectangle's height points.")
    size: Size = Field(
        default=[1.0, 1.0], description="World units: a diameter or a square's side, or [width, height]."
    )
    intensity: NotNegative = Field(
        default=1.0, description="Luminance in candela per square metre, or what `unit` says."
    )
    unit: AreaUnit = Field(
        default="nit",
        description="Of the intensity. candela: on the axis; lumen: all of its light; watt: the power of a Blender "
        "light of this size. docs/reference/lights.md has them.",
    )

    @model_validator(mode="after")
    def _check(self) -> AreaTable:
        if self.shape != "sphere":
            aimed(self, self.position, self.target)
        elif self.direction or self.target:
            raise wrong("a sphere shines all around", "leave it out", at="direction" if self.direction else "target")
        if self.shape != "rectangle" and self.size[0] != self.size[1]:
            raise wrong(f"a {self.shape} has one size", "give its diameter", at="size")
        _ = self.nits
        return self

    @property
    def nits(self) -> float:
        """The luminance in cd/m²."""
        size = self.size[0], self.size[1]
        one = AreaLight(name="", shape=self.shape, world_from_light=np.eye(4), size=size)
        return nits(self.intensity, self.unit, one)


def aimed(light: Table, position: list[float], target: list[float] | None) -> None:
    """One of direction and target, and no target at the light itself."""
    one_way(light, ("direction",), ("target",), needed="add direction = [x, y, z] or target = [x, y, z]")
    if target == position:
        raise wrong("the light's own position", "give another point", at="target")
