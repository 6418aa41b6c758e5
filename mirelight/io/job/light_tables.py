"""Tables of the job file for lights. Names and units are those of KHR_lights_punctual; angles are in degrees."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal, TypeAlias

from pydantic import AfterValidator, BeforeValidator, Discriminator, Field, Tag, model_validator

from mirelight.engine_lights import DEFAULT_RANGE
from mirelight.io.job.fields import (
    Color,
    Direction,
    DisplayColor,
    GltfPath,
    LightName,
    Name,
    NotNegative,
    Positive,
    Table,
    Vec3,
    one_way,
    paths_as_tables,
    wrong,
)
from mirelight.io.job.scene_tables import Environment, Transform
from mirelight.model import Falloff

_DIRECTION = "[x, y, z], the way the light travels."
_POSITION = "[x, y, z] in world units."
_TARGET = "[x, y, z], a point to shine at; instead of direction."
_RADIUS = "Radius of a glowing sphere of the same candela, in world units; 0: hard shadows."
_CANDELA = "Luminous intensity in candela."
_GROUP = "Lights of one group share a layer of this name. Default: a layer of its own."
ESTIMATE = "estimate"  # as `captured`
_LUX = "Illuminance of a surface that faces the light, in lux."
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
    """What all lights share."""

    name: LightName | None = Field(default=None, description="Names the light's layer. Default: its type.")
    group: GroupName | None = Field(default=None, description=_GROUP)
    color: Color = Field(default=[1.0, 1.0, 1.0], description="Linear [r, g, b] that multiplies the intensity.")


class DirectionalTable(LightTable):
    """Parallel light with hard shadows (KHR directional)."""

    type: Literal["directional"]
    direction: Direction = Field(description=_DIRECTION)
    intensity: NotNegative = Field(default=1.0, description=_LUX)


class SunTable(LightTable):
    """A far disc: parallel light with soft shadow edges."""

    type: Literal["sun"]
    direction: Direction = Field(description=_DIRECTION)
    intensity: NotNegative = Field(default=1.0, description=_LUX)
    angular_diameter: float = Field(
        default=0.53, gt=0, le=90, allow_inf_nan=False, description="Size of the disc in the sky, in degrees."
    )


class PointTable(LightTable):
    """Light from one place in all directions (KHR point)."""

    type: Literal["point"]
    position: Vec3 = Field(description=_POSITION)
    intensity: NotNegative = Field(default=1.0, description=_CANDELA)
    range: Positive | None = Field(default=None, description=_RANGE)
    radius: NotNegative = Field(default=0.0, description=_RADIUS)


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


class SpotTable(LightTable):
    """Light from one place into a cone (KHR spot)."""

    type: Literal["spot"]
    position: Vec3 = Field(description=_POSITION)
    direction: Direction | None = Field(default=None, description=_DIRECTION)
    target: Vec3 | None = Field(default=None, description=_TARGET)
    intensity: NotNegative = Field(default=1.0, description=_CANDELA)
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
        description="Half angle in degrees at which it is gone; above the inner.",
    )
    spot: KhrConeTable | None = Field(
        default=None,
        description="KHR's spelling of both angles, in radians: { innerConeAngle, outerConeAngle }; instead of them.",
    )
    radius: NotNegative = Field(default=0.0, description=_RADIUS)

    @model_validator(mode="after")
    def _check(self) -> SpotTable:
        _aimed(self, self.position, self.target)
        for key in ("inner_cone_angle", "outer_cone_angle"):
            if self.spot is not None and key in self.model_fields_set:
                raise wrong(f"both {key} and spot are given", f"keep one of them ({key} or spot)", at="spot")
        if self.inner_cone_angle >= self.outer_cone_angle:
            found = f"{self.inner_cone_angle:g}, and outer_cone_angle is {self.outer_cone_angle:g}"
            raise wrong(found, "make the inner angle the smaller one", at="inner_cone_angle")
        return self

    @property
    def cone(self) -> tuple[float, float]:
        """Inner and outer half angle in radians."""
        if self.spot is not None:
            return self.spot.innerConeAngle, self.spot.outerConeAngle
        return math.radians(self.inner_cone_angle), math.radians(self.outer_cone_angle)


class AreaTable(LightTable):
    """A glowing rectangle, disk or sphere. It lights, but is not seen and blocks nothing."""

    type: Literal["area"]
    shape: Literal["rectangle", "disk", "sphere"] = Field(
        default="rectangle", description="Form of the glowing surface."
    )
    position: Vec3 = Field(description="[x, y, z] of its centre in world units.")
    direction: Direction | None = Field(default=None, description=_DIRECTION)
    target: Vec3 | None = Field(default=None, description=_TARGET)
    up: Direction = Field(default=[0.0, 1.0, 0.0], description="[x, y, z], towards which a rectangle's height points.")
    size: Size = Field(
        default=[1.0, 1.0], description="World units: a diameter or a square's side, or [width, height]."
    )
    intensity: NotNegative = Field(default=1.0, description="Luminance in candela per square metre.")

    @model_validator(mode="after")
    def _check(self) -> AreaTable:
        if self.shape != "sphere":
            _aimed(self, self.position, self.target)
        elif self.direction or self.target:
            raise wrong("a sphere shines all around", "leave it out", at="direction" if self.direction else "target")
        if self.shape != "rectangle" and self.size[0] != self.size[1]:
            raise wrong(f"a {self.shape} has one size", "give its diameter", at="size")
        return self


class PlayCanvasTable(LightTable):
    """A light component of the real-time engine, in its own units and with its defaults."""

    type: Literal["playcanvas"]
    kind: Literal["omni", "spot", "directional"] = Field(description="The component's type.")
    color: DisplayColor = Field(default=[1.0, 1.0, 1.0], description="Display-encoded [r, g, b], 0 to 1 (2.2 power).")
    intensity: NotNegative = Field(default=1.0, description="The component's intensity.")
    position: Vec3 | None = Field(default=None, description="[x, y, z] in world units; not of directional.")
    direction: Direction | None = Field(default=None, description="[x, y, z], the way the light travels; not of omni.")
    target: Vec3 | None = Field(default=None, description=_TARGET)
    range: Positive = Field(default=DEFAULT_RANGE, description="Distance at which the light has faded to nothing.")
    falloff: Falloff = Field(
        default="linear", description="1 - d / range, or 16 / (d² + 1) with a squared window at the range."
    )
    inner_cone_angle: Annotated[float, Field(ge=0, le=90, allow_inf_nan=False)] = Field(
        default=40.0, description="Half angle in degrees at which a spot starts to fade."
    )
    outer_cone_angle: Annotated[float, Field(gt=0, le=90, allow_inf_nan=False)] = Field(
        default=45.0, description="Half angle in degrees at which it is gone."
    )
    cast_shadows: bool = Field(default=False, description="Whether it casts shadows, in the profile playcanvas.")

    @model_validator(mode="after")
    def _check(self) -> PlayCanvasTable:
        pose = {"position": self.position, "direction": self.direction, "target": self.target}
        for key in {"omni": ("direction", "target"), "directional": ("position", "target"), "spot": ()}[self.kind]:
            if pose[key] is not None:
                raise wrong(f"a {key} of a light of kind {self.kind}", "leave it out", at=key)
        needed = "direction" if self.kind == "directional" else "position"
        if pose[needed] is None:
            raise wrong(f"a light of kind {self.kind} without {needed}", f"add {needed} = [x, y, z]")
        if self.kind == "spot" and self.position is not None:
            _aimed(self, self.position, self.target)
            if self.inner_cone_angle > self.outer_cone_angle:
                found = f"{self.inner_cone_angle:g}, and outer_cone_angle is {self.outer_cone_angle:g}"
                raise wrong(found, "make the inner angle the smaller one", at="inner_cone_angle")
        return self


def _aimed(light: Table, position: list[float], target: list[float] | None) -> None:
    one_way(light, ("direction",), ("target",), needed="add direction = [x, y, z] or target = [x, y, z]")
    if target == position:
        raise wrong("the light's own position", "give another point", at="target")


def _light_type(value: Any) -> str | None:
    kind = value.get("type") if isinstance(value, dict) else getattr(value, "type", None)
    return f"type={kind}" if isinstance(kind, str) else None


AnyLight: TypeAlias = Annotated[
    Annotated[DirectionalTable, Tag("type=directional")]
    | Annotated[PointTable, Tag("type=point")]
    | Annotated[SpotTable, Tag("type=spot")]
    | Annotated[SunTable, Tag("type=sun")]
    | Annotated[AreaTable, Tag("type=area")]
    | Annotated[PlayCanvasTable, Tag("type=playcanvas")],
    Discriminator(_light_type),
]


LightUnit: TypeAlias = Literal["khr", "blender"]  # what a glTF file's intensities are


class LightsFromTable(Table):
    """Punctual lights of a glTF file."""

    path: GltfPath = Field(description='A .glb or .gltf file, or "proxy" for the proxy\'s own file.')
    names: list[str] | None = Field(default=None, min_length=1, description="Which lights, by name. Default: all.")
    transform: Transform | None = Field(
        default=None, description="Places them in the world. Default for the proxy: its own."
    )
    unit: LightUnit | None = Field(
        default=None,
        description="khr: lux and candela, as the file says; blender: of Blender's exporter in its Standard mode, as "
        "strong as Blender shows them (divided by 683). Default: khr, with a word about files of Blender.",
    )
    intensity: NotNegative = Field(default=1.0, description="Multiplies the intensity of each of them.")
    group: GroupName | None = Field(default=None, description=_GROUP)


LightsFrom: TypeAlias = Annotated[
    list[LightsFromTable],
    BeforeValidator(paths_as_tables, json_schema_input_type=str | LightsFromTable | list[str | LightsFromTable]),
    Field(max_length=1000),
]


class Lit(Table):
    """Lights and environment of one lighting."""

    lights: list[AnyLight] = Field(default=[], max_length=100_000, description="Lights, one table each.")
    lights_from: LightsFrom = Field(default=[], description="glTF files whose punctual lights are added.")
    environment: Environment | None = Field(default=None, description="Light from all around: a path or a table.")


class LightingTable(Lit):
    """A named lighting: each is rendered with each camera."""

    name: Name = Field(description="Part of the frames' file names.")

    @model_validator(mode="after")
    def _check(self) -> LightingTable:
        _lit(self)
        return self


class CapturedTable(Lit):
    """The lighting under which the splats were captured: given here, one of the job's lightings, or estimated."""

    lighting: str | None = Field(
        default=None, description="Name of one of the job's lightings; instead of the other keys."
    )
    estimate: bool = Field(
        default=False, description="Whether it is estimated from the splats and the proxy; instead of the other keys."
    )
    exposure: float = Field(
        default=0.0, ge=-20, le=20, allow_inf_nan=False, description="Stops by which an estimate is made stronger."
    )

    @model_validator(mode="after")
    def _check(self) -> CapturedTable:
        if self.estimate:
            if self.lighting is not None or self.lights or self.lights_from or self.environment:
                raise wrong("an estimate and a lighting", "keep one of them", at="estimate")
            return self
        if "exposure" in self.model_fields_set:
            raise wrong("the exposure of an estimate", "add estimate = true, or leave it out", at="exposure")
        if self.lighting is None:
            _lit(self)
        elif self.lights or self.lights_from or self.environment:
            raise wrong("a lighting's name and lights", "keep one of them", at="lighting")
        return self


def _lit(table: Lit) -> None:
    if not (table.lights or table.lights_from or table.environment):
        raise wrong("no light in it", "add lights, lights_from or environment")


def _name_as_table(value: Any) -> Any:
    if value == ESTIMATE:
        return {"estimate": True}
    return {"lighting": value} if isinstance(value, str) else value


Captured: TypeAlias = Annotated[
    CapturedTable, BeforeValidator(_name_as_table, json_schema_input_type=str | CapturedTable)
]
