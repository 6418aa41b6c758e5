"""What takes long to make of a capture, kept for all commands of a user: proxies made from splats, estimates of the
light that splats were captured under, guesses of where they were taken from, and what mirrors show.

Files are named by their keys (`mirelight.pipeline.keys`) in a folder of the user and carry a digest. They appear whole
or not at all, so any number of processes may share the folder. Where it cannot be used nothing is kept, and nothing is
said: an output folder keeps the same things for itself.
"""

from __future__ import annotations

import hashlib
import os
import platform
import zipfile
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from mirelight.base.errors import OutputError
from mirelight.io import owner
from mirelight.io.atomic import owner_of, write_file
from mirelight.io.safety import open_file
from mirelight.pipeline.codecs import Codec, Packed

VARIABLE = "MIRELIGHT_CACHE_DIR"
MOST = 2**30  # bytes; what was not used for longest goes
_SUFFIX = ".kept"
_MAGIC = b"mirelight kept 1 "
_BROKEN = (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile)

Arrays = dict[str, NDArray[np.generic]]
T = TypeVar("T")


def folder() -> Path | None:
    """The folder of this user, there or not; None where a machine has no such place."""
    named = os.environ.get(VARIABLE)
    if named:
        return Path(named)
    try:
        return _caches() / "mirelight" / "made"
    except RuntimeError:  # nobody's home
        return None


def _caches() -> Path:
    """Where programs of this platform keep what can be made again. Raises RuntimeError: the user has no home."""
    system = platform.system()
    if system == "Darwin":
        return Path.home() / "Library" / "Caches"
    if system == "Windows":
        local = os.environ.get("LOCALAPPDATA")
        return Path(local) if local else Path.home() / "AppData" / "Local"
    named = os.environ.get("XDG_CACHE_HOME", "")
    return Path(named) if Path(named).is_absolute() else Path.home() / ".cache"


@dataclass(frozen=True, slots=True)
class _Entry:
    path: Path
    used: float  # seconds since the epoch
    bytes: int


class UserCache:
    """Artefacts of scenes by key.

    Args:
        most: bytes that it may hold.
    """

    def __init__(self, most: int = MOST) -> None:
        self.folder, self.most = folder(), most

    def get(self, key: str, codec: Codec[T]) -> T | None:
        """A kept artefact; None where there is none, or it is damaged."""
        found = self._read(key)
        try:
            return None if found is None else codec.unpack(Packed(found))
        except _BROKEN:
            return None

    def put(self, key: str, value: T, codec: Codec[T]) -> None:
        """Keep an artefact, where that can be. It is told in arrays alone."""
        self._keep(key, codec.pack(value).arrays)

    def held(self) -> tuple[int, int]:
        """How many things it holds, and their bytes."""
        there = self._entries()
        return len(there), sum(x.bytes for x in there)

    def clear(self) -> None:
        """Remove all that it holds."""
        for entry in self._entries():
            with suppress(OSError):
                entry.path.unlink()

    def _path(self, key: str) -> Path | None:
        return None if self.folder is None else self.folder / f"{key}{_SUFFIX}"

    def _read(self, key: str) -> Arrays | None:
        path = self._path(key)
        if path is None:
            return None
        try:
            with open_file(path) as file:
                head, rest = file.readline(len(_MAGIC) + 65), file.read()
            if head != _MAGIC + hashlib.sha256(rest).hexdigest().encode() + b"\n":
                return None
            with np.load(BytesIO(rest), allow_pickle=False) as found:
                arrays = {name: found[name] for name in found.files}
        except _BROKEN:
            return None
        with suppress(OSError):
            os.utime(path)  # used now
        return arrays

    def _keep(self, key: str, arrays: Mapping[str, NDArray[np.generic]]) -> None:
        path = self._path(key)
        if path is None:
            return
        packed = BytesIO()
        np.savez(packed, allow_pickle=False, **arrays)
        content = packed.getvalue()
        with suppress(OSError, OutputError):
            path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            write_file(path, _MAGIC + hashlib.sha256(content).hexdigest().encode() + b"\n" + content)
            self._tidy()

    def _entries(self) -> list[_Entry]:
        """What there is, what was used last first."""
        found: list[_Entry] = []
        if self.folder is not None:
            with suppress(OSError), os.scandir(self.folder) as entries:
                for entry in entries:
                    if entry.name.endswith(_SUFFIX) and not entry.name.startswith("."):
                        with suppress(OSError):  # another process has just removed it
                            status = entry.stat()
                            found.append(_Entry(Path(entry.path), status.st_mtime, status.st_size))
        return sorted(found, key=lambda x: -x.used)

    def _tidy(self) -> None:
        """Remove what is too much, and what killed processes of this machine left half written."""
        if self.folder is None:
            return
        kept = 0
        for entry in self._entries():
            kept += entry.bytes
            if kept > self.most:
                with suppress(OSError):
                    entry.path.unlink()
        with suppress(OSError):
            for path in self.folder.glob(f".*{_SUFFIX}"):
                holder = owner_of(path.name)
                if holder is not None and owner.runs(holder) is False:
                    with suppress(OSError):
                        path.unlink()
