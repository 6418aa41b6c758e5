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
    found: list[bytes | memoryview] = []
    _feed(found, values)
    sha = hashlib.sha256()
    for part in found:
        sha.update(part)
    return sha.hexdigest()


def _feed(found: list[bytes | memoryview], value: object) -> None:
    """Add the bytes that stand for a value: atoms, each after its kind and length, so that no two sequences of atoms
    give the same bytes."""
    kind = type(value)
    if kind is str or kind is float or kind is int or kind is bool or value is None:  # nearly all of them
        _atom(found, kind.__name__, repr(value).encode())
    elif names := _names(value):
        _atom(found, "type", kind.__name__.encode())
        _feed(found, {name: getattr(value, name) for name in names})
    elif isinstance(value, tuple | list):
        _atom(found, "list", b"%d" % len(value))
        for item in value:
            _feed(found, item)
    elif isinstance(value, dict):
        _atom(found, "dict", b"%d" % len(value))
        for key in sorted(value):
            _feed(found, key)
            _feed(found, value[key])
    elif isinstance(value, np.ndarray):
        array = np.ascontiguousarray(value)
        _atom(found, f"array {array.dtype.str} {array.shape}", array.data.cast("B") if array.size else b"")
    elif isinstance(value, np.generic):
        _feed(found, value.item())
    elif isinstance(value, float):
        _feed(found, float(value))
    elif isinstance(value, str | int | Path):
        _atom(found, kind.__name__, repr(str(value) if isinstance(value, Path) else value).encode())
    elif isinstance(value, Digested):  # last of all: it takes longer than the rest together
        _atom(found, "digest", value.digest.encode())
    else:
        raise TypeError(f"no digest for {kind.__name__}")


def _names(value: object) -> tuple[str, ...]:
    """The fields of a dataclass; none of other values."""
    kind = type(value)
    if kind not in _NAMES:
        _NAMES[kind] = tuple(f.name for f in fields(kind)) if is_dataclass(kind) else ()
    return _NAMES[kind]


def _atom(found: list[bytes | memoryview], kind: str, content: bytes | memoryview) -> None:
    found.append(f"{kind} {len(content)}:".encode())
    found.append(content)
