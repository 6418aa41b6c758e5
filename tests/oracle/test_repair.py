"""Captured light as the picture shows it: shadows that end elsewhere on the proxy, and what was captured past white."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from mirelight import dataset, relighting
from mirelight.base import colour, sh
from mirelight.batch import executor
from mirelight.compositor import Compositor
from mirelight.model import (
    Camera,
    Deferred,
    DirectionalLight,
    Environment,
    Job,
    Lighting,
    LightingBuffer,
    LightLayer,
    OutputSettings,
    ProxyMesh,
    RelightSettings,
    RenderSettings,
    SplatCloud,
)
from mirelight.pipeline import stages
from mirelight.pipeline.plan import plan
from mirelight.pipeline.scene import prepare
from mirelight.relighting import repair
from mirelight.store import Store

F32 = NDArray[np.float32]
ROWS, EDGE = slice(24, 84), slice(81, 111)
RATIO = RelightSettings(mode="ratio", delta=1e-4)
SUN = DirectionalLight(name="sun", direction=np.array([0.6, -0.8, 0.0]), intensity=6.0)
FILL = DirectionalLight(name="fill", direction=np.array([0.0, -1.0, 0.0]), intensity=1.5)
NEW = 4.0  # lux straight from above
EYE = Camera.look_at((0, 3, 0.01), (0, 0, 0), 192, 144, yfov=35, name="above")
PLAIN, PAINT = 0.4, 0.12  # albedo of the floor, and of a stripe that is painted on it


def along(x: float) -> ProxyMesh:
    """A floor, and a roof that shades it up to x."""
    corners: list[list[float]] = [[-2, 0, 2], [2, 0, 2], [2, 0, -2], [-2, 0, -2]]
    corners += [[-9, 5, 2], [x - 3.75, 5, 2], [x - 3.75, 5, -2], [-9, 5, -2]]
    faces = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]], np.int32)
    return ProxyMesh(vertices=np.array(corners, np.float32), faces=faces, albedo=np.full(3, 0.5))


def floor() -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """(N, 3) places of splats, (N,) their albedo, (N,) captured irradiance: the shadow ends at x = 0."""
    x, z = (a.ravel() for a in np.meshgrid(np.arange(-1.55, 1.6, 0.1), np.arange(-1.5, 1.6, 0.1)))
    albedo = np.where(np.abs(z - 0.5) < 0.12, PAINT, PLAIN)
    return np.stack([x, 0 * x, z], axis=1), albedo, FILL.intensity + np.where(x > 0, 0.8 * SUN.intensity, 0)


def cloud(shown: NDArray[np.float64]) -> SplatCloud:
    """The floor's splats in a linear gray."""
    at, _, _ = floor()
    display = colour.srgb_encode(np.clip(shown, 0, 1).astype(np.float32))
    fields: dict[str, Any] = {
        "means": at,
        "quats": np.tile([1.0, 0, 0, 0], (len(at), 1)),
        "scales": np.tile([0.07, 0.001, 0.07], (len(at), 1)),
        "opacities": np.full(len(at), 0.95),
        "sh": np.repeat((display[:, None, None] - 0.5) / sh.C0, 3, axis=2),
    }
    return SplatCloud(**fields)


def job(relight: RelightSettings, edge: float = 0.0) -> Job:
    """The roof of the proxy reaches that much farther than the capture's."""
    _, albedo, light = floor()
    return Job(
        source=Path("floor.toml"),
        splats=Deferred.of(cloud(albedo * light / np.pi)),
        proxy=Deferred.of(along(edge)),
        cameras=(EYE,),
        lightings=(Lighting(name="noon", lights=(replace(FILL, name="noon", intensity=NEW),)),),
        captured=Lighting(name="captured", lights=(SUN, FILL)),
        render=RenderSettings(spp=16, max_depth=1),
        relight=relight,
    )


def rms(a: NDArray[np.float32], b: NDArray[np.float32], rows: slice, columns: slice) -> float:
    return float(np.sqrt(np.mean((a - b)[rows, columns] ** 2)))


WIDTH, HEIGHT = 200, 40


def frame(settings: RelightSettings, edge: float) -> F32:
    made = job(settings, edge)
    return stages.frame(prepare(made), EYE, made.lightings[0]).rgba[..., :3]


@pytest.mark.parametrize("edge", [0.0, 0.04, -0.04])
def test_nothing_is_left_of_a_shadow_that_ends_elsewhere_on_the_proxy(edge: float) -> None:
    """The roof reaches 3 pixels too far, or not far enough, or just as far while splats fade."""
    _, albedo, _ = floor()
    truth = relighting.unlit_rgba(Compositor(cloud(albedo * NEW / np.pi)).composite(EYE))[..., :3]
    plain, repaired = (rms(frame(replace(RATIO, repair=x), edge), truth, ROWS, EDGE) for x in (False, True))
    assert plain > 0.05
    assert repaired < 0.7 * plain


def test_the_setting_changes_the_key_of_a_frame_and_only_where_light_is_compared() -> None:
    def key(settings: RelightSettings) -> str:
        scene = prepare(job(settings))
        return scene.keys.frame(EYE, scene.job.lightings[0])

    assert key(RATIO) != key(replace(RATIO, repair=False))
    tint = RelightSettings(mode="tint")
    assert key(tint) == key(replace(tint, repair=False))


def test_a_data_set_mixes_what_render_made(tmp_path: Path) -> None:
    made = replace(job(RATIO, 0.04), output=OutputSettings(directory=tmp_path, store="both", png=False))
    store = Store(made)
    store.open()
    executor.run(plan(made), store)
    frame = stages.frame(prepare(made, store.artefacts), EYE, made.lightings[0])
    store.close()
    np.testing.assert_array_equal(dataset.open(tmp_path)[0].rgba, frame.rgba)


# --- pictures made by hand -------------------------------------------------------------------------------------------


def buffer(light: F32, albedo: float = 0.5) -> LightingBuffer:
    """A wall that faces the eye, lit by so much (H, W, 3), irradiance / pi."""
    shown, one = np.asarray(light * albedo, np.float32), np.ones((HEIGHT, WIDTH), np.float32)
    front = np.broadcast_to(np.array([0, 0, 1], np.float32), shown.shape)
    return LightingBuffer(
        camera=Camera.look_at((0, 0, 3), (0, 0, 0), WIDTH, HEIGHT),
        coverage=one,
        layers=(LightLayer(name="all", direct=shown, indirect=0 * shown),),
        depth=3 * one,
        position=front,
        normal=front,
        geometric_normal=front,
        albedo=np.full_like(shown, albedo),
    )


def wall(sun_from: int, strength: float) -> tuple[F32, F32]:
    """(H, W, 3) light of 0.2 from all around, and that of a sun which falls from a column on."""
    sun = np.zeros((HEIGHT, WIDTH, 3), np.float32)
    sun[:, sun_from:] = strength
    return np.full_like(sun, 0.2), sun


def paint() -> F32:
    """(H, W, 3) an albedo with a fine pattern."""
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    return np.asarray(np.stack([0.5 + 0.1 * ((rows // 2 + columns // 3) % 2)] * 3, -1) * [0.9, 0.7, 0.4], np.float32)


def picture(light: F32) -> F32:
    """(H, W, 4) what a camera shows of the wall: it ends at white."""
    return np.concatenate([np.minimum(paint() * light, 1), np.ones((HEIGHT, WIDTH, 1))], -1).astype(np.float32)


def sun_of(direct: F32, strength: float) -> relighting.Sun:
    return relighting.Sun(0.5 * direct, np.array([0, 0, -1], np.float32), np.full(3, strength, np.float32))


def test_a_shadow_takes_its_place_from_the_picture() -> None:
    sky, true = wall(100, 1.0)
    _, traced = wall(102, 1.0)
    before = buffer(sky + traced)
    made = relighting.repaired(before, sun_of(traced, 1.0), picture(sky + true))
    light = made.beauty / 0.5
    np.testing.assert_allclose(light[:, 100:102].mean(), 1.2, rtol=0.25)
    np.testing.assert_allclose(light[:, 98:100].mean(), 0.2, rtol=0.15)
    np.testing.assert_array_equal(made.beauty[:, 120:], before.beauty[:, 120:])


def test_what_ends_at_white_is_told_by_the_same_paint_in_less_light() -> None:
    """The captured light is held down as the picture is, channel by channel; the picture over it is the albedo."""
    sky, sun = wall(150, 4.0)
    shown = picture(sky + sun)
    made = relighting.repaired(buffer(sky + sun), sun_of(sun, 4.0), shown)
    found, plain = shown[..., :3] / (made.beauty / 0.5), shown[..., :3] / (sky + sun)
    inside = slice(5, -5), slice(156, 170)
    true = paint()[inside]
    assert (plain[inside][..., 0] < 0.6 * true[..., 0]).all()
    np.testing.assert_allclose(found[inside].mean((0, 1)), true.mean((0, 1)), rtol=0.06)
    assert np.sqrt(np.mean((found[inside] - true) ** 2)) < 0.06


def test_where_nothing_is_in_doubt_not_one_bit_changes() -> None:
    sky, _ = wall(30, 0)
    before = buffer(sky)
    for sun in (None, sun_of(0 * sky, 1.0)):
        np.testing.assert_array_equal(relighting.repaired(before, sun, picture(sky)).beauty, before.beauty)


def test_large_pictures_are_asked_at_a_smaller_size(monkeypatch: pytest.MonkeyPatch) -> None:
    sky, true = wall(100, 1.0)
    _, traced = wall(103, 1.0)
    shown, before, sun = picture(sky + true), buffer(sky + traced), sun_of(traced, 1.0)
    monkeypatch.setattr(repair, "_MOST", WIDTH // 2)
    light = relighting.repaired(before, sun, shown).beauty / 0.5
    np.testing.assert_allclose(light[:, 101:103].mean(), 1.2, rtol=0.25)


def test_a_sun_of_another_size_is_refused() -> None:
    sky, _ = wall(30, 0)
    wrong = relighting.Sun(np.ones((3, 4, 3), np.float32), np.array([0, 0, -1], np.float32), np.ones(3, np.float32))
    with pytest.raises(ValueError, match="its sun"):
        relighting.repaired(buffer(sky), wrong, picture(sky))


def test_a_capture_without_lamps_is_relit_as_before() -> None:
    sky = Lighting(name="sky", environment=Environment(radiance=np.ones((1, 1, 3), np.float32)))
    made = [replace(job(replace(RATIO, repair=x)), captured=sky) for x in (False, True)]
    plain, repaired = (stages.frame(prepare(x), EYE, x.lightings[0]).rgba for x in made)
    dim = colour.srgb_encode(plain[..., :3]).max(-1) < 0.9
    np.testing.assert_array_equal(plain[dim], repaired[dim])
