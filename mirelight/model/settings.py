"""Every setting, one type per stage."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal, TypeAlias

from mirelight.base.backend import Variant
from mirelight.base.colour import ToneCurve
from mirelight.base.layouts import Layout
from mirelight.base.primaries import ColorSpace
from mirelight.model.arrays import F32
from mirelight.model.cameras import Camera
from mirelight.model.deferred import Deferred
from mirelight.model.dressing import Dress, Mask
from mirelight.model.inserted import Inserted, moves, standing
from mirelight.model.lights import Lighting
from mirelight.model.planes import AOVS, EXACT, NAMEABLE
from mirelight.model.profiles import Profile, rules_of
from mirelight.model.recipe import OwnSplats, ProxyRecipe
from mirelight.model.relight_settings import RelightSettings
from mirelight.model.scene import ProxyMesh, SplatCloud, SplatColorSpace, SplatFile, holds_light

Indirect: TypeAlias = Literal["auto", "traced", "surface"]
Sort: TypeAlias = Literal["depth", "radial"]
Compression: TypeAlias = Literal["zip", "dwaa", "none"]
HeldOut: TypeAlias = Literal["camera", "lighting", "both"]
HdrFormat: TypeAlias = Literal["111110F", "RGBA16F", "RGBA32F"]  # pixels as the real-time engine names them


@dataclass(frozen=True, slots=True, kw_only=True)
class RenderSettings:
    """How the lighting is traced."""

    profile: Profile = "physical"  # playcanvas: the engine's light model at the pixels' centres, without noise
    spp: int = 64  # samples per pixel; under a noise target at least
    noise: float | None = None  # relative error to reach over the frame; None: exactly spp samples everywhere
    max_depth: int = 8  # vertices of a path from the eye's first hit on; 1: direct light only
    indirect: Indirect = "auto"  # surface: read at a path's first hit; auto: so in rooms
    seed: int = 0
    variant: Variant = "llvm_ad_rgb"
    denoise: bool = False
    threads: int | None = None  # None: every core
    max_memory: int | None = None  # bytes of a film, and of light on the surface; None: what the machine has free
    lens_samples: int = 32  # pinholes whose mean is a frame through a lens or an open shutter; they share `spp`
    ao_distance: float | None = None  # world units that ambient occlusion looks; None: a tenth of the proxy's diagonal


@dataclass(frozen=True, slots=True, kw_only=True)
class CompositorSettings:
    """How splats become pixels. The playcanvas-only fields are ignored by the physical profile."""

    profile: Profile = "physical"
    sort: Sort = "depth"  # view-space z, or distance to the eye
    work_buffer: Literal["compact", "large"] = "compact"  # playcanvas: GSPLATDATA_COMPACT (its default) or _LARGE
    min_pixel_size: float = 2.0  # playcanvas: smaller splats are dropped (its doubled pixels)
    alpha_clip: float = 1.0 / 255.0  # fragments below are dropped
    cutoff: float | None = None  # physical: fragments so many standard deviations from their splat's middle are dropped
    color_space: SplatColorSpace = "srgb_rec709_display"  # physical: the splats', which they blend in
    tone: ToneCurve = "none"  # playcanvas, gamma pipeline: tone curve per splat
    exposure: float = 1.0  # playcanvas: linear factor before that curve
    linear: bool = False  # playcanvas: 'linear' pipeline (colours decoded by a 2.2 power before blending)
    eight_bit: bool = False  # playcanvas: round after every blended splat, as its RGBA8 target does
    supersampling: int = 1  # physical: along each axis; a pixel is the mean of so many by so many
    max_memory: int | None = None  # bytes; None: what the machine has free

    @property
    def samples(self) -> int:
        """Along each axis of a pixel."""
        return 1 if rules_of(self.profile).splats.pipelines else self.supersampling

    @property
    def blends_linear(self) -> bool:
        """Whether splats blend in linear light: the engine's linear pipeline alone."""
        return self.linear and rules_of(self.profile).splats.pipelines

    @property
    def holds_light(self) -> bool:
        """Whether composites hold linear light, as splats that blend in it make them."""
        return self.blends_linear or (not rules_of(self.profile).splats.pipelines and holds_light(self.color_space))

    @property
    def tones_splats(self) -> bool:
        """Whether splats pass a tone curve before they are blended: only the engine's gamma pipeline does that."""
        return rules_of(self.profile).splats.pipelines and not self.linear and self.tone != "none"

    @property
    def rounds(self) -> bool:
        """Whether the blended colour is rounded to 8 bits after every splat."""
        return self.eight_bit and rules_of(self.profile).splats.pipelines


@dataclass(frozen=True, slots=True, kw_only=True)
class DisplayView:
    """A view of OpenColorIO, found in its config."""

    config: str  # "ocio://…", or a file
    display: str  # as the config calls it
    view: str
    identity: str  # OpenColorIO's digest of what the transform computes

    @property
    def config_name(self) -> str:
        """The config without its place: a built-in one, or a file's name."""
        return self.config if self.config.startswith("ocio://") else Path(self.config).name


@dataclass(frozen=True, slots=True, kw_only=True)
class Ground:
    """A floor that the lower half of a panorama is laid on, below a dome that takes the rest."""

    center: tuple[float, float, float] = (
        0.0,
        0.0,
        0.0,
    )  # of the floor, below where the panorama was taken
    height: float = 1.6  # that it was taken at above the floor, world units
    radius: float = 30.0  # of the dome, world units; larger than the height


@dataclass(frozen=True, slots=True, kw_only=True)
class Backdrop:
    """Light behind the splats: what a lighting has all around, or a picture."""

    picture: str | None = None  # a file; None: environment, sky and suns of the frame's lighting
    identity: str = ""  # SHA-256 of that file
    exposure: float = 0.0  # stops, beside that of the whole picture
    blur: float = 0.0  # degrees, standard deviation; of surroundings alone
    ground: Ground | None = None  # of surroundings alone; None: all lies far away


@dataclass(frozen=True, slots=True, kw_only=True)
class DisplaySettings:
    """How linear light becomes a PNG."""

    exposure: float = 0.0  # stops
    tone: ToneCurve = "none"
    view: DisplayView | None = None  # in place of the tone curve and the profile's transfer curve
    background: tuple[float, float, float] = (0.0, 0.0, 0.0)  # display-encoded, behind the splats
    transparent: bool = False  # nothing behind the splats: the PNG has straight alpha
    backdrop: Backdrop | None = None  # light in place of that colour, in the EXR too


@dataclass(frozen=True, slots=True, kw_only=True)
class OutputSettings:
    """Where and what is written."""

    directory: Path = Path("out")
    # frames: traced light is not kept, so a changed light is traced anew; layers: no frames, `mirelight.dataset` mixes
    store: Literal["both", "frames", "layers"] = "both"
    exr: bool = True
    png: bool = True
    layers: bool = True  # direct and indirect of each light or group, and `lighting`, which is their sum
    aovs: bool | tuple[str, ...] = True  # of `planes.NAMEABLE`; True: all AOVS that the compression allows, False: none
    half: bool = False  # 16-bit colour (positions and depth stay 32-bit)
    color_space: ColorSpace = "lin_rec709"  # of the EXR's colours; data stay as they are
    compression: Compression = "zip"  # of the EXR; dwaa is lossy and holds none of `planes.EXACT`

    def __post_init__(self) -> None:
        unknown = [] if isinstance(self.aovs, bool) else [name for name in self.aovs if name not in NAMEABLE]
        if unknown:
            raise ValueError(f"OutputSettings.aovs: no layer {unknown[0]!r}; there are: {', '.join(NAMEABLE)}")

    @property
    def wants_layers(self) -> bool:
        """Whether the EXR holds a layer for each light."""
        return self.exr and self.layers

    def wants(self, *names: str) -> bool:
        """Whether the EXR holds any of these rows of `planes.PLANES`, so that they have to be made."""
        if not self.exr:
            return False
        if self.layers and "lighting" in names:
            return True
        wanted = AOVS if self.aovs is True else self.aovs or ()
        lost = EXACT if self.compression == "dwaa" else ()
        return any(name in wanted and name not in lost for name in names)


@dataclass(frozen=True, slots=True, kw_only=True)
class DatasetSettings:
    """How frames are written as data sets."""

    layouts: tuple[Layout, ...] = ()  # written when all frames are there
    normalize: bool = False  # move and scale the world so that the surface fits a box of ±1
    split: HeldOut = "camera"  # what is held out
    held_out: float = 0.1  # share of the names, 0 to 1
    seed: int = 0  # of the choice
    license: str = ""  # of the data set, as SPDX has it
    hdr: bool = True  # linear pictures, too, where the layout's loaders take them


@dataclass(frozen=True, slots=True, kw_only=True)
class EngineSettings:
    """What `mirelight realtime` sets in the real-time engine, and lights written in its terms count on."""

    clustered: bool = True  # scene.clusteredLightingEnabled; on, cones are narrowed by a hundredth of their angles
    physical_units: bool = False  # scene.physicalUnits: lights have luminance instead of intensity
    hdr_format: HdrFormat | None = None  # of the linear pipeline's target; None: the engine's own choice


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """A job file, loaded: what it says, checked. Files are known by their digests and read when they are needed, so a
    job is small. `mirelight.prepare` makes it ready."""

    source: Path  # the job file, absolute
    splats: Deferred[SplatCloud] | None = None  # in world space
    splat_files: tuple[SplatFile, ...] = ()  # that they come from, in their order; none: they were made otherwise
    own_splats: OwnSplats | None = None  # the same in the axes of their one file; None: those of the world
    proxy: Deferred[ProxyMesh] | None = None  # in world space, with the job's albedo
    made_proxy: ProxyRecipe | None = None  # how `proxy` is made, but for its albedo, where it is made from the splats
    capture_cameras: tuple[Camera, ...] = ()  # of the pictures that the splats were made from, in world space
    capture_pictures: tuple[
        Deferred[F32] | None, ...
    ] = ()  # what those took, (H, W, 4) linear and what counts; or none
    materials: tuple[Dress, ...] = ()  # how parts of the proxy mirror; what they send out is in `proxy` itself
    masks: tuple[Mask, ...] = ()  # where factors are taken from the surface around
    objects: tuple[Inserted, ...] = ()  # that are put into the capture; lightings of a sweep may have theirs elsewhere
    albedo_from_splats: bool = False  # the proxy takes the splats' colours, where the relight mode can use them
    cameras: tuple[Camera, ...] = ()
    lightings: tuple[Lighting, ...] = ()  # every camera is rendered under every one
    pooled: bool = False  # unit lights of all lightings are traced together, as many at once as share paths
    captured: Lighting | None = None  # the lighting under which the splats were captured, where known
    render: RenderSettings = RenderSettings()
    compositor: CompositorSettings = CompositorSettings()
    relight: RelightSettings = field(default_factory=RelightSettings)
    display: DisplaySettings = DisplaySettings()
    output: OutputSettings = OutputSettings()
    dataset: DatasetSettings = DatasetSettings()
    engine: EngineSettings = EngineSettings()
    inputs: Mapping[str, str] = field(default_factory=dict)  # path as the job names it -> SHA-256 hex
    notes: tuple[str, ...] = ()  # what to know about files that were read, a line each; counts for no picture

    def relight_of(self, lighting: Lighting | None) -> RelightSettings:
        """How a lighting meets the splats."""
        return self.relight if lighting is None or lighting.relight is None else lighting.relight

    def objects_of(self, lighting: Lighting, camera: Camera | None = None) -> tuple[Inserted, ...]:
        """What stands in the capture when a lighting is seen: of things that move, where a camera's frame has them;
        None: without their motion."""
        objects = self.objects if lighting.objects is None else lighting.objects
        return objects if camera is None else standing(objects, camera.frame)

    @property
    def has_motion(self) -> bool:
        """Whether something that is put into the capture moves."""
        return any(moves(self.objects_of(x)) for x in self.lightings)

    @property
    def bare(self) -> Job:
        """The same without what is put into the capture."""
        return replace(self, objects=(), lightings=tuple(replace(x, objects=None) for x in self.lightings))

    def __repr__(self) -> str:
        there = [name for name in ("splats", "proxy", "captured") if getattr(self, name) is not None]
        views = f"{len(self.cameras)} cameras x {len(self.lightings)} lightings"
        how = f"{self.render.profile}, {self.relight.mode}"
        return f"Job({self.source.name}: {views}; {', '.join(there) or 'empty'}; {how})"
