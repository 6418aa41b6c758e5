"""Arithmetic on pictures, written for speed: channel by channel where a plane meets a colour, and without branches."""

from __future__ import annotations

import numpy as np

from mirelight.model import F32


def divide(numerator: F32, denominator: F32) -> F32:
    """numerator (..., n) / denominator (..., n or 1), 0 where the denominator is not above 0."""
    above = denominator > 0
    safe = np.maximum(denominator, np.float32(0)) + ~above
    out = np.empty_like(numerator)
    if denominator.shape == numerator.shape:
        np.divide(numerator, safe, out=out)
        out *= above
        return out
    for channel in range(numerator.shape[-1]):
        np.divide(numerator[..., channel], safe[..., 0], out=out[..., channel])
        out[..., channel] *= above[..., 0]
    return out


def multiply(color: F32, by: F32, out: F32) -> None:
    """color (..., n) times (..., n) or a plane (..., 1) into the first n channels of `out`."""
    for channel in range(color.shape[-1]):
        np.multiply(color[..., channel], by[..., min(channel, by.shape[-1] - 1)], out=out[..., channel])


def unit_or_zero(vectors: F32) -> F32:
    """(..., 3) of length 1; 0 where they have none."""
    return divide(vectors, np.linalg.norm(vectors, axis=-1, keepdims=True))
