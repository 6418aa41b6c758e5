"""Bars thinner than the discs on them: as wide as they are, from all sides, and nothing else becomes a bar."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from mirelight.lighting.sight import Sight
from mirelight.model import ProxyMesh
from mirelight.proxy import make
from mirelight.proxy.discs import neighbours_of
from mirelight.proxy.rods import Rods, rods_of
from mirelight.proxy.slender import slender_of

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


def found(at: F64, normals: F64) -> Rods:
    """Rods on which discs lie that have no plane around them."""
    near, distance = neighbours_of(at, 20)
    return rods_of(at, normals, near, distance[:, 5] / 1.8, np.zeros((0, 3)))


@pytest.mark.parametrize("surface", ["plane", "edge", "ball"])
def test_what_is_no_bar_has_none(surface: str) -> None:
    if surface == "ball":
        cloud = ball(2000)
        at = cloud.means.astype(np.float64)
        normals = at / np.linalg.norm(at, axis=1, keepdims=True)
    else:
        at, normals = square(2, STEP, 1, 0.0)
        if surface == "edge":
            wall = square(2, STEP, 0, 1.0)
            at, normals = np.concatenate([at, wall[0]]), np.concatenate([normals, wall[1]])
    assert not len(found(at, normals).rows)


def test_a_groove_in_a_plane_is_no_slender_rod() -> None:
    """Its sides face each other, and lines along their normals meet, but planes are beside it."""
    at, normals = square(2, STEP, 1, 0.0)
    flats = at[np.abs(at[:, 0]) > 3 * STEP]
    inside = np.abs(at[:, 0]) < STEP
    at[inside, :2] = np.stack([np.sign(at[inside, 0]) * 0.2 * STEP, np.full(inside.sum(), -0.1 * STEP)], axis=1)
    normals[inside, 0] = -np.sign(at[inside, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    near, distance = neighbours_of(at, 20)
    assert not slender_of(at, normals, near, distance[:, 5] / 1.8, flats).there.any()


def test_a_bar_is_found_by_its_discs() -> None:
    at, normals = bar(4)
    rods = found(at, normals)
    assert len(rods.rows) > 0.8 * len(at)
    np.testing.assert_allclose(np.abs(rods.axis[:, 1]), 1, atol=0.02)
    out = np.linalg.norm(rods.ring, axis=2)
    assert np.median(out.min(axis=1)) > HALF * 0.8 and np.median(out.max(axis=1)) < HALF * np.sqrt(2) * 1.2
    off = np.linalg.norm((at[rods.rows] + rods.middle)[:, [0, 2]], axis=1)
    assert np.median(off) < 0.3 * HALF


def few(count: int, radius: float, tall: float, seed: int) -> tuple[F64, F64]:
    """So many discs anywhere around an upright round post."""
    rng = np.random.default_rng(seed)
    turn, up = rng.uniform(0, 2 * np.pi, count), (np.arange(count) + rng.uniform(0.2, 0.8, count)) / count * tall
    out = np.stack([np.cos(turn), 0 * turn, np.sin(turn)], axis=1)
    return radius * out + up[:, None] * (0, 1, 0), out * rng.choice([-1.0, 1.0], count)[:, None]


@pytest.mark.parametrize("radius", [0.006, 0.012])
def test_posts_of_few_discs_hide_of_a_lamp_what_they_should(radius: float) -> None:
    """Around a lamp stand six posts: of a circle around it they hide six times twice the arc sine of radius by way."""
    away, tall = 0.1, 0.3
    turn = np.arange(6) * (np.pi / 3)
    foot = away * np.stack([np.cos(turn), 0 * turn, np.sin(turn)], axis=1)
    posts = [few(12, radius, tall, seed) for seed in range(6)]
    at = np.concatenate([post[0] + place for post, place in zip(posts, foot, strict=True)])
    rods = found(at, np.concatenate([post[1] for post in posts]))
    assert len(rods.rows) > 0.9 * len(at)
    nothing = np.zeros(len(rods.rows))
    sight = Sight(rods.prisms(at[rods.rows], nothing, nothing).mesh())
    around = np.linspace(0, 2 * np.pi, 3600, endpoint=False)
    way = np.stack([np.cos(around), 0 * around, np.sin(around)], axis=1)
    hidden = [(sight.first_hits(np.tile((0, tall * up, 0), (3600, 1)), way)[0] >= 0).mean() for up in (0.35, 0.5, 0.65)]
    np.testing.assert_allclose(hidden, 6 * np.arcsin(radius / away) / np.pi, rtol=0.2)


def test_a_post_goes_on_to_where_it_ends() -> None:
    """On a plate, but for the lowest disc: by what is found where it is free, as beside its lower end it is not."""
    at, normals = few(14, HALF, 0.4, 1)
    plate = square(0.12, 0.02, 1, 0.0)
    rods = found(np.concatenate([at, plate[0]]), np.concatenate([normals, plate[1]]))
    assert set(range(1, 14)) <= set(rods.rows.tolist())
    assert rods.rows.max() < 14


def test_a_ring_is_as_thick_as_its_tube() -> None:
    """A disc every 8 mm, anywhere around a tube of 5 mm radius that is bent to a ring of 120."""
    rng = np.random.default_rng(3)
    around, turn = np.arange(90) * (2 * np.pi / 90), rng.uniform(0, 2 * np.pi, 90)
    out = np.stack([np.cos(around), 0 * around, np.sin(around)], axis=1)
    normals = np.cos(turn)[:, None] * out + np.sin(turn)[:, None] * (0, 1, 0)
    at = 0.12 * out + 0.005 * normals
    rods = found(at, normals)
    assert len(rods.rows) > 0.8 * len(at)
    axis = at[rods.rows] + rods.middle
    assert np.median(np.abs(np.linalg.norm(axis[:, [0, 2]], axis=1) / 0.12 - 1)) < 0.03
    assert abs(np.median(np.linalg.norm(rods.ring, axis=2)) / 0.005 - 1) < 0.2
    along = np.cross(out[rods.rows], (0, 1, 0))
    assert np.median(np.abs((along * rods.axis).sum(axis=1))) > 0.97


@pytest.mark.parametrize("seed", range(4))
def test_a_ring_of_few_discs_bends_with_them(seed: int) -> None:
    """Twenty discs anywhere around a tube of 12 mm radius, on a ring of 80: within what tells of it, it turns by 60
    degrees and more. From its middle it hides of the directions in its plane's height as much as it should."""
    rng = np.random.default_rng(seed)
    around, turn = (np.arange(20) + rng.uniform(-0.3, 0.3, 20)) * (np.pi / 10), rng.uniform(0, 2 * np.pi, 20)
    out = np.stack([np.cos(around), 0 * around, np.sin(around)], axis=1)
    normals = np.cos(turn)[:, None] * out + np.sin(turn)[:, None] * (0, 1, 0)
    at = 0.08 * out + 0.012 * normals
    rods = found(at, normals * rng.choice([-1.0, 1.0], 20)[:, None])
    assert len(rods.rows) > 0.8 * len(at)
    assert abs(np.median(np.linalg.norm(rods.ring, axis=2)) / 0.012 - 1) < 0.2
    nothing = np.zeros(len(rods.rows))
    sight = Sight(rods.prisms(at[rods.rows], nothing, nothing).mesh())
    up, round_ = np.meshgrid(np.linspace(-0.6, 0.6, 121), np.linspace(0, 2 * np.pi, 360, endpoint=False))
    way = np.stack([np.cos(up) * np.cos(round_), np.sin(up), np.cos(up) * np.sin(round_)], axis=-1).reshape(-1, 3)
    hidden = (sight.first_hits(np.zeros(3), way)[0] >= 0).mean()
    np.testing.assert_allclose(hidden, np.arcsin(0.012 / 0.08) / 0.6, rtol=0.2)
