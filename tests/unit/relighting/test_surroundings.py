"""Light from far away as a map: energy of suns, turning, and the frames that maps are seen in."""

from __future__ import annotations

import numpy as np
import pytest

from mirelight.base import conventions
from mirelight.model import Camera
from mirelight.relighting.surroundings import CAMERA_FROM_MAP, Map, Sun, Surroundings, shrunk, solid_angles


def way_of(u: float, v: float) -> np.ndarray:
    """The direction that `conventions` gives a place of a map."""
    theta, phi = np.pi * v, 2 * np.pi * (u - 0.5)
    return np.array([np.cos(phi) * np.sin(theta), np.cos(theta), np.sin(phi) * np.sin(theta)])


def ways(rows: int) -> np.ndarray:
    v, u = (np.arange(rows) + 0.5) / rows, (np.arange(2 * rows) + 0.5) / (2 * rows)
    return np.array([[way_of(x, y) for x in u] for y in v])


def test_pixels_look_where_the_conventions_say() -> None:
    np.testing.assert_allclose(conventions.map_pixels(8), ways(8), atol=1e-15)
    for place, axis in (((0.5, 0.5), (1, 0, 0)), ((0.75, 0.5), (0, 0, 1)), ((0.3, 0.0), (0, 1, 0))):
        np.testing.assert_allclose(conventions.map_direction(*place), axis, atol=1e-15)


@pytest.mark.parametrize("rows", [16, 64])
@pytest.mark.parametrize("diameter", [0.05, 0.53, 8.0])
@pytest.mark.parametrize("to_sun", [(0, 1, 0), (0.3, 0.6, -0.5), (-1, 0.01, 0.02), (-1, -0.5, 0)])
def test_a_sun_gives_its_illuminance_however_small_it_is(rows: int, diameter: float, to_sun: tuple[float, ...]) -> None:
    toward = conventions.unit(to_sun)
    lux = np.array([3.0, 2.0, 1.0])
    picture = Surroundings(suns=(Sun(-toward, lux, diameter),)).picture(rows)
    facing = np.maximum(ways(rows) @ toward, 0) * solid_angles(rows)
    np.testing.assert_allclose((picture * facing[..., None]).sum(axis=(0, 1)), lux, rtol=1e-5)
    assert (ways(rows)[picture[..., 0] > 0] @ toward).min() > np.cos(np.radians(diameter / 2) + np.pi / rows)


def test_maps_are_turned_and_added() -> None:
    rng = np.random.default_rng(0)
    one, other = (rng.uniform(0, 1, (16, 32, 3)).astype(np.float32) for _ in range(2))
    ones = np.ones(3)
    np.testing.assert_array_equal(Surroundings(maps=(Map(one, 0, ones),)).picture(16), one)
    turned = Surroundings(maps=(Map(one, 90, ones), Map(other, 0, np.array([2.0, 0, 1])))).picture(16)
    np.testing.assert_allclose(turned, np.roll(one, -8, axis=1) + other * [2, 0, 1], rtol=1e-6)  # left by a quarter
    even = Surroundings(maps=(Map(np.full((1, 1, 3), 0.5, np.float32), 20, ones),))
    assert (even.picture(4) == 0.5).all()


def test_a_camera_s_map_has_the_view_in_its_middle_and_the_right_at_three_quarters() -> None:
    """Where Stanford-ORB's maps look: centre ahead, u = 0.75 to the right, row 0 up, all of the camera."""
    camera = Camera.look_at((1, 2, 3), (0, 0.5, -1), 8, 8)
    turn = camera.world_from_camera[:3, :3]
    for axis, place in ((-turn[:, 2], (0.5, 0.5)), (turn[:, 0], (0.75, 0.5)), (turn[:, 1], (None, 0.0))):
        picture = Surroundings(suns=(Sun(-axis, np.ones(3), 2.0),)).picture(64, turn @ CAMERA_FROM_MAP)
        row, column = np.unravel_index(picture[..., 0].argmax(), (64, 128))
        assert abs((row + 0.5) / 64 - place[1]) <= 1 / 64
        assert place[0] is None or abs((column + 0.5) / 128 - place[0]) <= 1 / 128


def test_smaller_maps_keep_their_light() -> None:
    rng = np.random.default_rng(0)
    radiance = rng.uniform(0, 1, (64, 128, 3)).astype(np.float32)
    small = shrunk(radiance, 16)
    assert small.shape == (16, 32, 3)
    full, less = ((x * solid_angles(len(x))[..., None]).sum(axis=(0, 1)) for x in (radiance, small))
    np.testing.assert_allclose(less, full, rtol=2e-4)
    assert shrunk(radiance[:10, :9], 64).shape == (10, 9, 3)
