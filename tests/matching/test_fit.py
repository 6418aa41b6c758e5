"""Lights found again from frames that they made: a ball over a floor under two lamps and a sky."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mirelight.apps.match import Match, Target, match
from mirelight.base.errors import InputError
from mirelight.model import (
    F32,
    Camera,
    Deferred,
    Environment,
    Job,
    LayerFactor,
    Lighting,
    PointLight,
    ProxyMesh,
    RelightSettings,
    RenderSettings,
    SplatCloud,
    digest,
)
from mirelight.pipeline import stages
from mirelight.pipeline.scene import Scene, prepare

CAMERA = Camera.look_at([0, 3, 6], [0, 0, 0], 64, 48, name="front")


def panorama() -> F32:
    """Brighter to one side, so that its rotation shows."""
    sky = np.full((16, 32, 3), 0.05, np.float32)
    sky[3:8, 4:9] = (6, 5, 4)
    return sky


def splats() -> SplatCloud:
    """Flat discs on the floor."""
    x, z = (a.ravel() for a in np.meshgrid(np.linspace(-2.9, 2.9, 40), np.linspace(-2.9, 2.9, 40)))
    n = len(x)
    return SplatCloud(
        means=np.stack([x, np.full(n, -1.0), z], axis=1).astype(np.float32),
        quats=np.tile(np.array([1, 0, 0, 0], np.float32), (n, 1)),
        scales=np.tile(np.array([0.1, 0.002, 0.1], np.float32), (n, 1)),
        opacities=np.full(n, 0.95, np.float32),
        sh=np.random.default_rng(0).normal(scale=0.4, size=(n, 1, 3)).astype(np.float32),
    )


def proxy() -> ProxyMesh:
    """The floor, and a wall that throws a shadow."""
    floor = [[-3, -1, -3], [3, -1, -3], [3, -1, 3], [-3, -1, 3]]
    wall = [[-1, -1, -0.5], [1, -1, -0.5], [1, 0.5, -0.5], [-1, 0.5, -0.5]]
    return ProxyMesh(
        vertices=np.array(floor + wall, np.float32),
        faces=np.array([[0, 2, 1], [0, 3, 2], [4, 6, 5], [4, 7, 6]], np.int32),
    )


def lamp(
    name: str, position: tuple[float, float, float], color: tuple[float, float, float], intensity: float, **more: str
) -> PointLight:
    return PointLight(name=name, position=np.array(position), color=np.array(color), intensity=intensity, **more)  # type: ignore[arg-type]


TRUE = Lighting(
    name="true",
    lights=(
        lamp("left", (-2, 1.5, 1.0), (1, 0.5, 0.2), 8.0),
        lamp("right", (2, 1.0, -1.5), (0.3, 0.6, 1), 5.0),
        lamp("a", (0, 2.0, 2.0), (1, 1, 1), 2.0, group="row"),
        lamp("b", (1, 2.0, 2.0), (1, 0.5, 1), 1.0, group="row"),
    ),
    environment=Environment(radiance=panorama(), intensity=0.8, rotation=40.0),
    mix=(LayerFactor(layer="environment", factor=np.array([1, 0.5, 0.8])),),
)
START = replace(
    TRUE,
    name="start",
    mix=(LayerFactor(layer="left", factor=np.full(3, 9.0)),),
    lights=(
        lamp("left", (-2, 1.5, 1.0), (1, 1, 1), 1.0),
        lamp("right", (2, 1.0, -1.5), (1, 0, 0), 0.0),
        lamp("a", (0, 2.0, 2.0), (1, 1, 1), 4.0, group="row"),
        lamp("b", (1, 2.0, 2.0), (1, 0.5, 1), 2.0, group="row"),
    ),
    environment=Environment(radiance=panorama(), intensity=3.0, rotation=40.0),
)
CAPTURED = Lighting(name="captured", environment=Environment(radiance=np.ones((1, 1, 3), np.float32)))


def job(**relight: object) -> Job:
    cloud, mesh = splats(), proxy()
    return Job(
        source=Path("test.toml"),
        splats=Deferred(digest("splats"), lambda: cloud),
        proxy=Deferred(digest("proxy"), lambda: mesh),
        cameras=(CAMERA,),
        lightings=(START,),
        captured=CAPTURED,
        render=RenderSettings(spp=32, max_depth=3),
        relight=RelightSettings(**{"mode": "ratio", **relight}),  # type: ignore[arg-type]
    )


@pytest.fixture(scope="module")
def scene() -> Scene:
    return prepare(job())


def picture(scene: Scene, lighting: Lighting = TRUE) -> F32:
    return stages.frame(scene, CAMERA, lighting).rgba[..., :3]


@pytest.fixture(scope="module")
def true(scene: Scene) -> F32:
    return picture(scene)


def target(values: F32, mask: F32 | None = None) -> Target:
    counts = np.ones(values.shape[:2], np.float32) if mask is None else mask
    return Target(path=Path("target.exr"), values=values, linear=True, mask=counts)


def weights(lighting: Lighting) -> np.ndarray:
    lights = [x.color * x.intensity for x in lighting.lights]
    assert lighting.environment is not None
    factor = lighting.factors().get("environment", np.ones(3))
    return np.array([*lights, lighting.environment.intensity * factor])


def test_lights_are_found_from_their_own_frame(scene: Scene, true: F32) -> None:
    found = match(scene, [(CAMERA, target(true))], START)
    np.testing.assert_allclose(weights(found.lighting), weights(TRUE), rtol=0.01, atol=0.01)
    assert found.psnr_after > 60 > found.psnr_before
    assert [x.name for x in found.layers] == ["left", "right", "row", "environment"]
    assert all(x.seen for x in found.layers)


def test_what_is_found_in_its_own_frame_is_known(scene: Scene, true: F32) -> None:
    for layer in match(scene, [(CAMERA, target(true))], START).layers:
        assert (layer.relative_uncertainty < 0.05).all(), layer.name


def test_faint_light_is_found_in_a_picture_without_the_ratios_floor(scene: Scene) -> None:
    """Where no light falls, a ratio leaves a little of the captured light; no other picture has that."""
    bare, faint = prepare(job(delta=0.0)), replace(TRUE, mix=(LayerFactor(layer="row", factor=np.full(3, 0.02)),))
    found = match(scene, [(CAMERA, target(picture(bare, faint)))], START)
    row = next(x for x in found.layers if x.name == "row")
    np.testing.assert_allclose(row.after, 0.02 * np.array([1, 1, 1]) / 2, rtol=0.1)


def test_lights_are_found_in_the_mode_tint(true: F32) -> None:
    tint = prepare(job(mode="tint"))
    found = match(tint, [(CAMERA, target(picture(tint)))], START)
    np.testing.assert_allclose(weights(found.lighting), weights(TRUE), rtol=0.01, atol=0.01)


def test_splats_past_the_proxy_tell_of_the_sky_that_they_follow() -> None:
    """All but a corner of the floor has no mesh beneath it, and follows the environment alone."""
    mesh = proxy()
    corner = replace(mesh, vertices=np.where(mesh.vertices > 0, -1, mesh.vertices).astype(np.float32))
    scene = prepare(replace(job(background="environment"), proxy=Deferred(digest("corner"), lambda: corner)))
    true = picture(scene)
    assert np.abs(true - picture(prepare(replace(scene.job, relight=job().relight)))).max() > 0.1
    found = match(scene, [(CAMERA, target(true))], START)
    np.testing.assert_allclose(weights(found.lighting)[-1], weights(TRUE)[-1], rtol=0.01)


def test_a_painted_corner_is_masked_out(scene: Scene, true: F32) -> None:
    painted, mask = true.copy(), np.ones(true.shape[:2], np.float32)
    painted[:24, :40] = (3, 0, 0)
    mask[:24, :40] = 0
    found = match(scene, [(CAMERA, target(painted, mask))], START)
    np.testing.assert_allclose(weights(found.lighting), weights(TRUE), rtol=0.02, atol=0.02)


def test_other_lights_stay(scene: Scene) -> None:
    only = replace(START, mix=(), lights=(replace(START.lights[0], intensity=6.0), *START.lights[1:]))
    found = match(scene, [(CAMERA, target(picture(scene, only)))], START, free=["left"])
    np.testing.assert_allclose(weights(found.lighting), weights(only), rtol=0.01, atol=0.01)
    assert [x.fixed for x in found.layers] == [False, True, True, True]


def test_intensities_alone_are_found_and_colours_stay(scene: Scene, true: F32) -> None:
    """A light that is off has a colour, too; and one that has no blue gets none."""
    yellow = lamp("yellow", (0, 1.0, -2.0), (1, 0.8, 0.0), 6.0)
    lit = replace(TRUE, lights=(*TRUE.lights, yellow))
    start = replace(
        lit,
        lights=(
            replace(lit.lights[0], intensity=0.0),
            replace(lit.lights[1], intensity=50.0),
            *lit.lights[2:4],
            replace(yellow, intensity=0.1),
        ),
        mix=(*lit.mix, LayerFactor(layer="right", factor=np.zeros(3))),
    )
    found = match(scene, [(CAMERA, target(picture(scene, lit)))], start, keep_colours=True)
    np.testing.assert_allclose(weights(found.lighting), weights(lit), rtol=0.01, atol=1e-6)
    assert all(x.keeps_colour and x.seen and (x.relative_uncertainty < 0.05).all() for x in found.layers)


def test_one_factor_is_the_best_for_all_channels(scene: Scene, true: F32) -> None:
    """Colours that are wrong stay wrong, and the intensity makes the best of them."""
    wrong = replace(
        TRUE, lights=(replace(TRUE.lights[0], color=np.array([0.9, 0.6, 0.2]), intensity=3.0), *TRUE.lights[1:])
    )
    shots = [(CAMERA, target(true))]
    found = match(scene, shots, wrong, free=["left"], keep_colours=True)
    left = found.lighting.lights[0]
    np.testing.assert_array_equal(left.color, wrong.lights[0].color)
    asked = TRUE.lights[0].color * 8 / left.color  # by each channel
    assert asked.min() < left.intensity < asked.max()
    assert found.psnr_before < found.psnr_after < match(scene, shots, wrong, free=["left"]).psnr_after


def test_a_light_that_the_picture_does_not_show_stays(scene: Scene) -> None:
    below = lamp("below", (0, -5, 0), (1, 1, 1), 7.0)  # under the floor, which is seen from above
    found = match(scene, [(CAMERA, target(picture(scene)))], replace(START, lights=(*START.lights, below)))
    assert [x.name for x in found.layers if not x.seen] == ["below"]
    assert found.lighting.lights[-1].intensity == 7.0


def test_a_second_picture_shows_what_the_first_does_not(scene: Scene) -> None:
    below = lamp("below", (0, -5, 0), (1, 0.5, 0.2), 7.0)
    under = Camera.look_at([0, -6, 4], [0, -1, 0], 64, 48, name="under")
    lit = replace(TRUE, lights=(*TRUE.lights, below))
    shots = [(x, target(stages.frame(scene, x, lit).rgba[..., :3])) for x in (CAMERA, under)]
    unknown = lamp("below", (0, -5, 0), (1, 1, 1), 1.0)
    found = match(scene, shots, replace(START, lights=(*START.lights, unknown)))
    assert all(x.seen for x in found.layers)
    np.testing.assert_allclose(weights(found.lighting), weights(lit), rtol=0.01, atol=0.01)


def test_the_environments_rotation_is_found(true: F32) -> None:
    sky = prepare(replace(job(), render=RenderSettings(spp=16, max_depth=2)))
    alone = Lighting(name="sky", environment=TRUE.environment)
    assert alone.environment is not None
    start = replace(alone, environment=replace(alone.environment, rotation=-100.0, intensity=1.0))
    found = match(sky, [(CAMERA, target(picture(sky, alone)))], start, rotate=True)
    assert found.rotation == pytest.approx(40, abs=1)
    assert found.lighting.environment is not None
    assert found.lighting.environment.intensity == pytest.approx(0.8, rel=0.02)


def test_the_same_numbers_again(scene: Scene, true: F32) -> None:
    first: Match = match(scene, [(CAMERA, target(true))], START)
    again = match(scene, [(CAMERA, target(true))], START)
    np.testing.assert_array_equal(weights(first.lighting), weights(again.lighting))


def test_what_cannot_be_matched_is_refused(scene: Scene, true: F32) -> None:
    with pytest.raises(InputError, match="no light named 'key'"):
        match(scene, [(CAMERA, target(true))], START, free=["key"])
    with pytest.raises(InputError, match="leave out --rotate"):
        match(scene, [(CAMERA, target(true))], CAPTURED, rotate=True)
    noisy = prepare(replace(job(), render=RenderSettings(spp=16, noise=0.1)))
    with pytest.raises(InputError, match=r"render\.noise"):
        match(noisy, [(CAMERA, target(true))], START)


def test_a_picture_of_another_shape_is_refused_before_anything_is_traced(scene: Scene, true: F32) -> None:
    said: list[str] = []
    with pytest.raises(InputError, match="64 x 24 pixels, a shape"):
        shots = [(CAMERA, target(true)), (CAMERA, target(true[:24]))]
        match(scene, shots, START, report=lambda what, done: said.append(what))
    assert not said
