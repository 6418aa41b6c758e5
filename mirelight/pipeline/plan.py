"""What a job's frames are: every camera under every lighting, with names and keys, without reading what they show."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

from mirelight.base.errors import InputError
from mirelight.model import Camera, EstimatedSky, Job, Lighting, playcanvas_lights
from mirelight.pipeline import keys, requirements
from mirelight.pipeline.completeness import check
from mirelight.pipeline.scene import prepare

_MOST_LISTED = 20  # names in a message


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrameTask:
    """One frame to make. `lighting` is None where the job has none: the frame shows the splats as captured."""

    camera: Camera
    lighting: Lighting | None
    name: str  # "camera.lighting", unique in the job, safe as a file name
    files: Mapping[str, str]  # by suffix the key of each file: the digest of exactly what it is made from


@dataclass(frozen=True, slots=True, eq=False)
class Group:
    """The frames of one camera: one piece of work, which shares a composite and traced light."""

    name: str  # unique in the job, safe as a file name
    tasks: tuple[FrameTask, ...]
    layers: tuple[str, ...] = ()  # keys of what is kept instead of frames, where the job wants layers alone

    @property
    def camera(self) -> Camera:
        """The camera of all of them."""
        return self.tasks[0].camera


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """The chosen frames of a job, camera by camera."""

    job: Job
    groups: tuple[Group, ...]
    keys: keys.Keys  # of the job, with what frames share at hand

    @property
    def tasks(self) -> tuple[FrameTask, ...]:
        """All frames in the order in which they are made."""
        return tuple(task for group in self.groups for task in group.tasks)

    def __repr__(self) -> str:
        return f"Plan({self.job.source.name}: {len(self.tasks)} frames of {len(self.groups)} cameras)"


def plan(job: Job, cameras: Iterable[str] | None = None, lightings: Iterable[str] | None = None) -> Plan:
    """The frames of a job; `cameras` and `lightings` choose by name (None: all).

    A frame's name and keys do not depend on what else is chosen. Files that the job names are not read.

    Raises:
        InputError: an unknown camera or lighting name; nothing to render; lights without a proxy to fall on; a mode
            without the captured lighting that it needs.
    """
    check(job)
    chosen_cameras = chosen(job, "camera", job.cameras, cameras)
    every_lighting: tuple[Lighting | None, ...] = job.lightings or (None,)
    chosen_lightings = chosen(job, "lighting", job.lightings, lightings) if job.lightings else (None,)
    names = _unique_names(job.cameras, every_lighting)
    made = keys.Keys(job)

    def task(camera: Camera, lighting: Lighting | None) -> FrameTask:
        frame = made.frame(camera, lighting)
        files = {suffix: made.file(frame, camera, lighting, suffix) for suffix in made.files}
        return FrameTask(camera=camera, lighting=lighting, name=names[id(camera), id(lighting)], files=files)

    def group(camera: Camera) -> Group:
        own = [x for x in chosen_lightings if _lit(camera, x)]
        layers = made.needs(camera, own).keys if not made.files else ()
        name = names[id(camera), id(next(x for x in every_lighting if _lit(camera, x)))]
        return Group(name, tuple(task(camera, x) for x in own), layers)

    lit = [camera for camera in chosen_cameras if any(_lit(camera, x) for x in chosen_lightings)]
    if not lit:
        raise InputError(job.source, "no frame of these cameras and lightings", "choose lightings of their times")
    return Plan(job, tuple(group(camera) for camera in lit), made)


def _lit(camera: Camera, lighting: Lighting | None) -> bool:
    return lighting is None or lighting.lights_up(camera)


def lightings_of(groups: Iterable[Group]) -> tuple[Lighting, ...]:
    """The lightings of their frames, each once."""
    return tuple({id(t.lighting): t.lighting for g in groups for t in g.tasks if t.lighting is not None}.values())


def light_keys(plan: Plan) -> frozenset[str]:
    """Keys of all the composites and traced buffers that the job's frames are made from, whatever is chosen."""
    job, made = plan.job, plan.keys
    composites = [made.composite(camera) for camera in job.cameras] if job.splats is not None else []
    return frozenset([*made.lights(), *composites] if job.proxy is not None else composites)


def warnings(plan: Plan) -> tuple[str, ...]:
    """A line for each thing in the plan that the light model of the job's profile does not follow, and about files that
    are easily taken for something else, said once."""
    job = plan.job
    lightings = lightings_of(plan.groups)
    if requirements.compares(job) and job.captured is not None and all(x is not job.captured for x in lightings):
        lightings = (*lightings, job.captured)
    if requirements.follows_engine(job):
        found = _engine_warnings(job, [group.camera for group in plan.groups], lightings)
    else:
        found = [(x.name, playcanvas_lights.physical_warnings(x.lights)) for x in lightings]
    if job.albedo_from_splats and not requirements.colors_proxy(job):
        gray = "the splats' colours are used in modes 'ratio' and 'albedo' with path-traced light; gray here"
        found.append(("proxy.albedo", (gray,)))
    if job.objects and job.render.indirect == "surface":
        found.append(("render.indirect", ("light beside inserted objects is traced, not read from the surface",)))
    return tuple(dict.fromkeys([*job.notes, *(f"{where}: {line}" for where, lines in found for line in lines)]))


def _engine_warnings(
    job: Job, cameras: Sequence[Camera], lightings: Sequence[Lighting]
) -> list[tuple[str, tuple[str, ...]]]:
    found: list[tuple[str, tuple[str, ...]]] = []
    if requirements.compares(job):
        found.append(("relight.mode", ("the engine knows the tint only",)))
    found += [("camera", playcanvas_lights.camera_warnings(x)) for x in cameras]
    if job.proxy is not None and lightings:
        from mirelight.lighting.engine.raster import culling_warnings

        scene = prepare(job)
        proxy = scene.mesh
        assert proxy is not None
        found.append(("proxy", culling_warnings(proxy, cameras, job.render.variant)))
        known = [x for x in lightings if not isinstance(x.sky, EstimatedSky)]
        found += [(x.name, playcanvas_lights.to_engine(scene.resolved(x), proxy)[1]) for x in known]
    found += [(x.name, playcanvas_lights.penumbra_warnings(x.lights)) for x in lightings]
    if job.engine.hdr_format is not None:
        found.append(("engine.hdr_format", ("mirelight blends in 32-bit floats; the engine's own frames follow it",)))
    return found


Named = TypeVar("Named", Camera, Lighting)


def chosen(job: Job, kind: str, existing: tuple[Named, ...], wanted: Iterable[str] | None) -> tuple[Named, ...]:
    """Cameras or lightings (`kind`) of a job by their names; None: all. Raises InputError where there is none."""
    names = {x.name for x in existing}
    if not existing:
        raise InputError(job.source, f"no {kind} to render", f"name at least one {kind}")
    if wanted is None:
        return existing
    meant = set(wanted)
    for name in sorted(meant - names):
        raise InputError(job.source, f"no {kind} named {name!r}", f"there are: {_listed([x.name for x in existing])}")
    return tuple(x for x in existing if x.name in meant)


def _listed(names: Sequence[str]) -> str:
    more = f", … ({len(names)} in all)" if len(names) > _MOST_LISTED else ""
    return ", ".join(names[:_MOST_LISTED]) + more


def camera_names(cameras: tuple[Camera, ...]) -> tuple[str, ...]:
    """A name for each camera that is unique and safe as a file name."""
    names = _unique_names(cameras, (None,))
    return tuple(names[id(camera), id(None)] for camera in cameras)


def _unique_names(cameras: tuple[Camera, ...], lightings: tuple[Lighting | None, ...]) -> dict[tuple[int, int], str]:
    """A file name for each camera and lighting: what files cannot hold becomes "_", doubles get a number."""
    names: dict[tuple[int, int], str] = {}
    taken: dict[str, int] = {}
    safe = {id(x): _safe(x.name) for x in (*cameras, *lightings) if x is not None}
    for camera in cameras:
        for lighting in lightings:
            if not _lit(camera, lighting):
                continue
            stem = safe[id(camera)] + (f".{safe[id(lighting)]}" if lighting else "")
            name, count = stem, taken.get(stem.casefold(), 0) + 1  # case-blind: some file systems are
            while count > 1 and (name := f"{stem}-{count}").casefold() in taken:
                count += 1
            taken[stem.casefold()] = count
            taken.setdefault(name.casefold(), 1)
            names[id(camera), id(lighting)] = name
    return names


def _safe(name: str) -> str:
    return re.sub(r"[^\w.-]+", "_", name, flags=re.ASCII).strip(".") or "_"
