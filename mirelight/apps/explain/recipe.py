"""What the rungs of a ladder are made of: what the engine rendered, the settings of its side and of the physical one,
splats as trained or as the engine draws them, and one recipe of a frame."""

from __future__ import annotations

import math
import tempfile
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mirelight import relighting
from mirelight.apps.explain.light import LitSurface
from mirelight.apps.explain.types import CAUSES, Rung
from mirelight.apps.realtime.browser import EngineFrames, render
from mirelight.apps.realtime.captures import HeldSplats, held
from mirelight.base import colour
from mirelight.compositor import Compositor
from mirelight.compositor.engine import HARDWARE_BITS, SOFTWARE_BITS, EngineDrawing, engine_rank
from mirelight.model import (
    F32,
    Camera,
    CompositorSettings,
    DisplaySettings,
    Job,
    Lighting,
    LightingBuffer,
    ProxyMesh,
    RelightSettings,
    SplatCloud,
    SplatLayer,
    ToneCurve,
    rules_of,
)
from mirelight.model.playcanvas_lights import EngineLighting


@dataclass(frozen=True, slots=True, eq=False)
class EngineRun:
    """What the engine rendered of a job: as users see it, and its lighting texture without shadow maps."""

    frames: EngineFrames
    unshadowed: F32  # (h, w, 4)


def run_engine(job: Job, camera: Camera, lighting: Lighting, directory: Path) -> EngineRun:
    """Render with the real engine, twice where its lights cast shadows; the first run stays in `directory`. Inserted
    objects are left out.

    Raises: as :func:`mirelight.apps.realtime.browser.render`.
    """
    job, lighting = job.bare, replace(lighting, objects=None)
    frames = render(job, camera, lighting, directory)
    if not lighting.lights:
        return EngineRun(frames, frames.relight)
    with tempfile.TemporaryDirectory(prefix="mirelight-") as temporary:
        return EngineRun(frames, render(job, camera, lighting, temporary, shadows=False).relight)


def corner_bits(run: EngineRun | None) -> int:
    """Bits of a pixel that the engine's rasteriser keeps of a corner; without a run, those of the software one."""
    renderer = "SwiftShader" if run is None else str(run.frames.meta.get("gl", {}).get("renderer", "SwiftShader"))
    return SOFTWARE_BITS if "SwiftShader" in renderer else HARDWARE_BITS


# --- the two sides of a job ------------------------------------------------------------------------------------------


def _is_engines(job: Job) -> bool:
    """Whether the job's splats go through the engine's pipelines anyway, so that its settings of them count."""
    return rules_of(job.compositor.profile).splats.pipelines


def engine_tone(job: Job) -> tuple[ToneCurve, float]:
    """Tone curve and linear exposure that the engine is given for a job; it has no AgX, and exposes in curves only."""
    if _is_engines(job):
        curve, exposure = job.compositor.tone, job.compositor.exposure
    else:
        curve, exposure = job.display.tone, 2.0**job.display.exposure
    return ("none", 1.0) if curve == "agx" else (curve, exposure)


def engine_compositor(job: Job) -> CompositorSettings:
    """How the engine draws a job's splats, blended in floating point."""
    theirs = job.compositor if _is_engines(job) else CompositorSettings()
    curve, exposure = engine_tone(job)
    return replace(
        theirs,
        profile="playcanvas",
        linear=job.compositor.blends_linear,
        tone=curve,
        exposure=exposure,
        eight_bit=False,
        max_memory=job.compositor.max_memory,
    )


def physical_settings(job: Job) -> RelightSettings:
    """How the last rung is relit: the job's settings by the profile physical, lighting at full size."""
    space = "linear" if rules_of(job.relight.profile).blending_space else job.relight.space
    return replace(job.relight, profile="physical", space=space, texture_scale=1.0)


def physical_display(job: Job) -> DisplaySettings:
    """How the last rung is shown: the job's display, or the engine's curve on the finished frame."""
    if not _is_engines(job):
        return job.display
    exposure = math.log2(job.compositor.exposure) if job.compositor.exposure > 0 else 0.0
    return replace(job.display, tone=job.compositor.tone, exposure=exposure)


# --- a rung ----------------------------------------------------------------------------------------------------------


class SplatPictures:
    """What one camera sees of a cloud, by whatever settings."""

    def __init__(self, job: Job, splats: SplatCloud, camera: Camera) -> None:
        self._job, self._render = job, job.render
        self._radial = job.compositor.sort == "radial" and rules_of(job.compositor.profile).splats.pipelines
        self._splats = splats
        self._camera = camera
        self._made: dict[CompositorSettings, SplatLayer] = {}

    def composite(self, settings: CompositorSettings) -> SplatLayer:
        """The cloud in exact order."""
        if settings not in self._made:
            self._made[settings] = self._exposed(self._splats, settings, None)
        return self._made[settings]

    def drawn(
        self, settings: CompositorSettings, *, bucketed: bool = True, corner_bits: int | None = None
    ) -> SplatLayer:
        """The cloud from the engine's textures.

        Args:
            settings: of the profile playcanvas.
            bucketed: sorted as the engine sorts, else exactly.
            corner_bits: of the sub-pixels that corners are snapped to; None: they are not.
        """
        drawing = EngineDrawing(self._rank if bucketed else None, corner_bits)
        return self._exposed(self._held.textures, settings, drawing)

    @cached_property
    def _held(self) -> HeldSplats:
        return held(self._job, self._splats)

    @cached_property
    def _rank(self) -> NDArray[np.uint32]:
        return engine_rank(self._splats, self._camera, radial=self._radial, loaded=self._held.loaded)

    def _exposed(self, splats: SplatCloud, settings: CompositorSettings, drawing: EngineDrawing | None) -> SplatLayer:
        """A composite. A bare exposure of the engine is applied here: the compositor has it within curves only."""
        compositor = Compositor(splats, settings, variant=self._render.variant, threads=self._render.threads)
        layer = compositor.composite(self._camera, depth=False, drawing=drawing)
        exposes = rules_of(settings.profile).splats.pipelines and settings.exposure != 1
        if not exposes or settings.linear or settings.tone != "none":
            return layer
        gain = np.float32(settings.exposure ** (1 / colour.ENGINE_GAMMA))
        return replace(layer, color=layer.color * gain)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Subject:
    """The frame that is explained."""

    job: Job
    splats: SplatPictures
    proxy: ProxyMesh
    camera: Camera
    given: Lighting  # as the job has it
    lighting: Lighting  # its sky model turned into a sun and a map
    lights: EngineLighting  # the same as the engine has it
    engine: EngineRun | None  # None: mirelight's prediction stands for it


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Recipe:
    """Everything that decides a modelled frame; a rung replaces one part."""

    splats: SplatLayer
    light: LightingBuffer
    settings: RelightSettings
    display: DisplaySettings
    engine_blending: bool = True  # linear pipeline: tone curve and encoding follow the blending over the background
    captured: LightingBuffer | None = None
    captured_level: float | None = None
    far: relighting.Far | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PointLight:
    """A surface and the light on it, one sample a pixel; lamps and surroundings apart, as they change apart."""

    surface: LitSurface
    lamps: F32  # (H, W, 3) radiance, linear
    sky: F32  # (H, W, 3)

    @property
    def total(self) -> F32:
        """All light: of the lamps and of the sky (H, W, 3)."""
        return self.lamps + self.sky

    @property
    def buffer(self) -> LightingBuffer:
        """The total, as a frame is relit by it."""
        return self.surface.buffer(self.total)


@dataclass(eq=False)
class Rungs:
    """The rungs of a ladder as they are made, and the causes that the job has not."""

    job: Job
    frames: list[Rung] = field(default_factory=list)
    absent: list[tuple[str, str]] = field(default_factory=list)

    def add(self, name: str, recipe: Recipe) -> Recipe:
        """The frame of a recipe, under the name of the cause that it takes away; the recipe."""
        self.append(name, self.shown(recipe))
        return recipe

    def append(self, name: str, frame: F32) -> None:
        """A frame (H, W, 3) of display values."""
        self.frames.append(Rung(name, CAUSES[name].title, CAUSES[name].change, frame))

    def skip(self, why: str, *names: str) -> None:
        """Causes that there are not."""
        self.absent += [(name, why) for name in names]

    def shown(self, recipe: Recipe) -> F32:
        """(H, W, 3) display values 0..1 of a recipe."""
        frame = relighting.apply(
            recipe.splats,
            recipe.light,
            recipe.settings,
            captured=recipe.captured,
            captured_level=recipe.captured_level,
            far=recipe.far,
            noise=False,
        )
        rgb, alpha, display = frame.rgba[..., :3], frame.rgba[..., 3], recipe.display
        tone, gain, whole = display.tone, 2.0**display.exposure, recipe.engine_blending and recipe.splats.linear
        if whole:
            tone, gain = engine_tone(self.job)
        transfer = rules_of(frame.profile).transfer
        behind = colour.decode(display.background, transfer) if whole else None
        return colour.shown(rgb, alpha, transfer, gain=gain, tone=tone, background=display.background, behind=behind)


def as_float(values: object) -> F32:
    """An array of any shape in the type of pictures."""
    return np.asarray(values, dtype=np.float32)
