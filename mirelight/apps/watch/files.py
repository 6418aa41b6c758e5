"""Which files a job is made of, and whether one of them has changed; asked of the file system now and then."""

from __future__ import annotations

import time
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from mirelight.base.errors import InputError
from mirelight.io.job.hashing import companions, strings
from mirelight.io.job.limits import load_toml
from mirelight.io.job.source import MOST_BYTES
from mirelight.io.safety import read_bytes

_MOST = 5_000  # files that are asked for
_SETTLED = 0.04  # seconds between two looks that must agree: an editor may write in several steps
_PATIENCE = 1.0  # seconds for a file that was replaced to be there again

State = tuple[int, int, int]  # when it was written, size, inode


def files_of(job: Path, named: Iterable[str] = ()) -> set[Path]:
    """The job file, and whatever its texts could name: files, those that these name, and files that are missing yet.

    Args:
        job: the job file, which may hold mistakes.
        named: further names, relative to it.
    """
    out = {job}
    names = list(named)
    with suppress(InputError, ValueError):
        names += strings(load_toml(read_bytes(job, MOST_BYTES).decode("utf-8-sig")))
    for name in dict.fromkeys(names):
        if not name or len(name) > 1000 or "\0" in name:
            continue
        path = job.parent / name
        out.add(path)
        with suppress(OSError):
            if path.is_dir() and path.resolve() != job.parent.resolve():
                out.update(x for x in path.iterdir() if x.is_file())
            elif path.is_file():
                out.update(companions(path))
        if len(out) > _MOST:
            break
    return out


class Files:
    """Files as they were when they were last looked at."""

    def __init__(self, job: Path) -> None:
        self._job = job
        self._seen: dict[Path, State | None] = {job: _state(job)}

    def __len__(self) -> int:
        return sum(state is not None for state in self._seen.values())

    def follow(self, paths: Iterable[Path]) -> None:
        """These from now on. What was known of them stays: a change since then still counts."""
        self._seen = {path: self._seen[path] if path in self._seen else _state(path) for path in paths}

    def changed(self) -> bool:
        """Whether one of them was written, replaced, removed or made since."""
        return any(_state(path) != state for path, state in self._seen.items())

    def settle(self) -> None:
        """Take them as they are now, once nobody is writing any more."""
        end = time.monotonic() + _PATIENCE
        while True:
            before = {path: _state(path) for path in self._seen}
            time.sleep(_SETTLED)
            self._seen = {path: _state(path) for path in before}
            if time.monotonic() > end or (self._seen == before and self._seen[self._job] is not None):
                return


def _state(path: Path) -> State | None:
    """None: there is no such file. A folder counts by what is in it."""
    try:
        found = path.stat()
    except (OSError, ValueError):
        return None
    return found.st_mtime_ns, found.st_size, found.st_ino
