"""Building the ladder: the engine's frame, then one setting of the renderer after another turned physical."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from mirelight import colour, relighting
from mirelight.compare import metrics
from mirelight.compare.explain import CAUSES, Ladder, Rung
from mirelight.compare.explain_engine import (
    EngineRun,
    corner_bits,
    engine_compositor,
    engine_tone,
    physical_display,
    physical_settings,
)
from mirelight.compare.explain_light import LitSurface, shadows, texture
from mirelight.compare.explain_splats import SplatPictures
from mirelight.engine_lights import NORMAL_OFFSET_BIAS, EngineLighting, to_engine
from mirelight.errors import InputError, RenderError
from mirelight.lighting.engine.raster import rasterise
from mirelight.lighting.layers import Layers
from mirelight.lighting.sunsky import resolved
from mirelight.lighting.visibility import ShadowRays
from mirelight.model import (
    F32,
    Camera,
    DisplaySettings,
    Job,
    Lighting,
    LightingBuffer,
    ProxyMesh,
    RelightSettings,
    SplatCloud,
    SplatLayer,
)
from mirelight.realtime.engine import VERSION
from mirelight.scene import Scene, prepare
from mirelight.stages import Lit, light

Say = Callable[[str], None]
_ANOTHER_SEED = 0x5EED  # added to the job's, for samples that are independent of its own


def explain(
    job: Job, camera: Camera, lighting: Lighting, engine: EngineRun | None = None, say: Say = lambda line: None
) -> Ladder:
    """The ladder of one frame.

    The first rung is the engine's frame, the last what `mirelight render` shows of the job in the profile physical
    with a lighting texture of full size, in floating point.

    Args:
        job: scene and settings.
        camera: perspective.
        lighting: physical units.
        engine: from :func:`run_engine`; None: mirelight's own prediction of the engine, with ideal shadow maps.
        say: is told what is being made.

    Raises:
        InputError: there are no splats or no proxy, an orthographic camera, or the variant `scalar_rgb`.
        MirelightError: a package of the extra `compare` is missing; said before any work.
        RenderError: the engine's texture has an unexpected size.
        BackendError: the variant cannot be used on this machine.
    """
    metrics.require(flip_alone=True)
    splats, proxy = require(job, camera)
    plain = resolved(lighting, job.render.variant)
    return _Builder(job, SplatPictures(job, splats, camera), proxy, camera, lighting, plain, engine, say).build()


def require(job: Job, camera: Camera) -> tuple[SplatCloud, ProxyMesh]:
    """The job's splats and proxy.

    Raises:
        InputError: a ladder of this job and camera cannot be made; see :func:`explain`.
    """
    splats, proxy = job.splats, job.proxy
    if splats is None or proxy is None:
        missing = "splats" if splats is None else "proxy"
        raise InputError(job.source, f"no {missing}", "a ladder needs splats, a proxy and light", field=missing)
    if not len(proxy.value.faces):
        raise InputError(job.source, "a proxy without a face", "a ladder needs something to light", field="proxy")
    if camera.projection != "perspective":
        raise InputError(
            job.source, f"camera {camera.name} is orthographic", "the engine relights perspective cameras only"
        )
    if job.render.variant == "scalar_rgb":
        raise InputError(job.source, "the variant scalar_rgb", "use llvm_ad_rgb or cuda_ad_rgb", field="render.variant")
    if relighting.mode_of(job.relight).needs_captured and job.captured is None:
        without = f"mode {job.relight.mode!r} without captured lighting"
        raise InputError(job.source, without, "name it, or set mode to 'tint'")
    return splats.value, proxy.value


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Recipe:
    """Everything that decides a modelled frame; a rung replaces one part."""

    splats: SplatLayer
    light: LightingBuffer
    settings: RelightSettings
    display: DisplaySettings
    engine_blending: bool = True  # linear pipeline: tone curve and encoding follow the blending over the background
    captured: LightingBuffer | None = None
    captured_level: float | None = None


@dataclass(eq=False)
class _Builder:
    job: Job
    splats: SplatPictures
    proxy: ProxyMesh
    camera: Camera
    given: Lighting  # as the job has it
    lighting: Lighting  # its sky model turned into a sun and a map
    engine: EngineRun | None
    say: Say
    rungs: list[Rung] = field(default_factory=list)
    absent: list[tuple[str, str]] = field(default_factory=list)

    def build(self) -> Ladder:
        self.say("real-time frame")
        lights, warnings = to_engine(self.lighting, self.proxy)
        recipe = self._engine_side(lights)
        self.say("lighting")
        recipe = self._punctual(recipe, lights)
        untraced, parts = len(self.rungs), self.parts
        self._physical_side(recipe, self.job.render.seed)
        self.say("noise")
        again = replace(self, rungs=[], absent=[])  # the same once more with independent samples
        again.full, again.parts = self.full, parts
        again._physical_side(recipe, self.job.render.seed + _ANOTHER_SEED)
        traced = (replace(x, again=y.frame) for x, y in zip(self.rungs[untraced:], again.rungs, strict=True))
        really = self.engine is not None
        return Ladder(
            name=f"{self.camera.name}.{self.lighting.name}",
            rungs=(*self.rungs[:untraced], *traced),
            absent=tuple(self.absent),
            engine=f"PlayCanvas {VERSION}" if really else f"mirelight's prediction of PlayCanvas {VERSION}",
            really_rendered=really,
            warnings=self.engine.frames.warnings if self.engine is not None else warnings,
        )

    def _physical_side(self, recipe: _Recipe, seed: int) -> None:
        """From points and one sample a pixel to the physical frame, by paths of that seed."""
        self.say("tracing")
        recipe = self._traced(recipe, self._light(seed, replace(self.job.relight, mode="tint"))[1].new)
        self.say("splats")
        recipe = self._splat_side(recipe)
        self._relight_mode(recipe, seed)

    def _light(self, seed: int, settings: RelightSettings) -> tuple[Scene, Lit]:
        """The light that `mirelight render` has in the profile physical, at the frame's own resolution."""
        render = replace(self.job.render, profile="physical", seed=seed)
        scene = prepare(replace(self.job, render=render, relight=replace(settings, texture_scale=1.0)))
        return scene, light(scene, self.camera, self.given)

    # --- from the engine's frame to mirelight's model of it ---

    def _engine_side(self, lights: EngineLighting) -> _Recipe:
        job = self.job
        self.small = self._lit_surface(relighting.lighting_camera(self.camera, self._settings), biased=True)
        sky = self.small.engine_environment(lights)
        self.parts = (self.small.engine_lights(lights, "exact"), sky)
        exact = self.small.buffer(self.parts[0] + sky)
        biased = self.small.buffer(self.small.engine_lights(lights, "biased") + sky)
        bits = corner_bits(self.engine)
        drawn = self.splats.drawn(engine_compositor(job), corner_bits=bits)
        recipe = _Recipe(
            splats=drawn,
            light=biased if self.engine is None else self._engine_texture(self.engine, lights),
            settings=self._settings,
            display=DisplaySettings(background=job.display.background),
        )
        title = "Real-time frame"
        if self.engine is None:
            rough = replace(engine_compositor(job), eight_bit=not recipe.splats.linear)
            eight = (
                np.rint(
                    self._shown(replace(recipe, splats=self.splats.drawn(rough, corner_bits=bits))) * np.float32(255)
                )
                / 255
            )
            self.rungs.append(Rung("engine", title, "mirelight's prediction: the engine did not run.", _f32(eight)))
            self._add("float", recipe)
            self.absent.append(("model", "the engine did not run"))
        else:
            frames = self.engine.frames
            self.rungs.append(
                Rung("engine", title, f"Rendered by PlayCanvas {VERSION}.", _f32(frames.frame[..., :3] / 255))
            )
            shown = frames.frame_f32[..., :3]
            if recipe.splats.linear:
                shown = self._engine_tone(shown)
            self._append("float", _f32(np.clip(np.nan_to_num(shown, nan=0.0), 0, 1)))
            self._add("model", recipe)
        recipe = replace(recipe, splats=self.splats.drawn(engine_compositor(job)))
        self._add("corners", recipe)
        recipe = replace(recipe, splats=self.splats.drawn(engine_compositor(job), bucketed=False))
        self._add("order", recipe)
        if engine_compositor(job).work_buffer == "compact":
            recipe = replace(recipe, splats=self.splats.composite(replace(engine_compositor(job), work_buffer="large")))
            self._add("buffer", recipe)
        else:
            self.absent.append(("buffer", "the job asks for half floats"))
            recipe = replace(recipe, splats=self.splats.composite(engine_compositor(job)))
        if not lights.lights:
            self.absent += [("shadows", "no light casts any"), ("bias", "no light casts any")]
            return recipe
        if self.engine is not None:
            recipe = replace(recipe, light=biased)
            self._add("shadows", recipe)
        else:
            self.absent.append(("shadows", "the engine did not run, and its shadow maps are not modelled"))
        recipe = replace(recipe, light=exact)
        self._add("bias", recipe)
        return recipe

    def _engine_texture(self, run: EngineRun, lights: EngineLighting) -> LightingBuffer:
        """The engine's texture, less what the model of its light without shadows misses."""
        expected = self.small.albedo.shape[:2]
        if run.frames.relight.shape[:2] != expected:
            raise RenderError(f"the engine's lighting texture is {run.frames.relight.shape[:2]}, expected {expected}")
        predicted = self.small.engine_lights(lights, "none") + self.parts[1]
        real, without = run.frames.relight, run.unshadowed
        known = (real[..., 3] > 0.5) & (without[..., 3] > 0.5) & self.small.surface.coverage
        corrected = np.maximum(real[..., :3] + predicted - without[..., :3], 0)
        return texture(
            self.small.camera,
            np.where(known[..., None], corrected, real[..., :3]),
            (real[..., 3] > 0.5).astype(np.float32),
        )

    # --- light ---

    def _punctual(self, recipe: _Recipe, lights: EngineLighting) -> _Recipe:
        """Causes that one light sample a pixel shows: texture scale, falloffs, prefiltering."""
        settings = replace(self._settings, texture_scale=1.0)
        self.full = self.small
        if self.small.camera is not self.camera:
            self.full = self._lit_surface(self.camera)
            self.parts = (self.full.engine_lights(lights, "exact"), self.full.engine_environment(lights))
            recipe = replace(recipe, light=self._sum(), settings=settings)
            self._add("scale", recipe)
        else:
            self.absent.append(("scale", "the lighting texture is as large as the frame"))
        if self.lighting.lights:
            self.parts = (self.full.lights(self.lighting.lights), self.parts[1])
            recipe = replace(recipe, light=self._sum())
            self._add("units", recipe)
        else:
            self.absent.append(("units", "there are no lights but the environment"))
        if self.lighting.environment is not None:
            self.parts = (self.parts[0], self.full.environment(self.lighting.environment))
            recipe = replace(recipe, light=self._sum())
            self._add("prefilter", recipe)
        else:
            self.absent += [("prefilter", "there is no environment"), ("occlusion", "there is no environment")]
        return recipe

    def _traced(self, recipe: _Recipe, traced: LightingBuffer) -> _Recipe:
        """Causes that only paths show: blocked sky, light sizes, indirect light, covered shares of pixels."""
        layers = Layers.of(self.lighting, emissive=False)
        direct = [x.direct for x in traced.layers]
        if self.lighting.environment is not None:
            self.parts = (self.parts[0], self._own(direct[layers.environment], traced, self.parts[1]))
            recipe = replace(recipe, light=self._sum())
            self._add("occlusion", recipe)
        if self.lighting.lights:
            lamps = np.unique(layers.of_light[: len(self.lighting.lights)])
            lit = np.asarray(np.sum([direct[k] for k in lamps], axis=0), dtype=np.float32)
            self.parts = (self._own(lit, traced, self.parts[0]), self.parts[1])
            recipe = replace(recipe, light=self._sum())
            self._add("size", recipe)
        else:
            self.absent.append(("size", "there are no lights but the environment"))
        everything = self._own(traced.beauty, traced, self.parts[0] + self.parts[1])
        recipe = replace(recipe, light=self.full.buffer(everything))
        self._add("indirect", recipe)
        recipe = replace(recipe, light=traced, settings=replace(recipe.settings, profile="physical"))
        self._add("coverage", recipe)
        return recipe

    def _sum(self) -> LightingBuffer:
        return self.full.buffer(self.parts[0] + self.parts[1])

    def _own(self, premultiplied: F32, traced: LightingBuffer, otherwise: F32) -> F32:
        """The light of the covered part of each pixel; `otherwise` where no path met the proxy."""
        cover = traced.coverage[..., None]
        return np.where(cover > 0, premultiplied / np.where(cover > 0, cover, 1), otherwise).astype(np.float32)

    def _lit_surface(self, camera: Camera, *, biased: bool = False) -> LitSurface:
        render = self.job.render
        surface = rasterise(self.proxy, camera, variant=render.variant, threads=render.threads)
        rays = ShadowRays(self.proxy, render.variant, render.threads)
        if self.proxy.albedo is not None:
            albedo = np.broadcast_to(self.proxy.albedo, (*surface.coverage.shape, 3)).astype(np.float32)
        else:
            hit = surface.coverage
            albedo = np.zeros((*hit.shape, 3), dtype=np.float32)
            albedo[hit] = rays.albedo(surface.face[hit], surface.position[hit].astype(np.float64))
        exact = shadows(rays, surface, camera, self.lighting)
        moved = shadows(rays, surface, camera, self.lighting, NORMAL_OFFSET_BIAS) if biased else ()
        return LitSurface(camera, surface, albedo, exact, moved)

    # --- splats and colour ---

    def _splat_side(self, recipe: _Recipe) -> _Recipe:
        job = self.job
        curve, _ = engine_tone(job)
        per_splat = replace(engine_compositor(job), work_buffer="large")
        space = physical_settings(job).space
        if per_splat.linear:
            per_splat = replace(per_splat, linear=False, tone="none", exposure=1.0)
            recipe = replace(
                recipe,
                splats=replace(self.splats.composite(per_splat), profile="physical"),
                settings=replace(recipe.settings, space=space),
                display=physical_display(job),
                engine_blending=False,
            )
            self._add("blending", recipe)
            self.absent.append(("tint", "the linear pipeline tints in linear light"))
        else:
            self.absent.append(("blending", "the gamma pipeline blends display values"))
            recipe = replace(
                recipe,
                splats=replace(recipe.splats, profile="physical"),
                settings=replace(recipe.settings, space=space),
                engine_blending=False,
            )
            if space == "linear":
                self._add("tint", recipe)
            else:
                self.absent.append(("tint", "the job asks for display space"))
        if not per_splat.linear and recipe.display != physical_display(job):
            per_splat = replace(per_splat, tone="none", exposure=1.0)
            plain = replace(self.splats.composite(per_splat), profile="physical")
            recipe = replace(recipe, splats=plain, display=physical_display(job))
            self._add("tone", recipe)
        else:
            where = "tone maps the finished frame too" if curve != "none" else "and the job have no tone curve"
            self.absent.append(("tone", f"the engine {where}"))
        recipe = replace(recipe, splats=self.splats.composite(replace(job.compositor, profile="physical")))
        self._add("kernel", recipe)
        return recipe

    def _relight_mode(self, recipe: _Recipe, seed: int) -> None:
        """The job's own mode instead of the tint, where it is one that divides the captured light out."""
        mode = relighting.mode_of(self.job.relight)
        if not mode.needs_captured:
            self.absent.append(("ratio", f"the job's mode is {mode.name}"))
            return
        scene, lit = self._light(seed, self.job.relight)
        settings, level = replace(recipe.settings, mode=mode.name), scene.captured_level
        self._add(
            "ratio", replace(recipe, light=lit.new, settings=settings, captured=lit.captured, captured_level=level)
        )

    # --- frames ---

    @property
    def _settings(self) -> RelightSettings:
        return replace(self.job.relight, profile="playcanvas", mode="tint", space="display")

    def _shown(self, recipe: _Recipe) -> F32:
        """(H, W, 3) display values 0..1 of a recipe."""
        frame = relighting.apply(
            recipe.splats,
            recipe.light,
            recipe.settings,
            captured=recipe.captured,
            captured_level=recipe.captured_level,
            noise=False,
        )
        rgb, alpha, display = frame.rgba[..., :3], frame.rgba[..., 3], recipe.display
        tone, gain, whole = display.tone, 2.0**display.exposure, recipe.engine_blending and recipe.splats.linear
        if whole:
            tone, gain = engine_tone(self.job)
        return colour.shown(rgb, alpha, frame.profile, gain=gain, tone=tone, background=display.background, whole=whole)

    def _engine_tone(self, linear: F32) -> F32:
        """Linear pipeline: what follows blending."""
        curve, exposure = engine_tone(self.job)
        return colour.power_encode(colour.tone_map(linear * np.float32(exposure), curve))

    def _add(self, name: str, recipe: _Recipe) -> None:
        self._append(name, self._shown(recipe))

    def _append(self, name: str, frame: F32) -> None:
        self.rungs.append(Rung(name, CAUSES[name].title, CAUSES[name].change, frame))


def _f32(values: object) -> F32:
    return np.asarray(values, dtype=np.float32)
