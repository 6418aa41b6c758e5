"""A file of named arrays that is mapped into memory, so that what is looked at is read once, and shared.

A line that names the format, one with a checksum of the next, one of JSON (names, types, shapes, places, what the
writer says of them, and a checksum of all that follows), then the arrays, each at a multiple of 64 bytes. The checksums
are CRC-32, which is as fast as memory and finds what disks do to files (one bit, or a block); nobody is kept from
forging one. Every byte counts into one of the two, so a file that has changed anywhere is never used.

Files of the first version hold no checksums; they are read, and their values looked at instead.
"""

from __future__ import annotations

import json
import mmap
import re
import zlib
from collections.abc import Mapping
from io import BufferedReader
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirelight.io.atomic import atomic_path
from mirelight.io.safety import open_file
from mirelight.pipeline.codecs import Packed

_ALIGN = 64
_LARGEST = 1e30
_LONGEST_HEAD = 1 << 24  # bytes
_MAGIC = b"mirelight arrays 2\n"
_MAGIC_1 = b"mirelight arrays 1\n"
_PLAIN = re.compile(r"[<|][biuf][1248]")  # types


def write_arrays(path: Path, arrays: Mapping[str, NDArray[Any]], about: Mapping[str, Any], maker: str = "") -> None:
    """Write a file of arrays of any shape, whole or not at all.

    Args:
        path: where to.
        arrays: by name, of numbers or booleans.
        about: JSON values that the reader is given.
        maker: the job whose file it is, for :func:`maker_of`.

    Raises:
        OutputError: it cannot be written.
    """
    table, offset, crc = {}, 0, 0
    for name, values in arrays.items():
        table[name] = (values.dtype.str, values.shape, offset)
        offset += -(-values.nbytes // _ALIGN) * _ALIGN
        for part in _parts(values):
            crc = zlib.crc32(part, crc)
    said = {"arrays": table, "about": about, "bytes": offset, "maker": maker, "crc": crc}
    head = json.dumps(said, sort_keys=True).encode()
    start = _start(len(_MAGIC) + 9 + len(head) + 1)
    head += b" " * (start - len(_MAGIC) - 9 - len(head) - 1) + b"\n"  # what fills up counts into its checksum, too
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        file.write(_MAGIC + f"{zlib.crc32(head):08x}\n".encode() + head)
        for values in arrays.values():
            for part in _parts(values):
                file.write(part)


def read_arrays(path: Path) -> Packed:
    """The arrays of a file, mapped into memory.

    Raises:
        ValueError, KeyError, TypeError, OSError: missing, damaged or cut off.
    """
    with open_file(path) as file:
        said, start, checked = _head(file)
        if path.stat().st_size != start + said["bytes"]:
            raise ValueError("cut off")
        mapped = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    if checked and zlib.crc32(memoryview(mapped)[start:]) != said["crc"]:
        raise ValueError("its bytes are others than were written")
    arrays = {
        name: _mapped(mapped, dtype, tuple(shape), start + offset)
        for name, (dtype, shape, offset) in said["arrays"].items()
    }
    if not all(map(is_sound, arrays.values())):
        raise ValueError("not finite")
    return Packed(arrays, said["about"])


def maker_of(path: Path) -> str:
    """Who wrote a file; empty where that is not known."""
    try:
        with open_file(path) as file:
            return str(_head(file)[0]["maker"])
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return ""


def is_sound(values: NDArray[Any]) -> bool:
    """Whether no value, in any shape, is NaN, infinite or so large that its sums would be: none is ever kept, so the
    file is damaged.

    Two passes at the speed of memory.
    """
    if values.dtype.kind != "f" or not values.size:
        return True
    return bool(values.min() > -_LARGEST and values.max() < _LARGEST)


def _head(file: BufferedReader) -> tuple[dict[str, Any], int, bool]:
    """What a file says of itself, where its arrays begin, and whether there are checksums."""
    magic = file.read(len(_MAGIC))
    if magic not in (_MAGIC, _MAGIC_1):
        raise ValueError("not a file of arrays")
    checked = magic == _MAGIC
    crc = file.read(9) if checked else b""
    head = file.readline(_LONGEST_HEAD)
    if checked and f"{zlib.crc32(head):08x}\n".encode() != crc:
        raise ValueError("its head is another than was written")
    said = json.loads(head)
    if not isinstance(said, dict):
        raise ValueError("not a file of arrays")
    return said, _start(len(magic) + len(crc) + len(head)), checked


def _start(length: int) -> int:
    return -(-length // _ALIGN) * _ALIGN


def _parts(values: NDArray[Any]) -> tuple[memoryview | bytes, bytes]:
    """The bytes of an array, and what fills up to the next one."""
    whole = np.ascontiguousarray(values).data.cast("B") if values.size else b""
    return whole, bytes(-values.nbytes % _ALIGN)


def _mapped(mapped: mmap.mmap, dtype: str, shape: tuple[int, ...], offset: int) -> NDArray[Any]:
    if not _PLAIN.fullmatch(dtype):
        raise ValueError("not numbers")
    count = int(np.prod(shape, dtype=np.int64))
    if not count:
        return np.zeros(shape, dtype)
    return np.frombuffer(mapped, dtype, count, offset).reshape(shape)
