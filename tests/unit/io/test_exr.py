"""Frames as OpenEXR: layers, precision, metadata, resuming."""

from __future__ import annotations

import errno
import json
import os
import resource
from dataclasses import replace
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np
import OpenEXR
import pytest

from mirelight.base.errors import InputError, OutputError
from mirelight.io.exr import read_exr, write_exr
from mirelight.io.frame_texts import layer_names, world_to_camera, world_to_ndc
from mirelight.io.image import read_fingerprint, write
from mirelight.model import F32, Camera, Frame, OutputSettings

Projection: TypeAlias = Literal["perspective", "orthographic"]


def test_every_layer_comes_back_bit_for_bit(frame: Frame, tmp_path: Path) -> None:
    write(frame, tmp_path / "a.exr")
    image = read_exr(tmp_path / "a.exr")
    lighting, splats = frame.lighting, frame.splats
    assert lighting is not None and splats is not None and lighting.variance is not None
    expected = {
        "": frame.rgba,
        "unlit": frame.unlit,
        "factor": frame.factor,
        "noise": frame.noise,
        "lighting": np.concatenate([lighting.beauty, lighting.coverage[..., None]], axis=-1),
        "lighting_noisy": lighting.noisy_beauty,
        "depth": lighting.depth[..., None],
        "position": lighting.position,
        "normal": lighting.normal,
        "geometric_normal": lighting.geometric_normal,
        "albedo": lighting.albedo,
        "sun_visibility": _plane(lighting.sun_visibility),
        "ambient_occlusion": _plane(lighting.ambient_occlusion),
        "samples": _plane(lighting.samples),
        "variance": lighting.variance,
        "splat_color": splats.color,
        "transmittance": splats.transmittance[..., None],
        "splat_depth": splats.depth[..., None],
        "splat_median_depth": splats.median_depth[..., None],
    }
    for name, light, noisy in zip(
        ("light_key", "light_Lampe__ber_T_r", "light_environment"), lighting.layers, lighting.noisy, strict=True
    ):
        expected |= {f"{name}_direct": light.direct, f"{name}_indirect": light.indirect}
        expected |= {f"{name}_direct_noisy": noisy.direct, f"{name}_indirect_noisy": noisy.indirect}
        expected[f"{name}_variance_noisy"] = noisy.variance
    assert set(image.layers) == set(expected)
    for name, values in expected.items():
        assert values is not None
        assert np.array_equal(image.layer(name), values), name


def _plane(values: F32 | None) -> F32:
    assert values is not None
    return values[..., None]


def test_layers_of_lights_sum_to_the_lighting(frame: Frame, tmp_path: Path) -> None:
    write(frame, tmp_path / "a.exr")
    image = read_exr(tmp_path / "a.exr")
    total = sum(image.layer(name) for name in image.layers if name.startswith("light_") and name.endswith("direct"))
    assert np.allclose(total, image.layer("lighting")[..., :3], rtol=1e-6)


def test_what_may_be_left_out(frame: Frame, tmp_path: Path) -> None:
    write(frame, tmp_path / "a.exr", output=OutputSettings(layers=False, aovs=False))
    assert set(read_exr(tmp_path / "a.exr").layers) == {""}
    write(frame, tmp_path / "a.exr", output=OutputSettings(layers=False, aovs=("normal", "depth")))
    assert set(read_exr(tmp_path / "a.exr").layers) == {"", "depth", "normal"}
    write(frame, tmp_path / "a.exr", output=OutputSettings(aovs=False))
    light = {f"light_{x}_{y}" for x in ("key", "Lampe__ber_T_r", "environment") for y in ("direct", "indirect")}
    expected = {"", "lighting"} | light | {f"{name}_noisy" for name in light}
    assert set(read_exr(tmp_path / "a.exr").layers) == expected
    write(replace(frame, unlit=None, factor=None, splats=None, made_by=None), tmp_path / "b.exr")
    assert "unlit" not in read_exr(tmp_path / "b.exr").layers
    write(replace(frame, lighting=None), tmp_path / "c.exr")
    assert "lighting" not in read_exr(tmp_path / "c.exr").layers


def test_half_floats_for_colour_alone(frame: Frame, tmp_path: Path) -> None:
    bright = frame.rgba.copy()
    bright[2, 3, 0] = 1e6
    write(replace(frame, rgba=bright), tmp_path / "a.exr", output=OutputSettings(half=True))
    image = read_exr(tmp_path / "a.exr")
    kinds = {name.rpartition(".")[0]: values.dtype.name for name, values in image.channels.items()}
    for name in ("position", "depth", "normal", "variance", "noise", "transmittance", "splat_depth"):
        assert kinds[name] == "float32", name
    for name in ("", "unlit", "lighting", "light_key_direct", "factor"):
        assert kinds[name] == "float16", name
    assert image.channels["R"][2, 3] == 65504  # not infinite
    assert np.allclose(image.layer()[..., 1:], frame.rgba[..., 1:], rtol=1e-3, atol=1e-6)
    lighting = frame.lighting
    assert lighting is not None and lighting.variance is not None
    assert np.array_equal(image.layer("variance"), lighting.variance)


def test_a_simple_reader_shows_the_relit_picture(frame: Frame, tmp_path: Path) -> None:
    write(frame, tmp_path / "a.exr")
    with OpenEXR.File(str(tmp_path / "a.exr")) as file:
        assert len(file.parts) == 1
        assert np.array_equal(file.channels()["RGBA"].pixels, frame.rgba)


def test_metadata(frame: Frame, tmp_path: Path) -> None:
    write(frame, tmp_path / "a.exr")
    found = read_exr(tmp_path / "a.exr").metadata
    made_by = json.loads(found["mirelight/provenance"])
    assert made_by["settings"] == {"render": {"spp": 64, "noise": None}}
    assert made_by["inputs"] == {"splats.ply": "ab" * 32}
    assert (made_by["lighting"], made_by["job"]) == ("night", "courtyard.toml")
    assert json.loads(found["mirelight/lights"])["light_Lampe__ber_T_r"] == "Lampe über Tür"
    camera = json.loads(found["mirelight/camera"])
    assert (camera["fx"], camera["cy"], camera["far"], camera["projection"]) == (30, 8, None, "perspective")
    assert np.array_equal(camera["world_from_camera"], frame.camera.world_from_camera)
    assert found["software"] == "mirelight 0.1.0"
    assert found["pixelAspectRatio"] == pytest.approx(25 / 30)
    assert found["screenWindowWidth"] == pytest.approx(20 / 30)
    assert np.allclose(found["screenWindowCenter"], ((10 - 7) / 30, (8 - 6) / 25))
    assert np.array_equal(found["worldToNDC"], world_to_ndc(frame.camera))


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_matrices_carry_points_to_their_pixels(frame: Frame, projection: Projection) -> None:
    camera: Camera = replace(frame.camera, projection=projection)
    points = np.random.default_rng(1).uniform(-0.3, 0.3, (50, 3))
    row = np.concatenate([points, np.ones((50, 1))], axis=1)
    ours = row @ camera.camera_from_world.T
    depth = -ours[:, 2]
    w = depth if projection == "perspective" else np.ones(50)
    pixels = np.stack([camera.cx + camera.fx * ours[:, 0] / w, camera.cy - camera.fy * ours[:, 1] / w], axis=1)
    ndc = row @ world_to_ndc(camera)  # OpenEXR's matrices act on row vectors
    assert np.allclose(ndc[:, :2] / ndc[:, 3:] * (camera.width, camera.height), pixels, atol=1e-4)
    assert np.allclose(ndc[:, 2], depth, atol=1e-5)
    seen = row @ world_to_camera(camera)  # left-handed: +Z is in front
    assert np.allclose(seen[:, :3], ours[:, :3] * (1, 1, -1), atol=1e-5)


def test_layer_names_are_plain_and_unique() -> None:
    assert layer_names(("a b", "a.b", "a_b", "", "é" * 3)) == (
        "light_a_b",
        "light_a_b_2",
        "light_a_b_3",
        "light_unnamed",
        "light____",
    )
    long = layer_names(("x" * 300, "x" * 300))
    assert long[0] != long[1]
    assert max(len(f"{name}_indirect.R") for name in long) <= 63  # Blender's limit


def test_fingerprints_decide_what_is_skipped(frame: Frame, tmp_path: Path) -> None:
    for suffix in (".exr", ".png"):
        path = tmp_path / f"a{suffix}"
        assert read_fingerprint(path) is None
        write(frame, path)
        assert read_fingerprint(path) == "f" * 64
        data = path.read_bytes()
        for length in (0, 3, 100, len(data) // 3, len(data) - 1):
            path.write_bytes(data[:length])
            assert read_fingerprint(path) is None
        write(replace(frame, made_by=None), path)
        assert read_fingerprint(path) is None
    assert read_fingerprint(tmp_path) is None


def test_the_same_frame_gives_the_same_bytes(frame: Frame, tmp_path: Path) -> None:
    for suffix in (".exr", ".png"):
        write(frame, tmp_path / f"a{suffix}")
        write(frame, tmp_path / f"b{suffix}")
        assert (tmp_path / f"a{suffix}").read_bytes() == (tmp_path / f"b{suffix}").read_bytes()


def test_multi_part_files_of_others_are_read(tmp_path: Path) -> None:
    first, second = (np.full((3, 4), x, dtype=np.float32) for x in (1, 2))
    parts = [OpenEXR.Part({}, {"R": first}, "rgba"), OpenEXR.Part({}, {"depth.Z": second, "N": second}, "depth")]
    with OpenEXR.File(parts) as file:
        file.write(str(tmp_path / "a.exr"))
    image = read_exr(tmp_path / "a.exr")
    assert set(image.channels) == {"rgba.R", "depth.Z", "depth.N"}
    assert image.layer("depth").shape == (3, 4, 2)
    with pytest.raises(KeyError, match="no layer 'x'"):
        image.layer("x")


def test_arrays_of_any_layout_are_written_right(tmp_path: Path) -> None:
    values = np.arange(24, dtype=np.float64).reshape(4, 6)
    write_exr(tmp_path / "a.exr", {"R": values[::-1], "G": values[:, ::-1], "B": values.reshape(6, 4).T})
    image = read_exr(tmp_path / "a.exr")
    assert np.array_equal(image.channels["R"], values[::-1])
    assert np.array_equal(image.channels["G"], values[:, ::-1])
    assert np.array_equal(image.channels["B"], values.reshape(6, 4).T)


def test_damaged_files_are_one_line(frame: Frame, tmp_path: Path) -> None:
    path = tmp_path / "a.exr"
    write(frame, path)
    data = path.read_bytes()
    rng = np.random.default_rng(5)
    for length in (0, 2, 50, 1000, len(data) - 10):
        path.write_bytes(data[:length])
        with pytest.raises(InputError) as error:
            read_exr(path)
        assert "\n" not in str(error.value)
    for _ in range(200):
        broken = bytearray(data)
        for at in rng.integers(0, 3000, 4):
            broken[at] = rng.integers(0, 256)
        path.write_bytes(broken)
        try:
            read_exr(path)
        except InputError as e:
            assert "\n" not in str(e)


@pytest.mark.parametrize("most", [0, 50, 2000])
def test_a_disk_that_fills_up(tmp_path: Path, most: int) -> None:
    """A limit on file sizes stands in for it. The library tells of no bytes that are lost as it closes the file."""
    picture = np.random.default_rng(0).random((16, 16, 3)).astype(np.float32)
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (most, before[1]))
    try:
        with pytest.raises(OutputError, match=r"a\.exr: cannot be written \(.+\); nothing half-written was left"):
            write_exr(tmp_path / "a.exr", {"": picture})
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert list(tmp_path.iterdir()) == []


def test_a_file_that_may_not_be_read_is_not_called_damaged(frame: Frame, tmp_path: Path) -> None:
    path = tmp_path / "a.exr"
    write(frame, path)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("os.open", _refused)
        with pytest.raises(InputError, match=r"cannot be read .Permission denied.; check the path and its permissions"):
            read_exr(path)


def _refused(path: Path, *_: object) -> int:
    raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))


def test_names_that_the_library_does_not_take_are_said(frame: Frame, tmp_path: Path) -> None:
    path = tmp_path / "a.exr"
    write(frame, path)
    other = tmp_path / os.fsdecode(b"\xff.exr")
    with pytest.raises(OutputError, match="OpenEXR takes names in UTF-8"):
        write(frame, other)
    assert list(tmp_path.iterdir()) == [path]
    path.rename(other)
    with pytest.raises(InputError, match="a name that is not UTF-8"):
        read_exr(other)


def test_other_suffixes_are_refused(frame: Frame, tmp_path: Path) -> None:
    for name in ("a.jpg", "a"):
        with pytest.raises(OutputError, match=r"written as \.exr or \.png"):
            write(frame, tmp_path / name)


def test_the_reached_error_and_the_samples_are_said(frame: Frame, tmp_path: Path) -> None:
    write(frame, tmp_path / "a.exr")
    said = json.loads(read_exr(tmp_path / "a.exr").metadata["mirelight/sampling"])
    assert frame.lighting is not None and frame.lighting.samples is not None
    assert said["relative_noise"] == frame.lighting.relative_noise
    assert said["relative_noise"] > 0
    assert said["samples"]["max"] == frame.lighting.samples.max()
    assert said["denoised"] is True
