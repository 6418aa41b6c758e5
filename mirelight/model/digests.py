"""SHA-256 over values of the model: what keys of finished work are made of."""

from __future__ import annotations

import hashlib
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np

_NAMES: dict[type, tuple[str, ...]] = {}  # of the fields of each type that was met


@runtime_checkable
class Digested(Protocol):
    """A value that knows its own digest, so that it need not be read to be told from others."""

    @property
    def digest(self) -> str:
        """SHA-256 (hex); equal digests mean equal values."""


def digest(*values: object) -> str:
    """SHA-256 (hex) over values of the model: dataclasses by field, arrays by type, shape and bytes.

    A new field of a type counts without a line being added here. Equal digests mean equal values; NumPy's scalars count
    as the plain numbers that they are.

    Raises:
        TypeError: a value of a type that the model does not use.
    """
    sha = hashlib.sha256()
    _feed(sha, values)
    return sha.hexdigest()


def _feed(sha: hashlib._Hash, value: object) -> None:
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and type(value) is not float:
        value = float(value)
    if value is None or isinstance(value, str | bool | int | float | Path):
        _atom(sha, type(value).__name__, repr(str(value) if isinstance(value, Path) else value).encode())
    elif isinstance(value, np.ndarray):
        array = np.ascontiguousarray(value)
        _atom(sha, f"array {array.dtype.str} {array.shape}", array.data.cast("B") if array.size else b"")
    elif isinstance(value, tuple | list):
        _atom(sha, "list", str(len(value)).encode())
        for item in value:
            _feed(sha, item)
    elif isinstance(value, dict):
        _atom(sha, "dict", str(len(value)).encode())
        for key in sorted(value):
            _feed(sha, key)
            _feed(sha, value[key])
    elif names := _names(value):
        _atom(sha, "type", type(value).__name__.encode())
        _feed(sha, {name: getattr(value, name) for name in names})
    elif isinstance(value, Digested):  # last of all: it takes longer than the rest together
        _atom(sha, "digest", value.digest.encode())
    else:
        raise TypeError(f"no digest for {type(value).__name__}")


def _names(value: object) -> tuple[str, ...]:
    """The fields of a dataclass; none of other values."""
    kind = type(value)
    if kind not in _NAMES:
        _NAMES[kind] = tuple(f.name for f in fields(kind)) if is_dataclass(kind) else ()
    return _NAMES[kind]


def _atom(sha: hashlib._Hash, kind: str, content: bytes | memoryview) -> None:
    """Kind and length go first, so that no two sequences of atoms give the same bytes."""
    sha.update(f"{kind} {len(content)}:".encode())
    sha.update(content)
