"""Where planes end: at planes that they meet, and not a cell beyond.

Cells tell no finer than two spacings where a plane is, and a little more of it counts where it goes on to another. What
stands out past a corner so would hide the surface beside it: a lip, with a hole beneath.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mirelight.base.together import each
from mirelight.model import F64
from mirelight.proxy.flats import Flat
from mirelight.proxy.tuning import TUNING

Bool = NDArray[np.bool_]


def ended(flats: Sequence[Flat]) -> list[Flat]:
    """The planes without what little of them is past others that stand across them, to the line where both meet."""
    return each(lambda flat: _ended(flat, flats), flats)


def _ended(flat: Flat, flats: Sequence[Flat]) -> Flat:
    from scipy.ndimage import binary_dilation, label

    across = [(other, _from(flat, other)) for other in flats if abs(float(flat.normal @ other.normal)) < 0.5]
    if not across:
        return flat
    lines = [np.abs(off) < _half(flat, other) for other, off in across]
    cut = flat.there & np.any(lines, axis=0)
    part, count = label(flat.there & ~cut)
    short, away = np.zeros(flat.there.shape, bool), np.full(flat.there.shape, np.inf)
    for _, off in across:
        farthest = np.zeros(count + 1)
        np.maximum.at(farthest, part.ravel(), np.abs(off).ravel())
        own = (farthest < TUNING.flat_longest * flat.cell)[part] & (part > 0)
        short, away = short | own, np.where(own, np.minimum(away, np.abs(off)), away)
    whole = (part > 0) & ~short
    # what is short on both sides of a line, as a shelf at a wall, is all that there is of it
    past = short & np.isin(part, np.unique(part[binary_dilation(whole, iterations=3) & short]))
    halves = list[F64]()
    for (other, off), line in zip(across, lines, strict=True):
        own = past & (np.abs(off) == away)
        above, below = (binary_dilation(whole & (side * off > 0), iterations=2) for side in (1, -1))
        half = np.tile([0.0, 0, 0, 1], (*flat.there.shape, 1))
        for side, only in ((1, above & ~below), (-1, below & ~above)):
            own_side = line & cut & only | own & (side * off < 0)
            half[own_side] = np.append(side * other.normal, TUNING.flat_past * flat.cell - side * other.offset)
        halves.append(half)
    return replace(flat, bound=_two(halves))


def _two(halves: Sequence[F64]) -> F64:
    """(I, J, 2, 4) the first two of half spaces (I, J, 4) that bound a cell: three planes meet in a corner."""
    out = np.tile([0.0, 0, 0, 1], (*halves[0].shape[:2], 2, 1))
    taken = np.zeros(halves[0].shape[:2], np.int64)
    for half in halves:
        own = (half[..., :3] != 0).any(axis=-1) & (taken < 2)
        i, j = np.nonzero(own)
        out[i, j, taken[own]] = half[own]
        taken[own] += 1
    return out


def _from(flat: Flat, other: Flat) -> F64:
    """(I, J) how far a plane's cells are from another, signed, where that has surface across from them; else inf."""
    from scipy.ndimage import binary_dilation

    at = flat.middles
    wide = replace(other, there=binary_dilation(other.there, iterations=TUNING.flat_corner))
    return np.where(wide.inside(at), other.off(at), np.inf).reshape(flat.there.shape)


def _half(flat: Flat, other: Flat) -> float:
    """How far the middle of a cell may be from another plane that crosses it."""
    return 0.5 * flat.cell * float(np.abs(flat.axes @ other.normal).sum())
