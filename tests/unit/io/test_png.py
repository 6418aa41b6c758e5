"""Display pictures."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from mirelight import relighting
from mirelight.base import colour
from mirelight.io.image import write
from mirelight.io.png import encode_display, read_png_text, write_png
from mirelight.model import DisplaySettings, Frame, Profile, RelightSettings, ToneCurve


def shown(path: Path) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    with Image.open(path) as image:
        assert image.mode == "RGB"
        return np.asarray(image)


@pytest.mark.parametrize("background", [(0.0, 0.0, 0.0), (1.0, 1.0, 1.0), (0.2, 0.5, 0.9)])
def test_an_unlit_composite_comes_back_as_it_was_blended(
    frame: Frame, tmp_path: Path, background: tuple[float, float, float]
) -> None:
    assert frame.unlit is not None and frame.splats is not None
    write(replace(frame, rgba=frame.unlit), tmp_path / "a.png", DisplaySettings(background=background))
    blended = frame.splats.color + frame.splats.transmittance[..., None] * np.array(background, np.float32)
    assert np.array_equal(shown(tmp_path / "a.png"), np.rint(blended * 255))


def test_the_playcanvas_profile_uses_its_own_curve(frame: Frame, tmp_path: Path) -> None:
    assert frame.splats is not None
    splats = replace(frame.splats, profile="playcanvas")
    alpha = 1 - splats.transmittance[..., None]
    own = splats.color / np.where(alpha > 0, alpha, np.float32(1))
    rgba = np.concatenate([colour.power_decode(own) * alpha, alpha], axis=-1)
    write(replace(frame, splats=splats, rgba=rgba), tmp_path / "a.png")
    assert np.array_equal(shown(tmp_path / "a.png"), np.rint(splats.color * 255))


@pytest.mark.parametrize("profile", ["physical", "playcanvas"])
def test_a_lit_proxy_alone_is_shown_by_its_profile_s_curve(frame: Frame, tmp_path: Path, profile: Profile) -> None:
    lit = relighting.apply(None, frame.lighting, RelightSettings(profile=profile))
    write(lit, tmp_path / "a.png")
    light, alpha = lit.rgba[..., :3], lit.rgba[..., 3:]
    own = np.divide(light, alpha, out=np.zeros_like(light), where=alpha > 0)
    curve = {"physical": colour.srgb_encode, "playcanvas": colour.power_encode}[profile]
    assert np.abs(shown(tmp_path / "a.png") - np.clip(curve(own) * alpha, 0, 1) * 255).max() <= 0.5 + 1e-3


@pytest.mark.parametrize("tone", ["none", "aces", "neutral", "agx"])
@pytest.mark.parametrize("stops", [-2.0, 0.0, 1.5])
def test_exposure_and_tone_act_on_each_pixel_s_own_colour(tone: ToneCurve, stops: float) -> None:
    own = np.random.default_rng(0).random((5, 7, 3), dtype=np.float32) * 4
    alpha = np.random.default_rng(1).uniform(0.1, 1, (5, 7, 1)).astype(np.float32)
    rgba = np.concatenate([own * alpha, alpha], axis=-1)
    display = DisplaySettings(exposure=stops, tone=tone, background=(0.1, 0.2, 0.3))
    curve = colour.srgb_encode(colour.tone_map(own * 2**stops, tone))
    expected = np.clip(curve * alpha + np.array((0.1, 0.2, 0.3), np.float32) * (1 - alpha), 0, 1) * 255
    assert np.abs(encode_display(rgba, display) - expected).max() <= 0.5 + 1e-3


def test_stops_double_the_light() -> None:
    rgba = np.array([[[0.1, 0.2, 0.05, 1.0]]], dtype=np.float32)
    assert np.array_equal(
        encode_display(rgba, DisplaySettings(exposure=1)),
        encode_display(rgba * np.array((2, 2, 2, 1), np.float32), DisplaySettings()),
    )


def test_what_cannot_be_shown_is_black_or_white() -> None:
    rgba = np.array([[[np.nan, np.inf, -1, 1], [5, 0, 0, 0]]], dtype=np.float32)
    assert encode_display(rgba, DisplaySettings()).tolist() == [[[0, 255, 0], [0, 0, 0]]]


def test_texts_travel_with_the_picture(frame: Frame, tmp_path: Path) -> None:
    write(frame, tmp_path / "a.png")
    texts = read_png_text(tmp_path / "a.png")
    assert texts["mirelight/fingerprint"] == "f" * 64
    assert '"night"' in texts["mirelight/provenance"] and '"front"' in texts["mirelight/camera"]


@pytest.mark.parametrize("channels", [3, 4])
def test_another_reader_reads_what_was_written(tmp_path: Path, channels: int) -> None:
    """RGB, and RGBA as the engine's back buffers are."""
    pixels = np.random.default_rng(2).integers(0, 256, (7, 11, channels), dtype=np.uint8)
    write_png(tmp_path / "p.png", pixels, {"key": "value"})
    with Image.open(tmp_path / "p.png") as image:
        np.testing.assert_array_equal(np.asarray(image), pixels)
