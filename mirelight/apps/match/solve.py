"""Non-negative least squares over pictures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirelight.apps.match.tone import seen_slope, seen_value
from mirelight.model import F64

_OUTLIER = 2.0  # residuals beyond so many standard deviations count by their size, not by its square (Huber 1964)
_LEAST_SPREAD = 1e-4  # of display values: below, pixels are as good as equal
_SEEN = 1e-6  # of the strongest column's power: a light that shows less cannot be used
_ROUNDS = 6  # of weights by residuals
_STEPS = 8  # of Newton's, at most
_SETTLED = 1e-4  # of the brightest light: a smaller change is none

Bool = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Column:
    """One unknown: what its unit adds to the picture, in one channel."""

    picture: F64  # (P, 3) linear light
    channel: int | None  # 0, 1 or 2: the one that it touches; None: all three, so that it keeps its colour

    @property
    def touched(self) -> slice:
        """The channels that it touches."""
        return slice(None) if self.channel is None else slice(self.channel, self.channel + 1)


def nonnegative(gram: F64, moment: F64) -> F64:
    """The x >= 0 that minimises x G x / 2 - m x.

    Args:
        gram: (n, n) symmetric, not negative; columns without any power stay at 0.
        moment: (n,).
    """
    from scipy.optimize import nnls

    power = np.sqrt(np.maximum(np.diag(gram), 0))
    scale = np.where(power > 0, power, 1)
    values, vectors = np.linalg.eigh(gram / np.outer(scale, scale))
    used = values > 1e-12 * max(float(values.max(initial=0)), 1e-300)
    roots = np.sqrt(values[used])
    found, _ = nnls(roots[:, None] * vectors[:, used].T, vectors[:, used].T @ (moment / scale) / roots)
    return np.where(power > 0, found / scale, 0.0)


def closest(columns: list[Column], target: F64, rest: F64, counts: F64, gain: float) -> tuple[F64, Bool]:
    """Weights of columns for the least difference of display values from a picture (Gauss and Newton's steps).

    Splats show a surface some percent too bright here and too dark there, in all columns alike. Fitted in light, such
    errors make every weight too small by their variance; of a curve close to a cube root nearly nothing is left.

    Args:
        columns: n of them.
        target: (P, 3) linear light.
        rest: (P, 3) light that is there anyway.
        counts: (P, 3) how much a pixel counts.
        gain: of the display.

    Returns:
        As :func:`fitted`.
    """
    aim, model = seen_value(target, gain), target
    for _ in range(_STEPS):
        slope = seen_slope(model, gain)
        light = model + (aim - seen_value(model, gain)) / slope
        found, told = fitted(columns, light - rest, slope * np.sqrt(counts))
        before, model = model, rest + summed(columns, found, rest.shape)
        if float(np.abs(model - before).max()) <= _SETTLED * float(np.abs(model).max()):
            break
    return found, told


def fitted(columns: list[Column], target: F64, weight: F64) -> tuple[F64, Bool]:
    """Weights of columns whose sum comes closest to a picture; outliers count less.

    Args:
        columns: n of them.
        target: (P, 3) linear light.
        weight: (P, 3) what a difference of light there is in display values; 0: does not count.

    Returns:
        (n,) weights, 0 or more; (n,) whether the picture tells anything of each.
    """
    trust = np.ones_like(target)
    power = np.array([_power(c, weight) for c in columns])
    seen = power > _SEEN * max(float(power.max(initial=0.0)), 1e-300)
    used = [c for c, s in zip(columns, seen, strict=True) if s]
    out = np.zeros(len(columns))
    if not used:  # of splats that are all black
        return out, seen
    for _ in range(_ROUNDS):
        x = nonnegative(*normal_equations(used, target, weight**2 * trust))
        off = np.abs(summed(used, x, target.shape) - target) * weight
        counted = off[weight > 0]
        spread = max(1.4826 * float(np.median(counted)), _LEAST_SPREAD) if counted.size else _LEAST_SPREAD
        trust = np.minimum(1, _OUTLIER * spread / np.maximum(off, 1e-300))
        out[seen] = x
    return out, seen


def summed(columns: list[Column], weights: F64, shape: tuple[int, ...]) -> F64:
    """(P, 3) the columns times their weights."""
    out = np.zeros(shape)
    for column, weight in zip(columns, weights, strict=True):
        out[:, column.touched] += weight * column.picture[:, column.touched]
    return out


def _power(column: Column, weight: F64) -> float:
    return float(((column.picture[:, column.touched] * weight[:, column.touched]) ** 2).sum())


def normal_equations(columns: list[Column], target: F64, weight: F64) -> tuple[F64, F64]:
    """(n, n) sum of w a b over the channels that both columns touch; (n,) sum of w a times the target (P, 3)."""
    n = len(columns)
    gram, moment = np.zeros((n, n)), np.zeros(n)
    for k in range(3):
        own = [i for i, c in enumerate(columns) if c.channel in (k, None)]
        if not own:
            continue
        a = np.stack([columns[i].picture[:, k] for i in own])
        weighted = a * weight[:, k]
        for row, i in enumerate(own):  # sums of fixed order, whatever the number of threads
            gram[i, own] += (weighted[row] * a).sum(axis=1)
        moment[own] += (weighted * target[:, k]).sum(axis=1)
    return gram, moment
