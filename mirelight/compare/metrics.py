"""The figures, as maps: one value per pixel, averaged over a region afterwards. Heavy imports happen on use."""

from __future__ import annotations

import math
import warnings
from typing import Any

import numpy as np

from mirelight.base import extras
from mirelight.compare.types import CompareSettings
from mirelight.model import F32

_LUMA = np.array([0.2126, 0.7152, 0.0722], dtype=np.float32)  # Rec.709 weights on display values
_SSIM_SIGMA, _SSIM_RADIUS = 1.5, 5
_SSIM_C1, _SSIM_C2 = 0.01**2, 0.03**2
_DARK_SHARE = 0.01  # relMSE: share of the squared mean that keeps dark pixels from deciding


def squared_error(reference: F32, test: F32) -> F32:
    """(H, W) mean over channels of the squared difference."""
    return np.asarray(np.mean((test - reference) ** 2, axis=-1), dtype=np.float32)


def psnr(mean_squared_error: float) -> float:
    """Peak signal-to-noise ratio in dB of values 0..1; infinite for no error."""
    return math.inf if mean_squared_error <= 0 else -10 * math.log10(mean_squared_error)


def relative_squared_error(reference: F32, error: F32) -> F32:
    """(H, W) mean over channels of error^2 / (reference^2 + 0.01 mean^2); both (H, W, 3) linear.

    The mean is that of the reference's values above zero, so that an empty background does not sharpen the figure.
    """
    lit = reference[reference > 0]
    floor = _DARK_SHARE * float(lit.mean(dtype=np.float64)) ** 2 if lit.size else 0.0
    relative = error.astype(np.float64) ** 2 / np.maximum(reference.astype(np.float64) ** 2 + floor, 1e-30)
    return np.asarray(relative.mean(axis=-1), dtype=np.float32)


def ssim(reference: F32, test: F32) -> F32:
    """(H, W) structural similarity of display values, mean over channels (Wang et al. 2004: 11 x 11 Gaussian, 1.5 px).

    Edges are mirrored, so that every pixel has a value.
    """
    a, b = reference.astype(np.float64), test.astype(np.float64)
    mean_a, mean_b = _blur(a), _blur(b)
    variance_a = _blur(a * a) - mean_a**2
    variance_b = _blur(b * b) - mean_b**2
    covariance = _blur(a * b) - mean_a * mean_b
    likeness = (2 * mean_a * mean_b + _SSIM_C1) * (2 * covariance + _SSIM_C2)
    scale = (mean_a**2 + mean_b**2 + _SSIM_C1) * (variance_a + variance_b + _SSIM_C2)
    return np.asarray((likeness / scale).mean(axis=-1), dtype=np.float32)


def _blur(image: np.ndarray[Any, np.dtype[np.float64]]) -> np.ndarray[Any, np.dtype[np.float64]]:
    offsets = np.arange(-_SSIM_RADIUS, _SSIM_RADIUS + 1)
    weights = np.exp(-0.5 * (offsets / _SSIM_SIGMA) ** 2)
    weights /= weights.sum()
    for axis in (0, 1):
        pad = [(_SSIM_RADIUS, _SSIM_RADIUS) if k == axis else (0, 0) for k in range(3)]
        wide = np.moveaxis(np.pad(image, pad, mode="symmetric"), axis, 0)
        blurred = np.zeros_like(image)
        along = np.moveaxis(blurred, axis, 0)
        for k, weight in enumerate(weights):
            along += weight * wide[k : k + len(along)]
        image = blurred
    return image


def delta_e(reference: F32, test: F32) -> F32:
    """(H, W) CIEDE2000 of display values seen on an sRGB screen (D65)."""
    colour = _library("colour")
    lab = [colour.XYZ_to_Lab(colour.sRGB_to_XYZ(x.astype(np.float64)), _d65(colour)) for x in (reference, test)]
    return np.asarray(colour.difference.delta_E_CIE2000(*lab), dtype=np.float32)


def _d65(colour: Any) -> Any:
    return colour.CCS_ILLUMINANTS["CIE 1931 2 Degree Standard Observer"]["D65"]


def flip(reference: F32, test: F32, settings: CompareSettings) -> F32:
    """(H, W) LDR FLIP of display values 0..1, 0: no visible difference (Andersson et al. 2020)."""
    return _flip(reference, test, "LDR", {"ppd": settings.pixels_per_degree})


def hdr_flip(reference: F32, test: F32, settings: CompareSettings) -> F32:
    """(H, W) HDR FLIP of linear light, over fixed exposures around the comparison's own (Andersson et al. 2021).

    FLIP's automatic exposures depend on the picture; fixed ones make figures of a set comparable.
    """
    low, high = (settings.exposure + stops for stops in settings.hdr_exposures)
    parameters: dict[str, float | int | str] = {
        "ppd": settings.pixels_per_degree,
        "startExposure": low,
        "stopExposure": high,
        "numExposures": max(2, round((high - low) / 2) + 1),
        "tonemapper": "ACES",
    }
    return _flip(np.maximum(reference, 0), np.maximum(test, 0), "HDR", parameters)


def _flip(reference: F32, test: F32, kind: str, parameters: dict[str, Any]) -> F32:
    evaluator = _library("flip_evaluator")
    error, _, _ = evaluator.evaluate(
        np.ascontiguousarray(reference, dtype=np.float32),
        np.ascontiguousarray(test, dtype=np.float32),
        kind,
        inputsRGB=True,
        applyMagma=False,
        computeMeanError=False,
        parameters=parameters,
    )
    return np.asarray(error, dtype=np.float32).reshape(reference.shape[:2])


def luma(display: F32) -> F32:
    """(H, W) brightness of display values."""
    return np.asarray(display @ _LUMA, dtype=np.float32)


def require(*, flip_alone: bool = False) -> None:
    """Make sure of the packages before any work is done; imports none of them.

    Args:
        flip_alone: only :func:`flip` is wanted, and :func:`delta_e` is not.

    Raises:
        BackendError: a package of the extra `compare` is missing.
    """
    extras.require("compare", "flip_evaluator" if flip_alone else None)


def _library(module: str) -> Any:
    from importlib import import_module

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # colour-science tells of plotting packages that are not needed here
            return import_module(module)
    except ImportError:
        raise extras.needed("compare", module) from None
