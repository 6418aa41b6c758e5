"""The playcanvas profile against frames that the real engine blended in float targets, and its 8-bit back buffer."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from mirelight import conventions
from mirelight.compositor import composite, reference
from mirelight.io import splats as splat_files
from mirelight.io.splats.edit import transform
from mirelight.model import Camera, CompositorSettings, SplatCloud

SYNTHETIC = ["synth_sh0", "synth_sh3", "synth_stack", "synth_stack_aces_gamma", "synth_stack_linear", "sphere_sky"]


def load(folder: Path) -> tuple[SplatCloud, Camera, CompositorSettings, NDArray[np.float32]]:
    """A recorded case in mirelight's terms, and the frame without relighting, premultiplied RGBA."""
    scene: dict[str, Any] = json.loads((folder / "scene.json").read_text())
    splats = splat_files.read(folder / scene["splat"]["file"])
    turn = conventions.rotation_from_euler(scene["splat"].get("eulerAngles", (0, 0, 0)))
    view = scene["camera"]
    camera = Camera.look_at(
        view["position"], view["target"], scene["width"], scene["height"], yfov=view["fov"], near=view["near"]
    )
    settings = CompositorSettings(
        profile="playcanvas",
        work_buffer="large" if scene.get("gsplat", {}).get("dataFormat") == "GSPLATDATA_LARGE" else "compact",
        linear=scene.get("pipeline") == "linear",
        tone=scene.get("toneMapping", "none"),
        exposure=scene.get("exposure", 1.0),
    )
    with np.load(folder / "buffers.npz") as buffers:
        return transform(splats, conventions.compose(rotation=turn)), camera, settings, buffers["unlit_f32"]


def premultiplied(splats: SplatCloud, camera: Camera, settings: CompositorSettings) -> NDArray[np.float32]:
    """What the compositor makes of it, RGBA."""
    layer = composite(splats, camera, settings)
    return np.concatenate([layer.color, 1 - layer.transmittance[..., None]], axis=2)


@pytest.mark.parametrize("name", SYNTHETIC)
def test_stacks_of_a_few_splats(data: Path, name: str) -> None:
    splats, camera, settings, engine = load(data / "realtime" / name)
    difference = np.abs(premultiplied(splats, camera, settings) - engine)
    assert difference.mean() < 2e-5
    # one fragment at the engine's alpha clip changes a pixel by up to 1/255 and a little more with what lies behind
    assert difference.max() < 1.6 / 255
    assert np.count_nonzero(difference.max(axis=2) > 1e-3) < 0.007 * difference[..., 0].size


@pytest.mark.parametrize("name", SYNTHETIC)
def test_the_oracle_agrees_as_well(data: Path, name: str) -> None:
    splats, camera, settings, engine = load(data / "realtime" / name)
    layer = reference.composite(splats, camera, settings)
    assert np.abs(layer.color - engine[..., :3]).mean() < 2e-5


@pytest.mark.parametrize(
    "changed",
    [
        {"work_buffer": "compact"},
        {"min_pixel_size": 150.0},
        {"alpha_clip": 0.02},
        {"linear": True},
        {"tone": "aces"},
        {"profile": "physical"},
    ],
    ids=lambda changed: next(iter(changed)),
)
def test_every_convention_shows_in_the_frame(data: Path, changed: dict[str, Any]) -> None:
    """The frames are sharp enough to tell each setting from its neighbour."""
    splats, camera, settings, engine = load(data / "realtime" / "synth_stack")
    right = np.abs(premultiplied(splats, camera, settings) - engine).mean()
    wrong = np.abs(premultiplied(splats, camera, replace(settings, **changed)) - engine).mean()
    assert wrong > 3 * right


def test_rounding_after_every_splat_explains_the_back_buffer(data: Path) -> None:
    folder = data / "realtime" / "synth_stack"
    splats, camera, settings, _ = load(folder)
    with Image.open(folder / "unlit.png") as picture:
        levels = np.asarray(picture)[..., :3].astype(np.float64)
    rounded_once = np.round(np.clip(composite(splats, camera, settings).color, 0, 1) * 255)
    rounded_always = composite(splats, camera, replace(settings, eight_bit=True)).color * 255
    assert (np.abs(rounded_always - levels) < 0.5).mean() > 0.995
    assert np.abs(rounded_always - levels).max() < 1.5
    assert np.abs(rounded_always - levels).mean() < 0.15 * np.abs(rounded_once - levels).mean()


def test_a_whole_capture(shared: Path) -> None:
    splats, camera, settings, engine = load(shared / "realtime" / "guitar_omni")
    assert settings.work_buffer == "compact"
    picture = premultiplied(splats, camera, settings)
    psnr = -10 * np.log10(np.mean((picture[..., :3].astype(np.float64) - engine[..., :3]) ** 2))
    assert psnr > 63
    assert np.abs(picture[..., 3] - engine[..., 3]).mean() < 1e-4


def test_a_whole_capture_against_the_oracle(shared: Path) -> None:
    splats, camera, _, _ = load(shared / "realtime" / "guitar_omni")
    for settings in (CompositorSettings(), CompositorSettings(profile="playcanvas")):
        fast, slow = composite(splats, camera, settings), reference.composite(splats, camera, settings)
        difference = np.abs(fast.color - slow.color)
        assert -10 * np.log10(np.mean(difference.astype(np.float64) ** 2)) > 100
        assert np.count_nonzero(difference.max(axis=2) > 1e-3) < 20  # thresholds and ties of depth
