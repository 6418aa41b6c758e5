"""Array types, and the check that every public array goes through."""

from __future__ import annotations

from dataclasses import fields
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

F32: TypeAlias = NDArray[np.float32]
F64: TypeAlias = NDArray[np.float64]
I32: TypeAlias = NDArray[np.int32]


def frozen_array(value: ArrayLike, shape: tuple[int | None, ...], dtype: Any, name: str) -> NDArray[Any]:
    """`value` as a C-contiguous read-only array of `dtype`; None in `shape` fits any length.

    No copy is made where the value already fits; a writeable array that fits is viewed, not locked.

    Raises:
        ValueError: the shape differs.
    """
    array = np.ascontiguousarray(value, dtype=dtype)
    fits = array.ndim == len(shape) and all(w is None or w == n for w, n in zip(shape, array.shape, strict=True))
    if not fits:
        wanted = "(" + ", ".join("n" if n is None else str(n) for n in shape) + ")"
        raise ValueError(f"{name}: shape {array.shape}, expected {wanted}")
    view = array.view()
    view.flags.writeable = False
    return view


def freeze(owner: object, name: str, shape: tuple[int | None, ...], dtype: Any = np.float32) -> None:
    """Replace a frozen dataclass' array field by its checked, read-only form; None stays None."""
    value = getattr(owner, name)
    if value is not None:
        object.__setattr__(owner, name, frozen_array(value, shape, dtype, f"{type(owner).__name__}.{name}"))


class ArrayHolder:
    """Base of the frozen dataclasses that hold arrays: what comes out of pickle and `copy` is read-only, too.

    NumPy forgets that an array was read-only when it is pickled or copied deeply.
    """

    __slots__ = ()

    def __reduce__(self) -> tuple[Any, ...]:
        names = tuple(f.name for f in fields(self))  # type: ignore[arg-type] # every subclass is a dataclass
        return _restored, (type(self), names, tuple(getattr(self, name) for name in names))


def _restored(kind: type, names: tuple[str, ...], values: tuple[Any, ...]) -> Any:
    """The object of these fields as it was: checked when it was made, so not checked again."""
    out: Any = object.__new__(kind)
    for name, value in zip(names, values, strict=True):
        if isinstance(value, np.ndarray):
            value = value.view()
            value.flags.writeable = False
        object.__setattr__(out, name, value)
    return out
