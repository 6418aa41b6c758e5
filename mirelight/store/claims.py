"""Who works on what, among processes and machines that share a folder. No server and no file locks.

A claim is a file that only one process can make (`O_EXCL` is atomic, on NFS too). Its process touches it while it
works; a claim of a process that has ended, or that was not touched for long, is taken over by whoever renames it first.
Should two work at once all the same, they make the same files twice, and lose nothing.
"""

from __future__ import annotations

import hashlib
import os
import re
import secrets
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from mirelight.io import owner
from mirelight.io.atomic import output_error

_TOUCH = 30.0  # seconds between two touches
_STALE = 600.0  # seconds without a touch after which another machine's process counts as gone


class Claims:
    """The claims in a folder."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._held: set[Path] = set()
        self._toucher: threading.Thread | None = None
        self._ended = threading.Event()

    @contextmanager
    def claim(self, name: str) -> Iterator[bool]:
        """Whether the work of that name is this process's own until the block ends.

        Raises:
            OutputError: the folder cannot be written.
        """
        path = self._path(name)
        mine = self._take(path)
        try:
            yield mine
        finally:
            if mine:
                self._held.discard(path)
                with suppress(OSError):
                    path.unlink()

    def _path(self, name: str) -> Path:
        plain = re.sub(r"[^\w.-]+", "_", name)[:80]
        return self._folder / f"{plain}-{hashlib.sha256(name.encode()).hexdigest()[:8]}"

    def _take(self, path: Path) -> bool:
        for _ in range(2):
            try:
                handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o644)
            except FileExistsError:
                if not self._abandoned(path) or not self._removed(path):
                    return False
                continue
            except OSError as e:
                raise output_error(path, e) from None
            os.write(handle, owner.token().encode())
            os.close(handle)
            self._hold(path)
            return True
        return False

    def _abandoned(self, path: Path) -> bool:
        try:
            holder = path.read_text(encoding="ascii", errors="replace")
            running = owner.runs(holder)
            if running is not None:
                return not running
            return self._now() - path.stat().st_mtime > _STALE
        except OSError:
            return False  # it has just been given up

    def _now(self) -> float:
        """The folder's own clock: the machines' may differ."""
        probe = self._folder / f".clock~{owner.token()}-{secrets.token_hex(4)}"
        try:
            probe.touch()
            return probe.stat().st_mtime
        finally:
            with suppress(OSError):
                probe.unlink()

    def _removed(self, path: Path) -> bool:
        """Takes an abandoned claim away; of several that try, one can."""
        taken = path.with_name(f".{path.name}~{owner.token()}-{secrets.token_hex(4)}")
        try:
            path.rename(taken)
            taken.unlink()
        except OSError:
            return False
        return True

    def _hold(self, path: Path) -> None:
        self._held.add(path)
        if self._toucher is None:
            self._toucher = threading.Thread(target=self._touch, name="mirelight claims", daemon=True)
            self._toucher.start()

    def _touch(self) -> None:
        while not self._ended.wait(_TOUCH):
            for path in tuple(self._held):
                with suppress(OSError):
                    os.utime(path)

    def close(self) -> None:
        """Stop touching."""
        self._ended.set()
