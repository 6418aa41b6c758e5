"""The scores of `scripts/bench truth`: the noise of the true pictures is not in them, errors are."""

from __future__ import annotations

import importlib
import json
from dataclasses import asdict
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from mirelight.model import ProxyMesh, SplatCloud

SCRIPTS = Path(__file__).parents[3] / "scripts"


@pytest.fixture
def scores(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(SCRIPTS)
    return importlib.import_module("bench.truth_scores")


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


def test_what_splats_have_before_nothing_is_not_scored(scores: ModuleType) -> None:
    before = np.random.default_rng(0).uniform(0.25, 0.4, (40, 60, 3)).astype(np.float32)
    edges, there = np.ones((40, 60), bool), np.ones((40, 60), bool)
    there[:, :20] = False
    factor = np.full_like(before, 2.0)
    factor[:, :20] = 0.1
    scored = scores.score(factor, before * factor, (before, before), (2 * before, 2 * before), edges, there)
    assert (scored.light, scored.light_edges, scored.psnr, scored.edges) == (60, 60, 60, 60)
    assert scored.ssim == pytest.approx(1, abs=1e-6)
    assert scores.score(factor, before * factor, (before, before), (2 * before, 2 * before), edges).light < 20


def test_silhouettes_are_bands_round_jumps_of_depth(scores: ModuleType) -> None:
    coverage, depth = np.ones((20, 40), np.float32), np.full((20, 40), 4.0, np.float32)
    depth[:, 20:] = 8.0
    band = np.flatnonzero(scores.edges_of(coverage, depth)[10])
    assert band[0] == 19 - scores.BAND and band[-1] == 20 + scores.BAND


def test_a_mean_takes_each_figure_by_itself(scores: ModuleType) -> None:
    a, b = scores.Score(30, 20, 28, 18, 0.9, 0.1), scores.Score(34, 26, 30, 20, 0.7, 0.3)
    assert scores.mean([a, b]) == scores.Score(32, 23, 29, 19, pytest.approx(0.8), pytest.approx(0.2))


@pytest.fixture
def storing(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> ModuleType:
    """The module that keeps things, with code of its own to look at."""
    monkeypatch.syspath_prepend(SCRIPTS)
    module = importlib.import_module("bench.truth_store")
    for sources in module.MAKERS.values():
        for source in sources:
            path = tmp_path / source if source.endswith(".py") else tmp_path / source / "made.py"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text("one", encoding="utf-8")
    monkeypatch.setattr(module, "ROOT", tmp_path)
    return module


def test_what_is_kept_is_made_again_when_the_code_that_makes_it_changes(storing: ModuleType, tmp_path: Path) -> None:
    made: list[str] = []

    def read(name: str, maker: str, of: object = None) -> None:
        def make() -> NDArray[np.float32]:
            made.append(name)
            return np.arange(3, dtype=np.float32)

        store = storing.Store(tmp_path / "cache")
        np.testing.assert_array_equal(store.array(name, "part", make, maker, of), [0, 1, 2])

    def read_all() -> list[str]:
        made.clear()
        read("truth", "scenes")
        read("own", "proxies")
        read("sun", "light", np.ones(3))
        return made

    assert read_all() == ["truth", "own", "sun"]
    assert read_all() == []
    (tmp_path / "mirelight" / "proxy" / "made.py").write_text("two", encoding="utf-8")
    assert read_all() == ["own"]
    (tmp_path / "scripts" / "scenegen" / "made.py").write_text("two", encoding="utf-8")
    assert read_all() == ["truth", "own"]
    read("sun", "light", np.zeros(3))
    assert made[-1] == "sun"  # from something else


def test_costs_are_kept_beside_the_things(storing: ModuleType, tmp_path: Path) -> None:
    def make(store: Any) -> list[dict[str, Any]]:
        return [{"light": store.cost("frames", lambda: 36.5), "nothing": float("nan")}]

    costs = []
    for _ in range(2):
        store = storing.Store(tmp_path / "cache")
        (row,) = store.table("exact", lambda store=store: make(store), "of this")
        assert row["light"] == 36.5 and np.isnan(row["nothing"])
        costs.append(store.costs)
    assert costs[0] == costs[1] and [list(parts) for parts in costs[0].values()] == [["frames"]]


def test_rows_are_the_same_from_plain_values(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(SCRIPTS)
    rows, scores = importlib.import_module("bench.truth_rows"), importlib.import_module("bench.truth_scores")
    own = (("evening", 36.0), ("night", 35.0))
    score = scores.Score(35.5, 34, 21, 20, 0.6, 0.2)
    row = rows.Row("room", "ratio", "own", "known", rows.BEST, True, score, own, 1.5, 0.0, 0.25, 300)
    assert rows.row_of(json.loads(json.dumps(asdict(row)))) == row


def test_what_splats_tell_of_a_surface_is_the_part_that_they_lie_on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(SCRIPTS)
    seen = importlib.import_module("bench.truth_seen")
    corners = np.array([[0, 0, 0], [4, 0, 0], [4, 1, 0], [0, 1, 0], [0.1, 0.1, 0], [0.9, 0.1, 0], [0.9, 0.9, 0]])
    corners[4:, 2] = 0.01
    faces = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6]], np.int32)
    x, y = np.meshgrid(np.arange(0, 1.01, 0.01), np.arange(0, 1.01, 0.01))  # on a quarter of the large one
    means = np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1).astype(np.float32)
    n = len(means)
    splats = SplatCloud(
        means=means,
        quats=np.tile(np.array([[1, 0, 0, 0]], np.float32), (n, 1)),
        scales=np.full((n, 3), 0.01, np.float32),
        opacities=np.ones(n, np.float32),
        sh=np.zeros((n, 1, 3), np.float32),
    )
    mesh = seen.seen_of(ProxyMesh(vertices=corners.astype(np.float32), faces=faces), splats, size=10.0)
    v = mesh.vertices[mesh.faces].astype(np.float64)
    low = v[v[..., 2].max(axis=1) == 0]
    assert len(v) == len(low) + 1  # what was seen all over stays as it was
    area = np.cross(low[:, 1] - low[:, 0], low[:, 2] - low[:, 0])[:, 2] / 2
    assert area.min() > 0  # none turned over
    assert 1.0 < area.sum() < 1 + 10 * (seen.REACH + seen.EDGE)  # all that is near a splat, little beyond
    assert low[..., 0].max() < 1 + 10 * (seen.REACH + seen.EDGE)


def test_pieces_of_triangles_are_small_and_leave_no_seam(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(SCRIPTS)
    corners = np.array([[0.0, 0, 0], [4, 0, 1], [4, 1, 0], [0, 1, 0]])
    pieces, face = importlib.import_module("bench.truth_seen").split(corners[[[0, 1, 2], [0, 2, 3]]], 0.3)
    ahead = np.roll(pieces, -1, axis=1)
    assert np.linalg.norm(ahead - pieces, axis=2).max() <= 0.3
    area = np.linalg.norm(np.cross(pieces[:, 1] - pieces[:, 0], pieces[:, 2] - pieces[:, 0]), axis=1) / 2
    whole = np.cross(corners[[1, 2]] - corners[0], corners[[2, 3]] - corners[0])
    np.testing.assert_allclose(np.bincount(face, area), np.linalg.norm(whole, axis=1) / 2)
    ends = np.stack([pieces, ahead], axis=2).reshape(-1, 3)
    points, which = np.unique(ends, axis=0, return_inverse=True)
    edges, count = np.unique(np.sort(which.reshape(-1, 2), axis=1), axis=0, return_counts=True)
    rim = [(p, q - p) for p, q in zip(corners, np.roll(corners, -1, axis=0), strict=True)]
    for a, b in points[edges[count == 1]]:  # an edge of one piece alone
        off = [np.linalg.norm(np.cross(a - p, q)) + np.linalg.norm(np.cross(b - p, q)) for p, q in rim]
        assert min(off) < 1e-12


def test_no_splat_is_made_from_the_camera_kept_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(SCRIPTS)
    captures = importlib.import_module("bench.truth_captures")
    for plan in captures.PLANS:
        recipe = importlib.import_module(f"scenegen.{plan.cloud}").recipe()
        eye = np.array(captures.APART[plan.scene][0])
        away = [np.linalg.norm(camera.position - eye) for camera in recipe.orbit]
        assert min(away) > 0.2, plan.name


@pytest.mark.parametrize("option", ["--pictures", "--cache", "--rows", "--json"])
def test_an_empty_path_is_not_the_working_folder(capsys: pytest.CaptureFixture[str], option: str) -> None:
    with pytest.raises(SystemExit) as ended:
        importlib.import_module("bench.__main__").main(["truth", "--quick", option, ""])
    assert ended.value.code == 2
    assert f"argument {option}: an empty path; name one" in capsys.readouterr().err
