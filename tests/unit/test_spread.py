"""How much smaller errors are than the spread of batches says, on batches whose law is known."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from mirelight.lighting.spread import FEWEST, REMAINS, share

PIXELS = 4000


def batches(p: float, count: int) -> NDArray[np.float64]:
    """(PIXELS, 3, count): means of 2^j batches differ from their neighbours with variance 2^(-p j), as on a Haar tree;
    the mean of all has what is left of an endless one."""
    rng = np.random.default_rng(7)
    out = np.zeros((PIXELS, 3, count))
    size = 1
    while size < count:
        halves = rng.normal(0, 0.5 * size ** (-p / 2), (PIXELS, 3, count // (2 * size), 1))
        out += (halves * np.repeat([1, -1], size)).reshape(PIXELS, 3, count)
        size *= 2
    left = 0.25 * (count / 2) ** -p / (2**p - 1)
    return 10 + out + rng.normal(0, np.sqrt(left), (PIXELS, 3, 1))


def told(drawn: NDArray[np.float64], pixels: int = PIXELS) -> tuple[float, float]:
    """(variance as if batches were independent, what of it is true) of the first pixels."""
    count = drawn.shape[-1]
    own = drawn[:pixels]
    stated = own.var(axis=-1, ddof=1) / count
    halves = own[..., : count // 2].mean(axis=-1) - own[..., count // 2 :].mean(axis=-1)
    stated, halves, mean = (x.astype(np.float32) for x in (stated, halves, own.mean(axis=-1)))
    return float(stated.mean()), share(stated, halves, mean, count)


@pytest.mark.parametrize("count", [4, 8, 32])
@pytest.mark.parametrize("p", [1.0, 1.4, 2.0, 2.9])
def test_a_part_of_what_the_law_takes_off_is_taken_off(p: float, count: int) -> None:
    drawn = batches(p, count)
    stated, part = told(drawn)
    true = np.mean((drawn.mean(axis=-1) - 10) ** 2)
    own, counted = ((count - 1) / (count**q - 1) for q in (p, 1 + REMAINS * (p - 1)))
    assert stated * own == pytest.approx(true, rel=0.1)
    assert part == pytest.approx(counted, rel=0.1)


def test_where_nothing_can_be_told_batches_count_as_independent() -> None:
    drawn = batches(2.5, 4)
    assert told(drawn)[1] < 0.4
    assert told(drawn, FEWEST - 1)[1] == 1
    assert told(drawn[..., :2])[1] == 1
    assert told(0 * drawn)[1] == 1
    assert told(10 + np.cumsum(drawn, axis=-1))[1] == 1  # halves differ more than neighbours
