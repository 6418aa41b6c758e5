"""The files that a stage is read from, and what is to be said of it before it is used."""

from __future__ import annotations

import os
from functools import lru_cache
from pathlib import Path

from mirelight.io.usd.process import ask
from mirelight.io.usd.rows import Request


def files_of(path: Path) -> tuple[str, ...]:
    """Names, relative to the stage's folder, of it, its layers and its pictures. Raises InputError."""
    return _read(path)[0]


def notes_of(path: Path) -> tuple[str, ...]:
    """Lines on what is read from elsewhere, and what of its meshes and cameras is not followed. Raises InputError."""
    return _read(path)[1]


def _read(path: Path) -> tuple[tuple[str, ...], tuple[str, ...]]:
    found = path.stat()
    return _read_once(path.absolute(), found.st_mtime_ns, found.st_size)


@lru_cache(maxsize=100)
def _read_once(path: Path, modified: int, size: int) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Of a stage in this state; layers below it that change hold the same names, or the stage is read anew."""
    base = path.parent.resolve()
    with ask(path, Request(path=str(path), part="files")) as read:
        names = tuple(os.path.relpath(file, base) for file in read.answer.files)
        return names, tuple(read.answer.notes)
