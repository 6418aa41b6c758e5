"""Creases: where a disc's plane meets the discs of other planes, so that cells end there, and only there.

The plane of a neighbour is endless, the neighbour is not: a wall's cell must not end at the plane of a post that stands
beside it. So the line in which two planes meet cuts only what lies across from the neighbour's disc, wedge by wedge: a
wedge is the triangle between the middle of a disc and one side of its cell.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from mirelight.model import F64
from mirelight.proxy.cell_tuning import CELLS
from mirelight.proxy.discs import Around, Discs
from mirelight.proxy.polygons import Polygons
from mirelight.proxy.types import Int

_PAIRS = 200_000  # of cells and lines looked at at once


@dataclass(frozen=True, slots=True, eq=False)
class Creases:
    """Lines across the cells of discs, one for each neighbour of another normal."""

    row: Int  # (P,) the disc, among those asked for
    rank: Int  # (P,) counts the lines of a disc, its nearest neighbour's first
    normal: F64  # (P, 2) unit, in the disc's plane, across the line and away from what is kept
    offset: F64  # (P,) of the line
    middle: F64  # (P,) along the line: where the neighbour is
    away: F64  # (P,) in the neighbour's plane: how far it is from the line
    reach: F64  # (P,) how far around its middle the neighbour's disc counts
    own: F64  # (P,) the disc's local spacing
    other: Int  # (P,) the neighbour
    over: F64  # (P, 2) how far the neighbour is over the disc's plane, and the disc over the neighbour's

    @staticmethod
    def of(discs: Discs, rows: Int, near: Int, around: Around, local: F64, cells: Polygons) -> Creases:
        """Between discs (R,) and their neighbours (R, K); `local` are the local spacings of all discs.

        Lines that cannot come into the discs' cells are left out.
        """
        count = np.maximum(around.on_sheet.sum(axis=1), 1)[:, None]
        inwards = CELLS.crease_inwards * (around.along * around.on_sheet[..., None]).sum(axis=1) / count
        row, k = np.nonzero(~around.same)
        other, step, i = near[row, k], around.step[row, k], rows[row]
        m = discs.normal[other]
        normal = np.einsum("pi,pij->pj", m, discs.axes[i][:, :, 1:])
        steep = np.maximum(np.linalg.norm(normal, axis=1), 1e-30)
        theirs, mine = (step * m).sum(axis=1), (step * discs.normal[i]).sum(axis=1)
        normal, offset = normal / steep[:, None], theirs / steep
        side = offset - (normal * inwards[row]).sum(axis=1)
        turn = np.where(side < 0, -1.0, 1.0)
        normal, offset = normal * turn[:, None], offset * turn
        middle = around.along[row, k, 1] * normal[:, 0] - around.along[row, k, 0] * normal[:, 1]
        away, over = np.abs(mine) / steep, np.stack([mine, -theirs], axis=1)
        reach, wide = CELLS.crease_meets * local[other], cells.radius()[row]
        kept = (np.abs(side) > CELLS.crease_on_line * discs.spacing) & (away < CELLS.crease_convex * reach)
        kept &= (
            (offset < wide)
            & (offset > -wide - CELLS.crease_behind * local[i])
            & (np.abs(middle) < wide + CELLS.crease_convex * reach)
        )
        return Creases(row, row, normal, offset, middle, away, reach, local[i], other, over).where(kept)

    def where(self, kept: NDArray[np.bool_]) -> Creases:
        """Some of them (P,), counted anew."""
        some = Creases(*(getattr(self, x.name)[kept] for x in fields(self)))
        return replace(some, rank=np.arange(len(some.row)) - np.searchsorted(some.row, some.row))

    def seen_from(self, front: F64, rows: Int) -> Creases:
        """With the sides known: `front` (N,) is 1 where a normal points to what was seen, -1 where away, else 0."""
        over = self.over * np.stack([front[rows[self.row]], front[self.other]], axis=1)
        corner, edge = (over > 0).all(axis=1), (over < 0).all(axis=1)
        offset = self.offset + np.where(corner, CELLS.crease_behind * self.own, 0.0)
        return replace(self, offset=offset, reach=self.reach * np.where(edge, CELLS.crease_convex, 1.0))

    def on(self, cells: Polygons) -> Creases:
        """Those that cross the cells of discs (R,): no other cuts anything of them."""
        kept = np.zeros(len(self.row), bool)
        for first in range(0, len(kept), _PAIRS):
            p = np.arange(first, min(first + _PAIRS, len(kept)))
            kept[p] = self._meet(cells, self.row[p], p)
        return self.where(kept)

    def cut(self, polygons: Polygons, row: Int) -> None:
        """Cut polygons (Q,) of discs where the neighbours' discs are; `row` (Q,) says of which disc each is."""
        line = np.empty(int(max(row.max(initial=0), self.row.max(initial=0))) + 1, np.int64)
        for k in range(int(self.rank.max(initial=-1)) + 1):
            these = np.flatnonzero(self.rank == k)
            line[:] = -1
            line[self.row[these]] = these
            found = line[row]
            some = np.flatnonzero(found >= 0)
            p = found[some]
            meets = self._meet(polygons, some, p)
            polygons.cut(some[meets], self.normal[p[meets]], self.offset[p[meets]])

    def _meet(self, polygons: Polygons, some: Int, p: Int) -> NDArray[np.bool_]:
        """(M,) whether polygons are crossed by lines where the neighbours' discs are, pair by pair."""
        normal, middle = self.normal[p], self.middle[p]
        along = np.stack([-normal[:, 1], normal[:, 0]], axis=1)
        half = np.sqrt(np.maximum(self.reach[p] ** 2 - self.away[p] ** 2, 0))
        enter, leave = polygons.chord(some, normal, self.offset[p], along)
        return np.asarray((enter <= leave) & (enter < middle + half) & (leave > middle - half) & (half > 0))


def wedges_of(cells: Polygons) -> tuple[Polygons, Int]:
    """A triangle from the middle of each disc to each side of its cell, and (W,) of which cell each is."""
    row, k = np.nonzero(np.arange(cells.corners.shape[1]) < cells.count[:, None])
    first, second = cells.corners[row, k], cells.corners[row, np.where(k + 1 < cells.count[row], k + 1, 0)]
    corners = np.zeros((len(row), CELLS.crease_wedge_corners, 2))
    corners[:, 1], corners[:, 2] = first, second
    return Polygons(corners, np.full(len(row), 3, np.int64)), row
