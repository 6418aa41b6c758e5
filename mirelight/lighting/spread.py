"""How much smaller a pixel's error is than the spread of its batches says. NumPy only.

The samples of a pixel are one Sobol' sequence, so its batches complement each other, and the variance of the mean of n
samples falls like n^-p with p from 1 (as if they were independent) to 3 (smooth light). Taken as independent, the
spread of B batches gives a variance that is too large by (B^p - 1) / (B - 1).

p is told from two scales: let Q be the mean squared difference of the means of a pixel's two halves. That of means of
half as many samples is 2^p Q, and so on; the spread of B batches, split into such differences (Haar), then gives the
variance Q / 4 (B^p - 1) / (2^p - 1) / (B - 1), where the mean's own is Q / 4 / (2^p - 1).

That p is one number for many pixels, and falls with more samples: what is smooth settles first, what is rough remains.
So only a part of what it exceeds 1 by is counted on, and of few pixels, whose Q is uncertain, less.
"""

from __future__ import annotations

import numpy as np

from mirelight.model import F32

EVERY = 4  # the film keeps the difference of halves of one pixel in so many: enough for one number a layer
FEWEST = 64  # pixels that tell p
REMAINS = 2 / 3  # of p - 1 at the next scale; on the benchmark's scenes stated deviations then are the true ones
SURE = 2.0  # standard errors by which Q may be larger than it was found; more overstates what few pixels tell
STEEPEST = 3.0  # p of scrambled nets where the light is smooth


def share(variance: F32, halves: F32, mean: F32, batches: int) -> float:
    """What of a layer's stated variance is true, at most 1.

    Args:
        variance: (N, 3) of each pixel's mean, from its batches as if they were independent.
        halves: (N, 3) mean over the first half of the batches less that over the second.
        mean: (N, 3) over all of them.
        batches: of each pixel; an even number.

    Returns:
        1 where too few pixels or batches tell.
    """
    if batches < 4 or len(mean) < FEWEST:
        return 1.0
    squared = mean.astype(np.float64) ** 2
    floor = 0.01 * squared.mean()
    if floor == 0:
        return 1.0
    weight = 1 / (squared + floor)
    found = (weight * halves.astype(np.float64) ** 2).sum(axis=1)
    spreads = (weight * variance).sum(axis=1, dtype=np.float64) * 4 * (batches - 1)
    spread = float(spreads.sum())
    # what pixels have of Q beyond their share of the spread: a ratio's error, which noise that both have is not in
    beyond = found - spreads * (found.sum() / spread) if spread > 0 else found
    top = float(found.sum() + SURE * np.sqrt(np.square(beyond).sum()))
    low, high = 1.0, STEEPEST
    if spread <= top * _sum_of_levels(low, batches):
        return 1.0
    for _ in range(30):
        middle = (low + high) / 2
        low, high = (middle, high) if spread > top * _sum_of_levels(middle, batches) else (low, middle)
    return float((batches - 1) / (batches ** (1 + REMAINS * (low - 1)) - 1))


def _sum_of_levels(p: float, batches: int) -> float:
    return float((batches**p - 1) / (2**p - 1))
