"""What was to be made in a folder, written down once a run: without the job, a folder cannot tell what it lacks."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from mirelight.io.atomic import write_file
from mirelight.io.safety import read_file
from mirelight.pipeline.keys import FILE_SUFFIXES
from mirelight.pipeline.plan import Plan

CAPTURE = "--capture="  # among the settings: what was rendered in place of a job file
_RECORDS = "[!.]*.json"  # what another process is writing begins with a dot


@dataclass(frozen=True, slots=True)
class PlannedFrame:
    """A frame that a run was to make."""

    name: str  # "camera.lighting"
    camera: str
    lighting: str  # "" where the job has none
    files: Mapping[str, str]  # by suffix the key of each file
    group: str  # name of the piece of work that it belongs to: all of its camera


@dataclass(frozen=True, slots=True)
class Planned:
    """What one command was to make; a shard's is that of the whole."""

    job: str  # path of the job file, absolute
    settings: tuple[str, ...]  # what was laid over it: arguments of the command
    whole: bool  # every camera under every lighting
    frames: tuple[PlannedFrame, ...]
    layers: Mapping[str, tuple[str, ...]]  # by group the keys of what is kept instead of frames

    @property
    def capture(self) -> str | None:
        """Path of the splats or the stage that were rendered in place of a job file, absolute."""
        return next((x.removeprefix(CAPTURE) for x in self.settings if x.startswith(CAPTURE)), None)

    @property
    def command(self) -> list[str]:
        """What to write for the same frames."""
        return [
            "mirelight",
            "render",
            self.capture or self.job,
            *(x for x in self.settings if not x.startswith(CAPTURE)),
        ]


class PlannedRuns:
    """The records in a folder, one for each different plan."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def keep(self, plan: Plan, settings: Sequence[str], *, whole: bool) -> None:
        """Write a plan down, unless it is there. A plan of the whole job takes the place of what was there of that job.

        Raises:
            OutputError: it cannot be written.
        """
        frames = [
            [task.name, task.camera.name, task.lighting.name if task.lighting else "", dict(task.files), group.name]
            for group in plan.groups
            for task in group.tasks
        ]
        layers = {group.name: list(group.layers) for group in plan.groups if group.layers}
        job = str(plan.job.source.absolute())
        entry = {"job": job, "settings": list(settings), "whole": whole, "frames": frames, "layers": layers}
        text = json.dumps(entry, sort_keys=True).encode()
        path = self._folder / f"{hashlib.sha256(text).hexdigest()[:24]}.json"
        if whole:
            for other in self._folder.glob(_RECORDS):
                if other != path and (read := _read(other)) is not None and read.job == entry["job"]:
                    with suppress(OSError):
                        other.unlink()
        if path.exists():
            with suppress(OSError):
                os.utime(path)
            return
        write_file(path, text)

    def frames(self) -> tuple[PlannedFrame, ...]:
        """Every frame that some run was to make, as the newest of them had it, in the order of the oldest."""
        found: dict[str, PlannedFrame] = {}
        for run in self.runs():
            found |= {frame.name: frame for frame in run.frames}
        return tuple(found.values())

    def runs(self) -> Iterator[Planned]:
        """The records, oldest first; what cannot be read is skipped."""
        with suppress(OSError):
            for path in sorted(self._folder.glob(_RECORDS), key=lambda x: x.lstat().st_mtime_ns):
                found = _read(path)
                if found is not None:
                    yield found


def _read(path: Path) -> Planned | None:
    try:
        entry = json.loads(read_file(path))
        frames = tuple(
            PlannedFrame(
                _plain(name), str(camera), str(lighting), {_suffix(k): str(v) for k, v in x.items()}, str(group)
            )
            for name, camera, lighting, x, group in entry["frames"]
        )
        layers = {str(group): tuple(map(str, keys)) for group, keys in entry["layers"].items()}
        return Planned(str(entry["job"]), tuple(map(str, entry["settings"])), bool(entry["whole"]), frames, layers)
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None


def _plain(name: object) -> str:
    """A frame's name; one that would lead out of the folder is none."""
    if not isinstance(name, str) or not name or Path(name).name != name or "\0" in name:
        raise ValueError
    return name


def _suffix(suffix: object) -> str:
    if suffix not in FILE_SUFFIXES:
        raise ValueError
    return str(suffix)
