"""A factor continued into gaps of the proxy and past its silhouettes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mirelight.model import F32
from mirelight.relighting.mode import Seen
from mirelight.relighting.pixels import divide, multiply
from mirelight.relighting.resample import bilinear

NEAR, FAR = 0.03, 0.08  # shares of the picture's longer side: so far the factor is carried in full, so far at all
_CELL = 0.005  # share of the longer side: distances are measured between cells of this size
_FAINTER = np.float32(0.25)  # weight of a value from blocks twice as large, against one from the block itself


def continued(factor: F32, seen: Seen, background: float) -> F32:
    """The factor, continued into gaps of the proxy and past its silhouettes; far from it, `background`.

    Splats reach past the proxy, and there an unchanged colour would stand out as an outline in the captured light.

    Args:
        factor: (H, W, 3); used up.
        seen: where it holds: the proxy covers something.
        background: the factor beyond `FAR` from the proxy.
    """
    if seen.all():
        return factor
    known = seen[..., None].astype(np.float32)
    multiply(factor, known, factor)
    closeness = _closeness(seen)
    near = np.flatnonzero((closeness > 0) & ~seen)
    values = _read(_filled(_halved(factor), _halved(known)), near, seen.shape[1])
    share = closeness.reshape(-1)[near, None]
    far = np.float32(background) * (1 - known[..., 0])
    for channel in range(3):
        factor[..., channel] += far
    factor.reshape(-1, 3)[near] = values[:, :3] / values[:, 3:] * share + np.float32(background) * (1 - share)
    return factor


# --- values ----------------------------------------------------------------------------------------------------------


def _filled(sums: F32, counts: F32) -> F32:
    """Every block's value, its own or from larger blocks (Gortler et al. 1996, "The lumigraph", section 3.4.1).

    Args:
        sums: (h, w, 3) of the known values of each block.
        counts: (h, w, 1) how many they are.

    Returns:
        (h, w, 4) values times a weight, and the weight: 1 at the most, less the larger the blocks they come from.
    """
    known = counts > 0
    own = np.concatenate([divide(sums, counts), known], axis=-1, dtype=np.float32)
    if known.all() or known.size == 1:
        return own
    height, width = known.shape[:2]
    coarse = _filled(_halved(sums), _halved(counts))
    above = _doubled(_doubled(coarse, 0), 1)[:height, :width]
    return np.asarray(np.where(known, own, above * _FAINTER), dtype=np.float32)


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
