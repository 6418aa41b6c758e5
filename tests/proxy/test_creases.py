"""Cells where surfaces meet: no crack at edges, in corners and grooves, and what is open stays open."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from mirelight.lighting.sight import Sight
from mirelight.model import ProxyMesh
from mirelight.proxy import make
from mirelight.proxy.polygons import Polygons, octagons

from .clouds import F64, box_shell, on_surface

STEP = 0.05
THIN = 0.05  # of their size: how thick discs are


def patch(low: tuple[float, float, float], high: tuple[float, float, float], axis: int, seed: int) -> tuple[F64, F64]:
    """Points strewn over a rectangle across one axis, about a step apart, and their normals."""
    rng = np.random.default_rng(seed)
    others = [k for k in range(3) if k != axis]
    x, y = (np.arange(low[k] + STEP / 2, high[k], STEP) for k in others)
    u, v = (a.ravel() for a in np.meshgrid(x, y, indexing="ij"))
    points = np.full((len(u), 3), float(low[axis]))
    for k, a in zip(others, (u, v), strict=True):
        points[:, k] = a + rng.uniform(-0.2, 0.2, len(u)) * STEP
    normals = np.zeros_like(points)
    normals[:, axis] = rng.choice([-1.0, 1.0], len(u))
    return points, normals


def made(*patches: tuple[F64, F64]) -> ProxyMesh:
    points, normals = (np.concatenate(x) for x in zip(*patches, strict=True))
    return make(on_surface(points, normals, 0.7 * STEP, thin=THIN)).mesh


def past(mesh: ProxyMesh, eye: F64, targets: F64) -> F64:
    """How far behind the targets rays to them end, in steps; endless where they meet nothing."""
    way = targets - eye
    far = np.linalg.norm(way, axis=1)
    face, distance = Sight(mesh).first_hits(eye, way / far[:, None])
    return np.where(face < 0, np.inf, (distance - far) / STEP)


def test_no_ray_gets_into_a_box_at_its_edges() -> None:
    mesh = make(box_shell(1, STEP, thin=THIN)).mesh
    rng = np.random.default_rng(1)
    at = rng.uniform(-0.49, 0.49, (4_000, 3))
    at[:, 0] = 0.5  # beside the edge between two sides, on the one or on the other
    at[:, 1] = 0.5 - rng.uniform(0, 1.5, len(at)) * STEP
    at[::2, :2] = at[::2, 1::-1]
    behind = past(mesh, np.array([2.0, 1.7, 0.4]), at)
    assert (behind > 0.2).mean() < 1e-3
    assert (behind < -0.2).mean() < 1e-3  # no fins beside it


@cache
def stairs() -> ProxyMesh:
    return made(
        patch((-0.6, 0, 0), (0, 0, 1), 1, 1),
        patch((0, 0, 0), (0, 0.3, 1), 0, 4),
        patch((0, 0.3, 0), (0.6, 0.3, 1), 1, 5),
    )


@pytest.mark.parametrize("eye", [(-0.8, 0.9, 0.5), (-1.5, 0.6, 1.4)])
def test_a_step_has_no_cracks_at_its_edge_and_in_its_corner(eye: tuple[float, float, float]) -> None:
    rng = np.random.default_rng(2)
    z, off = rng.uniform(0.1, 0.9, 4_000), rng.uniform(0, 1.5, 4_000) * STEP
    for at in (
        np.stack([-off, 0 * off, z], axis=1),
        np.stack([0 * off, off, z], axis=1),
        np.stack([0 * off, 0.3 - off, z], axis=1),
        np.stack([off, 0 * off + 0.3, z], axis=1),
    ):
        behind = past(stairs(), np.array(eye), at)
        assert (behind > 0.3).mean() < 2e-3
        assert (behind < -0.3).mean() < 2e-3


def test_a_groove_is_as_deep_as_it_is() -> None:
    """Two steps wide and one deep, between two planes: not bridged, not open at the bottom."""
    wide, deep = 2 * STEP, STEP
    mesh = made(
        patch((-0.6, 0, 0), (0, 0, 1), 1, 1),
        patch((wide, 0, 0), (0.6, 0, 1), 1, 2),
        patch((0, -deep, 0), (wide, -deep, 1), 1, 3),
        patch((0, -deep, 0), (0, 0, 1), 0, 4),
        patch((wide, -deep, 0), (wide, 0, 1), 0, 5),
    )
    rng = np.random.default_rng(3)
    at = np.stack([rng.uniform(0, wide, 4_000), np.full(4_000, -deep), rng.uniform(0.1, 0.9, 4_000)], axis=1)
    behind = past(mesh, np.array([wide / 2, 3.0, 0.5]), at)
    assert (behind > 0.3).mean() < 5e-3
    amid = np.abs(at[:, 0] - wide / 2) < 0.7 * STEP
    assert (behind[amid] < -0.3).mean() < 0.02


def test_a_window_of_three_steps_stays_open() -> None:
    """In a wall with jambs: their cells and the wall's end at each other, and what they leave open is the window."""
    half, deep = 1.5 * STEP, 3 * STEP
    points, normals = patch((-0.625, -0.625, 0), (0.625, 0.625, 0), 2, 1)
    open_there = (np.abs(points[:, :2]) < half).all(axis=1)
    jambs = []
    for k, side in enumerate((-half, half)):
        jambs.append(patch((side, -half, -deep), (side, half, 0), 0, 2 + k))
        jambs.append(patch((-half, side, -deep), (half, side, 0), 1, 4 + k))
    mesh = made((points[~open_there], normals[~open_there]), *jambs)
    rng = np.random.default_rng(4)
    at = np.concatenate([rng.uniform(-0.8, 0.8, (4_000, 2)) * half, np.zeros((4_000, 1))], axis=1)
    assert np.isinf(past(mesh, np.array([0.0, 0.0, 3.0]), at)).mean() > 0.99
    way = rng.uniform(0, 2 * np.pi, 4_000)
    rim = (half + rng.uniform(0, 1.0, 4_000) * STEP)[:, None] * np.stack([np.cos(way), np.sin(way)], axis=1)
    beside = (np.abs(rim) > half).any(axis=1)
    at[:, :2] = rim
    assert (past(mesh, np.array([0.0, 0.0, 3.0]), at[beside]) > 0.3).mean() < 5e-3


def test_a_post_does_not_open_the_wall_beside_it() -> None:
    """Planes are endless: those of a post's sides cross the wall behind it, its discs do not."""
    wall = patch((-0.6, 0, 0), (0.6, 1, 0), 2, 1)
    gap, wide = 1.5 * STEP, 2 * STEP
    post = [
        patch((-wide / 2, 0, gap), (-wide / 2, 1, gap + wide), 0, 2),
        patch((wide / 2, 0, gap), (wide / 2, 1, gap + wide), 0, 3),
        patch((-wide / 2, 0, gap + wide), (wide / 2, 1, gap + wide), 2, 4),
    ]
    mesh = made(wall, *post)
    rng = np.random.default_rng(5)
    at = np.stack([rng.uniform(-0.15, 0.15, 4_000), rng.uniform(0.1, 0.9, 4_000), np.zeros(4_000)], axis=1)
    assert (past(mesh, np.array([0.0, 0.5, -2.0]), at) > 0.1).mean() < 1e-3


def test_levels_of_one_normal_do_not_cut_each_other() -> None:
    """A board half a step over a floor: the floor goes on below it, each as far as its own discs."""
    floor, board = patch((-0.6, 0, 0), (0, 0, 1), 1, 1), patch((0, STEP / 2, 0), (0.6, STEP / 2, 1), 1, 2)
    mesh = made(floor, board)
    rng = np.random.default_rng(6)
    x, z = rng.uniform(-0.4, 0.4, 4_000), rng.uniform(0.1, 0.9, 4_000)
    at = np.stack([x, np.where(x < 0, 0.0, STEP / 2), z], axis=1)
    behind = past(mesh, np.array([0.0, 3.0, 0.5]), at)
    assert (behind > 0.6).mean() < 1e-3


@pytest.mark.parametrize("seed", range(3))
def test_lines_enter_and_leave_polygons_where_walks_along_them_do(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cells, turn = octagons(rng.uniform(0.5, 1, 30)), rng.uniform(0, 2 * np.pi, 30)
    tilt = rng.uniform(0, 2 * np.pi, 30)
    cells.cut(np.arange(30), np.stack([np.cos(tilt), np.sin(tilt)], axis=1), rng.uniform(0, 0.5, 30))
    normal, along = np.stack([np.cos(turn), np.sin(turn)], axis=1), np.stack([-np.sin(turn), np.cos(turn)], axis=1)
    offset = rng.uniform(-0.8, 0.8, 30)
    enter, leave = cells.chord(np.arange(30), normal, offset, along)
    t = np.linspace(-1.2, 1.2, 4_801)
    for i in range(30):
        walk = offset[i] * normal[i] + t[:, None] * along[i]
        corners = cells.corners[i, : cells.count[i]]
        side = np.roll(corners, -1, axis=0) - corners
        inside = np.all(
            side[:, 0] * (walk[:, None, 1] - corners[:, 1]) >= side[:, 1] * (walk[:, None, 0] - corners[:, 0]), axis=1
        )
        assert (enter[i] <= leave[i]) == inside.any()
        if inside.any():
            assert (enter[i], leave[i]) == pytest.approx((t[inside].min(), t[inside].max()), abs=1e-3)


def test_the_area_and_the_radius_of_polygons() -> None:
    cells = octagons(np.array([1.0, 2.0]))
    np.testing.assert_allclose(cells.area(), 2 * np.sqrt(2) * np.array([1.0, 4.0]))
    np.testing.assert_allclose(cells.radius(), [1, 2])
    square_of_two = Polygons(np.array([[[0.0, 0], [2, 0], [2, 2], [0, 2], [9, 9]]]), np.array([4]))
    np.testing.assert_allclose(square_of_two.area(), 4)
    np.testing.assert_allclose(square_of_two.radius(), np.sqrt(8))
