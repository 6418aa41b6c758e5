"""The scalar variant, which shares no kernel with the others, gives the same buffer."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mirelight.errors import RenderError
from mirelight.lighting import Tracer
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


def traced(variant: str) -> LightingBuffer:
    settings = RenderSettings(spp=64, max_depth=3, variant=variant)  # type: ignore[arg-type]
    return Tracer(CORNER, settings).trace(LIGHTING, CAMERA)


def test_scalar_and_llvm_agree_layer_by_layer() -> None:
    fast, slow = traced("llvm_ad_rgb"), traced("scalar_rgb")
    assert [x.name for x in fast.layers] == [x.name for x in slow.layers]
    for a, b in zip(fast.layers, slow.layers, strict=True):
        assert a.direct.mean() == pytest.approx(b.direct.mean(), rel=0.01)
        assert a.total.mean() == pytest.approx(b.total.mean(), rel=0.01)
        assert a.indirect.mean() == pytest.approx(b.indirect.mean(), rel=0.15)  # a small difference of large ones
    inside = (fast.coverage == 1) & (slow.coverage == 1)
    assert np.mean((fast.coverage == 1) != (slow.coverage == 1)) < 0.02
    np.testing.assert_allclose(fast.normal[inside], slow.normal[inside], atol=0.2)  # a crease inside a pixel
    assert np.abs(fast.position - slow.position)[inside].mean() < 0.02
    assert np.abs(fast.depth - slow.depth)[inside].mean() < 0.02


def test_a_lamp_that_mitsuba_lacks_is_refused_by_name() -> None:
    lamp = PointLight(name="bulb", position=np.ones(3), radius=0.1, range=2.0)
    tracer = Tracer(CORNER, RenderSettings(spp=1, variant="scalar_rgb"))
    with pytest.raises(RenderError, match="'bulb'"):
        tracer.trace(replace(LIGHTING, lights=(lamp,)), CAMERA)
