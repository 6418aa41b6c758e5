"""The ground that things stand on where no picture tells it: level, at their foot.

A table or a floor without a pattern has no surface in a capture: its splats hang anywhere, as those of a sky do. What
stands on it is known, and where that ends below. Nothing hangs in the air, so there the ground is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mirelight.base.together import each
from mirelight.model import F64
from mirelight.proxy.depth import DepthMap, points_of, sure_points
from mirelight.proxy.flats import Flat, seen_through
from mirelight.proxy.pieces import axes_of
from mirelight.proxy.thing_tuning import THINGS
from mirelight.proxy.tuning import TUNING
from mirelight.proxy.views import dot, rays, turned


def foot_of(views: Sequence[DepthMap], spacing: float, radius: float, up: F64) -> Flat | None:
    """A plane under all that views are sure of, on which as much of it stands as can; None where they show little below
    the horizon that has no surface, or a camera stands below it.

    Cameras tell to some degrees what is level: planes around that are tried.

    Args:
        views: maps of a capture's own cameras.
        spacing: of the splats, world units.
        radius: of the capture, world units.
        up: (3,) unit, as cameras were held.
    """
    if np.mean(each(lambda view: _unknown(view, up), views)) < THINGS.foot_unknown:
        return None
    at = np.concatenate(each(sure_points, views))
    if len(at) < TUNING.flat_fewest:
        return None
    normal, offset = _stood_on(at, up, spacing)
    eyes = np.stack([view.camera.position for view in views])
    return _reaching(normal, offset, views, spacing, radius) if (dot(eyes, normal) > offset).all() else None


def _unknown(view: DepthMap, up: F64) -> float:
    """The share of a view's opaque pixels below the horizon that have no surface."""
    _, directions = rays(view.camera)
    below = (dot(directions, up) < 0) & (view.alpha > TUNING.depth_opaque)
    return float((view.trust[below] < TUNING.fog).mean()) if below.any() else 0.0


def _stood_on(at: F64, up: F64, spacing: float) -> tuple[F64, float]:
    """Normal (3,) and offset of the plane below all but the lowest of points (N, 3) that has most of them on it."""
    along, best = axes_of(up), (-1.0, up, 0.0)
    place = np.zeros(2)
    for step in THINGS.foot_steps:
        middle = place
        for i in np.ndindex(*(2 * THINGS.foot_tried + 1,) * 2):
            lean = middle + step * (np.array(i) - THINGS.foot_tried)
            normal = up + lean @ along
            normal = normal / np.linalg.norm(normal)
            high = dot(at, normal)
            offset = float(np.quantile(high, THINGS.foot_below))
            held = float((np.abs(high - offset) < THINGS.foot_on * spacing).mean())
            if held > best[0]:
                best, place = (held, normal, offset), lean
    return best[1], best[2]


def _reaching(normal: F64, offset: float, views: Sequence[DepthMap], spacing: float, radius: float) -> Flat:
    """The plane as far as views show anything and to where they stand, but where they surely look through it."""
    at = np.concatenate(each(lambda view: points_of(view, TUNING.flat_step)[0], views))
    along, cell = axes_of(normal), TUNING.plane_cell * spacing
    near, eyes = at[dot(at, at) < radius * radius], np.stack([view.camera.position for view in views])
    ends = np.quantile(turned(near if len(near) else at, along), THINGS.foot_reach, axis=0)
    ends = np.concatenate([ends, turned(eyes, along)]) / cell
    low = np.floor(ends.min(axis=0)).astype(np.int64)
    size = tuple(np.ceil(ends.max(axis=0)).astype(np.int64) + 1 - low)
    whole = Flat(normal, offset, along, cell, low, np.ones(size, bool), np.zeros(size), told=False)
    through = seen_through(whole, views, TUNING.plane_tolerance * spacing, THINGS.foot_through)
    return replace(whole, there=~through)
