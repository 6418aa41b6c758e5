"""The ground that things stand on: it goes on beneath what pictures do not tell.

Out of doors an optimiser leaves most of the ground as fog, as it does the sky: few pictures show it, from afar and
aslant. But what no camera saw anything below is no hole. Where little tells its height, what is surely seen around
does: lawns lie lower than the paving between them, and rise and fall.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mirelight.model import F64
from mirelight.proxy.depth import DepthMap, points_of
from mirelight.proxy.flats import Flat, seen_through
from mirelight.proxy.tidy import compact
from mirelight.proxy.tuning import TUNING
from mirelight.proxy.types import Soup


def ground_of(flats: Sequence[Flat], views: Sequence[DepthMap], tolerance: float, up: F64 | None = None) -> int | None:
    """Which of the planes the ground is, if any.

    Args:
        flats: the planes of what views see, largest first.
        views: maps of a capture with a sky.
        tolerance: how far what lies on a plane may be from it, world units.
        up: (3,) unit: the ground is the largest plane that faces it; None: not known, it is the largest of all.
    """
    level = (k for k, flat in enumerate(flats) if up is None or abs(float(flat.normal @ up)) > TUNING.ground_upright)
    at = next(level, None)  # houses along a street have nothing behind them, either
    return at if at is not None and _is_ground(flats[at], views, tolerance) else None


def carried_on(flats: Sequence[Flat], at: int, views: Sequence[DepthMap], tolerance: float) -> list[Flat]:
    """The planes, the ground among them, `at`, with all cells that views do not surely see through."""
    ground = flats[at]
    whole = replace(ground, there=ground.there | ~seen_through(ground, views, tolerance))
    return [*flats[:at], replace(whole, lift=lift_of(whole, views, tolerance)), *flats[at + 1 :]]


def outside(ground: Flat, half: F64) -> Soup:
    """A ground's cells that reach out of a box of half extents (3,) around the origin: grids end there, it does not.

    They begin a cell within, as the grid's surface may end that early: a slit between the two is a line in a frame.
    """
    rows, columns = ground.there.shape
    i = np.stack(np.meshgrid(np.arange(rows + 1.0), np.arange(columns + 1.0), indexing="ij"), axis=-1).reshape(-1, 2)
    flat = ground.at(i)
    corners = flat + ground.lifted(flat)[:, None] * ground.normal
    end = half - ground.cell * np.abs(ground.axes).max(axis=0)
    out = (np.abs(corners) > end).any(axis=1).reshape(rows + 1, columns + 1)
    k = np.flatnonzero(ground.there & (out[:-1, :-1] | out[1:, :-1] | out[:-1, 1:] | out[1:, 1:]))
    first = k // columns * (columns + 1) + k % columns
    quad = first[:, None] + np.array([0, columns + 1, columns + 2, 1])
    return compact(Soup(corners, np.concatenate([quad[:, [0, 1, 2]], quad[:, [0, 2, 3]]])))


def lift_of(ground: Flat, views: Sequence[DepthMap], tolerance: float) -> F64:
    """(I, J) how far the ground lies before its plane: what is surely seen near it, a mean over cells around."""
    from scipy.ndimage import gaussian_filter

    shape = ground.there.shape
    total, count = np.zeros(shape), np.zeros(shape)
    for view in views:
        points, normals, trust = points_of(view, TUNING.ground_step)
        off = ground.off(points)
        sure = (trust > TUNING.ground_sure) & (np.abs(off) < TUNING.ground_near * tolerance)
        sure &= np.abs(np.einsum("ni,i->n", normals, ground.normal)) > TUNING.ground_facing
        i, inside = ground.cells(points[sure])
        np.add.at(total, tuple(i[inside].T), off[sure][inside])
        np.add.at(count, tuple(i[inside].T), 1)
    weight = np.minimum(count, TUNING.ground_most)
    rise, known = (
        gaussian_filter(x, TUNING.ground_smooth, mode="constant")
        for x in (weight * total / np.maximum(count, 1), weight)
    )
    lift = rise / (known + TUNING.ground_fewest)
    high = np.abs(lift)
    return np.asarray(np.sign(lift) * np.minimum(high, 2 * np.maximum(high - TUNING.ground_even * tolerance, 0)))


def _is_ground(flat: Flat, views: Sequence[DepthMap], tolerance: float) -> bool:
    """Whether all cameras are on one side of a plane, and all that is seen as well."""
    eyes = flat.off(np.stack([view.camera.position for view in views]))
    front = np.sign(np.median(eyes))
    if (front * eyes > 0).mean() < TUNING.ground_cameras:
        return False
    behind = total = 0.0
    for view in views:
        points, _, trust = points_of(view, TUNING.ground_step)
        behind += float(trust[front * flat.off(points) < -TUNING.ground_below * tolerance].sum())
        total += float(trust.sum())
    return behind < TUNING.ground_behind * total
