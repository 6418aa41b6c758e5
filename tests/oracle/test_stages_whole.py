"""The pipeline with the real compositor and tracer, on a wall of splats before a wall of proxy."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mirelight.model import (
    Camera,
    Deferred,
    DirectionalLight,
    Frame,
    Job,
    Lighting,
    ProxyMesh,
    RelightSettings,
    RenderSettings,
    SplatCloud,
)
from mirelight.pipeline import stages
from mirelight.pipeline.scene import prepare

W, H = 24, 16


def wall_of_splats() -> SplatCloud:
    x, y = np.meshgrid(np.linspace(-1.5, 1.5, 31), np.linspace(-1, 1, 21))
    n = x.size
    rng = np.random.default_rng(0)
    fields: dict[str, Any] = {
        "means": np.stack([x.ravel(), y.ravel(), np.zeros(n)], axis=1),
        "quats": np.tile([1, 0, 0, 0], (n, 1)),
        "scales": np.tile([0.06, 0.06, 1e-3], (n, 1)),
        "opacities": np.full(n, 0.95),
        "sh": rng.uniform(-1, 1, (n, 1, 3)),
    }
    return SplatCloud(**fields)


def wall() -> ProxyMesh:
    corners: Any = np.array([[-2, -1.5, 0], [2, -1.5, 0], [2, 1.5, 0], [-2, 1.5, 0]])
    return ProxyMesh(vertices=corners, faces=np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32))


def light(name: str, lux: float, towards: tuple[float, float, float] = (0, 0, -1)) -> Lighting:
    sun = DirectionalLight(name="sun", direction=np.asarray(towards, dtype=np.float64), intensity=lux)
    return Lighting(name=name, lights=(sun,))


def render(settings: RelightSettings) -> dict[str, Frame]:
    job = Job(
        source=Path("wall.toml"),
        splats=Deferred.of(wall_of_splats()),
        proxy=Deferred.of(wall()),
        cameras=(Camera.look_at((0, 0, 3), (0, 0, 0), W, H, yfov=30, name="front"),),
        lightings=(light("same", np.pi), light("double", 2 * np.pi), light("slanted", np.pi, (0, -1, -1))),
        captured=light("captured", np.pi),
        render=RenderSettings(spp=16, max_depth=2),
        relight=settings,
    )
    scene = prepare(job)
    return {x.name: stages.frame(scene, job.cameras[0], x) for x in job.lightings}


@pytest.fixture(scope="module")
def tints() -> dict[str, Frame]:
    return render(RelightSettings(mode="tint"))


@pytest.fixture(scope="module")
def ratios() -> dict[str, Frame]:
    return render(RelightSettings(mode="ratio", delta=0.0))


@pytest.mark.parametrize(("name", "factor"), [("same", 1.0), ("double", 2.0), ("slanted", 0.5**0.5)])
def test_a_gray_proxy_under_pi_lux_tints_by_one(tints: dict[str, Frame], name: str, factor: float) -> None:
    """Albedo 0.5 under E lux shows 0.5 E / pi; brightness 2 makes that E / pi."""
    frame = tints[name]
    assert frame.unlit is not None
    np.testing.assert_allclose(frame.rgba[..., :3], factor * frame.unlit[..., :3], rtol=2e-3, atol=1e-6)
    assert frame.unlit[..., :3].std() > 0.05


@pytest.mark.parametrize(("name", "factor"), [("same", 1.0), ("double", 2.0), ("slanted", 0.5**0.5)])
def test_the_ratio_is_that_of_the_lights(ratios: dict[str, Frame], name: str, factor: float) -> None:
    frame = ratios[name]
    assert frame.unlit is not None
    np.testing.assert_allclose(frame.rgba[..., :3], factor * frame.unlit[..., :3], rtol=1e-4, atol=1e-6)
