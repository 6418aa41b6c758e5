"""Each figure against another implementation or a closed form."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from mirelight.compare import CompareSettings, metrics


def pictures() -> tuple[Any, Any]:
    rng = np.random.default_rng(1)
    yy, xx = np.mgrid[0:40, 0:56] / 56
    a = np.stack([xx, yy, 0.5 + 0.4 * np.sin(20 * xx * yy)], axis=-1)
    b = np.clip(a + 0.05 * rng.normal(size=a.shape) + 0.03 * yy[..., None], 0, 1)
    return a.astype(np.float32), b.astype(np.float32)


def test_psnr_of_a_constant_error() -> None:
    a = np.full((4, 4, 3), 0.5, dtype=np.float32)
    assert metrics.psnr(float(metrics.squared_error(a, a + np.float32(0.1)).mean())) == pytest.approx(20, abs=1e-4)
    assert metrics.psnr(0.0) == math.inf


def test_ssim_is_that_of_scikit_image() -> None:
    from skimage.metrics import structural_similarity

    a, b = pictures()
    _, expected = structural_similarity(
        a.astype(np.float64),
        b.astype(np.float64),
        gaussian_weights=True,
        sigma=1.5,
        truncate=5 / 1.5,
        use_sample_covariance=False,
        data_range=1.0,
        channel_axis=-1,
        full=True,
    )
    np.testing.assert_allclose(metrics.ssim(a, b)[5:-5, 5:-5], expected.mean(axis=-1)[5:-5, 5:-5], atol=1e-5)
    assert metrics.ssim(a, a).min() == pytest.approx(1)


def test_ssim_of_tiny_pictures() -> None:
    a = np.full((2, 3, 3), 0.25, dtype=np.float32)
    assert metrics.ssim(a, a).shape == (2, 3)


def test_delta_e_is_that_of_scikit_image() -> None:
    from skimage.color import deltaE_ciede2000, rgb2lab

    a, b = pictures()
    expected = deltaE_ciede2000(rgb2lab(a.astype(np.float64)), rgb2lab(b.astype(np.float64)))
    np.testing.assert_allclose(metrics.delta_e(a, b), expected, atol=0.02)  # their D65 white has fewer digits


def test_black_and_white_are_100_apart() -> None:
    black = np.zeros((1, 1, 3), dtype=np.float32)
    assert metrics.delta_e(black, black + 1)[0, 0] == pytest.approx(100, abs=0.01)


def test_relative_error_of_a_constant_share() -> None:
    a = np.full((5, 5, 3), 7.0, dtype=np.float32)
    assert metrics.relative_squared_error(a, 0.1 * a).mean() == pytest.approx(0.01 / 1.01, rel=1e-5)


def test_flip_is_zero_for_equal_pictures_and_grows_with_the_difference() -> None:
    a, b = pictures()
    settings = CompareSettings()
    assert metrics.flip(a, a, settings).max() == 0
    half = metrics.flip(a, (a + b) / 2, settings).mean()
    full = metrics.flip(a, b, settings).mean()
    assert 0 < half < full < 1
    far = metrics.flip(a, b, CompareSettings(pixels_per_degree=200))
    assert far.mean() < full  # from afar the noise is seen less


def test_hdr_flip_uses_the_exposures_it_is_given() -> None:
    a, b = pictures()
    at_zero = metrics.hdr_flip(a, b, CompareSettings())
    darker = metrics.hdr_flip(a / 16, b / 16, CompareSettings(exposure=4.0))
    np.testing.assert_allclose(darker, at_zero, atol=2e-3)  # light and exposure cancel
    assert metrics.hdr_flip(a / 16, b / 16, CompareSettings()).mean() < at_zero.mean()
