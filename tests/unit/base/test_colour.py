"""Transfer and tone curves against values that others computed or published."""

from __future__ import annotations

from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from mirelight.base import colour
from mirelight.model import ToneCurve

ENGINE_FRAMES = Path(__file__).parents[2] / "data" / "realtime"
CURVES: tuple[ToneCurve, ...] = ("none", "aces", "neutral", "agx")


def test_srgb_matches_colour_science() -> None:
    from colour.models import eotf_inverse_sRGB, eotf_sRGB

    x = np.concatenate([np.linspace(0, 1, 4001), [0.0031308, 0.04045, 0.0031309, 0.04046]])
    np.testing.assert_allclose(colour.srgb_encode(x), eotf_inverse_sRGB(x), atol=3e-7)
    np.testing.assert_allclose(colour.srgb_decode(x), eotf_sRGB(x), atol=3e-7)


@pytest.mark.parametrize("transfer", get_args(colour.Transfer))
def test_decode_inverts_encode(transfer: colour.Transfer) -> None:
    x = np.linspace(0, 4, 5001, dtype=np.float32)
    back = colour.decode(colour.encode(x, transfer), transfer)
    np.testing.assert_allclose(back, x, rtol=2e-6, atol=1e-9)


def test_eight_bit_values_survive_a_round_trip() -> None:
    levels = np.arange(256, dtype=np.float32) / 255
    for encode, decode in ((colour.srgb_encode, colour.srgb_decode), (colour.power_encode, colour.power_decode)):
        np.testing.assert_array_equal(np.rint(encode(decode(levels)) * 255), np.arange(256))


def test_power_curve_is_plain_2_2_and_floors_negatives() -> None:
    assert colour.power_decode(0.5) == pytest.approx(0.217637641, rel=1e-6)
    assert colour.power_encode(-0.1) == 0


def test_luminance_weights_are_rec709() -> None:
    from colour.models import RGB_COLOURSPACE_BT709

    rgb = np.random.default_rng(1).random((7, 5, 3))
    expected = rgb @ RGB_COLOURSPACE_BT709.matrix_RGB_to_XYZ[1]
    np.testing.assert_allclose(colour.luminance(rgb), expected, atol=2e-4)
    assert colour.luminance([1, 1, 1]) == pytest.approx(1, abs=1e-6)


@pytest.mark.parametrize("curve", CURVES)
def test_tone_curves_keep_black_and_order_of_grays(curve: ToneCurve) -> None:
    gray = np.repeat(np.geomspace(1e-4, 1e4, 400)[:, None], 3, axis=1)
    out = colour.tone_map(gray, curve)
    assert out.dtype == np.float32
    np.testing.assert_array_equal(colour.tone_map(np.zeros((1, 3)), curve), 0)
    assert np.all(np.diff(out[:, 0].astype(np.float64)) >= 0)
    np.testing.assert_allclose(out.std(axis=1), 0, atol=2e-6 * out.max())  # grays stay gray


@pytest.mark.parametrize("curve", ["aces", "neutral", "agx"])
def test_tone_curves_are_finite_for_any_light(curve: ToneCurve) -> None:
    extreme = np.array([[np.inf, 0, 1], [3e38, 3e38, 0], [-5, 0.2, 1e-38]], dtype=np.float32)
    out = colour.tone_map(extreme, curve)
    assert np.isfinite(out).all()
    assert out.min() >= 0
    assert out.max() < 1.7  # AgX's way back from Rec.2020 leaves single channels above 1; writers clip


def test_aces_at_published_points() -> None:
    # Narkowicz 2016: x (2.51 x + 0.03) / (x (2.43 x + 0.59) + 0.14), worked out by hand
    x = np.array([[0.18, 1.0, 4.0]])
    np.testing.assert_allclose(
        colour.tone_map(x, "aces"), [[0.086724 / 0.324932, 2.54 / 3.16, 40.28 / 41.38]], atol=1e-6
    )


def test_aces_is_what_the_engine_computes_per_splat() -> None:
    """Where one splat alone is seen, the engine's frame with TONEMAP_ACES holds that splat's tone-mapped colour."""
    colours = np.load(ENGINE_FRAMES / "assets" / "synth_params.npz")["stack_rgb"]
    plain = np.load(ENGINE_FRAMES / "synth_stack" / "buffers.npz")["unlit_f32"]
    mapped = np.load(ENGINE_FRAMES / "synth_stack_aces_gamma" / "buffers.npz")["unlit_f32"]
    solid = plain[..., 3] > 0.05
    straight = plain[solid][:, :3] / plain[solid][:, 3:]
    straight_mapped = mapped[solid][:, :3] / mapped[solid][:, 3:]

    exposure = 1.3
    alone = 0
    for splat in colours:
        here = np.abs(straight - splat).max(axis=1) < 2e-4
        alone += int(here.sum())
        light = colour.tone_map(exposure * colour.power_decode(splat), "aces")
        expected = colour.power_encode(light + np.float32(colour.ENGINE_ENCODE_OFFSET))
        np.testing.assert_allclose(straight_mapped[here], np.broadcast_to(expected, (here.sum(), 3)), atol=2e-4)
    assert alone > 200


def test_neutral_keeps_colours_below_its_shoulder() -> None:
    # Khronos PBR Neutral: out = in - 0.04 wherever every channel lies in 0.08 .. 0.8
    rgb = np.random.default_rng(2).uniform(0.08, 0.8, (500, 3)).astype(np.float32)
    np.testing.assert_allclose(colour.tone_map(rgb, "neutral"), rgb - np.float32(0.04), atol=3e-7)


def test_neutral_toe_and_shoulder() -> None:
    # toe: with smallest channel x < 0.08 the offset is x - 6.25 x^2, so black stays black and pure hues keep zeros
    np.testing.assert_allclose(colour.tone_map([[0.04, 0.5, 0.3]], "neutral")[0, 0], 6.25 * 0.04**2, atol=1e-7)
    np.testing.assert_allclose(colour.tone_map([0.0, 0.5, 0.3], "neutral"), [0, 0.5, 0.3], atol=1e-7)
    # shoulder of a gray 2: peak 1.96 -> 1 - 0.24^2 / (1.96 + 0.24 - 0.76) = 0.96
    np.testing.assert_allclose(colour.tone_map([[2.0, 2.0, 2.0]], "neutral"), 0.96, atol=1e-6)
    # a bright red: peak 10, compressed to 1 - 0.0576 / 9.48, then drawn to white by 1 - 1 / (0.15 (10 - peak) + 1)
    peak = 1 - 0.0576 / 9.48
    white = 1 - 1 / (0.15 * (10 - peak) + 1)
    expected = [peak, peak * white, peak * white]
    np.testing.assert_allclose(colour.tone_map([[10.0, 0, 0]], "neutral")[0], expected, rtol=1e-5)


def test_neutral_has_no_kink() -> None:
    gray = np.repeat(np.linspace(0, 3, 30001)[:, None], 3, axis=1)
    slope = np.diff(colour.tone_map(gray, "neutral")[:, 0].astype(np.float64)) / 1e-4
    assert np.abs(np.diff(slope)).max() < 0.02


def test_agx_middle_gray_and_ends() -> None:
    # the sigmoid's pivot: 0.18 comes out as display value 1/2 under the 2.2 power
    np.testing.assert_allclose(colour.tone_map([[0.18] * 3], "agx"), 0.5**2.2, rtol=2e-5)
    # its ends lie 10 stops below and 6.5 above
    np.testing.assert_allclose(colour.tone_map([[0.18 * 2.0**6.5] * 3], "agx"), 1, atol=2e-5)
    np.testing.assert_allclose(colour.tone_map([[0.18 * 2.0**-10] * 3], "agx"), 0, atol=1e-6)


def test_agx_slope_at_middle_gray() -> None:
    # Sobotka's general contrast: 2 display units per log range of 16.5 stops
    stops = np.array([-0.05, 0.05])
    display = colour.power_encode(colour.tone_map(0.18 * 2.0 ** np.repeat(stops[:, None], 3, axis=1), "agx"))[:, 0]
    assert (display[1] - display[0]) / 0.1 == pytest.approx(2 / 16.5, rel=1e-3)


def test_agx_is_near_the_polynomial_that_others_use() -> None:
    # degree-6 fit of the same curve, used by three.js and Filament; its own error is a few thousandths
    gray = 0.18 * 2.0 ** np.linspace(-9.9, 6.4, 200)
    x = (np.log2(gray / 0.18) + 10) / 16.5
    fit = np.polyval([15.5, -40.14, 31.96, -6.868, 0.4298, 0.1191, -0.00232], x)
    display = colour.power_encode(colour.tone_map(np.repeat(gray[:, None], 3, axis=1), "agx"))[:, 0]
    assert np.abs(display - fit).max() < 0.006


def test_agx_desaturates_bright_light_and_keeps_hue_order() -> None:
    red = np.array([[1.0, 0.1, 0.02]]) * np.array([[0.1], [1.0], [10.0], [100.0]])
    out = colour.tone_map(red, "agx").clip(0, 1)
    saturation = 1 - out.min(axis=1) / out.max(axis=1)
    assert np.all(np.diff(saturation) < 0)
    assert np.all(np.diff(out, axis=1) <= 1e-6)
