"""Runs a plan: the frames that a store does not have yet, camera by camera, until all are there.

Several processes and machines may run one plan in one folder: each camera is claimed by one of them. Everything that
spreads work (worker processes, shards, a farm) ends in :func:`attempt`: the missing frames of one camera.
"""

from __future__ import annotations

import time
import traceback
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Protocol

from mirelight.base.errors import BackendError, InputError, ManyInputsError, MirelightError, OutputError
from mirelight.base.progress import CountProgress
from mirelight.model import Frame, ProxyMesh, SplatLayer, camera_checks, shown
from mirelight.model.unit_lights import may_be_dark
from mirelight.pipeline import frame_diagnostics, frames, stages
from mirelight.pipeline.artefact_cache import WAIT
from mirelight.pipeline.plan import FrameTask, Group, Plan, lightings_of
from mirelight.pipeline.scene import Scene, prepare
from mirelight.store import Store, layer_index, layer_records
from mirelight.store.journal import said_of

_MOST_SAID = 3  # lines of one kind of finding
_OF_ALL = (InputError, ManyInputsError, OutputError, BackendError)  # trouble that the next frame would meet, too


@dataclass(frozen=True, slots=True, kw_only=True)
class RenderSummary:
    """How many frames were made here, and how many were there already or were made by another process."""

    rendered: int
    skipped: int
    failed: int = 0  # tried twice, and recorded as failed

    def __add__(self, other: RenderSummary) -> RenderSummary:
        return RenderSummary(
            rendered=self.rendered + other.rendered,
            skipped=self.skipped + other.skipped,
            failed=self.failed + other.failed,
        )


class Progress:
    """Hears how far a render is, and says nothing; others say what they want of it.

    Called from the rendering thread. What it raises ends the run in order.
    """

    def started(self, tasks: Sequence[FrameTask]) -> None:
        """Told once, before the first frame is made."""

    def samples(self, task: FrameTask, done: int, total: int) -> None:
        """Light samples of a frame so far; the captured light's and those of unit lights it is the first to need
        included."""

    def finished(self, task: FrameTask, seconds: float | None) -> None:
        """A frame is there: made now, in so many seconds besides what all frames share; or found (None)."""

    def note(self, line: str) -> None:
        """Something to know: what takes long now, or what is wrong with a frame that was made."""

    def making(self, what: str, done: float) -> None:
        """How far something is that all frames share and that takes long: what is done now, and the share of it."""

    def failed(self, task: FrameTask, error: str) -> None:
        """A frame could not be made, twice; the rest goes on."""

    def working(self, frames: Sequence[str]) -> None:
        """What worker processes are on now; said a few times a second while there are some."""

    def waiting(self, cameras: int) -> None:
        """All that is left is being made by other processes: so many cameras."""


class Preview(Protocol):
    """Shows frames before they are finished; called from the rendering thread."""

    def first(self, scene: Scene, groups: Sequence[Group]) -> None:
        """Before the first frame: the groups with something left to make."""

    def so_far(self, task: FrameTask, frame: Callable[[], Frame]) -> None:
        """A frame is being made; `frame` gives it as far as it is."""

    def made(self, task: FrameTask, frame: Frame) -> None:
        """A frame is made; its files follow."""


def run(
    plan: Plan,
    store: Store,
    progress: Progress | None = None,
    preview: Preview | None = None,
    scene: Scene | None = None,
) -> RenderSummary:
    """Make the frames of a plan that the store does not have, and put each there as soon as it is made.

    Whatever is in the store before an error or an interrupt stays; running again goes on after it. The frame that
    Ctrl-C stops while it is lit is kept as far as it got, apart from the finished ones. A frame that fails twice is
    recorded as failed, and the rest goes on; the next run tries it again. `scene`: the plan's job, prepared already.

    Raises:
        InputError: a file that the job names cannot be used.
        OutputError: a file cannot be written.
        BackendError: see `mirelight.pipeline.stages`.
    """
    heard = progress or Progress()
    store.hear(heard.note)
    heard.started(plan.tasks)
    scene = scene or prepare(plan.job, store.artefacts, heard.note, progress=heard.making)
    said = FindingReporter(heard)
    left, done = unfinished(plan, store, heard)
    if left:
        scene.read()  # bad input is said before anything is kept
    keep_index(plan, store)
    keep_around(plan, scene, store)
    if plan.job.proxy is not None and plan.job.lightings and left:
        inspect_views(left, scene.mesh, heard)
    if preview is not None and left:
        preview.first(scene, left)
    while left:
        busy: list[Group] = []
        for group in left:
            made = attempt(scene, group, store, heard, said, preview)
            if made is None:
                busy.append(group)
            else:
                done += made
        if len(busy) == len(left):
            heard.waiting(len(left))
            time.sleep(WAIT)
        left = busy
    said.rest()
    return done


def unfinished(plan: Plan, store: Store, progress: Progress) -> tuple[list[Group], RenderSummary]:
    """The groups with something left to make, and how many frames of the others are there."""
    known = store.index()
    if store.bad_rows:
        progress.note(said_of(store.bad_rows))
    left: list[Group] = []
    there = 0
    for group in plan.groups:
        if all(known.has(task) for task in group.tasks) and store.has_layers(group.layers):
            there += len(group.tasks)
            for task in group.tasks:
                progress.finished(task, None)
        else:
            left.append(group)
    return left, RenderSummary(rendered=0, skipped=there)


def to_give(plan: Plan, store: Store, progress: Progress) -> tuple[list[Group], RenderSummary]:
    """:func:`unfinished`, for work that goes to other processes: what is wrong with cameras and lights is said here,
    once, unless the proxy is still to be made."""
    left, done = unfinished(plan, store, progress)
    if left and plan.job.proxy is not None and plan.job.made_proxy is None:
        inspect_views(left, plan.job.proxy.value, progress)
    keep_index(plan, store)
    return left, done


def keep_index(plan: Plan, store: Store) -> None:
    """Write the index of what is kept besides frames."""
    whole = all(x.time is None for x in plan.job.lightings)  # every camera under every lighting, as an index has it
    if plan.job.output.store != "frames" and plan.job.lightings and whole:
        layer_index.write(layer_records.describe(plan), store.folder)


def keep_around(plan: Plan, scene: Scene, store: Store) -> None:
    """Keep the maps and suns of the job's environments and skies beside the layers, unless they are there."""
    if plan.job.output.store != "frames":
        layer_records.keep_around(plan, store.artefacts, scene.resolved)


def inspect_views(groups: Sequence[Group], proxy: ProxyMesh | None, progress: Progress) -> None:
    """Say before any work which cameras and lights are of no use: inside the mesh, or before nothing."""
    lightings = lightings_of(groups)
    if proxy is not None and lightings:
        for line in camera_checks.remarks([group.camera for group in groups], lightings, proxy):
            progress.note(line)


class FindingReporter:
    """What is wrong with frames, said after each; of each kind the first few, then how many more."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self._counts: Counter[str] = Counter()

    def report(self, scene: Scene, task: FrameTask, frame: Frame) -> None:
        """Tell what is wrong with a frame."""
        off = may_be_dark(task.lighting) if task.lighting else []
        own = scene.job.made_proxy is not None
        for finding in frame_diagnostics.of_frame(frame, scene.job.display, off=off, own=own):
            self._counts[finding.kind] += 1
            if self._counts[finding.kind] <= _MOST_SAID:
                self._progress.note(f"{task.name}: {finding}")

    def rest(self) -> None:
        """Tell how much was left out."""
        more = sum(max(count - _MOST_SAID, 0) for count in self._counts.values())
        if more:
            self._progress.note(f"the like was found {shown.count(more, 'more time')}")


def attempt(
    scene: Scene, group: Group, store: Store, progress: Progress, said: FindingReporter, preview: Preview | None = None
) -> RenderSummary | None:
    """Make what is missing of a camera's frames, unless another process is at it: then None, at once.

    Raises:
        InputError, OutputError, BackendError: see :func:`run`.
    """
    with store.claim(group.name) as mine:
        return _make(scene, group, store, progress, said, preview) if mine else None


def _make(
    scene: Scene, group: Group, store: Store, progress: Progress, said: FindingReporter, preview: Preview | None
) -> RenderSummary:
    if group.layers:
        return _make_layers(scene, group, store, progress)
    store.refresh()
    missing: list[FrameTask] = []
    for task in group.tasks:
        if store.has(task):  # asked now: another process may have made it meanwhile
            progress.finished(task, None)
        else:
            missing.append(task)
    view = _OneCamera(scene, group, store)
    failed = 0
    for task in missing:
        made = _tried(view, task, store, progress, preview)
        if isinstance(made, str):
            failed += 1
            store.put_failed(task, made)
            progress.failed(task, made)
        else:
            frame, seconds = made
            progress.finished(task, seconds)  # first of all: from here on the frame counts as there
            said.report(view.scene, task, frame)
    return RenderSummary(rendered=len(missing) - failed, skipped=len(group.tasks) - len(missing), failed=failed)


class _OneCamera:
    """A camera's frames, whose composite is made once."""

    def __init__(self, scene: Scene, group: Group, store: Store) -> None:
        self.scene, self._group, self._store = scene, group, store

    @cached_property
    def splats(self) -> SplatLayer | None:
        return _composite(self.scene, self._group, self._store)


def _tried(
    view: _OneCamera, task: FrameTask, store: Store, progress: Progress, preview: Preview | None
) -> tuple[Frame, float] | str:
    """Make a frame and keep it, a second time where the first fails; also the seconds that it took by itself. What went
    wrong where the second fails, too."""
    clock, error = view.scene.clock, ""
    for _ in range(2):
        try:
            began = clock.now()
            frame = _make_one(view, task, store, progress, preview)
            if preview is not None:
                preview.made(task, frame)
            seconds = clock.now() - began
            store.put(task, frame, seconds=seconds)
            return frame, seconds
        except _OF_ALL:
            raise
        except Exception as e:
            if _interrupted(e):
                raise
            error = str(e) if isinstance(e, MirelightError) else "".join(traceback.format_exception(e)).strip()
    return error


def _make_one(view: _OneCamera, task: FrameTask, store: Store, progress: Progress, preview: Preview | None) -> Frame:
    scene = view.scene
    report: CountProgress = partial(progress.samples, task)
    if task.camera.exposure is not None:
        return frames.frame(scene, task.camera, task.lighting, progress=report)
    splats = view.splats

    def show(lit: Callable[[], stages.Lit]) -> None:
        assert preview is not None
        preview.so_far(task, lambda: stages.relit(scene, splats, lit(), unfinished=True))

    look = None if preview is None else show
    try:
        lit = stages.light(scene, task.camera, task.lighting, progress=report, look=look) if task.lighting else None
    except stages.Stopped as stopped:
        if stopped.lit is not None:
            store.put_partial(task, stages.relit(scene, splats, stopped.lit, unfinished=True))
        raise
    return stages.relight(scene, splats, lit)


def _make_layers(scene: Scene, group: Group, store: Store, progress: Progress) -> RenderSummary:
    """Make what is missing of the layers that a camera's frames are mixed from."""
    there = store.has_layers(group.layers)
    if not there:
        began = scene.clock.now()
        report: CountProgress = partial(progress.samples, group.tasks[0])
        _composite(scene, group, store)
        lightings = [task.lighting for task in group.tasks if task.lighting is not None]
        stages.trace(scene, group.camera, lightings, progress=report)
        seconds = scene.clock.now() - began
        store.add_row(group.name, seconds)
    for task in group.tasks:
        store.drop_preview(task)
        progress.finished(task, None if there else seconds / len(group.tasks))
    count = len(group.tasks)
    return RenderSummary(rendered=0 if there else count, skipped=count if there else 0)


def _composite(scene: Scene, group: Group, store: Store) -> SplatLayer | None:
    splats = stages.composite(scene, group.camera)
    if splats is not None:
        store.keep_composite(scene.keys.composite(group.camera), splats)
    return splats


def _interrupted(error: BaseException | None) -> bool:
    """True where an error came of a signal: what Ctrl-C breaks off may end as another error."""
    while error is not None:
        if isinstance(error, KeyboardInterrupt | SystemExit):
            return True
        error = error.__cause__ or error.__context__
    return False
