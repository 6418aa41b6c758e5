"""Are two renderers' means the same? Block means over independent seeds, Welch's t, Šidák's correction."""

from __future__ import annotations

from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def block_means(pictures: Array, size: int) -> Array:
    """(K, H, W, C) -> (K, blocks, C) means over size x size pixels."""
    k, h, w, c = pictures.shape
    cut = pictures[:, : h // size * size, : w // size * size]
    return np.asarray(cut.reshape(k, h // size, size, w // size, size, c).mean(axis=(2, 4)).reshape(k, -1, c))


def worst_and_allowed(
    a: Array, b: Array, *, block: int = 8, false_alarm: float = 1e-4, rounding: float = 1e-5
) -> tuple[float, float]:
    """(largest |t| over blocks, channels and the whole, and the bound that chance passes once in 1 / false_alarm).

    a, b: (K, H, W, 3) pictures of independent seeds. Blocks where both are black are left out. `rounding` is the
    relative difference that the two may have of themselves: single precision, or a table's resolution.
    """
    t: list[Array] = []
    for size in (block, min(a.shape[1:3])):
        x, y = block_means(a, size), block_means(b, size)
        spread = x.var(axis=0, ddof=1) / len(x) + y.var(axis=0, ddof=1) / len(y)
        difference = x.mean(axis=0) - y.mean(axis=0)
        floor = rounding * np.maximum(np.abs(x.mean(axis=0)), np.abs(y.mean(axis=0)))
        some = spread > 0
        t.append(np.maximum(np.abs(difference[some]) - floor[some], 0) / np.sqrt(spread[some]))
    every = np.concatenate(t)
    freedom = len(a) + len(b) - 2
    p = 1 - (1 - false_alarm) ** (1 / len(every))
    z = NormalDist().inv_cdf(1 - p / 2)
    bound = z + (z**3 + z) / (4 * freedom) + (5 * z**5 + 16 * z**3 + 3 * z) / (96 * freedom**2)  # Cornish-Fisher
    return float(every.max()), float(bound)
