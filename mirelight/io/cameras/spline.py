"""The cubic spline that SuperSplat flies its camera along: Hermite segments with weighted central differences.

A key's derivative is the slope from the key before to the key after, times `smoothness` (0: straight lines with stops;
1: smooth); at the ends it is that of the only segment there is.
"""

from __future__ import annotations

import numpy as np

from mirelight.model import F64


def looped(duration: float, times: F64, points: F64) -> tuple[F64, F64]:
    """The keys (N,) and (N, K) with the last two before the first and the first two after the last, so that the end
    meets the start."""
    times = np.concatenate([times[-2:] - duration, times, times[:2] + duration])
    return times, np.concatenate([points[-2:], points, points[:2]])


def evaluate(times: F64, points: F64, smoothness: float, at: F64) -> F64:
    """Values (M, D) of the spline at M moments; before the first and after the last key it stands still.

    Args:
        times: (N,) of the keys, rising, N at least 2.
        points: (N, D) values of the keys.
        smoothness: 0 to 1.
        at: (M,).
    """
    before, after = np.maximum(np.arange(len(times)) - 1, 0), np.minimum(np.arange(len(times)) + 1, len(times) - 1)
    slopes = smoothness * (points[after] - points[before]) / (times[after] - times[before])[:, None]
    moment = np.clip(at, times[0], times[-1])
    i = np.clip(np.searchsorted(times, moment, side="right") - 1, 0, len(times) - 2)
    length = (times[i + 1] - times[i])[:, None]
    t = (moment - times[i])[:, None] / length
    return np.asarray(
        points[i] * (1 + 2 * t) * (1 - t) ** 2
        + slopes[i] * length * t * (1 - t) ** 2
        + points[i + 1] * t**2 * (3 - 2 * t)
        + slopes[i + 1] * length * t**2 * (t - 1)
    )
