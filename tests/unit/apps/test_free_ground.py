"""Where a first picture has room for an object."""

from __future__ import annotations

import numpy as np
import pytest

from mirelight.apps.first_job import objects
from mirelight.apps.first_job.free_ground import FreeGround
from mirelight.model import F64, Camera, SplatLayer

_CAMERA = Camera.look_at((0, 1.6, 4), (0, 0.6, 0), 160, 90, yfov=50, name="first")


def _picture(*boxes: tuple[tuple[float, float, float], tuple[float, float, float]]) -> SplatLayer:
    """A floor at Y 0 and boxes, from low to high corners."""
    camera = _CAMERA
    y, x = np.mgrid[: camera.height, : camera.width] + 0.5
    own = np.stack([(x - camera.cx) / camera.fx, (camera.cy - y) / camera.fy, -np.ones_like(x)], axis=-1)
    way = own @ camera.world_from_camera[:3, :3].T
    depth = np.where(way[..., 1] < -1e-3, camera.position[1] / np.maximum(-way[..., 1], 1e-3), np.inf)
    for low, high in boxes:
        with np.errstate(divide="ignore"):
            first, last = ((np.array(end) - camera.position) / way for end in (low, high))
        enter, leave = np.minimum(first, last).max(axis=-1), np.maximum(first, last).min(axis=-1)
        depth = np.where((enter < leave) & (enter > 0), np.minimum(depth, enter), depth)
    depth = np.where(depth < 30, depth, 0).astype(np.float32)
    empty = np.zeros(depth.shape, np.float32)
    return SplatLayer(
        camera=camera,
        color=np.zeros((*depth.shape, 3), np.float32),
        transmittance=empty,
        depth=depth,
        median_depth=depth,
    )


def _pixels(place: F64) -> F64:
    own = (place - _CAMERA.position) @ _CAMERA.world_from_camera[:3, :3]
    return np.array([_CAMERA.cx - _CAMERA.fx * own[0] / own[2], _CAMERA.cy + _CAMERA.fy * own[1] / own[2]])


def test_what_can_stand_where_it_should_does() -> None:
    wish = np.array([0.3, 0.0, 0.5])
    place = FreeGround(_picture()).take(wish, 0.3, 0.5)
    assert place is not None and np.linalg.norm(place - wish) < 0.1


@pytest.mark.parametrize("top", [0.3, 1.2])
def test_nothing_stands_on_the_edge_of_a_thing_or_in_it(top: float) -> None:
    place = FreeGround(_picture(((-0.5, 0, 0), (0.5, top, 1)))).take(np.array([0.5, 0.0, 0.5]), 0.3, 0.5)
    assert place is not None and place[1] == pytest.approx(0, abs=0.05)
    beside = np.maximum(np.abs(place[[0, 2]] - [0, 0.5]) - 0.5, 0)
    assert np.linalg.norm(beside) > 0.25 and place[2] > -0.3  # nor behind it, where it would be hidden


def test_it_stands_on_the_table_that_is_looked_at() -> None:
    """Not on the floor, which is lower and shown, too; on the floor beside a table that nobody looks at."""
    table = ((-0.9, 0.0, -0.4), (0.9, 0.6, 1.0))
    on = FreeGround(_picture(table)).take(np.array([0.0, 0.7, 0.4]), 0.1, 0.2)
    assert on is not None and on[1] == pytest.approx(0.6, abs=0.02)
    beside = FreeGround(_picture(table)).take(np.array([1.3, 0.7, 0.4]), 0.1, 0.2)
    assert beside is not None and beside[1] == pytest.approx(0.0, abs=0.02)


def test_what_hangs_over_it_is_not_in_its_way() -> None:
    """A branch over a table, higher than the object's top."""
    wish, branch = np.array([0.0, 0.0, 0.5]), ((-0.5, 0.8, 0.2), (0.5, 0.9, 0.8))
    place = FreeGround(_picture(branch)).take(wish, 0.2, 0.4)
    assert place is not None and np.linalg.norm(place - wish) < 0.1
    taller = FreeGround(_picture(branch)).take(wish, 0.2, 0.75)
    assert taller is not None and np.linalg.norm(taller - wish) > 0.2


def test_one_stands_beside_the_other_in_the_picture() -> None:
    ground = FreeGround(_picture())
    places = [ground.take(np.array([0.0, 0.0, 1.0]), 0.3, 0.5) for _ in range(3)]
    assert all(x is not None for x in places)
    at = sorted(float(_pixels(np.asarray(x))[0]) for x in places)
    assert np.diff(at).min() > 15


def test_what_is_too_large_for_the_ground_stands_nowhere() -> None:
    assert FreeGround(_picture()).take(np.zeros(3), 0.5, 30) is None  # its top would be cut off
    narrow = _picture(((-9, 0, -9), (-0.2, 3, 9)), ((0.2, 0, -9), (9, 3, 9)))
    assert FreeGround(narrow).take(np.zeros(3), 0.5, 0.5) is None


def test_a_thing_takes_the_first_size_that_fits_a_little_over_its_ground() -> None:
    box = objects._Thing("box", frozenset(["box"]), np.array([-1.0, 0, -1]), np.array([1.0, 2, 1]))
    near = np.array([0.0, 1.6, 0.5])
    shelf = _picture(((-9, 0, -9), (-0.3, 3, 9)), ((0.3, 0, -9), (9, 3, 9)))
    foot, scale = objects._stood(box, [1.0, 0.5, 0.2], near, FreeGround(shelf))
    assert scale == 0.2 and foot[1] == pytest.approx(0.04, abs=0.01) and abs(foot[0]) < 0.15
    foot, scale = objects._stood(box, [1.0, 0.5], near, FreeGround(shelf))
    assert scale == 1 and np.allclose(foot, [0, -0.4, 0.5])  # its top is as high as was asked
