"""Where the next samples go, so that the whole frame reaches a noise target with the fewest. NumPy only.

A frame's squared error is mean(s² / n) over pixels, where s² is a pixel's variance of one sample relative to its
brightness and n its samples. For a given sum of n it is least where n is in proportion to s (Neyman 1934). s² is
estimated from the *other* pixels of a window: a pixel's own samples have no say in how many more it gets, so its mean
stays unbiased, where stopping at a pixel's own estimate would favour those that have missed what is rare and bright.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from mirelight.model import F32, F64

WINDOW = 3  # pixels to each side that a pixel's noise is estimated from
MOST_SAMPLES = 1 << 16  # where a noise target gives up
GROWTH = 4.0  # most that one look multiplies a pixel's samples by, as early estimates are rough
MARGIN = 0.985  # of the target is aimed at, so that the last look is seldom one too few
STEP = 16  # samples that a pixel gets at once: a pass, and a batch


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """The noise of a frame in progress."""

    relative_noise: float  # as `LightingBuffer.relative_noise`, of the samples alone
    spread: F64  # (H * W) s, the relative standard deviation of one sample, from the pixels around
    samples: NDArray[np.int64]  # (H * W) so far
    covered: NDArray[np.bool_]  # (H * W)
    of_surface: float = 0.0  # the same of light that is read from the surface, which samples do not lessen

    @classmethod
    def of(
        cls,
        sums: F32,
        squares: F32,
        hits: F32,
        samples: NDArray[np.int64],
        batch: int,
        shape: tuple[int, int],
        doubt: F32 | None = None,
    ) -> Self:
        """From sums over samples (H * W * 3) and over squared batches (H * W * 3), samples that hit (H * W), and sums
        of half the difference of two fills (H * W * 3)."""
        n = samples.astype(np.float32)[:, None]
        mean = sums.reshape(-1, 3) / n
        variance = np.maximum(squares.reshape(-1, 3) / (batch * n) - mean * mean, 0) / (n / batch - 1)
        covered = hits > 0
        floor = 0.01 * float(mean[covered].mean(dtype=np.float64)) ** 2 if covered.any() else 0.0
        if floor == 0:
            return cls(0.0, np.zeros(len(samples)), samples, covered)
        relative = np.where(covered, (variance / (mean * mean + np.float32(floor))).mean(axis=1), 0).astype(np.float64)
        noise = float(np.sqrt(relative[covered].mean()))
        of_surface = 0.0
        if doubt is not None:
            squares = np.square(doubt.reshape(-1, 3) / n) / (mean * mean + np.float32(floor))
            of_surface = float(np.sqrt(squares[covered].mean(dtype=np.float64)))
        around = _sum_around((relative * samples).reshape(shape))
        count = _sum_around(covered.reshape(shape).astype(np.float64))
        spread = np.sqrt(np.maximum(around, 0) / np.maximum(count, 1)).ravel()
        return cls(noise, spread, samples, covered, of_surface)

    def wanted(self, target: float) -> NDArray[np.int64]:
        """(H * W) samples that each pixel should have before the next look: no fewer than it has, by whole STEPs.

        Where light from the surface leaves little of the target to samples, or nothing, they are brought to half of it.
        """
        target = math.sqrt(max(target**2 - self.of_surface**2, (target / 2) ** 2))
        now = self.samples.astype(np.float64)
        spread2 = self.spread[self.covered] ** 2
        predicted = float(np.mean(spread2 / now[self.covered])) if len(spread2) else 0.0
        if predicted == 0 or self.relative_noise <= target:
            return self.samples
        aim = predicted * (MARGIN * target / self.relative_noise) ** 2  # the windows' estimate is off by a factor
        low, high = 0.0, float(self.spread[self.covered].mean()) / aim  # n = high * s reaches the aim without the past
        for _ in range(24):
            middle = (low + high) / 2
            n = np.maximum(now[self.covered], middle * self.spread[self.covered])
            low, high = (low, middle) if np.mean(spread2 / n) < aim else (middle, high)
        n = np.minimum(np.maximum(high * self.spread, now), GROWTH * now)
        steps = np.ceil((n - now) / STEP - 0.5).astype(np.int64)
        if not steps.any():  # rounding left nothing: the neediest pixel's step for all that need as much
            steps = (self.spread / now >= 0.9 * np.max(self.spread / now)).astype(np.int64)
        return np.where(self.samples < MOST_SAMPLES, self.samples + STEP * steps, self.samples)


def both_halves(sums: F32, squares: F32, hits: F32, batches: F64) -> tuple[F32, F32, F32]:
    """Sums (N * 3), squares (N * 3) and hits (N) of surface and inserted objects together, from those of the one and
    then of the other, (2 * N * 3) and (2 * N); `batches`: (N).

    A sample shows one or the other, so both as if they were independent overstate the noise where they meet.
    """
    (a, b), (aa, bb), (first, second) = (x.reshape(2, -1) for x in (sums, squares, hits))
    return a + b, np.asarray(aa + bb + 2 * a * b / np.repeat(batches, 3), np.float32), first + second


def _sum_around(image: F64) -> F64:
    """Sum over the window round each pixel, itself left out."""
    return window_sum(image, WINDOW) - image


def window_sum(image: F64, reach: int) -> F64:
    """(H, W) sum over the (2 reach + 1)² pixels round each, edges cut."""
    h, w = image.shape
    table = np.zeros((h + 1, w + 1))
    np.cumsum(np.cumsum(image, axis=0), axis=1, out=table[1:, 1:])
    (top, bottom), (left, right) = (
        (np.maximum(np.arange(n) - reach, 0), np.minimum(np.arange(n) + reach + 1, n)) for n in (h, w)
    )
    return np.asarray(table[bottom][:, right] - table[top][:, right] - table[bottom][:, left] + table[top][:, left])
