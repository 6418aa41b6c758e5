"""Building the ladder: the engine's frame, then one setting of the renderer after another turned physical."""

from __future__ import annotations

from dataclasses import replace

from mirelight import relighting
from mirelight.apps.explain.engine import EngineRun
from mirelight.apps.explain.recipe import Rungs, SplatPictures, Subject
from mirelight.apps.explain.steps import Say, as_modelled, physical_steps, with_physical_falloffs
from mirelight.apps.explain.types import Ladder
from mirelight.apps.realtime.engine import VERSION
from mirelight.base.errors import InputError
from mirelight.compare import metrics
from mirelight.model import Camera, Job, Lighting, ProxyMesh, SplatCloud
from mirelight.model.playcanvas_lights import to_engine
from mirelight.pipeline.artefact_cache import NullCache
from mirelight.pipeline.scene import Scene, prepare

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
        warnings=warnings if engine is None else engine.frames.warnings,
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
