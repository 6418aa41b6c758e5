"""The scores of `scripts/bench_truth.py`: the noise of the true pictures is not in them, errors are."""

from __future__ import annotations

import importlib
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from numpy.typing import NDArray

SCRIPTS = Path(__file__).parents[2] / "scripts"


@pytest.fixture
def scores(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(SCRIPTS)
    return importlib.import_module("bench_truth_scores")


def noisy(mean: NDArray[np.float32], seed: int, sigma: float) -> NDArray[np.float32]:
    return (mean + np.random.default_rng(seed).normal(0, sigma, mean.shape)).astype(np.float32)


def test_noise_of_the_truth_is_taken_out_and_an_error_is_not(scores: ModuleType) -> None:
    before = np.random.default_rng(0).uniform(0.25, 0.4, (200, 300, 3)).astype(np.float32)
    captured = noisy(before, 1, 0.02), noisy(before, 2, 0.02)
    truth = noisy(2 * before, 3, 0.02), noisy(2 * before, 4, 0.02)
    edges = np.zeros((200, 300), bool)
    edges[:, 100:140] = True
    right = scores.score(np.full_like(before, 2.0), 2 * before, captured, truth, edges)
    assert right.light > 50 and right.light_edges > 44  # the noise alone stands at 28 dB
    factor = np.full_like(before, 2.0)
    factor[:, 100:140] = 2.2
    wrong = scores.score(factor, before * factor, captured, truth, edges)
    known = np.mean((scores.shown(before * 2.2) - scores.shown(before * 2)) ** 2)
    assert wrong.light_edges == pytest.approx(-10 * np.log10(known), abs=0.2)
    assert wrong.light == pytest.approx(-10 * np.log10(known * 40 / 300), abs=0.3)
    assert wrong.psnr == pytest.approx(wrong.light, abs=0.3)


def test_silhouettes_are_bands_round_jumps_of_depth(scores: ModuleType) -> None:
    coverage, depth = np.ones((20, 40), np.float32), np.full((20, 40), 4.0, np.float32)
    depth[:, 20:] = 8.0
    band = np.flatnonzero(scores.edges_of(coverage, depth)[10])
    assert band[0] == 19 - scores.BAND and band[-1] == 20 + scores.BAND


def test_a_mean_takes_each_figure_by_itself(scores: ModuleType) -> None:
    a, b = scores.Score(30, 20, 28, 18, 0.9, 0.1), scores.Score(34, 26, 30, 20, 0.7, 0.3)
    assert scores.mean([a, b]) == scores.Score(32, 23, 29, 19, pytest.approx(0.8), pytest.approx(0.2))


def test_what_is_kept_is_made_again_when_the_code_that_makes_it_changes(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.syspath_prepend(SCRIPTS)
    captures = importlib.import_module("bench_truth_captures")
    for folder in (*captures.MAKES_PROXIES, "scripts/scenegen"):
        source = tmp_path / ("" if "/" in folder else "mirelight") / folder / "made.py"
        source.parent.mkdir(parents=True)
        source.write_text("one", encoding="utf-8")
    monkeypatch.setattr(captures, "ROOT", tmp_path)
    made: list[str] = []

    def read(name: str, *, proxy: bool) -> None:
        def make() -> NDArray[np.float32]:
            made.append(name)
            return np.arange(3, dtype=np.float32)

        store = captures.Store(tmp_path / "cache")
        np.testing.assert_array_equal(store.array(name, "part", make, proxy=proxy), [0, 1, 2])
        assert set(store.spent) <= {"part"}

    for _ in range(2):
        read("truth", proxy=False)
        read("own", proxy=True)
    assert made == ["truth", "own"]
    (tmp_path / "mirelight" / "proxy" / "made.py").write_text("two", encoding="utf-8")
    read("truth", proxy=False)
    read("own", proxy=True)
    assert made == ["truth", "own", "own"]
    (tmp_path / "scripts" / "scenegen" / "made.py").write_text("two", encoding="utf-8")
    read("truth", proxy=False)
    assert made == ["truth", "own", "own", "truth"]
