"""Tables of the job file for lightings: lamps, lights of files, what comes from all around."""

from __future__ import annotations

from typing import Annotated, Any, Literal, TypeAlias

from pydantic import BeforeValidator, Field, model_validator

from mirelight.io.job.fields import (
    CAPTURED,
    GltfPath,
    Name,
    NotNegative,
    Number,
    Positive,
    Table,
    has_light,
    is_captured,
    lightings_as_tables,
    one_way,
    paths_as_tables,
    wrong,
)
from mirelight.io.job.lamp_tables import CONE, GROUP, ConeName, GroupName
from mirelight.io.job.light_kinds import AnyLight
from mirelight.io.job.scene_tables import Environment, Transform

MOST_MOMENTS = 10_000  # of one lighting
AT_CAMERAS = "camera"  # as the time of lights
ESTIMATE = "estimate"  # as `captured`
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
    cone: ConeName = Field(default="khr", description=CONE.replace("see blend", "found from the exported angles"))
    intensity: NotNegative = Field(default=1.0, description="Multiplies the intensity of each of them.")
    group: GroupName | None = Field(default=None, description=GROUP)
    time: Number | Literal["camera"] | None = Field(
        default=None,
        description="Of animated lights: seconds of the animation; or camera: each camera of an animated file is "
        "rendered under the lights of its own time. Default: as the file's nodes stand.",
    )
    fps: Positive | None = Field(
        default=None, description="Of animated lights: as many lightings a second, from the first key to the last."
    )
    frames: int | None = Field(
        default=None, ge=1, le=MOST_MOMENTS, description="Of animated lights: so many lightings; instead of fps."
    )

    @model_validator(mode="after")
    def _check(self) -> LightsFromTable:
        one_way(self, ("time",), ("fps", "frames"))
        one_way(self, ("fps",), ("frames",))
        return self


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
        if self.name != CAPTURED:
            _lit(self)
        return self

    @property
    def is_captured(self) -> bool:
        """True where it is the captured light, in which nothing but inserted objects changes the picture."""
        return is_captured(vars(self))


Lightings: TypeAlias = Annotated[
    list[LightingTable],
    BeforeValidator(
        lightings_as_tables,
        json_schema_input_type=list[LightingTable | Literal["captured"]] | Literal["captured"],
    ),
    Field(max_length=100_000),
]


class CapturedTable(Lit):
    """The lighting under which the splats were captured: given here, one of the job's lightings, or estimated."""

    lighting: str | None = Field(
        default=None, description="Name of one of the job's lightings; instead of the other keys."
    )
    estimate: bool = Field(
        default=False,
        description="Whether it is estimated from the splats and the proxy. `lights` and `lights_from` then say which "
        "lamps there were: how strong they were is found.",
    )
    exposure: float = Field(
        default=0.0, ge=-20, le=20, allow_inf_nan=False, description="Stops by which an estimate is made stronger."
    )

    @model_validator(mode="after")
    def _check(self) -> CapturedTable:
        if self.estimate:
            if self.lighting is not None or self.environment:
                raise wrong("an estimate and a lighting", "keep one of them", at="estimate")
            if any(light.type == "playcanvas" for light in self.lights):
                raise wrong("a light in the engine's units", "give its place as another type", at="lights")
            return self
        if "exposure" in self.model_fields_set:
            raise wrong("the exposure of an estimate", "add estimate = true, or leave it out", at="exposure")
        if self.lighting is None:
            _lit(self)
        elif self.lights or self.lights_from or self.environment:
            raise wrong("a lighting's name and lights", "keep one of them", at="lighting")
        return self


def _lit(table: Lit) -> None:
    if not has_light(vars(table)):
        raise wrong("no light in it", "add lights, lights_from or environment")


def _name_as_table(value: Any) -> Any:
    if value == ESTIMATE:
        return {"estimate": True}
    return {"lighting": value} if isinstance(value, str) else value


Captured: TypeAlias = Annotated[
    CapturedTable, BeforeValidator(_name_as_table, json_schema_input_type=str | CapturedTable)
]
