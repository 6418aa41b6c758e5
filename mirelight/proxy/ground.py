"""The ground that things stand on: it goes on beneath what pictures do not tell.

Out of doors an optimiser leaves most of the ground as fog, as it does the sky: few pictures show it, from afar and
aslant. But what no camera saw anything below is no hole. Nothing tells its height out there; its middle's is the guess.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mirelight.proxy.depth import DepthMap, points_of
from mirelight.proxy.flats import Flat, votes
from mirelight.proxy.tuning import TUNING


def carried_on(flats: Sequence[Flat], views: Sequence[DepthMap], tolerance: float) -> list[Flat]:
    """The planes, the ground among them with all cells that views do not surely see through.

    Args:
        flats: the planes of what views see, largest first.
        views: maps of a capture with a sky.
        tolerance: how far what lies on a plane may be from it, world units.
    """
    if not flats or not _is_ground(flats[0], views, tolerance):
        return list(flats)
    ground = flats[0]
    held, through, seen = votes(ground, views, tolerance)
    hole = (through > held) & (through > TUNING.fog * seen)
    return [replace(ground, there=ground.there | ~hole), *flats[1:]]


def _is_ground(flat: Flat, views: Sequence[DepthMap], tolerance: float) -> bool:
    """Whether all cameras are on one side of a plane, and all that is seen as well."""
    eyes = flat.off(np.stack([view.camera.position for view in views]))
    front = np.sign(np.median(eyes))
    if (front * eyes > 0).mean() < TUNING.ground_cameras:
        return False
    behind = total = 0.0
    for view in views:
        points, _ = points_of(view, TUNING.ground_step)
        every = slice(None, None, TUNING.ground_step)
        trust = view.trust[every, every][view.depth[every, every] > 0]
        behind += float(trust[front * flat.off(points) < -TUNING.ground_below * tolerance].sum())
        total += float(trust.sum())
    return behind < TUNING.ground_behind * total
