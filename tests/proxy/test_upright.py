"""Up is told by what views see of a surface: points on planes with noise, however they lie."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mirelight.apps.first_job import up
from mirelight.base import conventions
from mirelight.io import splats
from mirelight.model import F64, Camera, SplatCloud
from mirelight.proxy import ProxySettings
from mirelight.proxy.capture import look_at_capture
from mirelight.proxy.upright import Seen, Upright, levelled, seen_surface, upright
from mirelight.proxy.views import held_up

from .clouds import ball, joined, on_surface, sphere_points, square

SPREAD = np.array(list(product((-1.0, 1.0), repeat=3)))  # as far apart whichever way
LEVEL = SPREAD * [1, 0.1, 1]  # eyes of people who walk about
TURNS = [Rotation.random(random_state=k).as_matrix() for k in range(4)]


def plane(normal: tuple[int, int, int], middle: tuple[float, float, float], half: float, count: int) -> tuple[F64, F64]:
    """So many points on a square, and its normal at each."""
    points = np.random.default_rng(count).uniform(-half, half, (count, 3))
    way = np.array(normal, np.float64)
    return points * (way == 0) + middle, np.tile(way, (count, 1))


def seen(*parts: tuple[F64, F64], turn: F64, eyes: F64 | None = None, around: bool = False) -> Seen:
    """The surface, turned, its normals off by some 3 degrees."""
    points, normals = (np.concatenate(x) for x in zip(*parts, strict=True))
    normals = conventions.unit(normals + np.random.default_rng(9).normal(0, 0.05, normals.shape))
    places = LEVEL if eyes is None else eyes
    return Seen(points @ turn.T, normals @ turn.T, np.full(len(points), 1 / len(points)), places @ turn.T, around)


def off(found: Upright | None, turn: F64) -> float:
    """Degrees between what is found and up."""
    assert found is not None
    return float(np.degrees(np.arccos(np.clip(found.way @ turn[:, 1], -1, 1))))


WALLS = (
    plane((1, 0, 0), (-2, 0, 0), 2, 900),
    plane((-1, 0, 0), (2, 0, 0), 2, 800),
    plane((0, 0, 1), (0, 0, -2), 2, 850),
)
FRONT = plane((0, 0, -1), (0, 0, 2), 2, 850)
FLOOR, CEILING = plane((0, 1, 0), (0, -2, 0), 2, 1000), plane((0, -1, 0), (0, 2, 0), 2, 1000)
TABLE = plane((0, 1, 0), (0, -1.2, 0), 0.6, 200)


@pytest.mark.parametrize("turn", TURNS)
def test_a_floor_between_walls_is_beneath(turn: F64) -> None:
    found = upright(seen(FLOOR, *WALLS, turn=turn))
    assert off(found, turn) < 0.3
    assert found is not None and not found.doubt


@pytest.mark.parametrize("turn", TURNS)
def test_things_stand_on_the_floor_of_a_closed_room(turn: F64) -> None:
    found = upright(seen(FLOOR, CEILING, TABLE, *WALLS, FRONT, turn=turn))
    assert off(found, turn) < 0.3
    assert found is not None and not found.doubt
    bare = upright(seen(FLOOR, CEILING, *WALLS, FRONT, turn=turn))
    assert bare is not None and bare.doubt


def test_steps_and_rims_of_a_ceiling_are_no_things() -> None:
    lower = plane((0, -1, 0), (0, 1.7, 0), 2, 600)
    rim = (plane((0, 1, 0), (0, 1.75, 0), 2, 700)[0], np.tile(conventions.unit([0.6, -0.8, 0]), (700, 1)))
    for turn in TURNS:
        found = upright(seen(FLOOR, CEILING, lower, rim, TABLE, *WALLS, FRONT, turn=turn))
        assert off(found, turn) < 0.3
        assert found is not None and not found.doubt


def test_the_largest_flat_side_of_a_thing_that_stands_is_no_floor_of_it() -> None:
    """A guitar on its stand: a front and a back, rounded sides, and nothing level."""
    front, back = plane((1, 0, 0), (0.1, 0, 0), 1, 900), plane((-1, 0, 0), (-0.1, 0, 0), 1, 900)
    turns = np.random.default_rng(4).uniform(0, 2 * np.pi, 1500)
    way = np.stack([np.sin(turns), np.zeros(1500), np.cos(turns)], axis=1)
    sides = way + np.random.default_rng(5).uniform(-1, 1, (1500, 1)) * np.array([0, 1, 0]), way
    shown = seen(front, back, sides, turn=np.eye(3), eyes=SPREAD, around=True)
    found = upright(shown, np.array([0.0, 1.0, 0.0]))
    assert off(found, np.eye(3)) < 1
    assert found is not None and "floor" in found.doubt
    anyhow = upright(shown)
    assert anyhow is not None and abs(anyhow.way[0]) > 0.99


@pytest.mark.parametrize("turn", TURNS)
def test_what_a_sheet_carries_is_above_it_though_it_is_seen_from_both_sides(turn: F64) -> None:
    thing = 0.5 * sphere_points(600)
    beneath = (FLOOR[0], -FLOOR[1])
    found = upright(
        seen(FLOOR, beneath, (thing - [0, 1.5, 0], conventions.unit(thing)), turn=turn, eyes=SPREAD, around=True)
    )
    assert off(found, turn) < 0.5


def test_nothing_faces_one_way_more_than_others_on_a_ball() -> None:
    points = sphere_points(4000)
    assert upright(seen((points, points), turn=np.eye(3))) is None


def test_of_alike_sides_the_one_along_which_cameras_are_as_high_is_up_or_the_habit() -> None:
    """Three sides of a cube; cameras on a plane, or anywhere."""
    corner = (
        plane((0, 1, 0), (0, -2, 0), 2, 900),
        plane((1, 0, 0), (-2, 0, 0), 2, 900),
        plane((0, 0, 1), (0, 0, -2), 2, 900),
    )
    for turn in TURNS:
        level = upright(seen(*corner, turn=turn, eyes=LEVEL))
        assert off(level, turn) < 0.5 and level is not None and not level.doubt
        anywhere = upright(seen(*corner, turn=turn, eyes=SPREAD))
        assert anywhere is not None and anywhere.doubt
        usual = upright(seen(*corner, turn=turn, eyes=SPREAD), turn[:, 1])
        assert off(usual, turn) < 0.5


def thing_on_a_floor() -> SplatCloud:
    """Blobs, which the floor among discs is not asked of."""
    floor, up_there = square(5.0, 0.1, 1, 0.0)
    thing = sphere_points(1500)
    points = np.concatenate([floor, 0.8 * thing + np.array([0, 0.8, 0])])
    return on_surface(points, np.concatenate([up_there, thing]), 0.05, thin=0.3)


@pytest.mark.parametrize("turn", [(0, 0, 0), (20, 30, 40), (160, 10, -30)])
def test_splats_on_a_floor_are_brought_upright(turn: tuple[float, float, float]) -> None:
    m = np.eye(4)
    m[:3, :3] = conventions.rotation_from_euler(turn)
    found = up.find(splats.transform(thing_on_a_floor(), m), Path("a.ply"))
    assert not found.guessed and "surface" in found.why
    assert found.way @ m[:3, 1] > np.cos(np.radians(1.0))


def test_rough_grass_is_a_floor() -> None:
    chance = np.random.default_rng(7)
    points = chance.uniform((-2.5, 0, -2.5), (2.5, 0.3, 2.5), (9000, 3))
    blades = on_surface(points, conventions.unit(chance.normal(size=points.shape)), 0.05, thin=0.3)
    stone = 0.6 * sphere_points(1500)
    lawn = joined(blades, on_surface(stone + np.array([0, 0.5, 0]), stone / 0.6, 0.04, thin=0.3))
    m = np.eye(4)
    m[:3, :3] = conventions.rotation_from_euler((180, 0, 0))  # as most files have it
    found = up.find(splats.transform(lawn, m), Path("a.ply"))
    assert not found.guessed
    assert found.way @ m[:3, 1] > np.cos(np.radians(3.0))


def test_splats_of_one_picture_are_not_rolled() -> None:
    level = Camera.look_at((0, 2, 5), (0, 0.5, 0), 160, 90, yfov=60)
    roll = np.eye(4)
    roll[:3, :3] = conventions.rotation_from_euler((0, 0, 6))
    camera = replace(level, world_from_camera=level.world_from_camera @ roll)
    found = up.find(thing_on_a_floor(), Path("photo.ply"), (camera,))
    right, own_up = camera.world_from_camera[:3, 0], camera.world_from_camera[:3, 1]
    assert found.way @ right == pytest.approx(0, abs=1e-9)
    assert found.way @ own_up == pytest.approx(level.world_from_camera[1, 1], abs=0.01)  # it looks as far down


def test_a_ball_of_splats_tells_nothing() -> None:
    capture = look_at_capture(ball(), "ball")
    assert upright(seen_surface(capture, (), ProxySettings())) is None


@pytest.mark.parametrize("turn", TURNS)
def test_cameras_that_lean_are_put_right_by_floors_and_walls(turn: F64) -> None:
    shown, up_there = seen(*WALLS, FLOOR, turn=turn), turn[:, 1]
    leaning = conventions.unit(up_there + 0.12 * turn[:, 0])
    assert np.degrees(np.arccos(np.clip(levelled(shown, leaning) @ up_there, -1, 1))) < 0.7
    little = seen(plane((1, 1, 0), (0, 0, 0), 2, 4000), TABLE, turn=turn)  # a slope, and hardly anything level
    assert np.array_equal(levelled(little, leaning), leaning)
    off_by_30 = conventions.unit(up_there + np.tan(np.radians(30)) * turn[:, 0])
    slanted = seen(plane((1, 1, 0), (0, 0, 0), 2, 4000), turn=turn)
    assert np.array_equal(levelled(slanted, off_by_30), off_by_30)


def test_cameras_that_look_down_from_one_side_are_held_level() -> None:
    """Their mean leans to where they look; across the right of all is up."""
    looks = [Camera.look_at(np.array([x, 2.0, 3.0]), np.array([0.3 * x, 0, 0]), 8, 8, yfov=40) for x in (-2, -1, 1, 2)]
    level = held_up(looks, np.zeros((1, 3)))
    assert level is not None and np.allclose(level, [0, 1, 0], atol=1e-6)
    about = [replace(looks[0], world_from_camera=conventions.compose(rotation=turn)) for turn in TURNS]
    assert held_up(about, np.zeros((1, 3))) is None and held_up([], np.zeros((1, 3))) is None


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("back", [False, True])
def test_what_a_drone_maps_lies_beneath_it(turn: F64, back: bool) -> None:
    """To and fro over the land, its head ahead on each strip or to one side: its pictures' up is none."""
    rng = np.random.default_rng(1)
    land = (rng.uniform(-8, 8, (500, 3)) * [1, 0.1, 1]) @ turn.T

    def surveyed(strip: float, apart: float) -> list[Camera]:
        cameras = []
        for k, z in enumerate(np.linspace(-apart, apart, 3)):
            head = np.diag([-1.0, 1.0, -1.0]) if back and k % 2 else np.eye(3)
            down = turn @ head @ np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # looks along -Y, and has -Z up
            places = (np.array([x, 5.0 + 0.1 * rng.normal(), z]) for x in np.linspace(-strip, strip, 5))
            cameras += [
                replace(
                    Camera.look_at((0, 0, 1), (0, 0, 0), 8, 8, yfov=40),
                    world_from_camera=conventions.compose(translation=turn @ place, rotation=down),
                )
                for place in places
            ]
        return cameras

    above = held_up(surveyed(4, 3), land)
    assert above is not None and np.allclose(above, turn[:, 1], atol=1e-6)
    front = held_up(surveyed(4, 0.7), land)  # the same of a wall, whose pictures somebody took on foot
    assert front is None if back else front is not None and np.allclose(front, -turn[:, 2], atol=1e-6)
