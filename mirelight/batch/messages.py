"""What worker processes and whoever watches them tell each other: a line of JSON for each thing."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import dataclass

from mirelight.batch.executor import Progress, RenderSummary
from mirelight.pipeline.plan import FrameTask

_EVERY = 0.25  # seconds between two words about samples

READY = "ready"  # the job is loaded
SAMPLES = "samples"  # frame, done, total
FINISHED = "finished"  # frame, seconds that it took; none where it was there already
FAILED = "failed"  # frame, what went wrong
NOTE = "note"  # a line for people
BUSY = "busy"  # the camera is another process's
DONE = "done"  # frames of the camera rendered, skipped, failed
PARTIAL = "partial"  # paths of the frame that an interrupt stopped
FATAL = "fatal"  # why nothing can go on, in lines


@dataclass(frozen=True, slots=True)
class Word:
    """One message from a worker process."""

    kind: str
    values: tuple[str | int | float, ...] = ()

    def line(self) -> str:
        """As text, without the end of line."""
        return json.dumps([self.kind, *self.values])

    @staticmethod
    def read(line: bytes | str) -> Word | None:
        """Back from :meth:`line`; None of anything else."""
        try:
            kind, *values = json.loads(line)
        except (ValueError, TypeError):
            return None
        return Word(str(kind), tuple(x if isinstance(x, int | float) else str(x) for x in values))


def outcome(made: RenderSummary | None) -> Word:
    """What came of a camera; None: another process is at it."""
    return Word(BUSY) if made is None else Word(DONE, (made.rendered, made.skipped, made.failed))


class Reporter(Progress):
    """Tells every step as a word, and ends the work between two of them where `check` raises."""

    def __init__(self, say: Callable[[Word], None]) -> None:
        self._say = say
        self._last = 0.0

    def check(self) -> None:
        """Raises what ends the work; here nothing does."""

    def samples(self, task: FrameTask, done: int, total: int) -> None:
        """A few times a second."""
        now = time.monotonic()
        if now - self._last >= _EVERY:
            self._last = now
            self._say(Word(SAMPLES, (task.name, done, total)))
        self.check()

    def finished(self, task: FrameTask, seconds: float | None) -> None:
        """Passes on that a frame is finished."""
        self._say(Word(FINISHED, (task.name, *(() if seconds is None else (seconds,)))))
        self.check()

    def making(self, what: str, done: float) -> None:
        """Says nothing, as every process makes the same."""
        self.check()

    def failed(self, task: FrameTask, error: str) -> None:
        """A frame could not be made."""
        self._say(Word(FAILED, (task.name, error)))

    def note(self, line: str) -> None:
        """Passes on a line for the person who waits."""
        self._say(Word(NOTE, (line,)))
