"""The playcanvas profile against frames that the real engine blended in float targets, and its 8-bit back buffer."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from mirelight.base import conventions
from mirelight.compositor import composite, reference
from mirelight.compositor.device import Array, Device
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


def bucket_keys(depth: NDArray[np.float64], corners: NDArray[np.float64]) -> NDArray[np.int64]:
    """The sort keys of the engine's worker: ascending towards the eye, in buckets that are finer near it.

    Args:
        depth: (N,) view z of the centres, negative in front.
        corners: (8,) view z of the corners of the engine's bounding box.
    """
    buckets = 2 ** int(np.clip(round(np.log2(len(depth) / 4)), 10, 20)) + 1
    low, span = corners.min(), np.ptp(corners)
    camera_bin = int(np.clip(np.floor(-low / span * 32), 0, 31))
    tiers = [(0, 40), (2, 20), (5, 8), (10, 3), (31, 1)]
    weights = np.array([next(w for most, w in tiers if abs(i - camera_bin) <= most) for i in range(32)])
    sizes = np.maximum(1, np.floor(weights / weights.sum() * buckets))
    starts = np.concatenate([[0], np.cumsum(sizes)[:-1]])
    place = (depth - low) * 32 / span
    bins = np.clip(np.floor(place).astype(np.int64), 0, 31)
    return np.asarray(np.floor(starts[bins] + sizes[bins] * (place - bins)).astype(np.int64))


def test_what_is_left_of_a_capture_is_mostly_the_engines_sort(shared: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In the engine's own order the frame agrees 6 dB better: exact depths are this compositor's choice."""
    folder = shared / "realtime" / "guitar_omni"
    splats, camera, settings, engine = load(folder)
    recorded = json.loads((folder / "meta.json").read_text())["splat"]
    box = np.array(list(product(*zip(*recorded["aabb"], strict=True))))
    world = np.asarray(recorded["world"])
    back = camera.world_from_camera[:3, 2]
    corners = (box @ world[:3, :3].T + world[:3, 3] - camera.position) @ back
    keys = bucket_keys((splats.means.astype(np.float64) - camera.position) @ back, corners)

    def engine_order(device: Device, _: object, visible: Array) -> Array:
        kept = np.flatnonzero(visible.numpy())
        return device.types.UInt32(kept[np.argsort(-keys[kept], kind="stable")].astype(np.uint32))

    monkeypatch.setattr("mirelight.compositor.compositor.depth_order", engine_order)
    difference = premultiplied(splats, camera, settings)[..., :3].astype(np.float64) - engine[..., :3]
    assert -10 * np.log10(np.mean(difference**2)) > 70
    assert np.abs(difference).max() < 0.03


def test_a_whole_capture_against_the_oracle(shared: Path) -> None:
    splats, camera, _, _ = load(shared / "realtime" / "guitar_omni")
    small = camera.scaled(0.5)  # which takes the oracle a third of the time
    for settings in (CompositorSettings(), CompositorSettings(profile="playcanvas")):
        fast, slow = composite(splats, small, settings), reference.composite(splats, small, settings)
        difference = np.abs(fast.color - slow.color)
        assert -10 * np.log10(np.mean(difference.astype(np.float64) ** 2)) > 100
        assert np.count_nonzero(difference.max(axis=2) > 1e-3) < 20  # thresholds and ties of depth
