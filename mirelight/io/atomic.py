"""Files that appear whole or not at all."""

from __future__ import annotations

import errno
import os
import re
import secrets
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from mirelight.base.errors import OutputError
from mirelight.io import owner

_REASONS = {
    errno.ENOSPC: "the disk is full",
    errno.EDQUOT: "the disk quota is used up",
    errno.EFBIG: "the file is larger than this system allows",
    errno.EACCES: "no permission to write there",
    errno.EPERM: "no permission to write there",
    errno.EROFS: "the file system is read-only",
    errno.ENOENT: "the folder does not exist",
    errno.ENOTDIR: "its folder is not a folder",
    errno.EEXIST: "it is a file, no folder",
    errno.EISDIR: "it is a folder",
    errno.ENAMETOOLONG: "the name is too long",
}


_TEMPORARY = re.compile(r"~([0-9a-f]{10}-\d+(?:-t\d+)?)-[0-9a-f]{8,}(?:\.[^.]*)?$")
_STALE = 600.0  # seconds after which another machine's temporary file counts as left behind


@contextmanager
def atomic_path(path: str | Path) -> Iterator[Path]:
    """A temporary path to write to, moved to `path` when the block ends well and removed when it does not.

    The temporary file stands in the same folder with the same suffix, empty at first; its name says which process it
    belongs to, so that what a killed one left can be told (:func:`owner_of`). Bytes reach the disk before the name
    does, so a crash leaves the old file or the new one.

    Args:
        path: the file that shall appear; its folder must exist.

    Raises:
        OutputError: the folder is missing or cannot be written, the disk is full, or `path` is a folder, a pipe or a
            device.
    """
    path = Path(path)
    try:
        if path.is_dir():
            raise OutputError(f"{path}: cannot be written (it is a folder)")
        if path.exists() and not path.is_file():  # renaming onto it would take the device's place
            raise OutputError(f"{path}: cannot be written (it is a pipe or a device)")
        temporary = path.with_name(f".{path.stem[:80]}~{owner.token()}-{secrets.token_hex(6)}{path.suffix}")
        temporary.touch(exist_ok=False)
    except (OSError, ValueError) as e:  # ValueError: a NUL in the name
        raise output_error(path, e) from None
    try:
        yield temporary
        _publish(temporary, path)
    except OSError as e:
        raise output_error(path, e) from None
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def write_file(path: str | Path, content: str | bytes) -> None:
    """Write a whole file, text as UTF-8, as :func:`atomic_path` does, and with its errors."""
    with atomic_path(path) as temporary:
        temporary.write_bytes(content.encode() if isinstance(content, str) else content)


def owner_of(name: str) -> str | None:
    """The token (`mirelight.io.owner`) of the process that a temporary file's name belongs to; None of other names."""
    found = _TEMPORARY.search(name) if name.startswith(".") else None
    return found[1] if found else None


def clear(folder: Path) -> None:
    """Remove temporary files in a folder whose process has ended; another machine's once they are old by the folder's
    own clock. What cannot be removed stays."""
    with suppress(OSError), os.scandir(folder) as entries:
        found = [(Path(entry.path), holder) for entry in entries if (holder := owner_of(entry.name)) is not None]
        if not found:
            return
        with tempfile.TemporaryFile(dir=folder) as probe:
            now = os.fstat(probe.fileno()).st_mtime
        for path, holder in found:
            running = owner.runs(holder)
            with suppress(OSError):
                if running is False or (running is None and now - path.lstat().st_mtime > _STALE):
                    path.unlink()


def output_error(path: str | Path, error: OSError | ValueError) -> OutputError:
    """The error to raise for a file that the system refused to write."""
    reason = str(error)
    if isinstance(error, OSError):
        reason = _REASONS.get(error.errno or 0) or error.strerror or reason
    return OutputError(f"{path}: cannot be written ({reason}); nothing half-written was left")


def _publish(temporary: Path, path: Path) -> None:
    with temporary.open("rb") as file:
        os.fsync(file.fileno())
    temporary.replace(path)
