"""Frames while they are made: a small quick picture of each first, then the frame in progress now and then.

What is shown is `NAME.preview.png` beside the frame's files. It is never taken for the frame, and is removed when the
frame is there.
"""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Callable, Sequence
from dataclasses import replace

from mirelight.base.errors import RenderError
from mirelight.batch.executor import Progress
from mirelight.model import Camera, Frame, Job
from mirelight.pipeline import stages
from mirelight.pipeline.artefact_cache import MemoryCache
from mirelight.pipeline.plan import FrameTask, Group
from mirelight.pipeline.scene import Scene, prepare
from mirelight.store import Store

_PART = 4  # of the frame's width and height
_LEAST_WIDTH = 160  # pixels, unless the frame has fewer
_SPP = 8  # what the denoiser still makes a picture of

_MEMORY = 64 * 2**20  # bytes of light that is kept, besides that of the view in work
_EVERY = 1.0  # seconds between two pictures of a running frame, at least
_SHARE = 20  # and so many times what making one takes


def quick_camera(camera: Camera) -> Camera:
    """A quarter of the pixels each way."""
    width = min(camera.width, max(camera.width // _PART, _LEAST_WIDTH))
    return camera.resized(width, max(1, round(camera.height * width / camera.width)))


def quick_job(job: Job) -> Job:
    """The job with few samples, denoised where that is installed, and nothing in its frames but the picture."""
    denoise = job.render.denoise or importlib.util.find_spec("pyoidn") is not None
    spp = min(job.render.spp, _SPP)
    render = replace(job.render, spp=spp, noise=None, denoise=denoise, indirect="traced")
    output = replace(job.output, exr=False, png=True, store="both")  # lights apart, so that they are mixed
    return replace(job, render=render, output=output)


def quick_scene(scene: Scene) -> Scene:
    """A prepared job made ready for quick pictures; what it has on the device is shared, and no light goes to disk."""
    return prepare(quick_job(scene.job), MemoryCache(scene.kept, _MEMORY), like=scene)


class Pace:
    """When a running frame is to be shown: not before a second, and for a twentieth of the time."""

    def __init__(self) -> None:
        self._task: FrameTask | None = None
        self._due = self._began = 0.0

    def is_due(self, task: FrameTask) -> bool:
        """Whether it is time to show this frame."""
        self._began = time.monotonic()
        if self._task is not task:
            self._task, self._due = task, self._began + _EVERY
        return self._began >= self._due

    def done(self) -> None:
        """Told that it was shown; the next one waits in proportion to what that took."""
        ended = time.monotonic()
        self._due = ended + max(_EVERY, _SHARE * (ended - self._began))


class Previews:
    """A `mirelight.batch.executor.Preview` that writes pictures into the store's folder.

    Args:
        store: where frames go.
        progress: hears of what takes a while.
    """

    def __init__(self, store: Store, progress: Progress) -> None:
        self._store, self._progress = store, progress
        self._pace = Pace()

    def first(self, scene: Scene, groups: Sequence[Group]) -> None:
        """A quick picture of every frame that is missing."""
        due = [[t for t in g.tasks if g.layers or not self._store.has(t)] for g in groups]
        count = sum(map(len, due))
        self._progress.note(
            f"first a quick picture of {'the frame' if count == 1 else f'{count} frames'}, NAME.preview.png"
        )
        quick = quick_scene(scene.ready(lit=any(task.lighting is not None for tasks in due for task in tasks)))
        for task in (x for tasks in due for x in tasks):
            try:
                self._store.put_preview(task, quick_frame(quick, task))
            except RenderError as e:  # the frame itself may do; if not, it is recorded as failed
                self._progress.note(f"{task.name}: no quick picture: {e}")
            self._progress.samples(task, 0, 1)

    def so_far(self, task: FrameTask, frame: Callable[[], Frame]) -> None:
        """Shows it, so seldom that it costs little."""
        if self._pace.is_due(task):
            self._store.put_preview(task, frame())
            self._pace.done()

    def made(self, task: FrameTask, frame: Frame) -> None:
        """Shows nothing: the finished frame's own files follow."""


def quick_frame(quick: Scene, task: FrameTask) -> Frame:
    """A frame of a quick scene at the size of a quick picture."""
    camera = quick_camera(task.camera)
    splats = stages.composite(quick, camera)
    lit = None if task.lighting is None else stages.light(quick, camera, task.lighting)
    return stages.relit(quick, splats, lit, unfinished=True)
