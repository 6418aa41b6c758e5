"""The types that cross module borders: frozen, NumPy only, every array checked and read-only.

Shapes and units stand in each field's comment. H, W: image rows and columns. Light is linear Rec.709; see
`mirelight.conventions` for axes. KHR = glTF extension KHR_lights_punctual.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mirelight import conventions

F32: TypeAlias = NDArray[np.float32]
F64: TypeAlias = NDArray[np.float64]
I32: TypeAlias = NDArray[np.int32]

Profile: TypeAlias = Literal["physical", "playcanvas"]
Variant: TypeAlias = Literal["llvm_ad_rgb", "cuda_ad_rgb", "scalar_rgb"]
ToneCurve: TypeAlias = Literal["none", "aces", "neutral", "agx"]


def frozen_array(value: ArrayLike, shape: tuple[int | None, ...], dtype: Any, name: str) -> NDArray[Any]:
    """`value` as a C-contiguous read-only array of `dtype`; None in `shape` fits any length.

    No copy is made where the value already fits; a writeable array that fits is viewed, not locked.

    Raises:
        ValueError: the shape differs.
    """
    array = np.ascontiguousarray(value, dtype=dtype)
    fits = array.ndim == len(shape) and all(w is None or w == n for w, n in zip(shape, array.shape, strict=True))
    if not fits:
        wanted = "(" + ", ".join("n" if n is None else str(n) for n in shape) + ")"
        raise ValueError(f"{name}: shape {array.shape}, expected {wanted}")
    view = array.view()
    view.flags.writeable = False
    return view


def _freeze(owner: object, name: str, shape: tuple[int | None, ...], dtype: Any = np.float32) -> None:
    value = getattr(owner, name)
    if value is not None:
        object.__setattr__(owner, name, frozen_array(value, shape, dtype, f"{type(owner).__name__}.{name}"))


# --- cameras ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Camera:
    """A pinhole or orthographic camera. A camera-space point (x, y, z), z < 0 in front, lands on pixel
    ``(cx + fx x / w, cy - fy y / w)`` with ``w = -z`` (perspective) or ``w = 1`` (orthographic)."""

    name: str = "camera"
    world_from_camera: F64  # (4, 4) rigid; columns right, up, back, position (world units)
    width: int  # px
    height: int  # px
    fx: float  # px (perspective) or px per world unit (orthographic)
    fy: float  # px or px per world unit
    cx: float  # px from the left edge of the image; width / 2 is centred
    cy: float  # px from the top edge; height / 2 is centred
    projection: Literal["perspective", "orthographic"] = "perspective"
    near: float = 0.01  # world units along the view axis; nearer splats and surfaces are not seen
    far: float = float("inf")  # world units

    def __post_init__(self) -> None:
        _freeze(self, "world_from_camera", (4, 4), np.float64)
        r = self.world_from_camera[:3, :3]
        if not np.allclose(r @ r.T, np.eye(3), atol=1e-4) or np.linalg.det(r) < 0:
            raise ValueError("world_from_camera is not rigid (scale, shear or mirror); see conventions.rigid_part")
        if self.width < 1 or self.height < 1:
            raise ValueError(f"image of {self.width} x {self.height} pixels")
        if not (self.fx > 0 and self.fy > 0 and 0 < self.near < self.far):
            raise ValueError("fx and fy must be positive, and 0 < near < far")

    @property
    def camera_from_world(self) -> F64:
        """(4, 4) inverse of `world_from_camera`."""
        r, t = self.world_from_camera[:3, :3], self.world_from_camera[:3, 3]
        out = np.eye(4)
        out[:3, :3], out[:3, 3] = r.T, -r.T @ t
        return out

    @property
    def position(self) -> F64:
        """(3,) eye position, world units."""
        return self.world_from_camera[:3, 3]

    def resized(self, width: int, height: int) -> Camera:
        """The same view on another pixel grid (used for `texture_scale` and small tests)."""
        sx, sy = width / self.width, height / self.height
        return replace(
            self,
            width=width,
            height=height,
            fx=self.fx * sx,
            fy=self.fy * sy,
            cx=self.cx * sx,
            cy=self.cy * sy,
        )

    @staticmethod
    def perspective(
        world_from_camera: ArrayLike,
        width: int,
        height: int,
        *,
        yfov: float,
        name: str = "camera",
        near: float = 0.01,
        far: float = float("inf"),
    ) -> Camera:
        """A centred pinhole camera with square pixels; `yfov` is the vertical field of view in degrees."""
        f = height / (2 * np.tan(np.radians(yfov) / 2))
        return Camera(
            name=name,
            world_from_camera=np.asarray(world_from_camera),
            width=width,
            height=height,
            fx=float(f),
            fy=float(f),
            cx=width / 2,
            cy=height / 2,
            near=near,
            far=far,
        )

    @staticmethod
    def look_at(
        position: ArrayLike, target: ArrayLike, width: int, height: int, *, yfov: float = 45.0, **named: Any
    ) -> Camera:
        """A centred pinhole camera at `position` looking at `target`; `named` as for :meth:`perspective`."""
        return Camera.perspective(conventions.look_at(position, target), width, height, yfov=yfov, **named)


# --- lights ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DirectionalLight:
    """KHR directional light: parallel, no position, hard shadows."""

    name: str
    direction: F64  # (3,) unit, the way the light travels
    color: F64 = field(default_factory=lambda: np.ones(3))  # (3,) linear Rec.709
    intensity: float = 1.0  # lux (illuminance on a facing surface)

    def __post_init__(self) -> None:
        _freeze(self, "color", (3,), np.float64)
        object.__setattr__(self, "direction", conventions.unit(self.direction))
        _freeze(self, "direction", (3,), np.float64)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PointLight:
    """KHR point light, or a sphere of that radius with the same candela."""

    name: str
    position: F64  # (3,) world units
    color: F64 = field(default_factory=lambda: np.ones(3))  # (3,) linear
    intensity: float = 1.0  # candela
    range: float = float("inf")  # world units; KHR window max(min(1 - (d/range)^4, 1), 0); inf: none
    radius: float = 0.0  # world units; 0: a point with hard shadows

    def __post_init__(self) -> None:
        _freeze(self, "color", (3,), np.float64)
        _freeze(self, "position", (3,), np.float64)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SpotLight:
    """KHR spot light: squared smooth cone between two half angles, `range` as for points."""

    name: str
    position: F64  # (3,) world units
    direction: F64  # (3,) unit, the cone's axis away from the light
    color: F64 = field(default_factory=lambda: np.ones(3))  # (3,) linear
    intensity: float = 1.0  # candela inside the inner cone
    range: float = float("inf")  # world units
    inner_cone_angle: float = 0.0  # rad, half angle, 0 <= inner < outer
    outer_cone_angle: float = float(np.pi / 4)  # rad, half angle, <= pi / 2
    radius: float = 0.0  # world units; 0: a point with hard shadows

    def __post_init__(self) -> None:
        _freeze(self, "color", (3,), np.float64)
        _freeze(self, "position", (3,), np.float64)
        object.__setattr__(self, "direction", conventions.unit(self.direction))
        _freeze(self, "direction", (3,), np.float64)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SunLight:
    """A far disc: a directional light with an angular diameter, so soft shadow edges."""

    name: str
    direction: F64  # (3,) unit, the way the light travels (from the disc's centre)
    color: F64 = field(default_factory=lambda: np.ones(3))  # (3,) linear
    intensity: float = 1.0  # lux on a surface facing the disc's centre
    angular_diameter: float = 0.53  # degrees, > 0

    def __post_init__(self) -> None:
        _freeze(self, "color", (3,), np.float64)
        object.__setattr__(self, "direction", conventions.unit(self.direction))
        _freeze(self, "direction", (3,), np.float64)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AreaLight:
    """A glowing rectangle, disk or sphere, seen by light only (it is not part of the proxy and blocks nothing)."""

    name: str
    shape: Literal["rectangle", "disk", "sphere"]
    world_from_light: F64  # (4, 4) rigid; a rectangle or disk lies in its XY plane and shines along its -Z
    size: tuple[float, float]  # world units: rectangle width and height; disk and sphere: diameter, twice
    color: F64 = field(default_factory=lambda: np.ones(3))  # (3,) linear
    intensity: float = 1.0  # candela per square metre (radiance), the same in every direction it shines

    def __post_init__(self) -> None:
        _freeze(self, "color", (3,), np.float64)
        _freeze(self, "world_from_light", (4, 4), np.float64)


Light: TypeAlias = DirectionalLight | PointLight | SpotLight | SunLight | AreaLight


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Environment:
    """Light from all around: an equirectangular map or one constant radiance (a 1 x 1 map)."""

    name: str = "environment"
    radiance: F32  # (h, w, 3) linear; row 0 is +Y; conventions.py says which way the columns look
    intensity: float = 1.0  # multiplies the radiance
    rotation: float = 0.0  # degrees about +Y, counter-clockwise seen from above

    def __post_init__(self) -> None:
        _freeze(self, "radiance", (None, None, 3))

    @property
    def is_constant(self) -> bool:
        """True where the radiance is the same in every direction."""
        return self.radiance.shape[:2] == (1, 1)


@dataclass(frozen=True, slots=True, kw_only=True)
class Lighting:
    """A named set of lights: what one frame is lit by. Light names are unique in it."""

    name: str = "lighting"
    lights: tuple[Light, ...] = ()
    environment: Environment | None = None

    @property
    def layer_names(self) -> tuple[str, ...]:
        """One name per layer: the lights in order, then the environment."""
        return tuple(x.name for x in self.lights) + ((self.environment.name,) if self.environment else ())


# --- scene -----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SplatCloud:
    """Gaussian splats in world space, activated (no logs or logits). N splats, K = (SH degree + 1)^2."""

    means: F32  # (N, 3) world units
    quats: F32  # (N, 4) wxyz, unit
    scales: F32  # (N, 3) linear standard deviations, world units
    opacities: F32  # (N,) 0..1
    sh: F32  # (N, K, 3) coefficients of display-encoded colour; colour = 0.5 + sum sh Y
    dropped: int = 0  # splats removed on reading because a value was NaN or infinite
    antialiased: bool = False  # trained with opacity compensation (SPZ flag, Mip-Splatting)

    def __post_init__(self) -> None:
        n = len(self.means)
        _freeze(self, "means", (n, 3))
        _freeze(self, "quats", (n, 4))
        _freeze(self, "scales", (n, 3))
        _freeze(self, "opacities", (n,))
        _freeze(self, "sh", (n, None, 3))
        if self.sh.shape[1] not in (1, 4, 9, 16):
            raise ValueError(f"SplatCloud.sh: {self.sh.shape[1]} coefficients, expected 1, 4, 9 or 16")

    def __len__(self) -> int:
        return len(self.means)

    @property
    def sh_degree(self) -> int:
        """0 to 3."""
        return round(float(self.sh.shape[1] ** 0.5)) - 1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Material:
    """What a proxy's own file says of its surface; used where the albedo comes from the file."""

    name: str = "default"
    base_color: F64 = field(default_factory=lambda: np.ones(3))  # (3,) linear factor
    base_color_texture: F32 | None = None  # (h, w, 3) linear, row 0 at v = 0 (glTF: top), repeat wrap
    emissive: F64 = field(default_factory=lambda: np.zeros(3))  # (3,) linear radiance, strength multiplied in

    def __post_init__(self) -> None:
        _freeze(self, "base_color", (3,), np.float64)
        _freeze(self, "base_color_texture", (None, None, 3))
        _freeze(self, "emissive", (3,), np.float64)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ProxyMesh:
    """The triangle mesh that stands for the captured scene, in world space. Lit from both sides."""

    vertices: F32  # (V, 3) world units
    faces: I32  # (F, 3) indices into vertices
    normals: F32 | None = None  # (V, 3) unit shading normals; None: flat
    uvs: F32 | None = None  # (V, 2) glTF: v = 0 is the texture's top row
    vertex_colors: F32 | None = None  # (V, 3) linear
    face_materials: I32 | None = None  # (F,) index into materials; None: all 0
    materials: tuple[Material, ...] = (Material(),)
    albedo: F64 | None = field(default_factory=lambda: np.full(3, 0.5))  # (3,) linear; None: the file's own colours

    def __post_init__(self) -> None:
        v = len(self.vertices)
        _freeze(self, "vertices", (v, 3))
        _freeze(self, "faces", (None, 3), np.int32)
        for name, width in (("normals", 3), ("uvs", 2), ("vertex_colors", 3)):
            _freeze(self, name, (v, width))
        _freeze(self, "face_materials", (len(self.faces),), np.int32)
        _freeze(self, "albedo", (3,), np.float64)
        if len(self.faces) and not (int(self.faces.min()) >= 0 and int(self.faces.max()) < v):
            raise ValueError(f"ProxyMesh.faces: an index outside 0..{v - 1}")

    @property
    def bounds(self) -> tuple[F32, F32]:
        """Lowest and highest corner, (3,) each."""
        return self.vertices.min(axis=0), self.vertices.max(axis=0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Scene:
    """What is rendered. Every camera is rendered under every lighting."""

    splats: SplatCloud | None = None
    proxy: ProxyMesh | None = None
    cameras: tuple[Camera, ...] = ()
    lightings: tuple[Lighting, ...] = ()
    captured: Lighting | None = None  # the lighting under which the splats were captured, where known


# --- settings --------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class RenderSettings:
    """How the lighting is traced."""

    spp: int = 64  # samples per pixel
    noise: float | None = None  # relative error target; None: exactly spp samples
    max_depth: int = 8  # vertices of a path from the eye's first hit on; 1: direct light only
    seed: int = 0
    variant: Variant = "llvm_ad_rgb"
    denoise: bool = False
    threads: int | None = None  # None: every core


@dataclass(frozen=True, slots=True, kw_only=True)
class CompositorSettings:
    """How splats become pixels. The playcanvas-only fields are ignored by the physical profile."""

    profile: Profile = "physical"
    sort: Literal["depth", "radial"] = "depth"  # view-space z, or distance to the eye
    work_buffer: Literal["compact", "large"] = "compact"  # playcanvas: GSPLATDATA_COMPACT (its default) or _LARGE
    min_pixel_size: float = 2.0  # playcanvas: smaller splats are dropped (its doubled pixels)
    alpha_clip: float = 1.0 / 255.0  # fragments below are dropped
    tone: ToneCurve = "none"  # playcanvas, gamma pipeline: tone curve per splat
    exposure: float = 1.0  # playcanvas: linear factor before that curve
    linear: bool = False  # playcanvas: 'linear' pipeline (colours decoded by a 2.2 power before blending)
    eight_bit: bool = False  # playcanvas: round after every blended splat, as its RGBA8 target does
    max_memory: int | None = None  # bytes; None: what the machine has free


@dataclass(frozen=True, slots=True, kw_only=True)
class RelightSettings:
    """How lighting meets splats. Defaults are the engine's GsplatRelighting attributes."""

    mode: Literal["tint", "ratio"] = "tint"
    profile: Profile = "physical"
    space: Literal["linear", "display"] = "linear"  # in which the factor multiplies
    blend: float = 1.0  # 0: unlit frame, bit for bit; 1: fully relit
    brightness: float = 2.0  # multiplies the lit proxy (tint)
    background: float = 1.0  # the factor where the proxy does not cover (tint)
    texture_scale: float = 1.0  # lighting pixels per frame pixel along each axis, (0, 1]
    delta: float = 0.01  # ratio: regularisation, share of the captured light's mean luminance
    max_ratio: float = 16.0  # ratio: upper clamp


@dataclass(frozen=True, slots=True, kw_only=True)
class DisplaySettings:
    """How linear light becomes a PNG."""

    exposure: float = 0.0  # stops
    tone: ToneCurve = "none"
    background: tuple[float, float, float] = (0.0, 0.0, 0.0)  # display-encoded, behind the splats


@dataclass(frozen=True, slots=True, kw_only=True)
class OutputSettings:
    """Where and what is written."""

    directory: Path = Path("out")
    exr: bool = True
    png: bool = True
    layers: bool = True  # one EXR part per light
    aovs: bool = True  # depth, position, normals
    half: bool = False  # 16-bit colour (positions and depth stay 32-bit)


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """A job file, loaded: the scene and every setting, validated."""

    source: Path  # the job file, absolute
    scene: Scene
    render: RenderSettings = RenderSettings()
    compositor: CompositorSettings = CompositorSettings()
    relight: RelightSettings = RelightSettings()
    display: DisplaySettings = DisplaySettings()
    output: OutputSettings = OutputSettings()
    inputs: Mapping[str, str] = field(default_factory=dict)  # path as the job names it -> SHA-256 hex


# --- results ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SplatLayer:
    """A composite of splats, before any lighting. `color` is in the space that the splats blend in."""

    camera: Camera
    color: F32  # (H, W, 3) premultiplied; display-encoded, or linear where `linear` is set
    transmittance: F32  # (H, W) what is left of a background, 0..1
    depth: F32  # (H, W) mean over blended splats of the view depth, world units; 0 where nothing is
    median_depth: F32  # (H, W) view depth where transmittance falls to 0.5; 0 where it does not
    profile: Profile = "physical"
    linear: bool = False  # color is linear light (playcanvas 'linear' pipeline)

    def __post_init__(self) -> None:
        h, w = self.camera.height, self.camera.width
        _freeze(self, "color", (h, w, 3))
        for name in ("transmittance", "depth", "median_depth"):
            _freeze(self, name, (h, w))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LightLayer:
    """What one light (or the environment, or emissive surfaces) adds to the lit proxy; premultiplied by coverage."""

    name: str
    direct: F32  # (H, W, 3) linear radiance after one reflection
    indirect: F32  # (H, W, 3) linear radiance after more

    def __post_init__(self) -> None:
        _freeze(self, "direct", (None, None, 3))
        _freeze(self, "indirect", (None, None, 3))

    @property
    def total(self) -> F32:
        """(H, W, 3) direct + indirect."""
        return np.asarray(self.direct + self.indirect, dtype=np.float32)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LightingBuffer:
    """The lit proxy as the splat camera sees it. Colours are premultiplied by coverage; AOVs are averages over the
    covered samples alone (0 where nothing is covered)."""

    camera: Camera
    coverage: F32  # (H, W) antialiased alpha of the proxy, 0..1
    layers: tuple[LightLayer, ...]  # sum of their totals is the beauty
    depth: F32  # (H, W) along the view axis, world units
    position: F32  # (H, W, 3) world units
    normal: F32  # (H, W, 3) shading normal, world, turned to the viewer
    geometric_normal: F32  # (H, W, 3) face normal, world, turned to the viewer
    albedo: F32  # (H, W, 3)
    variance: F32 | None = None  # (H, W, 3) variance of the beauty's mean, where it was estimated
    spp: int = 0  # samples per pixel that went in

    def __post_init__(self) -> None:
        h, w = self.camera.height, self.camera.width
        for name in ("coverage", "depth"):
            _freeze(self, name, (h, w))
        for name in ("position", "normal", "geometric_normal", "albedo", "variance"):
            _freeze(self, name, (h, w, 3))
        for layer in self.layers:
            if layer.direct.shape != (h, w, 3):
                raise ValueError(f"layer {layer.name!r}: shape {layer.direct.shape}, expected {(h, w, 3)}")

    @property
    def beauty(self) -> F32:
        """(H, W, 3) sum of all layers, premultiplied by coverage."""
        out = np.zeros((self.camera.height, self.camera.width, 3), dtype=np.float32)
        for layer in self.layers:
            out += layer.direct
            out += layer.indirect
        return out


@dataclass(frozen=True, slots=True, kw_only=True)
class Provenance:
    """What made an output; written into every file."""

    mirelight: str  # version
    versions: Mapping[str, str] = field(default_factory=dict)  # mitsuba, drjit, llvm, numpy, …
    job: str = ""  # the job file's name
    inputs: Mapping[str, str] = field(default_factory=dict)  # path as the job names it -> SHA-256 hex
    settings: Mapping[str, Any] = field(default_factory=dict)  # every setting that shapes pixels, JSON values
    lighting: str = ""
    fingerprint: str = ""  # SHA-256 over all that decides this frame's pixels; equal: the frame need not be made again


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Frame:
    """A finished frame: linear and premultiplied; alpha is 1 - transmittance, or coverage where there are no splats."""

    camera: Camera
    rgba: F32  # (H, W, 4) relit, linear Rec.709
    unlit: F32 | None  # (H, W, 4) the splats as captured, linear; None without splats
    factor: F32 | None  # (H, W, 3) what the splats were multiplied by, in its own space; None without splats
    lighting: LightingBuffer | None
    splats: SplatLayer | None
    made_by: Provenance | None = None

    def __post_init__(self) -> None:
        h, w = self.camera.height, self.camera.width
        _freeze(self, "rgba", (h, w, 4))
        _freeze(self, "unlit", (h, w, 4))
        _freeze(self, "factor", (h, w, 3))
