"""Where planes end: at planes that they meet, and not a cell beyond.

Cells tell no finer than two spacings where a plane is, and a little more of it counts where it goes on to another. What
stands out past a corner so would hide the surface beside it: a lip, with a hole beneath.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

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


@dataclass(frozen=True, slots=True, eq=False)
class _Across:
    """A plane that stands across another."""

    plane: Flat
    off: F64  # (I, J) how far the other's cells are from it, signed, where it has surface across from them; else inf
    line: Bool  # (I, J) cells that it crosses

    @staticmethod
    def of(plane: Flat, flat: Flat) -> _Across:
        from scipy.ndimage import binary_dilation

        at = flat.middles
        wide = replace(plane, there=binary_dilation(plane.there, iterations=TUNING.flat_corner))
        off = np.where(wide.inside(at), plane.off(at), np.inf).reshape(flat.there.shape)
        half = 0.501 * flat.cell * float(np.abs(flat.axes @ plane.normal).sum())  # of a cell, and its rim
        return _Across(plane, off, flat.there & (np.abs(off) < half))

    def longest(self, cell: float) -> float:
        """How far what sticks out past it may reach, of a plane in cells of that side.

        A plane in larger ones ends at one of a closer look within a cell: it was not led on to it. What is longer is
        the rest of a table, before what stands on it.
        """
        return TUNING.flat_longest * min(cell, self.plane.cell) + max(cell - self.plane.cell, 0)

    def halves(self, whole: Bool, past: Bool, cell: float) -> F64:
        """(I, J, 4) the side of it that cells are bounded to: those of its line to where the rest is whole, if that is
        on one side alone, and those past it to the other side; zeros and one: to none."""
        from scipy.ndimage import binary_dilation

        above, below = (binary_dilation(whole & (side * self.off > 0), iterations=2) for side in (1, -1))
        half = np.tile([0.0, 0, 0, 1], (*self.line.shape, 1))
        for side, only in ((1, above & ~below), (-1, below & ~above)):
            bounded = self.line & only | past & (side * self.off < 0)
            half[bounded] = np.append(side * self.plane.normal, TUNING.flat_past * cell - side * self.plane.offset)
        return half


def _ended(flat: Flat, flats: Sequence[Flat]) -> Flat:
    from scipy.ndimage import binary_dilation, label

    even = (other for other in flats if other.lift is None and abs(float(flat.normal @ other.normal)) < 0.5)
    across = [_Across.of(other, flat) for other in even]
    if not across:
        return flat
    part, count = label(flat.there & ~np.any([x.line for x in across], axis=0))
    short, away = np.zeros(flat.there.shape, bool), np.full(flat.there.shape, np.inf)
    for x in across:
        farthest = np.zeros(count + 1)
        np.maximum.at(farthest, part.ravel(), np.abs(x.off).ravel())
        own = (farthest < x.longest(flat.cell))[part] & (part > 0)
        short, away = short | own, np.where(own, np.minimum(away, np.abs(x.off)), away)
    whole = (part > 0) & ~short
    # what is short on both sides of a line, as a shelf at a wall, is all that there is of it
    past = short & np.isin(part, np.unique(part[binary_dilation(whole, iterations=3) & short]))
    return replace(flat, bound=_two([x.halves(whole, past & (np.abs(x.off) == away), flat.cell) for x in across]))


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
