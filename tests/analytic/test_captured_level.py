"""The captured light's mean over the surface, where it is known in closed form."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from mirelight.base import sh
from mirelight.lighting import EngineTracer, captured_level
from mirelight.model import Camera, DirectionalLight, Environment, Lighting, ProxyMesh, RenderSettings, SplatCloud

SETTINGS = RenderSettings(max_depth=4, seed=5)
SKY = Lighting(environment=Environment(radiance=np.full((1, 1, 3), 0.8, np.float32)))
SUN = Lighting(lights=(DirectionalLight(name="sun", direction=np.array([0.0, -0.8, 0.6]), intensity=3.0),))


def quads(*corners: tuple[Any, Any, Any]) -> ProxyMesh:
    """Parallelograms of a corner and two edges each; they face along their cross product."""
    v = [[np.add(c, np.zeros(3)), np.add(c, a), np.add(np.add(c, a), b), np.add(c, b)] for c, a, b in corners]
    f = [[[4 * i, 4 * i + 1, 4 * i + 2], [4 * i, 4 * i + 2, 4 * i + 3]] for i in range(len(v))]
    return ProxyMesh(
        vertices=np.concatenate(v).astype(np.float32), faces=np.concatenate(f).astype(np.int32), albedo=np.full(3, 0.5)
    )


def floor(x: float, up: bool = True, size: float = 2.0) -> tuple[Any, Any, Any]:
    a, b = (size, 0, 0), (0, 0, size)
    return ((x, 0, 0), b, a) if up else ((x, 0, 0), a, b)


def splats_over(low: float, high: float, count: int = 900, opacity: float = 0.9) -> SplatCloud:
    """Flat ones on y = 0."""
    rng = np.random.default_rng(int(1000 * high))
    at = np.stack([rng.uniform(low, high, count), np.zeros(count), rng.uniform(0, 2, count)], axis=1)
    fields: dict[str, Any] = {
        "means": at,
        "quats": np.tile([1.0, 0, 0, 0], (count, 1)),
        "scales": np.tile([0.02, 0.001, 0.02], (count, 1)),
        "opacities": np.full(count, opacity),
        "sh": np.full((count, 1, 3), 0.1 / sh.C0),
    }
    return SplatCloud(**fields)


@pytest.mark.parametrize("splats", [None, splats_over(0, 2)])
def test_under_an_even_sky_it_is_the_sky(splats: SplatCloud | None) -> None:
    assert captured_level(splats, quads(floor(0)), SKY, SETTINGS) == pytest.approx(0.8, rel=0.01)


@pytest.mark.parametrize("up", [True, False])
def test_under_a_sun_it_is_its_cosine_whichever_way_faces_are_wound(up: bool) -> None:
    expected = 3.0 * 0.8 / np.pi
    mesh = quads(floor(0, up))
    for splats in (None, splats_over(0, 2)):
        assert captured_level(splats, mesh, SUN, SETTINGS) == pytest.approx(expected, rel=1e-4)


def test_only_what_was_captured_counts_and_by_its_size() -> None:
    """A floor in the sun and one under a roof: splats on one, on both, or on both with other opacities."""
    mesh = quads(floor(0), floor(4), ((3, 3, -6), (5, 0, 0), (0, 0, 12)))
    bright = 3.0 * 0.8 / np.pi
    dark = captured_level(splats_over(4, 6), mesh, SUN, SETTINGS)
    assert dark < 0.1 * bright
    assert captured_level(splats_over(0, 2), mesh, SUN, SETTINGS) == pytest.approx(bright, rel=0.02)

    def both(opacity: float) -> float:
        sunny, shady = splats_over(0, 2, opacity=0.5), splats_over(4, 6, opacity=opacity)
        joined: dict[str, Any] = {
            name: np.concatenate([getattr(sunny, name), getattr(shady, name)])
            for name in ("means", "quats", "scales", "opacities", "sh")
        }
        return captured_level(SplatCloud(**joined), mesh, SUN, SETTINGS)

    assert both(0.5) == pytest.approx((bright + dark) / 2, rel=0.02)
    assert both(0.25) == pytest.approx((2 * bright + dark) / 3, rel=0.02)


def test_the_engine_s_profile_has_the_engine_s_light() -> None:
    """Its directional light of that intensity: the frame's light is intensity times cosine, no pi."""
    engine = replace(SETTINGS, profile="playcanvas")
    mesh = quads(floor(0))
    seen = EngineTracer(mesh, engine).trace(SUN, Camera.look_at((1, 5, 1.001), (1, 0, 1), 9, 9))
    light = seen.beauty[4, 4] / seen.albedo[4, 4]
    assert captured_level(splats_over(0, 2), mesh, SUN, engine) == pytest.approx(float(light.mean()), rel=1e-4)


def test_a_mesh_without_area_has_none() -> None:
    flat = ProxyMesh(vertices=np.zeros((3, 3), np.float32), faces=np.array([[0, 1, 2]], np.int32))
    empty = ProxyMesh(vertices=np.zeros((0, 3), np.float32), faces=np.zeros((0, 3), np.int32))
    for mesh in (flat, empty):
        assert captured_level(None, mesh, SKY, SETTINGS) == 0


def test_it_is_the_same_number_each_time() -> None:
    """Whatever the threads, and not by chance: another seed gives another one."""
    mesh = quads(floor(0), ((-1, 1.5, -1), (2.5, 0, 0), (0, 0, 2.5)))
    one, two, other = (
        captured_level(splats_over(0, 2), mesh, SKY, settings)
        for settings in (*(replace(SETTINGS, threads=n) for n in (1, 2)), replace(SETTINGS, seed=6))
    )
    assert one == two != other
    assert other == pytest.approx(one, rel=0.05)
