"""A case: a folder and a command. What all that draws, writes and judges cases speaks in."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

CANARY = b"secret"
STREAMS = ("closed", "full", "unread", "ascii")  # besides "kept": both closed, a full disk, a pipe nobody reads, ASCII


@dataclass(frozen=True, slots=True)
class Case:
    """A folder and a command."""

    name: str
    arguments: tuple[str, ...]
    build: Callable[[Path], None]  # fills the folder
    bright: bool = False  # a finished frame must not be black
    streams: str = "kept"  # what stdout and stderr are, see STREAMS
    codes: tuple[int, ...] = ()  # it must end with one of these; (): with any that its command has
    after: Callable[[Path], str] | None = None  # says what is wrong with the folder when all is done; "": nothing
    seconds: float = math.inf  # by the clock, that it may take


def of_files(
    name: str,
    arguments: tuple[str, ...],
    files: dict[str, bytes],
    *,
    bright: bool = False,
    setup: Callable[[Path], None] | None = None,
) -> Case:
    """A case of plain files; `setup` adds what is not."""

    def build(folder: Path) -> None:
        for path, data in files.items():
            (folder / path).parent.mkdir(parents=True, exist_ok=True)
            (folder / path).write_bytes(data)
        if setup is not None:
            setup(folder)

    return Case(name, arguments, build, bright)
