"""A dome of sky: splats far off all round, which worlds of image models and of game engines have behind their things.

It is no surface that light falls on, and would shut off all light from outside.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mirelight.model import F64
from mirelight.proxy.guess_tuning import GUESS


def on_dome(means: F64) -> NDArray[np.bool_]:
    """(N,) which of splats (N, 3) are of a dome; none where there is none.

    A dome is a shell, seen from within in most directions of one half of the sphere at least, many times farther off
    than the things, with hardly anything between. Walls of a room are no shell, and a ball holds nothing.
    """
    middle = np.median(means, axis=0)
    away = np.linalg.norm(means - middle, axis=1)
    inside = away < GUESS.dome_between * np.quantile(away, 1 - GUESS.dome_stray)
    if inside.mean() < GUESS.dome_things:
        return np.zeros(len(means), bool)
    middle = np.median(means[inside], axis=0)  # of the things: a half dome has its own middle above them
    ways = means - middle
    away = np.linalg.norm(ways, axis=1)
    far = float(np.quantile(away, 1 - GUESS.dome_stray))
    shell = away > GUESS.dome_thick * far
    between = ~shell & (away > GUESS.dome_between * far)
    things = ~shell & ~between
    if not things.any() or far < GUESS.dome_far * float(np.median(away[things])):
        return np.zeros(len(means), bool)
    if between.sum() > GUESS.dome_empty * shell.sum() or _covered(ways[shell]) < GUESS.dome_covered:
        return np.zeros(len(means), bool)
    return np.asarray(shell)


def _covered(ways: F64) -> float:
    """Of the half of the sphere that ways (N, 3) fill best, across any axis, the share that they fill."""
    cells = GUESS.dome_cells
    unit = ways / np.maximum(np.linalg.norm(ways, axis=1, keepdims=True), 1e-300)
    best = 0.0
    for axis in range(3):
        up, one, two = (unit[:, (axis + k) % 3] for k in range(3))
        row = np.minimum(((up + 1) / 2 * cells).astype(int), cells - 1)  # of equal area
        column = np.minimum(((np.arctan2(two, one) / np.pi + 1) * cells).astype(int), 2 * cells - 1)
        held = np.zeros((cells, 2 * cells), bool)
        held[row, column] = True
        best = max(best, float(held[: cells // 2].mean()), float(held[cells // 2 :].mean()))
    return best
