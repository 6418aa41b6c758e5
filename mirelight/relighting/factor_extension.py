"""A factor continued into gaps of the proxy and past its silhouettes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirelight.model import F32
from mirelight.relighting.mode import Seen
from mirelight.relighting.pixels import divide, multiply
from mirelight.relighting.resample import bilinear

NEAR, FAR = 0.03, 0.08  # shares of the picture's longer side: so far the factor is carried in full, so far at all
_CELL = 0.005  # share of the longer side: distances are measured between cells of this size
_FAINTER = np.float32(0.25)  # weight of a value from blocks twice as large, against one from the block itself


class Continuation:
    """A factor continued into gaps of the proxy and past its silhouettes; far from it, the background.

    Splats reach past the proxy, and there an unchanged colour would stand out as an outline in the captured light. All
    that depends on the mask alone is made once, for many factors of one view.

    Args:
        seen: (H, W) where factors hold: the proxy covers something.
        beyond: (H, W) share of what is there that is no part of the surface, and takes the background; None: nothing.

    Attributes:
        seen: (H, W) where the background does not count.
    """

    def __init__(self, seen: Seen, beyond: F32 | None = None) -> None:
        self._width = seen.shape[1]
        self._through = np.flatnonzero(seen & (beyond > 0)) if beyond is not None else np.zeros(0, np.intp)
        self._through_at = np.divmod(self._through, self._width)
        self._past = None if beyond is None else beyond.reshape(-1)[self._through, None]
        self.seen = seen if beyond is None else seen & (beyond <= 0)
        self._all = bool(seen.all())
        if self._all:
            return
        self._known = seen[..., None].astype(np.float32)
        closeness = _closeness(seen)
        self._near = np.flatnonzero((closeness > 0) & ~seen)
        self._near_at = np.divmod(self._near, self._width)  # rows and columns
        self._share = closeness.reshape(-1)[self._near, None]
        if beyond is not None:
            self._share = self._share * (1 - beyond.reshape(-1)[self._near, None])
        self._counts = [_halved(self._known)]
        while not ((self._counts[-1] > 0).all() or self._counts[-1].size == 1):
            self._counts.append(_halved(self._counts[-1]))
        self._weight = _read(_filled([x > 0 for x in self._counts], self._counts), self._near, self._width)

    def __call__(self, factor: F32, background: float | F32) -> F32:
        """The factor (H, W, 3), used up, with `background` beyond `FAR` from the proxy: a number, or (H, W, 3), or what
        broadcasts to it."""
        beyond = np.broadcast_to(np.asarray(background, np.float32), factor.shape)
        if not self._all:
            self._carry(factor, beyond)
        if self._past is not None:
            flat = factor.reshape(-1, 3)
            flat[self._through] += (beyond[self._through_at] - flat[self._through]) * self._past
        return factor

    def _carry(self, factor: F32, beyond: F32) -> None:
        """Fill the factor (H, W, 3) where it does not hold, with `beyond` (H, W, 3) far from where it does."""
        multiply(factor, self._known, factor)
        sums = [_halved(factor)]
        for _ in self._counts[1:]:
            sums.append(_halved(sums[-1]))
        own = [divide(total, count) for total, count in zip(sums, self._counts, strict=True)]
        values = _read(_filled(own, self._counts), self._near, self._width)
        unknown = 1 - self._known[..., 0]
        for channel in range(3):
            factor[..., channel] += beyond[..., channel] * unknown
        faded = beyond[self._near_at] * (1 - self._share)
        factor.reshape(-1, 3)[self._near] = values / self._weight * self._share + faded


# --- values ----------------------------------------------------------------------------------------------------------


def _filled(own: Sequence[NDArray[Any]], counts: Sequence[F32]) -> F32:
    """Every block's value, its own or from larger blocks, times a weight that falls with their size (Gortler et al.
    1996, "The lumigraph", section 3.4.1).

    Args:
        own: (h, w, n) the mean of the known values of each block, level by level, each with blocks twice as large.
        counts: (h, w, 1) how many they are.
    """
    filled = own[-1].astype(np.float32)
    for mean, count in zip(own[-2::-1], counts[-2::-1], strict=True):
        height, width = count.shape[:2]
        above = _doubled(_doubled(filled, 0), 1)[:height, :width]
        filled = np.asarray(np.where(count > 0, mean, above * _FAINTER), dtype=np.float32)
    return filled


def _halved(image: F32) -> F32:
    """(ceil(h / 2), ceil(w / 2), n) sums over blocks of 2 x 2 of (h, w, n)."""
    height, width = image.shape[:2]
    if height % 2 or width % 2:
        image = np.pad(image, ((0, height % 2), (0, width % 2), (0, 0)))
    rows = image[0::2] + image[1::2]
    return np.asarray(rows[:, 0::2] + rows[:, 1::2], dtype=np.float32)


def _read(halved: F32, pixels: NDArray[np.intp], width: int) -> F32:
    """(N, n) bilinear between the centres of blocks of 2 x 2 (h, w, n), at pixels (N,) of an image `width` wide."""
    rows, columns = halved.shape[:2]
    y, x = np.divmod(pixels, width)
    own_y, own_x = y >> 1, x >> 1  # the pixel's block, and beside it the one that it lies next to
    beside_y = np.clip(own_y + 2 * (y & 1) - 1, 0, rows - 1)
    beside_x = np.clip(own_x + 2 * (x & 1) - 1, 0, columns - 1)
    flat = halved.reshape(rows * columns, -1)
    out: F32 = flat.take(own_y * columns + own_x, axis=0) * np.float32(9 / 16)
    out += flat.take(own_y * columns + beside_x, axis=0) * np.float32(3 / 16)
    out += flat.take(beside_y * columns + own_x, axis=0) * np.float32(3 / 16)
    out += flat.take(beside_y * columns + beside_x, axis=0) * np.float32(1 / 16)
    return out


def _doubled(image: F32, axis: int) -> F32:
    """Twice as many rows (axis 0) or columns (1), bilinear between pixel centres, edges repeated."""
    source = np.moveaxis(image, axis, 0)
    shape = list(image.shape)
    shape[axis] *= 2
    out = np.empty(shape, dtype=np.float32)
    target = np.moveaxis(out, axis, 0)
    near, far = source * np.float32(0.75), source * np.float32(0.25)
    target[0::2] = near
    target[1::2] = near
    target[2::2] += far[:-1]
    target[1:-1:2] += far[1:]
    target[0] += far[0]
    target[-1] += far[-1]
    return out


# --- how far ---------------------------------------------------------------------------------------------------------


def _closeness(seen: Seen) -> F32:
    """(H, W) 1 up to NEAR from what is seen, falling smoothly to 0 at FAR."""
    height, width = seen.shape
    side = max(height, width)
    cell = max(1, round(_CELL * side))
    whole = np.pad(seen, ((0, -height % cell), (0, -width % cell)))
    rows, columns = whole.shape[0] // cell, whole.shape[1] // cell
    cells: Seen = np.asarray(whole.reshape(rows, cell, columns, cell).any(axis=(1, 3)))
    distance = np.sqrt(_squared_distances(cells, int(FAR * side / cell) + 1)) * np.float32(cell / side)
    t = np.clip((np.float32(FAR) - distance) / np.float32(FAR - NEAR), 0, 1)
    smooth = np.asarray(t * t * (3 - 2 * t), dtype=np.float32)
    return np.ascontiguousarray(bilinear(smooth, whole.shape)[:height, :width])


def _squared_distances(cells: Seen, reach: int) -> F32:
    """(rows, columns) squared distance to the nearest marked cell, in cells; those farther than `reach` are farther."""
    rows, columns = cells.shape
    at = np.arange(columns)
    nowhere = rows + columns + reach
    before = np.maximum.accumulate(np.where(cells, at, -nowhere), axis=1)
    after = np.minimum.accumulate(np.where(cells, at, columns + nowhere)[:, ::-1], axis=1)[:, ::-1]
    along = (np.minimum(at - before, after - at) ** 2).astype(np.float32)
    nearest = along.copy()
    for step in range(1, min(reach, rows - 1) + 1):
        np.minimum(nearest[step:], along[:-step] + np.float32(step * step), out=nearest[step:])
        np.minimum(nearest[:-step], along[step:] + np.float32(step * step), out=nearest[:-step])
    return nearest
