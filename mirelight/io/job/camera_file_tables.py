"""Tables of the job file for files of cameras."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Any, Literal, TypeAlias

from pydantic import BeforeValidator, Discriminator, Field, Tag, model_validator

from mirelight.io.job.fields import (
    GltfPath,
    NotNegative,
    Number,
    Positive,
    Resolution,
    Share,
    Table,
    one_way,
    path_as_table,
    paths_as_tables,
    wrong,
)
from mirelight.io.job.scene_tables import Transform, is_similarity
from mirelight.model import Camera, Exposure, SplatWorld

MOST_CAMERAS = 100_000  # of one table
SENSOR_WIDTH = 36.0  # mm, where a job says none


def _table_or_word(value: Any) -> str:
    return "type=table" if isinstance(value, dict | Transform) else "type=word"


Placing: TypeAlias = Annotated[
    Annotated[Transform, Tag("type=table")] | Annotated[Literal["splats", "none"], Tag("type=word")],
    Discriminator(_table_or_word),
]


class ApertureTable(Table):
    """Keys of a lens that is no pinhole."""

    f_stop: Positive | None = Field(
        default=None,
        description="Focal length over the width of the aperture, for scenes in metres: what is out of focus is "
        "blurred. Default: a pinhole, which all is sharp to.",
    )
    aperture_radius: NotNegative | None = Field(
        default=None, description="Radius of the aperture in world units, whatever they are; instead of f_stop."
    )
    focus_distance: Positive | None = Field(
        default=None,
        description="World units along the view axis to what is sharp. Default: as far as target.",
    )

    @model_validator(mode="after")
    def _check_aperture(self) -> ApertureTable:
        one_way(self, ("f_stop",), ("aperture_radius",))
        if self.focus_distance is not None and self.f_stop is None and self.aperture_radius is None:
            raise wrong("no f_stop and no aperture_radius", "give one of them, too", at="focus_distance")
        return self

    def require_focus(self) -> None:
        """Raises what says that a distance is needed, where nothing else gives one."""
        if (self.f_stop or self.aperture_radius) and self.focus_distance is None:
            raise wrong(
                "no focus_distance", "give it too, in world units", at="f_stop" if self.f_stop else "aperture_radius"
            )

    def exposed(self, camera: Camera, distance: float | None, sensor_width: float = SENSOR_WIDTH) -> Camera:
        """A camera with this lens; itself where the table says nothing of one.

        Args:
            camera: of any lens.
            distance: world units to what is sharp, where the table says nothing of it.
            sensor_width: mm.
        """
        radius = self.aperture_radius
        if self.f_stop is not None:
            radius = camera.fx / camera.width * sensor_width / 1000 / (2 * self.f_stop)
        if radius is None:
            return camera
        moving = None if camera.exposure is None else replace(camera.exposure, aperture_radius=0.0)
        away = self.focus_distance or distance
        if radius == 0 or away is None:
            return replace(camera, exposure=moving if moving is not None and moving.poses is not None else None)
        return replace(camera, exposure=replace(moving or Exposure(), aperture_radius=radius, focus_distance=away))


class ShutterTable(Table):
    """Keys of a camera whose frames follow each other."""

    shutter: Share | None = Field(
        default=None,
        description="Share of the time from frame to frame that the shutter is open around each frame's moment: 0.5 is "
        "an angle of 180 degrees. Default: as OpenUSD's camera says, else 0.",
    )


class CamerasFromTable(ApertureTable, ShutterTable):
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
    world: SplatWorld | None = Field(
        default=None,
        description="COLMAP, transforms.json, camera_path.json: the world that they are brought to. Default: that of "
        "the splats.",
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

    time: Number | None = Field(
        default=None, description="glTF, OpenUSD: the animation at this moment alone, in seconds; instead of fps."
    )

    @model_validator(mode="after")
    def _check(self) -> CamerasFromTable:
        one_way(self, ("fps",), ("frames",), ("time",))
        self.require_focus()
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
