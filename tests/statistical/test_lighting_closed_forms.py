"""E cos θ of every kind of light at several distances and angles: within 0.3 % of its closed form, and no further from
it than the spread of independent seeds explains."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from ztest import Array, worst_against_truth

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

SEEDS = 24
DISTANCES, ANGLES = (0.7, 2.0, 9.0), (0.0, 40.0, 75.0)  # from a speck of the floor; from its normal, in degrees
COLOR = np.array([1.0, 0.5, 0.25])
UP = np.array([0.0, 1.0, 0.0])


def patch(half: float = 50.0) -> ProxyMesh:
    corners = np.array([[-1, 0, -1], [-1, 0, 1], [1, 0, 1], [1, 0, -1]]) * half
    return ProxyMesh(vertices=corners.astype(np.float32), faces=np.array([[0, 1, 2], [0, 2, 3]], np.int32))


def speck(normal: Array = UP, pixels: int = 16) -> Camera:
    """A thousandth of a unit of a surface through the origin. Many pixels and few samples, as passes cost time."""
    pose, scale, middle = conventions.look_at(normal, [0, 0, 0]), pixels * 1000, pixels / 2
    return Camera(
        world_from_camera=pose,
        width=pixels,
        height=pixels,
        fx=scale,
        fy=scale,
        cx=middle,
        cy=middle,
        projection="orthographic",
    )


def measured(tracer: Tracer, lighting: Lighting, camera: Camera) -> Array:
    """(SEEDS, layers * 3) irradiance of each layer."""
    rows = []
    for seed in range(SEEDS):
        tracer.settings = replace(tracer.settings, seed=seed)
        buffer = tracer.trace(lighting, camera)
        rows.append([layer.direct.mean(axis=(0, 1), dtype=np.float64) * np.pi / 0.5 for layer in buffer.layers])
    return np.asarray(rows).reshape(SEEDS, -1)


def agrees(found: Array, truth: Array) -> None:
    np.testing.assert_allclose(found.mean(axis=0), truth, rtol=3e-3)
    worst, allowed = worst_against_truth(found, truth)
    assert worst < allowed, f"|t| = {worst:.2f}, chance allows {allowed:.2f}"


def polygon_irradiance(corners: Array) -> float:
    """E on the floor at the origin from a polygon of radiance 1 above it: half the sum of its edges' angles times their
    planes' normals (Lambert, Photometria, 1760)."""
    to = corners / np.linalg.norm(corners, axis=1, keepdims=True)
    after = np.roll(to, -1, axis=0)
    across = np.cross(to, after)
    sine = np.linalg.norm(across, axis=1)
    angle = np.arctan2(sine, np.sum(to * after, axis=1))
    return float(abs(np.sum(angle * across[:, 1] / sine)) / 2)


def towards_origin(position: Array) -> Array:
    """world_from_light of a panel there that shines at the origin, a little askew."""
    aside = 0.1 * float(np.linalg.norm(position))
    return conventions.look_at(position, [aside, 0, 0.05], up=[0.3, 0.2, 1.0])


def outline(light: AreaLight) -> Array:
    """Corners of a rectangle; a disk as a polygon of 2048, whose area falls short by 2e-6."""
    turn = np.arange(2048) * 2 * np.pi / 2048
    around = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    if light.shape == "rectangle":
        around = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], np.float64)
    local = np.concatenate(
        [around * np.array(light.size) / 2, np.zeros((len(around), 1)), np.ones((len(around), 1))], 1
    )
    return np.asarray((local @ light.world_from_light.T)[:, :3])


Case = tuple[Light, float]  # a light, and the irradiance that it gives per unit of colour


def directional(p: Array, d: float, cosine: float) -> Case:
    return DirectionalLight(name="", direction=-p, intensity=3.0), 3 * cosine


def sun(p: Array, d: float, cosine: float) -> Case:
    return SunLight(name="", direction=-p, intensity=3.0, angular_diameter=2 * d), 3 * cosine  # d in degrees: 1.4 to 18


def point(p: Array, d: float, cosine: float) -> Case:
    return PointLight(name="", position=p, intensity=5.0), 5 * cosine / d**2


def ranged_point(p: Array, d: float, cosine: float) -> Case:
    window = 1 - (d / (1.25 * d)) ** 4
    return PointLight(name="", position=p, intensity=5.0, range=1.25 * d), 5 * window * cosine / d**2


def spot(p: Array, d: float, cosine: float) -> Case:
    """The speck lies between the cones, off the axis."""
    aim = conventions.unit(-p + 0.3 * d * np.array([0.0, 0.0, 1.0]))
    inner, outer = 0.1, 0.6
    off = float(aim @ -p) / d
    cone = ((off - np.cos(outer)) / (np.cos(inner) - np.cos(outer))) ** 2
    light = SpotLight(
        name="", position=p, direction=aim, intensity=5.0, range=3 * d, inner_cone_angle=inner, outer_cone_angle=outer
    )
    return light, 5 * cone * (1 - (1 / 3) ** 4) * cosine / d**2


def bulb(p: Array, d: float, cosine: float) -> Case:
    """Wholly above the horizon a ball shines as its centre would."""
    return PointLight(name="", position=p, intensity=5.0, radius=0.2 * d), 5 * cosine / d**2


def sphere(p: Array, d: float, cosine: float) -> Case:
    place = conventions.compose(p)
    size = 0.3 * d
    light = AreaLight(name="", shape="sphere", world_from_light=place, size=(size, size), intensity=5.0)
    return light, 5 * np.pi * (size / 2) ** 2 * cosine / d**2


def rectangle(p: Array, d: float, cosine: float) -> Case:
    light = AreaLight(
        name="", shape="rectangle", world_from_light=towards_origin(p), size=(0.4 * d**0.5, 0.15), intensity=5.0
    )
    return light, 5 * polygon_irradiance(outline(light))


def disk(p: Array, d: float, cosine: float) -> Case:
    size = 0.3 * d**0.5
    light = AreaLight(name="", shape="disk", world_from_light=towards_origin(p), size=(size, size), intensity=5.0)
    return light, 5 * polygon_irradiance(outline(light))


KINDS: list[Callable[[Array, float, float], Case]] = [
    directional,
    sun,
    point,
    ranged_point,
    spot,
    bulb,
    sphere,
    rectangle,
    disk,
]


@pytest.fixture(scope="module")
def floor() -> Tracer:
    return Tracer(patch(), RenderSettings(spp=16, max_depth=1))


@pytest.mark.parametrize("kind", KINDS)
def test_irradiance_is_the_closed_form_at_every_distance_and_angle(
    floor: Tracer, kind: Callable[[Array, float, float], Case]
) -> None:
    lights, truth = [], []
    for d in DISTANCES:
        for angle in ANGLES:
            a = np.radians(angle)
            position = d * np.array([np.sin(a) * 0.8, np.cos(a), np.sin(a) * 0.6])
            light, expected = kind(position, d, float(np.cos(a)))
            lights.append(replace(light, name=f"{d} {angle}", color=COLOR))
            truth.append(expected * COLOR)
    agrees(measured(floor, Lighting(lights=tuple(lights)), speck()), np.concatenate(truth))


@pytest.mark.parametrize("distance", DISTANCES)
@pytest.mark.parametrize("angle", ANGLES)
def test_a_glowing_face_of_the_mesh_is_the_same_polygon(distance: float, angle: float) -> None:
    a = np.radians(angle)
    panel = AreaLight(
        name="",
        shape="rectangle",
        world_from_light=towards_origin(distance * np.array([np.sin(a) * 0.8, np.cos(a), np.sin(a) * 0.6])),
        size=(0.4 * distance**0.5, 0.15),
    )
    corners, floor = outline(panel), patch()
    proxy = ProxyMesh(
        vertices=np.concatenate([floor.vertices, corners.astype(np.float32)]),
        faces=np.concatenate([floor.faces, floor.faces + 4]),
        materials=(Material(), Material(emissive=5 * COLOR)),
        face_materials=np.array([0, 0, 1, 1], np.int32),
    )
    tracer = Tracer(proxy, RenderSettings(spp=16, max_depth=1))
    below = replace(speck(), world_from_camera=conventions.look_at([0, 0.01, 0], [0, 0, 0]), near=1e-4)
    agrees(measured(tracer, Lighting(), below), 5 * polygon_irradiance(corners) * COLOR)


def bilinear(image: Array, fine: int) -> Array:
    """A panorama with every pixel cut into fine x fine, linear between pixel centres; columns go round."""
    h, w = image.shape[:2]
    y = np.clip((np.arange(h * fine) + 0.5) / fine - 0.5, 0, h - 1)
    x = ((np.arange(w * fine) + 0.5) / fine - 0.5) % w
    y0, x0 = np.minimum(y.astype(int), h - 2), x.astype(int)
    fy, fx = (y - y0)[:, None, None], (x - x0)[None, :, None]
    rows = image[y0] * (1 - fy) + image[y0 + 1] * fy
    return np.asarray(rows[:, x0] * (1 - fx) + rows[:, (x0 + 1) % w] * fx)


@pytest.mark.parametrize("tilt", [0.0, 50.0, 110.0])
def test_a_panorama_is_the_integral_of_its_radiance_over_the_hemisphere(tilt: float) -> None:
    h, w = 24, 48
    image = np.random.default_rng(8).random((h, w, 3))
    image[5, 30] = [90, 70, 50]
    turn = 37.0
    lighting = Lighting(environment=Environment(radiance=image.astype(np.float32), rotation=turn, intensity=2.0))

    fine = bilinear(image, 16)
    rows, columns = fine.shape[:2]
    theta = np.pi * (np.arange(rows)[:, None] + 0.5) / rows
    phi = 2 * np.pi * ((np.arange(columns)[None, :] + 0.5) / columns - 0.5) - np.radians(turn)
    way = np.stack([np.cos(phi) * np.sin(theta), np.cos(theta) + 0 * phi, np.sin(phi) * np.sin(theta)], axis=-1)
    solid_angle = np.sin(theta) * (np.pi / rows) * (2 * np.pi / columns)

    t = np.radians(tilt)
    normal = np.array([0.6 * np.sin(t), np.cos(t), 0.8 * np.sin(t)])
    truth = 2 * np.sum(fine * (np.maximum(way @ normal, 0) * solid_angle)[..., None], axis=(0, 1))

    x = conventions.unit(np.cross(normal, [0.2, 0.1, -1.0]))
    y = np.cross(normal, x)
    corners = np.array([-x - y, x - y, x + y, y - x])
    plate = ProxyMesh(vertices=corners.astype(np.float32), faces=np.array([[0, 1, 2], [0, 2, 3]], np.int32))
    found = measured(Tracer(plate, RenderSettings(spp=16, max_depth=1)), lighting, speck(normal, pixels=32))
    agrees(found, truth)


def test_a_constant_sky_gives_pi_times_its_radiance_at_any_tilt() -> None:
    sky = Lighting(environment=Environment(radiance=np.full((1, 1, 3), 0.7, np.float32)))
    tracer = Tracer(patch(), RenderSettings(spp=16, max_depth=1))
    agrees(measured(tracer, sky, speck()), np.full(3, 0.7 * np.pi))


def test_the_test_would_see_a_bias_of_a_third_of_a_percent(floor: Tracer) -> None:
    light, _ = bulb(np.array([0.3, 1.9, 0.4]), 1.965, 0.967)
    lighting = Lighting(lights=(replace(light, name="bulb"),))
    found = measured(floor, lighting, speck())
    worst, allowed = worst_against_truth(found * 1.0033, np.full(3, found.mean()))
    assert worst > allowed
