"""The tint against the real engine: its own unlit frame and lighting texture go in, its relit frame must come out."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from mirelight import relighting
from mirelight.base import colour
from mirelight.model import Camera, Frame, LightingBuffer, LightLayer, RelightSettings, SplatLayer

DATA = Path(__file__).parents[1] / "data" / "realtime"
CLEAR_BEHIND = ["synth_stack", "synth_stack_aces_gamma", "synth_stack_linear", "stage_omni_lin", "sphere_sky"]


def load(folder: Path) -> tuple[dict[str, Any], dict[str, NDArray[np.float32]]]:
    with np.load(folder / "buffers.npz") as file:
        buffers = {name: file[name] for name in ("relight", "unlit_f32", "frame_f32")}
    return json.loads((folder / "scene.json").read_text()), buffers


def relit(scene: dict[str, Any], buffers: dict[str, NDArray[np.float32]], **changed: Any) -> Frame:
    unlit, texture = buffers["unlit_f32"], buffers["relight"]
    height, width = unlit.shape[:2]
    view = Camera.look_at(
        scene["camera"]["position"], scene["camera"]["target"], width, height, yfov=scene["camera"]["fov"]
    )
    zero = np.zeros((height, width, 3), dtype=np.float32)
    splats = SplatLayer(
        camera=view,
        color=unlit[..., :3],
        transmittance=1 - unlit[..., 3],
        depth=zero[..., 0],
        median_depth=zero[..., 0],
        profile="playcanvas",
        linear=scene.get("pipeline") == "linear",
    )
    lighting = LightingBuffer(
        camera=view,
        coverage=texture[..., 3],
        layers=(LightLayer(name="texture", direct=texture[..., :3] * texture[..., 3:], indirect=zero),),
        depth=zero[..., 0],
        position=zero,
        normal=zero,
        geometric_normal=zero,
        albedo=zero,
    )
    attributes = scene.get("relighting", {})
    settings = RelightSettings(
        profile="playcanvas",
        blend=changed.get("blend", attributes.get("blend", 1)),
        brightness=attributes.get("brightness", 2),
        background=attributes.get("background", 1),
    )
    return relighting.apply(splats, lighting, settings)


def as_blended(frame: Frame) -> NDArray[np.float32]:
    """The frame's colour in the space that the engine blended in, premultiplied, over nothing."""
    rgb, alpha = frame.rgba[..., :3], frame.rgba[..., 3:]
    assert frame.splats is not None
    if frame.splats.linear:
        return rgb
    straight = np.divide(rgb, alpha, out=np.zeros_like(rgb), where=alpha > 0)
    return colour.power_encode(straight) * alpha


@pytest.mark.parametrize("case", CLEAR_BEHIND)
def test_the_engines_frame_comes_out(case: str) -> None:
    scene, buffers = load(DATA / case)
    frame = relit(scene, buffers)
    assert frame.factor is not None
    error = np.abs(as_blended(frame) - buffers["frame_f32"][..., :3])
    changed = np.abs(buffers["frame_f32"] - buffers["unlit_f32"]).max()
    assert changed > 0.1  # the case shows something
    assert error.max() < 1e-5
    np.testing.assert_allclose(frame.rgba[..., 3], buffers["frame_f32"][..., 3], atol=1e-6)


@pytest.mark.parametrize("case", CLEAR_BEHIND)
def test_blend_zero_is_the_engines_unlit_frame(case: str) -> None:
    scene, buffers = load(DATA / case)
    frame = relit(scene, buffers, blend=0)
    np.testing.assert_allclose(as_blended(frame), buffers["unlit_f32"][..., :3], atol=1e-6)


def test_what_lies_behind_the_splats_is_not_multiplied() -> None:
    """With a sky drawn behind, frame = T sky + splats x factor: the sky's share is as it was in the unlit frame.

    The splats alone come from another case with the same splats and camera, drawn over nothing.
    """
    scene, with_sky = load(DATA / "stage_white_env")
    _, over_nothing = load(DATA / "stage_omni_lin")
    splats = over_nothing["unlit_f32"]
    behind = with_sky["unlit_f32"][..., :3] - splats[..., :3]
    frame = relit(scene, {**with_sky, "unlit_f32": splats})
    predicted = as_blended(frame) + behind
    assert behind.max() > 0.5
    assert np.abs(predicted - with_sky["frame_f32"][..., :3]).max() < 1e-4


def test_a_real_capture(shared: Path) -> None:
    scene, buffers = load(shared / "realtime" / "guitar_omni")
    error = np.abs(as_blended(relit(scene, buffers)) - buffers["frame_f32"][..., :3])
    assert error.max() < 1e-4
