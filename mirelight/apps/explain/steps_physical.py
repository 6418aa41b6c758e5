"""The last steps of a ladder: from light of points to the frame that `mirelight render` shows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from mirelight import relighting
from mirelight.apps.explain.engine import engine_compositor, engine_tone, physical_display, physical_settings
from mirelight.apps.explain.recipe import PointLight, Recipe, Rungs, Subject
from mirelight.lighting.layers import Layers
from mirelight.model import F32, LightingBuffer, RelightSettings
from mirelight.pipeline.scene import Scene, prepare
from mirelight.pipeline.stages import Lit, light

Say = Callable[[str], None]


def physical_steps(subject: Subject, rungs: Rungs, recipe: Recipe, points: PointLight, seed: int, say: Say) -> None:
    """From points and one sample a pixel to the physical frame, by paths of that seed."""
    say("tracing")
    _, lit = _light(subject, replace(subject.job.relight, mode="tint"), seed)
    recipe = _traced(subject, rungs, recipe, points, lit.new)
    say("splats")
    recipe = _blended_physically(subject, rungs, recipe)
    _by_the_jobs_mode(subject, rungs, recipe, seed)


def _light(subject: Subject, settings: RelightSettings, seed: int) -> tuple[Scene, Lit]:
    """The light that `mirelight render` has in the profile physical, at the frame's own resolution."""
    job = subject.job
    render = replace(job.render, profile="physical", seed=seed)
    scene = prepare(replace(job, render=render, relight=replace(settings, texture_scale=1.0)))
    return scene, light(scene, subject.camera, subject.given)


def _traced(subject: Subject, rungs: Rungs, recipe: Recipe, points: PointLight, traced: LightingBuffer) -> Recipe:
    """Causes that only paths show: blocked sky, light sizes, indirect light, covered shares of pixels."""
    lighting = subject.lighting
    layers = Layers.of(lighting, emissive=False)
    direct = [x.direct for x in traced.layers]
    if lighting.environment is not None:
        points = replace(points, sky=_where_covered(direct[layers.environment], traced, points.sky))
        recipe = replace(recipe, light=points.buffer)
        rungs.add("occlusion", recipe)
    if lighting.lights:
        lamps = np.unique(layers.of_light[: len(lighting.lights)])
        lit = np.asarray(np.sum([direct[k] for k in lamps], axis=0), dtype=np.float32)
        points = replace(points, lamps=_where_covered(lit, traced, points.lamps))
        recipe = replace(recipe, light=points.buffer)
        rungs.add("size", recipe)
    else:
        rungs.skip("there are no lights but the environment", "size")
    everything = _where_covered(traced.beauty, traced, points.total)
    recipe = replace(recipe, light=points.surface.buffer(everything))
    rungs.add("indirect", recipe)
    recipe = replace(recipe, light=traced, settings=replace(recipe.settings, profile="physical"))
    rungs.add("coverage", recipe)
    return recipe


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
        recipe = replace(recipe, splats=plain, display=physical_display(job))
        rungs.add("tone", recipe)
    else:
        where = "tone maps the finished frame too" if curve != "none" else "and the job have no tone curve"
        rungs.skip(f"the engine {where}", "tone")
    recipe = replace(recipe, splats=splats.composite(replace(job.compositor, profile="physical")))
    rungs.add("kernel", recipe)
    return recipe


def _by_the_jobs_mode(subject: Subject, rungs: Rungs, recipe: Recipe, seed: int) -> None:
    """The job's own mode instead of the tint, where it is one that divides the captured light out."""
    mode = relighting.mode_of(subject.job.relight)
    if not mode.needs_captured:
        rungs.skip(f"the job's mode is {mode.name}", "ratio")
        return
    scene, lit = _light(subject, subject.job.relight, seed)
    settings = replace(recipe.settings, mode=mode.name)
    level = scene.captured_level
    rungs.add("ratio", replace(recipe, light=lit.new, settings=settings, captured=lit.captured, captured_level=level))
