"""Environment maps: OpenEXR, Radiance HDR, 8-bit pictures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from PIL import Image

from mirelight.apps.inspect.facts import PictureFacts
from mirelight.apps.inspect.inspect import inspect
from mirelight.apps.match.target import read_target
from mirelight.base import backend, colour
from mirelight.base.errors import InputError, OutputError
from mirelight.base.primaries import INTEROP_IDS, PRIMARIES, REC709, ColorSpace, converted
from mirelight.cli.report import lines
from mirelight.compare.pictures import read_picture
from mirelight.io.environment import read_environment, write_environment
from mirelight.io.hdr import read_hdr, write_hdr

RNG = np.random.default_rng(8)
FILES = settings(
    max_examples=100, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


def radiance(height: int = 16, width: int = 32) -> NDArray[np.float32]:
    """Ten orders of magnitude, with flat areas and black."""
    out = np.exp(RNG.normal(0, 5, (height, width, 3))).astype(np.float32)
    out[: height // 4] = (0.25, 1.5, 3)
    out[height // 2, : width // 2] = 0
    return out


def save_exr(path: Path, channels: dict[str, NDArray[Any]], **header: object) -> Path:
    with OpenEXR.File(
        {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, **header}, channels
    ) as file:
        file.write(str(path))
    return path


# --- OpenEXR ---------------------------------------------------------------------------------------------------------


def test_exr_round_trip(tmp_path: Path) -> None:
    before = radiance()
    write_environment(tmp_path / "a.exr", before)
    assert np.array_equal(read_environment(tmp_path / "a.exr"), before)


def test_half_tiled_and_named_channels(tmp_path: Path) -> None:
    before = np.clip(radiance(), 0, 6e4)
    half = save_exr(tmp_path / "half.exr", {"RGBA": np.dstack([before, np.ones((16, 32))]).astype(np.float16)})
    assert np.array_equal(read_environment(half), before.astype(np.float16).astype(np.float32))
    named = save_exr(tmp_path / "named.exr", {"Combined": before, "depth.Z": np.ascontiguousarray(before[..., 0])})
    assert np.array_equal(read_environment(named), before)
    gray = save_exr(tmp_path / "gray.exr", {"Y": np.ascontiguousarray(before[..., 0])})
    assert np.array_equal(read_environment(gray), np.repeat(before[..., :1], 3, axis=2))
    tiles = OpenEXR.TileDescription()
    tiles.xSize = tiles.ySize = 8
    tiled = save_exr(tmp_path / "tiled.exr", {"RGB": before}, type=OpenEXR.tiledimage, tiles=tiles)
    assert np.array_equal(read_environment(tiled), before)


@pytest.mark.parametrize("space", PRIMARIES)
def test_a_map_is_the_same_light_in_any_primaries(tmp_path: Path, space: ColorSpace) -> None:
    before = RNG.uniform(0.1, 4, (16, 32, 3)).astype(np.float32)
    stored = converted(before, REC709, PRIMARIES[space]).astype(np.float16)
    found = read_environment(save_exr(tmp_path / "a.exr", {"RGB": stored}, chromaticities=PRIMARIES[space]))
    assert np.allclose(found, before, rtol=0, atol=4 * 2**-10)  # a half float's step at 4
    alone = save_exr(tmp_path / "id.exr", {"RGB": stored}, colorInteropID=INTEROP_IDS[space])
    assert np.array_equal(read_environment(alone), found)
    assert np.array_equal(read_picture(tmp_path / "a.exr").rgb, found)
    assert np.array_equal(read_target(tmp_path / "a.exr", None, "none").values, found)
    facts = inspect(tmp_path / "a.exr")
    assert isinstance(facts, PictureFacts) and facts.color_space == space


def test_inspect_counts_what_is_not_finite(tmp_path: Path) -> None:
    """An environment with such pixels is refused; the figures are of the others."""
    before = radiance()
    expected = np.delete(before.reshape(-1, 3), 9, axis=0)
    before[0, 9, 1] = np.nan
    facts = inspect(save_exr(tmp_path / "a.exr", {"RGB": before}))
    assert isinstance(facts, PictureFacts) and facts.not_finite == 1 and facts.mean is not None
    np.testing.assert_allclose(facts.mean, expected.mean(axis=0), rtol=1e-5)
    assert facts.brightest == pytest.approx(expected.max(), rel=1e-5)
    assert "  !            1 pixels are NaN or infinite" in "\n".join(lines(facts))
    none = inspect(save_exr(tmp_path / "b.exr", {"RGB": np.full((2, 4, 3), np.inf, np.float32)}))
    assert isinstance(none, PictureFacts) and (none.not_finite, none.mean, none.brightest) == (8, None, None)


def test_colours_without_primaries_are_taken_as_rec709(tmp_path: Path) -> None:
    before = radiance()
    path = save_exr(tmp_path / "a.exr", {"RGB": before})
    assert np.array_equal(read_environment(path), before)
    facts = inspect(path)
    assert isinstance(facts, PictureFacts) and facts.color_space == "not named, taken as lin_rec709"


@pytest.mark.parametrize("bad", [(0.0,) * 8, (np.nan,) * 8, (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.9, 0.05)])
def test_primaries_without_colours_are_refused(tmp_path: Path, bad: tuple[float, ...]) -> None:
    path = save_exr(tmp_path / "a.exr", {"RGB": radiance()}, chromaticities=bad)
    with pytest.raises(InputError, match="chromaticities: primaries that span no colours"):
        read_environment(path)


def test_radiance_pictures_say_their_primaries(tmp_path: Path) -> None:
    write_hdr(tmp_path / "plain.hdr", radiance())
    plain = (tmp_path / "plain.hdr").read_bytes()
    line = "PRIMARIES=" + " ".join(str(x) for x in PRIMARIES["ACEScg"])
    (tmp_path / "aces.hdr").write_bytes(plain.replace(b"FORMAT=", line.encode() + b"\nFORMAT=", 1))
    expected = converted(read_hdr(tmp_path / "plain.hdr"), PRIMARIES["ACEScg"], REC709)
    assert np.array_equal(read_hdr(tmp_path / "aces.hdr"), expected)
    (tmp_path / "bad.hdr").write_bytes(plain.replace(b"FORMAT=", b"PRIMARIES=1 2\nFORMAT=", 1))
    with pytest.raises(InputError, match="PRIMARIES: primaries '1 2'"):
        read_hdr(tmp_path / "bad.hdr")


def test_two_pictures_in_one_file_are_ambiguous(tmp_path: Path) -> None:
    path = save_exr(tmp_path / "a.exr", {"left": radiance(), "right": radiance()})
    with pytest.raises(InputError, match="no R, G and B channels of one picture"):
        read_environment(path)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_pixels_that_are_not_finite_are_counted(tmp_path: Path, bad: float) -> None:
    spoiled = radiance()
    spoiled[3, 5, 1] = spoiled[7, 2, 0] = bad
    with pytest.raises(InputError, match="2 pixels are NaN or infinite, the first in row 3, column 5"):
        read_environment(save_exr(tmp_path / "a.exr", {"RGB": spoiled}))


def test_negative_radiance_becomes_zero(tmp_path: Path) -> None:
    before = radiance()
    before[1, 1] = (-0.5, 1, 2)
    assert read_environment(save_exr(tmp_path / "a.exr", {"RGB": before}))[1, 1].tolist() == [0, 1, 2]


# --- Radiance --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("size", [(1, 1), (3, 7), (2, 8), (16, 32), (3, 129), (2, 1000)])
def test_hdr_round_trip_within_half_a_step(tmp_path: Path, size: tuple[int, int]) -> None:
    before = np.exp(RNG.normal(0, 5, (*size, 3))).astype(np.float32)
    write_environment(tmp_path / "a.hdr", before)
    after = read_environment(tmp_path / "a.hdr")
    assert np.all(np.abs(after - before).max(axis=-1) <= before.max(axis=-1) / 256 * 1.0001)
    write_hdr(tmp_path / "b.hdr", after)
    assert np.array_equal(read_hdr(tmp_path / "b.hdr"), after)


@pytest.mark.parametrize("writer", ["ours", "mitsuba"])
def test_hdr_against_mitsuba(tmp_path: Path, writer: str) -> None:
    mi = backend.mitsuba()
    path = tmp_path / "a.hdr"
    if writer == "ours":
        write_hdr(path, radiance())
    else:
        mi.Bitmap(radiance()).write(str(path))
    theirs = mi.Bitmap(str(path)).convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, False)
    assert np.array_equal(read_hdr(path), np.array(theirs))


def test_flat_pixels_and_old_run_lengths(tmp_path: Path) -> None:
    head = b"#?RGBE\n# made by hand\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 300\n"
    red, blue = bytes((128, 0, 0, 129)), bytes((0, 0, 64, 130))
    flat = (red * 300) + (blue * 300)
    old = (
        red + bytes((1, 1, 1, 43)) + bytes((1, 1, 1, 1)) + blue + bytes((1, 1, 1, 254)) + bytes((1, 1, 1, 1)) + blue * 0
    )
    # 1 + 43 + 1 * 256 = 300 pixels of red; blue needs 1 + 43 + 256 as well.
    old = (red + bytes((1, 1, 1, 43)) + bytes((1, 1, 1, 1))) + (blue + bytes((1, 1, 1, 43)) + bytes((1, 1, 1, 1)))
    for name, body in (("flat", flat), ("old", old)):
        path = tmp_path / f"{name}.hdr"
        path.write_bytes(head + body)
        found = read_hdr(path)
        assert found.shape == (2, 300, 3)
        assert np.all(found[0] == (1, 0, 0)) and np.all(found[1] == (0, 0, 1))


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"#?RADIANCE\nFORMAT=32-bit_rle_xyze\n\n-Y 1 +X 1\n\0\0\0\0", "FORMAT: pixels in '32-bit_rle_xyze'"),
        (b"#?RADIANCE\n\n+Y 1 +X 1\n\0\0\0\0", "resolution line '\\+Y 1 \\+X 1'"),
        (b"#?RADIANCE\n\n-Y 1 -X 1\n\0\0\0\0", "resolution line"),
        (b"#?RADIANCE\n\n+X 1 -Y 1\n\0\0\0\0", "resolution line"),
        (b"#?RADIANCE\n\n-Y 999999 +X 999999\n", "999999 x 999999 pixels"),
        (b"#?RADIANCE\n\n-Y 60000 +X 60000\n", "free|truncated"),
        (b"#?RADIANCE\n\n-Y 2 +X 1\n\0\0\0\0", "truncated"),
        (b"#?RADIANCE\n\n-Y 1 +X 8\n\2\2\0\7" + b"\0" * 40, "row 0 of 1 cannot be decoded"),
        (b"#?RADIANCE\n\n-Y 1 +X 8\n\2\2\0\x08\0\0", "row 0 of 1 cannot be decoded"),
        (b"#?RADIANCE\n\n-Y 1 +X 8\n\2\2\0\x08\xff\1", "row 0 of 1 cannot be decoded"),
        (b"#?RADIANCE\n\n-Y 1 +X 4\n\1\1\1\4", "row 0 of 1 cannot be decoded"),
        (b"#?RADIANCE\nEXPOSURE=1", "not a Radiance picture"),
    ],
)
def test_damaged_hdr(tmp_path: Path, data: bytes, message: str) -> None:
    path = tmp_path / "a.hdr"
    path.write_bytes(data)
    with pytest.raises(InputError, match=message):
        read_environment(path)


@FILES
@given(edits=st.lists(st.tuples(st.integers(0, 10**6), st.integers(0, 255)), max_size=6), cut=st.integers(0, 10**6))
def test_hdr_bytes_of_any_kind(tmp_path: Path, edits: list[tuple[int, int]], cut: int) -> None:
    path = tmp_path / "a.hdr"
    write_hdr(path, np.full((4, 9, 3), 0.5, dtype=np.float32))
    data = bytearray(path.read_bytes())
    for at, value in edits:
        data[at % len(data)] = value
    path.write_bytes(data[: len(data) - cut % 20])
    try:
        read_environment(path)
    except InputError as e:
        assert "\n" not in str(e)


# --- 8-bit pictures and others ---------------------------------------------------------------------------------------


def test_8_bit_pictures_are_decoded(tmp_path: Path) -> None:
    pixels = RNG.integers(0, 256, (4, 8, 3)).astype(np.uint8)
    Image.fromarray(pixels).save(tmp_path / "a.png")
    assert np.array_equal(read_environment(tmp_path / "a.png"), colour.srgb_decode(pixels / np.float32(255)))


def test_what_is_no_environment(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("hello", encoding="utf-8")
    (tmp_path / "empty.exr").touch()
    for name, message in (("a.txt", "neither OpenEXR"), ("empty.exr", "neither"), ("absent.hdr", "no such file")):
        with pytest.raises(InputError, match=message):
            read_environment(tmp_path / name)
    with pytest.raises(InputError):
        read_environment(tmp_path)
    with pytest.raises(OutputError, match=r"written as \.exr or \.hdr"):
        write_environment(tmp_path / "a.tif", radiance())
