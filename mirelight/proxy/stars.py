"""Wedges of a cell as one polygon: fewer triangles than a fan of them, and no seams between them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mirelight.proxy.polygons import Polygons
from mirelight.proxy.types import Int

_SEES = 1e-12  # of a square of the polygons' unit: a triangle of less negative area is none


def stars_of(wedges: Polygons, row: Int, cells: int, near: float) -> tuple[Polygons, NDArray[np.bool_]]:
    """What the wedges of cells cover together.

    Args:
        wedges: (W,) triangles from the middles of cells, one after the other around each, cut since.
        row: (W,) of which cell each is, ascending.
        cells: how many there are.
        near: corners that lie so near to the line between those beside them go.

    Returns:
        (S,) polygons, not convex: fans from their first corners are their triangles; and (cells,) of which cells those
        are, in order. Of any other the middle is cut away, so that its wedges are no star around it, or its wedges have
        no more triangles.
    """
    slots = np.arange(wedges.corners.shape[1])
    whole = np.ones(cells, bool)
    whole[row[(wedges.count < 3) | (wedges.corners[:, 0] != 0).any(axis=1)]] = False
    whole[np.bincount(row, minlength=cells) == 0] = False
    wedge, slot = np.nonzero((slots > 0) & (slots < wedges.count[:, None]) & whole[row][:, None])
    of = (np.cumsum(whole) - 1)[row[wedge]]
    count = np.bincount(of, minlength=int(whole.sum()))
    corners = np.zeros((len(count), int(count.max(initial=1)), 2))
    corners[of, np.arange(len(of)) - (np.cumsum(count) - count)[of]] = wedges.corners[wedge, slot]
    stars = _fans(Polygons(corners, count).simplified(near))
    fewer = stars.count - 2 < np.bincount(row, wedges.count - 2, cells)[whole]
    whole[whole] = fewer
    return stars.where(np.flatnonzero(fewer)), whole


def _fans(stars: Polygons) -> Polygons:
    """From a corner that sees all others; where none does, from the origin, which does."""
    room = stars.corners.shape[1]
    rows, slots = np.arange(len(stars.count)), np.arange(room)
    following = np.where(slots + 1 < stars.count[:, None], slots + 1, 0)
    used = slots < stars.count[:, None]
    here, there = stars.corners, np.take_along_axis(stars.corners, following[:, :, None], axis=1)
    start = np.full(len(rows), -1)
    for k in range(room - 1, -1, -1):
        a, b = here - here[:, k : k + 1], there - here[:, k : k + 1]
        seen = ((a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0] >= -_SEES) | ~used).all(axis=1)
        start[seen & (k < stars.count)] = k
    turn = (slots + np.maximum(start, 0)[:, None]) % np.maximum(stars.count, 1)[:, None]
    out = np.zeros((len(rows), room + 2, 2))
    out[:, :room] = np.take_along_axis(stars.corners, turn[:, :, None], axis=1)
    count, blind = stars.count.copy(), np.flatnonzero((start < 0) & (stars.count > 2))
    out[blind, 1:] = out[blind, :-1]
    out[blind, 0] = 0
    out[blind, count[blind] + 1] = out[blind, 1]
    count[blind] += 2
    return Polygons(out, count)
