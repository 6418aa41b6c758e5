"""Which frames a folder holds: what its journal says, held against the files themselves."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Protocol

from mirelight.io import image
from mirelight.io.safety import open_file
from mirelight.store.journal import FileRow, Row


class Filed(Protocol):
    """A frame by its name and the keys of its files; `mirelight.pipeline.plan.FrameTask` is one."""

    @property
    def name(self) -> str:
        """ "camera.lighting"."""

    @property
    def files(self) -> Mapping[str, str]:
        """By suffix the key of each file."""


class Index:
    """What a folder held when it was looked at: files by name, size and time, and what the journal says of them."""

    def __init__(self, folder: Path, rows: Iterator[Row]) -> None:
        self._there: dict[str, tuple[int, int]] = {}
        self._rows: dict[tuple[str, str], list[FileRow]] = {}
        self._folder = folder
        try:
            with os.scandir(folder) as entries:
                for entry in entries:
                    with suppress(OSError):  # a link that leads nowhere
                        status = entry.stat()
                        self._there[entry.name] = status.st_size, status.st_mtime_ns
        except OSError:
            pass
        self.add(rows)

    def add(self, rows: Iterator[Row]) -> None:
        """Take what the journal says besides."""
        for row in rows:
            for suffix, file in row.files.items():
                self._rows.setdefault((row.frame + suffix, file.key), []).append(file)

    def has(self, task: Filed) -> bool:
        """Whether all files of a frame are there: as the journal knows them, else they are asked themselves."""
        return all(self._known(task.name + suffix, key) for suffix, key in task.files.items()) or all(
            self.has_file(self._folder / (task.name + suffix), key) for suffix, key in task.files.items()
        )

    def rows_of(self, name: str, key: str) -> list[FileRow]:
        """What the journal says of a file of that name and key, as often as it was written."""
        return self._rows.get((name, key), [])

    def _known(self, name: str, key: str) -> bool:
        seen = self._there.get(name)
        return any((row.bytes, row.mtime_ns) == seen for row in self._rows.get((name, key), ()))

    def has_file(self, path: Path, key: str) -> bool:
        """Whether a file is there with that key and whole. A file whose size or time differ from what the journal says
        is read, and must have the journal's digest; one that the journal does not know must carry the key
        and be what its own digest says."""
        try:
            status = path.stat()
        except OSError:
            return False
        rows = self._rows.get((path.name, key), [])
        if any((row.bytes, row.mtime_ns) == (status.st_size, status.st_mtime_ns) for row in rows):
            return True
        return image.read_fingerprint(path) == key and (is_one_of(path, rows) if rows else image.is_intact(path))


def is_one_of(path: Path, rows: Collection[FileRow]) -> bool:
    """Whether a file is, to the bit, one that was written. What has another size is not read."""
    try:
        size = path.stat().st_size
    except OSError:
        return False
    digests = {row.sha256 for row in rows if row.bytes == size}
    return bool(digests) and digest_of(path) in digests


def row_of(path: Path, key: str) -> FileRow:
    """What the journal says of a file as it is."""
    status = path.stat()
    return FileRow(key, status.st_size, status.st_mtime_ns, digest_of(path))


def digest_of(path: Path) -> str:
    """SHA-256 (hex) of a file; empty where it cannot be read."""
    try:
        with open_file(path) as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        return ""
