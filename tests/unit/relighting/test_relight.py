"""The relighting formulas on buffers made up by hand: identities, closed forms, and the edges of the input."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, get_args

import numpy as np
import pytest

from mirelight import relighting
from mirelight.base import colour
from mirelight.model import (
    Camera,
    DisplaySettings,
    LightingBuffer,
    LightLayer,
    RelightMode,
    RelightSettings,
    SplatLayer,
    rules_of,
)
from mirelight.model.profiles import Gloss
from mirelight.pipeline import frame_diagnostics

H, W = 12, 17
TINT = RelightSettings(mode="tint")
RATIO = RelightSettings(mode="ratio")
ALBEDO = RelightSettings(mode="albedo")


def camera(width: int = W, height: int = H, x: float = 0.0) -> Camera:
    return Camera.look_at((x, 1, 4), (x, 0, 0), width, height)


def splat_layer(seed: int = 0, **changed: Any) -> SplatLayer:
    rng = np.random.default_rng(seed)
    transmittance = rng.uniform(0, 1, (H, W)).astype(np.float32)
    transmittance[0] = 1  # a row without splats
    transmittance[1] = 0  # an opaque one
    straight = rng.uniform(0, 1, (H, W, 3))
    fields: dict[str, Any] = {
        "camera": camera(),
        "color": straight * (1 - transmittance[..., None]),
        "transmittance": transmittance,
        "depth": np.ones((H, W)),
        "median_depth": np.ones((H, W)),
    }
    return SplatLayer(**(fields | changed))


def lit(radiance: Any, coverage: Any = 1.0, view: Camera | None = None) -> LightingBuffer:
    """A buffer of one layer with that radiance where the proxy covers."""
    view = view or camera()
    shape = (view.height, view.width)
    cover = np.broadcast_to(np.asarray(coverage, dtype=np.float32), shape)
    radiance = np.broadcast_to(np.asarray(radiance, dtype=np.float32), (*shape, 3))
    premultiplied = radiance * cover[..., None]
    up: Any = np.broadcast_to([0.0, 1.0, 0.0], (*shape, 3)) * (cover[..., None] > 0)
    return LightingBuffer(
        camera=view,
        coverage=cover,
        layers=(LightLayer(name="sun", direct=premultiplied * 0.75, indirect=premultiplied * 0.25),),
        depth=np.where(cover > 0, 4, 0),
        position=up * 2,
        normal=up,
        geometric_normal=up,
        albedo=np.where(cover[..., None] > 0, np.full(3, 0.5), 0),
        variance=np.full((*shape, 3), 0.04),
    )


# --- what holds in every mode ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("settings", [TINT, RATIO, replace(TINT, space="display"), replace(TINT, profile="playcanvas")])
def test_blend_zero_is_the_unlit_frame_bit_for_bit(settings: RelightSettings) -> None:
    layer = splat_layer(profile=settings.profile)
    new, captured = lit((3, 0.1, 7), 0.6), lit((0.2, 1, 1), 0.6)
    frame = relighting.apply(layer, new, replace(settings, blend=0.0), captured=captured)
    assert frame.unlit is not None
    assert frame.rgba.tobytes() == frame.unlit.tobytes()
    assert frame.factor is not None
    assert np.all(frame.factor == 1)


def test_no_lighting_is_the_unlit_frame() -> None:
    layer = splat_layer()
    frame = relighting.apply(layer, None, TINT)
    assert frame.rgba.tobytes() == relighting.unlit_rgba(layer).tobytes()


def test_alpha_is_never_relit() -> None:
    layer = splat_layer()
    for settings in (TINT, RATIO, replace(TINT, space="display")):
        frame = relighting.apply(layer, lit(5.0), settings, captured=lit(1.0))
        np.testing.assert_array_equal(frame.rgba[..., 3], 1 - layer.transmittance)


def test_unlit_encodes_back_to_the_blended_picture() -> None:
    for profile in ("physical", "playcanvas"):
        layer = splat_layer(profile=profile)
        rgba = relighting.unlit_rgba(layer)
        alpha = rgba[..., 3:]
        straight = np.divide(rgba[..., :3], alpha, out=np.zeros_like(rgba[..., :3]), where=alpha > 0)
        np.testing.assert_allclose(
            colour.encode(straight, rules_of(layer.profile).transfer) * alpha, layer.color, atol=3e-7
        )


def test_linear_composites_are_not_decoded() -> None:
    layer = splat_layer(linear=True, profile="playcanvas")
    np.testing.assert_array_equal(relighting.unlit_rgba(layer)[..., :3], layer.color)


def test_without_splats_the_frame_is_the_lit_proxy() -> None:
    buffer = lit((0.5, 1, 2), 0.25)
    frame = relighting.apply(None, buffer, replace(TINT, brightness=9.0))
    np.testing.assert_array_equal(frame.rgba[..., :3], buffer.beauty)
    np.testing.assert_array_equal(frame.rgba[..., 3], buffer.coverage)
    assert frame.unlit is None
    assert frame.factor is None


def test_wrong_combinations_are_refused() -> None:
    with pytest.raises(ValueError, match="splats, lighting, or both"):
        relighting.apply(None, None, TINT)
    with pytest.raises(ValueError, match="made under"):
        relighting.apply(splat_layer(), lit(1.0), RATIO)
    with pytest.raises(ValueError, match="traced from"):
        relighting.apply(splat_layer(), lit(1.0, view=camera(x=0.5)), TINT)
    with pytest.raises(ValueError, match="traced from"):
        relighting.apply(splat_layer(), lit(1.0), RATIO, captured=lit(1.0, view=camera(x=0.5)))


# --- tint ------------------------------------------------------------------------------------------------------------


def test_tint_formula_in_linear_light() -> None:
    """In full wherever the proxy covers anything; the background where it is far away."""
    rng = np.random.default_rng(3)
    coverage = rng.uniform(0.01, 1, (H, W))
    coverage[:, 10:] = 0
    radiance = rng.uniform(0, 2, (H, W, 3))
    settings = replace(TINT, blend=0.7, brightness=1.5, background=0.4)
    layer = splat_layer()
    frame = relighting.apply(layer, lit(radiance, coverage), settings)

    factor = 1.5 * radiance
    factor[:, 10:] = 0.4
    unlit = relighting.unlit_rgba(layer)[..., :3].astype(np.float64)
    expected, apart = 1 + 0.7 * (factor - 1), np.arange(W) != 10  # one column lies in between
    assert frame.factor is not None
    np.testing.assert_allclose(frame.factor[:, apart], expected[:, apart], rtol=2e-6)
    np.testing.assert_allclose(frame.rgba[:, apart, :3], (unlit * expected)[:, apart], rtol=2e-6, atol=1e-7)


def test_tint_in_display_space_scales_encoded_colour() -> None:
    layer = splat_layer()
    frame = relighting.apply(layer, lit(0.25), replace(TINT, space="display", brightness=2.0))
    alpha = frame.rgba[..., 3:]
    straight = np.divide(frame.rgba[..., :3], alpha, out=np.zeros_like(layer.color), where=alpha > 0)
    np.testing.assert_allclose(colour.srgb_encode(straight) * alpha, 0.5 * layer.color, atol=3e-7)


def test_display_tint_differs_from_linear_tint_as_gamma_says() -> None:
    layer = splat_layer(profile="playcanvas")
    half = lit(0.25)
    linear = relighting.apply(layer, half, TINT).rgba[..., :3]
    display = relighting.apply(layer, half, replace(TINT, space="display")).rgba[..., :3]
    np.testing.assert_allclose(display, linear * 0.5**1.2, rtol=3e-5, atol=1e-8)


def test_playcanvas_multiplies_where_it_blends() -> None:
    engine = replace(TINT, profile="playcanvas", brightness=1.0)
    gamma = splat_layer(profile="playcanvas")
    linear = splat_layer(profile="playcanvas", linear=True)
    out_gamma = relighting.apply(gamma, lit(0.5), engine).rgba[..., :3]
    out_linear = relighting.apply(linear, lit(0.5), engine).rgba[..., :3]
    np.testing.assert_allclose(out_gamma, relighting.unlit_rgba(gamma)[..., :3] * 0.5**2.2, rtol=2e-5, atol=1e-8)
    np.testing.assert_allclose(out_linear, linear.color * 0.5, rtol=1e-6)


def test_playcanvas_coverage_is_zero_or_one() -> None:
    engine = replace(TINT, profile="playcanvas", brightness=1.0, background=3.0)
    coverage = np.zeros((H, W))
    coverage[:, 8:] = 0.6  # more than half of the pixel: its one sample hits
    coverage[:, 5:8] = 0.4
    frame = relighting.apply(splat_layer(profile="playcanvas"), lit(0.5, coverage), engine)
    assert frame.factor is not None
    np.testing.assert_allclose(frame.factor[:, 8:], 0.5, rtol=1e-6)
    np.testing.assert_allclose(frame.factor[:, :8], 3.0)


# --- ratio -----------------------------------------------------------------------------------------------------------


def varied(seed: int) -> np.ndarray[Any, np.dtype[np.float64]]:
    return np.random.default_rng(seed).uniform(0.05, 3, (H, W, 3))


def test_the_same_light_changes_nothing() -> None:
    layer = splat_layer()
    light = lit(varied(4), np.random.default_rng(5).uniform(0, 1, (H, W)))
    frame = relighting.apply(layer, light, RATIO, captured=light)
    np.testing.assert_allclose(frame.rgba, relighting.unlit_rgba(layer), rtol=1e-6)


def test_twice_the_light_is_twice_the_picture() -> None:
    radiance = varied(6)
    frame = relighting.apply(splat_layer(), lit(2 * radiance), replace(RATIO, delta=0.0), captured=lit(radiance))
    assert frame.factor is not None
    np.testing.assert_allclose(frame.factor, 2, rtol=1e-6)
    np.testing.assert_allclose(frame.rgba[..., :3], 2 * relighting.unlit_rgba(splat_layer())[..., :3], rtol=1e-6)


def test_ratio_formula_with_regularisation() -> None:
    new, old, coverage = varied(7), varied(8), np.random.default_rng(9).uniform(0.1, 1, (H, W))
    frame = relighting.apply(splat_layer(), lit(new, coverage), replace(RATIO, delta=0.01), captured=lit(old, coverage))
    luminance = old @ [0.2126, 0.7152, 0.0722]
    m = (luminance * coverage).sum() / coverage.sum()
    assert frame.factor is not None
    np.testing.assert_allclose(frame.factor, np.minimum((new + 0.01 * m) / (old + 0.01 * m), 16), rtol=3e-6)


def test_ratio_is_applied_in_full_at_partly_covered_pixels() -> None:
    coverage = np.full((H, W), 0.03)
    frame = relighting.apply(splat_layer(), lit(0.3, coverage), replace(RATIO, delta=0.01), captured=lit(0.6, coverage))
    assert frame.factor is not None
    np.testing.assert_allclose(frame.factor, (0.3 + 0.006) / (0.6 + 0.006), rtol=1e-5)


def wide_frame(radiance: Any, coverage: Any, background: float = 1.0) -> Any:
    """The factor over 200 x 120 pixels whose captured radiance is 1."""
    view = camera(200, 120)
    settings = replace(RATIO, delta=0.0, background=background)
    layer = splat_layer(camera=view, **sized(120, 200))
    frame = relighting.apply(layer, lit(radiance, coverage, view), settings, captured=lit(1.0, coverage, view))
    assert frame.factor is not None
    return frame.factor


def test_ratio_is_carried_past_the_proxy_and_fades_to_the_background() -> None:
    coverage = np.zeros((120, 200))
    coverage[:, 150:] = 1
    factor = wide_frame(0.25, coverage, background=3.0)
    np.testing.assert_allclose(factor[:, 150:], 0.25, rtol=1e-6)
    trust = (3.0 - factor[60, :150, 0]) / (3.0 - 0.25)
    assert np.all(np.diff(trust) >= -1e-6)
    np.testing.assert_allclose(trust[144:], 1, atol=1e-6)  # 3 % of the longer side
    assert 0.3 < trust[138] < 0.7
    np.testing.assert_array_equal(trust[:134], 0)  # 8 %


@pytest.mark.parametrize("mode", ["tint", "ratio", "albedo"])
@pytest.mark.parametrize("edge", [37, 64, 128])
def test_a_light_from_behind_leaves_no_outline(mode: RelightMode, edge: int) -> None:
    """The side that is seen is dark, and splats reach past the proxy by 3 % of the picture.

    The edge runs slanted, straight, and along the blocks that values are averaged over.
    """
    view = camera(256, 144)
    slope = np.arange(144)[:, None] % 37 if edge == 37 else 0
    coverage = (np.arange(256) >= edge + slope).astype(np.float32) * np.ones((144, 1), np.float32)
    layer = splat_layer(camera=view, **sized(144, 256))
    new, captured = lit(0.0, coverage, view), lit(1.0, coverage, view)
    frame = relighting.apply(layer, new, RelightSettings(mode=mode), captured=captured)
    assert frame.unlit is not None
    past = (coverage == 0) & (np.arange(256) >= edge + slope - 0.03 * 256)
    assert past.sum() > 900
    kept = frame.rgba[past][:, :3].sum() / frame.unlit[past][:, :3].sum()
    assert kept < 0.02
    assert np.all(frame.rgba[:, : edge - 22, :3] == frame.unlit[:, : edge - 22, :3])


def test_the_engines_tint_ends_at_the_proxy() -> None:
    coverage = np.zeros((H, W))
    coverage[:, 8:] = 1
    engine = replace(TINT, profile="playcanvas")
    frame = relighting.apply(splat_layer(profile="playcanvas"), lit(0.0, coverage), engine)
    assert frame.factor is not None
    np.testing.assert_array_equal(frame.factor[:, :8], 1)
    np.testing.assert_array_equal(frame.factor[:, 8:], 0)


def test_gaps_in_the_proxy_are_filled_from_their_rim() -> None:
    coverage = np.ones((120, 200))
    coverage[50:54, 100:103] = 0
    ramp = np.broadcast_to(np.linspace(0.5, 1.5, 200)[None, :, None], (120, 200, 3))
    factor = wide_frame(ramp, coverage, background=100.0)
    np.testing.assert_allclose(factor, ramp, atol=0.02)
    outside = coverage > 0
    np.testing.assert_allclose(factor[outside], ramp[outside], rtol=1e-6)


def test_ratio_is_clamped_and_shadows_stay_finite() -> None:
    old = np.zeros((H, W, 3))
    old[:, :5] = 1
    frame = relighting.apply(splat_layer(), lit(1.0), RATIO, captured=lit(old))
    assert frame.factor is not None
    assert np.all(frame.factor[:, 5:] == 16)
    np.testing.assert_allclose(frame.factor[:, :5], 1, rtol=1e-6)


def test_a_black_capture_gives_the_clamp_or_one() -> None:
    new = np.zeros((H, W, 3))
    new[:, 5:] = 1
    frame = relighting.apply(splat_layer(), lit(new), RATIO, captured=lit(0.0))
    assert frame.factor is not None
    assert np.isfinite(frame.rgba).all()
    assert np.all(frame.factor[:, 5:] == 16)
    assert np.all(frame.factor[:, :5] == 1)


def test_an_empty_view_is_left_alone() -> None:
    frame = relighting.apply(splat_layer(), lit(0.0, 0.0), RATIO, captured=lit(0.0, 0.0))
    np.testing.assert_array_equal(frame.rgba, relighting.unlit_rgba(splat_layer()))


def test_ratio_ignores_the_tints_brightness_and_space() -> None:
    new, old = lit(varied(10)), lit(varied(11))
    plain = relighting.apply(splat_layer(), new, RATIO, captured=old)
    other = relighting.apply(splat_layer(), new, replace(RATIO, brightness=7, space="display"), captured=old)
    np.testing.assert_array_equal(plain.rgba, other.rgba)


def test_a_lambert_surface_is_relit_to_the_truth() -> None:
    """A textured, curved Lambert surface under two suns and skies: the ratio recovers the new picture."""
    yy, xx = np.mgrid[0:H, 0:W]
    normal = np.stack([np.sin(xx / 5), np.cos(yy / 4), np.full((H, W), 1.5)], axis=-1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    albedo = np.random.default_rng(12).uniform(0.05, 0.9, (H, W, 3))

    def irradiance(towards: Any, sun: Any, sky: Any) -> Any:
        direction = np.asarray(towards) / np.linalg.norm(towards)
        return np.maximum(normal @ direction, 0)[..., None] * np.asarray(sun) + np.asarray(sky)

    before = irradiance((0.3, 1, 0.5), (0.9, 0.8, 0.7), (0.3, 0.35, 0.5))
    after = irradiance((-1, 0.3, 0.4), (1.8, 0.9, 0.3), (0.05, 0.05, 0.1))
    layer = splat_layer(color=colour.srgb_encode(albedo * before / np.pi), transmittance=np.zeros((H, W)))
    truth = albedo * after / np.pi
    proxy_after, proxy_before = lit(0.5 * after / np.pi), lit(0.5 * before / np.pi)

    def psnr(settings: RelightSettings) -> float:
        out = relighting.apply(layer, proxy_after, settings, captured=proxy_before).rgba[..., :3]
        error = colour.srgb_encode(out).clip(0, 1) - colour.srgb_encode(truth).clip(0, 1)
        return float(-10 * np.log10(np.mean(error**2)))

    assert psnr(replace(RATIO, delta=0.0)) > 110  # float32 rounding is all that is left
    assert psnr(RATIO) > 40  # the regularisation's own cost
    assert psnr(RATIO) > psnr(TINT) + 15


# --- texture scale ---------------------------------------------------------------------------------------------------


def test_lighting_camera_rounds_as_its_profile_says() -> None:
    view = camera(17, 11)
    small = relighting.lighting_camera(view, replace(TINT, texture_scale=0.5))
    assert (small.width, small.height) == (9, 6)
    engine = relighting.lighting_camera(view, replace(TINT, texture_scale=0.5, profile="playcanvas"))
    assert (engine.width, engine.height) == (8, 5)
    assert relighting.lighting_camera(view, TINT) is view
    tiny = relighting.lighting_camera(camera(3, 2), replace(TINT, texture_scale=0.1, profile="playcanvas"))
    assert (tiny.width, tiny.height) == (1, 1)


def test_upsampling_keeps_linear_ramps_and_alignment() -> None:
    """A ramp over the view stays that ramp between the outermost coarse centres, whatever the two sizes are."""
    fine = camera(40, 24)
    coarse = relighting.lighting_camera(fine, replace(TINT, texture_scale=0.3))
    u = (np.arange(coarse.width) + 0.5) / coarse.width
    v = (np.arange(coarse.height) + 0.5) / coarse.height
    radiance = (u[None, :] + 2 * v[:, None])[..., None] * np.array([1, 2, 0.5])
    big = relighting.upsample(lit(radiance, view=coarse), fine)

    fu = np.clip((np.arange(40) + 0.5) / 40, u[0], u[-1])
    fv = np.clip((np.arange(24) + 0.5) / 24, v[0], v[-1])
    expected = (fu[None, :] + 2 * fv[:, None])[..., None] * np.array([1, 2, 0.5])
    np.testing.assert_allclose(big.beauty, expected, rtol=2e-6)
    assert big.camera is fine


def test_upsampled_aovs_are_those_of_the_surface() -> None:
    fine = camera(40, 24)
    coarse = camera(10, 6)
    coverage = np.zeros((6, 10))
    coverage[2:5, 3:7] = 1
    big = relighting.upsample(lit(1.0, coverage, view=coarse), fine)
    inside = big.coverage > 0
    assert 0 < inside.sum() < inside.size
    np.testing.assert_allclose(big.depth[inside], 4, rtol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(big.normal[inside], axis=-1), 1, rtol=1e-6)
    np.testing.assert_array_equal(big.depth[~inside], 0)
    np.testing.assert_allclose(big.beauty, big.coverage[..., None] * np.ones(3), rtol=1e-6)


def test_upsampled_variance_matches_a_monte_carlo_estimate() -> None:
    rng = np.random.default_rng(13)
    fine, coarse = camera(9, 7), camera(4, 3)
    sigma = rng.uniform(0.5, 2, (3, 4, 3))
    draws = np.stack(
        [
            relighting.upsample(lit(rng.normal(0, sigma), view=coarse), fine).beauty.astype(np.float64)
            for _ in range(4000)
        ]
    )
    noisy = replace(lit(0.0, view=coarse), variance=(sigma**2).astype(np.float32))
    predicted = relighting.upsample(noisy, fine).variance
    assert predicted is not None
    np.testing.assert_allclose(predicted / draws.var(axis=0), 1, atol=0.15)


def test_coarse_lighting_is_upsampled_into_the_frame() -> None:
    settings = replace(TINT, texture_scale=0.5)
    coarse = relighting.lighting_camera(camera(), settings)
    frame = relighting.apply(splat_layer(), lit(0.75, view=coarse), settings)
    assert frame.lighting is not None
    assert frame.lighting.coverage.shape == (H, W)
    assert frame.factor is not None
    np.testing.assert_allclose(frame.factor, 1.5, rtol=1e-6)


def test_four_lighting_pixels_of_a_frame_pixel_become_their_mean() -> None:
    """Of light and of albedo times coverage apart: what a pixel's four parts send out, over what they would."""
    settings = replace(RATIO, texture_scale=2, delta=1e-6, max_ratio=1e6)
    fine = relighting.lighting_camera(camera(), settings)
    assert (fine.width, fine.height) == (2 * W, 2 * H)
    rng = np.random.default_rng(5)
    new, old = rng.uniform(0.1, 2, (2, 2 * H, 2 * W, 3))
    coverage = rng.uniform(0.1, 1, (2 * H, 2 * W))
    frame = relighting.apply(
        splat_layer(), lit(new, coverage, fine), settings, captured=lit(old, coverage, fine), captured_level=1.0
    )

    def mean(radiance: Any) -> Any:
        return (radiance * coverage[..., None]).reshape(H, 2, W, 2, 3).mean(axis=(1, 3))

    assert frame.factor is not None and frame.lighting is not None
    np.testing.assert_allclose(frame.factor, mean(new) / mean(old), rtol=1e-4)
    np.testing.assert_allclose(frame.lighting.beauty, mean(new), rtol=1e-5)


def test_denoised_neighbours_share_their_error() -> None:
    fine = camera(2 * W, 2 * H)
    noisy = replace(lit(1.0, view=fine), variance=np.full((2 * H, 2 * W, 3), 4, np.float32))
    parted = relighting.upsample(noisy, camera()).variance
    shared = relighting.upsample(replace(noisy, noisy=noisy.layers), camera()).variance
    assert parted is not None and shared is not None
    np.testing.assert_allclose(parted, 1, rtol=1e-6)
    np.testing.assert_allclose(shared, 4, rtol=1e-6)


def test_engine_scaled_texture_darkens_towards_silhouettes() -> None:
    """The shader multiplies the interpolated colour (zeros outside) by the interpolated coverage once more."""
    settings = replace(TINT, profile="playcanvas", texture_scale=0.5, brightness=1.0, background=0.0)
    coarse = camera(8, 6)
    coverage = np.zeros((6, 8))
    coverage[:, 4:] = 1
    frame = relighting.apply(
        splat_layer(profile="playcanvas", camera=camera(16, 12), **sized(12, 16)), lit(1.0, coverage, coarse), settings
    )
    assert frame.factor is not None
    np.testing.assert_allclose(frame.factor[0, 5:11, 0], [0, 0, 0.25**2, 0.75**2, 1, 1][0:6], atol=1e-6)


def sized(height: int, width: int) -> dict[str, Any]:
    flat = np.ones((height, width), dtype=np.float32)
    return {"color": np.ones((height, width, 3)), "transmittance": 0 * flat, "depth": flat, "median_depth": flat}


# --- noise -----------------------------------------------------------------------------------------------------------


def noisy(radiance: Any, sigma: Any) -> LightingBuffer:
    return replace(lit(radiance), variance=np.broadcast_to(np.float32(sigma) ** 2, (H, W, 3)))


def test_noise_of_a_linear_tint_is_exact() -> None:
    layer = splat_layer()
    frame = relighting.apply(layer, noisy(1.0, 0.01), replace(TINT, brightness=1.5, blend=0.8))
    assert frame.noise is not None
    np.testing.assert_allclose(
        frame.noise, relighting.unlit_rgba(layer)[..., :3] * 1.5 * 0.8 * 0.01, rtol=2e-4, atol=1e-7
    )


@pytest.mark.parametrize(
    "settings",
    [RATIO, replace(TINT, space="display"), replace(TINT, profile="playcanvas"), replace(RATIO, blend=0.5)],
)
def test_noise_predicts_the_spread_of_relit_frames(settings: RelightSettings) -> None:
    rng = np.random.default_rng(14)
    layer = splat_layer(profile=settings.profile)
    new, old, sigma = 0.8, 0.5, 0.01

    def draw(mean: float) -> LightingBuffer:
        return noisy(rng.normal(mean, sigma, (H, W, 3)), sigma)

    frames = np.stack(
        [relighting.apply(layer, draw(new), settings, captured=draw(old)).rgba[..., :3] for _ in range(300)]
    )
    predicted = relighting.apply(layer, noisy(new, sigma), settings, captured=noisy(old, sigma)).noise
    assert predicted is not None
    strong = predicted > 1e-4
    assert strong.mean() > 0.5
    measured = frames.astype(np.float64).std(axis=0)
    assert np.median(measured[strong] / predicted[strong]) == pytest.approx(1, abs=0.05)


def test_unlit_frames_and_unknown_variance_have_their_noise() -> None:
    layer = splat_layer()
    still = relighting.apply(layer, noisy(1.0, 0.1), replace(TINT, blend=0.0)).noise
    assert still is not None
    assert not still.any()
    assert relighting.apply(layer, replace(lit(1.0), variance=None), TINT).noise is None
    assert relighting.apply(layer, None, TINT).noise is None
    proxy = relighting.apply(None, noisy(1.0, 0.1), TINT).noise
    assert proxy is not None
    np.testing.assert_allclose(proxy, 0.1, rtol=1e-6)


# --- albedo ----------------------------------------------------------------------------------------------------------


def of_surface(albedo: Any, light: Any) -> SplatLayer:
    """An opaque picture of a surface under light (irradiance / pi)."""
    shown = colour.srgb_encode(np.broadcast_to(np.asarray(albedo * light, np.float64), (H, W, 3)))
    return splat_layer(color=shown, transmittance=np.zeros((H, W)))


def test_albedo_is_the_surfaces_own_colour_lit_anew() -> None:
    """c = a E / pi gives a, whatever the proxy's gray, and the frame is a E_new / pi; what is unlit is black."""
    albedo, old, new = np.random.default_rng(20).uniform(0.05, 0.9, (H, W, 3)), varied(21), varied(22)
    new[:, :4] = 0
    frame = relighting.apply(
        of_surface(albedo, old), lit(0.5 * new), replace(ALBEDO, delta=1e-6), captured=lit(0.5 * old)
    )
    np.testing.assert_allclose(frame.rgba[..., :3], albedo * new, rtol=2e-4, atol=1e-6)
    assert not frame.rgba[:, :4, :3].any()


def test_albedo_formula_with_regularisation() -> None:
    albedo, old, new = np.random.default_rng(23).uniform(0.05, 0.9, (H, W, 3)), varied(24), varied(25)
    settings = replace(ALBEDO, delta=0.05, max_ratio=1.0)
    layer = of_surface(albedo, old)
    frame = relighting.apply(layer, lit(0.5 * new), settings, captured=lit(0.5 * old), captured_level=2.0)
    np.testing.assert_allclose(frame.rgba[..., :3], albedo * old / (old + 0.1) * new, rtol=2e-5)


@pytest.mark.parametrize("old", [0.0, 1e-4, 0.3])
def test_nothing_sends_out_more_than_the_brightest_surface_would(old: float) -> None:
    """Lamps and gloss in the capture, and captured shadow."""
    new = varied(26)
    frame = relighting.apply(of_surface(np.ones(3), 0.9), lit(0.5 * new), ALBEDO, captured=lit(0.5 * old))
    np.testing.assert_allclose(frame.rgba[..., :3], 0.95 * new, rtol=1e-5)
    (found,) = [x for x in frame_diagnostics.of_frame(frame, DisplaySettings(exposure=-2.0)) if x.kind == "albedo"]
    assert "100% of the splats' pixels were brighter than any surface" in found.text
    right = relighting.apply(of_surface(np.full(3, 0.5), 1.0), lit(0.5 * new), ALBEDO, captured=lit(0.5))
    assert "albedo" not in [x.kind for x in frame_diagnostics.of_frame(right, DisplaySettings())]


# --- colour that changes with the view -------------------------------------------------------------------------------


def glossy(diffuse: Any, color: Any) -> SplatLayer:
    """An opaque picture that shows `color` where its surface alone would show `diffuse`, both linear."""
    own = [colour.srgb_encode(np.broadcast_to(np.asarray(x, np.float64), (H, W, 3))) for x in (color, diffuse)]
    return splat_layer(color=own[0], diffuse=own[1], transmittance=np.zeros((H, W)))


@pytest.mark.parametrize("blend", [1.0, 0.6, 0.0])
@pytest.mark.parametrize("settings", [RATIO, TINT, ALBEDO])
def test_gloss_is_kept_faded_or_removed(settings: RelightSettings, blend: float) -> None:
    """D f + (C - D) g, the highlight's factor g: f, at most 1, or none. The picture stays between what both allow."""
    diffuse = np.random.default_rng(30).uniform(0.05, 0.4, (H, W, 3))
    color = diffuse + np.random.default_rng(31).uniform(-0.04, 0.4, (H, W, 3))
    layer, new, old = glossy(diffuse, color), lit(varied(32)), lit(varied(33) * 0.3 + 1)
    settings = replace(settings, blend=blend)

    def relit(sh: Gloss) -> Any:
        return relighting.apply(layer, new, replace(settings, sh=sh), captured=old).rgba[..., :3]

    frame = relighting.apply(layer, new, settings, captured=old)
    f = frame.factor
    assert f is not None and frame.unlit is not None
    np.testing.assert_allclose(relit("keep"), color * f, rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(relit("fade"), diffuse * f + (color - diffuse) * np.minimum(f, 1), rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(relit("remove"), diffuse * f + (color - diffuse) * (1 - blend), rtol=1e-4, atol=1e-5)
    if blend == 0:
        for sh in get_args(Gloss):
            assert np.array_equal(relit(sh), frame.unlit[..., :3])


def test_a_captured_highlight_is_never_brightened_by_fading() -> None:
    """A hundred times the light: the surface follows, the highlight on it stays as it was."""
    layer, settings = glossy(0.1, 0.9), RelightSettings(mode="ratio", sh="fade", max_ratio=1000, delta=1e-6)
    frame = relighting.apply(layer, lit(100.0), settings, captured=lit(1.0))
    np.testing.assert_allclose(frame.rgba[..., :3], 100 * 0.1 + 0.8, rtol=1e-4)


def test_a_composite_without_its_diffuse_part_is_refused() -> None:
    with pytest.raises(ValueError, match="no `diffuse`"):
        relighting.apply(splat_layer(), lit(1.0), replace(TINT, sh="fade"))


# --- splats instead of pixels ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", ["tint", "ratio", "albedo"])
def test_splats_take_the_factor_that_their_pixels_would(mode: RelightMode) -> None:
    settings = RelightSettings(mode=mode, delta=0.01)
    proxy, color, old, new = (np.random.default_rng(i).uniform(0.05, 0.9, (H * W, 3)) for i in range(4))
    of_splats = relighting.splat_relighter(
        color.astype(np.float32),
        proxy.astype(np.float32),
        settings,
        captured=old.astype(np.float32),
        captured_level=1.0,
    )

    def seen(light: Any) -> LightingBuffer:
        return replace(lit((light * proxy).reshape(H, W, 3)), albedo=proxy.reshape(H, W, 3).astype(np.float32))

    layer = of_surface(color.reshape(H, W, 3), 1.0)
    frame = relighting.apply(layer, seen(new), settings, captured=seen(old), captured_level=1.0)
    assert frame.factor is not None
    np.testing.assert_allclose(of_splats(new.astype(np.float32)), frame.factor.reshape(-1, 3), rtol=2e-5)
