"""Wedges as one polygon: the same area in fewer triangles; corners on lines go."""

from __future__ import annotations

import numpy as np
import pytest

from mirelight.proxy.creases import wedges_of
from mirelight.proxy.polygons import Polygons, octagons
from mirelight.proxy.stars import stars_of

from .clouds import F64

NEAR = 1e-6


def fans(polygons: Polygons) -> F64:
    """(N,) areas of the triangles of fans from the first corners; each triangle turns the way of its polygon."""
    corners = polygons.corners
    a, b = corners[:, 1:-1] - corners[:, :1], corners[:, 2:] - corners[:, :1]
    area = 0.5 * (a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
    used = np.arange(area.shape[1]) + 2 < polygons.count[:, None]
    assert (area[used] > -1e-9).all()
    return np.asarray(np.where(used, area, 0).sum(axis=1))


@pytest.mark.parametrize("seed", range(3))
def test_stars_cover_what_their_wedges_do_in_fewer_triangles(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = 200
    cells = octagons(rng.uniform(0.5, 1, n))
    wedges, row = wedges_of(cells)
    turn, half = rng.uniform(0, 2 * np.pi, n), rng.uniform(0.05, 0.4, n)
    normal = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    some = np.flatnonzero((wedges.corners[:, 1] * normal[row][:, ::-1] * (1, -1)).sum(axis=1) > 0)  # those on one side
    wedges.cut(some, normal[row[some]], half[row[some]])
    stars, whole = stars_of(wedges, row, n, NEAR)
    assert whole.mean() > 0.9
    area, faces = np.bincount(row, wedges.area())[whole], np.bincount(row, wedges.count - 2)[whole]
    np.testing.assert_allclose(fans(stars), area, rtol=1e-6)
    assert (stars.count - 2 < faces).all()


def test_a_cell_cut_by_one_line_is_a_star_without_its_wedges() -> None:
    """A regular octagon whose wedges are all cut at x = 0.1 loses its right: seven corners at most are left."""
    wedges, row = wedges_of(octagons(np.ones(1)))
    wedges.cut(np.arange(8), np.tile((1.0, 0.0), (8, 1)), np.full(8, 0.1))
    stars, _ = stars_of(wedges, row, 1, NEAR)
    assert stars.count[0] == 6
    assert stars.corners[0, :6, 0].max() == pytest.approx(0.1)


def test_cells_whose_middle_is_cut_away_stay_wedges() -> None:
    wedges, row = wedges_of(octagons(np.ones(3)))
    middle = np.flatnonzero(row == 1)
    wedges.cut(middle, np.tile((1.0, 0.0), (8, 1)), np.full(8, -0.1))
    stars, whole = stars_of(wedges, row, 3, NEAR)
    np.testing.assert_array_equal(whole, [True, False, True])
    np.testing.assert_allclose(fans(stars), 2 * np.sqrt(2))
    none, whole = stars_of(wedges.where(middle), row[middle], 3, NEAR)
    assert len(none.count) == 0 and not whole.any()


def test_corners_on_a_side_go_and_others_stay() -> None:
    corners = [(0, 0), (1, 0.001), (2, 0), (2, 0.0005), (2, 1), (0.5, 1.2), (0, 1), (0, 0.5)]
    made = Polygons(np.array([corners], np.float64), np.array([8])).simplified(0.01)
    np.testing.assert_allclose(
        made.corners[0, : made.count[0]], [(0, 0), (2, 0), (2, 1), (0.5, 1.2), (0, 1)], atol=1e-3
    )
    few = Polygons(np.array([corners], np.float64), np.array([3])).simplified(1e-6)
    assert few.count[0] == 3
