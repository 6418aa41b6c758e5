"""Room on the disk that is given back when it is full, so that the journal's last line can still be written."""

from __future__ import annotations

import os
import secrets
import shutil
from contextlib import suppress
from pathlib import Path

from mirelight.io import owner
from mirelight.store.touching import Toucher

_BYTES = 16 * 2**20
_SHARE = 16  # one part in so many of what is free is taken at most: frames come first


class Ballast:
    """A file of this process's own. Its name tells whose it is, so that a killed process's is cleared away.

    Args:
        folder: its place.
        toucher: gives signs of life, so that another machine does not take it for a killed process's.
    """

    def __init__(self, folder: Path, toucher: Toucher) -> None:
        self.folder, self._toucher = folder, toucher
        self._path: Path | None = None

    def take(self) -> None:
        """Take the room, where there is that much and it is not held yet."""
        if self._path is not None:
            return
        path = self.folder / f".ballast~{owner.token()}-{secrets.token_hex(6)}"
        try:
            size = min(_BYTES, shutil.disk_usage(self.folder).free // _SHARE)
            if not size:
                return
            with path.open("xb") as file:
                if hasattr(os, "posix_fallocate"):
                    os.posix_fallocate(file.fileno(), 0, size)
                else:
                    file.write(bytes(size))
        except OSError:
            with suppress(OSError):
                path.unlink()
            return
        self._path = path
        self._toucher.hold(path)

    def free(self) -> None:
        """Gives the reserved room on the disk back."""
        if self._path is not None:
            self._toucher.leave(self._path)
            with suppress(OSError):
                self._path.unlink()
            self._path = None
