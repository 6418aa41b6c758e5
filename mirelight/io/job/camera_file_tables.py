"""Tables of the job file for files of cameras."""

from __future__ import annotations

from typing import Annotated, Any, Literal, TypeAlias

from pydantic import BeforeValidator, Discriminator, Field, Tag, model_validator

from mirelight.io.job.fields import (
    GltfPath,
    Positive,
    Resolution,
    Table,
    one_way,
    path_as_table,
    paths_as_tables,
    wrong,
)
from mirelight.io.job.scene_tables import Transform, is_similarity

MOST_CAMERAS = 100_000  # of one table


def _table_or_word(value: Any) -> str:
    return "type=table" if isinstance(value, dict | Transform) else "type=word"


Placing: TypeAlias = Annotated[
    Annotated[Transform, Tag("type=table")] | Annotated[Literal["splats", "none"], Tag("type=word")],
    Discriminator(_table_or_word),
]


class CamerasFromTable(Table):
    """Cameras of a file or folder: glTF, still or animated, or of a capture."""

    path: GltfPath = Field(
        description='A file or folder of cameras (docs/guides/cameras.md), or "proxy" for the proxy\'s own glTF file.'
    )
    names: list[str] | None = Field(
        default=None, min_length=1, description="Which cameras, by name or pattern (* and ?). Default: all."
    )
    every: int = Field(default=1, ge=1, le=MOST_CAMERAS, description="Of those, only every so many, from the first on.")
    transform: Placing | None = Field(
        default=None,
        description='Places them in the world: a table, "splats" for that of the splats, or "none". '
        "Default: glTF none, the proxy's its own, a capture's splats.",
    )
    resolution: Resolution | None = Field(
        default=None,
        description="[width, height] in pixels; the vertical field is kept. Default: the file's, else the job's.",
    )
    resolution_scale: Annotated[Positive, Field(le=16)] = Field(
        default=1.0, description="Scales the image of each of them."
    )
    distortion: Literal["error", "ignore"] = Field(
        default="error", description="What to do with lenses that bend lines: refuse them, or render plain pinholes."
    )
    axes: Literal["opengl", "opencv"] | None = Field(
        default=None,
        description="transforms.json, CSV: opengl: cameras look along their -Z with +Y up; opencv: along +Z with +Y "
        "down. Default: opengl.",
    )
    world: Literal["capture", "nerfstudio"] = Field(
        default="capture",
        description="transforms.json, camera_path.json: what the splats are in: the capture's coordinates, or those "
        "that nerfstudio trained and exported in.",
    )
    fps: Positive | None = Field(
        default=None, description="glTF, SuperSplat: samples the animation at this rate, in frames per second."
    )
    frames: int | None = Field(
        default=None,
        ge=1,
        le=MOST_CAMERAS,
        description="glTF, SuperSplat: samples the animation at this many equal steps; instead of fps.",
    )

    @model_validator(mode="after")
    def _check(self) -> CamerasFromTable:
        one_way(self, ("fps",), ("frames",))
        placed = self.transform
        if isinstance(placed, Transform) and placed.matrix and not is_similarity(placed.matrix):
            raise wrong(
                "shear, mirror or unequal scale", "give a rotation, a translation and one scale", at="transform"
            )
        return self


CamerasFrom: TypeAlias = Annotated[
    list[CamerasFromTable],
    BeforeValidator(paths_as_tables, json_schema_input_type=str | CamerasFromTable | list[str | CamerasFromTable]),
    Field(max_length=1000),
]
Capture: TypeAlias = Annotated[
    CamerasFromTable, BeforeValidator(path_as_table, json_schema_input_type=str | CamerasFromTable)
]
