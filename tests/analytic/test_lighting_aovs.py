"""Sun visibility and ambient occlusion against closed forms, and what is left out when nobody asks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mirelight.lighting import Tracer
from mirelight.model import (
    Camera,
    DirectionalLight,
    Lighting,
    LightingBuffer,
    PointLight,
    ProxyMesh,
    RenderSettings,
    SunLight,
)

from .lighting_scenes import FLOOR, Array, constant_sky, floor_mean, join, overhead, quad

WALL = quad([0, 1.5, -2], [40, 0, 0], [0, 1.5, 0])  # 3 high, at z = -2, as good as endless
ROOF = quad([0, 2, 0], [1, 0, 0], [0, 0, 1])  # 2 above the floor
DOWN = np.array([0.0, -1, 0])
NOON = DirectionalLight(name="noon", direction=DOWN, intensity=2.0)


def traced(proxy: ProxyMesh, camera: Camera, lighting: Lighting, **settings: object) -> LightingBuffer:
    return Tracer(proxy, RenderSettings(**settings)).trace(lighting, camera)  # type: ignore[arg-type]


def aside(width: int, height: int, extent: float) -> Camera:
    """From above, but over the half of the floor that neither wall nor roof hides."""
    camera = overhead(width, height, extent=extent)
    return replace(camera, near=98.5)  # starts below the roof and inside the wall's height


# --- ambient occlusion -----------------------------------------------------------------------------------------------


def test_occlusion_before_a_wall_is_its_form_factor() -> None:
    """A point at distance d from an endless wall of height h loses (1 - d / sqrt(d² + h²)) / 2 of its hemisphere."""
    camera = overhead(4, 32, extent=0.5)
    buffer = traced(join(FLOOR, WALL), camera, Lighting(), spp=1024, max_depth=1, ao_distance=1e4)
    assert buffer.ambient_occlusion is not None

    def free(points: Array) -> Array:
        d = points[..., 2] + 2
        return np.asarray(1 - (1 - d / np.hypot(d, 3)) / 2)

    assert buffer.ambient_occlusion.mean(axis=1) == pytest.approx(floor_mean(camera, free).mean(axis=1), abs=0.01)


def test_occlusion_looks_no_farther_than_its_distance() -> None:
    camera = overhead(4, 4, extent=0.5)  # two units from the wall
    world = join(FLOOR, WALL)
    near = traced(world, camera, Lighting(), spp=64, ao_distance=1.7).ambient_occlusion
    far = traced(world, camera, Lighting(), spp=64, ao_distance=3.0).ambient_occlusion
    assert near is not None and far is not None
    assert np.array_equal(near, np.ones((4, 4), np.float32)) and 0.8 < far.mean() < 0.98
    default = traced(world, camera, Lighting(), spp=64).ambient_occlusion  # a tenth of a diagonal of about 140
    reached = traced(world, camera, Lighting(), spp=64, ao_distance=14.15).ambient_occlusion
    assert default is not None and reached is not None
    assert default.mean() == pytest.approx(reached.mean(), abs=0.002)


@pytest.mark.parametrize(("depth", "albedo", "lit"), [(1, 0.5, False), (1, 0.5, True), (8, 0.0, True), (8, 0.9, False)])
def test_occlusion_does_not_depend_on_light_albedo_or_bounces(depth: int, albedo: float, lit: bool) -> None:
    camera = overhead(6, 6, extent=1.0)
    world = replace(join(FLOOR, WALL), albedo=np.full(3, albedo))
    lighting = Lighting(lights=(NOON,), environment=constant_sky(1.0)) if lit else Lighting()
    found = traced(world, camera, lighting, spp=64, max_depth=depth, ao_distance=50.0).ambient_occlusion
    expected = traced(join(FLOOR, WALL), camera, Lighting(), spp=64, ao_distance=50.0).ambient_occlusion
    assert found is not None and expected is not None and np.array_equal(found, expected)


# --- sun visibility --------------------------------------------------------------------------------------------------


def test_visibility_under_a_roof_is_0_and_beside_it_1() -> None:
    camera = aside(16, 4, 4.0)
    found = traced(join(FLOOR, ROOF), camera, Lighting(lights=(NOON,)), spp=16).sun_visibility
    assert found is not None
    assert not found[:, 4:12].any() and np.array_equal(found[:, :4], np.ones((4, 4), np.float32))


def test_visibility_in_a_penumbra_is_the_direct_light_over_the_unshadowed() -> None:
    sun = SunLight(name="sun", direction=DOWN, intensity=2.0, angular_diameter=20.0)
    camera = aside(32, 4, 4.0)
    shadowed = traced(join(FLOOR, ROOF), camera, Lighting(lights=(sun,)), spp=64, max_depth=1)
    free = traced(FLOOR, camera, Lighting(lights=(sun,)), spp=64, max_depth=1)
    assert shadowed.sun_visibility is not None
    share = shadowed.layers[0].direct[..., 0] / free.layers[0].direct[..., 0]
    assert np.ptp(share) == 1
    np.testing.assert_allclose(shadowed.sun_visibility, share, atol=0.02)  # cos varies by 1.5 % over the disc


def test_several_suns_count_by_illuminance() -> None:
    slant = DirectionalLight(name="slant", direction=np.array([1.0, -1, 0]), intensity=6.0)
    lamp = PointLight(name="lamp", position=np.array([0.0, 1, 0]))
    camera = aside(40, 2, 10.0)
    found = traced(join(FLOOR, ROOF), camera, Lighting(lights=(NOON, lamp, slant)), spp=4).sun_visibility
    assert found is not None
    x = (np.arange(40) + 0.5) / 4 - 5
    noon, slanted = np.abs(x) > 1, (x < 1) | (x > 3)
    assert found[0] == pytest.approx(0.25 * noon + 0.75 * slanted, abs=1e-5)


def test_visibility_among_more_lights_than_are_sampled_is_right_on_average() -> None:
    rng = np.random.default_rng(3)
    lamps = tuple(
        PointLight(name=str(k), position=rng.uniform([-3, 0.5, -3], [3, 1.5, 3]), intensity=0.2) for k in range(30)
    )
    found = traced(join(FLOOR, ROOF), aside(32, 8, 4.0), Lighting(lights=(*lamps, NOON)), spp=256).sun_visibility
    assert found is not None
    assert not found[:, 8:24].any() and found[:, :8].mean() == pytest.approx(1, abs=0.01)


# --- only what is asked for ------------------------------------------------------------------------------------------


def test_without_a_sun_there_is_no_visibility_and_without_asking_no_aov() -> None:
    camera = overhead(4, 4, extent=1.0)
    lamp = PointLight(name="lamp", position=np.array([0.0, 1, 0]))
    assert traced(FLOOR, camera, Lighting(lights=(lamp,)), spp=4).sun_visibility is None
    plain = Tracer(FLOOR, RenderSettings(spp=4), aovs=False).trace(Lighting(lights=(NOON,)), camera)
    assert plain.sun_visibility is None and plain.ambient_occlusion is None


def test_the_picture_is_the_same_with_and_without_aovs() -> None:
    camera = aside(24, 16, 4.0)
    lighting = Lighting(lights=(NOON,), environment=constant_sky(0.3))
    world = join(FLOOR, ROOF)
    bare = Tracer(world, RenderSettings(spp=8), aovs=False).trace(lighting, camera)
    full = Tracer(world, RenderSettings(spp=8)).trace(lighting, camera)
    np.testing.assert_allclose(bare.beauty, full.beauty, rtol=1e-5)
