"""Tone curves turned back, scene-linear light from display-linear light, and what a difference of light looks like."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mirelight.model import F32, F64, ToneCurve

CURVES: tuple[ToneCurve, ...] = ("none", "aces", "neutral")  # AgX mixes channels at both ends, and clips between
_SHADOW = 0.02  # display-linear light added to all: black is no better known


def seen_value(light: F64, gain: float) -> F64:
    """Display values, in the shape of `light`, of light times `gain`: the sRGB curve without its straight piece, and
    even in the shadows."""
    return np.asarray(1.055 * (np.maximum(light, 0) * gain + _SHADOW) ** (1 / 2.4))


def seen_slope(light: F64, gain: float) -> F64:
    """What a small difference, in the shape of `light`, of light is in values of :func:`seen_value`."""
    return np.asarray(gain * 1.055 / 2.4 * (np.maximum(light, 0) * gain + _SHADOW) ** (1 / 2.4 - 1))


def inverse(shown: F32, curve: ToneCurve) -> tuple[F32, NDArray[np.bool_]]:
    """The light x with `colour.tone_map(x, curve) == shown`.

    Args:
        shown: (..., 3) display-linear, 0 to 1.
        curve: one of `CURVES`.

    Returns:
        (..., 3) light; (..., 3) whether it is known: not where the curve never gets as bright.
    """
    y = shown.astype(np.float64)
    if curve == "aces":
        return _aces(y)
    if curve == "neutral":
        return _neutral(y)
    return shown, np.ones(shown.shape, bool)


def _aces(y: NDArray[np.float64]) -> tuple[F32, NDArray[np.bool_]]:
    """The positive root of x (a x + b) = y (x (c x + d) + e), with the numbers of `colour.tone_map`."""
    a, b, c, d, e = 2.51, 0.03, 2.43, 0.59, 0.14
    square, plain = a - c * y, b - d * y
    root = (-plain + np.sqrt(plain**2 + 4 * square * e * y)) / (2 * square)  # a - c y > 0 up to y = 1.03
    return root.astype(np.float32), np.ones(y.shape, bool)


def _neutral(y: NDArray[np.float64]) -> tuple[F32, NDArray[np.bool_]]:
    """Khronos PBR Neutral step by step: highlights made darker and coloured again, then the offset put back."""
    fresnel, start, desaturation = 0.04, 0.76, 0.15
    room = 1 - start
    top = y.max(axis=-1, keepdims=True)
    known = top < 0.995  # white is the curve's end
    bright = np.clip(top, start, 0.995)
    peak = room**2 / (1 - bright) - room + start
    towards_white = 1 - 1 / (desaturation * (peak - bright) + 1)
    colored = (y - towards_white * bright) / (1 - towards_white) * (peak / bright)
    shifted = np.maximum(np.where(top > start, colored, y), 0)
    low = shifted.min(axis=-1, keepdims=True)
    offset = np.where(low < fresnel, np.sqrt(4 * fresnel * low) - low, fresnel)
    return (shifted + offset).astype(np.float32), np.broadcast_to(known, y.shape)
