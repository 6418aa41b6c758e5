"""Tables of the job file for what is in the scene: splats, proxy, environment."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Any, Literal, TypeAlias

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field, WithJsonSchema, model_validator

from mirelight.io.job.fields import (
    SPLATS,
    AssetPath,
    ColorOrGray,
    Degrees,
    Euler,
    LightName,
    Matrix,
    MeshPath,
    Name,
    NotNegative,
    Number,
    Positive,
    Quaternion,
    Seed,
    Share,
    Table,
    Vec3,
    given,
    one_way,
    path_as_table,
    paths_as_tables,
    wrong,
)
from mirelight.io.job.sun_position import SOUTH, sun_position
from mirelight.io.job.words import shown
from mirelight.model import SplatColorSpace, SplatWorld

SMALLEST = 1e-6  # scale: below, float32 positions fall together


class Transform(Table):
    """How a file's content is placed in the world: scaled, then rotated, then moved; or one matrix."""

    translation: Vec3 | None = Field(default=None, description="[x, y, z] in world units. Default: no shift.")
    rotation_euler: Euler | None = Field(
        default=None,
        description="[x, y, z] in degrees about the fixed axes, X first, then Y, then Z (PlayCanvas' eulerAngles).",
    )
    rotation_quaternion: Quaternion | None = Field(default=None, description="[w, x, y, z]; normalised when read.")
    scale: Annotated[Positive, Field(ge=SMALLEST)] | None = Field(
        default=None, description="One factor for all axes. Default: 1."
    )
    matrix: Matrix | None = Field(
        default=None, description="4 rows of 4 numbers acting on column vectors; instead of the other keys."
    )

    @model_validator(mode="after")
    def _check(self) -> Transform:
        one_way(self, ("matrix",), ("translation", "rotation_euler", "rotation_quaternion", "scale"))
        one_way(self, ("rotation_euler",), ("rotation_quaternion",))
        return self


def is_similarity(matrix: list[list[float]]) -> bool:
    """True where the matrix only rotates, moves and scales all axes alike (no shear, no mirror)."""
    r = np.asarray(matrix, dtype=np.float64)[:3, :3]
    size = np.cbrt(np.linalg.det(r))
    return bool(size > SMALLEST and np.allclose(r @ r.T, size**2 * np.eye(3), atol=1e-4 * size**2))


class SplatsTable(Table):
    """A splat file, and how it is placed."""

    path: AssetPath = Field(
        description="Splat file: .ply, .compressed.ply, .spz, .sog, SOG folder, .splat, .ksplat, .glb, or a training's "
        "checkpoint: .pt, .ckpt."
    )
    transform: Transform = Field(default=Transform(), description="Places the splats in the world.")
    lod: int | None = Field(
        default=None,
        ge=0,
        le=63,
        description="Level of detail of a streamed SOG (lod-meta.json), 0 the finest. Default: 0.",
    )

    color_space: SplatColorSpace | None = Field(
        default=None,
        description="That the splats were trained in, and blend in: display-encoded, linear light, or log (ACEScct). "
        "Default: what the file says, else srgb_rec709_display.",
    )
    world: SplatWorld = Field(
        default="capture",
        description="What they lie in: the coordinates of the pictures' cameras, or those that nerfstudio or gsplat "
        "moved them to before training. Cameras of COLMAP and transforms.json are brought there.",
    )

    @model_validator(mode="after")
    def _check(self) -> SplatsTable:
        if self.transform.matrix and not is_similarity(self.transform.matrix):
            remedy = "splats can be rotated, moved and scaled alike on all axes; bake anything else into the file"
            raise wrong("a matrix with shear, mirror or unequal scale", remedy, at="transform")
        return self


def _albedo(value: Any) -> Any:
    if isinstance(value, str):
        if value not in ("file", "splats"):
            raise wrong(shown(value), 'give a number, [r, g, b], "file" or "splats"')
        return value
    values = value if isinstance(value, list) else [value] * 3
    if len(values) != 3 or any(isinstance(v, bool) or not isinstance(v, int | float) for v in values):
        raise wrong(shown(value), 'give a number, [r, g, b], "file" or "splats"')
    if not all(0 <= v <= 1 for v in values):
        raise wrong(f"an albedo of {shown(value)}", "give values from 0 to 1")
    return [float(v) for v in values]


_SHARE = {"type": "number", "minimum": 0, "maximum": 1}
Albedo: TypeAlias = Annotated[
    list[float] | Literal["file", "splats"],
    BeforeValidator(_albedo),
    WithJsonSchema(
        {
            "anyOf": [
                _SHARE,
                {"type": "array", "items": _SHARE, "minItems": 3, "maxItems": 3},
                {"enum": ["file", "splats"]},
            ]
        }
    ),
]


def _reflectance(values: list[float]) -> list[float]:
    if max(values) > 1:
        raise wrong(f"an albedo of {shown(values)}", "give values from 0 to 1")
    return values


class ProxyTable(Table):
    """The triangle mesh that receives and blocks the light in place of the splats."""

    path: MeshPath = Field(
        description='Mesh file: .glb, .gltf, .ply or .obj; or "splats" for one that is made from the splats.'
    )
    transform: Transform = Field(default=Transform(), description="Places the mesh, and its file's lights and cameras.")
    albedo: Albedo = Field(
        default=[0.5, 0.5, 0.5],
        description='Diffuse reflectance: a number, linear [r, g, b], "file" for the file\'s own base colours, or '
        '"splats" to estimate it from the splats and the captured light (modes ratio and albedo; '
        "the default of mode albedo).",
    )
    cameras: AssetPath | None = Field(
        default=None,
        description="The cameras of the capture's pictures, a file or folder (docs/guides/cameras.md), placed as the "
        "splats are. Colours of fuzzy splats are looked at from there; of a proxy made from the splats, what they did "
        "not see "
        "is closed against light.",
    )
    pictures: bool | AssetPath = Field(
        default=True,
        description="Whether colours of fuzzy splats are those of the pictures that these cameras took, where they "
        "lie beside the cameras' file as it names them; or the folder in which they lie. What the splats show is a "
        "little too bright where it is dark.",
    )
    ceiling: bool = Field(
        default=True,
        description="Of a proxy made from the splats: whether a room whose walls go on above all pictures gets a "
        "ceiling there. false for a yard with walls all round, captured without its sky.",
    )

    @model_validator(mode="after")
    def _check(self) -> ProxyTable:
        if self.path != SPLATS and "ceiling" in self.model_fields_set:
            raise wrong("a ceiling of a proxy that is a file", "leave it out", at="ceiling")
        if self.path == SPLATS and self.transform.model_fields_set:
            raise wrong("a transform of a proxy that is made from the splats", "give it to the splats", at="transform")
        if "pictures" in self.model_fields_set and self.cameras is None:
            raise wrong("pictures of no cameras", "name the cameras that took them, too", at="pictures")
        if self.path == SPLATS and self.albedo == "file":
            raise wrong("'file' for a proxy that has none", 'give a number, [r, g, b] or "splats"', at="albedo")
        return self


class ScatterTable(Table):
    """Random places on the ground: tried one after the other until the object fits."""

    center: Vec3 = Field(description="[x, y, z] of the middle, near the ground; from over it the object must be seen.")
    radius: Positive = Field(description="How far from there its foot stands at most, in world units.")
    seed: Seed = Field(default=0, description="Another seed, another place.")
    turn: bool = Field(default=True, description="Whether it is turned about the vertical, too.")


class KeyTable(Table):
    """Where an object is at one frame; between two it goes straight on and turns evenly."""

    frame: Number = Field(
        description="Of a camera's path, whose first picture is 1. Before the first key and after the last it stands "
        "still."
    )
    translation: Vec3 | None = Field(
        default=None, description="[x, y, z] in world units, in place of the transform's. Default: the transform's."
    )
    rotation_euler: Euler | None = Field(
        default=None, description="As in transform, whose rotation it takes the place of. Default: the transform's."
    )
    rotation_quaternion: Quaternion | None = Field(default=None, description="[w, x, y, z]; instead of rotation_euler.")

    @model_validator(mode="after")
    def _check(self) -> KeyTable:
        one_way(self, ("rotation_euler",), ("rotation_quaternion",))
        return self


class ObjectTable(Table):
    """An object that is put into the capture: lit by it, mirroring it, and casting its shadows on it."""

    path: AssetPath = Field(description="Mesh file: .glb, .gltf, .ply, .obj or .stl.")
    node: LightName | None = Field(
        default=None,
        description="One node of a glTF file, with what hangs on it, in place of all: as turned and as large as there, "
        "with its own origin at the world's. Default: the whole file.",
    )
    name: Name | None = Field(default=None, description="What messages call it. Default: the node's or file's name.")
    category: Name | None = Field(default=None, description="What kind of thing it is in data sets. Default: its name.")
    transform: Transform = Field(default=Transform(), description="Places it in the world.")
    drop: bool | Literal["tilt"] = Field(
        default=False,
        description="Whether it is moved along Y until its lowest vertices stand on the proxy; "
        '"tilt" turns it along the ground under them first.',
    )
    scatter: ScatterTable | None = Field(
        default=None,
        description="Puts it at a random place where it fits, and drops it there; its transform scales and turns it.",
    )
    keys: list[KeyTable] | None = Field(
        default=None, min_length=2, max_length=10_000, description="Where it is at which frame: it moves."
    )
    base_color: Annotated[ColorOrGray, AfterValidator(_reflectance)] | None = Field(
        default=None, description="In place of the file's colours: a number or linear [r, g, b]."
    )
    metallic: Share | None = Field(default=None, description="In place of the file's: 0 no metal, 1 a metal.")
    roughness: Share | None = Field(default=None, description="In place of the file's: 0 a mirror, 1 matt.")

    @model_validator(mode="after")
    def _check(self) -> ObjectTable:
        for i, (one, later) in enumerate(zip(self.keys or [], (self.keys or [])[1:], strict=False)):
            if later.frame <= one.frame:
                raise wrong(f"{later.frame:g} after {one.frame:g} at key {i + 2}", "let frames rise", at="keys")
        if self.keys is not None and self.scatter is not None:
            raise wrong("keys, and a random place", "keep one of them (keys or scatter)", at="scatter")
        return self


Splats: TypeAlias = Annotated[
    list[SplatsTable],
    BeforeValidator(paths_as_tables, json_schema_input_type=str | SplatsTable | list[str | SplatsTable]),
    Field(min_length=1, max_length=1000),
]
Proxy: TypeAlias = Annotated[ProxyTable, BeforeValidator(path_as_table, json_schema_input_type=str | ProxyTable)]


def _moment(value: Any) -> Any:
    example = "write 2026-06-21T15:30:00+02:00, without quotes"
    if not isinstance(value, datetime):
        raise wrong(shown(str(value)), f"give a date and time with its offset from UTC: {example}")
    if value.tzinfo is None:
        raise wrong("a time without its offset from UTC", example)
    if not 1900 <= value.year <= 2100:
        raise wrong(f"the year {value.year}", "give one from 1900 to 2100")
    return value


Moment: TypeAlias = Annotated[
    datetime, BeforeValidator(_moment), WithJsonSchema({"type": "string", "format": "date-time"})
]


Latitude: TypeAlias = Annotated[float, Field(ge=-90, le=90, allow_inf_nan=False)]
Longitude: TypeAlias = Annotated[float, Field(ge=-180, le=180, allow_inf_nan=False)]


class SkyTable(Table):
    """A clear day's sun and sky: by place and time, or by where the sun stands."""

    latitude: Latitude | None = Field(default=None, description="Degrees, north is positive.")
    longitude: Longitude | None = Field(default=None, description="Degrees, east is positive.")
    time: Moment | None = Field(default=None, description="Date and time with its offset from UTC, without quotes.")
    elevation: Annotated[float, Field(gt=0, le=90, allow_inf_nan=False)] | None = Field(
        default=None, description="Degrees of the sun's centre above the horizon; instead of place and time."
    )
    azimuth: Degrees | None = Field(default=None, description="Degrees clockwise from north. Default: 180, south.")
    turbidity: float = Field(
        default=3.0,
        ge=1,
        le=10,
        allow_inf_nan=False,
        description="Haze: 2 is very clear, 3 a clear day, 6 warm and moist, 10 hazy.",
    )
    albedo: Annotated[ColorOrGray, AfterValidator(_reflectance)] = Field(
        default=[0.3, 0.3, 0.3], description="The ground's reflectance, which brightens the sky: a number or [r, g, b]."
    )

    @model_validator(mode="after")
    def _check(self) -> SkyTable:
        place = ("latitude", "longitude", "time")
        one_way(self, place, ("elevation", "azimuth"), needed="add latitude, longitude and time, or elevation")
        missing = [name for name in place if name not in given(self, *place)]
        if 0 < len(missing) < len(place):
            raise wrong(f"no {missing[0]}", f"give {', '.join(place[:2])} and time together")
        if self.azimuth is not None and self.elevation is None:
            raise wrong("an azimuth without an elevation", "add elevation", at="azimuth")
        elevation, _ = self.sun
        if elevation <= 0:
            raise wrong(f"the sun is {-elevation:.1f} degrees below the horizon then", "take another time", at="time")
        return self

    @property
    def sun(self) -> tuple[float, float]:
        """Elevation and azimuth of the sun in degrees."""
        if self.elevation is not None:
            return self.elevation, SOUTH if self.azimuth is None else self.azimuth
        assert self.latitude is not None and self.longitude is not None and self.time is not None
        return sun_position(self.latitude, self.longitude, self.time)


class EnvironmentTable(Table):
    """Light from all around: a panorama, the same radiance in every direction, or a clear sky with its sun."""

    path: AssetPath | None = Field(
        default=None, description="Equirectangular picture: .exr or .hdr (linear), .png or .jpg (sRGB-decoded)."
    )
    radiance: ColorOrGray | None = Field(
        default=None, description="Constant radiance in cd/m²: a number or linear [r, g, b]; instead of path."
    )
    sky: SkyTable | None = Field(
        default=None, description="A clear day's sun and sky in lux and cd/m², as two layers; instead of path."
    )
    intensity: NotNegative = Field(default=1.0, description="Multiplies the light.")
    rotation: Degrees = Field(
        default=0.0, description="Turns the light about +Y, in degrees, counter-clockwise seen from above."
    )
    orientation: Literal["blender", "playcanvas"] = Field(
        default="blender",
        description="What the picture's centre column looks along at rotation 0: blender +X (as Blender's world "
        "texture), playcanvas +Z (and rotation turns the other way, as the engine's skybox rotation).",
    )

    @model_validator(mode="after")
    def _check(self) -> EnvironmentTable:
        one_way(self, ("path",), ("radiance",), ("sky",), needed='add path = "sky.hdr" or radiance = 1.0')
        if self.sky is not None and "orientation" in self.model_fields_set:
            raise wrong("a picture's orientation for a computed sky", "leave it out; north is -Z", at="orientation")
        return self


Environment: TypeAlias = Annotated[
    EnvironmentTable, BeforeValidator(path_as_table, json_schema_input_type=str | EnvironmentTable)
]
