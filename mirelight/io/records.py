"""Dataclasses as JSON values, and back by the types that their fields say: files may hold anything."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from functools import cache
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, TypeAlias, TypeVar, Union, cast, get_args, get_origin, get_type_hints

import numpy as np

from mirelight.model import LightBase

Key: TypeAlias = Annotated[str, "key"]  # names a kept file: what is none must lead nowhere
_ENDLESS = ("far", "range")  # fields that may be infinite, which JSON has as null
_T = TypeVar("_T")


def packed(value: Any) -> Any:
    """A value as JSON has it; a light says of which class it is. Numbers that JSON does not have are null."""
    if is_dataclass(value):
        own = {field.name: packed(getattr(value, field.name)) for field in fields(value)}
        return {"type": type(value).__name__, **own} if isinstance(value, LightBase) else own
    if isinstance(value, np.ndarray | np.generic):
        return packed(value.tolist())
    if isinstance(value, Mapping):
        return {name: packed(x) for name, x in value.items()}
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, tuple | list):
        return [packed(x) for x in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def made(kind: type[_T], values: Any) -> _T:
    """A dataclass from what :func:`packed` made of it. Names that it does not know are passed over, and those that are
    not there have their defaults.

    Raises:
        KeyError, TypeError, ValueError: it is something else.
    """
    if not isinstance(values, Mapping):
        raise TypeError(kind.__name__)
    hints, own = _hints(cast(Any, kind)), dict[str, Any]()
    for field in fields(cast(Any, kind)):
        if field.name in values:
            value = values[field.name]
            endless = field.name in _ENDLESS and value in (None, math.inf)
            own[field.name] = math.inf if endless else _value(hints[field.name], value)
    return kind(**own)


@cache
def _hints(kind: type) -> Mapping[str, Any]:
    return get_type_hints(kind, include_extras=True)


def _value(hint: Any, value: Any) -> Any:
    """A JSON value as one of a type. Raises as :func:`made`."""
    origin, args = get_origin(hint), get_args(hint)
    if origin in (Union, UnionType):
        if value is None and NoneType in args:
            return None
        kinds = [x for x in args if x is not NoneType]
        if any(get_origin(x) is Literal for x in kinds):  # a number, or a word in its place
            kinds = [x for x in kinds if _fits(x, get_origin(x), get_args(x), value)][:1] or kinds[:1]
        named = kinds[0] if len(kinds) == 1 else {x.__name__: x for x in kinds}[value["type"]]
        return _value(named, value)
    if is_dataclass(hint):
        return made(cast(type, hint), value)
    if origin is tuple and isinstance(value, list | tuple):
        each = [args[0]] * len(value) if args[1:] == (...,) else args
        return tuple(_value(x, y) for x, y in zip(each, value, strict=True))
    if origin is np.ndarray:
        value = np.array(value)
    if not _fits(hint, origin, args, value):
        raise TypeError(f"not of type {hint}")
    return value


def _fits(hint: Any, origin: Any, args: tuple[Any, ...], value: Any) -> bool:
    """Whether a plain value is of a type."""
    if origin is np.ndarray:
        return value.dtype.kind in "fiub" and bool(np.isfinite(value).all())
    if origin is Literal:
        return any(type(value) is type(x) and value == x for x in args)
    if origin is Annotated:  # a key
        return isinstance(value, str) and value.isalnum()
    if hint is float:
        return type(value) in (int, float) and abs(value) < 1e300 and math.isfinite(value)
    return type(value) is hint
