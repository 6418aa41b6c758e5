"""How a noise target is shared out: against every other way to share it, and means of fills."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mirelight.lighting.budget import MOST_FILLS, MOST_OF_TARGET, RAY_PRICE, Noise, averaged, even

from ..model.test_surface_cache import cache


@pytest.mark.parametrize("of_fill", [1e-6, 1e-4, 4e-3])
@pytest.mark.parametrize("of_sample", [1e-3, 0.1, 3.0])
@pytest.mark.parametrize("pixels", [10_000, 5_000_000])
@pytest.mark.parametrize("target", [0.01, 0.05])
def test_no_other_number_of_fills_costs_less(of_fill: float, of_sample: float, pixels: int, target: float) -> None:
    rays = 20_000 * 256
    chosen = Noise(of_fill, of_sample).fills(target, rays, pixels)
    costs = {}
    for n in range(1, MOST_FILLS + 1):
        left = target**2 - of_fill / n
        if math.sqrt(of_fill / n) <= MOST_OF_TARGET * target:
            costs[n] = n * RAY_PRICE * rays + pixels * of_sample / left
    assert costs[chosen] <= (1 + 1e-9) * min(costs.values())


def test_what_cannot_be_reached_ends_and_what_has_no_noise_takes_one() -> None:
    assert Noise(1.0, 1.0).fills(1e-4, 1000, 1000) == MOST_FILLS
    assert Noise(0.0, 0.0).fills(0.01, 1000, 1000) == 1 == Noise(0.0, 1.0).fills(0.01, 1000, 10**9)


def test_the_mean_of_fills() -> None:
    one, other = cache(), cache()
    both = averaged([one, other])
    for made, a, b in zip(both.lights, one.lights, other.lights, strict=True):
        np.testing.assert_allclose(made.indirect, (a.indirect + b.indirect) / 2, rtol=1e-6)
        np.testing.assert_allclose(made.direct, (a.direct + b.direct) / 2, rtol=1e-6)
        assert (
            (made.first_bounce is None) == (a.first_bounce is None)
            and made.name == a.name
            and made.rays == a.rays + b.rays
        )


@pytest.mark.parametrize("count", [1, 7, 1024, 1500, 100_000])
def test_pixels_that_are_looked_at_are_different_and_in_order(count: int) -> None:
    found = even(count)
    assert len(found) == min(count, 1024) and (np.diff(found) > 0).all() and found[0] >= 0 and found[-1] < count
