"""How far found lights may be off, told from where the frame still differs from the picture."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mirelight.apps.match.solve import Bool, Column, normal_equations, summed
from mirelight.apps.match.tone import seen_slope, seen_value
from mirelight.model import F64

ACROSS = 9  # tiles along a picture's shorter side: farther apart, a scene's errors are as good as independent
_ALIKE = 1e-9  # of the largest eigenvalue: along smaller ones columns cannot be told apart
_PART = 1e-3  # a light with a larger component along such a direction is not known

Int = NDArray[np.int64]


def tiles(size: tuple[int, int]) -> Int:
    """(H * W,) in which tile each pixel lies, row by row."""
    short = min(size)
    down, right = (np.arange(n) * max(round(ACROSS * n / short), 1) // n for n in size)
    return np.asarray(down[:, None] * (int(right.max()) + 1) + right, np.int64).ravel()


def uncertainties(
    columns: list[Column], weights: F64, told: Bool, target: F64, rest: F64, counts: F64, gain: float, tile: Int
) -> F64:
    """How far weights may be off: what leaving out each tile would change, all changes added up.

    A scene's errors are alike over whole areas (a colour, a shadow, something that is missing), and nothing says that
    they cancel from area to area as noise does. So the first-order changes G^-1 sum(w a r) of the tiles (the
    infinitesimal jackknife of Jaeckel 1972) are added by size and not in quadrature: as if all of them pulled a light
    the same way. What a light's error does to the whole of the picture alike, no residual shows.

    Args:
        columns: n of them, of single channels or of all three.
        weights: (n,) those found.
        told: (n,) whether the picture tells anything of each.
        target: (P, 3) linear light.
        rest: (P, 3) light that is there anyway.
        counts: (P, 3) how much a pixel counts.
        gain: of the display.
        tile: (P,) as :func:`tiles` gives.

    Returns:
        (n,) 0 or more, in the weights' unit; inf where nothing is told of a column, or nothing apart from others.
    """
    model = rest + summed(columns, weights, rest.shape)
    slope = seen_slope(model, gain)
    weight = slope**2 * counts
    off = (seen_value(target, gain) - seen_value(model, gain)) * slope * counts
    out = np.full(len(columns), np.inf)
    for channel in dict.fromkeys(c.channel for c in columns):
        own = [i for i, c in enumerate(columns) if c.channel == channel and told[i]]
        if not own:
            continue
        gram, _ = normal_equations([columns[i] for i in own], off, weight)
        size = np.sqrt(np.diag(gram))
        pulls = np.array([_by_tile(columns[i], off, tile) for i in own]) / size[:, None]
        values, vectors = np.linalg.eigh(gram / np.outer(size, size))
        alike = values <= _ALIKE * values[-1]
        solved = vectors[:, ~alike] @ ((vectors[:, ~alike].T @ pulls) / values[~alike, None])
        unknown = (np.abs(vectors[:, alike]) > _PART).any(axis=1)
        out[own] = np.where(unknown, np.inf, np.abs(solved).sum(axis=1) / size)
    return out


def _by_tile(column: Column, off: F64, tile: Int) -> F64:
    """(T,) how much each tile asks for more of a column."""
    more = (off[:, column.touched] * column.picture[:, column.touched]).sum(axis=1)
    return np.asarray(np.bincount(tile, more), np.float64)
