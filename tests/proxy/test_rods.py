"""Bars thinner than the discs on them: as wide as they are, from all sides, and nothing else becomes a bar."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from mirelight.lighting.sight import Sight
from mirelight.model import ProxyMesh
from mirelight.proxy import make
from mirelight.proxy.rods import rods_of

from .clouds import ball, on_surface, square

HALF, STEP, TALL = 0.006, 0.05, 1.0

F64 = NDArray[np.float64]


def bar(sides: int = 4) -> tuple[F64, F64]:
    """Middles and normals of discs on the sides of an upright bar, far apart for what it is wide."""
    rng = np.random.default_rng(5)
    at, normals = [], []
    for k in range(sides):
        turn = 2 * np.pi * k / sides
        out = np.array([np.cos(turn), 0.0, np.sin(turn)])
        up = np.arange(0.1, TALL, STEP) + rng.uniform(-0.3, 0.3, len(np.arange(0.1, TALL, STEP))) * STEP
        at.append(HALF * out + up[:, None] * (0, 1, 0))
        normals.append(np.tile(out, (len(up), 1)) * rng.choice([-1.0, 1.0], len(up))[:, None])
    return np.concatenate(at), np.concatenate(normals)


@cache
def standing(sides: int) -> ProxyMesh:
    """The bar on a floor."""
    floor, bars = square(2, STEP, 1, 0.0), bar(sides)
    points, normals = (np.concatenate([a, b]) for a, b in zip(floor, bars, strict=True))
    return make(on_surface(points, normals, 0.04, thin=0.02)).mesh


@pytest.mark.parametrize("sides", [4, 6])
def test_a_bar_is_as_wide_as_it_is_from_all_sides(sides: int) -> None:
    """Discs of 4 cm on a bar of 1.2: octagons would stick out on all sides. A square one stands for all of them."""
    shortest, longest = 2 * HALF, 2 * np.sqrt(2) * HALF
    sight, across = Sight(standing(sides)), np.linspace(-0.1, 0.1, 801)
    for turn in np.linspace(0, np.pi, 12, endpoint=False):
        way, side = np.array([np.cos(turn), 0, np.sin(turn)]), np.array([-np.sin(turn), 0, np.cos(turn)])
        for tall in (0.3, 0.5, 0.7):
            starts = across[:, None] * side - 0.5 * way + (0, tall, 0)
            face, _ = sight.first_hits(starts, np.tile(way, (len(across), 1)))
            wide = (face >= 0).mean() * 0.2
            assert 0.75 * shortest < wide < 1.3 * longest


def test_bars_turn_their_fronts_outwards() -> None:
    mesh = standing(4)
    corners = mesh.vertices[mesh.faces].astype(np.float64)
    normal, middle = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), corners.mean(axis=1)
    on_bar = (middle[:, 1] > 0.15) & (middle[:, 1] < 0.9)
    assert on_bar.any()
    outwards = (normal * (middle * (1, 0, 1))).sum(axis=1)[on_bar]
    assert (outwards > 0).mean() > 0.9


@pytest.mark.parametrize("surface", ["plane", "edge", "ball"])
def test_what_is_no_bar_has_none(surface: str) -> None:
    from scipy.spatial import cKDTree

    if surface == "ball":
        cloud = ball(2000)
        at = cloud.means.astype(np.float64)
        normals = at / np.linalg.norm(at, axis=1, keepdims=True)
    else:
        at, normals = square(2, STEP, 1, 0.0)
        if surface == "edge":
            wall = square(2, STEP, 0, 1.0)
            at, normals = np.concatenate([at, wall[0]]), np.concatenate([normals, wall[1]])
    distance, near = cKDTree(at).query(at, k=21)
    rods = rods_of(at, normals, near[:, 1:], distance[:, 6] / 1.8)
    assert not len(rods.rows)


def test_a_bar_is_found_by_its_discs() -> None:
    from scipy.spatial import cKDTree

    at, normals = bar(4)
    distance, near = cKDTree(at).query(at, k=21)
    rods = rods_of(at, normals, near[:, 1:], distance[:, 6] / 1.8)
    assert len(rods.rows) > 0.8 * len(at)
    np.testing.assert_allclose(np.abs(rods.axis[:, 1]), 1, atol=0.02)
    assert np.median(np.abs(rods.half / HALF - 1)) < 0.2
    off = np.linalg.norm((at[rods.rows] + rods.middle)[:, [0, 2]], axis=1)
    assert np.median(off) < 0.3 * HALF
