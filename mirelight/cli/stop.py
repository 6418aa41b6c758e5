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


class Signals:
    """SIGINT and SIGTERM are noted, and raised between two steps of the work; a second one at once."""

    noted: int | None = None

    def __enter__(self) -> Self:
        self._before = {number: signal.signal(number, self._note) for number in (signal.SIGINT, signal.SIGTERM)}
        return self

    def __exit__(self, *error: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def check(self) -> None:
        """Raises what was noted."""
        if self.noted == signal.SIGINT:
            raise KeyboardInterrupt
        if self.noted is not None:
            raise SystemExit(TERMINATED)

    def _note(self, number: int, frame: FrameType | None) -> None:
        again, self.noted = self.noted is not None, number
        if again:
            Signals.check(self)


class Watched(Signals, Progress):
    """Passes everything on and raises a noted signal after it."""

    def __init__(self, tally: Tally) -> None:
        self._tally = tally

    def started(self, tasks: Sequence[FrameTask]) -> None:
        """Starts counting, unless a signal has asked to stop."""
        self._tally.started(tasks)
        self.check()

    def samples(self, task: FrameTask, done: int, total: int) -> None:
        """Samples of the frame in progress."""
        self._tally.samples(task, done, total)
        self.check()

    def finished(self, task: FrameTask, seconds: float | None) -> None:
        """Counts a finished frame, then stops where a signal has asked for it."""
        self._tally.finished(task, seconds)
        self.check()

    def note(self, line: str) -> None:
        """Prints a line, then stops where a signal has asked for it."""
        self._tally.note(f"mirelight: {line}")
        self.check()

    def making(self, what: str, done: float) -> None:
        """What all frames share."""
        self._tally.making(what, done)
        self.check()

    def failed(self, task: FrameTask, error: str) -> None:
        """A frame could not be made."""
        self._tally.failed(task, error)
        self.check()

    def working(self, frames: Sequence[str]) -> None:
        """What worker processes are on."""
        self._tally.working(frames)
        self.check()

    def waiting(self, cameras: int) -> None:
        """Others make what is left."""
        self._tally.waiting(cameras)
        self.check()

    def _note(self, number: int, frame: FrameType | None) -> None:
        super()._note(number, frame)
        self._tally.stopping()


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
