"""Whether the values of a dataclass are of the types that its fields say: files may hold anything."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from functools import cache
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np

_ENDLESS = ("far", "range")  # fields that may be infinite


def require(value: Any) -> None:
    """See that a dataclass, and all below it, holds what its fields say.

    Raises:
        TypeError: it does not.
    """
    hints = _hints(type(value))  # type: ignore[arg-type]
    for field in fields(value):
        own = getattr(value, field.name)
        endless = field.name in _ENDLESS and own == math.inf
        if not endless and not _fits(own, hints[field.name]):
            raise TypeError(f"{type(value).__name__}.{field.name}")


@cache
def _hints(kind: type) -> Mapping[str, Any]:
    return get_type_hints(kind)


def _fits(value: Any, hint: Any) -> bool:
    origin, args = get_origin(hint), get_args(hint)
    if isinstance(value, np.ndarray):
        return value.dtype.kind in "fiub" and bool(np.isfinite(value).all())
    if is_dataclass(value):
        require(value)
        return True
    if origin is Literal:
        return any(value is x or (type(value) is type(x) and value == x) for x in args)
    if origin in (Union, UnionType):
        return any(_fits(value, x) for x in args)
    if origin is tuple:
        if not isinstance(value, tuple):
            return False
        kinds = [args[0]] * len(value) if args[1:] == (...,) else args
        return len(kinds) == len(value) and all(map(_fits, value, kinds))
    if hint is float:
        return type(value) in (int, float) and abs(value) < 1e300 and math.isfinite(value)
    return type(value) is hint if hint in (int, bool, str) else hint in (None, NoneType) and value is None
