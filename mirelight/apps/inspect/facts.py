"""What `mirelight inspect` says of files, as types; units are those of the job file."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, is_dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar, TypeAlias

import numpy as np

from mirelight.io.job.write import light_keys
from mirelight.model import F32, Camera, EstimatedSky, Light, Lighting, PointLight, SkyModel, SpotLight, cones
from mirelight.model.surface_lights import DESCRIBED

if TYPE_CHECKING:
    from mirelight.io.gltf.cameras import GltfCamera
    from mirelight.io.usd.cameras import UsdCamera

Numbers: TypeAlias = tuple[float, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Bounds:
    """An axis-aligned box in world units."""

    low: Numbers  # (3,)
    high: Numbers  # (3,)


@dataclass(frozen=True, slots=True)
class FieldFacts:
    """A number of a light, in the unit of the job file."""

    name: str
    value: float


@dataclass(frozen=True, slots=True, kw_only=True)
class LightFacts:
    """One light, in the names and units of the job file: lux, candela, cd/m², degrees, world units."""

    name: str
    type: str
    intensity: float
    color: Numbers
    position: Numbers | None = None
    direction: Numbers | None = None
    range: float | None = None
    inner_cone_angle: float | None = None
    outer_cone_angle: float | None = None
    cone: str | None = None
    radius: float | None = None
    ies: float | None = None  # lumens of a measured light
    angular_diameter: float | None = None
    shape: str | None = None
    size: Numbers | None = None
    animated: bool = False
    own: tuple[FieldFacts, ...] = ()  # of kinds that their record describes: its fields


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraFacts:
    """One camera; angles in degrees."""

    name: str
    type: str
    position: Numbers
    yfov: float | None = None
    ymag: float | None = None
    aspect: float | None = None  # width / height that a glTF file asks for
    width: int | None = None  # px
    height: int | None = None  # px
    exposure: str | None = None  # its lens and shutter, where it is no pinhole
    animated: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class EnvironmentFacts:
    """An environment: light from all around."""

    width: int
    height: int
    mean: Numbers  # (3,) radiance over the sphere, intensity included
    brightest: float
    rotation: float  # degrees, mirelight's convention
    intensity: float


@dataclass(frozen=True, slots=True, kw_only=True)
class SkyFacts:
    """A computed sun and sky."""

    elevation: float  # degrees of the sun above the horizon
    to_sun: Numbers  # (3,) unit
    turbidity: float
    intensity: float


@dataclass(frozen=True, slots=True, kw_only=True)
class LightingFacts:
    """One lighting of a job."""

    name: str
    lights: tuple[LightFacts, ...]  # of an estimate: those whose places are known, of intensity 1
    environment: EnvironmentFacts | None
    sky: SkyFacts | None
    estimated: bool = False  # its light is estimated from the splats when something is rendered


@dataclass(frozen=True, slots=True, kw_only=True)
class SplatFacts:
    """A splat file."""

    kind: ClassVar[str] = "splats"
    path: str
    format: str
    splats: int
    dropped: int  # left out on reading: NaN, infinite or absurd values
    sh_degree: int
    antialiased: bool
    color_space: str
    levels: Numbers  # splats in each level of detail of a streamed SOG
    bounds: Bounds | None
    median_scale: float | None  # world units
    mean_opacity: float | None
    memory: int  # bytes once read
    notes: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class MeshFacts:
    """A mesh or glTF file."""

    kind: ClassVar[str] = "mesh"
    path: str
    triangles: int
    vertices: int
    bounds: Bounds | None
    normals: bool
    uvs: bool
    vertex_colors: bool
    materials: tuple[str, ...]
    memory: int  # bytes once read
    lights: tuple[LightFacts, ...] = ()
    cameras: tuple[CameraFacts, ...] = ()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class PictureFacts:
    """An image: an environment, or a frame that mirelight wrote."""

    kind: ClassVar[str] = "image"
    path: str
    width: int
    height: int
    channels: tuple[str, ...]
    mean: Numbers | None  # (3,) linear, every finite pixel alike
    brightest: float | None  # largest value of a channel in those, linear
    not_finite: int  # pixels with a NaN or an infinite value, as which no environment is taken
    color_space: str  # of the file's colours; `mean` and `brightest` are in Rec.709
    memory: int  # bytes once read
    fingerprint: str | None  # of a frame that mirelight wrote


@dataclass(frozen=True, slots=True)
class ObjectFacts:
    """An object that is put into the capture."""

    name: str
    triangles: int
    bounds: Bounds | None  # where it stands in a lighting that moves it nowhere else
    to_drop: bool  # it is not set down yet, as the proxy is still to be made


@dataclass(frozen=True, slots=True, kw_only=True)
class JobFacts:
    """A job file with everything it names."""

    kind: ClassVar[str] = "job"
    path: str
    splats: int
    dropped: int  # left out on reading: NaN, infinite or absurd values
    sh_degree: int | None
    triangles: int
    proxy_to_make: bool  # from the splats, when something is rendered
    bounds: Bounds | None
    lightings: tuple[LightingFacts, ...]
    captured: LightingFacts | None
    cameras: tuple[CameraFacts, ...]
    objects: tuple[ObjectFacts, ...]
    frames: int
    inputs: tuple[str, ...]
    mode: str
    profile: str
    output: str
    memory: int  # bytes that a render takes, estimated
    notes: tuple[str, ...] = ()


Facts: TypeAlias = SplatFacts | MeshFacts | PictureFacts | JobFacts


def as_json(facts: Facts | LightingFacts) -> dict[str, Any]:
    """The facts as JSON values, a file's with their kind; what does not apply is left out, infinity is null."""
    kind = {} if isinstance(facts, LightingFacts) else {"kind": facts.kind}
    return {**kind, **_plain(facts)}


def _plain(value: Any) -> Any:
    if is_dataclass(value) and not isinstance(value, type):
        shown = {f.name: getattr(value, f.name) for f in fields(value)}
        return {name: _plain(entry) for name, entry in shown.items() if entry is not None}
    if isinstance(value, tuple):
        return [_plain(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


# --- from the model's types ------------------------------------------------------------------------------------------


def lighting_facts(lighting: Lighting) -> LightingFacts:
    """A lighting of the model."""
    environment = None
    if lighting.environment is not None:
        light = lighting.environment
        height, width = light.pixels.shape[:2]
        rows = np.sin(np.pi * (np.arange(height) + 0.5) / height)  # solid angle of a row's pixels
        mean = np.average(light.pixels.mean(axis=1, dtype=np.float64), axis=0, weights=rows)
        environment = EnvironmentFacts(
            width=width,
            height=height,
            mean=numbers(mean * light.intensity),
            brightest=rounded(light.pixels.max() * light.intensity),
            rotation=light.rotation,
            intensity=light.intensity,
        )
    named = lighting.sky.lights if isinstance(lighting.sky, EstimatedSky) else ()
    return LightingFacts(
        name=lighting.name,
        lights=tuple(light_facts(x) for x in (*lighting.lights, *named)),
        environment=environment,
        sky=_sky_facts(lighting.sky) if isinstance(lighting.sky, SkyModel) else None,
        estimated=isinstance(lighting.sky, EstimatedSky),
    )


def _sky_facts(sky: SkyModel) -> SkyFacts:
    return SkyFacts(
        elevation=rounded(math.degrees(math.asin(sky.to_sun[1]))),
        to_sun=numbers(sky.to_sun),
        turbidity=sky.turbidity,
        intensity=sky.intensity,
    )


def light_facts(light: Light) -> LightFacts:
    """A light in the names and units of the job file."""
    said = {name: _for_people(value) for name, value in light_keys(light).items() if name not in ("group", "up")}
    if isinstance(light, DESCRIBED):
        said["own"] = tuple(FieldFacts(x.name, said.pop(x.name)) for x in light.KIND.fields)
    elif isinstance(light, PointLight | SpotLight) and light.profile is not None:
        solid_angle = light.profile.solid_angle
        if isinstance(light, SpotLight):
            cone = partial(cones.share, light.cone, light.inner_cone_angle, light.outer_cone_angle)
            solid_angle = light.profile.solid_angle_in(cone)
        said["ies"] = rounded(light.intensity * solid_angle)
    return LightFacts(**said)


def _for_people(value: Any) -> Any:
    return value if isinstance(value, str) else numbers(value) if isinstance(value, list) else rounded(value)


def camera_facts(camera: Camera) -> CameraFacts:
    """A camera of the model."""
    perspective = camera.projection == "perspective"
    return CameraFacts(
        name=camera.name,
        type=camera.projection,
        position=numbers(camera.position),
        yfov=rounded(math.degrees(2 * math.atan(camera.height / (2 * camera.fy)))) if perspective else None,
        ymag=None if perspective else rounded(camera.height / (2 * camera.fy)),
        width=camera.width,
        height=camera.height,
        exposure=None if camera.exposure is None else repr(camera.exposure),
    )


def gltf_camera_facts(camera: GltfCamera, animated: bool) -> CameraFacts:
    """A camera as a glTF file has it."""
    return CameraFacts(
        name=camera.name,
        type=camera.projection,
        position=numbers(camera.world[:3, 3]),
        yfov=None if camera.yfov is None else rounded(math.degrees(camera.yfov)),
        ymag=camera.ymag,
        aspect=None if camera.aspect is None else rounded(camera.aspect),
        animated=animated,
    )


def stage_camera_facts(camera: UsdCamera) -> CameraFacts:
    """A camera as a stage has it."""
    flat, one = camera.row.orthographic, camera.to_camera(1000, 1000)
    half = 500 / one.fy
    return CameraFacts(
        name=camera.name,
        type=one.projection,
        position=numbers(camera.world[:3, 3]),
        yfov=None if flat else rounded(math.degrees(2 * math.atan(half))),
        ymag=rounded(half) if flat else None,
        aspect=rounded(camera.aspect),
        animated=camera.row.moves,
    )


def bounds_of(points: F32) -> Bounds | None:
    """The box around points (N, 3); None of none."""
    return Bounds(low=numbers(points.min(axis=0)), high=numbers(points.max(axis=0))) if len(points) else None


def numbers(values: Any) -> Numbers:
    """An array as plain numbers for people."""
    return tuple(rounded(v) for v in np.asarray(values).reshape(-1))


def rounded(value: Any) -> float:
    """Six significant digits: float32 holds no more."""
    return float(f"{float(value):.6g}") + 0.0  # of -0: 0
