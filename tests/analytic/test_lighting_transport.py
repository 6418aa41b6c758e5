"""Light transport against closed forms: furnaces, shadows, interreflection, layers, determinism."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from mirelight.base import conventions
from mirelight.lighting import Tracer
from mirelight.model import (
    AreaLight,
    Camera,
    DirectionalLight,
    Environment,
    Light,
    Lighting,
    Material,
    PointLight,
    ProxyMesh,
    RenderSettings,
    SpotLight,
    SunLight,
)

from .lighting_scenes import FLOOR, Array, constant_sky, join, overhead, quad, render, sphere

VIEW = Camera.look_at([0, 1.5, 4], [0, 0, 0], 48, 32)
DOWN = np.array([0.0, -1.0, 0.0])


@pytest.mark.parametrize("smooth", [False, True])
def test_a_convex_white_furnace_is_white(smooth: bool) -> None:
    """Every path off a convex body leaves it: a white one in a uniform sky cannot be told from the sky."""
    proxy = replace(sphere(smooth=smooth, rings=24), albedo=np.ones(3))
    buffer = render(proxy, VIEW, environment=constant_sky(1.0), spp=64, max_depth=8)
    np.testing.assert_allclose(buffer.beauty[buffer.coverage == 1], 1.0, rtol=2e-4 if not smooth else 2e-3)


def test_a_furnace_with_bounces_is_white() -> None:
    """A ball on a floor, both white, with paths long enough that next to nothing is cut off."""
    proxy = replace(join(sphere(0.5, rings=12), FLOOR, quad([0, 0, -2], [3, 0, 0], [0, 3, 0])), albedo=np.ones(3))
    buffer = render(proxy, VIEW, environment=constant_sky(1.0), spp=64, max_depth=200)
    assert buffer.beauty[buffer.coverage == 1].mean() == pytest.approx(1.0, rel=2e-3)


def test_a_gray_furnace_is_the_geometric_series() -> None:
    """Inside a closed ball of emission 1 and albedo a, radiance is 1 + a + a² + … cut at the last bounce."""
    glow = (Material(emissive=np.ones(3)),)
    proxy = replace(sphere(rings=16), materials=glow, albedo=np.full(3, 0.5))
    camera = Camera.look_at([0.2, 0.1, 0], [1, 0, 0], 24, 24, yfov=70)
    for bounces in (1, 3, 8):
        buffer = render(proxy, camera, spp=256, max_depth=bounces)
        expected = sum(0.5**k for k in range(bounces + 1))
        assert [x.name for x in buffer.layers] == ["emission"]
        assert buffer.beauty.mean() == pytest.approx(expected, rel=2e-3)
        assert buffer.layers[0].direct.mean() == pytest.approx(1.5, rel=2e-3)


def polygon_irradiance(p: Array, n: Array, corners: Array) -> float:
    """Irradiance at p from a polygon of radiance 1 wholly above its horizon: half the sum of edge angles times the
    edge planes' normals (Lambert, Photometria, 1760)."""
    to = corners - p
    to = to / np.linalg.norm(to, axis=1, keepdims=True)
    total = 0.0
    for a, b in zip(to, np.roll(to, -1, axis=0), strict=True):
        normal = np.cross(a, b)
        total += np.arccos(a @ b) * (normal @ n) / np.linalg.norm(normal)
    return abs(total) / 2


def wall_patch(y: float) -> Camera:
    """A camera that sees a speck of the wall z = 0 at height y."""
    matrix = conventions.look_at([0, y, 0.5], [0, y, 0])
    return Camera(world_from_camera=matrix, width=4, height=4, fx=2e4, fy=2e4, cx=2, cy=2)


@pytest.mark.parametrize("y", [0.1, 0.5, 1.9])
def test_a_wall_receives_the_floors_light_by_its_form_factor(y: float) -> None:
    """Sunlight parallel to the wall lights the floor evenly; the wall shows what the floor reflects, once."""
    floor, wall = quad([0, 0, 1], [1, 0, 0], [0, 0, 1]), quad([0, 1, 0], [1, 0, 0], [0, 1, 0])
    sun = DirectionalLight(name="sun", direction=DOWN, intensity=2.0)
    buffer = render(join(floor, wall), wall_patch(y), sun, spp=2048, max_depth=2)
    corners = np.array([[-1, 0, 0], [1, 0, 0], [1, 0, 2], [-1, 0, 2]], np.float64)
    floor_radiance = 0.5 * 2.0 / np.pi
    truth = 0.5 / np.pi * floor_radiance * polygon_irradiance(np.array([0, y, 0]), np.array([0, 0, 1.0]), corners)
    assert buffer.layers[0].indirect.mean() == pytest.approx(truth, rel=0.006)
    assert buffer.layers[0].direct.max() < 1e-6


@pytest.mark.parametrize("y", [0.1, 0.5, 1.9])
def test_a_wall_receives_a_glowing_floors_light(y: float) -> None:
    """The same with a floor that glows itself."""
    floor, wall = quad([0, 0, 1], [1, 0, 0], [0, 0, 1]), quad([0, 1, 0], [1, 0, 0], [0, 1, 0])
    materials = (Material(emissive=np.array([1.0, 2.0, 0.0])), Material())
    proxy = replace(join(floor, wall), materials=materials, face_materials=np.array([0, 0, 1, 1], np.int32))
    buffer = render(proxy, wall_patch(y), spp=1024, max_depth=1)
    corners = np.array([[-1, 0, 0], [1, 0, 0], [1, 0, 2], [-1, 0, 2]], np.float64)
    truth = 0.5 / np.pi * polygon_irradiance(np.array([0, y, 0]), np.array([0, 0, 1.0]), corners)
    np.testing.assert_allclose(buffer.beauty.mean(axis=(0, 1)), [truth, 2 * truth, 0], rtol=0.006)


def shadow(proxy: ProxyMesh, camera: Camera, *lights: Light, spp: int = 64) -> Array:
    """Direct light on the floor, (H, W), seen from just above it and below any occluder."""
    matrix = camera.world_from_camera.copy()
    matrix[1, 3] = 0.5
    low = replace(camera, world_from_camera=matrix)
    return render(proxy, low, *lights, spp=spp).beauty[..., 1].astype(np.float64)


CASTER = join(FLOOR, quad([0, 1, 0], [1, 0, 0], [0, 0, 1]))  # a square of side 2 one unit above the floor


def test_a_hard_shadow_ends_where_the_ray_past_the_edge_lands() -> None:
    camera = overhead(200, 40, extent=10.0)
    lamp = PointLight(name="lamp", position=np.array([0.0, 3.0, 0.0]), intensity=50.0)
    row = shadow(CASTER, camera, lamp)[20]
    x = (np.arange(200) + 0.5 - 100) / 20
    assert not row[np.abs(x) < 1.5 - 0.05].any()
    assert np.all(row[np.abs(x) > 1.5 + 0.05] > 0)
    lit = np.sum(row > 0.5 * row.max()) / 20  # the edge itself, to a fraction of a pixel
    assert np.sum(row / lamp_alone(lamp, camera)[20]) / 20 == pytest.approx(10 - 3.0, abs=0.01), lit


def lamp_alone(lamp: PointLight, camera: Camera) -> Array:
    return shadow(FLOOR, camera, lamp)


def test_the_penumbra_of_a_sun_is_the_discs_share_above_the_edge() -> None:
    """Past a straight edge the lit share of the disc is a circle cut by a chord; the width is 2 h tan(radius)."""
    edge = join(FLOOR, quad([-5, 2, 0], [5, 0, 0], [0, 0, 20]))  # ends at x = 0, two units up
    diameter = 6.0
    sun = SunLight(name="sun", direction=DOWN, intensity=1.0, angular_diameter=diameter)
    camera = overhead(64, 8, extent=0.4)
    lit = shadow(edge, camera, sun, spp=1024).mean(axis=0) / (0.5 / np.pi)
    x = (np.arange(64) + 0.5 - 32) / 64 * 0.4
    t = np.clip(x / (2 * np.tan(np.radians(diameter / 2))), -1, 1)
    share = 0.5 + (np.arcsin(t) + t * np.sqrt(1 - t * t)) / np.pi
    np.testing.assert_allclose(lit, share, atol=0.015)
    assert not lit[x < -2 * np.tan(np.radians(diameter / 2)) - 0.01].any()


def test_the_penumbra_of_a_panel_spans_the_lines_past_both_its_ends() -> None:
    """A panel 2 w wide at height H over an edge at height h: penumbra from -w h/(H-h) to +w h/(H-h)."""
    edge = join(FLOOR, quad([-5, 1, 0], [5, 0, 0], [0, 0, 20]))
    matrix = np.array([[1, 0, 0, 0], [0, 0, 1, 4.0], [0, -1, 0, 0], [0, 0, 0, 1]], np.float64)
    panel = AreaLight(name="p", shape="rectangle", world_from_light=matrix, size=(1.2, 0.01), intensity=1000.0)
    camera = overhead(80, 8, extent=0.8)
    lit = shadow(edge, camera, panel, spp=1024).mean(axis=0)
    lit = lit / shadow(FLOOR, camera, panel, spp=1024).mean(axis=0)
    x = (np.arange(80) + 0.5 - 40) / 80 * 0.8
    half = 0.6 * 1 / 3
    np.testing.assert_allclose(lit, np.clip((x + half) / (2 * half), 0, 1), atol=0.015)


@pytest.mark.parametrize("kind", ["point", "sphere", "disk"])
def test_the_penumbra_of_a_round_lamp_is_the_share_of_it_above_the_edge(kind: str) -> None:
    """Radius r at height H past an edge at height h: a circle cut by a chord, the penumbra r h / (H - h) either way."""
    r, above, h = 0.05, 4.0, 1.0
    edge = join(FLOOR, quad([-5, h, 0], [5, 0, 0], [0, 0, 20]))
    matrix = np.array([[1, 0, 0, 0], [0, 0, 1, above], [0, -1, 0, 0], [0, 0, 0, 1]], np.float64)
    lamp: Light = PointLight(name="lamp", position=matrix[:3, 3], intensity=10.0, radius=r)
    if kind != "point":
        lamp = AreaLight(name="lamp", shape=kind, world_from_light=matrix, size=(2 * r, 2 * r), intensity=1000.0)  # type: ignore[arg-type]
    camera = overhead(64, 8, extent=0.06)
    lit = shadow(edge, camera, lamp, spp=1024).mean(axis=0) / shadow(FLOOR, camera, lamp, spp=256).mean()
    x = (np.arange(64) + 0.5 - 32) / 64 * 0.06
    t = np.clip(x * (above - h) / (h * r), -1, 1)
    np.testing.assert_allclose(lit, 0.5 + (np.arcsin(t) + t * np.sqrt(1 - t * t)) / np.pi, atol=0.015)
    assert not lit[t == -1].any()


def test_nothing_leaks_through_a_closed_box() -> None:
    """A camera and floor inside a box, every kind of light outside it: black."""
    box = join(
        quad([0, 0, 0], [2, 0, 0], [0, 0, 2]),
        quad([0, 4, 0], [2, 0, 0], [0, 0, 2]),
        quad([-2, 2, 0], [0, 2, 0], [0, 0, 2]),
        quad([2, 2, 0], [0, 2, 0], [0, 0, 2]),
        quad([0, 2, -2], [2, 0, 0], [0, 2, 0]),
        quad([0, 2, 2], [2, 0, 0], [0, 2, 0]),
    )
    matrix = np.array([[1, 0, 0, 0], [0, 0, 1, 5.0], [0, -1, 0, 0], [0, 0, 0, 1]], np.float64)
    lights = (
        DirectionalLight(name="a", direction=np.array([0.3, -1, 0.2]), intensity=10.0),
        SunLight(name="b", direction=DOWN, intensity=10.0, angular_diameter=20.0),
        PointLight(name="c", position=np.array([0.0, 4.01, 0.0]), intensity=10.0),
        PointLight(name="d", position=np.array([0.0, 6.0, 0.0]), intensity=10.0, radius=1.0),
        SpotLight(name="e", position=np.array([0.0, 9.0, 0.0]), direction=DOWN, intensity=10.0),
        AreaLight(name="f", shape="rectangle", world_from_light=matrix, size=(8.0, 8.0), intensity=10.0),
        AreaLight(name="g", shape="disk", world_from_light=matrix, size=(8.0, 8.0), intensity=10.0),
    )
    camera = Camera.look_at([-1.5, 3.5, 1.5], [0, 1, 0], 48, 32, yfov=90)
    buffer = render(box, camera, *lights, environment=constant_sky(5.0), spp=64, max_depth=6)
    assert buffer.coverage.min() == 1
    assert not buffer.beauty.any()


EVERY_KIND: tuple[Light, ...] = (
    DirectionalLight(name="directional", direction=np.array([0.5, -1, 0.2]), intensity=1.0),
    PointLight(name="point", position=np.array([1.0, 1.5, 1.0]), intensity=3.0, range=6.0),
    SpotLight(name="spot", position=np.array([-1.5, 2, 1]), direction=np.array([1, -1.5, -0.5]), intensity=5.0),
    SunLight(name="sun", direction=np.array([-0.3, -1, -0.4]), intensity=1.0, angular_diameter=8.0),
    PointLight(name="bulb", position=np.array([-1.0, 1.2, 0.5]), intensity=2.0, radius=0.2),
    AreaLight(
        name="panel",
        shape="rectangle",
        world_from_light=np.array([[1, 0, 0, 0], [0, 0, 1, 2.5], [0, -1, 0, 0], [0, 0, 0, 1]], np.float64),
        size=(1.0, 0.5),
        intensity=4.0,
    ),
)
STAGE = join(sphere(0.5, rings=12), quad([0, -0.5, 0], [2, 0, 0], [0, 0, 2]), quad([0, 1, -1], [2, 0, 0], [0, 1.5, 0]))


def test_layers_add_up_and_scale_like_light() -> None:
    """Each layer alone, rendered alone, is the same to the bit or nearly; and twice the light is twice the layer."""
    lighting = Lighting(lights=EVERY_KIND, environment=constant_sky(0.2))
    tracer = Tracer(STAGE, RenderSettings(spp=16, max_depth=4))
    together = tracer.trace(lighting, VIEW)
    assert [x.name for x in together.layers] == [*(x.name for x in EVERY_KIND), "environment"]
    total = sum(x.direct.astype(np.float64) + x.indirect for x in together.layers)
    np.testing.assert_allclose(together.beauty, total, rtol=1e-5, atol=1e-7)
    for light, layer in zip(EVERY_KIND, together.layers, strict=False):
        twice = tracer.trace(Lighting(lights=(replace(light, intensity=2 * light.intensity),)), VIEW)
        assert layer.direct.mean() == pytest.approx(twice.layers[0].direct.mean() / 2, rel=0.02)
        assert layer.indirect.mean() == pytest.approx(twice.layers[0].indirect.mean() / 2, rel=0.06)


def test_more_bounces_bring_more_light_and_never_more_than_albedo_allows() -> None:
    lighting = Lighting(lights=EVERY_KIND)
    means = []
    for depth in (1, 2, 4, 8):
        buffer = Tracer(STAGE, RenderSettings(spp=16, max_depth=depth)).trace(lighting, VIEW)
        means.append(buffer.beauty.mean())
        indirect = sum(x.indirect.mean() for x in buffer.layers)
        direct = sum(x.direct.mean() for x in buffer.layers)
        assert (indirect > 0) == (depth > 1)
        assert indirect < direct  # the series of albedo 0.5: 1/2 + 1/4 + … of the direct light at most
    assert means == sorted(means)
    sky = Tracer(STAGE, RenderSettings(spp=64, max_depth=8)).trace(Lighting(environment=constant_sky(1.0)), VIEW)
    assert sky.beauty.max() < 0.75


def test_the_same_seed_gives_the_same_bits_and_another_seed_others() -> None:
    lighting = Lighting(lights=EVERY_KIND, environment=constant_sky(0.2))
    tracer = Tracer(STAGE, RenderSettings(spp=24, max_depth=4, seed=5))
    first, again = tracer.trace(lighting, VIEW), tracer.trace(lighting, VIEW)
    fresh = Tracer(STAGE, RenderSettings(spp=24, max_depth=4, seed=5)).trace(lighting, VIEW)
    other = Tracer(STAGE, RenderSettings(spp=24, max_depth=4, seed=6)).trace(lighting, VIEW)
    for name in ("coverage", "beauty", "depth", "position", "normal", "variance"):
        assert np.array_equal(getattr(first, name), getattr(again, name)), name
        assert np.array_equal(getattr(first, name), getattr(fresh, name)), name
    assert not np.array_equal(first.beauty, other.beauty)


@pytest.mark.parametrize("spp", [16, 64, 18])
def test_the_predicted_variance_is_that_of_independent_seeds(spp: int) -> None:
    """Of a picture as small as this one, few pixels are sampled twice, so it is the mean of several that is right."""
    lighting = Lighting(lights=EVERY_KIND, environment=constant_sky(0.2))
    tracer, made = Tracer(STAGE, RenderSettings(spp=spp, max_depth=4)), []
    for seed in range(24):
        tracer.settings = replace(tracer.settings, seed=seed)
        made.append(tracer.trace(lighting, VIEW))
    predicted = np.array([np.mean(np.asarray(x.variance)) for x in made])
    actual = np.stack([x.beauty for x in made]).astype(np.float64).var(axis=0, ddof=1).mean()
    assert 0.85 < predicted.mean() / actual < 1.15
    assert predicted.min() / actual > 0.5 and predicted.max() / actual < 2.5


def test_a_noise_target_is_reached_and_reported() -> None:
    lighting = Lighting(lights=EVERY_KIND, environment=constant_sky(0.2))
    calls: list[tuple[int, int]] = []
    tracer = Tracer(STAGE, RenderSettings(spp=8, max_depth=3, noise=0.03))
    buffer = tracer.trace(lighting, VIEW, progress=lambda done, total: calls.append((done, total)))
    truth = Tracer(STAGE, RenderSettings(spp=1024, max_depth=3, seed=9)).trace(lighting, VIEW).beauty
    assert buffer.samples is not None and buffer.samples.min() == buffer.spp
    error = (buffer.beauty - truth)[buffer.coverage > 0]
    floor = 0.01 * truth[buffer.coverage > 0].mean() ** 2
    assert np.sqrt(np.mean(error**2 / (truth[buffer.coverage > 0] ** 2 + floor))) < 0.036
    assert calls[-1][0] == buffer.samples.sum() > buffer.spp * 48 * 32
    assert all(a[0] < b[0] for a, b in pairwise(calls))


def test_an_empty_mesh_no_lights_and_a_camera_inside_the_mesh() -> None:
    empty = ProxyMesh(vertices=np.zeros((0, 3), np.float32), faces=np.zeros((0, 3), np.int32))
    lighting = Lighting(lights=EVERY_KIND)
    buffer = Tracer(empty, RenderSettings(spp=4)).trace(lighting, VIEW)
    assert not buffer.coverage.any() and not buffer.beauty.any() and len(buffer.layers) == len(EVERY_KIND)
    dark = Tracer(STAGE, RenderSettings(spp=4)).trace(Lighting(), VIEW)
    assert dark.coverage.any() and not dark.beauty.any() and dark.layers == ()
    within = Tracer(sphere(5.0), RenderSettings(spp=4)).trace(Lighting(lights=EVERY_KIND), VIEW)
    assert within.coverage.min() == 1 and within.beauty.mean() > 0


def test_lights_inside_and_on_the_surface_leave_no_holes() -> None:
    """Lamps at a vertex, on a face, round the camera, and a panel lying on the floor: finite everywhere."""
    on_floor = np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]], np.float64)
    lights = (
        PointLight(name="vertex", position=FLOOR.vertices[0].astype(np.float64)),
        PointLight(name="face", position=np.array([0.5, 0.0, 0.5])),
        PointLight(name="ball", position=np.zeros(3), radius=1.0),
        PointLight(name="round the camera", position=np.array([0, 1.5, 4.0]), radius=2.0),
        AreaLight(name="panel", shape="rectangle", world_from_light=on_floor, size=(1.0, 1.0)),
        AreaLight(name="disk", shape="disk", world_from_light=on_floor, size=(1.0, 1.0)),
    )
    buffer = render(FLOOR, VIEW, *lights, spp=64, max_depth=3)
    assert np.all(np.isfinite(buffer.beauty))
    assert buffer.beauty.min() >= 0


def test_an_environment_map_looks_where_the_conventions_say() -> None:
    """Six coloured patches, one at the end of each axis; a surface facing an axis takes its colour."""
    h, w = 64, 128
    v, u = (np.arange(h) + 0.5) / h, (np.arange(w) + 0.5) / w
    phi, theta = np.meshgrid(2 * np.pi * (u - 0.5), np.pi * v)
    way = np.stack([np.cos(phi) * np.sin(theta), np.cos(theta), np.sin(phi) * np.sin(theta)], axis=-1)
    axes = {(1, 0, 0): (1, 0, 0), (-1, 0, 0): (0, 1, 1), (0, 1, 0): (0, 1, 0)}
    axes |= {(0, -1, 0): (1, 0, 1), (0, 0, 1): (0, 0, 1), (0, 0, -1): (1, 1, 0)}
    radiance = sum((way @ np.array(a) > 0.8)[..., None] * np.array(c, np.float32) for a, c in axes.items())
    solid_angle = (np.cos(np.pi * np.arange(h) / h) - np.cos(np.pi * (np.arange(h) + 1) / h))[:, None] * 2 * np.pi / w
    for turn in (0.0, 90.0, 30.0):
        angle = np.radians(turn)
        about_y = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
        sky = Environment(radiance=np.asarray(radiance, np.float32), rotation=turn, intensity=2.0)
        for axis in axes:
            facing = about_y @ np.array(axis, np.float64)
            x = np.cross(facing, [0.3, 0.5, 0.8])
            x /= np.linalg.norm(x)
            plate = quad([0, 0, 0], x, np.cross(facing, x))
            camera = Camera.look_at(3 * facing, [0, 0, 0], 4, 4, yfov=5)
            picture = render(plate, camera, environment=sky, spp=512).beauty.mean(axis=(0, 1))
            cosine = np.maximum(way @ np.array(axis), 0)
            expected = 0.5 / np.pi * 2 * np.sum(radiance * (cosine * solid_angle)[..., None], axis=(0, 1))
            np.testing.assert_allclose(picture, expected, atol=0.012)
