"""`mirelight watch`: a job is rendered again whenever it is saved."""

from __future__ import annotations

import argparse
import signal
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

from mirelight.base.errors import InputError, MirelightError, printable
from mirelight.batch.executor import Progress
from mirelight.cli.codes import TERMINATED
from mirelight.cli.new import refuse_capture
from mirelight.cli.options import order_of
from mirelight.cli.stop import Signals

if TYPE_CHECKING:
    from mirelight.apps.watch.files import Files
    from mirelight.pipeline.plan import FrameTask

_LOOK = 0.1  # seconds between two looks at the files


def run_watch(args: argparse.Namespace) -> int:
    """The command, until Ctrl-C. All that it says goes to stderr."""
    from mirelight.apps.watch.files import Files, files_of
    from mirelight.apps.watch.session import Session

    refuse_capture(args.job)
    order, job = order_of(args), Path(args.job).absolute()
    if not job.is_file():
        raise InputError(args.job, "no such file", "name a job file (.toml)")
    files, screen = Files(job), _Screen()
    files.follow(files_of(job))
    session = Session(order)
    try:
        with _Signals() as signals:
            while True:
                heard = _Heard(files, screen, signals)
                try:
                    session.update(heard, heard.shown)
                    heard.ended()
                except _Changed:
                    files.follow(files_of(job, session.named))
                    continue
                except MirelightError as e:
                    screen.say(_one_line(e))
                files.follow(files_of(job, session.named))
                screen.status(f"watching {job.name} and {len(files) - 1} more files; Ctrl-C ends")
                while not files.changed():
                    signals.check()
                    time.sleep(_LOOK)
                files.settle()
    except _Ended as e:
        screen.status("")
        return e.code
    finally:
        session.close()


class _Changed(BaseException):
    """A file has changed: what is being made is of no use any more."""


class _Ended(BaseException):
    """The user has had enough."""

    def __init__(self, code: int) -> None:
        self.code = code
        super().__init__()


class _Signals(Signals):
    def check(self) -> None:
        """Ends the command where a signal has asked for it."""
        if self.noted is not None:
            raise _Ended(0 if self.noted == signal.SIGINT else TERMINATED)


class _Heard(Progress):
    """Says when frames are shown and there, and stops for a change."""

    def __init__(self, files: Files, screen: _Screen, signals: _Signals) -> None:
        self._files, self._screen, self._signals = files, screen, signals
        self._began = self._looked = time.monotonic()
        self._there = 0

    def samples(self, task: FrameTask, done: int, total: int) -> None:
        """Now and then the files are looked at."""
        self._signals.check()
        if time.monotonic() - self._looked > _LOOK:
            self._looked = time.monotonic()
            if self._files.changed():
                self._files.settle()
                raise _Changed
            self._screen.status(f"{task.name}: {done / total:.0%}" if total else task.name)

    def finished(self, task: FrameTask, seconds: float | None) -> None:
        """Counts a frame that is finished."""
        if seconds is not None:
            self._there += 1
        self.samples(task, 1, 1)

    def failed(self, task: FrameTask, error: str) -> None:
        """Said in a line; the rest goes on."""
        self._screen.say(f"{task.name}: failed: {error.strip().rpartition(chr(10))[2]}")

    def note(self, line: str) -> None:
        """Prints a line for the person who watches."""
        self._screen.say(line)
        self._signals.check()

    def shown(self, task: FrameTask, what: str) -> None:
        """Says that a picture was replaced, and how long after the change."""
        if what != "so far":
            name = {"quick": "quick picture", "full": "shown in full", "done": "done"}[what]
            self._screen.say(f"{task.name}: {name} after {time.monotonic() - self._began:.1f} s")

    def ended(self) -> None:
        """Says that all frames are finished."""
        if not self._there:
            self._screen.say("all frames are there")


class _Screen:
    """Lines that stay, with the time of day, and on a terminal one that is replaced."""

    def __init__(self) -> None:
        self._live = sys.stderr is not None and sys.stderr.isatty()

    def say(self, line: str) -> None:
        """Prints a line with the time, above the line that changes."""
        if sys.stderr is not None:
            clear = "\r\033[K" if self._live else ""
            print(f"{clear}{time.strftime('%H:%M:%S')} {printable(line)}", file=sys.stderr, flush=True)

    def status(self, line: str) -> None:
        """What is going on now."""
        if self._live:
            print(f"\r\033[K{printable(line)}", end="", file=sys.stderr, flush=True)


def _one_line(error: MirelightError) -> str:
    """The first mistake, and how many more there are."""
    first, *more = str(error).splitlines() or [""]
    return f"{first} (and {len(more)} more)" if more else first
