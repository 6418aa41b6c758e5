"""Splats of a sky that are relit one by one, against closed forms: over a wide floor in the light of even domes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import mirelight
from mirelight.apps import bake
from mirelight.apps.mixer.layers import make
from mirelight.base.conventions import unit
from mirelight.base.sh import C0
from mirelight.lighting.sight import Sight
from mirelight.model import (
    Camera,
    Deferred,
    Environment,
    Frame,
    Job,
    Lighting,
    ProxyMesh,
    RelightSettings,
    SplatCloud,
    SunLight,
)
from mirelight.pipeline.far_splats import FarSplats
from mirelight.pipeline.keys import Keys
from mirelight.pipeline.scene import prepare
from mirelight.pipeline.splat_light import SplatLight

from .test_mixing_layers import FLOOR, JOB, LAMP
from .test_mixing_layers import SPLATS as ON_FLOOR

DAY, EVENING = np.array([0.4, 0.6, 1.0]), np.array([0.6, 0.3, 0.2])
FOLLOWS = RelightSettings(mode="ratio", background="environment", delta=0.01, per="splat")
TO_SUN = unit(np.array([1.0, 1.0, 0.5]))
SUN = SunLight(name="sun", direction=-TO_SUN, color=np.array([1.0, 0.9, 0.8]), intensity=3.0, angular_diameter=0.5)
SEEN_FROM = Camera.look_at((0, 1.6, 0), (0, 2.5, -4), 48, 32, yfov=60, name="front")
SKY = 40


def dome(radiance: np.ndarray) -> Environment:
    return Environment(radiance=np.broadcast_to(radiance.astype(np.float32), (8, 16, 3)).copy())


def cloud() -> SplatCloud:
    """Splats on the floor, and a sky of large ones high above it, all around."""
    rng = np.random.default_rng(5)
    turn, high = rng.uniform(0, 2 * np.pi, SKY), rng.uniform(20, 70, SKY)
    sky = np.stack([60 * np.cos(turn), high, 60 * np.sin(turn)], axis=1)
    own, n = ON_FLOOR, len(ON_FLOOR) - 1

    def joined(on_floor: np.ndarray, of_sky: np.ndarray) -> np.ndarray:
        return np.concatenate([on_floor[:n], np.broadcast_to(of_sky, (SKY, *on_floor.shape[1:]))]).astype(np.float32)

    return SplatCloud(
        means=joined(own.means, sky),
        quats=joined(own.quats, own.quats[:1]),
        scales=joined(own.scales, np.full((1, 3), 12.0)),
        opacities=joined(own.opacities, np.array([0.95])),
        sh=joined(own.sh, own.sh[:1]),
    )


SPLATS = cloud()
LEVEL = float(DAY @ [0.2126, 0.7152, 0.0722])  # of the captured light: a floor under an even sky of that radiance
FLOOR_OF_RATIO = FOLLOWS.delta * LEVEL


def job(*lightings: Lighting, captured: Lighting | None = None, settings: RelightSettings = FOLLOWS) -> Job:
    return replace(
        JOB,
        splats=Deferred.of(SPLATS),
        proxy=Deferred.of(FLOOR),
        cameras=(SEEN_FROM,),
        capture_cameras=(SEEN_FROM,),
        lightings=lightings,
        captured=captured or Lighting(name="captured", environment=dome(DAY)),
        relight=settings,
    )


def factors(of: Job) -> np.ndarray:
    return SplatLight(prepare(of), 64).factor(of.lightings[0])


def quotient(new: np.ndarray, old: np.ndarray) -> np.ndarray:
    return (new + FLOOR_OF_RATIO) / (old + FLOOR_OF_RATIO)


def test_sky_takes_the_quotient_of_both_skies_and_a_sun_changes_the_floor_alone() -> None:
    new = Lighting(name="evening", lights=(SUN,), environment=dome(EVENING))
    found = factors(job(new))
    wanted = np.broadcast_to(quotient(EVENING, DAY), (SKY, 3))
    np.testing.assert_allclose(found[-SKY:], wanted, rtol=2e-3)
    lit = EVENING + SUN.color * SUN.intensity * TO_SUN[1] / np.pi
    np.testing.assert_allclose(found[:-SKY].mean(axis=0), quotient(lit, DAY), rtol=5e-3)


def test_a_sky_that_is_brighter_on_one_side_is_so_on_its_splats() -> None:
    """Seen from where the capture was taken, not from the world's origin."""
    rows = 64
    bright = np.tile(EVENING.astype(np.float32), (rows, 2 * rows, 1))
    bright[:, :rows] *= 4  # columns that look to -Z
    found = factors(job(Lighting(name="one side", environment=Environment(radiance=bright))))[-SKY:]
    way = unit(SPLATS.means[-SKY:].astype(np.float64) - SEEN_FROM.position)
    clear = np.abs(way[:, 2]) > 0.2
    assert clear.sum() > SKY / 2
    wanted = quotient(EVENING * np.where(way[:, 2:] < 0, 4.0, 1.0), DAY)
    np.testing.assert_allclose(found[clear], wanted[clear], rtol=0.02)


def test_captured_light_changes_nothing() -> None:
    day = Lighting(name="day", environment=dome(DAY))
    np.testing.assert_allclose(factors(job(day)), 1, rtol=1e-4)


def test_a_lamp_alone_makes_the_sky_dark() -> None:
    found = factors(job(Lighting(name="night", lights=(LAMP,))))[-SKY:]
    np.testing.assert_allclose(found, np.broadcast_to(quotient(0 * DAY, DAY), found.shape), rtol=2e-3)


def test_without_the_setting_splats_of_the_sky_take_the_nearest_place() -> None:
    new = Lighting(name="night", lights=(LAMP,))
    number = replace(FOLLOWS, background=1.0)
    found = factors(job(new, settings=number))
    own = job(new)
    follows = replace(own, lightings=(replace(new, relight=number),))
    np.testing.assert_array_equal(factors(follows), found)
    np.testing.assert_array_equal(factors(own)[:-SKY], found[:-SKY])
    assert (factors(own)[-SKY:] < 0.5 * found[-SKY:]).mean() > 0.5


def test_layers_of_the_mixer_and_baked_splats_have_the_same_sky() -> None:
    new = Lighting(name="evening", lights=(LAMP,), environment=dome(EVENING))
    asked = job(new)
    wanted = factors(asked)
    layers = make(prepare(asked), spp=64, lightings=asked.lightings)
    np.testing.assert_allclose(layers.factor(layers.weights(0)), wanted, rtol=1e-4)
    np.testing.assert_array_equal(bake.factors(prepare(asked), new, spp=64), wanted)


def test_a_frame_by_splats_has_the_sky_of_one_by_pixels() -> None:
    new = Lighting(name="evening", environment=dome(EVENING))

    def frame(settings: RelightSettings) -> Frame:
        scene = prepare(job(new, settings=settings))
        lit = mirelight.light(scene, SEEN_FROM, new)
        return mirelight.relight(scene, mirelight.composite(scene, SEEN_FROM), lit)

    by_splats, by_pixels = frame(FOLLOWS), frame(replace(FOLLOWS, per="pixel"))
    sky = np.arange(SEEN_FROM.height) < 6
    assert by_splats.unlit is not None and by_splats.unlit[sky, :, 3].mean() > 0.5
    np.testing.assert_allclose(by_splats.rgba[sky], by_pixels.rgba[sky], atol=0.01)


@pytest.mark.parametrize("change", ["cameras of the capture", "the setting"])
def test_a_frames_key_knows_what_its_sky_is_read_from(change: str) -> None:
    new = Lighting(name="evening", environment=dome(EVENING))
    own = job(new)
    moved = replace(own, capture_cameras=(replace(SEEN_FROM, name="other").resized(24, 16),))
    other = moved if change == "cameras of the capture" else job(new, settings=replace(FOLLOWS, background=1.0))
    assert Keys(own).frame(SEEN_FROM, new) != Keys(other).frame(SEEN_FROM, new)


def test_white_splats_in_the_windows_of_a_room_are_sky_however_near_they_hang() -> None:
    """Walls on three sides of the eye; splats where the fourth would be, white and gray, and a white one on a wall."""
    wall = np.array([[-2, 0, -2], [2, 0, -2], [2, 3, -2], [-2, 3, -2]], np.float32)
    turned = [wall @ np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]], np.float32) for c, s in ((1, 0), (0, 1), (0, -1))]
    faces = np.concatenate([np.array([[0, 1, 2], [0, 2, 3]]) + 4 * k for k in range(3)]).astype(np.int32)
    room = ProxyMesh(vertices=np.concatenate(turned).astype(np.float32), faces=faces)
    shown = np.array([1.0, 0.6, 1.0], np.float32)
    splats = SplatCloud(
        means=np.array([[0.3, 1.5, 1.99], [-0.3, 1.5, 1.99], [0, 1.5, -1.99]], np.float32),
        quats=np.tile(np.array([1, 0, 0, 0], np.float32), (3, 1)),
        scales=np.full((3, 3), 0.05, np.float32),
        opacities=np.full(3, 0.9, np.float32),
        sh=((shown - 0.5) / np.float32(C0))[:, None, None].repeat(3, axis=2),
    )
    eye = Camera.look_at((0, 1.5, 0), (0, 1.5, 1), 8, 8, yfov=60)
    on_proxy, far = np.full((3, 3), 5, np.float32), np.full((128, 256, 3), 0.25, np.float32)
    seen = FarSplats(splats, np.zeros(3, np.float32), [eye], Sight(room)).on(on_proxy, far)
    np.testing.assert_allclose(seen[:, 0], [0.25, 5, 5], rtol=1e-5)
    np.testing.assert_array_equal(FarSplats(splats, np.zeros(3, np.float32), [eye]).on(on_proxy, far), on_proxy)
