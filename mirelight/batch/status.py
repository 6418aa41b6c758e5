"""How far the frames of a folder are: there, in flight, failed, missing; without the job, from what runs wrote down."""

from __future__ import annotations

import shlex
from collections import Counter, defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from mirelight.base.errors import InputError
from mirelight.batch.pace import Costs
from mirelight.store.folder import Folder
from mirelight.store.planned import PlannedFrame

Progress = Literal["done", "running", "stopped"]


@dataclass(frozen=True, slots=True)
class InFlight:
    """A camera that a process is at."""

    camera: str
    frames: tuple[str, ...]  # of it that are not there yet
    host: str
    process: int
    seconds: float  # since it was begun
    silent: float  # seconds since the last sign of life


@dataclass(frozen=True, slots=True)
class Failed:
    """A frame that could not be made."""

    frame: str
    error: str  # the line that says what it was


@dataclass(frozen=True, slots=True, kw_only=True)
class Status:
    """The state of a folder. Every frame that some run was to make is counted once."""

    folder: Path
    frames: int
    there: int
    in_flight: tuple[InFlight, ...]
    failed: tuple[Failed, ...]
    missing: tuple[str, ...]  # nobody is at them
    seconds_left: float | None  # with the processes that are at work, else with one; None where nothing is known
    command: str  # what makes the rest
    damaged_rows: int = 0  # of the journal, left out

    @property
    def progress(self) -> Progress:
        """Whether all is there, somebody is at work, or neither."""
        if self.there == self.frames:
            return "done"
        return "running" if self.in_flight else "stopped"


def status(path: str | Path) -> Status:
    """Look at an output folder.

    Raises:
        InputError: no folder, or nothing is known of what was to be made there.
    """
    folder = Folder(path)
    if not folder.runs:
        remedy = "frames are counted once mirelight render has been started there"
        raise InputError(path, "no record of what is to be made", remedy)
    left: dict[str, list[PlannedFrame]] = defaultdict(list)
    count: Counter[str] = Counter(frame.group for frame in folder.planned)
    for frame in folder.planned:
        if not folder.has(frame):
            left[frame.group].append(frame)
    errors = {row.frame: row for rows in folder.rows for row in rows if row.error}
    failed = {
        frame.name: errors[frame.name]
        for frames in left.values()
        for frame in frames
        if frame.name in errors and errors[frame.name].wanted == frame.files
    }
    in_flight = tuple(
        InFlight(
            camera=left[held.name][0].camera,
            frames=tuple(frame.name for frame in left[held.name] if frame.name not in failed),
            host=held.host,
            process=held.process,
            seconds=round(held.age, 1),
            silent=round(held.silent, 1),
        )
        for held in folder.held()
        if held.alive and left.get(held.name)
    )
    busy = {name for one in in_flight for name in one.frames}
    waiting = [frame.name for frames in left.values() for frame in frames]
    costs = Costs.of(folder.rows, _by_row(folder))
    seconds = None
    if costs is not None:
        pieces = ((1, 0) if g in folder.layers else (count[g], count[g] - len(x)) for g, x in left.items())
        seconds = costs.left(pieces, max(1, len(in_flight)))
    newest = folder.runs[-1]
    return Status(
        folder=folder.path,
        frames=len(folder.planned),
        there=len(folder.planned) - len(waiting),
        in_flight=in_flight,
        failed=tuple(Failed(name, row.error.strip().rpartition("\n")[2]) for name, row in failed.items()),
        missing=tuple(name for name in waiting if name not in busy and name not in failed),
        seconds_left=None if seconds is None else round(seconds, 3),
        command=shlex.join(newest.command),
        damaged_rows=folder.journal.bad,
    )


def _by_row(folder: Folder) -> dict[str, PlannedFrame]:
    """The planned frames by the names that rows have: where layers alone are kept, a camera has one row."""
    found = {frame.name: frame for frame in folder.planned}
    if not folder.layers:
        return found
    return found | {frame.group: frame for frame in folder.planned if frame.group in folder.layers}
