"""A ceiling for rooms whose pictures end below it, as those of things on a table do.

Nothing shows that there is one. What tells is the walls: they stand all round the cameras, and where pictures end above
they have not ended. A yard's walls end in its pictures, and what is above them was looked through.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirelight.model import F64, triangles
from mirelight.proxy.pictures import Pictures
from mirelight.proxy.planes import Plane, Sheet
from mirelight.proxy.tuning import TUNING
from mirelight.proxy.types import Soup, corners_of
from mirelight.proxy.views import mean_up

Bool = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Ceiling:
    """Where it is guessed."""

    up: F64  # (3,) unit, from the floor
    height: float  # along it, from the origin
    floor: float  # the floor's
    walls: tuple[tuple[F64, float], ...]  # (3,) unit normal towards the cameras, and offset, of each

    def box(self, low: F64, high: F64) -> tuple[F64, F64]:
        """The corners (3,) of a box, moved so that walls in it reach the ceiling."""
        corners = corners_of(low, high)
        lifted = corners + np.maximum(self.height - corners @ self.up, 0)[:, None] * self.up
        return np.minimum(low, lifted.min(axis=0)), np.maximum(high, lifted.max(axis=0))

    def soup(self, planes: Sequence[Plane], low: F64, high: F64, cell: float, pictures: Pictures) -> Soup:
        """Its triangles between the walls and a little over them, and what no picture shows of the walls below it.

        Fronts face the room. A window that pictures do not show to its end ends with them: rows of `beyond` end below
        it, and would leave open what is above. Pictures end within cells: those beside are closed as well, or the sun
        comes in through a slit. `low`, `high`: (3,) corners of the box that is closed.
        """
        from scipy.ndimage import binary_dilation

        out = Soup(np.zeros((0, 3)), np.zeros((0, 3), np.int64))
        for normal, offset in ((-self.up, -self.height), *self.walls):
            sheet = Sheet.of(Plane(normal, offset, np.zeros(0, np.int64), 0.0), planes, low, high, cell)
            at = sheet.middles()
            free, shown = pictures.states(at.astype(np.float32), -TUNING.beyond_near * cell)
            unseen = binary_dilation(~shown.reshape(sheet.inside.shape), np.ones((3, 3), bool)).ravel() & ~free
            inside = unseen & (at @ self.up < self.height + cell) & self._between(at, 2 * cell)
            out = out.beside(sheet.rectangles(inside.reshape(sheet.inside.shape)))
        return out

    def _between(self, points: F64, margin: float) -> Bool:
        return np.asarray(np.all([points @ normal > offset - margin for normal, offset in self.walls], axis=0))


def ceiling_of(soup: Soup, planes: Sequence[Plane], pictures: Pictures, cell: float) -> Ceiling | None:
    """The ceiling that pictures of a room end below; None: this is no such room.

    It is as high over the floor as a third more than the highest camera, as people hold cameras in rooms; no lower than
    what was seen. Walls that are seen to stand twice as high as that camera are a courtyard's.

    Args:
        soup: the surface.
        planes: its large planes.
        pictures: what they show of space.
        cell: side of the cells in which planes are looked at, world units.
    """
    area = float(triangles.areas(soup.vertices[soup.faces]).sum())
    large = [plane for plane in planes if plane.area >= TUNING.beyond_least_area * area]
    fronts = [(plane, *side) for plane in large if (side := _facing(plane, pictures.eyes)) is not None]
    held = mean_up(pictures.cameras)
    for _, up, floor in fronts:
        if abs(float(held @ up)) < TUNING.ceiling_upright:  # a wall, before which they stand
            continue
        heights = pictures.eyes @ up
        seen = float(np.quantile(soup.vertices @ up, TUNING.ceiling_seen))
        highest = float(heights.max()) - floor
        if seen > floor + TUNING.ceiling_most * highest:  # a room's ceiling would be in the pictures
            continue
        height = max(seen, floor + TUNING.ceiling_over * highest)
        walls = tuple(
            (normal, offset)
            for plane, normal, offset in fronts
            if abs(float(normal @ up)) < TUNING.ceiling_across
            and np.quantile(soup.vertices[soup.faces[plane.faces]] @ up, TUNING.ceiling_top)
            > np.quantile(heights, 0.25)
        )
        found = Ceiling(up, height, floor, walls)
        if walls and _holds(found, pictures, cell):
            return found
    return None


def _facing(plane: Plane, eyes: F64) -> tuple[F64, float] | None:
    """The plane's normal and offset, turned so that all eyes (C, 3) lie before it; None where they do not."""
    before = eyes @ plane.normal > plane.offset
    if 0 < before.sum() < len(eyes):
        return None
    side = 1.0 if before.all() else -1.0
    return side * plane.normal, side * plane.offset


def _holds(ceiling: Ceiling, pictures: Pictures, cell: float) -> bool:
    """Whether walls stand all round, have not ended where pictures do, and no picture shows what is above them."""
    up, eye = ceiling.up, np.median(pictures.eyes, axis=0)
    across = np.linalg.svd(up[None])[2][1:]
    turn = np.linspace(0, 2 * np.pi, TUNING.ceiling_ways, endpoint=False)
    ways = np.cos(turn)[:, None] * across[0] + np.sin(turn)[:, None] * across[1]
    away = np.min([_away(eye, ways, *wall) for wall in ceiling.walls], axis=0)
    if np.isinf(away).any():
        return False
    foot = eye + away[:, None] * ways
    steps = np.linspace(0, 1, TUNING.ceiling_steps) * (ceiling.height - float(eye @ up))
    columns = foot[:, None] + steps[:, None] * up
    free, _ = pictures.states(columns.reshape(-1, 3).astype(np.float32), -TUNING.beyond_near * cell)
    ended = free.reshape(columns.shape[:2]).any(axis=1)
    share = np.sqrt((np.arange(TUNING.ceiling_steps) + 0.5) / TUNING.ceiling_steps)
    above = eye + share[:, None, None] * away[:, None] * ways + (ceiling.height - float(eye @ up)) * up
    _, shown = pictures.states(above.reshape(-1, 3).astype(np.float32), 0.0)
    return bool(ended.mean() < TUNING.ceiling_ended and shown.mean() < TUNING.ceiling_shown)


def _away(eye: F64, ways: F64, normal: F64, offset: float) -> F64:
    """(K,) how far a wall is along directions (K, 3); infinite where they do not meet it."""
    towards = -(ways @ normal)
    return np.where(towards > 1e-3, (float(eye @ normal) - offset) / np.maximum(towards, 1e-3), np.inf)
