"""What planes look like to most pictures: what looks otherwise in one of them stands before the plane.

Paint and smooth plastic tell an optimiser no place. Their splats are fog, and so are those of a wall without a pattern:
by depth alone nobody knows whether fog is the plane's behind it. But a red car is not the grey road.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mirelight.model import F32, F64
from mirelight.proxy.depth import DepthMap
from mirelight.proxy.flats import Flat, behind
from mirelight.proxy.tuning import TUNING
from mirelight.proxy.types import Int

Bool = NDArray[np.bool_]

_CHUNK = 1 << 15  # places at once


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """A plane's colours."""

    plane: Flat  # in cells that have one colour each
    color: F32  # (I, J, 3) display values of these; NaN where pictures do not agree

    @staticmethod
    def of(flat: Flat, views: Sequence[DepthMap], spacing: float) -> Look:
        """What most of the views that look at a place show there, be it the plane or not.

        Args:
            flat: the plane.
            views: maps of cameras.
            spacing: of the splats, world units.
        """
        times = np.sqrt(TUNING.look_places / max(int(flat.there.sum()), 1))
        plane = flat.finer(int(np.clip(times, 1, TUNING.look_fine)))
        at, there = plane.middles, np.flatnonzero(plane.there)
        color = np.full((len(at), 3), np.nan, np.float32)
        for start in range(0, len(there), _CHUNK):
            some = there[start : start + _CHUNK]
            color[some] = _agreed(_seen(plane, at[some], views, spacing))
        return Look(plane, color.reshape(*plane.there.shape, 3))

    def with_hidden(self, hidden: Bool) -> Look:
        """The same where something hides cells (I, J) of the plane: these are taken to look as those around."""
        from scipy.ndimage import binary_dilation, distance_transform_edt

        times = self.plane.there.shape[0] // hidden.shape[0]
        there = np.kron(hidden, np.ones((times, times), bool))
        around, none = binary_dilation(there, iterations=TUNING.look_rim * times), np.isnan(self.color[..., 0])
        if (around | none).all():
            return self
        at = distance_transform_edt(around | none, return_distances=False, return_indices=True)
        beside = there | around & none
        return replace(self, color=np.where(beside[..., None], self.color[tuple(at)], self.color))

    def other(self, color: F32, points: F64) -> F32:
        """(H, W) 0..1 whether pixels of a colour (H, W, 3) look otherwise than the plane at points (H, W, 3) on it; 0
        where that is not known."""
        i, inner = self.plane.cells(points)
        off = np.abs(color - self.color[i[..., 0], i[..., 1]]).sum(axis=-1)
        known = inner & np.isfinite(off)
        return np.where(known, np.clip(off / np.float32(TUNING.look_other) - 1, 0, 1), 0).astype(np.float32)


def _seen(flat: Flat, at: F64, views: Sequence[DepthMap], spacing: float) -> F32:
    """(V, N, 3) what views have in the pixels of points (N, 3) of a plane; NaN where one does not look there, or is
    sure of something before it."""
    out = np.full((len(views), len(at), 3), np.nan, np.float32)
    for color, view in zip(out, views, strict=True):
        rows, pixel, off, aslant = behind(view, flat, at)
        near = TUNING.plane_tolerance * spacing + view.spread.ravel()[pixel] * aslant
        before = (view.trust.ravel()[pixel] > TUNING.look_sure) & (off < -TUNING.look_before * near)
        shown = (aslant > TUNING.look_aslant) & ~before
        color[rows[shown]] = view.color.reshape(-1, 3)[pixel[shown]]
    return out


def _agreed(seen: F32) -> F32:
    """(N, 3) the median of what views show (V, N, 3), NaN: nothing; NaN where they are too few, or half of them show
    something else."""
    count = np.isfinite(seen[..., 0]).sum(axis=0)
    color = _median(seen, count)
    apart = _median(np.abs(seen - color).sum(axis=2, keepdims=True), count)[:, 0]
    color[(count < TUNING.look_views) | ~(apart < TUNING.look_apart)] = np.nan
    return color


def _median(values: F32, count: Int) -> F32:
    """(N, n) the lower median over the first axis of values (V, N, n), of which `count` (N,) are no NaN."""
    middle = np.maximum(count - 1, 0) // 2
    ordered = np.sort(values, axis=0)  # NaN last
    return np.asarray(np.take_along_axis(ordered, middle[None, :, None], axis=0)[0])
