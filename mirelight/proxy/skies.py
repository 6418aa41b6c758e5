"""What pictures show of a sky: fog that hangs anywhere, told by its depth and by how it looks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirelight.base.together import each
from mirelight.compositor.supersample import mean
from mirelight.model import F32, F64
from mirelight.proxy.depth import DepthMap
from mirelight.proxy.flats import Bool, Flat, depth_of
from mirelight.proxy.tuning import TUNING
from mirelight.proxy.views import dot, rays

_CELLS = 6  # that colours are blurred by: means over blocks tell as much as pixels do, in a tenth of the time


@dataclass(frozen=True, slots=True, eq=False)
class Sky:
    """What views show beside surfaces: fog, most of all above the horizon, if it is white or looks as fog around."""

    fog: float  # the trust below which pixels show no surface, see :func:`fog_of`; 0: no sky
    up: F64 | None = None  # (3,) unit; None: not known

    def least(self, view: DepthMap, directions: F64) -> F32:
        """(H, W) that trust for a view's pixels, which look along directions (H, W, 3)."""
        if self.up is None or not self.fog:
            return np.full(view.depth.shape, self.fog, np.float32)
        above = dot(directions, self.up) > 0
        deep = large(above & (view.trust < self.fog))
        alike = above & ((view.color.min(axis=2) > TUNING.clipped) | (unlike(view.color, deep) < TUNING.sky_alike))
        least = np.where(alike, TUNING.sky_white * self.fog, self.fog).astype(np.float32)
        least[_joined(deep, alike, view.trust)] = np.inf
        return least


def unlike(color: F32, sky: Bool) -> F32:
    """(H, W) how far pixels of a picture (H, W, 3) are from the mean of a mask's (H, W) around them, in any channel;
    infinite where little around is of it."""
    from scipy.ndimage import gaussian_filter

    cell = max(1, round(TUNING.sky_around * sky.shape[1] / _CELLS))
    known = _means(sky, cell)
    wide = TUNING.sky_around * sky.shape[1] / cell
    sums = [gaussian_filter(_means(np.where(sky, color[..., k], 0), cell), wide) for k in range(3)]
    known = gaussian_filter(known, wide)
    apart = np.zeros(sky.shape, np.float32)
    for k, total in enumerate(sums):
        usual = _spread(total / np.maximum(known, np.float32(1e-6)), cell, sky.shape)
        np.maximum(apart, np.abs(color[..., k] - usual), out=apart)
    apart[_spread(known, cell, sky.shape) < TUNING.sky_known] = np.inf
    return apart


def _means(values: NDArray[Any], cell: int) -> F32:
    """(h, w) of blocks of so many pixels a side, past the edge nothing, of (H, W)."""
    height, width = values.shape
    return mean(np.pad(values, ((0, -height % cell), (0, -width % cell))).astype(np.float32), cell)


def _spread(blocks: F32, cell: int, shape: tuple[int, ...]) -> F32:
    """(H, W) the value of each pixel's block."""
    return np.asarray(blocks.repeat(cell, axis=0).repeat(cell, axis=1)[: shape[0], : shape[1]])


def _joined(sky: Bool, alike: Bool, trust: F32) -> Bool:
    """(H, W) what looks as a sky (H, W) and goes on from it without an edge, however much fog there is trusted.

    What is as sure as a surface is one, but for a rim: a house's splats are a little wider than the house.
    """
    from scipy.ndimage import binary_dilation, binary_propagation

    doubted = binary_propagation(sky, mask=sky | (alike & (trust < TUNING.sky_sure)))
    return np.asarray(binary_dilation(doubted, iterations=TUNING.sky_rim, mask=sky | alike))


def large(there: Bool) -> Bool:
    """(H, W) the large pieces of a mask (H, W): windows mirror a sky, too."""
    from scipy.ndimage import label

    piece, _ = label(there)
    size = np.bincount(piece.ravel())
    size[0] = 0
    return np.asarray((size > TUNING.sky_piece * there.size)[piece])


def fog_of(views: Sequence[DepthMap], flats: Sequence[Flat] = ()) -> float:
    """The trust below which pixels on no plane show no surface: 0 unless the views show a sky.

    What pictures show of a sky hangs anywhere, and so does what they tell nothing else of; without a sky, as in a room,
    a surface in a wrong place shuts out more wrong light than none. What hangs before a plane is no sky: even walls are
    as hard to place.
    """

    def hanging(view: DepthMap) -> int:
        hangs = (view.depth > 0) & (view.trust < TUNING.sky_trust)
        if hangs.any():
            _, directions = rays(view.camera)
            hangs &= ~np.any([depth_of(view, flat, directions) > 0 for flat in flats], axis=0)
        return int(hangs.sum())

    deep = sum(each(hanging, views))
    return TUNING.fog if deep > TUNING.sky_share * sum(int((view.depth > 0).sum()) for view in views) else 0.0
