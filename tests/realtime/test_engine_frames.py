"""Whole frames of the profile `playcanvas`, rendered from job files, against the frames that the engine rendered.

Shadows are off on both sides: what shadow maps do is the engine's own error.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from mirelight.apps import realtime
from mirelight.base import colour
from mirelight.compare import CompareSettings, Pair, evaluate
from mirelight.io import job as jobs
from mirelight.io.exr import read_exr
from mirelight.io.gltf.scene import read_scene
from mirelight.io.image import write
from mirelight.io.job.overrides import parse
from mirelight.io.splats import ply
from mirelight.lighting import trace
from mirelight.model import F32, Camera, Deferred, DirectionalLight, Frame, Job, Lighting, RelightSettings
from mirelight.pipeline import stages
from mirelight.pipeline.scene import prepare

LIGHTS = ["stage_dir", "stage_omni_inv", "stage_omni_lin", "stage_spot"]
SPHERE = ["synth_stack", "synth_stack_aces_gamma", "synth_stack_linear"]
EDGE_PIXELS = 2  # that may be covered on one side alone


def decibels(ours: F32, theirs: F32) -> float:
    return float(-10 * np.log10(np.mean((ours[..., :3].astype(np.float64) - theirs[..., :3]) ** 2)))


@cache
def rendered(path: Path) -> tuple[Job, Frame]:
    """The only frame of a job, as `mirelight render` makes it."""
    job = jobs.load(path)
    (camera,) = job.cameras
    return job, stages.frame(prepare(job), camera, job.lightings[0] if job.lightings else None)


def written(frame: Frame, job: Job, path: Path) -> F32:
    """(H, W, 3) the frame's EXR as the engine blends: premultiplied, display-encoded in the gamma pipeline."""
    write(frame, path, job.display, replace(job.output, half=False))
    rgba = read_exr(path).layer()
    if job.compositor.linear:
        return rgba[..., :3]
    alpha = rgba[..., 3:]
    straight = np.divide(rgba[..., :3], alpha, out=np.zeros_like(rgba[..., :3]), where=alpha > 0)
    return np.asarray(colour.power_encode(straight) * alpha, dtype=np.float32)


@pytest.mark.parametrize(
    ("name", "least"),
    [
        *((name, 75.0) for name in LIGHTS),
        *((name, 75.0) for name in SPHERE),
        ("stage_white_env", 75.0),
        ("stage_turned_sky", 75.0),
        ("sphere_sky", 65.0),
        ("synth_sh0", 75.0),
        ("synth_sh3", 75.0),
    ],
)
def test_rendered_frame_is_the_engines(data: Path, tmp_path: Path, name: str, least: float) -> None:
    folder = data / "realtime" / name
    job, frame = rendered(folder / "job.toml")
    ours = written(frame, job, tmp_path / "frame.exr")
    with np.load(folder / "buffers.npz") as buffers:
        theirs = buffers["frame_f32" if job.lightings else "unlit_f32"]
        if name == "stage_white_env":  # recorded with a sky behind the splats, which is not multiplied
            with np.load(data / "realtime" / "stage_omni_lin" / "buffers.npz") as over_nothing:
                ours = ours + buffers["unlit_f32"][..., :3] - over_nothing["unlit_f32"][..., :3]
    assert decibels(ours, theirs) > least


@pytest.mark.parametrize(
    ("name", "bound"),
    [
        *((name, 0.001) for name in LIGHTS),
        *((name, 0.001) for name in SPHERE),
        ("stage_white_env", 0.005),
        ("stage_turned_sky", 0.005),
        ("sphere_sky", 0.03),
    ],
)
def test_rendered_light_is_the_engines(data: Path, name: str, bound: float) -> None:
    _, frame = rendered(data / "realtime" / name / "job.toml")
    assert frame.lighting is not None
    with np.load(data / "realtime" / name / "buffers.npz") as buffers:
        theirs = buffers["relight"]
    covered = theirs[..., 3] > 0.5
    assert np.count_nonzero(covered != (frame.lighting.coverage > 0.5)) <= EDGE_PIXELS
    both = covered & (frame.lighting.coverage > 0.5)
    error = np.abs(frame.lighting.beauty - theirs[..., :3])[both].max(axis=1) / theirs[..., :3].max()
    assert np.percentile(error, 99) < bound


@pytest.mark.parametrize("rotation", [-60, 0, 150])
def test_a_sky_turned_otherwise_is_another(data: Path, rotation: float) -> None:
    path = data / "realtime" / "stage_turned_sky" / "job.toml"
    job = jobs.load(path, [parse(f"environment.rotation={rotation}")])
    with np.load(path.parent / "buffers.npz") as buffers:
        theirs = buffers["relight"]
    assert job.proxy is not None
    ours = trace(job.proxy.value, job.lightings[0], job.cameras[0], job.render).beauty
    error = np.abs(ours - theirs[..., :3])[theirs[..., 3] > 0.5].max(axis=1) / theirs[..., :3].max()
    assert np.percentile(error, 99) > 0.05


def test_layers_add_up_without_noise(data: Path) -> None:
    _, frame = rendered(data / "realtime" / "stage_omni_lin" / "job.toml")
    lighting = frame.lighting
    assert lighting is not None and lighting.variance is not None and frame.noise is not None
    assert lighting.variance.max() == frame.noise.max() == 0
    assert [layer.name for layer in lighting.layers] == ["omni"]
    assert lighting.layers[0].indirect.max() == 0
    assert set(np.unique(lighting.coverage)) == {0, 1}


def test_job_is_predicted_in_the_engines_terms(data: Path) -> None:
    assets = data / "realtime" / "assets"
    mesh = read_scene(assets / "stage.glb").mesh
    assert mesh is not None
    job = Job(
        source=Path("test.toml"),
        splats=Deferred.of(ply.read(assets / "synth_stack.ply")),
        proxy=Deferred.of(mesh),
        relight=RelightSettings(brightness=1.0),
    )
    camera = Camera.look_at((1, 2.5, 5), (0, -0.4, 0), 64, 48, yfov=45, near=0.1, far=100)
    sun = DirectionalLight(name="sun", direction=np.array([0.0, -1.0, 0.0]), intensity=2 * np.pi)
    frame = realtime.engine_frame(job, camera, Lighting(lights=(sun,)))
    assert frame.lighting is not None
    assert frame.factor is not None
    up = (frame.lighting.normal[..., 1] > 0.999) & (frame.lighting.beauty[..., 0] > 0)
    assert up.any()
    np.testing.assert_allclose(frame.factor[up], 1.0, rtol=1e-4)  # albedo 0.5 / pi times 2 pi lux
    assert frame.factor[frame.lighting.coverage == 0].min() == 1


GUITAR = """
profile = "playcanvas"
splats = {{ path = "{assets}/guitar.compressed.ply", transform = {{ rotation_euler = [0, 0, 180] }} }}
resolution = [640, 480]
cameras = [{{ position = [5.4, 2.6, 1.6], target = [0, 2.1, 0], yfov = 45, near = 0.1, far = 100 }}]

[proxy]
path = "{assets}/guitar.proxy.glb"
transform = {{ rotation_euler = [0, 0, 180] }}
albedo = 0.21763764

[[lights]]
type = "playcanvas"
kind = "omni"
color = [1, 0.8, 0.6]
intensity = 4
position = [2.5, 3, 1.5]
range = 6
"""


def test_a_whole_capture(shared: Path, tmp_path: Path) -> None:
    (tmp_path / "job.toml").write_text(GUITAR.format(assets=(shared / "realtime" / "assets").as_posix()))
    job, frame = rendered(tmp_path / "job.toml")
    with np.load(shared / "realtime" / "guitar_omni" / "buffers.npz") as buffers:
        assert decibels(written(frame, job, tmp_path / "frame.exr"), buffers["frame_f32"]) > 64
        assert frame.lighting is not None
        both = (buffers["relight"][..., 3] > 0.5) & (frame.lighting.coverage > 0.5)
        error = np.abs(frame.lighting.beauty - buffers["relight"][..., :3])[both].max(axis=1)
        assert np.percentile(error, 99) < 0.01 * buffers["relight"].max()


def test_the_linear_pipelines_picture_is_encoded_whole(data: Path, tmp_path: Path) -> None:
    """Half-transparent silhouettes: blended in linear light over the background, then encoded, as the back buffer is.

    The engine blends this case in floats, so that its picture is rounded once, as ours.
    """
    folder = data / "realtime" / "synth_stack_linear"
    job, frame = rendered(folder / "job.toml")
    write(frame, tmp_path / "frame.png", job.display, job.output)
    write(frame, tmp_path / "frame.exr", job.display, job.output)
    ours, theirs = (np.asarray(Image.open(x / "frame.png").convert("RGBA"), np.int16) for x in (tmp_path, folder))
    edge = (theirs[..., 3] > 10) & (theirs[..., 3] < 245)
    assert edge.sum() > 10_000
    difference = np.abs(ours - theirs)[..., :3]
    assert np.percentile(difference[edge], 99) <= 1
    assert (difference.max(axis=-1) > 3).mean() < 2e-3  # single fragments at the clip, which dark light makes visible

    for pair in (("frame.exr", folder / "frame.png"), ("frame.png", folder / "frame.png")):
        reference, test = tmp_path / pair[0], Path(pair[1])
        result, _ = evaluate(Pair(name="linear", reference=reference, test=test), CompareSettings())
        assert result.overall.psnr > 57  # rounding alone: 59
    over = replace(job.display, background=(0.8, 0.5, 0.2))
    write(frame, tmp_path / "over.png", over, job.output)
    with np.load(folder / "buffers.npz") as buffers:
        light = buffers["frame_f32"]
    behind = np.array(over.background) ** 2.2 * (1 - light[..., 3:])
    expected = np.clip((light[..., :3] + behind) ** (1 / 2.2), 0, 1) * 255
    picture = np.asarray(Image.open(tmp_path / "over.png"), np.float64)[..., :3]
    assert np.percentile(np.abs(picture - expected), 99.9) < 1.5


def test_a_gain_multiplies_the_light_of_a_linear_back_buffer(data: Path, tmp_path: Path) -> None:
    folder = data / "realtime" / "synth_stack_linear"
    job, frame = rendered(folder / "job.toml")
    write(frame, tmp_path / "frame.exr", replace(job.display, exposure=1.0), job.output)
    settings = CompareSettings(fit_gain=True, exposure=-0.5)
    pair = Pair(name="linear", reference=folder / "frame.png", test=tmp_path / "frame.exr")
    result, _ = evaluate(pair, settings)
    assert abs(np.log2(result.gain) + 0.5) < 0.02
