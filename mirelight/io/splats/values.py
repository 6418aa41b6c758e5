"""The value conversions that splat formats share, each in one place.

Stored splats keep log scales, logit opacities and spherical-harmonic colours (Kerbl et al. 2023); compressed formats
quantise those. Everything here turns stored values into what :class:`mirelight.model.SplatCloud` holds, or back.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mirelight.base.sh import C0, basis
from mirelight.model import F32

SQRT2 = 2**0.5

# The components that remain when the largest one (row) is left out, in wxyz or xyzw order alike.
_OTHERS = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])

_LARGEST_LOGIT = 20.0  # sigmoid(20) is 1 in float32; files get finite logits, which every viewer reads
_SMALLEST_SCALE = 1e-30  # a flat axis is written as this, because log(0) is not finite


def sigmoid(logits: NDArray[Any], out: F32) -> None:
    """Opacity 0–1 of logits of any shape, written into `out`; exact at ±inf."""
    with np.errstate(over="ignore"):
        np.negative(logits, out=out, casting="same_kind")
        np.exp(out, out=out)
        out += 1
        np.reciprocal(out, out=out)


def logit(opacities: NDArray[Any]) -> F32:
    """Finite logits of opacities of any shape, float32; 0 and 1 become ∓20."""
    o = np.asarray(opacities, dtype=np.float64)
    with np.errstate(divide="ignore"):
        raw = np.log(o) - np.log1p(-o)
    return np.asarray(np.clip(raw, -_LARGEST_LOGIT, _LARGEST_LOGIT), dtype=np.float32)


def exponential(logs: NDArray[Any], out: F32) -> None:
    """Linear scales of log scales of any shape, written into `out`; −inf gives 0, too large gives inf (dropped
    later)."""
    with np.errstate(over="ignore"):
        np.exp(logs, out=out, casting="same_kind")


def log_scale(scales: NDArray[Any]) -> F32:
    """Finite log scales of linear scales of any shape, float32."""
    return np.log(np.maximum(np.asarray(scales, dtype=np.float64), _SMALLEST_SCALE)).astype(np.float32)


def dc_from_rgb(rgb: NDArray[Any]) -> NDArray[Any]:
    """(..., 3) degree-0 coefficients of a view-independent, display-encoded colour."""
    return (rgb - 0.5) / C0


def rgb_from_dc(dc: NDArray[Any]) -> NDArray[Any]:
    """(..., 3) inverse of :func:`dc_from_rgb`."""
    return dc * C0 + 0.5


def complete_quaternions(three: NDArray[Any], largest: NDArray[Any], out: F32) -> F32:
    """Unit quaternions from their three smaller components.

    Args:
        three: (n, 3) the stored components, in order.
        largest: (n,) index 0–3 of the component left out; it is positive.
        out: (n, 4) written in the same component order.
    """
    rows = np.arange(len(out))
    out[rows[:, None], _OTHERS[largest]] = three
    out[rows, largest] = np.sqrt(np.maximum(1 - np.einsum("ij,ij->i", three, three), 0))
    return out


def three_smallest(quats: NDArray[Any]) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """The three smaller components (n, 3) and the index of the largest (n,), signed so that the largest is positive."""
    q = np.asarray(quats, dtype=np.float64)
    rows, largest = np.arange(len(q)), np.argmax(np.abs(q), axis=1)
    q = q * np.where(q[rows, largest] < 0, -1.0, 1.0)[:, None]
    return np.take_along_axis(q, _OTHERS[largest], axis=1), largest


class AxisFlips(NamedTuple):
    """What changes sign where axes point the other way; factors of ±1 that multiply a cloud's arrays."""

    means: F32  # (3,)
    quats: F32  # (4,) wxyz
    sh: F32  # (K, 1)


def axis_flips(signs: tuple[int, int, int], degree: int) -> AxisFlips:
    """The factors that show splats in axes of which some point the other way (it is its own inverse).

    A rotation R becomes S R S with S = diag(signs); that is a rotation even where S mirrors, because a Gaussian has
    no handedness. Each SH basis function is even or odd in every axis, so its coefficient keeps or changes its sign.

    Args:
        signs: ±1 for x, y, z.
        degree: SH degree, 0 to 3.
    """
    s = np.asarray(signs, dtype=np.float32)
    probe = np.array([0.48, 0.6, 0.64])  # a direction on which no basis function is zero
    parity = np.sign(basis(probe * s, degree)) * np.sign(basis(probe, degree))
    quats = np.concatenate([np.ones(1, dtype=np.float32), s[[1, 2, 0]] * s[[2, 0, 1]]])
    return AxisFlips(means=s, quats=quats, sh=parity.astype(np.float32)[:, None])
