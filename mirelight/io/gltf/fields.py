"""One JSON object of a glTF file that knows where it stands, so that every complaint names its field."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from mirelight.base.errors import InputError

Bytes = NDArray[np.uint8]  # (n,) raw contents of a buffer or view

_KINDS = {dict: "an object", list: "an array", str: "a string", bool: "true or false", type(None): "null"}


@dataclass(frozen=True, slots=True)
class Fields:
    """A JSON object with its file and position. Every getter raises InputError naming file and field. A field that is
    null is one that is not there, as exporters write it for what they do not have; but an index or count is none."""

    file: Path
    where: str  # e.g. "nodes[3].extensions"; empty at the top
    values: Mapping[str, Any]

    def at(self, name: str) -> str:
        """Position of a field of this object, for messages."""
        return f"{self.where}.{name}" if self.where else name

    def fail(self, name: str, found: str, remedy: str = "") -> InputError:
        """The error to raise about one field (an empty name: this object)."""
        return InputError(self.file, found, remedy, field=self.at(name) if name else self.where)

    def __contains__(self, name: str) -> bool:
        return self.values.get(name) is not None

    @overload
    def integer(self, name: str, default: int = ..., *, low: int = ..., high: int = ...) -> int: ...
    @overload
    def integer(self, name: str, default: None, *, low: int = ..., high: int = ...) -> int | None: ...
    def integer(self, name: str, default: int | None = -1, *, low: int = 0, high: int = 2**53) -> int | None:
        """An integer in [low, high]. The default of -1 means that the field must be there."""
        if name not in self.values:
            if default == -1:
                raise self.fail(name, "missing")
            return default
        value = self.values[name]
        if isinstance(value, float) and value.is_integer():
            value = int(value)  # JSON has no integers; some writers print 3.0
        if not isinstance(value, int) or isinstance(value, bool):
            raise self.fail(name, f"{_shown(value)}, expected an integer")
        if not low <= value <= high:
            raise self.fail(name, f"{_shown(value)}, expected {low} to {high}")
        return value

    def number(self, name: str, default: float | None = None) -> float:
        """A finite number. Without a default the field must be there."""
        if name not in self:
            if default is None:
                raise self.fail(name, "missing" if name not in self.values else "null, expected a number")
            return default
        return self._finite(name, self.values[name])

    def vector(self, name: str, length: int, default: Sequence[float] | None = None) -> NDArray[np.float64]:
        """(length,) float64 of finite numbers. Without a default the field must be there."""
        if name not in self and default is not None:
            return np.asarray(default, dtype=np.float64)
        value = self._list(name)
        if len(value) != length:
            raise self.fail(name, f"{len(value)} numbers, expected {length}")
        return np.array([self._finite(f"{name}[{i}]", x) for i, x in enumerate(value)], dtype=np.float64)

    def text(self, name: str, default: str | None = None) -> str:
        """A string. Without a default the field must be there."""
        if name not in self and default is not None:
            return default
        value = self.values.get(name)
        if not isinstance(value, str):
            raise self.fail(name, "missing" if name not in self.values else f"{_shown(value)}, expected a string")
        return value

    def flag(self, name: str) -> bool:
        """A boolean, false where it is absent."""
        value = self.values[name] if name in self else False
        if not isinstance(value, bool):
            raise self.fail(name, f"{_shown(value)}, expected true or false")
        return value

    def child(self, name: str) -> Fields:
        """The object under `name`, empty where it is absent."""
        value = self.values[name] if name in self else {}
        if not isinstance(value, dict):
            raise self.fail(name, f"{_shown(value)}, expected an object")
        return Fields(self.file, self.at(name), value)

    def children(self, name: str) -> tuple[Fields, ...]:
        """The objects in the array under `name`, none where it is absent."""
        found = []
        for i, value in enumerate(self._list(name) if name in self else ()):
            if not isinstance(value, dict):
                raise self.fail(f"{name}[{i}]", f"{_shown(value)}, expected an object")
            found.append(Fields(self.file, self.at(f"{name}[{i}]"), value))
        return tuple(found)

    def integers(self, name: str, *, high: int = 2**53) -> tuple[int, ...]:
        """The integers in the array under `name`, none where it is absent."""
        values = self._list(name) if name in self else []
        for i, value in enumerate(values):
            if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value <= high:
                raise self.fail(f"{name}[{i}]", f"{_shown(value)}, expected an integer from 0 to {high}")
        return tuple(values)

    def texts(self, name: str) -> tuple[str, ...]:
        """The strings in the array under `name`, none where it is absent."""
        values = self._list(name) if name in self else []
        for i, value in enumerate(values):
            if not isinstance(value, str):
                raise self.fail(f"{name}[{i}]", f"{_shown(value)}, expected a string")
        return tuple(values)

    def indices(self, name: str) -> dict[str, int]:
        """The object under `name` as names and non-negative integers (mesh attributes), empty where it is absent."""
        entry = self.child(name)
        return {key: entry.integer(key) for key in entry.values}

    def extension(self, name: str) -> Fields | None:
        """This object's extension of that name, or None."""
        extensions = self.child("extensions")
        return extensions.child(name) if name in extensions else None

    def _list(self, name: str) -> list[Any]:
        value = self.values.get(name)
        if not isinstance(value, list):
            raise self.fail(name, "missing" if name not in self.values else f"{_shown(value)}, expected an array")
        return value

    def _finite(self, name: str, value: Any) -> float:
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise self.fail(name, f"{_shown(value)}, expected a number")
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
        if not math.isfinite(number):
            raise self.fail(name, f"{_shown(value)}, expected a finite number")
        return number


def _shown(value: object) -> str:
    """A short description of a JSON value for a message."""
    if isinstance(value, (dict, list, type(None))):
        return _KINDS[type(value)]
    text = repr(value) if not isinstance(value, int) or abs(value) < 10**20 else "a huge integer"
    return text if len(text) <= 40 else text[:37] + "..."
