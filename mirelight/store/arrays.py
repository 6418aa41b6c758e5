"""A file of named arrays that is mapped into memory, so that only what is looked at is read.

A line of JSON (names, types, shapes, places, and what the writer says of them), then the arrays, each at a multiple of
64 bytes. `.npz` would do the same, but is read whole and checked byte by byte, which costs more than mixing the light
in it.
"""

from __future__ import annotations

import json
import mmap
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirelight.io.atomic import atomic_path
from mirelight.io.safety import open_file

_ALIGN = 64
_LARGEST = 1e30
_MAGIC = b"mirelight arrays 1\n"


@dataclass(frozen=True, slots=True, eq=False)
class Arrays:
    """The content of a file."""

    arrays: Mapping[str, NDArray[Any]]  # read-only
    about: Mapping[str, Any]  # JSON values


def write_arrays(path: Path, arrays: Mapping[str, NDArray[Any]], about: Mapping[str, Any]) -> None:
    """Write a file, whole or not at all.

    Raises:
        OutputError: it cannot be written.
    """
    table, offset = {}, 0
    for name, values in arrays.items():
        table[name] = (values.dtype.str, values.shape, offset)
        offset += -(-values.nbytes // _ALIGN) * _ALIGN
    head = json.dumps({"arrays": table, "about": about, "bytes": offset}, sort_keys=True).encode() + b"\n"
    start = -(-(len(_MAGIC) + len(head)) // _ALIGN) * _ALIGN
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        file.write((_MAGIC + head).ljust(start, b"\0"))
        for values in arrays.values():
            file.write(np.ascontiguousarray(values).data.cast("B") if values.size else b"")
            file.write(bytes(-values.nbytes % _ALIGN))


def read_arrays(path: Path) -> Arrays:
    """Map a file.

    Raises:
        ValueError, KeyError, TypeError, OSError: missing, damaged or cut off.
    """
    with open_file(path) as file:
        if file.read(len(_MAGIC)) != _MAGIC:
            raise ValueError("not a file of arrays")
        head = file.readline(1 << 24)
        start = -(-(len(_MAGIC) + len(head)) // _ALIGN) * _ALIGN
        said = json.loads(head)
        if path.stat().st_size != start + said["bytes"]:
            raise ValueError("cut off")
        if not said["bytes"]:
            raise ValueError("empty")
        mapped = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    arrays = {
        name: np.frombuffer(mapped, dtype, int(np.prod(shape, dtype=np.int64)), start + offset).reshape(shape)
        for name, (dtype, shape, offset) in said["arrays"].items()
    }
    if not all(map(is_sound, arrays.values())):
        raise ValueError("not finite")
    return Arrays(arrays, said["about"])


def is_sound(values: NDArray[Any]) -> bool:
    """Whether no value is NaN, infinite or so large that its sums would be: none is ever kept, so the file is damaged.

    Two passes at the speed of memory.
    """
    if values.dtype.kind != "f" or not values.size:
        return True
    return bool(values.min() > -_LARGEST and values.max() < _LARGEST)
