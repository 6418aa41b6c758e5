"""One job, loaded again and again: what an edit leaves as it was stays ready from one time to the next."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from mirelight.base.errors import InputError, RenderError
from mirelight.batch import executor
from mirelight.batch.executor import Progress, RenderSummary
from mirelight.batch.order import Order
from mirelight.batch.preview import Pace, quick_frame, quick_job
from mirelight.io import image
from mirelight.io.atomic import write_file
from mirelight.io.folders import NewFolders
from mirelight.model import Frame, Job
from mirelight.pipeline import stages
from mirelight.pipeline.artefact_cache import MemoryCache
from mirelight.pipeline.plan import FrameTask, Group, Plan, light_keys, plan
from mirelight.pipeline.scene import Scene, prepare
from mirelight.store import Store
from mirelight.store.folder import ASIDE

FOLDER = Path(ASIDE) / "watch"  # inside the output folder: of each frame the newest picture that there is


class Session:
    """What is kept between two edits: the scene, the quick scene, light of quick pictures, the store.

    Args:
        order: the job and what is laid over it.
    """

    def __init__(self, order: Order) -> None:
        self._order = order
        self._scene: Scene | None = None
        self._quick: Scene | None = None
        self._store: Store | None = None
        self._live: Path | None = None
        self._spared = False
        self.job: Job | None = None  # as it was last read

    @property
    def named(self) -> tuple[str, ...]:
        """Files that the job named when it was last read, as it names them."""
        return () if self.job is None else tuple(self.job.inputs)

    def update(self, progress: Progress, shown: Callable[[FrameTask, str], None]) -> RenderSummary:
        """Read the job, show what is to be made, and make it.

        Args:
            progress: hears of frames; what it raises ends the update, and all that is ready stays.
            shown: called with a frame and what its picture now is: "quick", "full", "so far" or "done".

        Raises:
            MirelightError: the job or a file of it cannot be used, or nothing can be written.
        """
        job = self._order.load()
        work = self._order.plan(job)
        self._spare(job, work)
        self.job = job
        store = self._opened(job)
        every = self._order.cameras is None and self._order.lightings is None
        store.planned.keep(work, self._order.arguments()[1:], whole=every)
        assert self._live is not None
        if self._scene is None:
            progress.note(f"frames: {len(work.tasks)}; the newest picture of each is in {self._live}")
        scene = prepare(job, store.artefacts, progress.note, like=self._scene)
        self._scene = scene
        live = _Live(self, store, self._live, progress, shown)
        live.copy([task for task in work.tasks if store.has(task)])
        made = executor.run(work, store, progress, live, scene)
        store.tidy(light_keys(plan(job)))
        return made

    def quick(self, scene: Scene) -> Scene:
        """The scene made ready for quick pictures, with the light of those before."""
        beneath = self._quick.kept if self._quick is not None else MemoryCache(scene.kept)
        self._quick = prepare(quick_job(scene.job), beneath, like=scene)
        return self._quick

    def close(self) -> None:
        """No more: pictures of frames in progress go, frames stay."""
        if self._store is not None:
            self._store.close()
        if self._live is not None:
            shutil.rmtree(self._live, ignore_errors=True)

    def _spare(self, job: Job, work: Plan) -> None:
        """Once, before anything is written: what is laid over a job for speed replaces none of its finished frames.

        Raises:
            InputError: frames of another size stand in the job's own folder.
        """
        if self._spared or not self._order.settings or self._order.out is not None:
            return
        sizes = {group.camera.name: (group.camera.width, group.camera.height) for group in work.groups}
        own = replace(self._order, settings=()).load()
        smaller = any(sizes.get(x.name, (x.width, x.height)) != (x.width, x.height) for x in own.cameras)
        if smaller and own.output.directory == job.output.directory:
            for task in work.tasks:
                for suffix in task.files:
                    size = image.read_size(job.output.directory / f"{task.name}{suffix}")
                    if size is not None and size != (task.camera.width, task.camera.height):
                        found = f"{task.name}{suffix} is {size[0]} x {size[1]}, which --set would write over"
                        raise InputError(job.output.directory, found, "name another folder with -o")
        self._spared = True

    def _opened(self, job: Job) -> Store:
        """The store of the job's output folder, opened anew where what is written has changed."""
        known = self._scene.job if self._scene is not None else None
        if self._store is None or known is None or (known.output, known.display) != (job.output, job.display):
            if self._store is not None:
                self._store.close()
            self._store = Store(job)
            self._store.open()
            live = self._store.folder / FOLDER
            if self._live is not None and self._live != live:
                shutil.rmtree(self._live, ignore_errors=True)
            self._live = live
            NewFolders(live).make()
        return self._store


class _Live:
    """A `batch.executor.Preview`: of each frame the newest picture that there is, in a folder of their own."""

    def __init__(
        self, session: Session, store: Store, folder: Path, progress: Progress, shown: Callable[[FrameTask, str], None]
    ) -> None:
        self._session, self._store, self._folder = session, store, folder
        self._progress, self._shown = progress, shown
        self._pace = Pace()

    def first(self, scene: Scene, groups: Sequence[Group]) -> None:
        """Frames whose light is all there are shown as they will be, others by a quick picture."""
        quick: Scene | None = None
        for task in (t for g in groups for t in g.tasks if g.layers or not self._store.has(t)):
            try:
                if self._is_lit(scene, task):
                    self._show(task, stages.frame(scene, task.camera, task.lighting), scene.job, "full")
                else:
                    quick = quick or self._session.quick(scene.ready(lit=task.lighting is not None))
                    self._show(task, quick_frame(quick, task), scene.job, "quick")
            except RenderError as e:  # the frame itself may do; if not, it is recorded as failed
                self._progress.note(f"{task.name}: no quick picture: {e}")
            self._progress.samples(task, 0, 1)

    def so_far(self, task: FrameTask, frame: Callable[[], Frame]) -> None:
        """Shows a frame that is still being rendered, every few seconds."""
        if self._session.job is not None and self._pace.is_due(task):
            self._show(task, frame(), self._session.job, "so far")
            self._pace.done()

    def made(self, task: FrameTask, frame: Frame) -> None:
        """Shown before its files are written."""
        if self._session.job is not None:
            self._show(task, frame, self._session.job, "done")

    def copy(self, tasks: Sequence[FrameTask]) -> None:
        """Frames that are there already."""
        for task in tasks:
            source, target = self._store.folder / f"{task.name}.png", self._folder / f"{task.name}.png"
            with suppress(OSError):
                data = source.read_bytes()
                write_file(target, data)

    def _is_lit(self, scene: Scene, task: FrameTask) -> bool:
        """Whether nothing has to be traced for a frame."""
        lit = task.lighting is not None
        return not lit or self._store.has_layers(scene.keys.needs(task.camera, [task.lighting]).lights)

    def _show(self, task: FrameTask, frame: Frame, job: Job, what: str) -> None:
        image.write(frame, self._folder / f"{task.name}.png", job.display)
        self._shown(task, what)
