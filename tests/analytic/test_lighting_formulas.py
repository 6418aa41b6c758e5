"""Each light against its closed form on a plane: what a Lambert surface of albedo 0.5 shows is 0.5 E / pi."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from mirelight.model import AreaLight, DirectionalLight, Light, PointLight, SpotLight, SunLight
from mirelight.model.cones import ConeLaw

from .lighting_scenes import FLOOR, Array, constant_sky, floor_mean, overhead, render

CAMERA = overhead(96, 64, extent=12.0)
GRAY = 0.5 / np.pi


def khr_window(distance: Array, reach: float) -> Array:
    """The range window of KHR_lights_punctual over the square of the distance."""
    return np.clip(1 - (distance / reach) ** 4, 0, 1) / distance**2


def measured(*lights: Light, spp: int = 4) -> NDArray[np.float32]:
    return render(FLOOR, CAMERA, *lights, spp=spp).beauty


def agree(picture: NDArray[np.float32], truth: Array, tolerance: float = 0.003) -> None:
    """Every pixel within `tolerance` of the truth at its centre, or of 0.1 % of its brightest."""
    np.testing.assert_allclose(picture, truth, rtol=tolerance, atol=0.001 * float(np.max(truth)))


@pytest.mark.parametrize("angle", [0.0, 30.0, 75.0])
def test_a_directional_light_is_its_lux_times_the_cosine(angle: float) -> None:
    direction = [np.sin(np.radians(angle)), -np.cos(np.radians(angle)), 0.0]
    color = np.array([1.0, 0.5, 0.25])
    light = DirectionalLight(name="key", direction=np.array(direction), color=color, intensity=3.0)
    agree(measured(light), np.broadcast_to(GRAY * 3 * np.cos(np.radians(angle)) * color, (64, 96, 3)))


def lambert(position: Array, points: Array, *, reach: float = np.inf) -> Array:
    """0.5 / pi times the irradiance of one candela there on the floor."""
    to_light = position - points
    d = np.linalg.norm(to_light, axis=-1)
    return np.asarray(GRAY * khr_window(d, reach) * to_light[..., 1] / d)


@pytest.mark.parametrize("height", [0.5, 2.0, 8.0])
@pytest.mark.parametrize("reach", [np.inf, 5.0])
def test_a_point_light_is_candela_over_distance_squared_in_its_range_window(height: float, reach: float) -> None:
    position = np.array([1.0, height, -0.5])
    truth = floor_mean(CAMERA, lambda p: 40 * lambert(position, p, reach=reach))
    picture = measured(PointLight(name="lamp", position=position, intensity=40.0, range=reach), spp=64)
    agree(picture[..., 1], truth, tolerance=0.005)
    nearest = floor_mean(CAMERA, lambda p: np.linalg.norm(position - p, axis=-1)) - 0.1
    assert not picture[nearest > reach].any()


@pytest.mark.parametrize(("inner", "outer"), [(0.0, np.pi / 4), (0.2, 0.6), (0.5, 0.5005), (0.3, np.pi / 2)])
@pytest.mark.parametrize("law", ["khr", "playcanvas"])
def test_a_spot_light_has_the_cone_of_its_law(inner: float, outer: float, law: ConeLaw) -> None:
    position, axis = np.array([0.0, 5.0, 0.0]), np.array([0.3, -1.0, 0.1])
    axis /= np.linalg.norm(axis)

    def brightness(points: Array) -> Array:
        to_light = position - points
        cosine = -(to_light @ axis) / np.linalg.norm(to_light, axis=-1)
        scale = 1 / max(0.001 if law == "khr" else 0, np.cos(inner) - np.cos(outer))
        t = np.clip((cosine - np.cos(outer)) * scale, 0, 1)
        cone = t**2 if law == "khr" else t**2 * (3 - 2 * t)
        return np.asarray(100 * cone * lambert(position, points, reach=9.0))

    light = SpotLight(
        name="spot",
        position=position,
        direction=axis,
        intensity=100.0,
        range=9.0,
        inner_cone_angle=inner,
        outer_cone_angle=outer,
        cone=law,
    )
    picture, truth = measured(light, spp=256)[..., 1], floor_mean(CAMERA, brightness)
    if outer - inner > 0.01:
        agree(picture, truth, tolerance=0.005)
    else:  # the edge is a step, and a pixel on it is sampled, not smooth
        assert np.abs(picture - truth).max() < 0.06 * truth.max()  # 256 samples here, 64 in the truth's pixel
        assert picture.mean() == pytest.approx(truth.mean(), rel=1e-3)


@pytest.mark.parametrize("diameter", [0.53, 10.0, 60.0])
def test_a_sun_gives_its_lux_on_a_facing_surface(diameter: float) -> None:
    direction = np.array([0.4, -1.0, 0.2]) / np.linalg.norm([0.4, -1.0, 0.2])
    light = SunLight(name="sun", direction=direction, intensity=2.0, angular_diameter=diameter)
    picture = measured(light, spp=64)
    assert picture.mean() == pytest.approx(GRAY * 2 * -direction[1], rel=5e-4)
    agree(picture, np.full((64, 96, 3), GRAY * 2 * -direction[1]), tolerance=0.003 if diameter < 20 else 0.05)


@pytest.mark.parametrize("height", [1.0, 4.0])
def test_a_ball_light_shines_as_its_centre_would(height: float) -> None:
    """The irradiance of a uniform ball wholly above the horizon is that of a point at its centre."""
    position = np.array([0.5, height, 0.5])
    truth = floor_mean(CAMERA, lambda p: 20 * lambert(position, p))
    lamp = PointLight(name="lamp", position=position, intensity=20.0, radius=0.9)
    ball = AreaLight(
        name="ball",
        shape="sphere",
        world_from_light=placed(position),
        size=(1.8, 1.8),
        intensity=20 / (np.pi * 0.9**2),
    )
    for light in (lamp, ball):
        picture = measured(light, spp=256)[..., 0]
        assert picture.mean() == pytest.approx(truth.mean(), rel=1e-3)
        np.testing.assert_allclose(picture, truth, rtol=0.06)


def test_a_disk_light_overhead() -> None:
    """Directly below its centre E = L pi r² / (r² + h²)."""
    camera = overhead(9, 9, extent=0.02)
    for height in (0.5, 2.0):
        light = AreaLight(name="disk", shape="disk", world_from_light=facing_down(height), size=(2.0, 2.0), intensity=7)
        truth = GRAY * 7 * np.pi / (1 + height**2)
        assert render(FLOOR, camera, light, spp=1024).beauty.mean() == pytest.approx(truth, rel=2e-3)


@pytest.mark.parametrize("height", [0.05, 0.5, 3.0, 30.0])
def test_a_rectangle_light_overhead(height: float) -> None:
    """Below a corner E = L/2 (a/A atan(b/A) + b/B atan(a/B)), A² = 1 + a², a = width / height (Lambert 1760)."""
    camera = overhead(9, 9, extent=0.002)
    light = AreaLight(
        name="panel", shape="rectangle", world_from_light=facing_down(height), size=(3.0, 1.0), intensity=2.0
    )
    a, b = 1.5 / height, 0.5 / height
    quarter = a / np.hypot(1, a) * np.arctan(b / np.hypot(1, a)) + b / np.hypot(1, b) * np.arctan(a / np.hypot(1, b))
    truth = GRAY * 2.0 * 4 * quarter / 2
    assert render(FLOOR, camera, light, spp=512).beauty.mean() == pytest.approx(truth, rel=2e-3)


def test_an_area_light_is_dark_behind() -> None:
    for shape in ("rectangle", "disk"):
        light = AreaLight(name="panel", shape=shape, world_from_light=upward(1.0), size=(2.0, 2.0), intensity=5.0)
        assert not measured(light).any()


def test_a_constant_sky_over_a_plane() -> None:
    """E = pi L: the plane shows albedo times L."""
    picture = render(FLOOR, CAMERA, environment=constant_sky(3.0), spp=16).beauty
    np.testing.assert_allclose(picture, 1.5, rtol=1e-5)


def placed(position: Array) -> Array:
    out = np.eye(4)
    out[:3, 3] = position
    return out


def facing_down(height: float) -> Array:
    """world_from_light of a panel at that height whose -Z looks down."""
    return np.array([[1, 0, 0, 0], [0, 0, 1, height], [0, -1, 0, 0], [0, 0, 0, 1]], np.float64)


def upward(height: float) -> Array:
    return np.array([[1, 0, 0, 0], [0, 0, -1, height], [0, 1, 0, 0], [0, 0, 0, 1]], np.float64)
