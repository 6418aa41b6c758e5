"""Cells of discs: whole planes, sharp edges, no cracks."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from mirelight.lighting.sight import Sight
from mirelight.proxy import MadeProxy, ProxySettings, make
from mirelight.proxy.cell_tuning import CELLS
from mirelight.proxy.polygons import octagons

from .clouds import ball, box_shell, on_surface, square

SIDE, STEP = 2.0, 0.08


@cache
def box() -> MadeProxy:
    return make(box_shell(SIDE, STEP, thin=0.05))


def test_discs_become_cells_and_blobs_do_only_where_they_are_asked_to() -> None:
    """What blobs become else stands in test_make."""
    assert box().method == "cells"
    assert make(ball(600), ProxySettings(method="cells")).method == "cells"


def test_cells_of_a_box_lie_on_the_box() -> None:
    """Cut at each other's planes, cells end at the edges, where octagons would stick out by two spacings."""
    v = np.abs(box().mesh.vertices.astype(np.float64))
    assert v.max() < SIDE / 2 + 0.3 * STEP
    assert np.abs(v.max(axis=1) - SIDE / 2).max() < 0.3 * STEP


def test_no_ray_passes_through_cells_from_inside() -> None:
    k = np.arange(20_000) + 0.5
    z, turn = 1 - 2 * k / len(k), k * np.pi * (3 - np.sqrt(5))
    ways = np.stack([np.sqrt(1 - z * z) * np.cos(turn), np.sqrt(1 - z * z) * np.sin(turn), z], axis=1)
    face, _ = Sight(box().mesh).first_hits(np.zeros(3), ways)
    assert (face < 0).mean() < 2e-4


def test_sparse_places_have_larger_cells() -> None:
    """A square with one spacing in one half and twice that in the other has no holes."""
    fine, coarse = square(2, 0.05, 1, 0.0), square(2, 0.1, 1, 0.0)
    points = np.concatenate([fine[0] - (0, 0, 1), coarse[0] + (0, 0, 1)])
    normals = np.tile((0.0, 1.0, 0.0), (len(points), 1))
    mesh = make(on_surface(points, normals, 0.04, thin=0.05)).mesh
    x, z = np.meshgrid(np.linspace(-0.9, 0.9, 100), np.linspace(-1.9, 1.9, 200))
    above = np.stack([x.ravel(), np.ones(x.size), z.ravel()], axis=1)
    face, distance = Sight(mesh).first_hits(above, np.tile((0.0, -1.0, 0.0), (x.size, 1)))
    assert (face < 0).mean() < 1e-3  # rays that meet a seam exactly may slip through it
    np.testing.assert_allclose(distance[face >= 0], 1, atol=1e-5)


def test_a_sheet_ends_where_its_discs_do() -> None:
    """Cells that nothing cuts would stick out by two spacings, and cast shadows that are not there."""
    side, step, size = 2.0, 0.08, 0.05
    mesh = make(on_surface(*square(side, step, 1, 0.0), size, thin=0.05)).mesh
    end = side / 2 - step / 2 + CELLS.cell_reach * size
    assert np.abs(mesh.vertices).max() == pytest.approx(end, abs=CELLS.cell_weld * step)


def test_a_leaf_ends_where_its_own_discs_are_half_seen_through() -> None:
    """Few discs add little to each other's alpha; as wide as a sheet's edge, leaves would take more light."""
    step, size, apart = 0.08, 0.08, 0.15
    x, y, z = np.meshgrid([-step / 2, step / 2], np.arange(20) * apart, [-step, 0, step], indexing="ij")
    points = np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1)
    mesh = make(on_surface(points, np.tile((0.0, 1.0, 0.0), (len(points), 1)), size, thin=0.05)).mesh
    far = np.abs(mesh.vertices).max(axis=0)[[0, 2]]
    np.testing.assert_allclose(
        far, np.array([step / 2, step]) + CELLS.cell_half * size, atol=0.2 * (CELLS.cell_reach - CELLS.cell_half) * size
    )


def test_the_same_cells_on_any_number_of_threads() -> None:
    one, two = (make(box_shell(1, 0.1, thin=0.05), ProxySettings(threads=n)).mesh for n in (1, 2))
    np.testing.assert_array_equal(one.vertices, two.vertices)
    np.testing.assert_array_equal(one.faces, two.faces)


@pytest.mark.parametrize("seed", range(3))
def test_cut_polygons_are_what_all_half_planes_share(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n, radius = 50, np.full(50, 1.0)
    cells = octagons(radius)
    turns = rng.uniform(0, 2 * np.pi, (n, 6))
    normals = np.stack([np.cos(turns), np.sin(turns)], axis=2)
    offsets = rng.uniform(0.1, 1.0, (n, 6))
    for k in range(6):
        cells.cut(np.arange(n), normals[:, k], offsets[:, k])
    eighths = (np.arange(8) + 0.5) * np.pi / 4 + np.pi / 8
    octagon = np.stack([np.cos(eighths), np.sin(eighths)], axis=1)
    for i in range(n):
        corners = cells.corners[i, : cells.count[i]]
        assert (corners @ normals[i].T <= offsets[i] + 1e-9).all()
        following = np.roll(corners, -1, axis=0)
        area = 0.5 * float((corners[:, 0] * following[:, 1] - corners[:, 1] * following[:, 0]).sum())
        points = rng.uniform(-1, 1, (20_000, 2))
        inside = (points @ octagon.T <= np.cos(np.pi / 8)).all(axis=1) & (points @ normals[i].T <= offsets[i]).all(
            axis=1
        )
        assert area == pytest.approx(4 * inside.mean(), abs=0.06)
