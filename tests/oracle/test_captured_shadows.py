"""Captured shadows as the splats show them, on a floor whose every splat has a light in closed form."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from mirelight import relighting
from mirelight.base import colour, sh
from mirelight.base.errors import InputError
from mirelight.compositor import Compositor
from mirelight.model import (
    Camera,
    Deferred,
    DirectionalLight,
    Environment,
    Job,
    Lighting,
    LightingBuffer,
    LightLayer,
    OutputSettings,
    ProxyMesh,
    RelightSettings,
    RenderSettings,
    SplatCloud,
)
from mirelight.model.profiles import Per
from mirelight.pipeline import stages
from mirelight.pipeline.scene import prepare

SUN = DirectionalLight(name="sun", direction=np.array([0.6, -0.8, 0.0]), intensity=6.0)
FILL = DirectionalLight(name="fill", direction=np.array([0.0, -1.0, 0.0]), intensity=1.5)
NEW = 4.0  # lux straight from above
EYE = Camera.look_at((0, 3, 0.01), (0, 0, 0), 64, 48, yfov=35, name="above")
WAYS: tuple[Per, ...] = ("pixel", "both")
PLAIN, PAINT = 0.4, 0.12  # albedo of the floor, and of a stripe that is painted on it


def along(x: float) -> ProxyMesh:
    """A floor, and a roof that shades it up to x."""
    corners: list[list[float]] = [[-2, 0, 2], [2, 0, 2], [2, 0, -2], [-2, 0, -2]]
    corners += [[-9, 5, 2], [x - 3.75, 5, 2], [x - 3.75, 5, -2], [-9, 5, -2]]
    faces = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]], np.int32)
    return ProxyMesh(vertices=np.array(corners, np.float32), faces=faces, albedo=np.full(3, 0.5))


def floor() -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """(N, 3) places of splats, (N,) their albedo, (N,) captured irradiance: the shadow ends at x = 0."""
    x, z = (a.ravel() for a in np.meshgrid(np.arange(-1.55, 1.6, 0.1), np.arange(-1.5, 1.6, 0.1)))
    albedo = np.where(np.abs(z - 0.5) < 0.12, PAINT, PLAIN)
    return np.stack([x, 0 * x, z], axis=1), albedo, FILL.intensity + np.where(x > 0, 0.8 * SUN.intensity, 0)


def cloud(shown: NDArray[np.float64]) -> SplatCloud:
    """The floor's splats in a linear gray."""
    at, _, _ = floor()
    display = colour.srgb_encode(np.clip(shown, 0, 1).astype(np.float32))
    fields: dict[str, Any] = {
        "means": at,
        "quats": np.tile([1.0, 0, 0, 0], (len(at), 1)),
        "scales": np.tile([0.07, 0.001, 0.07], (len(at), 1)),
        "opacities": np.full(len(at), 0.95),
        "sh": np.repeat((display[:, None, None] - 0.5) / sh.C0, 3, axis=2),
    }
    return SplatCloud(**fields)


def job(relight: RelightSettings, edge: float = 0.0) -> Job:
    _, albedo, light = floor()
    return Job(
        source=Path("floor.toml"),
        splats=Deferred.of(cloud(albedo * light / np.pi)),
        proxy=Deferred.of(along(edge)),
        cameras=(EYE,),
        lightings=(Lighting(name="noon", lights=(replace(FILL, name="noon", intensity=NEW),)),),
        captured=Lighting(name="captured", lights=(SUN, FILL)),
        render=RenderSettings(spp=16, max_depth=1),
        relight=relight,
    )


def frame(made: Job) -> NDArray[np.float32]:
    return stages.frame(prepare(made), EYE, made.lightings[0]).rgba[..., :3]


@pytest.fixture(scope="module")
def truth() -> NDArray[np.float32]:
    """The splats as they are under the new light."""
    _, albedo, _ = floor()
    return relighting.unlit_rgba(Compositor(cloud(albedo * NEW / np.pi)).composite(EYE))[..., :3]


@pytest.fixture(scope="module")
def frames() -> dict[str, NDArray[np.float32]]:
    ratio = RelightSettings(mode="ratio", delta=1e-4, repair=False)
    return {per: frame(job(replace(ratio, per=per))) for per in WAYS}


def rms(a: NDArray[np.float32], b: NDArray[np.float32], rows: slice, columns: slice) -> float:
    return float(np.sqrt(np.mean((a - b)[rows, columns] ** 2)))


ROWS, EDGE, REST = slice(8, 28), slice(27, 37), slice(44, 60)


def test_no_line_is_left_of_a_captured_shadow(frames: dict[str, Any], truth: NDArray[np.float32]) -> None:
    assert rms(frames["pixel"], truth, ROWS, EDGE) > 0.05
    assert rms(frames["both"], truth, ROWS, EDGE) < 0.3 * rms(frames["pixel"], truth, ROWS, EDGE)


def test_far_from_its_edge_nothing_changes_and_paint_stays(frames: dict[str, Any], truth: NDArray[np.float32]) -> None:
    for columns in (REST, slice(4, 20)):
        for per in WAYS:
            assert rms(frames[per], truth, slice(8, 44), columns) < 0.01
    painted, plain = truth[33:36, REST].min(), truth[ROWS, REST].min()
    assert painted < 0.6 * plain


def test_a_capture_without_lamps_is_relit_as_before() -> None:
    """Light from all around stays with the pixels: not one bit changes."""
    sky = Lighting(name="sky", environment=Environment(radiance=np.ones((1, 1, 3), np.float32)))
    ratio = RelightSettings(mode="ratio", repair=False)
    made = [frame(replace(job(replace(ratio, per=per)), captured=sky)) for per in WAYS]
    np.testing.assert_array_equal(made[0], made[1])


def test_a_stop_while_lamps_are_found_leaves_nothing_to_show(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = prepare(job(RelightSettings(mode="ratio", per="both")))

    def stopped(_: LightingBuffer) -> LightingBuffer:
        raise KeyboardInterrupt

    monkeypatch.setattr(scene, "softened", stopped)
    with pytest.raises(stages.Stopped) as found:
        stages.light(scene, EYE, scene.job.lightings[0])
    assert found.value.lit is None


def test_frames_that_are_mixed_from_pixels_refuse_it() -> None:
    made = replace(job(RelightSettings(mode="ratio", per="both")), output=OutputSettings(store="layers"))
    with pytest.raises(InputError, match=r"relight\.per: light that is found for splats"):
        prepare(made)


# --- pictures made by hand -------------------------------------------------------------------------------------------


def lit(light: NDArray[np.float64], albedo: float = 0.5) -> LightingBuffer:
    """One row, lit by so much (W,)."""
    shown = np.repeat(light[None, :, None] * albedo, 3, axis=2).astype(np.float32)
    one = np.ones((1, len(light)), np.float32)
    up = np.broadcast_to(np.array([0, 1, 0], np.float32), shown.shape)
    return LightingBuffer(
        camera=replace(EYE, width=len(light), height=1),
        coverage=one,
        layers=(LightLayer(name="sun", direct=shown, indirect=0 * shown),),
        depth=one,
        position=up,
        normal=up,
        geometric_normal=up,
        albedo=np.full_like(shown, albedo),
    )


def test_lamps_are_replaced_and_all_else_stays() -> None:
    sun = np.repeat([0.0, 2.0], 20)
    fades = np.clip((np.arange(40) - 15) / 10, 0, 1)
    alpha = np.full((1, 40), 0.8, np.float32)
    alpha[0, :3] = 0
    on_splats = np.repeat((2 * fades * alpha)[..., None], 3, axis=2).astype(np.float32)
    before = lit(0.3 + sun)
    made = relighting.softened(before, lit(sun), on_splats, alpha)
    np.testing.assert_allclose(made.beauty[0, 3:, 0], 0.5 * (0.3 + 2 * fades)[3:], rtol=1e-5)
    np.testing.assert_array_equal(made.beauty[:, :3], before.beauty[:, :3])


def test_what_is_left_beside_a_lamp_is_not_black() -> None:
    """A pixel whose lamp came out brighter than all its light would be divided by nothing."""
    sun = np.zeros(40)
    sun[20] = 2.0
    light = 0.3 + sun
    light[20] = 1.9
    nothing, whole = np.zeros((1, 40, 3), np.float32), np.ones((1, 40), np.float32)
    made = relighting.softened(lit(light), lit(sun), nothing, whole)
    assert made.beauty[0, 20, 0] == pytest.approx(0.5 * 0.5 * 0.3 * 8 / 9, rel=1e-5)


def test_pictures_of_different_sizes_are_refused() -> None:
    few, many = lit(np.ones(4)), lit(np.ones(5))
    with pytest.raises(ValueError, match="sizes"):
        relighting.softened(few, many, np.ones((1, 4, 3), np.float32), np.ones((1, 4), np.float32))
