"""Maps of an environment, made small enough to be kept with a data set."""

from __future__ import annotations

import numpy as np

from mirelight.model import F32

MOST_ROWS = 1024  # of a map that is kept with a data set


def shrunk(radiance: F32, most: int = MOST_ROWS) -> F32:
    """A map (H, W, 3) of at most so many rows and twice as many columns, each pixel the mean of those that it stands
    for."""
    height, width, _ = radiance.shape
    down, across = -(-height // most), -(-width // (2 * most))
    if (down, across) == (1, 1):
        return radiance
    padded = np.pad(radiance, ((0, -height % down), (0, -width % across), (0, 0)), mode="edge")
    share = np.sin(np.pi * (np.arange(len(padded)) + 0.5) / len(padded)) if not height % down else np.ones(len(padded))
    weights = share.reshape(-1, down, 1, 1, 1)
    blocks = padded.reshape(len(padded) // down, down, -1, across, 3).astype(np.float64) * weights
    return np.asarray(blocks.sum(axis=1).mean(axis=2) / weights.sum(axis=1)[:, 0], dtype=np.float32)
