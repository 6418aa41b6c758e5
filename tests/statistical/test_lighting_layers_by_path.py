"""Mitsuba's `path`, light by light, gives the same buffer."""

from __future__ import annotations

import numpy as np
import pytest
from ztest import worst_and_allowed

from mirelight.lighting import Tracer
from mirelight.lighting.layers import Layers
from mirelight.model import (
    Camera,
    DirectionalLight,
    Environment,
    Lighting,
    LightingBuffer,
    PointLight,
    ProxyMesh,
    RenderSettings,
    SunLight,
)

from .by_path import trace_by_path

SEEDS = 8

VERTICES = [[-2, 0, -2], [2, 0, -2], [2, 0, 2], [-2, 0, 2], [-2, 0, -1], [2, 0, -1], [2, 2, -1], [-2, 2, -1]]
CORNER = ProxyMesh(
    vertices=np.array(VERTICES, np.float32), faces=np.array([[0, 2, 1], [0, 3, 2], [4, 5, 6], [4, 6, 7]], np.int32)
)
CAMERA = Camera(  # off-centre, non-square pixels: Mitsuba has no sensor for it
    world_from_camera=Camera.look_at([0.5, 1.5, 4], [0, 0.4, 0], 4, 4).world_from_camera,
    width=24,
    height=16,
    fx=20.0,
    fy=18.0,
    cx=10.5,
    cy=9.0,
)
LIGHTING = Lighting(
    lights=(
        DirectionalLight(name="key", direction=np.array([0.3, -1, -0.5]), intensity=2.0),
        PointLight(name="lamp", position=np.array([1.0, 1, 0.5]), intensity=2.0, range=3.0),
        SunLight(name="sun", direction=np.array([-0.3, -1, -0.2]), intensity=1.0, angular_diameter=10.0),
    ),
    environment=Environment(radiance=np.full((1, 1, 3), 0.4, np.float32)),
)


def traced(spp: int, seed: int = 0) -> LightingBuffer:
    return Tracer(CORNER, RenderSettings(spp=spp, max_depth=3, seed=seed)).trace(LIGHTING, CAMERA)


def by_path(spp: int, seed: int = 0) -> LightingBuffer:
    settings = RenderSettings(spp=spp, max_depth=3, seed=seed)
    return trace_by_path(CORNER, LIGHTING, CAMERA, settings, Layers.of(LIGHTING, emissive=False), emission=False)


def test_they_agree_layer_by_layer() -> None:
    """By z-test over independent seeds: every layer's direct light and its whole."""
    fast, slow = ([make(16, seed) for seed in range(SEEDS)] for make in (traced, by_path))
    names = [x.name for x in slow[0].layers]
    assert [x.name for x in fast[0].layers] == names and len(names) == 4
    for index, name in enumerate(names):
        for part in ("direct", "total"):
            a, b = (
                np.stack([getattr(x.layers[index], part).astype(np.float64) for x in runs]) for runs in (fast, slow)
            )
            worst, allowed = worst_and_allowed(a, b)
            assert worst < allowed, f"{name}, {part}: |t| = {worst:.2f}, chance allows {allowed:.2f}"
            assert a.mean() == pytest.approx(b.mean(), rel=0.01)


def test_they_see_the_same_surface() -> None:
    fast, slow = traced(64), by_path(64)
    inside = (fast.coverage == 1) & (slow.coverage == 1)
    assert np.mean((fast.coverage == 1) != (slow.coverage == 1)) < 0.02
    np.testing.assert_allclose(fast.normal[inside], slow.normal[inside], atol=0.2)  # a crease inside a pixel
    assert np.abs(fast.position - slow.position)[inside].mean() < 0.02
    assert np.abs(fast.depth - slow.depth)[inside].mean() < 0.02
