"""Plain walls of what is no room, as a yard's: planes through what pictures tell too little of.

Splats of a wall without a pattern hang before and behind it by more than surfaces may lie off their planes. Planes that
are several spacings thick go through such pixels, and just as many through hedges. On a wall nearly all that pictures
show is of one colour around, and they show each place in one colour.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mirelight.base.together import each
from mirelight.model import F64
from mirelight.proxy.depth import DepthMap
from mirelight.proxy.flats import Flat, behind, flats_of
from mirelight.proxy.labels import labelled
from mirelight.proxy.tuning import TUNING
from mirelight.proxy.types import Int

Bool = NDArray[np.bool_]


def plain_of(views: Sequence[DepthMap], flats: Sequence[Flat], spacing: float, radius: float) -> list[Flat]:
    """The plain walls that views show beside planes, largest first.

    Args:
        views: maps of a capture's own cameras.
        flats: the planes that they show.
        spacing: of the splats, world units.
        radius: of the capture, world units.
    """
    tolerance = TUNING.plane_tolerance * spacing
    rest = each(lambda view: _rest(view, flats, tolerance), views)
    thick = TUNING.plain_thick * spacing
    found = [flat for flat in flats_of(rest, thick, radius, least=0) if not _is_known(flat, flats, thick)]
    return [flat for flat in found if _is_plain(flat, views, rest, thick)]


def _rest(view: DepthMap, flats: Sequence[Flat], tolerance: float) -> DepthMap:
    """The view with what lies on no plane and has one colour around."""
    kept = (labelled(view, flats, tolerance).plane == len(flats)) & _is_even(view)
    trust = np.maximum(view.trust, np.float32(TUNING.plain_trust))
    return replace(view, depth=np.where(kept, view.depth, np.float32(0)), trust=trust)


def _is_even(view: DepthMap) -> Bool:
    """(H, W) pixels about which colours are much alike."""
    from scipy.ndimage import uniform_filter

    color, wide = view.color.astype(np.float64), (TUNING.plain_window, TUNING.plain_window, 1)
    spread = uniform_filter(color**2, wide) - uniform_filter(color, wide) ** 2
    return np.asarray(spread.sum(axis=2) < TUNING.plain_even**2)


def _is_known(flat: Flat, flats: Sequence[Flat], thick: float) -> bool:
    """Whether it is one of those planes, a little off."""
    at = flat.middles[flat.there.ravel()]
    alike = (x for x in flats if abs(float(x.normal @ flat.normal)) > TUNING.plane_cosine)
    return any(float(np.median(np.abs(x.off(at)))) < TUNING.plain_beside * thick for x in alike)


def _is_plain(flat: Flat, views: Sequence[DepthMap], rest: Sequence[DepthMap], thick: float) -> bool:
    """Whether views show places on a plane in one colour each, and nearly all in one colour around; `rest`: the views
    with what is so in them."""
    fine = flat.finer(TUNING.plain_places)
    at = fine.middles[fine.there.ravel()]
    count, even = np.zeros(len(at)), np.zeros(len(at))
    total, square = np.zeros((len(at), 3)), np.zeros((len(at), 3))
    for view, plain in zip(views, rest, strict=True):
        rows, pixel = _on(flat, at, view, thick)
        color = view.color.reshape(-1, 3)[pixel].astype(np.float64)
        count[rows] += 1
        even[rows] += plain.depth.ravel()[pixel] > 0
        total[rows] += color
        square[rows] += color**2
    told = count >= TUNING.plain_views
    if not told.any():
        return False
    count, even, mean, square = count[told], even[told], total[told], square[told]
    mean, square = mean / count[:, None], square / count[:, None]
    apart = np.sqrt(np.maximum(square - mean**2, 0)).mean(axis=1)
    most = float(np.quantile(apart, TUNING.plain_most))
    return bool((even / count).mean() > TUNING.plain_share and most < TUNING.plain_apart)


def _on(flat: Flat, at: F64, view: DepthMap, thick: float) -> tuple[Int, Int]:
    """Rows (M,) of points (N, 3) of a plane on which a view's surface may lie, for all that it knows, and their
    pixels."""
    rows, pixel, off, aslant = behind(view, flat, at)
    near = (aslant > TUNING.plain_aslant) & (np.abs(off) < thick + view.spread.ravel()[pixel] * aslant)
    return rows[near], pixel[near]
