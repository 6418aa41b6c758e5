"""Keeps off the terminal what the OpenEXR package prints about damaged files before it raises an error.

It has no switch for that. The library writes to file descriptor 2, so that is a file for the time of a call, and what
anybody else wrote there meanwhile is passed on afterwards. The package prints to `sys.stdout`, in pieces, so all that
the calling thread prints there is dropped.
"""

from __future__ import annotations

import os
import re
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import IO, Any

_LIBRARY = re.compile(rb"^.*: \(EXR_ERR_\w+\).*\n?", re.MULTILINE)
_STDERR = 2
_lock = threading.Lock()
_own = threading.local()  # `depth`: blocks that this thread is in
_inside = 0  # blocks that run now, in all threads
_held: _Held | None = None
_filter: _Filter | None = None


@contextmanager
def silenced() -> Iterator[None]:
    """What the package prints in this block is dropped. Nothing else should print there.

    Blocks may run in several threads at once: the first one redirects, the last one restores. A process that another
    thread starts meanwhile inherits the file. Where there is no room for a file, the library's lines are not held back.
    """
    global _inside
    with _lock:
        if not _inside:
            _redirect()
        _inside += 1
    _own.depth = getattr(_own, "depth", 0) + 1
    try:
        yield
    finally:
        _own.depth -= 1
        with _lock:
            _inside -= 1
            if not _inside:
                _restore()


@dataclass(frozen=True, slots=True)
class _Held:
    """Descriptor 2 in other hands."""

    kept: int  # a copy of what it was
    file: IO[bytes]  # what it is now


class _Filter:
    """A stream that takes nothing from threads that are in a block."""

    def __init__(self, stream: Any) -> None:
        self.stream = stream

    def write(self, text: str) -> int:
        return len(text) if getattr(_own, "depth", 0) else int(self.stream.write(text))

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)


def _redirect() -> None:
    global _held, _filter
    if sys.stdout is not None:
        _filter = _Filter(sys.stdout)
        sys.stdout = _filter
    _flush()
    with suppress(OSError):  # a closed stream
        kept = os.dup(_STDERR)
        try:
            file = tempfile.TemporaryFile(buffering=0)  # noqa: SIM115 (closed by _restore)
        except OSError:  # no room
            os.close(kept)
            return
        os.dup2(file.fileno(), _STDERR)
        _held = _Held(kept, file)


def _restore() -> None:
    global _held, _filter
    if _filter is not None and sys.stdout is _filter:  # else another thread has put a stream of its own there
        sys.stdout = _filter.stream
    _filter = None
    if _held is None:
        return
    _flush()
    os.dup2(_held.kept, _STDERR)
    os.close(_held.kept)
    with _held.file as file, suppress(OSError):  # whoever reads the stream may be gone
        file.seek(0)
        rest = _LIBRARY.sub(b"", file.read())
        while rest:
            rest = rest[os.write(_STDERR, rest) :]
    _held = None


def _flush() -> None:
    """What Python still holds back for stderr belongs to where that is now."""
    with suppress(OSError, ValueError, AttributeError):  # full, closed, or None
        sys.stderr.flush()
