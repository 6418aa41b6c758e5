"""What a render would take: frames, traces, time and disk, before it is started. Writes nothing to the job's folder."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

from mirelight.model import Camera, Job, camera_checks
from mirelight.pipeline import keys, peak, requirements, stages
from mirelight.pipeline.artefact_cache import ArtefactCache, NullCache
from mirelight.pipeline.codecs import Codec, Packed
from mirelight.pipeline.frames import effort
from mirelight.pipeline.plan import FrameTask, Group, Plan, lightings_of
from mirelight.pipeline.scene import Scene, prepare
from mirelight.store import Store, write

T = TypeVar("T")

_SIDE = 96  # pixels of the measured frame's longer side
_SPP = 4
_GEOMETRY, _LAYER, _COMPOSITE = 60, 36, 24  # bytes a pixel of kept light, of each light in it, of a composite


@dataclass(frozen=True, slots=True, kw_only=True)
class Forecast:
    """What is left to be made of a plan."""

    frames: int
    there: int  # of them already
    cameras: int
    lightings: int
    traces: int  # of sets of unit lights, over all cameras, that are not kept yet
    fills: int | None  # of the surface, rays that serve any light, that are not kept yet; None: nothing is read there
    gathered: int  # unit lights on the surface that are not kept yet
    seconds: float  # measured on a small frame and scaled by pixels and samples: no more than a guide
    bytes: int  # of new files
    memory: int  # bytes that one process takes at once; without a mesh that is still to be made of the splats
    remarks: tuple[str, ...] = ()  # cameras and lights of no use, see `mirelight.model.camera_checks.remarks`


@dataclass(frozen=True, slots=True, kw_only=True)
class _Cost:
    """Of a small frame, by pixel; a trace by pixel and sample."""

    composite: float
    trace: float
    finish: float
    bytes: float
    on_surface: bool = False  # reflected light is read there


def forecast(plan: Plan) -> Forecast:
    """Count what is missing, and render one small frame of it, twice: the first time compiles.

    Raises:
        InputError, BackendError, RenderError: as the render itself would.
    """
    job, store = plan.job, Store(plan.job)
    made, index = plan.keys, store.index()
    left = [g for g in plan.groups if not all(index.has(t) for t in g.tasks) or not store.has_layers(g.layers)]
    missing = {g.name: [t for t in g.tasks if g.layers or not index.has(t)] for g in left}
    nothing = _Cost(composite=0, trace=0, finish=0, bytes=0)
    cost = _measured(job, missing[left[0].name][0], _SceneCache(store.artefacts)) if left else nothing
    seconds, size, traces = 0.0, 0.0, 0
    for group in left:
        pixels = group.camera.width * group.camera.height
        sets, lights = _due(made, store, group, missing[group.name])
        traces += sets
        frames = 0 if group.layers else len(missing[group.name])
        pinholes, samples = effort(job, group.camera, group.tasks[0].lighting)
        composites = 1 if pinholes == 1 else pinholes * frames
        light = sets * samples * cost.trace * job.render.spp
        seconds += pixels * (composites * cost.composite + light + frames * pinholes * cost.finish)
        size += pixels * frames * cost.bytes
        if job.output.store != "frames":
            size += pixels * (_COMPOSITE + sets * _GEOMETRY + lights * _LAYER)
    frames = sum(len(g.tasks) for g in plan.groups)
    return Forecast(
        frames=frames,
        there=frames - sum(len(x) for x in missing.values()),
        cameras=len(plan.groups),
        lightings=max(len(g.tasks) for g in plan.groups),
        traces=traces,
        fills=int(not store.has_layers([made.surface_transport])) if cost.on_surface else None,
        gathered=sum(not store.has_layers([x]) for x in _on_surface(plan, missing)) if cost.on_surface else 0,
        seconds=seconds,
        bytes=round(size),
        memory=_memory(plan),
        remarks=_remarks(plan),
    )


def _on_surface(plan: Plan, missing: Mapping[str, list[FrameTask]]) -> set[str]:
    """Keys of the unit lights on the surface that frames are made from."""
    made = plan.keys
    needs = [needs for group in plan.groups if (needs := _lit_needs(made, group, missing.get(group.name, [])))]
    sets = {s.digest: s for x in needs for s in x.sets}
    return {made.surface_light(part) for one in sets.values() for part in one.parts()}


def _memory(plan: Plan) -> int:
    job = plan.job
    known = job.proxy is not None and (job.made_proxy is None or job.made_proxy.mesh.is_there)
    chosen = replace(job, cameras=tuple(g.camera for g in plan.groups), lightings=tuple(lightings_of(plan.groups)))
    return peak.of_render(chosen, job.proxy.value if known and job.proxy is not None else None)


def _remarks(plan: Plan) -> tuple[str, ...]:
    job = plan.job
    if job.proxy is None or job.made_proxy is not None or not job.lightings:
        return ()
    return camera_checks.remarks([g.camera for g in plan.groups], lightings_of(plan.groups), job.proxy.value)


def _due(made: keys.Keys, store: Store, group: Group, missing: list[FrameTask]) -> tuple[int, int]:
    """How many sets of a camera must be traced, and how many unit lights are in them."""
    needs = _lit_needs(made, group, missing)
    if needs is None:
        return 0, 0
    due = [s for s, key in zip(needs.sets, needs.lights, strict=True) if not store.has_layers([key])]
    return len(due), sum(max(1, len(s.units)) for s in due)


def _lit_needs(made: keys.Keys, group: Group, missing: list[FrameTask]) -> requirements.FrameNeeds | None:
    """What the missing frames of a camera need; None where none of them is lit."""
    wanted = [t.lighting for t in missing if t.lighting is not None]
    return made.needs(group.camera, wanted) if wanted else None


class _SceneCache(NullCache):
    """What scenes need, found where a job keeps it and else kept in memory: it is made once, and nothing is written."""

    def __init__(self, beneath: ArtefactCache) -> None:
        self._beneath = beneath
        self._made: dict[str, Packed] = {}

    def get(self, key: str, codec: Codec[T]) -> T | None:
        """Nothing of views: what they take is measured."""
        if key in self._made:
            return codec.unpack(self._made[key])
        return self._beneath.get(key, codec) if codec.place == "scene" else None

    def put(self, key: str, value: T, codec: Codec[T]) -> None:
        """Keeps what is of a scene."""
        if codec.place == "scene":
            self._made[key] = codec.pack(value)


def _measured(job: Job, task: FrameTask, kept: ArtefactCache) -> _Cost:
    small = task.camera.scaled(min(1.0, _SIDE / max(task.camera.width, task.camera.height)))
    spp = min(_SPP, job.render.spp)
    with tempfile.TemporaryDirectory() as folder:
        output = replace(job.output, store="frames" if job.output.store == "frames" else "both")
        # light on the surface is counted, not timed: gathering it takes longer than all the rest here
        quick = replace(job, cameras=(small,), render=replace(job.render, spp=spp, indirect="traced"), output=output)
        _once(prepare(quick, kept), small, task, Path(folder))
        scene = prepare(quick, kept)
        if quick.splats is not None:
            _ = scene.compositor
        if task.lighting is not None:
            _ = scene.tracer, scene.captured_level
            scene.make_ready(job.objects_of(task.lighting, small))  # once for all frames: what mirrors show takes long
        cost = _once(scene, small, task, Path(folder))
    there = task.lighting is not None and prepare(job, like=scene).surface_light is not None
    return replace(cost, on_surface=there)


def _once(scene: Scene, camera: Camera, task: FrameTask, folder: Path) -> _Cost:
    job, pixels = scene.job, camera.width * camera.height
    began = time.perf_counter()
    splats = stages.composite(scene, camera)
    composited = time.perf_counter()
    sets = 1
    lit = None
    if task.lighting is not None:
        lit = stages.light(scene, camera, task.lighting)
        lightings = (task.lighting, requirements.compared_in(job, task.lighting))
        sets = len({s.digest for x in lightings if x is not None for s in scene.mixture(x).sets})
    traced = time.perf_counter()
    frame = stages.relight(scene, splats, lit)
    for suffix in task.files:
        write(frame, folder / f"frame{suffix}", job)
    done = time.perf_counter()
    return _Cost(
        composite=(composited - began) / pixels,
        trace=(traced - composited) / pixels / sets / job.render.spp,
        finish=(done - traced) / pixels,
        bytes=sum(x.stat().st_size for x in folder.iterdir()) / pixels,
    )
