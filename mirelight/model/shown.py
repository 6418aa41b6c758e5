"""What objects of the model say of themselves in a console (a line or two, never arrays) and show in a notebook."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from mirelight.base import colour
from mirelight.base.png import png_bytes
from mirelight.model.arrays import F32
from mirelight.model.profiles import Profile, rules_of

_MOST = 6  # names that a line lists


def names(values: Sequence[str]) -> str:
    """Some names, and how many more there are."""
    more = len(values) - _MOST
    return ", ".join(values[:_MOST]) + (f" and {more} more" if more > 0 else "")


def count(number: int, thing: str) -> str:
    """A number and its noun, in the plural where it is not 1."""
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


def picture(rgba: F32, profile: Profile = "physical", behind: F32 | None = None) -> bytes:
    """A premultiplied linear picture (H, W, 4) over light (H, W, 3), or black, as PNG, at exposure 0, without tone
    curve: for a notebook."""
    display = colour.shown(rgba[..., :3], rgba[..., 3], rules_of(profile).transfer, behind=behind)
    return png_bytes(np.rint(display * np.float32(255)).astype(np.uint8), {})
