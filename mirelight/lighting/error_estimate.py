"""How large a picture's error is: from some pixels that are sampled twice. NumPy only.

The samples of a pixel are one Sobol' sequence, so its batches complement each other, and its mean errs less than they
differ: by how much, no model tells beforehand, as edges, smooth light and rare paths settle each in their own way. So
some pixels are sampled a second time from a sequence of their own, as long as the first. Half the squared difference of
two independent means is their variance, whatever the light is; what of the spread of batches that is, is found for
pixels of like brightness together and holds for all of them. The second samples are not in the picture.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mirelight.model import F32

EVERY = 64  # one pixel in so many is sampled twice, which costs as much more
FEW = 512  # in small pictures more of them, up to so many
MOST = 8  # but never more than one in so many
FEWEST = 64  # pixels that tell anything
OF_A_CLASS = 96  # pixels of like brightness, that one factor is told from
CLASSES = 8  # at most


def chosen(pixels: int) -> NDArray[np.int64]:
    """(n,) the pixels that are sampled twice, in order; spread evenly, but not on a grid."""
    count = max(pixels // EVERY, min(FEW, pixels // MOST))
    if not count:
        return np.zeros(0, np.int64)
    return np.arange(count) * pixels // count + np.random.default_rng(0).integers(0, pixels // count, count)


def correct(variance: F32, mean: F32, apart: F32, some: NDArray[np.int64]) -> None:
    """A layer's variance from batches as if they were independent to the true one, in place.

    Args:
        variance: (N, 3) of each pixel's mean.
        mean: (N, 3)
        apart: (n, 3) mean less that of the second samples.
        some: (n,) pixels that have such.
    """
    stated = variance[some].sum(axis=1, dtype=np.float64)
    true = 0.5 * np.square(apart.astype(np.float64)).sum(axis=1)
    lit = (stated > 0) | (true > 0)
    if np.count_nonzero(lit) < FEWEST:
        return
    bright = mean.sum(axis=1)
    known, stated, true = bright[some][lit], stated[lit], true[lit]
    classes = min(max(len(known) // OF_A_CLASS, 1), CLASSES)
    edges = np.quantile(known, np.arange(1, classes) / classes)
    own = np.searchsorted(edges, known)
    stated, true = (np.bincount(own, x, classes) for x in (stated, true))
    factors = np.where(stated > 0, true / np.where(stated > 0, stated, 1), 1).astype(np.float32)
    variance *= factors[np.searchsorted(edges, bright)][:, None]
