"""Splats past the proxy follow the far light: the factor there is a quotient known in closed form."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from mirelight import relighting
from mirelight.base.conventions import map_pixels, unit
from mirelight.model import F32, Camera, LightingBuffer, LightLayer, RelightMode, RelightSettings, SplatLayer
from mirelight.relighting.far import far_map
from mirelight.relighting.surroundings import Map, Sun, Surroundings

H, W = 24, 36
FOLLOWS = RelightSettings(mode="ratio", background="environment", delta=0.01)
LEVEL = 2.0  # of the captured light on the surface
FLOOR = FOLLOWS.delta * LEVEL
DAY, EVENING = np.array([0.4, 0.6, 1.0]), np.array([0.6, 0.3, 0.2])


def looking(towards: tuple[float, float, float]) -> Camera:
    return Camera.look_at((0, 0, 0), towards, W, H, yfov=50)


def dome(radiance: Any, rows: int = 64, rotation: float = 0.0, suns: tuple[Sun, ...] = ()) -> Surroundings:
    pixels = np.broadcast_to(np.asarray(radiance, np.float32), (rows, 2 * rows, 3))
    return Surroundings((Map(np.array(pixels), rotation, np.ones(3)),), suns)


def factor(
    camera: Camera,
    new: Surroundings | None,
    old: Surroundings | None,
    settings: RelightSettings = FOLLOWS,
    beyond: F32 | None = None,
) -> F32:
    """Of a frame whose last column alone shows the proxy, lit by half of its captured light."""
    coverage = np.zeros((H, W), np.float32)
    coverage[:, -1] = 1
    up = np.broadcast_to(np.array([0, 1, 0], np.float32), (H, W, 3))
    captured = LightingBuffer(
        camera=camera,
        coverage=coverage,
        layers=(LightLayer(name="sun", direct=coverage[..., None] * np.ones(3, np.float32), indirect=0 * up),),
        depth=coverage,
        position=up,
        normal=up,
        geometric_normal=up,
        albedo=np.full((H, W, 3), 0.5, np.float32),
    )
    flat = np.full((H, W), 0.25, np.float32)
    splats = SplatLayer(camera=camera, color=0.5 * up, transmittance=flat, depth=flat, median_depth=flat, beyond=beyond)
    frame = relighting.apply(
        splats,
        captured.reweighted({"sun": 0.5}),
        settings,
        captured=captured,
        captured_level=LEVEL,
        far=relighting.Far(far_map(new), far_map(old)),
        noise=False,
    )
    assert frame.factor is not None
    return frame.factor


def away(image: F32) -> F32:
    """Beyond what the surface's factor is carried to."""
    return image[:, : W - 6]


@pytest.mark.parametrize("towards", [(0, 0.8, -1), (1, 0.0, 0.2), (-0.3, -0.7, 1), (0, 1, 0.01)])
def test_under_even_domes_it_is_their_quotient_in_every_direction(towards: tuple[float, float, float]) -> None:
    found = factor(looking(towards), dome(EVENING), dome(DAY))
    expected = np.broadcast_to((EVENING + FLOOR) / (DAY + FLOOR), away(found).shape)
    np.testing.assert_allclose(away(found), expected, rtol=1e-3)
    np.testing.assert_allclose(found[:, -1], (0.5 * 2 + FLOOR) / (2 + FLOOR), rtol=1e-5)


def test_it_is_the_quotient_pixel_by_pixel() -> None:
    """Skies that brighten linearly, the new one towards -X and the captured one towards the zenith."""
    camera, way = looking((-1, 1, -0.5)), map_pixels(256)
    slopes = {"new": np.array([-0.5, 0.2, 0.0]), "old": np.array([0.0, 0.6, 0.1])}
    new, old = (dome(DAY * (1 + way @ slope)[..., None], 256) for slope in slopes.values())
    seen = unit(camera.rays()[1])
    assert seen[..., 1].min() > np.sin(np.radians(12))
    expected = ((DAY * (1 + seen @ slopes["new"])[..., None]) + FLOOR) / (
        DAY * (1 + seen @ slopes["old"])[..., None] + FLOOR
    )
    np.testing.assert_allclose(away(factor(camera, new, old)), away(expected.astype(np.float32)), rtol=0.01)


def test_a_turned_environment_turns_its_sky() -> None:
    """Bright where it faces -Z, in the map's own frame; turned a quarter to the left it is bright towards -X."""
    half = DAY * np.where(map_pixels(64)[..., 2:] < 0, 4.0, 1.0)
    towards_x, towards_z = (
        away(factor(looking(x), dome(half, rotation=90.0), dome(DAY)))[H // 2, W // 2] for x in ((-1, 1, 0), (1, 1, 0))
    )
    np.testing.assert_allclose(towards_x, (4 * DAY + FLOOR) / (DAY + FLOOR), rtol=1e-2)
    np.testing.assert_allclose(towards_z, 1, rtol=1e-2)


def test_below_the_horizon_it_is_that_of_level_ground_under_sky_and_suns() -> None:
    to_sun = unit(np.array([1.0, 1.0, 0.0]))
    sun = Sun(-to_sun, np.array([2.0, 1.5, 1.0]))
    found = away(factor(looking((0.3, -1, 0)), dome(EVENING), dome(DAY, suns=(sun,))))
    lit = (np.pi * DAY + sun.lux * to_sun[1]) / np.pi
    np.testing.assert_allclose(found, np.broadcast_to((EVENING + FLOOR) / (lit + FLOOR), found.shape), rtol=2e-3)


@pytest.mark.parametrize("seed", [0, 1])
def test_the_captured_light_itself_changes_nothing_bit_for_bit(seed: int) -> None:
    day = dome(np.random.default_rng(seed).uniform(0, 5, (64, 128, 3)))
    np.testing.assert_array_equal(away(factor(looking((1, 0.1, 0)), day, day)), 1)


def test_new_light_without_surroundings_makes_the_sky_dark() -> None:
    found = away(factor(looking((0, 1, -1)), None, dome(DAY)))
    np.testing.assert_allclose(found, np.broadcast_to(FLOOR / (DAY + FLOOR), found.shape), rtol=1e-3)
    albedo = away(factor(looking((0, 1, -1)), None, dome(DAY), replace(FOLLOWS, mode="albedo")))
    np.testing.assert_array_equal(albedo, 0)


def test_mode_albedo_adds_nothing_to_the_new_light() -> None:
    found = away(factor(looking((0, 1, -1)), dome(EVENING), dome(DAY), replace(FOLLOWS, mode="albedo")))
    np.testing.assert_allclose(found, np.broadcast_to(EVENING / (DAY + FLOOR), found.shape), rtol=1e-3)


def test_it_is_clamped_as_on_the_surface() -> None:
    found = away(factor(looking((0, 1, -1)), dome(100 * DAY), dome(DAY), replace(FOLLOWS, max_ratio=3.0)))
    np.testing.assert_array_equal(found, 3)


@pytest.mark.parametrize("lit", ["new", "old"])
def test_the_sun_of_a_panorama_leaves_no_disc(lit: str) -> None:
    """Splats show a sun as white at most; the sky beside it is neither burnt nor put out by it."""
    sunny = np.array(np.broadcast_to(DAY, (256, 512, 3)))
    row, column = 80, 300
    sunny[row : row + 2, column : column + 2] = 2e4
    towards = map_pixels(256)[row, column]
    with_sun, plain = dome(sunny, 256), dome(DAY, 256)
    pair = (with_sun, plain) if lit == "new" else (plain, with_sun)
    found = away(factor(looking(tuple(towards)), *pair))
    np.testing.assert_allclose(found, 1, rtol=0.03)


def test_splats_off_the_proxy_take_the_far_factor_up_to_its_edge() -> None:
    """And those that are told to lie on it that of the surface, however near the sky."""
    beyond = np.ones((H, W, 2), np.float32)
    beyond[H // 2 :, :, 0] = 0
    found = factor(looking((0, 1, -1)), dome(EVENING), dome(DAY), beyond=beyond)
    sky, surface = (EVENING + FLOOR) / (DAY + FLOOR), (0.5 * 2 + FLOOR) / (2 + FLOOR)
    np.testing.assert_allclose(found[: H // 2, W - 2], np.broadcast_to(sky, (H // 2, 3)), rtol=1e-3)
    np.testing.assert_allclose(found[H // 2 :, W - 2], surface, rtol=1e-3)
    number = replace(FOLLOWS, background=0.25)
    plain, told = (factor(looking((0, 1, -1)), None, dome(DAY), number, x) for x in (None, beyond))
    np.testing.assert_array_equal(plain, told)


def test_a_proxy_that_is_too_wide_takes_nothing_of_the_sky_beside_the_thing() -> None:
    """In the last column it covers, at depth 1, splats of which half lie off it: at it, a little and far behind it."""
    beyond = np.full((H, W, 2), 0.5, np.float32)
    beyond[..., 1] = np.linspace(0.5, 2, H)[:, None]
    found = factor(looking((0, 1, -1)), dome(EVENING), dome(DAY), beyond=beyond)[:, -1]
    sky, surface = (EVENING + FLOOR) / (DAY + FLOOR), (0.5 * 2 + FLOOR) / (2 + FLOOR)
    near, far = np.linspace(0.5, 2, H) < 1.1, np.linspace(0.5, 2, H) > 1.3
    np.testing.assert_allclose(found[near], surface, rtol=1e-5)
    np.testing.assert_allclose(found[far], np.broadcast_to((sky + surface) / 2, (far.sum(), 3)), rtol=1e-3)


@pytest.mark.parametrize("mode", ["ratio", "albedo"])
def test_a_number_stays_a_number(mode: RelightMode) -> None:
    settings = RelightSettings(mode=mode, background=0.25)
    np.testing.assert_array_equal(away(factor(looking((0, 1, -1)), dome(EVENING), dome(DAY), settings)), 0.25)
