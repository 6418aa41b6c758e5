"""Frames through a lens: the proxy against Mitsuba's own thin lens, and a splat against its circle of confusion."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import mirelight
from mirelight.base import backend
from mirelight.io import splats
from mirelight.io.gltf.write import write_glb
from mirelight.io.image import read
from mirelight.model import Camera, Exposure, Frame, Job, SplatCloud
from mirelight.pipeline.frames import frame
from tests.analytic.lighting_scenes import join, quad

sys.path.append(str(Path(__file__).parents[2] / "scripts"))

LENS = Exposure(aperture_radius=0.12, focus_distance=2.5)
VIEW = replace(Camera.look_at((0, 1.0, 3), (0, 0.4, 0), 48, 32, yfov=45, name="front"), exposure=LENS)
JOB = """
{what}
lights = [{{ type = "point", name = "lamp", position = [1, 2, 1.5], intensity = 10 }}]
resolution = [48, 32]
render = {{ spp = 64, lens_samples = 64, max_depth = 2 }}
[[cameras]]
name = "front"
position = [0, 1.0, 3]
target = [0, 0.4, 0]
aperture_radius = 0.12
focus_distance = 2.5
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two cards, one before and one behind what is in focus, and a small bright splat far out of focus."""
    here = tmp_path_factory.mktemp("lens")
    near, far = quad((-0.4, 0.5, 1.6), (0.3, 0, 0), (0, 0.3, 0)), quad((0.2, 0.6, -2), (0.9, 0, 0), (0, 0.8, 0))
    write_glb(here / "cards.glb", join(near, far), (), ())
    point = VIEW.world_from_camera @ [0, 0, -8, 1]
    one = SplatCloud(
        means=point[None, :3].astype(np.float32),
        quats=np.array([[1, 0, 0, 0]], np.float32),
        scales=np.full((1, 3), 0.08, np.float32),
        opacities=np.full(1, 0.99, np.float32),
        sh=np.full((1, 1, 3), 1.7, np.float32),
    )
    splats.write(one, here / "point.ply")
    return here


def job(folder: Path, what: str, *more: str) -> Job:
    (folder / "job.toml").write_text(JOB.format(what=what))
    return mirelight.load(folder / "job.toml", list(more))


def test_the_lit_proxy_is_that_of_mitsuba_s_thin_lens(folder: Path) -> None:
    import path_oracle as oracle

    cards = job(folder, 'proxy = "cards.glb"')
    camera, lighting = cards.cameras[0], cards.lightings[0]
    assert camera.exposure is not None and camera.exposure.aperture_radius == LENS.aperture_radius
    scene = mirelight.prepare(cards)
    ours, sharp = frame(scene, camera, lighting), frame(scene, camera.pinhole, lighting)
    mi = backend.mitsuba(cards.render.variant, cards.render.threads)
    assert cards.proxy is not None
    world = oracle.scene(mi, cards.proxy.value, lighting, camera)
    light, coverage = oracle.path_beauty(mi, world, spp=1024, max_depth=2, seed=1)
    scale = light[..., 0].max()

    def error(made: Frame) -> float:
        return float(np.sqrt(np.mean((made.rgba[..., 0] - light[..., 0]) ** 2)) / scale)

    assert error(ours) < 0.01 < 0.025 < error(sharp)
    assert np.abs(ours.rgba[..., 3] - coverage).mean() < 0.01
    assert ours.rgba.mean() == pytest.approx(float(np.append(light, coverage[..., None], axis=-1).mean()), rel=0.01)


def test_a_far_splat_becomes_a_disc_of_the_right_radius_and_keeps_its_light(folder: Path) -> None:
    alone = replace(job(folder, 'splats = "point.ply"\nproxy = "cards.glb"'), lightings=(), proxy=None)
    scene, camera = mirelight.prepare(alone), alone.cameras[0]
    made, sharp = frame(scene, camera, None), frame(scene, camera.pinhole, None)
    radius = camera.fx * LENS.aperture_radius * (1 / LENS.focus_distance - 1 / 8)
    y, x = np.mgrid[:32, :48] + 0.5
    away = np.hypot(x - camera.cx, y - camera.cy)
    alpha = made.rgba[..., 3].astype(np.float64)
    assert alpha.sum() == pytest.approx(float(sharp.rgba[..., 3].sum()), rel=0.02)
    spread = float((alpha * away**2).sum() / alpha.sum())
    own = float((sharp.rgba[..., 3] * away**2).sum() / sharp.rgba[..., 3].sum())
    assert spread - own == pytest.approx(radius**2 / 2, rel=0.03)  # of an even disc
    assert alpha[away > radius + 2.5].max() < 0.01 * alpha.max()


def test_a_splat_beside_a_moving_camera_becomes_a_streak_of_the_right_length(folder: Path) -> None:
    alone = replace(job(folder, 'splats = "point.ply"\nproxy = "cards.glb"'), lightings=(), proxy=None)
    scene, camera = mirelight.prepare(alone), alone.cameras[0].pinhole
    length, poses = 14.0, np.stack([camera.world_from_camera] * 2)
    poses[:, :3, 3] += np.array([-0.5, 0.5])[:, None] * camera.world_from_camera[:3, 0] * length * 8 / camera.fx
    made = frame(scene, replace(camera, exposure=Exposure(poses=poses)), None).rgba[..., 3].astype(np.float64)
    sharp = frame(scene, camera, None).rgba[..., 3].astype(np.float64)
    assert made.sum() == pytest.approx(sharp.sum(), rel=0.02)
    x = np.arange(48) + 0.5 - camera.cx

    def spread(alpha: np.ndarray) -> float:
        return float((alpha.sum(axis=0) * x**2).sum() / alpha.sum())

    assert spread(made) - spread(sharp) == pytest.approx(length**2 / 12, rel=0.02)  # of an even line
    row = made.sum(axis=0)[np.abs(x) < length / 2 - 2.5]
    assert row.max() < 1.05 * row.min()
    np.testing.assert_allclose(made.sum(axis=1) / made.sum(), sharp.sum(axis=1) / sharp.sum(), atol=0.01)


def test_files_keep_the_lens_and_what_is_said_of_the_surface_is_sharp(folder: Path) -> None:
    cards = job(folder, 'proxy = "cards.glb"', "render.lens_samples=4", "render.spp=16")
    scene, lighting = mirelight.prepare(cards), cards.lightings[0]
    made = frame(scene, cards.cameras[0], lighting)
    mirelight.write(made, folder / "frame.exr", cards)
    again = read(folder / "frame.exr")
    assert again.camera.exposure is not None
    assert again.camera.exposure.focus_distance == LENS.focus_distance
    assert made.lighting is not None
    np.testing.assert_allclose(made.lighting.beauty, made.rgba[..., :3], rtol=1e-5, atol=1e-6)
    depths = made.lighting.depth[made.lighting.depth > 0]
    middle = made.lighting.coverage
    assert ((middle > 0) & (middle < 1)).mean() > 0.1  # blurred edges
    assert len(np.unique(np.round(depths, 1))) < 30
    assert np.array_equal(frame(scene, cards.cameras[0], lighting).rgba, made.rgba)
