"""Many convex polygons in planes of their own, cut by half-planes all at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirelight.model import F64
from mirelight.proxy.types import Int

MOST_CORNERS = 20  # of a cell: most have five to eight


@dataclass(slots=True, eq=False)
class Polygons:
    """Polygons, counter-clockwise, convex where they are cut.

    A cut that would make more corners than there is room for is left out.
    """

    corners: F64  # (N, room, 2); those past the count mean nothing
    count: Int  # (N,)

    def cut(self, rows: Int, normal: F64, offset: F64) -> None:
        """Keep of polygons what lies at x·normal <= offset (Sutherland and Hodgman, 1974).

        Args:
            rows: which polygons.
            normal: (R, 2).
            offset: (R,).
        """
        most = self.corners.shape[1]
        slots = np.arange(most)
        over = np.einsum("nvj,nj->nv", self.corners[rows], normal) - offset[:, None]
        touched = ((over > 0) & (slots < self.count[rows, None])).any(axis=1)
        rows, over = rows[touched], over[touched]
        if not len(rows):
            return
        corners = self.corners[rows]
        used, following = self._sides(rows)
        over_next = np.take_along_axis(over, following, axis=1)
        inside, inside_next = over <= 0, over_next <= 0
        crossing = used & (inside != inside_next)
        share = over / np.where(crossing, over - over_next, 1)
        there = np.take_along_axis(corners, following[:, :, None], axis=1)
        met = corners + (there - corners) * share[:, :, None]
        kept = np.stack([used & inside, crossing], axis=2).reshape(len(rows), -1)
        points = np.stack([corners, met], axis=2).reshape(len(rows), -1, 2)
        total = kept.sum(axis=1)
        fits = total <= most
        place = np.cumsum(kept, axis=1) - 1
        row, slot = np.nonzero(kept & fits[:, None])
        fresh = np.zeros_like(corners)
        fresh[row, place[row, slot]] = points[row, slot]
        self.corners[rows[fits]] = fresh[fits]
        self.count[rows[fits]] = total[fits]

    def chord(self, rows: Int, normal: F64, offset: F64, along: F64) -> tuple[F64, F64]:
        """Where lines x·normal = offset enter and leave polygons; where they miss, the first is the larger.

        Args:
            rows: (R,) which polygons.
            normal: (R, 2).
            offset: (R,).
            along: (R, 2) the direction along which that is told.

        Returns:
            (R,) and (R,).
        """
        corners, used, following = self.corners[rows], *self._sides(rows)
        over = np.einsum("nvj,nj->nv", corners, normal) - offset[:, None]
        at = np.einsum("nvj,nj->nv", corners, along)
        over_next, at_next = (np.take_along_axis(x, following, axis=1) for x in (over, at))
        crossing = used & ((over <= 0) != (over_next <= 0))
        met = at + (at_next - at) * (over / np.where(crossing, over - over_next, 1))
        return np.where(crossing, met, np.inf).min(axis=1), np.where(crossing, met, -np.inf).max(axis=1)

    def radius(self) -> F64:
        """(N,) how far the farthest corner is from the origin."""
        used, _ = self._sides(np.arange(len(self.count)))
        return np.asarray(np.sqrt(np.where(used, (self.corners**2).sum(axis=2), 0).max(axis=1)))

    def area(self) -> F64:
        """Area of each polygon (N,)."""
        used, following = self._sides(np.arange(len(self.count)))
        x, y = self.corners[..., 0], self.corners[..., 1]
        x_next, y_next = (np.take_along_axis(v, following, axis=1) for v in (x, y))
        return np.asarray(0.5 * np.where(used, x * y_next - y * x_next, 0).sum(axis=1))

    def extent(self, rows: Int, way: F64) -> tuple[F64, F64]:
        """(R,) where polygons begin and where they end along directions (R, 2)."""
        along = np.einsum("rvj,rj->rv", self.corners[rows], way)
        used, _ = self._sides(rows)
        return np.where(used, along, np.inf).min(axis=1), np.where(used, along, -np.inf).max(axis=1)

    def where(self, chosen: Int) -> Polygons:
        """Copies of the polygons of some rows (N,)."""
        return Polygons(self.corners[chosen], self.count[chosen])

    def simplified(self, near: float) -> Polygons:
        """Without corners so near to the one before them, or to the line between those beside them."""
        slots, rows = np.arange(self.corners.shape[1]), np.arange(len(self.count))
        last = np.maximum(self.count - 1, 0)
        before = np.concatenate([self.corners[rows, last][:, None], self.corners[:, :-1]], axis=1)
        apart = (slots < self.count[:, None]) & (((self.corners - before) ** 2).sum(axis=2) >= near**2)
        few = self._with(apart)
        kept = np.zeros_like(apart)
        last_of = few.corners[rows, np.maximum(few.count - 1, 0)]
        first = few.corners[:, 0].copy()
        for k in range(int(few.count.max(initial=0))):
            at, ends = few.corners[:, k], (k + 1 >= few.count)[:, None]
            after = np.where(ends, first, few.corners[:, min(k + 1, few.corners.shape[1] - 1)])
            way, step = after - last_of, at - last_of
            along, squared = (way * step).sum(axis=1), (way**2).sum(axis=1)
            off = np.abs(way[:, 0] * step[:, 1] - way[:, 1] * step[:, 0])
            straight = (along > 0) & (along < squared) & (off < near * np.sqrt(squared))
            stays = (k < few.count) & ~straight
            first = np.where((stays & ~kept.any(axis=1))[:, None], at, first)
            kept[:, k] = stays
            last_of = np.where(stays[:, None], at, last_of)
        return few._with(kept)

    def _with(self, kept: NDArray[np.bool_]) -> Polygons:
        """With those corners (N, room) alone."""
        place = np.cumsum(kept, axis=1) - 1
        row, slot = np.nonzero(kept)
        corners = np.zeros_like(self.corners)
        corners[row, place[row, slot]] = self.corners[row, slot]
        return Polygons(corners, kept.sum(axis=1))

    def _sides(self, rows: Int) -> tuple[NDArray[np.bool_], Int]:
        """(R, room) which corners count, and which one follows each."""
        slots, count = np.arange(self.corners.shape[1]), self.count[rows, None]
        return slots < count, np.where(slots + 1 < count, slots + 1, 0)


def octagons(radius: F64) -> Polygons:
    """Regular octagons about the origin with those radii (N,) of their corners."""
    turn = (np.arange(8) + 0.5) * (np.pi / 4)
    corners = np.zeros((len(radius), MOST_CORNERS, 2))
    corners[:, :8] = np.stack([np.cos(turn), np.sin(turn)], axis=1) * radius[:, None, None]
    return Polygons(corners, np.full(len(radius), 8, np.int64))
