"""Tables of the job file for cameras."""

from __future__ import annotations

from typing import Annotated, Any, Literal, TypeAlias

from pydantic import BeforeValidator, Discriminator, Field, Tag, model_validator

from mirelight.io.job.fields import (
    Degrees,
    Direction,
    FieldOfView,
    GltfPath,
    Matrix,
    Name,
    Number,
    Pixels,
    Positive,
    Table,
    Vec3,
    given,
    one_way,
    paths_as_tables,
    wrong,
)
from mirelight.io.job.scene_tables import Transform, is_similarity


class CameraTable(Table):
    """What all cameras share."""

    name: Name | None = Field(default=None, description="Part of the frames' file names. Default: camera, camera-2, …")
    width: Pixels | None = Field(default=None, description="Image width in pixels. Default: the job's resolution.")
    height: Pixels | None = Field(default=None, description="Image height in pixels. Default: the job's resolution.")
    near: Positive = Field(default=0.01, description="World units along the view axis; nearer things are not seen.")
    far: Positive | None = Field(default=None, description="World units; farther things are not seen. Default: no end.")

    @model_validator(mode="after")
    def _check_planes(self) -> CameraTable:
        if self.far is not None and self.far <= self.near:
            raise wrong(f"{self.far:g}, and near is {self.near:g}", "put far beyond near", at="far")
        return self


class PosedCamera(CameraTable):
    """A camera with one pose: from position to target, or a matrix."""

    position: Vec3 | None = Field(default=None, description="[x, y, z] of the eye in world units.")
    target: Vec3 | None = Field(default=None, description="[x, y, z], the point in the middle of the picture.")
    up: Direction | None = Field(
        default=None, description="[x, y, z], towards which the picture's top points. Default: +Y."
    )
    matrix: Matrix | None = Field(
        default=None,
        description="World from camera, 4 rows of 4 numbers; the camera looks along its -Z, +Y is up. "
        "Instead of position, target and up.",
    )

    @model_validator(mode="after")
    def _check_pose(self) -> PosedCamera:
        one_way(self, ("matrix",), ("position", "target", "up"), needed="add position and target, or matrix")
        if self.matrix is None:
            for name in ("position", "target"):
                if not given(self, name):
                    raise wrong(f"no {name}", f"add {name} = [x, y, z]")
            if self.position == self.target:
                raise wrong("the camera's own position", "give another point", at="target")
        elif not is_similarity(self.matrix):
            raise wrong("shear, mirror or unequal scale", "give a rotation and a translation", at="matrix")
        return self


class PerspectiveTable(PosedCamera):
    """A pinhole camera."""

    type: Literal["perspective"] = Field(default="perspective", description="Kind of camera.")
    yfov: FieldOfView | None = Field(default=None, description="Vertical field of view in degrees. Default: 45.")
    fx: Positive | None = Field(default=None, description="Focal length in pixels along x; instead of yfov.")
    fy: Positive | None = Field(default=None, description="Focal length in pixels along y. Default: fx.")
    cx: Number | None = Field(
        default=None, description="Principal point, pixels from the left edge. Default: width / 2."
    )
    cy: Number | None = Field(
        default=None, description="Principal point, pixels from the top edge. Default: height / 2."
    )

    @model_validator(mode="after")
    def _check_lens(self) -> PerspectiveTable:
        one_way(self, ("yfov",), ("fx",))
        if self.fy is not None and self.fx is None:
            raise wrong("no fx", "give fx too, or yfov alone", at="fy")
        return self


class OrthographicTable(PosedCamera):
    """A camera with parallel view rays."""

    type: Literal["orthographic"]
    ymag: Positive = Field(description="Half the height of the view, in world units (as in glTF).")


class TurntableTable(CameraTable):
    """A perspective camera that circles once around a point, counter-clockwise seen from above."""

    type: Literal["turntable"]
    target: Vec3 | None = Field(
        default=None, description="[x, y, z], the point looked at. Default: the scene's middle."
    )
    radius: Positive | None = Field(
        default=None, description="Distance from the axis, in world units. Default: the whole scene is in view."
    )
    elevation: Number = Field(default=0.0, description="Height of the circle above target, in world units.")
    frames: int = Field(default=36, ge=1, le=100_000, description="Number of pictures in one turn.")
    start: Degrees = Field(default=0.0, description="Where the circle starts, in degrees from +Z towards +X.")
    yfov: FieldOfView = Field(default=45.0, description="Vertical field of view in degrees.")


def _camera_type(value: Any) -> str | None:
    if not isinstance(value, dict):
        return f"type={value.type}" if isinstance(value, CameraTable) and hasattr(value, "type") else None
    kind = value.get("type", "perspective")
    return f"type={kind}" if isinstance(kind, str) else None


AnyCamera: TypeAlias = Annotated[
    Annotated[PerspectiveTable, Tag("type=perspective")]
    | Annotated[OrthographicTable, Tag("type=orthographic")]
    | Annotated[TurntableTable, Tag("type=turntable")],
    Discriminator(_camera_type),
]


class CamerasFromTable(Table):
    """Cameras of a glTF file, still or animated."""

    path: GltfPath = Field(description='A .glb or .gltf file, or "proxy" for the proxy\'s own file.')
    names: list[str] | None = Field(default=None, min_length=1, description="Which cameras, by name. Default: all.")
    transform: Transform | None = Field(
        default=None, description="Places them in the world. Default for the proxy: its own."
    )
    fps: Positive | None = Field(
        default=None, description="Samples the file's animation at this rate, in frames per second."
    )
    frames: int | None = Field(
        default=None,
        ge=1,
        le=100_000,
        description="Samples the file's animation at this many equal steps; instead of fps.",
    )

    @model_validator(mode="after")
    def _check(self) -> CamerasFromTable:
        one_way(self, ("fps",), ("frames",))
        if self.transform and self.transform.matrix and not is_similarity(self.transform.matrix):
            raise wrong(
                "shear, mirror or unequal scale", "give a rotation, a translation and one scale", at="transform"
            )
        return self


CamerasFrom: TypeAlias = Annotated[
    list[CamerasFromTable],
    BeforeValidator(paths_as_tables, json_schema_input_type=str | CamerasFromTable | list[str | CamerasFromTable]),
    Field(max_length=1000),
]
