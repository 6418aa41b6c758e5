"""How light samples of a sky are spread anew: a table of the inverse of a distribution."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mirelight.lighting import sky_guiding
from mirelight.lighting.sky_guiding import BINS, STEPS, WHOLE, groups, inverse
from mirelight.model import F64, SurfaceCells

from ..model.test_surface_cache import cells


def part_of_bins(table: sky_guiding.U16) -> F64:
    """(G, BINS) what part of evenly drawn numbers ends in each bin, by drawing them."""
    x = (np.arange(1 << 16) + 0.5) / (1 << 16) * STEPS
    step = x.astype(int)
    edges = np.append(table, np.full((len(table), 1), WHOLE), axis=1) / WHOLE
    ways = edges[:, step] + (edges[:, step + 1] - edges[:, step]) * (x - step)
    return np.stack([np.bincount((row * BINS).astype(int), minlength=BINS) / len(x) for row in ways])


def test_an_even_spread_stays_as_it_is() -> None:
    table = inverse(np.full((2, BINS), 1 / BINS))
    assert np.array_equal(table, np.tile(np.arange(STEPS) * (WHOLE // STEPS), (2, 1)))


def test_samples_go_where_they_are_wanted() -> None:
    """Eight bins next to each other get 85 %, to within what one share of a boundary bin may move."""
    wanted = np.full((1, BINS), 0.15 / (BINS - 8))
    wanted[0, 40:48] = 0.85 / 8
    made = part_of_bins(inverse(wanted))
    assert abs(made[0, 40:48].sum() - 0.85) < 1.5 / STEPS
    assert made.min() > 0  # nothing is left out


def test_shares_follow_each_other_whatever_is_wanted() -> None:
    rng = np.random.default_rng(3)
    wanted = rng.random((50, BINS)) ** 12 + 0.15 / BINS
    table = inverse(wanted / wanted.sum(axis=1, keepdims=True)).astype(np.int64)
    assert (np.diff(table, axis=1) >= 0).all() and (table[:, 0] == 0).all()
    assert np.abs(part_of_bins(table.astype(np.uint16)).sum(axis=1) - 1).max() < 1e-12


def _on(keys: list[tuple[int, int, int, int]]) -> SurfaceCells:
    """Cells in voxels x, y, z that face a way."""
    one = cells()
    rows = np.array([[y << 16 | x, way << 16 | z] for x, y, z, way in keys], np.uint32)
    again = np.zeros(len(keys), np.int64)
    return replace(
        one,
        keys=rows,
        starts=np.array([0, len(keys), len(keys)], np.uint32),
        anchors=one.anchors[again],
        faces=one.faces[again],
        corners=one.corners[again],
        normals=one.normals[again],
    )


def test_groups_are_neighbours_that_face_the_same_way(monkeypatch: pytest.MonkeyPatch) -> None:
    found = groups(_on([(4, 8, 12, 0), (7, 11, 15, 0), (8, 8, 12, 0), (4, 8, 12, 1), (5, 8, 12, 0)]))
    assert found[0] == found[1] == found[4] and len(set(found[[0, 2, 3]])) == 3
    many = _on([(x, 0, z, 0) for x in range(16) for z in range(16)])
    assert int(groups(many).max()) + 1 == 16
    monkeypatch.setattr(sky_guiding, "MOST", 5)
    assert int(groups(many).max()) + 1 == 4
