"""A process of the studio: makes what light on splats takes and finds the captured light, or renders a frame.

It reads one order, a line of JSON, and says lines of JSON. When its order's pipe is closed, it ends.
"""

from __future__ import annotations

import base64
import json
import os
import signal
import sys
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from mirelight.apps.studio import around, early
from mirelight.base.errors import MirelightError
from mirelight.batch import executor
from mirelight.batch.preview import Previews
from mirelight.estimate.describe import described, doubts
from mirelight.io import job as jobs
from mirelight.model import EstimatedSky, Frame
from mirelight.pipeline.plan import FrameTask, Group, plan
from mirelight.pipeline.scene import Scene, prepare
from mirelight.store import Store

Say = Callable[..., None]  # named values; one message


@dataclass(frozen=True, slots=True)
class Ordered:
    """What is to be done with a job."""

    text: str  # of the job
    path: str  # where it would stand
    estimates: str = ""  # the job whose captured light is to be estimated; "": none is
    camera: str = ""  # to render; "": the proxy is made, and what fine light on splats takes
    lighting: str = ""


def carry_out(asked: Ordered, say: Say) -> None:
    """Do it. Raises MirelightError."""
    work = jobs.load_text(asked.text, asked.path)
    store = Store(work)
    store.open()
    try:
        if asked.camera:
            _render(asked, store, say)
            return
        making = _Making(say)
        scene = prepare(work, store.artefacts, lambda line: say(line=line), progress=making.heard)
        mesh = scene.mesh
        say(proxy=0 if mesh is None else len(mesh.faces))
        if asked.estimates:
            other = jobs.load_text(asked.estimates, asked.path)
            with_found = prepare(other, store.artefacts, like=scene, progress=making.heard)
            scene = with_found if _estimate(with_found, say) else scene
        say(line=early.REFINING)
        early.make(scene)
    finally:
        store.close()


def _estimate(scene: Scene, say: Say) -> bool:
    """Whether it is taken."""
    sky = None if scene.job.captured is None else scene.job.captured.sky
    assert isinstance(sky, EstimatedSky) and scene.splats is not None and scene.mesh is not None
    say(line="finding the captured light")
    found = scene.estimate(sky)
    scene.keep_estimate(sky, found)
    against = [f"not known: {x}" for x in doubts(found)][:1]
    sound = not against
    level = scene.captured_level if sound else None
    lines = [*against, *(" ".join(x.split()) for x in described(found))]
    seen = base64.b64encode(around.shown(found.radiance)).decode()
    say(estimate={"sound": bool(sound and level), "level": level or 1.0, "lines": lines, "picture": seen})
    return bool(sound and level)


def _render(asked: Ordered, store: Store, say: Say) -> None:
    work = plan(jobs.load_text(asked.text, asked.path), cameras=[asked.camera], lightings=[asked.lighting])
    heard = _Heard(say)
    shown = _Shown(store, say)
    made = executor.run(work, store, heard, shown)
    task = work.tasks[0]
    if made.failed:
        say(failed=heard.error)
    else:
        say(picture=str(store.folder / f"{task.name}.png"), finished=task.name)


class _Making:
    """Says how far something is that takes long, whenever it is a percent further."""

    def __init__(self, say: Say) -> None:
        self._say, self._line = say, ""

    def heard(self, what: str, done: float) -> None:
        line = f"{what}: {done:.0%}"
        if line != self._line:
            self._line = line
            self._say(line=line)


class _Heard(executor.Progress):
    def __init__(self, say: Say) -> None:
        self._say, self._share, self.error = say, -1.0, ""
        self._making = _Making(say)

    def samples(self, task: FrameTask, done: int, total: int) -> None:
        share = done / max(total, 1)
        if share - self._share > 0.01 or share < self._share:
            self._share = share
            self._say(done=round(share, 3))

    def note(self, line: str) -> None:
        self._say(line=line)

    def making(self, what: str, done: float) -> None:
        self._making.heard(what, done)

    def failed(self, task: FrameTask, error: str) -> None:
        self.error = error


class _Shown(Previews):
    """Says when there is another picture."""

    def __init__(self, store: Store, say: Say) -> None:
        super().__init__(store, executor.Progress())
        self._folder, self._tell = store, say

    def first(self, scene: Scene, groups: Sequence[Group]) -> None:
        super().first(scene, groups)
        self._tell(picture=str(self._folder.preview_path(groups[0].tasks[0])))

    def so_far(self, task: FrameTask, frame: Callable[[], Frame]) -> None:
        super().so_far(task, frame)
        self._tell(picture=str(self._folder.preview_path(task)))


def main() -> int:
    """The process; its exit code."""
    told = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # what libraries print is no message

    def say(**values: Any) -> None:
        print(json.dumps(values), file=told, flush=True)

    line = sys.stdin.readline()
    threading.Thread(target=_end_with_stdin, daemon=True).start()
    try:
        carry_out(Ordered(**json.loads(line)), say)
    except (MirelightError, RuntimeError, MemoryError, OSError) as error:
        said = str(error).strip().splitlines() if not isinstance(error, MemoryError) else ["not enough memory"]
        say(failed=(said or ["it failed without a word"])[-1 if isinstance(error, RuntimeError) else 0])
        return 2
    return 0


def _end_with_stdin() -> None:
    sys.stdin.read()
    os.kill(os.getpid(), signal.SIGTERM)


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the studio's, which closes the pipe
    sys.exit(main())
