"""How far a render is: a live bar on a terminal, a line for each frame elsewhere, nothing where asked."""

from __future__ import annotations

import sys
import time
from collections import Counter
from collections.abc import Sequence
from typing import Protocol, Self

from mirelight.base.errors import printable
from mirelight.batch.pace import Pace
from mirelight.cli import say
from mirelight.model.shown import count


class Named(Protocol):
    """A frame, or what else is counted."""

    @property
    def name(self) -> str:
        """The frame's name."""

    @property
    def camera(self) -> object:
        """What it shares work with others of; known by identity."""


class Tally:
    """Counts frames and samples, and estimates the time left. Shows nothing; a `mirelight.batch.executor.Progress`."""

    def __init__(self) -> None:
        self.total = 0
        self.rendered = 0
        self.skipped = 0
        self.failures: list[tuple[str, str]] = []  # frame, and what went wrong
        self.samples_done = 0  # of the frame in progress that was last heard of
        self.samples_total = 0
        self._begun: dict[str, float] = {}  # by frame in progress how much of it is done
        self._pace = Pace({})
        self._workers = 1  # frames in progress at once, at most so far
        self._began = time.monotonic()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        return None

    def started(self, tasks: Sequence[Named]) -> None:
        """Starts counting before the first frame."""
        self.total = len(tasks)
        self._began = time.monotonic()
        self._pace = Pace(Counter(id(task.camera) for task in tasks))

    def samples(self, task: Named, done: int, total: int) -> None:
        """Samples of the frame in progress."""
        self.samples_done, self.samples_total = done, total
        self._begun[task.name] = done / total if total else 0.0
        self._pace.part(id(task.camera), self._begun[task.name], self.elapsed)

    def finished(self, task: Named, seconds: float | None) -> None:
        """Counts a frame that is finished, in so many seconds of its own; None: it was there."""
        self._over(task)
        if seconds is None:
            self.skipped += 1
            self._pace.found(id(task.camera))
        else:
            self.rendered += 1
            self._pace.made(id(task.camera), seconds, self.elapsed)

    def failed(self, task: Named, error: str) -> None:
        """A frame could not be made; said at once."""
        self._over(task)
        self.failures.append((task.name, error))
        self._pace.found(id(task.camera))
        self.note(f"mirelight: {task.name}: failed twice: {last_line(error)}")

    def _over(self, task: Named) -> None:
        self.samples_done = self.samples_total = 0
        self._begun.pop(task.name, None)

    def working(self, frames: Sequence[str]) -> None:
        """What worker processes are on now."""
        self._workers = max(self._workers, len(frames))

    def waiting(self, cameras: int) -> None:
        """Other processes make what is left."""

    def stopping(self) -> None:
        """The run was told to stop and will, at the end of the step it is in."""

    def making(self, what: str, done: float) -> None:
        """How far something is that all frames share."""

    def note(self, line: str) -> None:
        """Something to know before the first frame."""

    @property
    def there(self) -> int:
        """Frames that exist: made now, or found."""
        return self.rendered + self.skipped

    @property
    def elapsed(self) -> float:
        """Seconds since the first frame began."""
        return time.monotonic() - self._began

    @property
    def begun(self) -> float:
        """How much of the frames in progress is done, in frames."""
        return sum(self._begun.values())

    @property
    def left(self) -> float | None:
        """Seconds that the rest will take, see `mirelight.batch.pace`; None while nothing is known."""
        return self._pace.left(self._workers, self.elapsed)


class Lines(Tally):
    """A line on stderr for each frame that is made."""

    def __init__(self) -> None:
        super().__init__()
        self._frame_began = 0.0
        self._waits = False

    def waiting(self, cameras: int) -> None:
        """Says, once, that other processes are waited for."""
        if not self._waits:
            say.remark(f"waiting for {count(cameras, 'camera')} that other processes render")
        self._waits = True

    def note(self, line: str) -> None:
        """As a line of its own."""
        say.line(line)

    def started(self, tasks: Sequence[Named]) -> None:
        """Starts counting before the first frame."""
        super().started(tasks)
        self._frame_began = self.elapsed

    def finished(self, task: Named, seconds: float | None) -> None:
        """A frame is there; those that were found are counted, and said at the end."""
        super().finished(task, seconds)
        took, self._frame_began = self.elapsed - self._frame_began, self.elapsed
        if seconds is None:
            return
        left = f", about {duration(self.left)} left" if self.left and self.there < self.total else ""
        say.line(f"[{self.there}/{self.total}] {task.name}: made in {duration(took)}{left}")


class Bar(Tally):
    """A live line on a terminal: frame, samples, frames, time gone, time left."""

    def __init__(self) -> None:
        super().__init__()
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

        text = "{task.fields[frame]}", "{task.fields[samples]}", "{task.fields[frames]}", "{task.fields[left]}"
        name, samples, frames, left = (TextColumn(part, markup=False) for part in text)
        columns = name, BarColumn(), samples, frames, TimeElapsedColumn(), left
        self._bar = Progress(*columns, console=Console(stderr=True), transient=True)
        self._row = self._bar.add_task("", total=1.0, frame="reading the job", samples="", frames="", left="")

    def __enter__(self) -> Self:
        self._bar.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._bar.stop()

    def samples(self, task: Named, done: int, total: int) -> None:
        """Samples of the frame in progress."""
        super().samples(task, done, total)
        self._show(task.name)

    def finished(self, task: Named, seconds: float | None) -> None:
        """Counts a frame that is finished."""
        super().finished(task, seconds)
        self._show(task.name)

    def waiting(self, cameras: int) -> None:
        """Says so in place of the frame's name."""
        self._bar.update(self._row, frame=f"waiting for {count(cameras, 'camera')} that others render")

    def working(self, frames: Sequence[str]) -> None:
        """How many workers there are, in place of the frame's name."""
        super().working(frames)
        self._show(f"{len(frames)} workers")

    def making(self, what: str, done: float) -> None:
        """In place of the frame's name, and of how far all frames are."""
        self._bar.update(self._row, completed=done, frame=what, samples="")

    def note(self, line: str) -> None:
        """As a line above the bar."""
        self._bar.console.print(printable(line), markup=False, highlight=False, soft_wrap=True)

    def stopping(self) -> None:
        """Says so in place of the frame's name."""
        self._bar.update(self._row, frame="stopping")

    def _show(self, frame: str) -> None:
        self._bar.update(
            self._row,
            completed=(self.there + self.begun) / max(self.total, 1),
            frame=frame,
            samples=samples_of(self.samples_done, self.samples_total),
            frames=f"{self.there}/{self.total} frames",
            left=f"{duration(self.left)} left" if self.left is not None else "",
        )


def chosen(quiet: bool) -> Tally:
    """What fits the terminal, or silence."""
    if quiet:
        return Tally()
    return Bar() if sys.stderr.isatty() else Lines()


def last_line(error: str) -> str:
    """The line of an error that says what it was: the last one of a traceback."""
    return error.strip().rpartition("\n")[2]


def samples_of(done: int, total: int) -> str:
    """Samples of a frame for people: 12/64 samples, 98/157 M samples; empty where none are due."""
    if total >= 10_000_000:
        return f"{done / 1e6:.0f}/{total / 1e6:.0f} M samples"
    return f"{done}/{total} samples" if total else ""


def duration(seconds: float) -> str:
    """A time for people: 0.4 s, 12 s, 3 min 5 s, 2 h 10 min."""
    if seconds < 9.95:
        return f"{seconds:.1f} s"
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    minutes, rest = divmod(whole, 60)
    if minutes < 60:
        return f"{minutes} min {rest} s"
    return f"{minutes // 60} h {minutes % 60} min"
