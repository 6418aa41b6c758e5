"""Signs of life: files of this process that are touched while they are held, so that other machines leave them."""

from __future__ import annotations

import os
import threading
from contextlib import suppress
from pathlib import Path

_EVERY = 30.0  # seconds between two touches


class Toucher:
    """Touches files from a thread of its own, which begins with the first."""

    def __init__(self) -> None:
        self._held: set[Path] = set()
        self._lock = threading.Lock()
        self._ended: threading.Event | None = None  # of the thread that is at it

    def hold(self, path: Path) -> None:
        """Touch a file from now on."""
        with self._lock:
            self._held.add(path)
            if self._ended is None:
                self._ended = threading.Event()
                name = "mirelight claims"
                threading.Thread(target=self._run, args=(self._ended,), name=name, daemon=True).start()

    def leave(self, path: Path) -> None:
        """Touch a file no more."""
        with self._lock:
            self._held.discard(path)

    def touch(self) -> None:
        """Touch all of them now."""
        with self._lock:
            held = tuple(self._held)
        for path in held:
            with suppress(OSError):
                os.utime(path)

    def close(self) -> None:
        """Ends the thread that touches files."""
        with self._lock:
            if self._ended is not None:
                self._ended.set()
                self._ended = None

    def _run(self, ended: threading.Event) -> None:
        while not ended.wait(_EVERY):
            self.touch()
