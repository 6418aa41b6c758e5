"""Many frames from one job: every camera under every lighting, with all that can be shared made once.

One composite of the splats per camera serves all its lightings, one tracer serves the whole job, and the captured light
is traced once per camera. The pipeline knows no file format: whether a frame exists, and where a finished one goes, are
given to it as functions.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import TYPE_CHECKING, Protocol, TypeVar

from mirelight import engine_lights, provenance, relight
from mirelight.errors import InputError
from mirelight.model import Camera, Frame, Job, Lighting, LightingBuffer, ProxyMesh, SplatLayer

if TYPE_CHECKING:
    from mirelight.compositor import Compositor
    from mirelight.lighting import EngineTracer, Tracer


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrameTask:
    """One frame to make. `lighting` is None where the job has none: the frame shows the splats as captured."""

    camera: Camera
    lighting: Lighting | None
    name: str  # "camera.lighting", unique in the job, safe as a file name
    fingerprint: str  # SHA-256 over everything that decides the frame's pixels and files


@dataclass(frozen=True, slots=True, kw_only=True)
class RenderSummary:
    """How many frames were made, and how many were already there."""

    rendered: int
    skipped: int


class Progress(Protocol):
    """Is told how far a render is; called from the rendering thread."""

    def started(self, tasks: Sequence[FrameTask]) -> None:
        """Before the first frame."""

    def samples(self, task: FrameTask, done: int, total: int) -> None:
        """Light samples per pixel of a frame so far; in mode `ratio` those of the captured light included."""

    def finished(self, task: FrameTask, skipped: bool) -> None:
        """A frame is there: made now, or found."""


class Silent:
    """A `Progress` that says nothing."""

    def started(self, tasks: Sequence[FrameTask]) -> None: ...

    def samples(self, task: FrameTask, done: int, total: int) -> None: ...

    def finished(self, task: FrameTask, skipped: bool) -> None: ...


# --- planning --------------------------------------------------------------------------------------------------------


def plan(
    job: Job, cameras: Iterable[str] | None = None, lightings: Iterable[str] | None = None
) -> tuple[FrameTask, ...]:
    """The frames of a job, camera by camera; `cameras` and `lightings` choose by name (None: all).

    A frame's name and fingerprint do not depend on what else is chosen.

    Raises:
        InputError: an unknown camera or lighting name; nothing to render; lights without a proxy to fall on; mode
            `ratio` without captured lighting.
    """
    _check(job)
    chosen_cameras = _choose(job, "camera", job.scene.cameras, cameras)
    every_lighting: tuple[Lighting | None, ...] = job.scene.lightings or (None,)
    chosen_lightings = _choose(job, "lighting", job.scene.lightings, lightings) if job.scene.lightings else (None,)

    names = _unique_names(job.scene.cameras, every_lighting)
    common = provenance.digest(
        provenance.versions(),
        provenance.pixel_settings(job),
        job.scene.splats,
        job.scene.proxy,
        job.scene.captured if job.relight.mode == "ratio" else None,
    )
    return tuple(
        FrameTask(
            camera=camera,
            lighting=lighting,
            name=names[id(camera), id(lighting)],
            fingerprint=provenance.digest(common, camera, lighting),
        )
        for camera in chosen_cameras
        for lighting in chosen_lightings
    )


def warnings(job: Job, tasks: Sequence[FrameTask]) -> tuple[str, ...]:
    """A line for each thing in the tasks that the light model of the job's profile does not follow, said once."""
    lightings = {id(task.lighting): task.lighting for task in tasks if task.lighting is not None}
    if job.relight.mode == "ratio" and job.scene.captured is not None:
        lightings[id(job.scene.captured)] = job.scene.captured
    if job.render.profile == "playcanvas":
        cameras = {id(task.camera): task.camera for task in tasks}
        told = _engine_warnings(job, tuple(cameras.values()), tuple(lightings.values()))
    else:
        told = [(x.name, engine_lights.physical_warnings(x.lights)) for x in lightings.values()]
    if job.scene.albedo_from_splats and not job.colors_proxy:
        told.append(
            ("proxy.albedo", ("the splats' colours are used in mode 'ratio' with path-traced light; gray here",))
        )
    return tuple(dict.fromkeys(f"{where}: {line}" for where, lines in told for line in lines))


def _engine_warnings(
    job: Job, cameras: Sequence[Camera], lightings: Sequence[Lighting]
) -> list[tuple[str, tuple[str, ...]]]:
    told: list[tuple[str, tuple[str, ...]]] = []
    if job.relight.mode == "ratio":
        told.append(("relight.mode", ("the engine knows the tint only, not the ratio",)))
    told += [("camera", engine_lights.camera_warnings(x)) for x in cameras]
    proxy = job.scene.proxy
    if proxy is not None and lightings:
        from mirelight.lighting.engine.raster import culling_warnings
        from mirelight.lighting.sunsky import resolved

        told.append(("proxy", culling_warnings(proxy, cameras, job.render.variant)))
        told += [(x.name, engine_lights.to_engine(resolved(x, job.render.variant), proxy)[1]) for x in lightings]
    return told


def _check(job: Job) -> None:
    scene = job.scene
    if scene.splats is None and (scene.proxy is None or not scene.lightings):
        raise InputError(job.source, "nothing to render", "name splats, or a proxy and lights")
    if scene.lightings and scene.proxy is None:
        raise InputError(job.source, "lights but no proxy mesh for them to fall on", "name a proxy, or leave them out")
    if scene.lightings and scene.splats is not None and job.relight.mode == "ratio" and scene.captured is None:
        raise InputError(
            job.source,
            "mode 'ratio' without the lighting that the capture was made under",
            "name it, or set mode to 'tint'",
            field="relight.mode",
        )


Named = TypeVar("Named", Camera, Lighting)


def _choose(job: Job, kind: str, existing: tuple[Named, ...], wanted: Iterable[str] | None) -> tuple[Named, ...]:
    names = [x.name for x in existing]
    if not existing:
        raise InputError(job.source, f"no {kind} to render", f"name at least one {kind}")
    if wanted is None:
        return existing
    wanted = list(wanted)
    for name in wanted:
        if name not in names:
            raise InputError(job.source, f"no {kind} named {name!r}", f"there are: {', '.join(names)}")
    return tuple(x for x in existing if x.name in wanted)


def _unique_names(cameras: tuple[Camera, ...], lightings: tuple[Lighting | None, ...]) -> dict[tuple[int, int], str]:
    """A file name for each camera and lighting: what files cannot hold becomes "_", doubles get a number."""
    names: dict[tuple[int, int], str] = {}
    taken: set[str] = set()
    for camera in cameras:
        for lighting in lightings:
            parts = [camera.name] + ([lighting.name] if lighting else [])
            stem = ".".join(re.sub(r"[^\w.-]+", "_", part, flags=re.ASCII).strip(".") or "_" for part in parts)
            name, count = stem, 1
            while name.casefold() in taken:  # case-blind: some file systems are
                count += 1
                name = f"{stem}-{count}"
            taken.add(name.casefold())
            names[id(camera), id(lighting)] = name
    return names


# --- rendering -------------------------------------------------------------------------------------------------------


def render(
    job: Job,
    tasks: Sequence[FrameTask],
    *,
    is_done: Callable[[FrameTask], bool] = lambda task: False,
    sink: Callable[[FrameTask, Frame], None],
    partial: Callable[[FrameTask, Frame], None] = lambda task, frame: None,
    progress: Progress | None = None,
) -> RenderSummary:
    """Make the frames of `tasks` that `is_done` does not know yet, and give each to `sink` as soon as it is there.

    Whatever `sink` has received before an error or an interrupt stays; running again with the same tasks goes on after
    it. `is_done` is asked right before a camera's frames would be made. `partial` receives the frame that Ctrl-C stops
    while it is lit, as far as it got; its provenance says so and has no fingerprint.
    """
    told = progress or Silent()
    told.started(tasks)
    studio = _Studio(job)
    rendered = skipped = 0
    for _, of_camera in groupby(tasks, key=lambda task: id(task.camera)):
        missing: list[FrameTask] = []
        for task in of_camera:
            if is_done(task):
                skipped += 1
                told.finished(task, True)
            else:
                missing.append(task)
        if not missing:
            continue
        view = studio.look(missing[0].camera)
        for task in missing:
            sink(task, view.frame(task, told, partial))
            rendered += 1
            told.finished(task, False)
    return RenderSummary(rendered=rendered, skipped=skipped)


def lit_proxy(job: Job) -> ProxyMesh:
    """The job's proxy as its frames are lit on it: with the splats' colours where `Job.colors_proxy` says so.

    Raises:
        RenderError: no splat lies on the proxy.
        BackendError: the splats' colours are wanted, and the variant cannot find them or cannot be used.
    """
    scene = job.scene
    assert scene.proxy is not None, "plan() refuses lights without a proxy"
    if not job.colors_proxy or scene.splats is None or scene.captured is None:
        return scene.proxy
    from mirelight.lighting import colored_by

    return colored_by(scene.splats, scene.proxy, scene.captured, job.render)


class _Studio:
    """What all frames of a job share, made when first needed: the splats and the proxy on the compute device."""

    def __init__(self, job: Job) -> None:
        self.job = job
        self._compositor: Compositor | None = None
        self._tracer: Tracer | EngineTracer | None = None

    def look(self, camera: Camera) -> _View:
        return _View(self, camera, self._composite(camera))

    def _composite(self, camera: Camera) -> SplatLayer | None:
        splats = self.job.scene.splats
        if splats is None:
            return None
        if self._compositor is None:
            from mirelight.compositor import Compositor

            settings, render_settings = self.job.compositor, self.job.render
            self._compositor = Compositor(
                splats, settings, variant=render_settings.variant, threads=render_settings.threads
            )
        output = self.job.output
        return self._compositor.composite(camera, depth=output.wants("splat_depth", "splat_median_depth"))

    def trace(self, lighting: Lighting, camera: Camera, progress: Callable[[int, int], None]) -> LightingBuffer:
        if self._tracer is None:
            from mirelight.lighting import tracer

            output = self.job.output
            self._tracer = tracer(
                lit_proxy(self.job),
                self.job.render,
                layers=output.exr and output.layers,
                aovs=output.wants("sun_visibility", "ambient_occlusion"),
            )
        from mirelight.lighting import finished

        output = self.job.output
        buffer = self._tracer.trace(lighting, camera, progress=progress)
        return finished(buffer, self.job.render, layers=output.exr and output.layers)


class _View:
    """What all frames of one camera share: the composite and the captured light."""

    def __init__(self, studio: _Studio, camera: Camera, splats: SplatLayer | None) -> None:
        self._studio = studio
        self._splats = splats
        self._lighting_camera = relight.lighting_camera(camera, studio.job.relight)
        self._captured: LightingBuffer | None = None

    def frame(self, task: FrameTask, progress: Progress, partial: Callable[[FrameTask, Frame], None]) -> Frame:
        job = self._studio.job
        made_by = provenance.of_frame(job, task.lighting.name if task.lighting else "", task.fingerprint)
        if task.lighting is None:
            return relight.apply(self._splats, None, job.relight, made_by=made_by)
        from mirelight.lighting import Interrupted

        compared = job.relight.mode == "ratio" and self._splats is not None
        passes = 2 if compared and self._captured is None else 1
        if passes == 2 and job.scene.captured is not None:
            self._captured = self._trace(job.scene.captured, _part(progress, task, 0, passes))
        captured = self._captured if compared else None
        try:
            lit = self._trace(task.lighting, _part(progress, task, passes - 1, passes))
        except Interrupted as stopped:
            if stopped.buffer is not None:
                unfinished = replace(made_by, fingerprint="", partial=True)
                so_far = relight.apply(self._splats, stopped.buffer, job.relight, captured=captured, made_by=unfinished)
                partial(task, so_far)
            raise
        return relight.apply(self._splats, lit, job.relight, captured=captured, made_by=made_by)

    def _trace(self, lighting: Lighting, progress: Callable[[int, int], None]) -> LightingBuffer:
        return self._studio.trace(lighting, self._lighting_camera, progress)


def _part(progress: Progress, task: FrameTask, index: int, passes: int) -> Callable[[int, int], None]:
    """Reports the samples of one of several equal passes as those of the whole frame."""

    def report(done: int, total: int) -> None:
        progress.samples(task, index * total + done, passes * total)

    return report
