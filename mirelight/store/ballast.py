"""Room on the disk that is given back when it is full, so that the journal's last line can still be written."""

from __future__ import annotations

import os
import secrets
from contextlib import suppress
from pathlib import Path

from mirelight.io import owner

_BYTES = 16 * 2**20


class Ballast:
    """A file of this process's own. Its name tells whose it is, so that a killed process's is cleared away."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._path: Path | None = None

    def take(self) -> None:
        """Take the room, where there is that much and it is not held yet."""
        if self._path is not None:
            return
        path = self.folder / f".ballast~{owner.token()}-{secrets.token_hex(6)}"
        try:
            with path.open("xb") as file:
                if hasattr(os, "posix_fallocate"):
                    os.posix_fallocate(file.fileno(), 0, _BYTES)
                else:
                    file.write(bytes(_BYTES))
        except OSError:
            with suppress(OSError):
                path.unlink()
            return
        self._path = path

    def free(self) -> None:
        """Give the room back."""
        if self._path is not None:
            with suppress(OSError):
                self._path.unlink()
            self._path = None
