"""What the child process says of a stage: plain values, sent as JSON beside arrays in files."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias

Part: TypeAlias = Literal["splats", "head", "mesh", "cameras", "lights", "files", "times"]
Rows4: TypeAlias = list[list[float]]  # a matrix (4, 4), row-major, acting on columns


@dataclass(frozen=True, slots=True, kw_only=True)
class Request:
    """What is asked of a stage."""

    path: str
    part: Part
    time: float | None = None  # s; None: the stage as it stands by default
    times: list[float] = field(default_factory=list)  # s, of "cameras": poses at each
    textures: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class SplatRow:
    """One field of splats; its arrays have the same index."""

    prim: str
    world: Rows4
    count: int
    degree: int
    color_space: str  # "" where it is not authored
    projection: str
    sorting: str
    antialiased: bool = False  # of a stage that this package wrote; the schema has no word for it


@dataclass(frozen=True, slots=True, kw_only=True)
class MaterialRow:
    """UsdPreviewSurface; files are in the answer's folder, "" where there is none."""

    name: str
    prim: str
    base_color: list[float]
    base_color_file: str = ""
    base_color_raw: bool = False  # the picture holds linear values
    base_color_wrap: list[str] = field(default_factory=lambda: ["repeat", "repeat"])
    emissive: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    emissive_file: str = ""
    emissive_raw: bool = False
    emissive_wrap: list[str] = field(default_factory=lambda: ["repeat", "repeat"])


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraRow:
    """A camera; lengths of the lens in tenths of a unit of the stage (all that counts is their ratio)."""

    name: str
    prim: str
    world: Rows4  # rigid or scaled
    orthographic: bool
    focal: float
    apertures: list[float]  # horizontal, vertical
    offsets: list[float]  # horizontal, vertical
    clipping: list[float]  # metres
    unit: float  # metres of a tenth of a unit: of orthographic apertures
    moves: bool  # something is animated
    aperture_radius: float = 0.0  # metres; 0: a pinhole
    focus_distance: float = 0.0  # metres
    shutter: list[float] = field(default_factory=lambda: [0.0, 0.0])  # s after a frame's moment: opens, closes


@dataclass(frozen=True, slots=True, kw_only=True)
class LightRow:
    """A light; `radiance` is its luminance by colour channel, in cd/m² (lux where it is parallel)."""

    name: str
    prim: str
    kind: str  # UsdLux: DistantLight, SphereLight, RectLight, DiskLight, CylinderLight, DomeLight
    world: Rows4  # rigid, metres
    radiance: list[float]
    size: list[float]  # metres or degrees: radius; width, height; length, radius; angle
    point: bool = False  # treatAsPoint, or of no size
    candela: list[float] = field(default_factory=list)  # of a point
    cone_angle: float = 180.0  # degrees from the axis
    cone_softness: float = 0.0
    focus: float = 0.0
    ies_file: str = ""  # in the answer's folder
    ies_normalize: bool = False
    ies_angle_scale: float = 0.0
    texture_file: str = ""
    texture_format: str = "automatic"
    exact: dict[str, Any] | None = None  # the lamp in full, of a stage that this package wrote


@dataclass(frozen=True, slots=True, kw_only=True)
class Failure:
    """Why a stage cannot be used."""

    found: str
    remedy: str = ""
    prim: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """All that a child said."""

    failure: Failure | None = None
    notes: list[str] = field(default_factory=list)  # what is not followed, a line each
    splats: list[SplatRow] = field(default_factory=list)
    materials: list[MaterialRow] = field(default_factory=list)
    nodes: list[str] = field(default_factory=list)
    cameras: list[CameraRow] = field(default_factory=list)
    lights: list[LightRow] = field(default_factory=list)
    files: list[str] = field(default_factory=list)  # absolute
    times: list[float] = field(default_factory=list)  # s: first and last key, where there are some
    rate: float = 24.0  # time codes a second
    counts: list[int] = field(default_factory=list)  # "head": meshes, cameras, lamps, domes


def answer_from(data: dict[str, object]) -> Answer:
    """An answer from its JSON."""
    kinds = {"splats": SplatRow, "materials": MaterialRow, "cameras": CameraRow, "lights": LightRow}
    out = dict(data)
    for name, kind in kinds.items():
        found = out.get(name)
        if isinstance(found, list):
            out[name] = [kind(**one) for one in found]
    failure = out.get("failure")
    if isinstance(failure, dict):
        out["failure"] = Failure(**failure)
    return Answer(**out)  # type: ignore[arg-type]
