"""`scripts/bench`: every part has options, and its errors and clocks are right."""

from __future__ import annotations

import importlib

import numpy as np
import pytest
from bench import common

BENCH = importlib.import_module("bench.__main__")


@pytest.mark.parametrize("part", sorted(BENCH.PARTS))
def test_every_part_says_what_it_takes(part: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        BENCH.main([part, "--help"])
    assert not ended.value.code
    said = capsys.readouterr().out
    assert "--quick" in said and "--json" in said


def test_relative_errors_are_those_of_lit_pixels() -> None:
    mean = np.zeros((20, 30, 3))
    mean[:, :15] = 2.0
    seeds = np.random.default_rng(0)
    pictures = [mean + (mean > 0) * seeds.normal(0, 0.1, mean.shape) for _ in range(400)]
    assert common.error2(pictures) == pytest.approx(0.1**2 / (1.01 * 2.0**2), rel=0.02)


def test_cells_are_shown_short() -> None:
    shown = common.table("T", ["a", "b", "c"], [("x", 1 / 3, [0.5, 2.0])])
    assert shown.rows == (("x", "0.3333", "0.5 to 2"),)


def test_pictures_are_averaged_over_blocks() -> None:
    picture = np.random.default_rng(0).random((7, 9, 3))
    found = common.averaged(picture, 3, 2)
    assert found.shape == (2, 4, 3)
    np.testing.assert_allclose(found[1, 2], picture[3:6, 4:6].mean(axis=(0, 1)))
