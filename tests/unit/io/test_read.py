"""EXR files read back into the frames that they were written from."""

from __future__ import annotations

import json
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mirelight.base.errors import InputError
from mirelight.base.primaries import INTEROP_IDS, PRIMARIES, REC709, ColorSpace, conversion
from mirelight.io.exr import read_exr, write_exr
from mirelight.io.image import read, write
from mirelight.model import Compression, Frame, LightLayer, OutputSettings, RelightSettings
from mirelight.relighting import apply


def same(a: Any, b: Any, where: str = "frame") -> None:
    """Equal to the bit, dataclasses by field."""
    if isinstance(a, np.ndarray):
        assert isinstance(b, np.ndarray) and a.dtype == b.dtype and a.shape == b.shape, where
        assert a.tobytes() == b.tobytes(), where
    elif hasattr(a, "__dataclass_fields__"):
        assert type(a) is type(b), where
        for field in fields(a):
            same(getattr(a, field.name), getattr(b, field.name), f"{where}.{field.name}")
    elif isinstance(a, tuple):
        assert isinstance(b, tuple) and len(a) == len(b), where
        for k, (x, y) in enumerate(zip(a, b, strict=True)):
            same(x, y, f"{where}[{k}]")
    else:
        assert a == b, where


@pytest.mark.parametrize("compression", ["zip", "none"])
def test_what_is_written_is_read_to_the_bit(frame: Frame, tmp_path: Path, compression: Compression) -> None:
    assert frame.lighting is not None and frame.splats is not None
    plain = replace(frame.lighting, layers=frame.lighting.noisy, noisy=(), spp=7)  # traced, not denoised
    both = tuple(replace(x, variance=x.direct * np.float32(1e-12)) for x in frame.lighting.layers)
    wilder = [
        frame,
        replace(frame, lighting=plain),
        replace(frame, lighting=replace(frame.lighting, layers=both)),
        replace(frame, lighting=replace(plain, layers=(), variance=None)),
        replace(frame, lighting=replace(plain, sun_visibility=None, ambient_occlusion=None, samples=None)),
        replace(frame, splats=replace(frame.splats, profile="playcanvas", linear=True)),
        replace(frame, splats=None, unlit=None, factor=None, profile="playcanvas"),
        replace(frame, lighting=None, noise=None, made_by=None),
        replace(
            frame, camera=replace(frame.camera, projection="orthographic", far=0.1 + 0.2), lighting=None, splats=None
        ),
    ]
    for one in wilder:
        write(one, tmp_path / "a.exr", output=OutputSettings(compression=compression))
        same(one, read(tmp_path / "a.exr"))


@pytest.mark.parametrize("space", [x for x in PRIMARIES if x != "lin_rec709"])
def test_colours_are_stored_in_the_space_asked_for_and_data_as_they_are(
    frame: Frame, tmp_path: Path, space: ColorSpace
) -> None:
    write(frame, tmp_path / "a.exr", output=OutputSettings())
    write(frame, tmp_path / "b.exr", output=OutputSettings(color_space=space))
    plain, other = read_exr(tmp_path / "a.exr"), read_exr(tmp_path / "b.exr")
    assert np.allclose(other.metadata["chromaticities"], PRIMARIES[space], rtol=0, atol=1e-6)
    assert (plain.metadata["colorInteropID"], other.metadata["colorInteropID"]) == (
        "lin_rec709_scene",
        INTEROP_IDS[space],
    )
    matrix = conversion(REC709, PRIMARIES[space])
    colours = {"", "unlit", "lighting", "lighting_noisy", "albedo"}
    for layer in plain.layers:
        old, new = plain.layer(layer), other.layer(layer)
        lit = layer.startswith("light_") and "variance" not in layer
        if layer in colours or lit:
            assert np.allclose(new[..., :3], old[..., :3] @ matrix.T, rtol=1e-5, atol=1e-5), layer
            assert np.array_equal(new[..., 3:], old[..., 3:]), layer
        else:
            assert np.array_equal(new, old), layer
    back = read(tmp_path / "b.exr")
    assert np.allclose(back.rgba, frame.rgba, rtol=1e-5, atol=1e-5)
    assert back.lighting is not None and frame.lighting is not None
    assert np.allclose(back.lighting.layers[0].direct, frame.lighting.layers[0].direct, rtol=1e-5, atol=1e-5)
    assert np.array_equal(back.lighting.position, frame.lighting.position)


def test_layers_on_disk_are_reweighted_as_those_in_memory(frame: Frame, tmp_path: Path) -> None:
    assert frame.lighting is not None
    write(frame, tmp_path / "a.exr", output=OutputSettings(aovs=("variance",)))
    lighting = read(tmp_path / "a.exr").lighting
    assert lighting is not None
    weights: dict[str, float | tuple[float, ...]] = {"Lampe über Tür": (0.5, 2.0, 0.0), "key": 3.0}
    here, there = frame.lighting.reweighted(weights), lighting.reweighted(weights)
    same(here.layers, there.layers)
    same(here.noisy, there.noisy)
    same(here.beauty, there.beauty)
    assert not lighting.depth.any() and not lighting.albedo.any() and lighting.samples is None  # as documented


def test_a_ratio_of_light_without_its_albedo_is_refused(frame: Frame, tmp_path: Path) -> None:
    assert frame.splats is not None
    settings = RelightSettings(mode="ratio")
    for aovs, works in ((("albedo",), True), (("depth",), False)):
        write(frame, tmp_path / "a.exr", output=OutputSettings(aovs=aovs))
        light = read(tmp_path / "a.exr").lighting
        if works:
            assert apply(frame.splats, light, settings, captured=light).factor is not None
        else:
            with pytest.raises(ValueError, match="without 'albedo'"):
                apply(frame.splats, light, settings, captured=light)


def test_lights_named_as_the_files_own_layers_stay_apart(frame: Frame, tmp_path: Path) -> None:
    assert frame.lighting is not None
    names = ("emission", "environment", "key direct", "key", "key_direct", "emission-2", "noisy", "é", "è", "x" * 90)
    rng = np.random.default_rng(3)
    shape = frame.lighting.position.shape
    layers = tuple(
        LightLayer(name=n, **{k: rng.random(shape, np.float32) for k in ("direct", "indirect", "variance")})
        for n in names
    )
    one = replace(frame, lighting=replace(frame.lighting, layers=layers, noisy=layers))
    write(one, tmp_path / "a.exr")
    same(one, read(tmp_path / "a.exr"))


def test_without_layers_all_light_is_one(frame: Frame, tmp_path: Path) -> None:
    assert frame.lighting is not None
    write(frame, tmp_path / "a.exr", output=OutputSettings(layers=False))
    lighting = read(tmp_path / "a.exr").lighting
    assert lighting is not None and [x.name for x in lighting.layers] == ["beauty"] == [x.name for x in lighting.noisy]
    same(lighting.beauty, frame.lighting.beauty)
    same(lighting.noisy_beauty, frame.lighting.noisy_beauty)
    same(lighting.coverage, frame.lighting.coverage)


def test_a_bare_picture_is_a_frame_of_nothing_else(frame: Frame, tmp_path: Path) -> None:
    write(frame, tmp_path / "a.exr", output=OutputSettings(layers=False, aovs=False, half=True))
    found = read(tmp_path / "a.exr")
    assert (found.lighting, found.splats, found.unlit, found.factor, found.noise) == (None,) * 5
    same(found.rgba, frame.rgba.astype(np.float16).astype(np.float32))
    same(found.camera, frame.camera)


def test_files_of_others_and_damaged_metadata_are_one_line(frame: Frame, tmp_path: Path) -> None:
    path = tmp_path / "a.exr"
    write_exr(path, {"": frame.rgba})
    with pytest.raises(InputError, match="not a frame that mirelight wrote"):
        read(path)
    write(frame, tmp_path / "a.png")
    with pytest.raises(InputError, match="a PNG, which holds the displayed picture alone"):
        read(tmp_path / "a.png")
    write(frame, path)
    image = read_exr(path)
    whole = {name: values.astype(np.float32) for name, values in image.channels.items()}
    texts = {name: text for name, text in image.metadata.items() if name.startswith("mirelight/")}
    huge = json.dumps({**json.loads(texts["mirelight/camera"]), "width": 10**9, "height": 10**9})
    broken: list[tuple[dict[str, Any], dict[str, Any]]] = [
        (whole, {"mirelight/camera": "[" * 5000}),
        (whole, {"mirelight/camera": "[]"}),
        (whole, {"mirelight/camera": json.dumps({**json.loads(texts["mirelight/camera"]), "width": 5})}),
        (whole, {"mirelight/camera": json.dumps({**json.loads(texts["mirelight/camera"]), "fx": "wide"})}),
        (whole, {"mirelight/camera": json.dumps({**json.loads(texts["mirelight/camera"]), "height": 10**12})}),
        ({k: v for k, v in whole.items() if "albedo" not in k}, {"mirelight/camera": huge}),
        (whole, {"mirelight/lights": '{"light_key": 5}'}),
        (whole, {"mirelight/sampling": '{"spp": []}'}),
        (whole, {"mirelight/provenance": '{"x": 1}'}),
        (whole, {"mirelight/profile": "{}"}),
        (whole, {"mirelight/lights": '{"light_key": "key", "light_other": "other"}'}),
        ({k: v for k, v in whole.items() if k != "normal.Y"}, {}),
        ({k: v for k, v in whole.items() if k not in "RGB"}, {}),
    ]
    for channels, changed in broken:
        write_exr(path, channels, {**texts, **changed})
        with pytest.raises(InputError) as error:
            read(path)
        assert "\n" not in str(error.value) and str(path) in str(error.value)
