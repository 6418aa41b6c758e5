"""A factor continued into gaps of the proxy and past its silhouettes."""

from __future__ import annotations

import numpy as np

from mirelight.model import F32
from mirelight.relight.mode import Seen
from mirelight.relight.resample import divide

_REACH = 0.01  # share of the picture's longer side up to which the factor is carried past the proxy


def continued(factor: F32, seen: Seen, background: float) -> F32:
    """The factor, continued into gaps of the proxy and past its silhouettes; far from it, `background`.

    Splats reach past the proxy, and there an unchanged colour would stand out as an outline in the captured light.

    Args:
        factor: (H, W, 3); used up.
        seen: where it holds: the proxy covers something.
        background: the factor far from the proxy.
    """
    if seen.all():
        return factor
    weight = seen[..., None].astype(np.float32)
    factor *= weight
    filled = _from_coarser(np.concatenate([factor, weight], axis=-1), _REACH * max(seen.shape))
    trust = filled[..., 3:]
    filled[..., :3] *= trust
    filled[..., :3] += np.float32(background) * (1 - trust)
    filled[..., :3] *= 1 - weight
    factor += filled[..., :3]
    return factor


def _from_coarser(total: F32, reach: float) -> F32:
    """Every block's value from blocks twice as large: the gaps' own (Gortler et al. 1996, "The lumigraph", 3.4.1).

    Args:
        total: (h, w, 4) sum of the known values of each block, and how many there are.
        reach: blocks up to which a value is fully trusted; each doubling beyond halves the trust.

    Returns:
        (h, w, 4) values, and trust from 0 to 1.
    """
    height, width = total.shape[:2]
    even = total
    if height % 2 or width % 2:
        even = np.pad(total, ((0, height % 2), (0, width % 2), (0, 0)))
    rows = even[0::2] + even[1::2]
    coarse = _filled(rows[:, 0::2] + rows[:, 1::2], reach / 2)
    above = _doubled(_doubled(coarse, 0), 1)[:height, :width]
    if reach < 1:
        above[..., 3] *= np.float32(0.5)
    return above


def _filled(total: F32, reach: float) -> F32:
    """The blocks' own means where something is known, else those of :func:`_from_coarser`."""
    known = total[..., 3:] > 0
    values = divide(total, total[..., 3:])  # the last channel becomes 1 where something is known, else 0
    if known.all() or known.size == 1:
        return values
    return np.asarray(np.where(known, values, _from_coarser(total, reach)), dtype=np.float32)


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
