"""Are two renderers' means the same, or one's and a formula's? Means over independent seeds, t, Šidák's correction."""

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
        t.append(_scores(x.mean(axis=0), y.mean(axis=0), spread, rounding))
    every = np.concatenate(t)
    return float(every.max()), _bound(len(every), len(a) + len(b) - 2, false_alarm)


def worst_against_truth(
    measured: Array, truth: Array, *, false_alarm: float = 1e-4, rounding: float = 2e-5
) -> tuple[float, float]:
    """The same for means (K, N) of independent seeds against N true values."""
    spread = measured.var(axis=0, ddof=1) / len(measured)
    t = _scores(measured.mean(axis=0), truth, spread, rounding)
    return float(t.max(initial=0.0)), _bound(max(len(t), 1), len(measured) - 1, false_alarm)


def _scores(a: Array, b: Array, spread: Array, rounding: float) -> Array:
    """|t| of differences beyond rounding; a difference without any spread counts as endless."""
    beyond = np.maximum(np.abs(a - b) - rounding * np.maximum(np.abs(a), np.abs(b)), 0)
    some = (spread > 0) | (beyond > 0)
    return np.asarray(beyond[some] / np.sqrt(np.maximum(spread[some], 1e-300)))


def _bound(count: int, freedom: int, false_alarm: float) -> float:
    p = 1 - (1 - false_alarm) ** (1 / count)
    z = NormalDist().inv_cdf(1 - p / 2)
    return z + (z**3 + z) / (4 * freedom) + (5 * z**5 + 16 * z**3 + 3 * z) / (96 * freedom**2)  # Cornish-Fisher
