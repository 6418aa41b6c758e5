"""What every reader of untrusted files needs: paths that stay inside their folder, checks before memory is taken."""

from __future__ import annotations

import errno
import json
import os
import stat
from io import BufferedReader
from pathlib import Path, PurePosixPath
from typing import Any

from mirelight.base.errors import InputError
from mirelight.base.machine import free_memory

BRIGHTEST = 1e12  # no light, emission or pixel of a map is brighter; its square is still far from float32's end

_LONGEST_NAME = 255  # bytes, of a file or folder


class NotAFileError(OSError):
    """What should be a file is a folder, a pipe or a device."""


def existing(path: str | Path) -> Path:
    """`path` as a Path that leads to a file or a folder.

    Raises:
        InputError: nothing is there, or it is neither file nor folder (a device, a pipe).
    """
    path = Path(path)
    try:
        if path.is_file() or path.is_dir():
            return path
        found = "no such file" if not path.exists() else "neither a file nor a folder"
    except (OSError, ValueError) as e:
        found = f"cannot be read ({getattr(e, 'strerror', None) or 'bad path'})"
    raise InputError(path, found, "check the path")


def open_file(path: Path) -> BufferedReader:
    """The file, open for reading. A pipe is not waited for, and a device has no end.

    Raises:
        NotAFileError: it is a folder, a pipe or a device.
        OSError, ValueError: it cannot be opened.
    """
    if stat.S_ISREG(path.stat().st_mode):  # some devices act on being opened
        number = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
        if stat.S_ISREG(os.fstat(number).st_mode):
            return os.fdopen(number, "rb")
        os.close(number)
    raise NotAFileError(errno.EINVAL, "not a file", str(path))


def read_file(path: Path) -> bytes:
    """The whole of a file that is left out where it cannot be read.

    Raises:
        OSError, ValueError: as for :func:`open_file`, or it is larger than a quarter of the memory that is free.
    """
    with open_file(path) as file:
        if os.fstat(file.fileno()).st_size > free_memory() // 4:
            raise OSError(errno.EFBIG, os.strerror(errno.EFBIG), str(path))
        return file.read()


def open_binary(path: Path) -> BufferedReader:
    """The file, open for reading.

    Raises:
        InputError: it cannot be opened, or is a folder, a pipe or a device (those are not waited for).
    """
    try:
        return open_file(path)
    except NotAFileError:
        raise InputError(path, "not a file", "a folder, a pipe or a device cannot be read; name a file") from None
    except (OSError, ValueError) as e:
        reason = getattr(e, "strerror", None) or "bad path"
        raise InputError(path, f"cannot be read ({reason})", "check the path and its permissions") from None


def read_whole(path: Path, what: str, times: float = 1.0) -> bytes:
    """The whole of a file, read only where memory has room for `times` its bytes.

    Raises:
        InputError: it cannot be read, or is too large; `what` names its content there.
    """
    with open_binary(path) as file:
        require_memory(path, int(os.fstat(file.fileno()).st_size * times), what)
        try:
            return file.read()
        except OSError as e:
            raise InputError(path, f"cannot be read ({e.strerror})") from None


def read_bytes(path: Path, limit: int) -> bytes:
    """The whole of a small file.

    Raises:
        InputError: it cannot be read, or is longer than `limit` bytes.
    """
    with open_binary(path) as file:
        try:
            size = file.seek(0, 2)
            file.seek(0)
            data = file.read(min(size, limit) + 1)
        except OSError as e:
            raise InputError(path, f"cannot be read ({e.strerror})") from None
    if len(data) > limit:
        raise InputError(path, f"more than {limit:,} bytes where that is the most expected", "the file is damaged")
    return data


def json_value(path: Path, data: bytes) -> Any:
    """The JSON value that the whole of a file is. Raises InputError: no JSON, or too deep."""
    try:
        return json.loads(data.decode("utf-8-sig"))
    except json.JSONDecodeError as e:
        raise InputError(path, f"bad JSON ({e.msg})", field=f"line {e.lineno}, column {e.colno}") from None
    except (UnicodeDecodeError, ValueError, RecursionError):
        raise InputError(path, "not UTF-8 JSON of sensible depth and numbers") from None


def json_object(text: Any) -> dict[str, Any] | None:
    """The JSON object in a text; None of anything else."""
    try:
        found = json.loads(text)
    except (TypeError, ValueError, RecursionError):
        return None
    return found if isinstance(found, dict) else None


def contained(folder: Path, name: str, file: Path, field: str) -> Path:
    """The path of `name`, a relative path with forward slashes written in `file`, inside `folder`.

    Symbolic links are followed before the check.

    Raises:
        InputError: `name` is empty, absolute, too long, or leaves the folder.
    """
    shown = _shown(name)
    relative = PurePosixPath(name)
    if "\0" in name or "\\" in name or relative.is_absolute() or not relative.parts or ":" in relative.parts[0]:
        raise InputError(file, f"{shown} is not a relative path", "put the file beside this one", field=field)
    if any(len(os.fsencode(part)) > _LONGEST_NAME for part in relative.parts):
        raise InputError(file, f"{shown} is too long for a file name", "the file is damaged", field=field)
    try:
        base = folder.resolve()
        target = (base / relative).resolve()
    except (OSError, RuntimeError):
        raise InputError(file, f"{shown} cannot be followed", field=field) from None
    if not target.is_relative_to(base):
        raise InputError(file, f"{shown} leaves the folder of the file", "put it beside this one", field=field)
    return target


def neighbour(name: str, file: Path, field: str) -> Path:
    """The existing file that `name`, written in `file`, leads to, in the folder of `file` or below.

    Raises:
        InputError: as for :func:`contained`, or there is no such file.
    """
    target = contained(file.parent, name, file, field)
    try:
        there = target.is_file()
    except OSError:  # a name too long to exist
        there = False
    if not there:
        raise InputError(file, f"there is no file {_shown(name)}", "the capture is incomplete", field=field)
    return target


def _shown(name: str) -> str:
    return repr(name if len(name) <= 60 else name[:57] + "...")


def require_memory(file: Path, needed: int, what: str) -> None:
    """Refuse what would not fit before it is allocated.

    Raises:
        InputError: `needed` bytes are more than the machine has left; names both.
    """
    free = free_memory()
    if needed > free:
        found = f"{what} take {needed / 2**30:,.1f} GiB, {free / 2**30:,.1f} GiB are free"
        raise InputError(file, found, "use a smaller file or a machine with more memory")
