"""What torch.save wrote, without torch and without running the pickle in it.

A file is a ZIP archive, nothing in it compressed: NAME/data.pkl, a pickle in which each tensor refers to a storage, and
NAME/data/KEY, its numbers (pytorch.org, "Serialization semantics"). A pickle may name any function of any package and
have it called. Here the few that stand for tensors and dictionaries are known, by objects of this module; all others
give an object that swallows what it is given.
"""

from __future__ import annotations

import io
import pickle
import pickletools
import struct
import zipfile
from collections import OrderedDict
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mirelight.base.errors import InputError
from mirelight.model import F32

_MOST_BYTES = 1 << 26  # of the pickle: it holds names and shapes
_HEADER = 30  # bytes of a member's header before its name
_STORAGES = {"FloatStorage": "<f4", "DoubleStorage": "<f8", "HalfStorage": "<f2"}


@dataclass(frozen=True, slots=True)
class Tensor:
    """Where the numbers of a tensor stand; :meth:`rows` maps them."""

    path: Path
    start: int  # bytes from the beginning of the file
    kind: str  # numpy's
    shape: tuple[int, ...]

    def rows(self, first: int, end: int) -> F32:
        """(n, ...) those from `first` to `end` along the first axis. Raises InputError: the file ends before them."""
        row = int(np.prod(self.shape[1:], dtype=np.int64))
        kind = np.dtype(self.kind)
        try:
            with self.path.open("rb") as file:
                file.seek(self.start + first * row * kind.itemsize)
                data = file.read((end - first) * row * kind.itemsize)
        except OSError as e:
            raise InputError(self.path, f"cannot be read ({e.strerror})") from None
        if len(data) < (end - first) * row * kind.itemsize:
            raise InputError(self.path, "ends within a tensor", "the file is truncated or damaged")
        with np.errstate(over="ignore"):
            return np.frombuffer(data, kind).reshape(end - first, *self.shape[1:]).astype(np.float32)


def load(path: Path) -> dict[str, Any]:
    """The dictionary that was saved: of dictionaries, lists, numbers, texts and :class:`Tensor`.

    Raises:
        InputError: damaged, or something else than a dictionary was saved.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            members = {x.filename: x for x in archive.infolist()}
            name = next((x for x in members if x.endswith("/data.pkl")), None)
            if name is None or members[name].file_size > _MOST_BYTES:
                raise InputError(path, "no data.pkl in it that can be read", "is it a checkpoint of a training?")
            data = archive.read(name)
        _refuse_memo(path, data)
        found = _Reader(path, members, name.removesuffix("data.pkl"), data).load()
    except InputError:
        raise
    except Exception as e:  # damaged archives and pickles raise errors of a dozen types
        said = f"not a readable checkpoint ({str(e)[:80] or type(e).__name__})"
        raise InputError(path, said, "the file is truncated or damaged") from None
    if not isinstance(found, dict):
        raise InputError(path, "no dictionary was saved in it", "is it a checkpoint of a training?")
    return found


def _refuse_memo(path: Path, data: bytes) -> None:
    """Raises InputError: a pickle that asks for a table larger than itself."""
    for code, argument, _ in pickletools.genops(data):
        if code.name == "LONG_BINPUT" and isinstance(argument, int) and argument > len(data):
            raise InputError(path, "a pickle that asks for too much memory", "the file is damaged")


class _Swallows:
    """Stands for what is not known; takes anything and does nothing."""

    def __new__(cls, *_: Any, **__: Any) -> _Swallows:
        return object.__new__(cls)

    def __call__(self, *_: Any, **__: Any) -> _Swallows:
        return self

    def __setstate__(self, _: Any) -> None:
        pass

    def __setitem__(self, _: Any, __: Any) -> None:
        pass

    def append(self, _: Any) -> None:
        """Nothing."""

    def extend(self, _: Any) -> None:
        """Nothing."""

    def add(self, _: Any) -> None:
        """Nothing."""


@dataclass(frozen=True, slots=True)
class _Storage:
    kind: str
    start: int
    count: int


class _Reader(pickle.Unpickler):
    def __init__(self, path: Path, members: dict[str, zipfile.ZipInfo], folder: str, data: bytes) -> None:
        super().__init__(io.BytesIO(data))
        self._path, self._members, self._folder = path, members, folder

    def find_class(self, module: str, name: str) -> Any:
        """What a name of the pickle stands for here."""
        if (module, name) == ("collections", "OrderedDict"):
            return OrderedDict
        if (module, name) == ("torch._utils", "_rebuild_tensor_v2"):
            return self._tensor
        if (module, name) == ("torch._utils", "_rebuild_parameter"):
            return _first
        return _STORAGES.get(name, _Swallows) if module == "torch" else _Swallows

    def persistent_load(self, pid: Any) -> Any:
        """The storage that a tensor refers to; None: of numbers that no splat has."""
        _, kind, key, _, count = pid
        if not isinstance(kind, str):
            return None
        return _Storage(kind, self._start(self._members[f"{self._folder}data/{key}"]), int(count))

    def _start(self, member: zipfile.ZipInfo) -> int:
        """Bytes from the beginning of the file to a member's own."""
        if member.compress_type != zipfile.ZIP_STORED:
            raise InputError(self._path, "a compressed archive", "save it again with torch.save")
        with self._path.open("rb") as file:
            file.seek(member.header_offset)
            name, extra = struct.unpack_from("<2H", file.read(_HEADER), 26)
        return int(member.header_offset + _HEADER + name + extra)

    def _tensor(self, storage: Any, offset: int, size: tuple[int, ...], stride: tuple[int, ...], *_: Any) -> Any:
        """A tensor whose numbers lie one after the other, as those of parameters do; others stand for nothing here."""
        along, expected = 1, list[int]()
        for length in reversed(size):
            expected.insert(0, along)
            along *= max(length, 1)
        apart = [a for a, length in zip(stride, size, strict=True) if length > 1]
        if not isinstance(storage, _Storage) or apart != [a for a, n in zip(expected, size, strict=True) if n > 1]:
            return _Swallows()
        if offset < 0 or min(size, default=1) < 0 or offset + int(np.prod(size, dtype=object)) > storage.count:
            raise InputError(self._path, "a tensor past the end of its numbers", "the file is damaged")
        start = storage.start + offset * np.dtype(storage.kind).itemsize
        return Tensor(self._path, start, storage.kind, tuple(size))


def _first(value: Any, *_: Any) -> Any:
    return value
