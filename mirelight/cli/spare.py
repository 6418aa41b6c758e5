"""What a command reads is not what it writes over."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from mirelight.errors import OutputError

if TYPE_CHECKING:
    from mirelight.model import Job


def files_of(work: Job) -> tuple[Path, ...]:
    """The job file, and all that it names."""
    return work.source, *(work.source.parent / name for name in work.inputs)


def spare(outs: Iterable[Path], read: Iterable[Path]) -> None:
    """Raises OutputError where a file to write is one that is read."""
    known = [path for path in read if path.exists()]
    for out in outs:
        if out.exists() and any(out.samefile(path) for path in known):
            raise OutputError(f"{out}: it is read here, and would be written over; give another name")
