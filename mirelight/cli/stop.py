"""Ends a render in order: a signal is noted, and raised where Python is between two steps of the work.

An exception in the middle of a step would reach Dr.Jit while it records a kernel, which turns it into another error.
"""

from __future__ import annotations

import signal
from collections.abc import Sequence
from types import FrameType
from typing import Self

from mirelight.batch.executor import Progress
from mirelight.cli.codes import INTERRUPTED, TERMINATED
from mirelight.cli.progress import Tally
from mirelight.pipeline.plan import FrameTask


class Watched(Progress):
    """Passes everything on and raises a noted signal after it.

    The first SIGINT or SIGTERM waits for the next call; a second one is raised at once.
    """

    def __init__(self, tally: Tally) -> None:
        self._tally = tally
        self._noted: int | None = None

    def __enter__(self) -> Self:
        self._before = {number: signal.signal(number, self._note) for number in (signal.SIGINT, signal.SIGTERM)}
        return self

    def __exit__(self, *error: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def started(self, tasks: Sequence[FrameTask]) -> None:
        """Starts counting, unless a signal has asked to stop."""
        self._tally.started(tasks)
        self._raise_noted()

    def samples(self, task: FrameTask, done: int, total: int) -> None:
        """Samples of the frame in progress."""
        self._tally.samples(task, done, total)
        self._raise_noted()

    def finished(self, task: FrameTask, seconds: float | None) -> None:
        """Counts a finished frame, then stops where a signal has asked for it."""
        self._tally.finished(task, seconds)
        self._raise_noted()

    def note(self, line: str) -> None:
        """Prints a line, then stops where a signal has asked for it."""
        self._tally.note(f"mirelight: {line}")
        self._raise_noted()

    def failed(self, task: FrameTask, error: str) -> None:
        """A frame could not be made."""
        self._tally.failed(task, error)
        self._raise_noted()

    def working(self, frames: Sequence[str]) -> None:
        """What worker processes are on."""
        self._tally.working(frames)
        self._raise_noted()

    def waiting(self, cameras: int) -> None:
        """Others make what is left."""
        self._tally.waiting(cameras)
        self._raise_noted()

    def _note(self, number: int, frame: FrameType | None) -> None:
        again, self._noted = self._noted is not None, number
        if again:
            self._raise_noted()
        self._tally.stopping()

    def _raise_noted(self) -> None:
        if self._noted == signal.SIGINT:
            raise KeyboardInterrupt
        if self._noted is not None:
            raise SystemExit(TERMINATED)


def exit_code(error: BaseException) -> int | None:
    """The exit code of an interruption, also where another error came of it; None of any other error."""
    cause: BaseException | None = error
    while cause is not None:
        if isinstance(cause, KeyboardInterrupt):
            return INTERRUPTED
        if isinstance(cause, SystemExit):
            return TERMINATED
        cause = cause.__cause__ or cause.__context__
    return None
