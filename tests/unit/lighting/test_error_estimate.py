"""What pixels that are sampled twice say of the error of all, on samples whose law is known."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from mirelight.lighting.error_estimate import EVERY, FEW, FEWEST, MOST, chosen, correct
from mirelight.model import F32

PIXELS = 6000
BRIGHT = np.repeat([1.0, 10.0], PIXELS // 2)[:, None]
TRUE = np.repeat([0.02, 0.5], PIXELS // 2)[:, None]  # variance of the mean, three channels of it alike


def drawn(overstated: NDArray[np.float64]) -> tuple[F32, F32, F32, NDArray[np.int64]]:
    """(variance as batches tell it, mean, first less second samples of some, which), light with rare bright samples."""
    rng = np.random.default_rng(11)
    tails = np.sqrt(rng.gamma(0.5, 2, (PIXELS, 1)))  # pixels are noisy by very different degrees
    first, second = (BRIGHT + np.sqrt(TRUE) * tails * rng.normal(size=(PIXELS, 3)) for _ in range(2))
    stated = TRUE * np.square(tails) * overstated * rng.gamma(1.5, 1 / 1.5, (PIXELS, 3))
    some = chosen(PIXELS)
    variance, mean, apart = (x.astype(np.float32) for x in (stated, first, (first - second)[some]))
    return variance, mean, apart, some


def test_dark_and_bright_pixels_get_their_own_factor() -> None:
    overstated = np.where(BRIGHT > 5, 4.0, 1.2)
    variance, mean, apart, some = drawn(overstated)
    before = variance.copy()
    correct(variance, mean, apart, some)
    for part in (slice(0, PIXELS // 2), slice(PIXELS // 2, None)):
        assert before[part].mean() / TRUE[part].mean() == pytest.approx(overstated[part].mean(), rel=0.1)
        assert variance[part].mean() / TRUE[part].mean() == pytest.approx(1, abs=0.25)
    assert variance.mean() / TRUE.mean() == pytest.approx(1, abs=0.2)


def test_an_understated_variance_is_raised() -> None:
    variance, mean, apart, some = drawn(np.full((PIXELS, 1), 0.4))
    correct(variance, mean, apart, some)
    assert variance.mean() / TRUE.mean() == pytest.approx(1, abs=0.2)


def test_where_too_few_pixels_tell_batches_count_as_independent() -> None:
    variance, mean, apart, some = drawn(np.full((PIXELS, 1), 3.0))
    before = variance.copy()
    correct(variance, mean, apart[: FEWEST - 1], some[: FEWEST - 1])
    np.testing.assert_array_equal(variance, before)
    dark = 0 * variance
    correct(dark, 0 * mean, 0 * apart, some)
    assert not dark.any()


@pytest.mark.parametrize("pixels", [0, 1, 100, 1536, 5184, 14400, 921600])
def test_pixels_that_are_sampled_twice_are_few_and_everywhere(pixels: int) -> None:
    some = chosen(pixels)
    assert len(some) <= max(pixels / EVERY, min(FEW, pixels / MOST)) and (len(some) > 0) == (pixels >= MOST)
    assert (np.diff(some) > 0).all()
    if len(some):
        assert some[0] >= 0 and some[-1] < pixels
        assert np.diff(np.concatenate([[0], some, [pixels]])).max() <= 2 * pixels / len(some) + 1
