"""Pairs of files: shown alike, gain, noise, regions, masks."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mirelight.base.errors import InputError
from mirelight.compare import CompareSettings, Comparison, Maps, Pair, evaluate, find_pairs
from mirelight.compare.pictures import read_picture
from mirelight.compare.regions import grown, silhouettes
from mirelight.io.png import encode_display
from mirelight.model import DisplaySettings, Frame


def run(reference: Path, test: Path, mask: Path | None = None, **settings: Any) -> tuple[Comparison, Maps]:
    return evaluate(Pair(name="pair", reference=reference, test=test, mask=mask), CompareSettings(**settings))


def noisy(frame: Frame, sigma: float, seed: int) -> Frame:
    """The frame with Gaussian noise on its light, relative to it, where the proxy covers."""
    assert frame.lighting is not None
    noise = 1 + sigma * np.random.default_rng(seed).normal(size=frame.rgba[..., :3].shape)
    factor = np.where(frame.lighting.coverage[..., None] > 0, noise, 1)
    rgba = frame.rgba.copy()
    rgba[..., :3] *= factor.astype(np.float32)
    return replace(frame, rgba=rgba)


# --- shown alike -----------------------------------------------------------------------------------------------------


def test_equal_frames_are_identical(made: Any, save: Any) -> None:
    result, maps = run(save(made(), "a/f.exr"), save(made(), "b/f.exr"))
    s = result.overall
    assert (s.verdict, s.psnr, s.flip, s.delta_e, s.rel_mse, s.hdr_flip) == ("identical", math.inf, 0, 0, 0, 0)
    assert s.ssim == pytest.approx(1)
    assert not maps.signed.any()
    assert [r.region for r in result.regions] == ["all", "covered", "silhouette"]


@pytest.mark.parametrize("profile", ["physical", "playcanvas"])
@pytest.mark.parametrize("tone", ["none", "aces", "neutral", "agx"])
def test_an_exr_is_shown_as_its_own_png(made: Any, save: Any, profile: str, tone: str) -> None:
    """The comparison's display of a linear file equals what the writer of PNGs makes of the same frame."""
    frame = made(profile=profile, opaque=False)
    look: dict[str, Any] = {"exposure": 0.7, "tone": tone, "background": (0.1, 0.2, 0.3)}
    result, _ = run(save(frame, "a/f.exr"), save(frame, "b/f.png", **look), **look)
    assert result.overall.max_error <= 1 / 255 + 1e-6  # one rounding may fall the other way
    assert result.overall.psnr > 75
    assert not result.linear
    assert result.overall.rel_mse is None


def test_transfer_curve_can_be_forced(made: Any, save: Any) -> None:
    frame = made()
    png, exr = save(frame, "b/f.png"), save(frame, "a/f.exr")
    assert run(exr, png, transfer="srgb")[0].overall.psnr > 75
    assert run(exr, png, transfer="power")[0].overall.psnr < 45


def test_the_engines_own_frame(data: Path, tmp_path: Path) -> None:
    """Its float frame as a linear EXR against its 8-bit back buffer, premultiplied, recognised by its meta.json."""
    from mirelight.base import colour
    from mirelight.io.exr import write_exr

    case = data / "realtime" / "stage_omni_lin"
    with np.load(case / "buffers.npz") as file:
        shown = file["frame_f32"]
    alpha = shown[..., 3:]
    straight = np.divide(shown[..., :3], alpha, out=np.zeros_like(shown[..., :3]), where=alpha > 0)
    linear = colour.power_decode(straight) * alpha
    channels = {name: linear[..., k] for k, name in enumerate("RGB")} | {"A": shown[..., 3]}
    write_exr(tmp_path / "frame.exr", channels, {})
    result, _ = run(tmp_path / "frame.exr", case / "frame.png")
    assert result.test_settings["engine"]["version"] == "2.23.3"
    assert result.overall.psnr > 55  # the back buffer rounds every splat; 8 bits alone would give 59
    assert run(tmp_path / "frame.exr", case / "frame.png", transfer="srgb")[0].overall.psnr < 50


def test_files_say_what_made_them(made: Any, save: Any) -> None:
    for name in ("f.exr", "f.png"):
        assert read_picture(save(made(), name)).settings["settings"]["render"]["spp"] == 64


# --- gain ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("gain", [0.2, 1.0, 1.7, 9.0])
def test_a_gain_is_found_and_reported(made: Any, save: Any, lighter: Any, gain: float) -> None:
    frame = made()
    reference, test = save(frame, "a/f.exr"), save(lighter(frame, gain), "b/f.png")
    plain, _ = run(reference, test)
    fitted, _ = run(reference, test, fit_gain=True)
    assert plain.gain == 1
    assert fitted.gain == pytest.approx(gain, rel=2e-3)
    assert fitted.overall.psnr > 55
    if gain != 1:
        assert plain.overall.psnr < 35


def test_gain_between_linear_files_scales_the_reference(made: Any, save: Any, lighter: Any) -> None:
    frame = made()
    result, _ = run(save(frame, "a/f.exr"), save(lighter(frame, 0.6), "b/f.exr"), fit_gain=True)
    assert result.gain == pytest.approx(0.6, rel=1e-3)
    assert result.overall.rel_mse is not None
    assert result.overall.rel_mse < 1e-6


# --- noise -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", ["exr", "png"])
def test_a_difference_as_large_as_the_noise_is_noise(made: Any, save: Any, suffix: str) -> None:
    clean = made(sigma=0.02)
    result, _ = run(save(clean, "a/f.exr"), save(noisy(clean, 0.02, 1), f"b/f.{suffix}"))
    s = result.overall
    assert s.verdict == "noise"
    assert s.noise_psnr is not None
    if suffix == "exr":  # both files say 0.02, one of them really is exact: 3 dB less than expected
        assert s.psnr - s.noise_psnr == pytest.approx(3, abs=0.5)
        assert s.noise_rel_mse is not None
        assert s.rel_mse is not None
        assert 0.4 < s.rel_mse / s.noise_rel_mse < 0.6
    else:
        assert s.psnr == pytest.approx(s.noise_psnr, abs=0.5)


@pytest.mark.parametrize("suffix", ["exr", "png"])
def test_a_bias_larger_than_the_noise_is_a_difference(made: Any, save: Any, lighter: Any, suffix: str) -> None:
    clean = made(sigma=0.02)
    off = lighter(noisy(clean, 0.02, 2), 1.06)
    assert run(save(clean, "a/f.exr"), save(off, f"b/f.{suffix}"))[0].overall.verdict == "difference"


def test_without_variance_nothing_is_called_noise(made: Any, save: Any) -> None:
    frame = made(sigma=None)
    assert run(save(frame, "a/f.exr"), save(noisy(frame, 0.001, 3), "b/f.exr"))[0].overall.verdict == "unknown"


def test_rounding_to_eight_bits_is_noise(made: Any, save: Any) -> None:
    frame = made(sigma=1e-5)
    assert run(save(frame, "a/f.exr"), save(noisy(frame, 1e-5, 4), "b/f.png"))[0].overall.verdict in (
        "noise",
        "identical",
    )


# --- regions and masks -----------------------------------------------------------------------------------------------


def test_scores_are_of_their_region(made: Any, save: Any) -> None:
    """An error painted outside the proxy is seen by the whole picture alone."""
    frame = made()
    rgba = frame.rgba.copy()
    rgba[:, :8, :3] = 0
    result, _ = run(save(frame, "a/f.exr"), save(replace(frame, rgba=rgba), "b/f.exr"))
    by_name = {s.region: s for s in result.regions}
    assert by_name["all"].psnr < 30
    assert by_name["covered"].psnr == math.inf
    assert by_name["silhouette"].psnr == math.inf
    height, width = rgba.shape[:2]
    assert by_name["covered"].pixels == height * width * 3 // 4
    # the cover's edge at column 16 and the depth step at column 40: two columns each, four more on either side
    assert by_name["silhouette"].pixels == height * (2 + 8) * 2


def test_silhouettes_are_edges_and_steps_but_not_slopes() -> None:
    covered = np.ones((30, 40), dtype=bool)
    slope = np.tile(np.linspace(1, 9, 40, dtype=np.float32), (30, 1))
    assert not silhouettes(covered, slope).any()
    step = np.where(np.arange(40) < 25, 2.0, 2.5).astype(np.float32) * np.ones((30, 1), dtype=np.float32)
    assert set(np.nonzero(silhouettes(covered, step))[1]) == {24, 25}
    covered[:10] = False
    assert set(np.nonzero(silhouettes(covered, None))[0]) == {9, 10}


def test_growing_reaches_every_side_and_stops_at_the_border() -> None:
    mask = np.zeros((9, 9), dtype=bool)
    mask[4, 0] = True
    out = grown(mask, 2)
    assert out.sum() == 5 * 3
    assert out[2:7, :3].all()
    assert grown(mask, 50).all()
    np.testing.assert_array_equal(grown(mask, 0), mask)


def test_a_mask_takes_pixels_out(made: Any, save: Any, tmp_path: Path) -> None:
    from PIL import Image

    frame = made()
    rgba = frame.rgba.copy()
    rgba[:, 40:, :3] *= 0.5
    white = np.zeros(rgba.shape[:2], dtype=np.uint8)
    white[:, :40] = 255
    Image.fromarray(white).save(tmp_path / "mask.png")
    reference, test = save(frame, "a/f.exr"), save(replace(frame, rgba=rgba), "b/f.exr")
    result, maps = run(reference, test, tmp_path / "mask.png")
    assert result.overall.psnr == math.inf
    assert result.overall.pixels == 40 * rgba.shape[0]
    assert maps.counted.sum() == result.overall.pixels
    Image.fromarray(0 * white).save(tmp_path / "black.png")
    with pytest.raises(InputError, match="without a white pixel"):
        run(reference, test, tmp_path / "black.png")


# --- pairs and bad files ---------------------------------------------------------------------------------------------


def test_folders_are_matched_by_name_and_exr_goes_first(made: Any, save: Any, tmp_path: Path) -> None:
    for name in ("a/x.exr", "a/x.png", "a/y.png", "b/x.png", "b/y.exr", "b/more.png", "a/notes.txt"):
        save(made(), name) if not name.endswith("txt") else (tmp_path / name).write_text("")
    found = find_pairs([tmp_path / "a"], [tmp_path / "b"])
    assert [(p.name, p.reference.name, p.test.name) for p in found.pairs] == [
        ("x", "x.exr", "x.png"),
        ("y", "y.png", "y.exr"),
    ]
    assert found.without_test == ()
    assert found.without_reference == (f"more: no partner in {tmp_path / 'a'}",)


def engine_folder(save: Any, frame: Any, name: str) -> None:
    """As `mirelight realtime` leaves one: the frame, the unlit frame, and the engine's meta.json."""
    for picture in ("frame", "unlit"):
        path = save(frame, f"{name}/{picture}.png")
    path.with_name("meta.json").write_text('{"engine": {"version": "2.23.3"}}')


def test_folders_of_the_engine_are_matched_by_their_name(made: Any, save: Any, tmp_path: Path) -> None:
    """What `render` and `realtime` write of one job, each into a folder of its own."""
    for name in ("front.night", "front.day", "side.night"):
        save(made(), f"room/{name}.exr")
        save(made(), f"room/{name}.png")
    for name in ("front.night", "side.night", "top.night"):
        engine_folder(save, made(), f"live/{name}")
    found = find_pairs([tmp_path / "room"], [tmp_path / "live"])
    assert [(p.name, p.reference.name, p.test.relative_to(tmp_path).as_posix()) for p in found.pairs] == [
        ("front.night", "front.night.exr", "live/front.night/frame.png"),
        ("side.night", "side.night.exr", "live/side.night/frame.png"),
    ]
    assert found.without_test == (f"front.day: no partner in {tmp_path / 'live'}",)
    assert found.without_reference == (f"top.night: no partner in {tmp_path / 'room'}",)
    back = find_pairs([tmp_path / "live"], [tmp_path / "room"])
    assert [p.reference.name for p in back.pairs] == ["frame.png"] * 2
    (one,) = find_pairs([tmp_path / "room" / "front.day.exr"], [tmp_path / "live" / "top.night"]).pairs
    assert (one.name, one.test.name) == ("front.day", "frame.png")


def test_the_engines_pictures_are_premultiplied(tmp_path: Path) -> None:
    """Half-covered white is stored as half white, and shown over black so; other files hold the colour itself."""
    from PIL import Image

    pixels = np.full((4, 4, 4), 128, np.uint8)
    for name in ("frame.png", "unlit.png", "other.png"):
        Image.fromarray(pixels, "RGBA").save(tmp_path / name)
    straight = read_picture(tmp_path / "frame.png").rgb
    np.testing.assert_allclose(straight, (128 / 255) ** 2, rtol=1e-6)
    (tmp_path / "meta.json").write_text('{"engine": {"version": "2.23.3"}}')
    for name in ("frame.png", "unlit.png"):
        np.testing.assert_allclose(read_picture(tmp_path / name).rgb, 128 / 255, rtol=1e-6)
    np.testing.assert_array_equal(read_picture(tmp_path / "other.png").rgb, straight)


def test_a_frame_without_partner_is_an_error(made: Any, save: Any, tmp_path: Path) -> None:
    save(made(), "a/x.png")
    save(made(), "b/y.png")
    with pytest.raises(InputError, match=r"no frame of .*a by name \(x there, y here\)"):
        find_pairs([tmp_path / "a"], [tmp_path / "b"])
    with pytest.raises(InputError, match="1 references and 2 tests"):
        find_pairs([tmp_path / "a"], [tmp_path / "b", tmp_path / "a"])
    with pytest.raises(InputError, match="one side is a folder"):
        find_pairs([tmp_path / "a"], [tmp_path / "b" / "y.png"])
    with pytest.raises(InputError, match="no such file"):
        find_pairs([tmp_path / "a" / "x.png"], [tmp_path / "gone.png"])


def test_pairs_of_one_name_are_told_apart(made: Any, save: Any, tmp_path: Path) -> None:
    files = [save(made(), f"{folder}/f.png") for folder in ("one", "two", "other")]
    assert [p.name for p in find_pairs(files[:2], [files[2]] * 2).pairs] == ["one/f", "two/f"]


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("f.png", b"\x89PNG\r\n\x1a\nnot really"),
        ("f.exr", b"\x76\x2f\x31\x01broken"),
        ("f.exr", b"plain text"),
        ("f.jpg", b""),
        ("f.bmp", b"BM"),
    ],
)
def test_bad_files_are_one_line(made: Any, save: Any, tmp_path: Path, name: str, content: bytes) -> None:
    bad = tmp_path / name
    bad.write_bytes(content)
    with pytest.raises(InputError) as caught:
        run(save(made(), "a/f.exr"), bad)
    assert str(bad) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_truncated_png_is_one_line(made: Any, save: Any, tmp_path: Path) -> None:
    whole = save(made(), "a/f.png").read_bytes()
    (tmp_path / "cut.png").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match=r"cut\.png"):
        run(tmp_path / "a" / "f.png", tmp_path / "cut.png")


def test_sizes_must_agree(made: Any, save: Any, tmp_path: Path) -> None:
    from PIL import Image

    Image.new("RGB", (5, 5)).save(tmp_path / "small.png")
    with pytest.raises(InputError, match="5 x 5 pixels where the reference has 64 x 48"):
        run(save(made(), "a/f.exr"), tmp_path / "small.png")


@pytest.mark.parametrize(
    ("size", "said"),
    [
        ((96, 128), "128 x 96 pixels where the reference has 64 x 48, exactly 2 times as many each way: "),
        ((24, 32), "64 x 48, exactly 2 times as few each way: another resolution or device pixel ratio"),
        ((63, 85), "64 x 48, 1.328 times as many each way: "),
        ((48, 50), "64 x 48, as high as that: a crop, or a window of another shape"),
        ((60, 64), "64 x 48, as wide as that: "),
        ((64, 48), "64 x 48, turned by 90 degrees or with width and height swapped"),
        ((30, 50), "64 x 48; render one size"),
    ],
)
def test_two_sizes_say_where_they_may_come_from(
    size: tuple[int, int], said: str, made: Any, save: Any, tmp_path: Path
) -> None:
    from PIL import Image

    Image.new("RGB", size[::-1]).save(tmp_path / "other.png")
    with pytest.raises(InputError) as error:
        run(save(made(), "a/f.exr"), tmp_path / "other.png")
    assert said in str(error.value)


def test_an_exr_without_colour_is_refused(tmp_path: Path) -> None:
    from mirelight.io.exr import write_exr

    write_exr(tmp_path / "z.exr", {"Z": np.ones((4, 4), dtype=np.float32)}, {})
    with pytest.raises(InputError, match="without channels R, G and B"):
        read_picture(tmp_path / "z.exr")


def test_a_broken_meta_file_is_ignored(made: Any, save: Any) -> None:
    png = save(made(), "a/f.png")
    from PIL import Image

    Image.open(png).convert("RGB").save(png)  # without its text chunks
    png.with_name("meta.json").write_text("{broken")
    assert read_picture(png).settings == {}
    png.with_name("meta.json").write_text(json.dumps({"something": 1}))
    assert read_picture(png).settings == {}


def test_display_of_the_comparison_is_that_of_the_writer(made: Any) -> None:
    """Guards the fixture itself: the frames have contrast to compare."""
    shown = encode_display(made().rgba, DisplaySettings())
    assert shown.std() > 30
