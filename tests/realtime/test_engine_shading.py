"""The NumPy model of the engine's lights against what the engine wrote into its relighting texture."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mirelight.base import conventions
from mirelight.lighting.engine.ambient import ambient_light, ambient_tile
from mirelight.lighting.engine.raster import rasterise
from mirelight.model import F32, Camera, Environment, ProxyMesh
from mirelight.model.playcanvas_lights import EngineLight, EngineLighting

from .engine_cases import Case, read_case, texture

EDGE_PIXELS = 2  # pixels on silhouettes that may be decided the other way


def p99(case: Case) -> float:
    """99th percentile of the error inside both coverages, relative to the brightest light."""
    ours = texture(case.proxy, case.camera, case.lighting)
    covered, seen = case.relight[..., 3] > 0.5, ours[..., 3] > 0.5
    assert np.count_nonzero(covered != seen) <= EDGE_PIXELS
    both = covered & seen
    error = np.abs(ours - case.relight)[both][:, :3].max(axis=1)
    return float(np.percentile(error, 99) / case.relight[..., :3].max())


@pytest.mark.parametrize("name", ["stage_dir", "stage_omni_inv", "stage_omni_lin", "stage_spot"])
def test_lights_agree_with_the_engine(data: Path, name: str) -> None:
    assert p99(read_case(data / "realtime" / name, data / "realtime" / "assets")) < 0.001


def test_constant_environment_agrees_with_the_engine(data: Path) -> None:
    assert p99(read_case(data / "realtime" / "stage_white_env", data / "realtime" / "assets")) < 0.001


@pytest.mark.parametrize(("name", "bound"), [("synth_stack", 0.001), ("sphere_sky", 0.03), ("stage_turned_sky", 0.005)])
def test_smooth_meshes_and_skies_agree_with_the_engine(data: Path, name: str, bound: float) -> None:
    assert p99(read_case(data / "realtime" / name, data / "realtime" / "assets")) < bound


def test_a_capture_agrees_with_the_engine(shared: Path) -> None:
    assert p99(read_case(shared / "realtime" / "guitar_omni", shared / "realtime" / "assets")) < 0.002


def test_shadowed_case_agrees_where_it_is_lit(shared: Path) -> None:
    case = read_case(shared / "realtime" / "stage_dir_pcss", shared / "realtime" / "assets")
    ours = texture(case.proxy, case.camera, case.lighting)
    lit = (case.relight[..., 3] > 0.5) & (ours[..., 3] > 0.5) & (ours[..., 0] > 0.02)
    ratio = case.relight[lit][:, :3] / ours[lit][:, :3]
    assert np.median(ratio) == pytest.approx(1, abs=1e-3)
    assert np.percentile(ratio, 99) < 1.001  # shadows only take away


# --- the parts, by closed forms --------------------------------------------------------------------------------------

FLOOR = ProxyMesh(
    vertices=np.array([[-5, 0, -5], [-5, 0, 5], [5, 0, 5], [5, 0, -5]], dtype=np.float32),
    faces=np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32),
)
ABOVE = Camera.look_at((0, 4, 0), (0, 0, 0), 41, 41, yfov=60)


def centre(lighting: EngineLighting, diffuse: float = 1.0) -> F32:
    """The floor's light straight below the origin."""
    return texture(FLOOR, ABOVE, lighting, diffuse)[20, 20, :3]


def omni(**changed: object) -> EngineLighting:
    values: dict[str, object] = {"name": "lamp", "kind": "omni", "position": (0.0, 2.0, 0.0), "intensity": 3.0}
    return EngineLighting(lights=(EngineLight(**(values | changed)),))  # type: ignore[arg-type]


def test_linear_falloff_and_no_division_by_pi() -> None:
    np.testing.assert_allclose(centre(omni(range=8.0)), 3 * (8 - 2) / 8, rtol=1e-6)


def test_inverse_squared_falloff() -> None:
    window = (1 - (2 / 8) ** 4) ** 2
    expected = 3 * 16 / (2**2 + 1) * window
    np.testing.assert_allclose(centre(omni(range=8.0, falloff="inverse-squared")), expected, rtol=1e-6)


def test_colour_is_decoded_before_or_after_the_intensity() -> None:
    bright = centre(omni(range=1e9, color=(0.5, 1.0, 0.25), intensity=2.0))
    np.testing.assert_allclose(bright, 2 * np.array([0.5, 1.0, 0.25]) ** 2.2, rtol=1e-5)
    dim = centre(omni(range=1e9, color=(0.5, 1.0, 0.25), intensity=0.5))
    np.testing.assert_allclose(dim, (0.5 * np.array([0.5, 1.0, 0.25])) ** 2.2, rtol=1e-5)


def test_diffuse_one_half_is_an_albedo_of_0_2176() -> None:
    sun = EngineLighting(lights=(EngineLight(name="sun", kind="directional", intensity=1.0),))
    np.testing.assert_allclose(centre(sun, 0.5), 0.5**2.2, rtol=1e-6)


def test_spot_cone_is_shrunk_and_smooth() -> None:
    aimed = {"kind": "spot", "range": 1e9, "direction": (np.sin(np.radians(20)), -np.cos(np.radians(20)), 0.0)}
    inner, outer = np.cos(np.radians(15 * 0.99)), np.cos(np.radians(30 * 0.99))
    t = (np.cos(np.radians(20)) - outer) / (inner - outer)
    found = centre(omni(inner_cone_angle=15.0, outer_cone_angle=30.0, **aimed))
    np.testing.assert_allclose(found, 3 * t * t * (3 - 2 * t), rtol=1e-5)
    assert centre(omni(inner_cone_angle=5.0, outer_cone_angle=15.0, **aimed)).max() == 0


def test_ambient_is_decoded_and_a_constant_environment_is_one() -> None:
    ambient = np.array([0.2, 0.4, 0.8])
    np.testing.assert_allclose(centre(EngineLighting(ambient=ambient)), ambient**2.2, rtol=1e-6)
    gray = Environment(radiance=np.full((1, 1, 3), 0.7, dtype=np.float32), intensity=3.0)
    np.testing.assert_allclose(centre(EngineLighting(environment=gray)), 2.1, rtol=1e-6)


def test_an_environments_light_is_stored_in_eight_bits() -> None:
    white = Environment(radiance=np.ones((4, 8, 3), dtype=np.float32), intensity=0.7)
    np.testing.assert_allclose(centre(EngineLighting(environment=white)), 0.7 * 256 / 255, rtol=0.004)


@pytest.mark.parametrize("rotation", [0.0, 90.0, 200.0])
def test_a_patch_of_sky_lights_what_faces_it(rotation: float) -> None:
    # u = 0.625 looks half way between +X (0.5) and +Z (0.75); the rotation turns it counter-clockwise about +Y.
    sky = np.zeros((64, 128, 3), dtype=np.float32)
    sky[31:33, 80] = 100
    angles = np.radians(np.arange(0, 360, 3))
    around = np.stack([np.cos(angles), np.zeros_like(angles), -np.sin(angles)], axis=-1)  # counter-clockwise about +Y
    light = ambient_light(Environment(radiance=sky, rotation=rotation), around)[:, 0]
    start = conventions.unit((1.0, 0.0, 1.0))
    expected = conventions.rotation_from_euler((0.0, rotation, 0.0)) @ start
    assert around[light.argmax()] @ expected > np.cos(np.radians(5))
    assert light[around @ expected < -0.5].max() < 0.01 * light.max()


def test_gradient_sky_has_the_closed_form() -> None:
    # radiance 1 + y has E(n) / pi = 1 + 2 n_y / 3
    rows = np.cos(np.pi * (np.arange(128) + 0.5) / 128)
    sky = np.broadcast_to((1 + rows)[:, None, None], (128, 256, 3)).astype(np.float32)
    tile = ambient_tile(Environment(radiance=sky))
    up = np.sin(np.pi / 2 * (1 - 2 * (np.arange(30) + 0.5) / 30))
    expected = np.broadcast_to((1 + 2 * up / 3)[:, None], (30, 62))
    np.testing.assert_allclose(tile[1:-1, 1:-1, 1], expected * 256 / 255, rtol=0.025)  # coarse mip levels leak


# --- the rasteriser --------------------------------------------------------------------------------------------------


def test_positions_lie_on_their_pixels_rays() -> None:
    camera = Camera.look_at((1, 3, 2), (0.3, 0, -0.2), 60, 44, yfov=50)
    surface = rasterise(FLOOR, camera)
    y, x = np.nonzero(surface.coverage)
    view = (surface.position[y, x] - camera.position) @ camera.world_from_camera[:3, :3]
    np.testing.assert_allclose(camera.cx - camera.fx * view[:, 0] / view[:, 2], x + 0.5, atol=1e-3)
    np.testing.assert_allclose(camera.cy + camera.fy * view[:, 1] / view[:, 2], y + 0.5, atol=1e-3)
    np.testing.assert_allclose(surface.depth[y, x], -view[:, 2], rtol=1e-5)
    np.testing.assert_allclose(surface.position[y, x, 1], 0, atol=1e-5)


def test_back_faces_are_culled_and_the_nearest_wins() -> None:
    shelf = FLOOR.vertices * np.float32(0.1) + np.array([0, 1, 0], dtype=np.float32)
    both = ProxyMesh(
        vertices=np.concatenate([FLOOR.vertices, shelf]), faces=np.concatenate([FLOOR.faces, FLOOR.faces + 4])
    )
    assert rasterise(both, ABOVE).depth[20, 20] == pytest.approx(3)
    assert not rasterise(both, Camera.look_at((0, -4, 0), (0, 0, 0), 41, 41)).coverage.any()


def test_triangles_through_the_eyes_plane_are_seen() -> None:
    inside = Camera.look_at((0, 1, 0), (0, 1, -5), 64, 64, yfov=80)  # the floor passes below and behind
    surface = rasterise(FLOOR, inside)
    assert surface.coverage[50:, 32].all()
    assert not surface.coverage[:32].any()
    assert surface.position[63, 32, 2] == pytest.approx(-1 / np.tan(np.radians(40)) * (32 / 31.5), rel=1e-3)
