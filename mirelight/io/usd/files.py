"""The files that a stage is read from."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

from mirelight.io.usd.process import ask
from mirelight.io.usd.rows import Request


def files_of(path: Path) -> tuple[str, ...]:
    """Names, relative to the stage's folder, of it, its layers and its pictures. Raises InputError."""
    found = path.stat()
    return _files_of(path.absolute(), found.st_mtime_ns, found.st_size)


@lru_cache(maxsize=100)
def _files_of(path: Path, modified: int, size: int) -> tuple[str, ...]:
    """Of a stage in this state; layers below it that change hold the same names, or the stage is read anew."""
    base = path.parent.resolve()
    with ask(path, Request(path=str(path), part="files")) as read:
        return tuple(str(Path(file).relative_to(base)) for file in read.answer.files)
