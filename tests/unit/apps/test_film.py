"""Films: what is decoded from them is what went in, in order, at the right rate; nothing is begun without its tool."""

from __future__ import annotations

import itertools
import os
import stat
import sys
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from mirelight.apps.show import encoders, yuv
from mirelight.apps.show.encoders import durations, encoder_of
from mirelight.apps.show.film import Order, ordered, rate_of, write_film
from mirelight.apps.show.shots import Shot, wanted
from mirelight.base.errors import InputError, OutputError

RATE = Fraction(24)


def picture(i: int, size: tuple[int, int] = (91, 121)) -> np.ndarray:
    """A smooth colourful picture with a bar that moves."""
    y, x = np.mgrid[: size[0], : size[1]].astype(np.float64)
    out = np.stack([40 + x, 200 - y, 90 + (x + y) / 2], axis=-1)
    out[:, 8 * i : 8 * i + 8] = (230, 220, 40)
    return np.asarray(np.rint(np.clip(out, 0, 255)), np.uint8)


def shots(count: int = 10, size: tuple[int, int] = (91, 121)) -> list[Shot]:
    return [Shot(f"frame {i}", f"c{i}", "", lambda i=i: picture(i, size)) for i in range(count)]  # type: ignore[misc]


def psnr(a: np.ndarray, b: np.ndarray) -> float:
    return float(10 * np.log10(255**2 / np.mean((a.astype(float) - b.astype(float)) ** 2)))


# --- colours ---


@pytest.mark.parametrize(
    ("rgb", "code"),  # 8-bit codes of the primaries by ITU-R BT.709
    [
        ((255, 255, 255), (235, 128, 128)),
        ((0, 0, 0), (16, 128, 128)),
        ((255, 0, 0), (63, 102, 240)),
        ((0, 255, 0), (173, 42, 26)),
        ((0, 0, 255), (32, 240, 118)),
    ],
)
def test_primaries_have_the_codes_of_the_recommendation(rgb: tuple[int, int, int], code: tuple[int, int, int]) -> None:
    found = yuv.planes(np.full((4, 6, 3), rgb, np.uint8))
    assert [x.shape for x in found] == [(4, 6), (2, 3), (2, 3)]
    assert [int(x[1, 1]) for x in found] == list(code)


def test_chroma_lies_on_the_left_column() -> None:
    blue = np.zeros((2, 40, 3), np.uint8)
    blue[..., 2] = 4 * np.arange(40)
    cb = yuv.planes(blue).cb[0]
    exact = 128 + blue[0, ::2, 2] * (1 - yuv.KB) * 224 / 255 / (2 * (1 - yuv.KB))
    assert np.abs(cb - exact)[1:].max() <= 0.5  # a ramp is kept: no column is half a pixel off


def test_an_odd_picture_keeps_its_pixels() -> None:
    odd = picture(0, (5, 7))
    grown = yuv.even(odd)
    assert grown.shape == (6, 8, 3)
    assert np.array_equal(grown[:5, :7], odd) and np.array_equal(grown[5, :7], odd[4])


# --- files ---


def test_h264_comes_back_frame_by_frame(tmp_path: Path) -> None:
    import av

    path = tmp_path / "a.mp4"
    rate = rate_of("29.97")
    made = write_film(shots(), path, rate, encoder_of(path, rate))
    assert (made.count, made.size) == (10, (121, 91))
    with av.open(str(path)) as film:
        stream = film.streams.video[0]
        assert (stream.width, stream.height, stream.average_rate) == (122, 92, Fraction(2997, 100))
        context = stream.codec_context
        assert (context.name, context.pix_fmt) == ("h264", "yuv420p")
        assert context.color_primaries == context.color_trc == context.colorspace == context.color_range == 1
        decoded = [x.reformat(format="rgb24", src_colorspace="ITU709").to_ndarray() for x in film.decode(stream)]
    assert len(decoded) == 10
    for i, found in enumerate(decoded):
        assert psnr(found[:91, :121], picture(i)) > 32  # 4:2:0 blurs the bar's edges
        smooth = np.s_[:80, 90:118]
        assert psnr(found[smooth], picture(i)[smooth]) > 40
        assert np.abs(found[smooth].mean(axis=(0, 1)) - picture(i)[smooth].mean(axis=(0, 1))).max() < 2
    again = tmp_path / "b.mp4"
    write_film(shots(), again, rate, encoder_of(again, rate))
    assert again.read_bytes() == path.read_bytes()


@pytest.mark.parametrize(("suffix", "least"), [(".gif", 28.0), (".webp", 30.0)])
def test_moving_pictures_of_pillow(tmp_path: Path, suffix: str, least: float) -> None:
    path = tmp_path / f"a{suffix}"
    write_film(shots(), path, RATE, encoder_of(path, RATE))
    with Image.open(path) as film:
        assert (getattr(film, "n_frames", 1), film.size) == (10, (121, 91))
        lasted = 0
        for i in range(10):
            film.seek(i)
            assert psnr(np.asarray(film.convert("RGB")), picture(i)) > least
            lasted += int(film.info["duration"])
    assert abs(lasted - 10_000 / 24) <= 5


@pytest.mark.parametrize("ticks", [100, 1000])
@pytest.mark.parametrize("rate", [Fraction(24), Fraction(24000, 1001), Fraction(7), Fraction(50)])
def test_rounded_times_do_not_add_up(ticks: int, rate: Fraction) -> None:
    found = durations(480, rate, ticks)
    assert abs(sum(found) - 480 * ticks / rate) <= 0.5
    assert max(found) - min(found) <= 1


FAKE = """\
#!{python}
import sys
said = sys.stdin.buffer.read()
if len(said) < 2_000:
    sys.exit("not what I wanted\\nUnknown encoder 'libx264'")
open(sys.argv[-1], "wb").write(said)
open({log!r}, "w").write("\\n".join(sys.argv[1:]))
"""


@pytest.fixture
def ffmpeg(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A program of that name that keeps what it is given; no PyAV. Returns where it writes its arguments."""
    folder, log = tmp_path / "bin", tmp_path / "arguments"
    folder.mkdir()
    program = folder / "ffmpeg"
    program.write_text(FAKE.format(python=sys.executable, log=str(log)), encoding="utf-8")
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("PATH", f"{folder}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setattr(encoders, "_has_pyav", lambda: False)
    return log


def test_ffmpeg_is_given_the_same_planes(tmp_path: Path, ffmpeg: Path) -> None:
    path = tmp_path / "a.mp4"
    write_film(shots(3), path, RATE, encoder_of(path, RATE))
    expected = b"".join(p.tobytes() for i in range(3) for p in yuv.planes(yuv.even(picture(i))))
    assert path.read_bytes() == expected
    said = ffmpeg.read_text().split("\n")
    pairs = dict(itertools.pairwise(said))
    assert pairs["-s"] == "122x92" and pairs["-r"] == "24" and pairs["-c:v"] == "libx264"
    assert pairs["-colorspace"] == pairs["-color_primaries"] == pairs["-color_trc"] == "bt709"


def test_what_ffmpeg_says_is_told_and_nothing_is_left(tmp_path: Path, ffmpeg: Path) -> None:
    path = tmp_path / "a.mp4"
    with pytest.raises(OutputError, match="Unknown encoder 'libx264'"):
        write_film(shots(1, (8, 8)), path, RATE, encoder_of(path, RATE))
    assert sorted(x.name for x in tmp_path.iterdir()) == ["bin"]


# --- wrong use ---


def test_without_an_encoder_it_is_said_at_once(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(encoders, "_has_pyav", lambda: False)
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(InputError, match=r"pip install 'mirelight\[film\]', or put ffmpeg on the PATH"):
        encoder_of(tmp_path / "a.mp4", RATE)
    encoder_of(tmp_path / "a.gif", RATE)


def test_frames_of_two_sizes_are_refused_and_nothing_is_left(tmp_path: Path) -> None:
    path = tmp_path / "a.webp"
    with pytest.raises(InputError, match="frame 0: 7 x 5 pixels, and frame 0 has 121 x 91"):
        write_film([*shots(2), *shots(1, (5, 7))], path, RATE, encoder_of(path, RATE))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("text", ["0", "-1", "x", "1/0", "1e9", ""])
def test_a_rate_that_is_none(text: str) -> None:
    with pytest.raises(InputError, match="--fps"):
        rate_of(text)


def test_rates() -> None:
    assert rate_of("24") == 24 and rate_of("24000/1001") == Fraction(24000, 1001) and rate_of("12.5") == Fraction(25, 2)
    with pytest.raises(InputError, match="at most 50"):
        encoder_of(Path("a.gif"), Fraction(60))
    with pytest.raises(OutputError, match=r"\.mp4, \.gif or \.webp"):
        encoder_of(Path("a.avi"), RATE)


@pytest.mark.parametrize(
    ("order", "expected"), [("cameras", ["a1", "b1", "a2", "b2"]), ("lightings", ["a1", "a2", "b1", "b2"])]
)
def test_what_runs_first(order: Order, expected: list[str]) -> None:
    every = [Shot(f"{c}{n}", c, n, lambda: picture(0)) for c in "ab" for n in "12"]
    assert [x.name for x in ordered(every, order)] == expected


def test_patterns_go_by_number(tmp_path: Path) -> None:
    for i in (10, 9, 1):
        Image.fromarray(picture(i)).save(tmp_path / f"f{i}.png")
    assert [x.name for x in wanted([str(tmp_path / "f*.png")])] == ["f1", "f9", "f10"]
    with pytest.raises(InputError, match="no file of that pattern"):
        wanted([str(tmp_path / "g*.png")])
