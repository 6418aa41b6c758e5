"""What a render would take: frames, traces, time and disk, before it is started. Writes nothing to the job's folder."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple, TypeVar

from mirelight import relighting
from mirelight.batch.executor import Progress
from mirelight.model import Camera, Job, camera_checks
from mirelight.model.unit_lights import LightSet
from mirelight.pipeline import keys, peak, requirements, stages
from mirelight.pipeline.artefact_cache import ArtefactCache, NullCache
from mirelight.pipeline.codecs import ARRAY, Codec, Packed, composite_of
from mirelight.pipeline.frames import effort
from mirelight.pipeline.plan import FrameTask, Group, Plan, lightings_of
from mirelight.pipeline.scene import Scene, prepare
from mirelight.pipeline.surface_light import SurfaceLight
from mirelight.store import Store, layer_records, write

T = TypeVar("T")

_SIDES = 96, 192  # pixels of the measured frames' longer side
_SPP = 4  # samples of those frames
_MORE = 16  # of one more of the first size


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
    seconds: float  # measured on small frames and continued by pixels and samples: no more than a guide
    bytes: int  # of new files
    memory: int  # bytes that one process takes at once; without a mesh that is still to be made of the splats
    remarks: tuple[str, ...] = ()  # cameras and lights of no use, see `mirelight.model.camera_checks.remarks`


@dataclass(frozen=True, slots=True)
class _Seconds:
    """What a stage takes: whatever the picture's size (each splat is projected, a kernel started), by pixel, and by
    pixel and sample."""

    fixed: float = 0
    pixel: float = 0
    sample: float = 0

    def of(self, pixels: int, samples: float = 0) -> float:
        """Of one picture, with so many samples of each pixel."""
        return self.fixed + pixels * (self.pixel + samples * self.sample)

    @classmethod
    def between(cls, few: int, many: int, short: float, long: float, samples: float = 0, each: float = 0) -> _Seconds:
        """From two pictures of so many pixels and what they took; of so many samples, which take `each` by pixel.
        Nothing is less than zero, however badly it is measured."""
        pixel = (long - short) / (many - few) if many > few else short / few
        pixel = min(max(pixel, samples * each), short / few)
        each = min(each, pixel / samples) if samples else 0.0
        return cls(short - few * pixel, pixel - samples * each, each)


class _Times(NamedTuple):
    """Seconds that the stages of a frame took."""

    composite: float
    light: float  # of a set of unit lights
    relight: float
    write: float


@dataclass(frozen=True, slots=True, kw_only=True)
class _Cost:
    """Seconds by stage, and bytes by pixel, of small frames."""

    composite: _Seconds = _Seconds()
    light: _Seconds = _Seconds()
    relight: _Seconds = _Seconds()
    write: _Seconds = _Seconds()
    files: float = 0  # bytes from here on
    view: float = 0  # what is kept of a view besides its light
    geometry: float = 0  # of each set of unit lights that is kept
    layer: float = 0  # of each light in it
    glow: int = 0  # 1: surfaces that glow are one more set
    scene: int = 0  # in all: what is made once
    surface: SurfaceLight | None = None  # where reflected light is read there


def forecast(plan: Plan, progress: Progress | None = None) -> Forecast:
    """Count what is missing, and render one small frame of it, twice: the first time compiles. What all frames share is
    made for that, and kept for the user's next time; `progress` hears of it.

    Raises:
        InputError, BackendError, RenderError: as the render itself would.
    """
    job, store = plan.job, Store(plan.job)
    made, index = plan.keys, store.index()
    left = [g for g in plan.groups if not all(index.has(t) for t in g.tasks) or not store.has_layers(g.layers)]
    missing = {g.name: [t for t in g.tasks if g.layers or not index.has(t)] for g in left}
    heard = progress or Progress()
    cost = _measured(plan, missing[left[0].name][0], _Sizes(store.artefacts), heard) if left else _Cost()
    seconds, size, traces = 0.0, float(cost.scene), 0
    for group in left:
        pixels = group.camera.width * group.camera.height
        sets, lights = _due(made, store, group, missing[group.name])
        traces += sets
        frames = 0 if group.layers else len(missing[group.name])
        pinholes, samples = effort(job, group.camera, group.tasks[0].lighting)
        composites = 1 if pinholes == 1 else pinholes * frames
        seconds += composites * cost.composite.of(pixels)
        seconds += sets * pinholes * cost.light.of(pixels, samples / pinholes * job.render.spp)
        seconds += frames * (pinholes * cost.relight.of(pixels) + cost.write.of(pixels))
        size += pixels * frames * cost.files
        if job.output.store != "frames":
            glow = cost.glow if sets else 0
            size += pixels * (cost.view + (sets + glow) * cost.geometry + (lights + glow) * cost.layer)
    fills, gathered = None, 0
    if cost.surface is not None:
        fills = int(not store.has_layers([made.surface_transport]))
        due = _due_on_surface(plan, missing, store)
        gathered = sum(len(x) for x in due)
        size += _of_surface(len(cost.surface.cells), bool(fills), [x for parts in due for x in parts])
        seconds += _to_gather(cost.surface, bool(fills), due)
    frames = sum(len(g.tasks) for g in plan.groups)
    return Forecast(
        frames=frames,
        there=frames - sum(len(x) for x in missing.values()),
        cameras=len(plan.groups),
        lightings=max(len(g.tasks) for g in plan.groups),
        traces=traces,
        fills=fills,
        gathered=gathered,
        seconds=seconds,
        bytes=round(size),
        memory=_memory(plan),
        remarks=_remarks(plan),
    )


def _due_on_surface(plan: Plan, missing: Mapping[str, list[FrameTask]], store: Store) -> list[list[LightSet]]:
    """The unit lights on the surface that frames are made from and that are not kept, as they are gathered together."""
    made = plan.keys
    needs = [needs for group in plan.groups if (needs := _lit_needs(made, group, missing.get(group.name, [])))]
    seen: set[str] = set()
    due = []
    for one in {s.digest: s for x in needs for s in x.sets}.values():
        parts = {made.surface_light(part): part for part in one.parts()}
        due.append([part for key, part in parts.items() if key not in seen and not store.has_layers([key])])
        seen |= parts.keys()
    return [parts for parts in due if parts]


def _to_gather(surface: SurfaceLight, fills: bool, due: list[list[LightSet]]) -> float:
    """Seconds, as the first lights to be gathered take them."""
    if not due:
        return 0.0
    between, light = surface.seconds(due[0])
    return between * fills + light / len(due[0]) * sum(len(x) for x in due)


def _of_surface(cells: int, fills: bool, gathered: Iterable[LightSet]) -> int:
    """Bytes of light on so many cells, and of how it goes between them. Lights that no ray meets have an array less."""
    from mirelight.lighting.trace import CELL_SAMPLES
    from mirelight.lighting.transport import size_of_links

    lamps = [bool(x.units) and all(u.environment is None and u.sky is None for u in x.units) for x in gathered]
    lights = cells * 2 * 3 * 4 * sum(2 if is_lamp else 3 for is_lamp in lamps)
    return lights + (size_of_links(cells, CELL_SAMPLES) if fills else 0)


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
    return len(due), sum(s.layers for s in due)


def _lit_needs(made: keys.Keys, group: Group, missing: list[FrameTask]) -> requirements.FrameNeeds | None:
    """What the missing frames of a camera need; None where none of them is lit."""
    wanted = [t.lighting for t in missing if t.lighting is not None]
    return made.needs(group.camera, wanted) if wanted else None


class _Sizes(NullCache):
    """Keeps what is made once in memory, unless it is kept beneath, and nothing of views; counts the bytes of both."""

    def __init__(self, beneath: ArtefactCache) -> None:
        self._beneath = beneath
        self._made: dict[str, Packed] = {}
        self.sets = self.layers = 0  # of traced light
        self.of_sets = self.of_layers = self.of_views = 0  # bytes: those of sets without their layers

    def get(self, key: str, codec: Codec[T]) -> T | None:
        """Nothing of views: what they take is measured."""
        if key in self._made:
            return codec.unpack(self._made[key])
        return self._beneath.get(key, codec) if codec.place != "view" else None

    def has(self, key: str, codec: Codec[T]) -> bool:
        """Whether it need not be made."""
        return key in self._made or (codec.place != "view" and self._beneath.has(key, codec))

    def put(self, key: str, value: T, codec: Codec[T]) -> None:
        """Keeps what is not of a view."""
        packed = codec.pack(value)
        if codec.place != "view":
            self._made[key] = packed
        elif "layers" in packed.about:
            of_layers = sum(x.nbytes for name, x in packed.arrays.items() if "layers." in name)
            self.sets, self.layers = self.sets + 1, self.layers + len(packed.about["layers"])
            self.of_sets, self.of_layers = self.of_sets + packed.nbytes - of_layers, self.of_layers + of_layers
        else:
            self.of_views += packed.nbytes

    @property
    def of_scene(self) -> int:
        """Bytes of all that is not of a view."""
        return sum(x.nbytes for x in self._made.values())


def _measured(plan: Plan, task: FrameTask, kept: _Sizes, heard: Progress) -> _Cost:
    job = plan.job
    longest = max(task.camera.width, task.camera.height)
    large = task.camera.scaled(min(1.0, _SIDES[1] / longest))
    small = large.scaled(_SIDES[0] / _SIDES[1])
    spp = min(_SPP, job.render.spp)
    output = replace(job.output, store="frames" if job.output.store == "frames" else "both")
    # light on the surface is timed by itself: gathering all of it takes longer than all the rest here
    quick = replace(job, render=replace(job.render, spp=spp, indirect="traced"), output=output)
    sizes = _Sizes(kept)  # of the larger one, where heads of files count for less
    with tempfile.TemporaryDirectory() as folder:
        whole = prepare(replace(quick, cameras=(large,)), kept, heard.note, progress=heard.making)
        scene = _ready(whole, small, task)
        heard.making("timing small frames", 0.0)
        _ = _once(scene, small, task, Path(folder))  # compiles kernels
        scene = _ready(prepare(scene.job, sizes, like=scene), small, task)
        second = _once(scene, _later(job, large, 2), task, Path(folder))
        files = sum(x.stat().st_size for x in Path(folder).iterdir())
        again = _ready(prepare(scene.job, kept, like=scene), small, task)
        first = _once(again, _later(job, small, 1), task, Path(folder))
        finer = replace(scene.job, render=replace(quick.render, spp=_MORE))
        again = _ready(prepare(finer, kept, like=scene), small, task)
        third = _once(again, _later(job, small, 3), task, Path(folder))
    few, pixels = small.width * small.height, large.width * large.height
    if scene.job.splats is not None:
        composite = scene.composite(large.pinhole)
        sizes.put("", composite, composite_of(large, composite.profile, composite.linear))
    surface = None if task.lighting is None else prepare(job, kept, like=scene).surface_light
    if surface is not None:
        _ = surface.cells  # counted with what is made once
    if job.output.store != "frames":
        layer_records.keep_around(plan, kept, scene.resolved)
    each = max(third.light - first.light, 0) / (_MORE - spp) / few
    between = partial(_Seconds.between, few, pixels)
    return _Cost(
        composite=between(first.composite, second.composite),
        light=between(first.light, second.light, spp, each),
        relight=between(first.relight, second.relight),
        write=between(first.write, second.write),
        files=files / pixels,
        view=sizes.of_views / pixels,
        geometry=sizes.of_sets / max(sizes.sets, 1) / pixels,
        layer=sizes.of_layers / max(sizes.layers, 1) / pixels,
        glow=int(task.lighting is not None and scene.glows),
        scene=kept.of_scene + _of_splats(scene, plan),
        surface=surface,
    )


def _of_splats(scene: Scene, plan: Plan) -> int:
    """Bytes of light on splats, where frames take it and it is not kept."""
    job, made = scene.job, plan.keys
    lit = [x for x in job.lightings if relighting.per_splat(job.relight_of(x))]
    if scene.splats is None or not lit:
        return 0
    mixtures = (made.splat_sets.mixture(x) for x in requirements.with_compared(job, lit))
    sets = {made.splat_light(s, plan.job.render.spp): s for x in mixtures for s in x.sets}
    due = sum(len(s.units) for key, s in sets.items() if not scene.kept.has(key, ARRAY))
    return due * len(scene.splats) * 3 * 4


def _ready(scene: Scene, camera: Camera, task: FrameTask) -> Scene:
    """With all that frames share: what mirrors show takes long."""
    scene.ready(lit=task.lighting is not None)
    if task.lighting is not None:
        scene.make_ready(scene.job.objects_of(task.lighting, camera))
    return scene


def _later(job: Job, camera: Camera, step: int) -> Camera:
    """The camera at another moment, where objects move: each frame, and each pinhole of an open shutter, has them
    elsewhere."""
    return replace(camera, frame=(camera.frame or 1.0) + step / 4) if job.has_motion else camera


def _sets(scene: Scene, task: FrameTask) -> int:
    """How many sets of unit lights a frame's light is mixed from."""
    if task.lighting is None:
        return 1
    lightings = (task.lighting, requirements.compared_in(scene.job, task.lighting))
    return len({s.digest for x in lightings if x is not None for s in scene.mixture(x).sets})


def _once(scene: Scene, camera: Camera, task: FrameTask, folder: Path) -> _Times:
    times = [time.perf_counter()]
    splats = stages.composite(scene, camera)
    times.append(time.perf_counter())
    lit = None if task.lighting is None else stages.light(scene, camera, task.lighting)
    times.append(time.perf_counter())
    frame = stages.relight(scene, splats, lit)
    times.append(time.perf_counter())
    for suffix in task.files:
        write(frame, folder / f"frame{suffix}", scene.job)
    times.append(time.perf_counter())
    made = _Times(*(after - before for before, after in pairwise(times)))
    return made._replace(light=made.light / _sets(scene, task))
