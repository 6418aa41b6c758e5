"""What objects of the model say of themselves in a console (a line or two, never arrays) and show in a notebook."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from typing import Any

import numpy as np

from mirelight.model.arrays import F32

_MOST = 6  # names that a line lists


def names(values: Sequence[str]) -> str:
    """Some names, and how many more there are."""
    more = len(values) - _MOST
    return ", ".join(values[:_MOST]) + (f" and {more} more" if more > 0 else "")


def count(number: int, thing: str) -> str:
    """So many things."""
    return f"{number:,} {thing}{'' if number == 1 else 's'}"


def view(camera: Any) -> str:
    """A camera by its name and size."""
    return f"{camera.name!r}, {camera.width} x {camera.height}"


def span(values: Any) -> str:
    """Least and largest value of an array, and how many are no finite numbers."""
    array = np.asarray(values)
    finite = np.isfinite(array)
    odd = array.size - int(finite.sum())
    kept = array[finite] if odd else array
    said = f"{kept.min():.4g} to {kept.max():.4g}" if kept.size else "nothing finite" if odd else "empty"
    return said + (f" ({odd:,} not finite)" if odd and kept.size else "")


def share(covered: Any) -> str:
    """Mean of an alpha or coverage in percent."""
    array = np.asarray(covered)
    return f"{100 * float(array.mean(dtype=np.float64)):.3g} %" if array.size else "nothing"


def point(values: Any) -> str:
    """A point or a colour."""
    return "(" + ", ".join(f"{float(x):.4g}" for x in np.asarray(values).ravel()) + ")"


def picture(rgba: F32, profile: str = "physical") -> bytes:
    """A premultiplied linear picture (H, W, 4) as PNG, at exposure 0 and without tone curve, for a notebook.

    The encoder is looked up when a picture is asked for: the model imports nothing that stands above it.
    """
    png: bytes = import_module("mirelight.io.png").display_png(rgba, profile)
    return png
