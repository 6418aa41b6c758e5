"""Many convex polygons in planes of their own, cut by half-planes all at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mirelight.model import F64
from mirelight.proxy.types import Int

MOST_CORNERS = 20  # a cut that would make more is left out: cells have five to eight


@dataclass(slots=True, eq=False)
class Polygons:
    """Convex polygons, counter-clockwise."""

    corners: F64  # (N, MOST_CORNERS, 2); those past the count mean nothing
    count: Int  # (N,)

    def cut(self, rows: Int, normal: F64, offset: F64) -> None:
        """Keep of polygons what lies at x·normal <= offset (Sutherland and Hodgman, 1974).

        Args:
            rows: which polygons.
            normal: (N, 2), a row for each polygon.
            offset: (N,).
        """
        normal, offset = normal[rows], offset[rows]
        slots = np.arange(MOST_CORNERS)
        over = np.einsum("nvj,nj->nv", self.corners[rows], normal) - offset[:, None]
        touched = ((over > 0) & (slots < self.count[rows, None])).any(axis=1)
        rows, over = rows[touched], over[touched]
        if not len(rows):
            return
        corners, count = self.corners[rows], self.count[rows]
        used = slots < count[:, None]
        following = np.where(slots + 1 < count[:, None], slots + 1, 0)
        over_next = np.take_along_axis(over, following, axis=1)
        inside, inside_next = over <= 0, over_next <= 0
        crossing = used & (inside != inside_next)
        share = over / np.where(crossing, over - over_next, 1)
        there = np.take_along_axis(corners, following[:, :, None], axis=1)
        met = corners + (there - corners) * share[:, :, None]
        kept = np.stack([used & inside, crossing], axis=2).reshape(len(rows), -1)
        points = np.stack([corners, met], axis=2).reshape(len(rows), -1, 2)
        total = kept.sum(axis=1)
        fits = total <= MOST_CORNERS
        place = np.cumsum(kept, axis=1) - 1
        row, slot = np.nonzero(kept & fits[:, None])
        fresh = np.zeros_like(corners)
        fresh[row, place[row, slot]] = points[row, slot]
        self.corners[rows[fits]] = fresh[fits]
        self.count[rows[fits]] = total[fits]

    def extent(self, rows: Int, way: F64) -> tuple[F64, F64]:
        """(R,) where polygons begin and where they end along directions (R, 2)."""
        along = np.einsum("rvj,rj->rv", self.corners[rows], way)
        used = np.arange(MOST_CORNERS) < self.count[rows, None]
        return np.where(used, along, np.inf).min(axis=1), np.where(used, along, -np.inf).max(axis=1)


def octagons(radius: F64) -> Polygons:
    """Regular octagons about the origin with those radii of their corners."""
    turn = (np.arange(8) + 0.5) * (np.pi / 4)
    corners = np.zeros((len(radius), MOST_CORNERS, 2))
    corners[:, :8] = np.stack([np.cos(turn), np.sin(turn)], axis=1) * radius[:, None, None]
    return Polygons(corners, np.full(len(radius), 8, np.int64))
