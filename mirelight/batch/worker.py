"""One worker: an order made ready, and the frames of the cameras that it is given, one after the other.

As a process of its own (`python -m mirelight.batch.worker`) it reads the order and then names of cameras from stdin,
and tells on stdout what it does. It ends when stdin does, so also when the process that watches it was killed.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from types import FrameType

from mirelight.base.errors import InputError, MirelightError
from mirelight.batch import executor, messages
from mirelight.batch.executor import RenderSummary
from mirelight.batch.messages import Reporter, Word
from mirelight.batch.order import Order, fingerprint
from mirelight.pipeline.scene import prepare
from mirelight.store import Store

_PATIENCE = 60.0  # seconds for a step to end after the watcher has gone


class WorkerContext:
    """An order, ready to be worked on: scene, kernels and store stay from one camera to the next."""

    def __init__(self, order: Order, progress: executor.Progress) -> None:
        job = order.load()
        self._order, self._progress = order, progress
        self._said = executor.FindingReporter(progress)
        plan = order.plan(job)
        self._groups = {group.name: group for group in plan.groups}
        self.store = Store(job)
        self.store.hear(progress.note)
        self.store.open()
        self.store.index()
        self._scene = prepare(job, self.store.artefacts, progress.note, progress=progress.making)
        self._scene.read()
        executor.keep_around(plan, self._scene, self.store)

    def plans(self, camera: str, expected: str) -> bool:
        """Whether the camera's frames are those that the asking process means, see :meth:`make`."""
        group = self._groups.get(camera)
        return group is not None and fingerprint(group) == expected

    def make(self, camera: str, expected: str) -> RenderSummary | None:
        """Make what is missing of a camera's frames; None: another process is at it.

        Args:
            camera: the name of its group in the plan.
            expected: `order.fingerprint` of the group as the asking process has planned it.

        Raises:
            InputError: this process plans other frames.
        """
        if not self.plans(camera, expected):
            raise InputError(
                self._order.job,
                f"the frames of {camera} are others here than for the process that asked for them",
                "the job, one of its files or the installed versions differ or have changed; render again",
            )
        return executor.attempt(self._scene, self._groups[camera], self.store, self._progress, self._said)


class _Stopping(Reporter):
    """Ends the work between two steps once a signal has come, or the watcher has gone."""

    def __init__(self) -> None:
        super().__init__(_say)
        self._noted: int | None = None
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._note)

    def _note(self, number: int, frame: FrameType | None) -> None:
        self._noted = number

    def check(self) -> None:
        """Raises what the signal means."""
        if self._noted == signal.SIGINT:
            raise KeyboardInterrupt
        if self._noted is not None:
            raise SystemExit(128 + signal.SIGTERM)


def main() -> int:
    """The process: exit code 0 where its watcher ended it, 2 where nothing could go on."""
    stopping = _Stopping()
    lines = _Lines()
    context: WorkerContext | None = None
    try:
        context = WorkerContext(Order.read(next(lines)), stopping)
        _say(Word(messages.READY))
        for line in lines:
            stopping.check()
            asked = Word.read(line)
            if asked is None or len(asked.values) != 1:
                continue
            _say(messages.outcome(context.make(asked.kind, str(asked.values[0]))))
    except MirelightError as e:
        _say(Word(messages.FATAL, (str(e),)))
        return 2
    except (KeyboardInterrupt, SystemExit):
        if context is not None and context.store.partial:
            _say(Word(messages.PARTIAL, tuple(str(path) for path in context.store.partial)))
    finally:
        if context is not None:
            context.store.close()
    return 0


class _Lines(Iterator[str]):
    """Lines of stdin, read by a thread of their own: its end must be seen while a frame is made."""

    def __init__(self) -> None:
        import queue

        self._queue: queue.Queue[str | None] = queue.Queue()
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        for line in sys.stdin:
            self._queue.put(line)
        self._queue.put(None)
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(_PATIENCE)
        os._exit(2)

    def __next__(self) -> str:
        line = self._queue.get()
        if line is None:
            raise StopIteration
        return line


def _say(word: Word) -> None:
    try:
        print(word.line(), file=_TOLD, flush=True)
    except (OSError, ValueError):  # nobody listens any more; stdin has ended as well
        return


_TOLD = sys.stdout


def _take_stdout() -> None:
    """What libraries print goes to stderr; stdout is for words."""
    global _TOLD
    _TOLD = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)


if __name__ == "__main__":
    _take_stdout()
    sys.exit(main())
