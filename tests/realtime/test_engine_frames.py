"""Whole frames predicted without the engine, against the frames it rendered: at least 60 dB in float."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mirelight import conventions, realtime, relight, sh
from mirelight.compositor import composite
from mirelight.io.gltf.scene import read_scene
from mirelight.io.splats import compressed_ply, ply
from mirelight.model import (
    F32,
    Camera,
    CompositorSettings,
    DirectionalLight,
    Job,
    Lighting,
    RelightSettings,
    Scene,
    SplatCloud,
)
from mirelight.realtime.predict import engine_buffer

from .engine_cases import read_case

PLAYCANVAS = RelightSettings(profile="playcanvas", space="display")


def decibels(ours: F32, theirs: F32) -> float:
    return float(-10 * np.log10(np.mean((ours[..., :3] - theirs[..., :3]) ** 2)))


def read_splats(folder: Path, assets: Path) -> tuple[SplatCloud, CompositorSettings]:
    """A case's splats where its scene places them, and the engine's settings."""
    scene = json.loads((folder / "scene.json").read_text())
    path = assets / Path(scene["splat"]["file"]).name
    cloud = (compressed_ply if ".compressed." in path.name else ply).read(path)
    turn = conventions.rotation_from_euler(scene["splat"].get("eulerAngles", (0, 0, 0)))
    quats = conventions.multiply_quaternions(conventions.quaternion_from_rotation(turn), cloud.quats)
    large = scene.get("gsplat", {}).get("dataFormat") == "GSPLATDATA_LARGE"
    settings = CompositorSettings(
        profile="playcanvas",
        work_buffer="large" if large else "compact",
        linear=scene.get("pipeline") == "linear",
    )
    placed = replace(cloud, means=cloud.means @ turn.T, quats=quats, sh=sh.rotate(cloud.sh, turn))
    return placed, settings


@pytest.mark.parametrize(
    ("name", "least"),
    [
        ("stage_dir", 80.0),
        ("stage_omni_inv", 75.0),
        ("stage_omni_lin", 80.0),
        ("stage_spot", 80.0),
        ("synth_stack", 80.0),
        ("synth_stack_linear", 80.0),
        ("sphere_sky", 65.0),
        ("guitar_omni", 64.0),
    ],
)
def test_predicted_frame_is_the_engines(shared: Path, name: str, least: float) -> None:
    folder, assets = shared / "realtime" / name, shared / "realtime" / "assets"
    case = read_case(folder, assets)
    cloud, settings = read_splats(folder, assets)
    layer = composite(cloud, case.camera, settings)
    frame = relight.apply(layer, engine_buffer(case.proxy, case.lighting, case.camera), PLAYCANVAS)
    with np.load(folder / "buffers.npz") as buffers:
        assert decibels(realtime.blended(frame), buffers["frame_f32"]) > least


def test_job_is_predicted_in_the_engines_terms(data: Path) -> None:
    assets = data / "realtime" / "assets"
    job = Job(
        source=Path("test.toml"),
        scene=Scene(splats=ply.read(assets / "synth_stack.ply"), proxy=read_scene(assets / "stage.glb").mesh),
        relight=replace(PLAYCANVAS, brightness=1.0),
    )
    camera = Camera.look_at((1, 2.5, 5), (0, -0.4, 0), 64, 48, yfov=45, near=0.1, far=100)
    sun = DirectionalLight(name="sun", direction=np.array([0.0, -1.0, 0.0]), intensity=2 * np.pi)
    frame = realtime.engine_frame(job, camera, Lighting(lights=(sun,)))
    assert frame.lighting is not None
    assert frame.factor is not None
    up = frame.lighting.normal[..., 1] > 0.999
    assert up.any()
    np.testing.assert_allclose(frame.factor[up], 1.0, rtol=1e-4)  # albedo 0.5 / pi times 2 pi lux
    assert frame.factor[frame.lighting.coverage == 0].min() == 1


def test_proxy_with_its_own_colours_is_refused(data: Path) -> None:
    mesh = read_scene(data / "realtime" / "assets" / "stage.glb").mesh
    assert mesh is not None
    job = Job(source=Path("test.toml"), scene=Scene(proxy=replace(mesh, albedo=None)))
    with pytest.raises(ValueError, match="own colours"):
        realtime.engine_frame(job, Camera.look_at((0, 1, 5), (0, 0, 0), 8, 8), Lighting())
