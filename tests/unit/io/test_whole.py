"""Damaged files do not count as done; what lies in the files' structure."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest

from mirelight.base.errors import InputError
from mirelight.io import exr_bytes
from mirelight.io.exr import read_exr, write_exr
from mirelight.io.image import is_intact, read, read_fingerprint, write
from mirelight.model import F32, Compression, Frame, OutputSettings
from mirelight.store import Index

COMPRESSIONS: tuple[Compression, ...] = ("zip", "dwaa", "none")


@pytest.mark.parametrize("suffix", [".exr", ".png"])
def test_any_changed_bit_is_found(frame: Frame, tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    write(frame, path)
    assert is_intact(path)
    data = path.read_bytes()
    for at in np.random.default_rng(1).integers(0, len(data), 150):
        broken = bytearray(data)
        broken[at] ^= 1 << int(at) % 8
        path.write_bytes(broken)
        assert not is_intact(path), at
    path.write_bytes(data + b"\0")
    assert not is_intact(path)


@pytest.mark.parametrize("suffix", [".exr", ".png"])
def test_a_file_damaged_in_its_middle_does_not_count_as_done(frame: Frame, tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    write(frame, path)
    assert Index(tmp_path, iter(())).has_file(path, "f" * 64)
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 16
    path.write_bytes(data)
    assert not Index(tmp_path, iter(())).has_file(path, "f" * 64)


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_holes_and_cuts_in_the_middle_are_found(frame: Frame, tmp_path: Path, compression: Compression) -> None:
    """A zeroed disk block is found by its chunk's header or by the digest; a hole over a chunk's head by the header."""
    tall = {"": np.random.default_rng(0).random((200, 80, 4), np.float32)}
    path = tmp_path / "a.exr"
    write_exr(path, tall, {"mirelight/fingerprint": "f"}, compression=compression)
    assert read_fingerprint(path) == "f" and is_intact(path)
    data = path.read_bytes()
    middle = len(data) // 2
    for broken in (data[:middle] + bytes(4096) + data[middle + 4096 :], data[:middle] + data[middle + 1 :]):
        path.write_bytes(broken)
        assert not is_intact(path)
    with OpenEXR.File(str(path), header_only=True) as file:
        assert file.header()["compression"].name.startswith({"none": "NO"}.get(compression, compression.upper()))
    holes = [data[:middle] + data[middle + 8 :] + bytes(8), data[:-1], data + b"\0"]
    holes += [data[: len(data) - n] + bytes(n) for n in (30_000, 60_000)]
    for broken in holes if compression != "dwaa" else holes[1:3]:
        path.write_bytes(broken)
        assert read_fingerprint(path) is None


def test_files_without_a_digest_are_whole_and_not_known_to_be_intact(tmp_path: Path) -> None:
    path = tmp_path / "a.exr"
    with OpenEXR.File({"type": OpenEXR.scanlineimage}, {"R": np.ones((40, 30), np.float32)}) as file:
        file.write(str(path))
    assert exr_bytes.is_whole(path) and not is_intact(path)
    assert not exr_bytes.is_whole(tmp_path / "none.exr") and not is_intact(tmp_path / "none.png")


def on_a_stage(frame: Frame, rows: slice, columns: slice) -> Frame:
    """The frame, empty outside of a window; factor and transmittance are not 0 there, so they are left out."""

    def cut(values: F32) -> F32:
        out = np.zeros_like(values)
        out[rows, columns] = values[rows, columns]
        return out

    assert frame.lighting is not None
    names = ("coverage", "depth", "position", "normal", "geometric_normal", "albedo")
    layers = tuple(replace(x, direct=cut(x.direct), indirect=cut(x.indirect)) for x in frame.lighting.layers)
    arrays: dict[str, Any] = {name: cut(getattr(frame.lighting, name)) for name in names}
    lighting = replace(
        frame.lighting,
        layers=layers,
        noisy=(),
        variance=None,
        samples=None,
        sun_visibility=None,
        ambient_occlusion=None,
        **arrays,
    )
    return replace(frame, rgba=cut(frame.rgba), unlit=None, factor=None, splats=None, noise=None, lighting=lighting)


@pytest.mark.parametrize("half", [False, True])
def test_empty_surroundings_are_cropped_and_come_back(frame: Frame, tmp_path: Path, half: bool) -> None:
    one = on_a_stage(frame, slice(3, 9), slice(8, 17))
    write(one, tmp_path / "a.exr", output=OutputSettings(half=half))
    with OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True) as file:
        header, channels = file.header(), file.channels()
        assert [x.tolist() for x in header["dataWindow"]] == [[8, 3], [16, 8]]
        assert [x.tolist() for x in header["displayWindow"]] == [[0, 0], [19, 11]]
        assert np.array_equal(channels["depth.Z"].pixels, one.lighting.depth[3:9, 8:17]) if one.lighting else False
    found = read(tmp_path / "a.exr")
    assert found.lighting is not None and one.lighting is not None
    assert np.array_equal(found.rgba, one.rgba.astype(np.float16) if half else one.rgba)
    assert np.array_equal(found.lighting.position, one.lighting.position)
    assert is_intact(tmp_path / "a.exr")


def test_most_of_a_picture_or_a_negative_zero_is_not_cropped(tmp_path: Path) -> None:
    def window(values: F32) -> list[list[int]]:
        write_exr(tmp_path / "a.exr", {"": values})
        assert read_exr(tmp_path / "a.exr").layer().tobytes() == values.tobytes()
        with OpenEXR.File(str(tmp_path / "a.exr"), header_only=True) as file:
            return [x.tolist() for x in file.header()["dataWindow"]]

    full = np.zeros((10, 8, 3), np.float32)
    assert window(full) == [[0, 0], [0, 0]]
    full[:6] = 1
    assert window(full) == [[0, 0], [7, 9]]
    full[5] = 0
    assert window(full) == [[0, 0], [7, 4]]
    full[9, 7, 1] = -0.0
    assert window(full) == [[0, 0], [7, 9]]


def test_windows_of_other_programs(tmp_path: Path) -> None:
    values = np.arange(20, dtype=np.float32).reshape(4, 5)

    def corners(*xy: int) -> tuple[np.ndarray[tuple[int, ...], np.dtype[np.int32]], ...]:
        return np.array(xy[:2], np.int32), np.array(xy[2:], np.int32)

    header = {"type": OpenEXR.scanlineimage, "dataWindow": corners(-1, -1, 3, 2), "displayWindow": corners(0, 0, 5, 1)}
    with OpenEXR.File(header, {"Y": values}) as file:
        file.write(str(tmp_path / "a.exr"))
    expected = np.zeros((2, 6), np.float32)
    expected[:, :4] = values[1:3, 1:]
    assert np.array_equal(read_exr(tmp_path / "a.exr").channels["Y"], expected)
    header["displayWindow"] = corners(50, 0, 60, 10)
    with OpenEXR.File(header, {"Y": values}) as file:
        file.write(str(tmp_path / "a.exr"))
    with pytest.raises(InputError, match="outside its display window"):
        read_exr(tmp_path / "a.exr")
    header["displayWindow"] = corners(-(2**29), -(2**29), 2**29, 2**29)  # a small file, an endless picture
    with OpenEXR.File(header, {"Y": values}) as file:
        file.write(str(tmp_path / "a.exr"))
    with pytest.raises(InputError):
        read_exr(tmp_path / "a.exr")


def test_dwaa_comes_near_in_colour_and_leaves_out_what_it_would_spoil(frame: Frame, tmp_path: Path) -> None:
    write(frame, tmp_path / "a.exr", output=OutputSettings(compression="dwaa", half=True))
    found = read(tmp_path / "a.exr")
    assert found.lighting is not None and frame.lighting is not None
    assert np.array_equal(found.lighting.depth, frame.lighting.depth)
    assert (found.noise, found.lighting.variance, found.lighting.samples) == (None, None, None)
    assert not found.lighting.position.any() and not found.lighting.normal.any()
    assert np.abs(found.rgba[..., :3] - frame.rgba[..., :3]).mean() < 0.05
    assert np.array_equal(found.rgba[..., 3], frame.rgba[..., 3].astype(np.float16))


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_the_same_frame_gives_the_same_bytes(frame: Frame, tmp_path: Path, compression: Compression) -> None:
    tall = np.random.default_rng(0).random((300, 40, 4), np.float32)
    before = OpenEXR.global_thread_count()
    try:
        for name, threads in (("a", 0), ("b", 1), ("c", 5)):
            OpenEXR.set_global_thread_count(threads)
            write(frame, tmp_path / f"{name}.exr", output=OutputSettings(compression=compression))
            write_exr(tmp_path / f"{name}-tall.exr", {"": tall}, compression=compression)
    finally:
        OpenEXR.set_global_thread_count(before)
    assert len({(tmp_path / f"{name}-tall.exr").read_bytes() for name in "abc"}) == 1
    assert (tmp_path / "a.exr").read_bytes() == (tmp_path / "b.exr").read_bytes()


def test_metadata_is_json_even_of_numbers_that_json_does_not_have(frame: Frame, tmp_path: Path) -> None:
    assert frame.lighting is not None and frame.made_by is not None
    light = frame.lighting.variance * np.float32(np.nan) if frame.lighting.variance is not None else None
    made_by = replace(frame.made_by, settings={"a": [float("inf"), {"b": float("nan")}]})
    bad = replace(frame, lighting=replace(frame.lighting, variance=light), made_by=made_by)
    write(bad, tmp_path / "a.exr")

    def refuse(name: str) -> None:
        raise AssertionError(f"{name} is not JSON")

    texts = [v for k, v in read_exr(tmp_path / "a.exr").metadata.items() if k.startswith("mirelight/") and "{" in v]
    assert len(texts) >= 4
    for text in texts:
        json.loads(text, parse_constant=refuse)
    assert read(tmp_path / "a.exr").made_by is not None
