"""Building the ladder: the engine's frame, then one setting of the renderer after another turned physical."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from mirelight import relighting
from mirelight.apps.explain.light import LitSurface, shadows, texture
from mirelight.apps.explain.recipe import (
    EngineRun,
    PointLight,
    Recipe,
    Rungs,
    SplatPictures,
    Subject,
    as_float,
    corner_bits,
    engine_compositor,
    engine_tone,
    physical_display,
    physical_settings,
)
from mirelight.apps.explain.types import Ladder, Rung
from mirelight.apps.realtime.engine import VERSION
from mirelight.base import colour
from mirelight.base.errors import InputError, RenderError
from mirelight.compare import metrics
from mirelight.lighting.engine.raster import rasterise
from mirelight.lighting.layers import Layers
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
)
from mirelight.model.playcanvas_lights import NORMAL_OFFSET_BIAS, to_engine
from mirelight.pipeline.artefact_cache import NullCache
from mirelight.pipeline.scene import Scene, prepare
from mirelight.pipeline.stages import Lit, light

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
        say: hears what is being made.

    Raises:
        InputError: there are no splats or no proxy, or an orthographic camera.
        MirelightError: a package of the extra `compare` is missing; said before any work.
        RenderError: the engine's texture has an unexpected size.
        BackendError: the variant cannot be used on this machine.
    """
    metrics.require(flip_alone=True)
    left_out = ("inserted objects are left out: the steps are those of the capture's light",) if job.objects else ()
    job, lighting = job.bare, replace(lighting, objects=None)
    splats, proxy = require(job, camera)
    plain = prepare(job).resolved(lighting)
    lights, warnings = to_engine(plain, proxy)
    subject = Subject(
        job=job,
        splats=SplatPictures(job, splats, camera),
        proxy=proxy,
        camera=camera,
        given=lighting,
        lighting=plain,
        lights=lights,
        engine=engine,
    )
    rungs = Rungs(job)
    say("real-time frame")
    recipe, light = as_modelled(subject, rungs)
    say("lighting")
    recipe, light = with_physical_falloffs(subject, rungs, recipe, light)
    untraced, again = len(rungs.frames), Rungs(job)
    physical_steps(subject, rungs, recipe, light, job.render.seed, say)
    say("noise")
    physical_steps(subject, again, recipe, light, job.render.seed + _ANOTHER_SEED, say)
    traced = (replace(x, again=y.frame) for x, y in zip(rungs.frames[untraced:], again.frames, strict=True))
    return Ladder(
        name=f"{camera.name}.{plain.name}",
        rungs=(*rungs.frames[:untraced], *traced),
        absent=tuple(rungs.absent),
        engine=f"PlayCanvas {VERSION}" if engine is not None else f"mirelight's prediction of PlayCanvas {VERSION}",
        really_rendered=engine is not None,
        warnings=(*left_out, *(warnings if engine is None else engine.frames.warnings)),
    )


def require(job: Job, camera: Camera) -> tuple[SplatCloud, ProxyMesh]:
    """The job's splats and proxy.

    Raises:
        InputError: a ladder of this job and camera cannot be made; see :func:`explain`.
    """
    splats, proxy = job.splats, job.proxy
    if splats is None or proxy is None:
        missing = "splats" if splats is None else "proxy"
        raise InputError(job.source, f"no {missing}", "a ladder needs splats, a proxy and light", field=missing)
    mesh = Scene(job, NullCache()).mesh
    assert mesh is not None
    if not len(mesh.faces):
        raise InputError(job.source, "a proxy without a face", "a ladder needs something to light", field="proxy")
    if camera.projection != "perspective":
        raise InputError(
            job.source, f"camera {camera.name} is orthographic", "the engine relights perspective cameras only"
        )
    if relighting.mode_of(job.relight).needs_captured and job.captured is None:
        without = f"mode {job.relight.mode!r} without captured lighting"
        raise InputError(job.source, without, "name it, or set mode to 'tint'")
    return splats.value, mesh


# --- the engine's side -----------------------------------------------------------------------------------------------


def as_modelled(subject: Subject, rungs: Rungs) -> tuple[Recipe, PointLight]:
    """From the engine's frame to mirelight's model of it with exact shadows, order, corners and buffers.

    Raises:
        RenderError: the engine's texture has an unexpected size.
    """
    job, lights = subject.job, subject.lights
    settings = replace(job.relight, profile="playcanvas", mode="tint", space="display")
    surface = _lit_surface(subject, relighting.lighting_camera(subject.camera, settings), biased=True)
    sky = surface.engine_environment(lights)
    exact = PointLight(surface=surface, lamps=surface.engine_lights(lights, "exact"), sky=sky)
    biased = replace(exact, lamps=surface.engine_lights(lights, "biased")).buffer
    recipe = Recipe(
        splats=subject.splats.drawn(engine_compositor(job), corner_bits=corner_bits(subject.engine)),
        light=biased if subject.engine is None else _engine_texture(subject, subject.engine, exact),
        settings=settings,
        display=DisplaySettings(background=job.display.background),
    )
    _engine_frame(subject, rungs, recipe)
    recipe = _splats_drawn_exactly(subject, rungs, recipe)
    return _shadows_exact(subject, rungs, recipe, biased, exact), exact


def _engine_frame(subject: Subject, rungs: Rungs, recipe: Recipe) -> None:
    """The frame as users see it, the same in floating point, and the model's own."""
    job, title = subject.job, "Real-time frame"
    if subject.engine is None:
        rough = replace(engine_compositor(job), eight_bit=not recipe.splats.linear)
        drawn = subject.splats.drawn(rough, corner_bits=corner_bits(None))
        eight = np.rint(rungs.shown(replace(recipe, splats=drawn)) * np.float32(255)) / 255
        what = "mirelight's prediction: the engine did not run."
        rungs.frames.append(Rung("engine", title, what, as_float(eight)))
        rungs.add("float", recipe)
        rungs.skip("the engine did not run", "model")
        return
    frames = subject.engine.frames
    what = f"Rendered by PlayCanvas {VERSION}."
    rungs.frames.append(Rung("engine", title, what, as_float(frames.frame[..., :3] / 255)))
    shown = frames.frame_f32[..., :3]
    if recipe.splats.linear:  # what follows blending
        curve, exposure = engine_tone(job)
        shown = colour.power_encode(colour.tone_map(shown * np.float32(exposure), curve))
    rungs.append("float", as_float(np.clip(np.nan_to_num(shown, nan=0.0), 0, 1)))
    rungs.add("model", recipe)


def _splats_drawn_exactly(subject: Subject, rungs: Rungs, recipe: Recipe) -> Recipe:
    """Corners where they are, splats in exact order, colours not rounded."""
    drawing, splats = engine_compositor(subject.job), subject.splats
    recipe = rungs.add("corners", replace(recipe, splats=splats.drawn(drawing)))
    recipe = rungs.add("order", replace(recipe, splats=splats.drawn(drawing, bucketed=False)))
    recipe = replace(recipe, splats=splats.composite(replace(drawing, work_buffer="large")))
    if drawing.work_buffer == "compact":
        rungs.add("buffer", recipe)
    else:
        rungs.skip("the job asks for half floats", "buffer")
    return recipe


def _shadows_exact(subject: Subject, rungs: Rungs, recipe: Recipe, biased: LightingBuffer, exact: PointLight) -> Recipe:
    """Traced shadows from the biased points that the engine looks up, then from the points themselves."""
    if not subject.lights.lights:
        rungs.skip("no light casts any", "shadows", "bias")
        return recipe
    if subject.engine is not None:
        recipe = rungs.add("shadows", replace(recipe, light=biased))
    else:
        rungs.skip("the engine did not run, and its shadow maps are not modelled", "shadows")
    return rungs.add("bias", replace(recipe, light=exact.buffer))


def _engine_texture(subject: Subject, run: EngineRun, exact: PointLight) -> LightingBuffer:
    """The engine's texture, less what the model of its light without shadows misses."""
    surface, real, without = exact.surface, run.frames.relight, run.unshadowed
    expected = surface.albedo.shape[:2]
    if real.shape[:2] != expected:
        raise RenderError(f"the engine's lighting texture is {real.shape[:2]}, expected {expected}")
    predicted = surface.engine_lights(subject.lights, "none") + exact.sky
    known = (real[..., 3] > 0.5) & (without[..., 3] > 0.5) & surface.surface.coverage
    corrected = np.maximum(real[..., :3] + predicted - without[..., :3], 0)
    return texture(
        surface.camera, np.where(known[..., None], corrected, real[..., :3]), (real[..., 3] > 0.5).astype(np.float32)
    )


def with_physical_falloffs(
    subject: Subject, rungs: Rungs, recipe: Recipe, light: PointLight
) -> tuple[Recipe, PointLight]:
    """Causes that one light sample a pixel shows: texture scale, falloffs, prefiltering."""
    lighting = subject.lighting
    if light.surface.camera is not subject.camera:
        full = _lit_surface(subject, subject.camera)
        lamps, sky = full.engine_lights(subject.lights, "exact"), full.engine_environment(subject.lights)
        light = PointLight(surface=full, lamps=lamps, sky=sky)
        recipe = replace(recipe, light=light.buffer, settings=replace(recipe.settings, texture_scale=1.0))
        rungs.add("scale", recipe)
    else:
        rungs.skip("the lighting texture is as large as the frame", "scale")
    if lighting.lights:
        light = replace(light, lamps=light.surface.lights(lighting.lights))
        recipe = rungs.add("units", replace(recipe, light=light.buffer))
    else:
        rungs.skip("there are no lights but the environment", "units")
    if lighting.environment is not None:
        light = replace(light, sky=light.surface.environment(lighting.environment))
        recipe = rungs.add("prefilter", replace(recipe, light=light.buffer))
    else:
        rungs.skip("there is no environment", "prefilter", "occlusion")
    return recipe, light


def _lit_surface(subject: Subject, camera: Camera, *, biased: bool = False) -> LitSurface:
    render, proxy = subject.job.render, subject.proxy
    surface = rasterise(proxy, camera, variant=render.variant, threads=render.threads)
    rays = ShadowRays(proxy, render.variant, render.threads)
    exact = shadows(rays, surface, camera, subject.lighting)
    moved = shadows(rays, surface, camera, subject.lighting, NORMAL_OFFSET_BIAS) if biased else ()
    hit = surface.coverage
    if proxy.albedo is not None:
        albedo: F32 = np.broadcast_to(proxy.albedo, (*hit.shape, 3)).astype(np.float32)
    else:
        albedo = np.zeros((*hit.shape, 3), dtype=np.float32)
        albedo[hit] = rays.albedo(surface.face[hit], surface.position[hit].astype(np.float64))
    return LitSurface(camera, surface, albedo, exact, moved)


# --- from light of points to the physical frame ----------------------------------------------------------------------


def physical_steps(subject: Subject, rungs: Rungs, recipe: Recipe, points: PointLight, seed: int, say: Say) -> None:
    """From points and one sample a pixel to the physical frame, by paths of that seed."""
    say("tracing")
    relight = subject.job.relight
    _, lit = _light(subject, replace(relight, mode="tint", background=relight.far_number), seed)
    recipe = _traced(subject, rungs, recipe, points, lit.new)
    say("splats")
    recipe = _blended_physically(subject, rungs, recipe)
    _by_the_jobs_mode(subject, rungs, recipe, seed)


def _light(subject: Subject, settings: RelightSettings, seed: int) -> tuple[Scene, Lit]:
    """The light that `mirelight render` has in the profile physical, at the frame's own resolution."""
    job = subject.job
    render = replace(job.render, profile="physical", seed=seed)
    output = replace(job.output, exr=True, layers=True)  # which light is which, whatever files hold
    scene = prepare(replace(job, render=render, relight=replace(settings, texture_scale=1.0), output=output))
    return scene, light(scene, subject.camera, subject.given)


def _traced(subject: Subject, rungs: Rungs, recipe: Recipe, points: PointLight, traced: LightingBuffer) -> Recipe:
    """Causes that only paths show: blocked sky, light sizes, indirect light, covered shares of pixels."""
    lighting = subject.lighting
    layers = Layers.of(lighting, emissive=False)
    direct = [x.direct for x in traced.layers]
    if lighting.environment is not None:
        points = replace(points, sky=_where_covered(direct[layers.environment], traced, points.sky))
        recipe = rungs.add("occlusion", replace(recipe, light=points.buffer))
    if lighting.lights:
        lamps = np.unique(layers.of_light[: len(lighting.lights)])
        lit = np.asarray(np.sum([direct[k] for k in lamps], axis=0), dtype=np.float32)
        points = replace(points, lamps=_where_covered(lit, traced, points.lamps))
        recipe = rungs.add("size", replace(recipe, light=points.buffer))
    else:
        rungs.skip("there are no lights but the environment", "size")
    everything = _where_covered(traced.beauty, traced, points.total)
    recipe = rungs.add("indirect", replace(recipe, light=points.surface.buffer(everything)))
    return rungs.add("coverage", replace(recipe, light=traced, settings=replace(recipe.settings, profile="physical")))


def _where_covered(premultiplied: F32, traced: LightingBuffer, otherwise: F32) -> F32:
    """The light of the covered part of each pixel; `otherwise` where no path met the proxy."""
    cover = traced.coverage[..., None]
    return np.where(cover > 0, premultiplied / np.where(cover > 0, cover, 1), otherwise).astype(np.float32)


def _blended_physically(subject: Subject, rungs: Rungs, recipe: Recipe) -> Recipe:
    """Where splats blend and are tinted, the place of the tone curve, and the kernel that they were trained with."""
    job, splats = subject.job, subject.splats
    curve, _ = engine_tone(job)
    drawing = replace(engine_compositor(job), work_buffer="large")
    space = physical_settings(job).space
    settings = replace(recipe.settings, space=space)
    if drawing.linear:
        drawing = replace(drawing, linear=False, tone="none", exposure=1.0)
        drawn, display = replace(splats.composite(drawing), profile="physical"), physical_display(job)
        recipe = replace(recipe, splats=drawn, settings=settings, display=display, engine_blending=False)
        rungs.add("blending", recipe)
        rungs.skip("the linear pipeline tints in linear light", "tint")
    else:
        rungs.skip("the gamma pipeline blends display values", "blending")
        drawn = replace(recipe.splats, profile="physical")
        recipe = replace(recipe, splats=drawn, settings=settings, engine_blending=False)
        if space == "linear":
            rungs.add("tint", recipe)
        else:
            rungs.skip("the job asks for display space", "tint")
    if not drawing.linear and recipe.display != physical_display(job):
        plain = replace(splats.composite(replace(drawing, tone="none", exposure=1.0)), profile="physical")
        recipe = rungs.add("tone", replace(recipe, splats=plain, display=physical_display(job)))
    else:
        where = "tone maps the finished frame too" if curve != "none" else "and the job have no tone curve"
        rungs.skip(f"the engine {where}", "tone")
    return rungs.add("kernel", replace(recipe, splats=splats.composite(replace(job.compositor, profile="physical"))))


def _by_the_jobs_mode(subject: Subject, rungs: Rungs, recipe: Recipe, seed: int) -> None:
    """The job's own mode instead of the tint, where it is one that divides the captured light out."""
    mode = relighting.mode_of(subject.job.relight)
    if not mode.needs_captured:
        rungs.skip(f"the job's mode is {mode.name}", "ratio")
        return
    scene, lit = _light(subject, subject.job.relight, seed)
    settings = replace(recipe.settings, mode=mode.name)
    level, far = scene.captured_level, scene.far(lit.lighting)
    splats = recipe.splats
    if far is not None:  # which splats lie off the proxy no other rung asks
        splats = replace(splats, beyond=scene.composite(subject.camera).beyond)
    light = replace(recipe, splats=splats, light=lit.new, captured=lit.captured, captured_level=level, far=far)
    rungs.add("ratio", replace(light, settings=settings))
