"""Walls and floors that go on where the cameras' pictures end, and behind what stands before them.

Pictures end somewhere, and walls do not end there with them: the wall beside a camera, the floor below it. Each large
plane of the surface is looked at in rows along its two axes; where a row is still surface at the last place that any
picture shows, it goes on, to the end of the box that holds the surface and the cameras. Where a picture shows that it
ends, it does not. A row that is lost behind something, and found again in the same plane on its other side, was there
all the way; so was one that is hidden up to the end of the box, where that is no farther than it was seen.

A row that no picture looks through goes on to what it meets next, too, no farther than it was seen: the ceiling above a
beam, to the wall. Planes of parts of things do no more than that. All end where they meet another plane.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from mirelight.model import F64, triangles
from mirelight.proxy.planes import Bool, Plane, Sheet
from mirelight.proxy.sampling import spread, spread_on
from mirelight.proxy.tuning import TUNING
from mirelight.proxy.types import Soup
from mirelight.proxy.views import turned

# (M, 3) points: whether a camera looked through them, and whether one has them in its picture, seen or hidden
Look = Callable[[F64], tuple[Bool, Bool]]


def box_of(soup: Soup, eyes: F64) -> tuple[F64, F64]:
    """(3,) and (3,): the corners of the box that holds a surface and the eyes (C, 3) that saw it."""
    return (
        np.minimum(soup.vertices.min(axis=0), eyes.min(axis=0)),
        np.maximum(soup.vertices.max(axis=0), eyes.max(axis=0)),
    )


def cell_of(low: F64, high: F64, spacing: float) -> float:
    """Side of the cells in which planes are looked at, in a box of two corners (3,); `spacing` is that of the capture's
    splats."""
    return max(float((high - low).max()) / TUNING.beyond_cells, TUNING.beyond_spacings * spacing)


def beyond_pictures(
    soup: Soup,
    planes: Sequence[Plane],
    low: F64,
    high: F64,
    cell: float,
    look: Callable[[float], Look],
    top: tuple[F64, float] | None = None,
) -> Soup:
    """Triangles that carry on large planes of a surface where no picture shows whether they end.

    Args:
        soup: the surface.
        planes: its planes, the largest first.
        low: (3,) a corner of the box that holds the surface and the eyes of its cameras.
        high: (3,) the other.
        cell: side of the cells in which planes are looked at.
        look: tells what was in pictures; of points nearer to the surface than so much, not looked through.
        top: (3,) unit, and how far along it none goes on; None: all may.
    """
    area = float(triangles.areas(soup.vertices[soup.faces]).sum())
    marks, face = spread_on(soup.vertices, soup.faces, int(TUNING.beyond_marks * area / cell**2) + 1)
    plane_of = np.full(len(soup.faces), -1)
    for k, plane in enumerate(planes):
        plane_of[plane.faces] = k
    of = plane_of[face]
    looked = [
        _Looked.of(soup, k, planes, (low, high), cell, look(TUNING.beyond_near * cell)) for k in range(len(planes))
    ]
    out = Soup(np.zeros((0, 3)), np.zeros((0, 3), np.int64))
    done: dict[int, Bool] = {}
    for k in 2 * sorted(range(len(planes)), key=lambda k: planes[k].area):  # what each closes, the others meet
        plane, known = planes[k], looked[k]
        near = np.abs(turned(marks, plane.normal[None])[:, 0] - plane.offset) < cell
        met, stops = (known.sheet.cells(x) for x in (marks[near], marks[near & np.isin(of, known.across)]))
        cells = _carried_on(known, met, stops, plane.area >= TUNING.beyond_least_area * area)
        if top is not None:
            cells &= (known.sheet.middles() @ top[0] < top[1]).reshape(cells.shape)
        made = known.sheet.rectangles(cells & ~done.get(k, known.surface))
        done[k] = cells
        more = spread(
            made.vertices,
            made.faces,
            int(TUNING.beyond_marks * triangles.areas(made.vertices[made.faces]).sum() / cell**2),
        )
        marks, of = np.concatenate([marks, more]), np.concatenate([of, np.full(len(more), k)])
        out = out.beside(made)
    return out


@dataclass(frozen=True, slots=True, eq=False)
class _Looked:
    """What is known of a plane's cells, whatever else is closed."""

    sheet: Sheet
    surface: Bool  # (I, J) which hold surface of the plane
    free: Bool  # (I, J) which a camera looked through
    shown: Bool  # (I, J) which one has in its picture
    across: list[int]  # planes that cross it

    @staticmethod
    def of(soup: Soup, k: int, planes: Sequence[Plane], box: tuple[F64, F64], cell: float, look: Look) -> _Looked:
        """Of one of the planes."""
        plane = planes[k]
        sheet = Sheet.of(plane, planes, *box, cell)
        surface = spread(soup.vertices, soup.faces[plane.faces], int(TUNING.beyond_marks * plane.area / cell**2) + 1)
        free, shown = (x.reshape(sheet.inside.shape) for x in look(sheet.middles()))
        across = [j for j, x in enumerate(planes) if abs(float(x.normal @ plane.normal)) < TUNING.beyond_across]
        return _Looked(sheet, sheet.cells(surface), free, shown, across)


def _carried_on(known: _Looked, near: Bool, across: Bool, large: bool) -> Bool:
    """Cells of a plane in the box that carry on its surface.

    Args:
        known: the plane's cells.
        near: which hold any surface.
        across: which hold surface of planes that cross it.
        large: whether it is more than a part of a thing.
    """
    surface, free, shown, inside = known.surface, known.free, known.shown, known.sheet.inside
    met, way = surface | near, ~free & (surface | ~across)
    more = np.zeros_like(surface)
    for turn in range(4):
        grown = _met(*(np.rot90(x, turn) for x in (surface, met, free, way, inside)))
        if large:
            grown |= _grown(*(np.rot90(x, turn) for x in (surface, shown, inside)))
            grown |= _behind(*(np.rot90(x, turn) for x in (surface, shown & ~free, ~free, inside)))
        more |= np.rot90(grown, -turn)
    return np.asarray(more & ~surface & inside)


def _grown(surface: Bool, shown: Bool, inside: Bool) -> Bool:
    """Cells past the end of rows, towards larger second indices, where pictures end before the surface does.

    Where many rows are seen to end, the others end no farther out.
    """
    along = np.arange(surface.shape[1])
    last = np.where(surface, along, -1).max(axis=1)
    past = along > last[:, None]
    soon = past & (along <= last[:, None] + TUNING.beyond_gap)
    goes_on = _open_ends(surface) & ~(shown & past & ~soon).any(axis=1) & (soon & ~shown).any(axis=1)
    end = _end(surface, _open_ends(surface) & ~goes_on)
    return np.asarray(goes_on[:, None] & past & ~shown & inside & (along <= end))


def _open_ends(surface: Bool) -> Bool:
    """Rows that have enough surface, but none in their last cell."""
    return np.asarray((surface.sum(axis=1) >= TUNING.beyond_least_row) & ~surface[:, -1])


def _end(surface: Bool, ended: Bool) -> int:
    """Where a side ends: of rows that are seen to end, if they are many; else behind the last cell."""
    along = np.arange(surface.shape[1])
    if ended.sum() <= TUNING.beyond_enough * (surface.sum(axis=1) >= TUNING.beyond_least_row).sum():
        return len(along)
    return int(np.quantile(np.where(surface, along, -1).max(axis=1)[ended], 0.9)) + 1


def _met(surface: Bool, met: Bool, free: Bool, way: Bool, inside: Bool) -> Bool:
    """Cells that no picture looks through, from surface to what a row meets first, no longer than what is seen.

    Where many rows are seen to end, the others end no farther out.
    """
    along = np.arange(surface.shape[1])
    length = surface.sum(axis=1)
    next_ = np.minimum.accumulate(np.where(met, along, len(along))[:, ::-1], axis=1)[:, ::-1]
    last = np.maximum.accumulate(np.where(surface, along, -1), axis=1)
    short = (next_ - last - 1 <= length[:, None]) & (length >= TUNING.beyond_least_row)[:, None]
    outer = last[:, -1:]
    soon = (along > outer) & (along <= outer + TUNING.beyond_gap)
    end = _end(surface, _open_ends(surface) & (soon & free).any(axis=1))
    between = _reached(surface, way) & _reached(met[:, ::-1], way[:, ::-1])[:, ::-1]
    return np.asarray(between & short & inside & (along <= end))


def _reached(start: Bool, through: Bool) -> Bool:
    """Cells `through` which one comes from a start, towards larger second indices."""
    along = np.arange(start.shape[1])
    last = np.maximum.accumulate(np.where(start, along, -1), axis=1)
    stopped = np.maximum.accumulate(np.where(start | through, -1, along), axis=1)
    return np.asarray(through & ~start & (last >= 0) & (last > stopped))


def _behind(surface: Bool, hidden: Bool, unknown: Bool, inside: Bool) -> Bool:
    """Cells that no picture looks through, between surface in their row, or hidden from surface to the box's end."""
    enough = surface.sum(axis=1) >= TUNING.beyond_least_row

    def back(start: Bool, through: Bool) -> Bool:
        return _reached(start[:, ::-1], through[:, ::-1])[:, ::-1]

    between = _reached(surface, unknown) & back(surface, unknown)
    past = np.pad(~inside, ((0, 0), (0, 1)), constant_values=True)
    to_the_end = _reached(surface, hidden) & back(past, np.pad(hidden, ((0, 0), (0, 1))))[:, :-1]
    to_the_end &= to_the_end.sum(axis=1, keepdims=True) <= surface.sum(axis=1, keepdims=True)
    return np.asarray(enough[:, None] & inside & (between | to_the_end))
