"""A glowing tube against its closed form, a sum over its surface, and rectangles around it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from mirelight.base import conventions
from mirelight.lighting import Tracer
from mirelight.model import AreaLight, Lighting, Material, RenderSettings, TubeLight

from .lighting_scenes import FLOOR, Array, floor_mean, overhead, render

CAMERA = overhead(12, 8, extent=3.0)
ALBEDO = 0.5


def tube(position: Array, direction: Array, length: float = 1.5, radius: float = 0.1) -> TubeLight:
    pose = conventions.look_at(position, np.asarray(position) + direction)
    return TubeLight(name="tube", world_from_light=pose, length=length, radius=radius, intensity=20.0)


def facets(light: TubeLight, count: int = 24) -> tuple[AreaLight, ...]:
    """Rectangles as long that face outwards, together as wide, seen from all sides, as the tube."""
    width = 2 * math.pi * light.radius / count
    away = width / (2 * math.tan(math.pi / count))
    out = []
    for k in range(count):
        angle = 2 * math.pi * k / count
        outward = np.array([math.cos(angle), math.sin(angle), 0.0])
        own = np.eye(4)
        own[:3, 0], own[:3, 2], own[:3, 3] = (0, 0, 1), -outward, away * outward
        own[:3, 1] = np.cross(own[:3, 2], own[:3, 0])
        pose = light.world_from_light @ own
        size = (light.length, width)
        out.append(
            AreaLight(name=str(k), shape="rectangle", world_from_light=pose, size=size, intensity=20.0, group="g")
        )
    return tuple(out)


def summed(light: TubeLight, points: Array) -> Array:
    """Irradiance on the floor at points (..., 3): its surface in small pieces, with cosines at both ends."""
    around, across = 160, 80
    angle = (np.arange(around) + 0.5) * (2 * math.pi / around)
    along = ((np.arange(across) + 0.5) / across - 0.5) * light.length
    outward = np.stack([np.cos(angle), np.sin(angle), np.zeros(around)], axis=-1)
    own = (light.radius * outward)[:, None] + along[:, None] * np.array([0.0, 0.0, 1.0])
    m = light.world_from_light
    surface, normal = own @ m[:3, :3].T + m[:3, 3], (outward @ m[:3, :3].T)[:, None]
    piece = light.radius * (2 * math.pi / around) * light.length / across
    out = np.empty(points.shape[:-1])
    for place in np.ndindex(out.shape):
        to = surface - points[place]
        square = np.sum(to * to, axis=-1)
        leaves = np.maximum(-np.sum(to * normal, axis=-1), 0)
        out[place] = float(np.sum(leaves * np.maximum(to[..., 1], 0) / square**2)) * piece * light.intensity
    return out


@pytest.mark.parametrize(
    ("position", "direction"),
    [((0.2, 0.7, 0.1), (1.0, 0.0, 0.0)), ((0.0, 1.3, 0.0), (0.3, 1.0, -0.2)), ((-0.5, 0.16, 0.3), (0.5, 0.0, 1.0))],
)
def test_what_it_gives_the_floor_is_the_sum_over_its_surface(position: Array, direction: Array) -> None:
    light = tube(np.array(position), np.array(direction))
    truth = floor_mean(CAMERA, lambda p: ALBEDO / math.pi * summed(light, p), grid=4)
    found = render(FLOOR, CAMERA, light, spp=256).beauty[..., 0]
    np.testing.assert_allclose(found, truth, rtol=0.02, atol=0.003 * truth.max())
    assert found.mean() == pytest.approx(truth.mean(), rel=3e-3)


@pytest.mark.parametrize(("height", "length"), [(0.3, 2.0), (2.0, 0.5), (9.0, 4.0)])
def test_below_its_end_it_is_the_view_factor_of_a_cylinder(height: float, length: float) -> None:
    """Of a small plane whose normal meets the axis of a cylinder at its end, at a right angle (Howell, A Catalog of
    Radiation Heat Transfer Configuration Factors, B-30)."""
    radius = 0.1
    h, l = height / radius, length / radius  # noqa: E741
    x, y = (1 + h) ** 2 + l**2, (1 - h) ** 2 + l**2
    factor = math.atan(l / math.sqrt(h * h - 1)) / (math.pi * h) + l / math.pi * (
        (x - 2 * h) / (h * math.sqrt(x * y)) * math.atan(math.sqrt(x * (h - 1) / (y * (h + 1))))
        - math.atan(math.sqrt((h - 1) / (h + 1))) / h
    )
    light = tube(np.array([length / 2, height, 0.0]), np.array([1.0, 0.0, 0.0]), length, radius)
    np.testing.assert_allclose(summed(light, np.zeros((1, 3))), math.pi * 20 * factor, rtol=2e-3)
    speck = overhead(8, 8, extent=0.01)
    found = render(FLOOR, speck, light, spp=64).beauty[..., 0].mean()
    assert found == pytest.approx(ALBEDO * 20 * factor, rel=3e-3)


def test_gloss_mirrors_it_as_rectangles_around_it() -> None:
    """A rough mirror meets it by rays of its own, weighed against those drawn to it."""
    light = tube(np.array([0.1, 0.8, 0.0]), np.array([0.6, 0.3, 0.2]))
    metal = replace(FLOOR, materials=(Material(metallic=1.0, roughness=0.4),))
    tracer = Tracer(metal, RenderSettings(spp=128, max_depth=2), aovs=False, lobes=True)
    found, truth = (
        tracer.trace(Lighting(lights=lights), CAMERA).beauty.mean(axis=(0, 1)) for lights in ((light,), facets(light))
    )
    assert found[0] > 0
    np.testing.assert_allclose(found, truth, rtol=0.02)


def test_nothing_is_lit_from_inside_it() -> None:
    light = tube(np.array([0.0, 0.0, 0.0]), np.array([1.0, 0.0, 0.0]), length=9.0, radius=4.0)
    assert not render(FLOOR, CAMERA, light, spp=4).beauty.any()
