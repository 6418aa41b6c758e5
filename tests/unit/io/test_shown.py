"""Objects of the model in a console and in a notebook."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from mirelight.base import colour
from mirelight.io.exr import ExrImage, read_exr
from mirelight.io.image import write
from mirelight.model import (
    Camera,
    Environment,
    Frame,
    Lighting,
    Material,
    PointLight,
    ProxyMesh,
    SplatCloud,
    shown,
)
from mirelight.model.deferred import Deferred

from .conftest import make_frame

NOTHING = np.zeros((0, 3), np.float32)


def objects(tmp_path: Path) -> list[Any]:
    frame = make_frame()
    assert frame.lighting is not None and frame.splats is not None
    write(frame, tmp_path / "a.exr")
    lights = tuple(PointLight(name=f"lamp {k}", position=np.zeros(3)) for k in range(500))
    sky = Environment(radiance=np.ones((4, 8, 3), np.float32))
    cloud = SplatCloud(
        means=np.ones((9, 3), np.float32),
        quats=np.ones((9, 4), np.float32),
        scales=np.ones((9, 3), np.float32),
        opacities=np.ones(9, np.float32),
        sh=np.ones((9, 4, 3), np.float32),
    )
    return [
        frame,
        replace(frame, lighting=None, splats=None, unlit=None, factor=None, noise=None, made_by=None),
        frame.lighting,
        replace(frame.lighting, layers=()),
        frame.lighting.layers[0],
        frame.splats,
        frame.camera,
        read_exr(tmp_path / "a.exr"),
        ExrImage({}, {}),
        Lighting(name="night", lights=lights, environment=sky),
        Lighting(),
        sky,
        Environment(radiance=Deferred("ab" * 32, lambda: np.ones((1, 1, 3), np.float32))),
        cloud,
        ProxyMesh(vertices=NOTHING, faces=NOTHING.astype(np.int32)),
        ProxyMesh(vertices=np.eye(3, dtype=np.float32), faces=np.array([[0, 1, 2]], np.int32), albedo=None),
        Material(base_color_texture=np.ones((5, 6, 3), np.float32)),
    ]


def test_a_line_or_two_and_no_arrays(tmp_path: Path) -> None:
    for thing in objects(tmp_path):
        said = repr(thing)
        assert said.startswith(f"{type(thing).__name__}("), said
        assert said.count("\n") <= 1 and len(said) < 400 and all(len(line) <= 200 for line in said.splitlines()), said
        assert "array" not in said and "dtype" not in said, said


def test_what_the_lines_say(frame: Frame, tmp_path: Path) -> None:
    dark = replace(frame, rgba=np.zeros_like(frame.rgba))
    assert repr(dark).startswith("Frame('front', 20 x 12 under 'night', physical: alpha 0 %, light 0 to 0;")
    assert "unlit, factor, noise, splats, lighting in 3 layers" in repr(dark)
    assert "(key, Lampe über Tür, environment)" in repr(frame.lighting)
    broken = frame.rgba.copy()
    broken[0, 0, 0], broken[0, 0, 1] = np.nan, np.inf
    assert "(2 not finite)" in repr(replace(frame, rgba=broken))
    assert repr(Lighting()) == "Lighting('lighting': no lights)"
    assert "500 lights (lamp 0, lamp 1, lamp 2, lamp 3, lamp 4, lamp 5 and 494 more)" in repr(objects(tmp_path)[9])
    assert shown.span(np.zeros(0)) == "empty" and shown.span([np.nan]) == "nothing finite"
    eye = Camera.look_at([0, 0, 3], [0, 0, 0], 8, 6, name="eye")
    assert repr(eye).endswith("at (0, 0, 3), looks along (0, 0, -1))") or "looks along (-0, -0, -1)" in repr(eye)


@pytest.mark.parametrize("profile", ["physical", "playcanvas"])
def test_notebooks_show_the_displayed_picture(frame: Frame, profile: Any) -> None:
    assert frame.lighting is not None and frame.splats is not None
    one = replace(frame, splats=None, profile=profile)
    rgb, alpha = frame.rgba[..., :3], frame.rgba[..., 3:]
    own = np.divide(rgb, alpha, out=np.zeros_like(rgb), where=alpha > 0)
    curve = colour.power_encode(own) if profile == "playcanvas" else colour.srgb_encode(own)
    assert np.abs(decoded(one._repr_png_()) - 255.0 * np.clip(curve * alpha, 0, 1)).max() <= 0.501
    layer = frame.lighting.layers[1]
    assert np.abs(decoded(layer._repr_png_()) - 255.0 * np.clip(colour.srgb_encode(layer.total), 0, 1)).max() <= 0.501
    assert decoded(frame.lighting._repr_png_()).shape == (12, 20, 3)


def decoded(png: bytes) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    with Image.open(io.BytesIO(png), formats=("PNG",)) as image:
        assert image.mode == "RGB"
        return np.asarray(image)
