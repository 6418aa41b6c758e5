"""Runs a plan: the frames that a store does not have yet, camera by camera, until all are there.

Several processes and machines may run one plan in one folder: each camera is claimed by one of them. Every engine that
spreads work (worker processes, shards, a farm) calls :func:`run` with its part of the plan.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Protocol

import numpy as np

from mirelight import advice, stages
from mirelight.dataset import describe, index
from mirelight.model import Frame, SplatLayer
from mirelight.plan import FrameTask, Group, Plan
from mirelight.scene import Scene, prepare
from mirelight.store import Store
from mirelight.units import terms

_MOST_SAID = 3  # lines of one kind of finding
_WAIT = 0.25  # seconds between two looks at cameras that others work on


@dataclass(frozen=True, slots=True, kw_only=True)
class RenderSummary:
    """How many frames were made here, and how many were there already or were made by another process."""

    rendered: int
    skipped: int


class Progress(Protocol):
    """Hears how far a render is; called from the rendering thread. What it raises ends the run in order."""

    def started(self, tasks: Sequence[FrameTask]) -> None:
        """Before the first frame."""

    def samples(self, task: FrameTask, done: int, total: int) -> None:
        """Light samples of a frame so far; the captured light's and those of unit lights it is the first to need
        included."""

    def finished(self, task: FrameTask, skipped: bool) -> None:
        """A frame is there: made now, or found."""

    def note(self, line: str) -> None:
        """Something to know: what takes long now, or what is wrong with a frame that was made."""

    def waiting(self, cameras: int) -> None:
        """All that is left is being made by other processes: so many cameras."""


class Silent:
    """A `Progress` that says nothing."""

    def started(self, tasks: Sequence[FrameTask]) -> None: ...

    def samples(self, task: FrameTask, done: int, total: int) -> None: ...

    def finished(self, task: FrameTask, skipped: bool) -> None: ...

    def note(self, line: str) -> None: ...

    def waiting(self, cameras: int) -> None: ...


def run(plan: Plan, store: Store, progress: Progress | None = None) -> RenderSummary:
    """Make the frames of a plan that the store does not have, and put each there as soon as it is made.

    Whatever is in the store before an error or an interrupt stays; running again goes on after it. The frame that
    Ctrl-C stops while it is lit is kept as far as it got, apart from the finished ones.

    Raises:
        InputError: a file that the job names cannot be used.
        OutputError: a file cannot be written.
        BackendError, RenderError: see `mirelight.stages`.
    """
    heard = progress or Silent()
    heard.started(plan.tasks)
    scene = prepare(plan.job, store, heard.note)
    if plan.job.output.store != "frames" and plan.job.lightings:
        index.write(describe.describe(plan), store.folder)
    said = _Said(heard)
    open_groups, skipped = _open(plan, store, heard)
    rendered = 0
    while open_groups:
        left: list[Group] = []
        for group in open_groups:
            with store.claim(group.name) as mine:
                if not mine:
                    left.append(group)
                    continue
                made = _make(scene, group, store, heard, said)
            rendered += made
            skipped += len(group.tasks) - made
        if len(left) == len(open_groups):
            heard.waiting(len(left))
            time.sleep(_WAIT)
        open_groups = left
    said.rest()
    return RenderSummary(rendered=rendered, skipped=skipped)


def _open(plan: Plan, store: Store, progress: Progress) -> tuple[list[Group], int]:
    """The groups with something left to make, and how many frames of the others are there."""
    index = store.index()
    left: list[Group] = []
    there = 0
    for group in plan.groups:
        if all(index.has(task) for task in group.tasks) and store.has_layers(group.layers):
            there += len(group.tasks)
            for task in group.tasks:
                progress.finished(task, True)
        else:
            left.append(group)
    return left, there


class _Said:
    """What is wrong with frames, told after each; of each kind the first few, then how many more."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self._counts: Counter[str] = Counter()

    def look(self, scene: Scene, task: FrameTask, frame: Frame) -> None:
        """Tell what is wrong with a frame."""
        off = [x.layer for x in terms(task.lighting) if not np.any(x.weight)] if task.lighting else []
        for finding in advice.of_frame(frame, scene.job.display, off=off):
            self._counts[finding.kind] += 1
            if self._counts[finding.kind] <= _MOST_SAID:
                self._progress.note(f"{task.name}: {finding}")

    def rest(self) -> None:
        """Tell how much was left out."""
        more = sum(max(count - _MOST_SAID, 0) for count in self._counts.values())
        if more:
            self._progress.note(f"the like was found {more} more times")


def _make(scene: Scene, group: Group, store: Store, progress: Progress, said: _Said) -> int:
    """Make what is missing of a camera's frames; says how many that were."""
    if group.layers:
        return _make_layers(scene, group, store, progress)
    missing: list[FrameTask] = []
    for task in group.tasks:
        if store.has(task):  # asked now: another process may have made it meanwhile
            progress.finished(task, True)
        else:
            missing.append(task)
    if not missing:
        return 0
    splats = _composite(scene, group, store)
    for task in missing:
        began = time.monotonic()
        report: Callable[[int, int], None] = partial(progress.samples, task)
        try:
            lit = stages.light(scene, task.camera, task.lighting, progress=report) if task.lighting else None
        except stages.Stopped as stopped:
            if stopped.lit is not None:
                store.put_partial(task, stages.relit(scene, splats, stopped.lit, unfinished=True))
            raise
        frame = stages.relight(scene, splats, lit)
        store.put(task, frame, seconds=time.monotonic() - began)
        progress.finished(task, False)
        said.look(scene, task, frame)
    return len(missing)


def _make_layers(scene: Scene, group: Group, store: Store, progress: Progress) -> int:
    """Make what is missing of the layers that a camera's frames are mixed from; says how many frames those give."""
    there = store.has_layers(group.layers)
    if not there:
        began = time.monotonic()
        report: Callable[[int, int], None] = partial(progress.samples, group.tasks[0])
        _composite(scene, group, store)
        lightings = [task.lighting for task in group.tasks if task.lighting is not None]
        stages.trace(scene, group.camera, lightings, progress=report)
        store.add_row(group.name, time.monotonic() - began)
    for task in group.tasks:
        progress.finished(task, there)
    return 0 if there else len(group.tasks)


def _composite(scene: Scene, group: Group, store: Store) -> SplatLayer | None:
    splats = stages.composite(scene, group.camera)
    if splats is not None:
        store.keep_composite(scene.keys.composite(group.camera), splats)
    return splats
