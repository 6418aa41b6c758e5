"""Scores of scripts/bench truth, with the noise of the true pictures taken out."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirelight.base.colour import srgb_encode
from mirelight.compare import metrics
from mirelight.compare.regions import grown, silhouettes
from mirelight.compare.types import CompareSettings

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
Bool = NDArray[np.bool_]
Halves = tuple[F32, F32]  # (H, W, 3) linear pictures with independent noise

BAND = 2  # px on either side of a silhouette


@dataclass(frozen=True, slots=True)
class Score:
    """One frame against the truth; dB of display values, the truth's own noise taken out of squared errors."""

    light: float  # the true captured picture times the factor: the splats' own error is not in it
    light_edges: float  # the same round silhouettes
    psnr: float  # the frame itself
    edges: float
    ssim: float
    flip: float  # NaN without the extra `compare`


def shown(linear: NDArray[np.floating]) -> F64:
    """Display values of linear light at exposure 0, clipped."""
    return np.asarray(srgb_encode(np.clip(linear, 0, 1)), np.float64)


def squared_error(a: Halves, b: Halves) -> F64:
    """(H, W) squared difference of display values, mean over channels, unbiased by the noise of either side.

    With e + n1 and e + n2 the differences of both halves, and n1, n2 independent of mean 0, the mean of their product
    is e². (Display curves bend: where a picture's noise is not small, a little of it stays.)
    """
    first, second = (shown(x) - shown(y) for x, y in zip(a, b, strict=True))
    return np.asarray((first * second).mean(axis=-1))


def decibels(error: F64) -> float:
    """PSNR of a mean squared error; its mean over a few pixels of little error can fall below 0: 60 dB at most."""
    return min(metrics.psnr(max(float(error.mean()), 1e-6)), 60.0)


def edges_of(coverage: F32, depth: F32) -> Bool:
    """(H, W) a band round silhouettes of the true surface."""
    return grown(silhouettes(np.asarray(coverage > 0.5), depth), BAND)


def score(factor: F32, frame: F32, captured: Halves, truth: Halves, edges: Bool, scored: Bool | None = None) -> Score:
    """A frame's scores.

    Args:
        factor: (H, W, 3) what the splats were multiplied by, linear.
        frame: (H, W, 3) the frame, linear on black.
        captured: true pictures under the captured light.
        truth: under the new light.
        edges: (H, W) round silhouettes.
        scored: (H, W) pixels that count, where a sky is not of this; None: all. Means over windows leave the others
            as they truly are.
    """
    there = np.ones_like(edges) if scored is None else scored
    frame = np.where(there[..., None], frame, (truth[0] + truth[1]) / 2).astype(np.float32)
    alone = squared_error((captured[0] * factor, captured[1] * factor), truth)
    whole = squared_error((frame, frame), truth)
    seen, true = shown(frame).astype(np.float32), shown((truth[0] + truth[1]) / 2).astype(np.float32)
    return Score(
        light=decibels(alone[there]),
        light_edges=decibels(alone[edges & there]),
        psnr=decibels(whole[there]),
        edges=decibels(whole[edges & there]),
        ssim=float(metrics.ssim(true, seen).mean()),
        flip=_flip(true, seen),
    )


def _flip(true: F32, seen: F32) -> float:
    try:
        metrics.require(flip_alone=True)
    except Exception:
        return math.nan
    return float(metrics.flip(true, seen, CompareSettings()).mean())


def mean(scores: list[Score]) -> Score:
    """Of several frames, each figure by itself."""
    columns = zip(*((s.light, s.light_edges, s.psnr, s.edges, s.ssim, s.flip) for s in scores), strict=True)
    return Score(*(float(np.mean(x)) for x in columns))
