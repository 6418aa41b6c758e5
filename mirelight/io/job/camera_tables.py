"""Tables of the job file for cameras."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal, TypeAlias

from pydantic import Discriminator, Field, Tag, model_validator

from mirelight.io.job.camera_file_tables import MOST_CAMERAS, SENSOR_WIDTH, ApertureTable, Capture, ShutterTable
from mirelight.io.job.fields import (
    Bounds,
    Degrees,
    Direction,
    Elevation,
    FieldOfView,
    Matrix,
    Name,
    Number,
    Pixels,
    Positive,
    Seed,
    Table,
    Vec3,
    given,
    one_way,
    wrong,
)
from mirelight.io.job.scene_tables import is_similarity

YFOV = 45.0  # degrees
_TARGET = "[x, y, z], the point looked at. Default: the scene's middle."
_RADIUS = "Distance from target, in world units. Default: the whole scene is in view."


class CameraTable(Table):
    """Keys that all cameras have."""

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


class LensTable(CameraTable, ApertureTable):
    """A lens by its field of view, or by its focal length as photographers write it. Pixels are square."""

    yfov: FieldOfView | None = Field(default=None, description="Vertical field of view in degrees. Default: 45.")
    focal_length: Positive | None = Field(default=None, description="Focal length in millimetres; instead of yfov.")
    sensor_width: Positive | None = Field(
        default=None, description="Millimetres that the picture's width spans; with focal_length. Default: 36."
    )

    @model_validator(mode="after")
    def _check_lens(self) -> LensTable:
        one_way(self, ("yfov",), ("focal_length",))
        if self.sensor_width is not None and self.focal_length is None:
            raise wrong("no focal_length", "give it too, in millimetres, or yfov alone", at="sensor_width")
        return self

    def focal(self, width: int, height: int, yfov: float = YFOV) -> float:
        """Focal length in pixels on a picture; `yfov` in degrees where the table says nothing."""
        if self.focal_length is not None:
            return self.focal_length / (self.sensor_width or SENSOR_WIDTH) * width
        return height / (2 * math.tan(math.radians(self.yfov or yfov) / 2))


class PerspectiveTable(PosedCamera, LensTable, ShutterTable):
    """A pinhole camera."""

    type: Literal["perspective"] = Field(default="perspective", description="Kind of camera.")
    fx: Positive | None = Field(default=None, description="Focal length in pixels along x; instead of yfov.")
    fy: Positive | None = Field(default=None, description="Focal length in pixels along y. Default: fx.")
    cx: Number | None = Field(
        default=None, description="Principal point, pixels from the left edge. Default: width / 2."
    )
    cy: Number | None = Field(
        default=None, description="Principal point, pixels from the top edge. Default: height / 2."
    )
    frames: int = Field(
        default=1, ge=1, le=MOST_CAMERAS, description="Number of pictures from there, of objects that move."
    )

    @model_validator(mode="after")
    def _check_pixels(self) -> PerspectiveTable:
        one_way(self, ("yfov",), ("focal_length",), ("fx",))
        if self.fy is not None and self.fx is None:
            raise wrong("no fx", "give fx too, or yfov alone", at="fy")
        if self.matrix is not None:
            self.require_focus()
        return self


class OrthographicTable(PosedCamera):
    """A camera with parallel view rays."""

    type: Literal["orthographic"]
    ymag: Positive = Field(description="Half the height of the view, in world units (as in glTF).")


class TurntableTable(LensTable, ShutterTable):
    """A perspective camera that circles once around a point, counter-clockwise seen from above."""

    type: Literal["turntable"]
    target: Vec3 | None = Field(
        default=None, description="[x, y, z], the point looked at. Default: the scene's middle."
    )
    radius: Positive | None = Field(
        default=None, description="Distance from the axis, in world units. Default: the whole scene is in view."
    )
    elevation: Number = Field(default=0.0, description="Height of the circle above target, in world units.")
    frames: int = Field(default=36, ge=1, le=MOST_CAMERAS, description="Number of pictures in one turn.")
    start: Degrees = Field(default=0.0, description="Where the circle starts, in degrees from +Z towards +X.")


class OrbitTable(LensTable, ShutterTable):
    """A perspective camera that circles once around a point at one distance and one angle above it."""

    type: Literal["orbit"]
    target: Vec3 | None = Field(default=None, description=_TARGET)
    radius: Positive | None = Field(default=None, description=_RADIUS)
    elevation: Elevation = Field(default=0.0, description="Degrees above the horizon of target, seen from there.")
    frames: int = Field(default=36, ge=1, le=MOST_CAMERAS, description="Number of pictures in one turn.")
    start: Degrees = Field(default=0.0, description="Where the circle starts, in degrees from +Z towards +X.")


class _Sampled(LensTable):
    """Keys of tables that stand for many cameras."""

    count: int = Field(default=64, ge=1, le=MOST_CAMERAS, description="Number of cameras.")
    target: Vec3 | None = Field(default=None, description=_TARGET)


class SphereTable(_Sampled):
    """Cameras all around a point, spread evenly over a sphere (a Fibonacci lattice)."""

    type: Literal["sphere"]
    radius: Positive | None = Field(default=None, description=_RADIUS)
    seed: Seed = Field(default=0, description="Turns the whole pattern about the vertical; 0: not at all.")


class DomeTable(_Sampled):
    """Cameras around a point, spread evenly over a band of a sphere: between two elevations."""

    type: Literal["dome"]
    radius: Positive | None = Field(default=None, description=_RADIUS)
    elevation: Annotated[list[Elevation], Field(min_length=2, max_length=2)] = Field(
        default=[0.0, 90.0], description="[lowest, highest] in degrees above the horizon of target."
    )
    seed: Seed = Field(default=0, description="Turns the whole pattern about the vertical; 0: not at all.")

    @model_validator(mode="after")
    def _check_band(self) -> DomeTable:
        if self.elevation[0] >= self.elevation[1]:
            low, high = self.elevation
            raise wrong(f"[{low:g}, {high:g}]", "give the lower angle first", at="elevation")
        return self


class RandomTable(_Sampled):
    """Cameras at random places of a box, each drawn by seed and number alone: more of them change none. One inside the
    proxy, or that sees nothing of it, is drawn again."""

    type: Literal["random"]
    bounds: Bounds | None = Field(
        default=None, description="[[x, y, z], [x, y, z]], the box of the eyes. Default: the scene's."
    )
    target_bounds: Bounds | None = Field(
        default=None, description="[[x, y, z], [x, y, z]], a box of points to look at; instead of target."
    )
    seed: Seed = Field(default=0, description="Same seed, same cameras.")

    @model_validator(mode="after")
    def _check_targets(self) -> RandomTable:
        one_way(self, ("target",), ("target_bounds",))
        return self


class AroundTable(_Sampled):
    """Cameras between those of the capture: each between one of them and a neighbour, in direction and distance from
    what they look at, so that splats are seen as they were captured. More of them change none."""

    type: Literal["around"]
    target: Vec3 | None = Field(
        default=None, description="[x, y, z], the point looked at. Default: where the capture's cameras look."
    )
    capture: Capture | None = Field(
        default=None, description="The capture's cameras, as in cameras_from; not rendered. Default: cameras_from."
    )
    seed: Seed = Field(default=0, description="Same seed, same cameras.")


def _camera_type(value: Any) -> str | None:
    if not isinstance(value, dict):
        return f"type={value.type}" if isinstance(value, CameraTable) and hasattr(value, "type") else None
    kind = value.get("type", "perspective")
    return f"type={kind}" if isinstance(kind, str) else None


AnyCamera: TypeAlias = Annotated[
    Annotated[PerspectiveTable, Tag("type=perspective")]
    | Annotated[OrthographicTable, Tag("type=orthographic")]
    | Annotated[TurntableTable, Tag("type=turntable")]
    | Annotated[OrbitTable, Tag("type=orbit")]
    | Annotated[SphereTable, Tag("type=sphere")]
    | Annotated[DomeTable, Tag("type=dome")]
    | Annotated[RandomTable, Tag("type=random")]
    | Annotated[AroundTable, Tag("type=around")],
    Discriminator(_camera_type),
]
