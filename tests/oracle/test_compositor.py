"""The Dr.Jit compositor against the NumPy oracle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mirelight import relighting
from mirelight.apps import bake
from mirelight.base.primaries import acescct_decoded, acescct_encoded
from mirelight.base.sh import C0
from mirelight.compositor import Compositor, composite, reference
from mirelight.model import Camera, CompositorSettings

from .compositor_clouds import (
    COMPACT,
    PHYSICAL,
    PLAYCANVAS,
    VIEW,
    assert_agrees,
    changed,
    cloud,
    front,
    one,
    same_bits,
    splat_cloud,
    stacked,
    unit,
)

PROFILES = pytest.mark.parametrize("settings", [PHYSICAL, PLAYCANVAS, COMPACT], ids=["physical", "large", "compact"])


@PROFILES
@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_sh_degrees(settings: CompositorSettings, degree: int) -> None:
    layer = assert_agrees(cloud(degree=degree), VIEW, settings)
    assert 0.02 < layer.transmittance.mean() < 0.9


CAMERAS = {
    "off-centre": replace(VIEW, cx=11.0, cy=90.0, fx=70.0, fy=45.0),
    "orthographic": replace(VIEW, projection="orthographic", fx=9.0, fy=11.0),
    "very wide": replace(VIEW, fx=6.0, fy=6.0),
    "long": replace(VIEW, fx=900.0, fy=900.0),
    "inside, looking out": Camera.look_at((0, 0, 0), (1, 0.2, 0.3), 90, 50, yfov=100),
    "between the splats' middles": Camera.look_at((0.1, 0.05, 0), (0, 0, 0), 33, 41, yfov=150, near=1e-3),
    "one pixel": replace(VIEW, width=1, height=1, cx=0.5, cy=0.5),
    "one column": replace(VIEW, width=1, height=65),
    "no whole tile": replace(VIEW, width=3, height=7),
    "near and far": replace(VIEW, near=3.0, far=5.0),
}


@PROFILES
@pytest.mark.parametrize("name", CAMERAS)
def test_cameras(settings: CompositorSettings, name: str) -> None:
    assert_agrees(cloud(degree=1), CAMERAS[name], settings, flips=3)


@PROFILES
def test_far_from_the_origin(settings: CompositorSettings) -> None:
    shift = np.array([12345.678, -2345.6, 7654.321])
    world_from_camera = VIEW.world_from_camera.copy()
    world_from_camera[:3, 3] += shift
    far = changed(cloud(), means=(cloud().means + shift).astype(np.float32))
    assert_agrees(far, replace(VIEW, world_from_camera=world_from_camera), settings)


@PROFILES
def test_radial_order(settings: CompositorSettings) -> None:
    wide = replace(VIEW, fx=30.0, fy=30.0)
    radial = assert_agrees(cloud(), wide, replace(settings, sort="radial"))
    assert not same_bits(radial, composite(cloud(), wide, settings))


def test_a_cut_off_ends_splats_there() -> None:
    """At three standard deviations alpha is still 0.011 of the opacity, above the clip."""
    ended = assert_agrees(cloud(), VIEW, replace(PHYSICAL, cutoff=3.0), flips=6)
    whole = composite(cloud(), VIEW, PHYSICAL)
    assert not same_bits(ended, whole)
    assert same_bits(composite(cloud(), VIEW, replace(PHYSICAL, cutoff=9.0)), whole)
    middle, camera = one(scale=0.2, opacity=0.9), front(65, 65, f=200.0, distance=4.0)
    alpha = 1 - composite(middle, camera, replace(PHYSICAL, cutoff=3.0)).transmittance
    row, column = np.indices(alpha.shape) - 32.0
    deviations = np.hypot(row, column) / np.sqrt((200 * 0.2 / 4) ** 2 + 0.3)
    assert np.array_equal(alpha > 0, deviations < 3)


def test_splats_of_linear_light_blend_in_it() -> None:
    """The same numbers are blended; what they are is another thing."""
    display = stacked(one(rgb=(0.8, 0.2, 0.4)), one(mean=(0, 0, -1), rgb=(0.1, 0.9, 0.3)))
    light = replace(display, color_space="lin_rec709_display")
    old, new = (composite(x, front(), PHYSICAL) for x in (display, light))
    assert (old.linear, new.linear, reference.composite(light, front(), PHYSICAL).linear) == (False, True, True)
    assert np.array_equal(old.color, new.color)
    assert np.array_equal(relighting.unlit_rgba(new)[..., :3], new.color)
    factor = np.full((2, 3), 0.5, np.float32)
    half = bake.relit(light, factor)
    assert np.allclose(0.5 + C0 * half.sh[:, 0], 0.5 * (0.5 + C0 * light.sh[:, 0]), atol=1e-6)
    dimmed = composite(half, front(), PHYSICAL)
    assert np.allclose(dimmed.color, new.color / 2, atol=2e-6)


def test_splats_of_log_values_blend_in_them_and_are_light_then() -> None:
    """ACEScct as OpenColorIO has it; what is relit splat by splat, and what is baked, is light times the factor."""
    display = stacked(one(rgb=(0.5, 0.3, 0.4)), one(mean=(0, 0, -1), rgb=(0.2, 0.6, 0.3)))
    log = replace(display, color_space="ACEScct")
    plain, shown = (composite(x, front(), PHYSICAL) for x in (display, log))
    assert shown.linear and np.allclose(shown.color, reference.composite(log, front(), PHYSICAL).color, atol=1e-5)
    alpha = 1 - plain.transmittance[..., None]
    seen = (alpha > 0.01)[..., 0]
    straight = plain.color[seen] / alpha[seen]
    assert np.allclose(shown.color[seen], np.maximum(acescct_decoded(straight), 0) * alpha[seen], rtol=1e-4, atol=1e-6)
    assert np.allclose(acescct_encoded(acescct_decoded(straight)), straight, atol=1e-5)
    grey = np.array([0.18, 0.18, 0.18], np.float32)
    assert np.allclose(acescct_encoded(grey), 0.4135884, atol=1e-5)  # of the standard, S-2016-001
    one_of = replace(one(rgb=(0.5, 0.3, 0.4)), color_space="ACEScct")
    half = bake.relit(one_of, np.full((1, 3), 0.5, np.float32))
    assert np.allclose(
        one_of.light(half.sh[:, 0] * C0 + 0.5), 0.5 * one_of.light(one_of.sh[:, 0] * C0 + 0.5), rtol=1e-4
    )


@PROFILES
def test_opacity_compensation(settings: CompositorSettings) -> None:
    fine = replace(cloud(2000, size=0.02), antialiased=True)
    compensated = assert_agrees(fine, VIEW, settings, flips=6)
    assert (
        compensated.transmittance.mean()
        > composite(replace(fine, antialiased=False), VIEW, settings).transmittance.mean()
    )


DEGENERATE = {
    "no splats": splat_cloud(
        means=np.zeros((0, 3)),
        quats=np.zeros((0, 4)),
        scales=np.zeros((0, 3)),
        opacities=np.zeros(0),
        sh=np.zeros((0, 9, 3)),
    ),
    "one": one(),
    "points": changed(cloud(), scales=np.zeros((600, 3))),
    "needles": changed(cloud(), scales=np.tile([1.5, 1e-4, 1e-4], (600, 1))),
    "discs": changed(cloud(), scales=np.tile([0.6, 0.6, 0.0], (600, 1))),
    "larger than the picture": changed(cloud(), scales=cloud().scales * 1e4),
    "opaque": changed(cloud(), opacities=np.ones(600)),
    "invisible": changed(cloud(), opacities=np.zeros(600)),
    "at the clip": changed(cloud(), opacities=np.full(600, 1 / 255)),
    "one depth": changed(cloud(), means=np.tile([[-1, -0.3, -0.6]], (600, 1)) + 0.2 * unit(np.eye(3))[[0]]),
    "all behind": changed(cloud(), means=cloud().means + 50 * (VIEW.position - [-1, -0.3, -0.6])),
}


@PROFILES
@pytest.mark.parametrize("name", DEGENERATE)
def test_degenerate_clouds(settings: CompositorSettings, name: str) -> None:
    layer = assert_agrees(DEGENERATE[name], VIEW, replace(settings, min_pixel_size=0.0), tolerance=1e-4, flips=6)
    if name in ("no splats", "invisible", "all behind"):
        assert (layer.transmittance == 1).all() and not layer.color.any() and not layer.median_depth.any()


@PROFILES
def test_broken_numbers_drop_their_splat_alone(settings: CompositorSettings) -> None:
    splats = cloud()
    means, sh, scales, opacities = (np.array(x) for x in (splats.means, splats.sh, splats.scales, splats.opacities))
    means[::50], sh[7::50, 2], scales[11::50], opacities[13::50] = np.nan, np.nan, np.inf, np.nan
    broken = changed(splats, means=means, sh=sh, scales=scales, opacities=opacities)
    keep = np.ones(len(splats), bool)
    for first in (0, 7, 11, 13):
        keep[first::50] = False
    whole = changed(splats, **{n: getattr(splats, n)[keep] for n in ("means", "quats", "scales", "opacities", "sh")})
    if settings.profile == "playcanvas" and settings.work_buffer == "compact":
        broken = changed(broken, scales=np.where(np.isfinite(scales), scales, np.nan))
    assert same_bits(composite(broken, VIEW, settings), composite(whole, VIEW, settings))


def test_linear_pipeline_and_tone_curves() -> None:
    for fields in ({"linear": True}, {"tone": "aces", "exposure": 1.3}, {"tone": "neutral"}, {"tone": "agx"}):
        settings = replace(PLAYCANVAS, **fields)
        layer = assert_agrees(cloud(degree=1), VIEW, settings, tolerance=2e-4)
        assert layer.linear == ("linear" in fields)
        assert np.abs(layer.color - composite(cloud(degree=1), VIEW, PLAYCANVAS).color).max() > 0.05


def test_eight_bit_target_rounds_after_every_splat() -> None:
    settings = replace(PLAYCANVAS, eight_bit=True)
    layer = composite(cloud(), VIEW, settings)
    levels = layer.color * 255
    np.testing.assert_allclose(levels, np.round(levels), atol=1e-4)
    expected = reference.composite(cloud(), VIEW, settings).color
    wrong = (np.abs(layer.color - expected) > 1e-4).any(axis=2)
    assert np.count_nonzero(wrong) <= 10  # a value at half a level falls to either side
    assert np.abs(layer.color - composite(cloud(), VIEW, PLAYCANVAS).color).max() > 1 / 255


@PROFILES
def test_other_values_share_the_blend(settings: CompositorSettings) -> None:
    splats = cloud(degree=1)
    compositor = Compositor(splats, settings)
    values = np.random.default_rng(1).normal(size=(len(splats), 11)).astype(np.float32)
    layer, blended = compositor.composite_with(VIEW, values)
    assert same_bits(layer, compositor.composite(VIEW))
    expected = reference.composite_channels(splats, VIEW, values, settings)
    assert blended.shape == (*layer.transmittance.shape, 11)
    assert np.count_nonzero(np.abs(blended - expected).max(axis=2) > 5e-5) <= 2
    _, again = compositor.composite_with(VIEW, compositor.colors(VIEW), depth=False)
    np.testing.assert_array_equal(again, layer.color)


def test_what_changes_with_the_view_is_told_from_the_rest() -> None:
    splats = cloud(degree=1)
    layer = Compositor(splats).composite(VIEW, diffuse=True)
    assert same_bits(replace(layer, diffuse=None), Compositor(splats).composite(VIEW))
    plain = Compositor(replace(splats, sh=splats.sh[:, :1])).composite(VIEW)
    assert layer.diffuse is not None and not np.allclose(layer.color, plain.color, atol=1e-2)
    np.testing.assert_allclose(layer.diffuse, plain.color, atol=1e-6)
    assert Compositor(replace(splats, sh=splats.sh[:, :1])).composite(VIEW).diffuse is None


def test_other_values_are_checked() -> None:
    compositor = Compositor(cloud(5))
    for wrong in (np.zeros((4, 1)), np.zeros((5, 0)), np.full((5, 1), np.nan)):
        with pytest.raises(ValueError, match="values"):
            compositor.composite_with(VIEW, wrong.astype(np.float32))


def test_without_depth_the_colour_is_the_same() -> None:
    compositor = Compositor(cloud())
    with_depth, without = compositor.composite(VIEW), compositor.composite(VIEW, depth=False)
    np.testing.assert_array_equal(with_depth.color, without.color)
    np.testing.assert_array_equal(with_depth.transmittance, without.transmittance)
    assert not without.depth.any() and not without.median_depth.any()


def test_alpha_clip_zero_is_a_small_clip() -> None:
    assert_agrees(cloud(100), VIEW, replace(PHYSICAL, alpha_clip=0.0))
    assert_agrees(cloud(100), VIEW, replace(PLAYCANVAS, alpha_clip=0.02))


def test_two_opaque_splats_end_a_pixel_as_in_the_cuda_rasteriser() -> None:
    """There (1 - 0.99f)² is just below the limit: of two splats whose alpha is capped the second is not blended."""
    camera = front(8, 8)
    far, near = (
        one(mean=(0, 0, -1), scale=2.0, opacity=1.0, rgb=(0, 0, 1)),
        one(mean=(0, 0, 1), scale=2.0, opacity=1.0, rgb=(1, 0, 0)),
    )
    for layer in (composite(stacked(far, near), camera), reference.composite(stacked(far, near), camera, PHYSICAL)):
        middle = layer.color[4, 4]
        np.testing.assert_allclose(middle, [0.99, 0, 0], atol=1e-6)
        assert layer.transmittance[4, 4] == pytest.approx(0.01, rel=1e-5)


def test_colours_match_the_oracle() -> None:
    splats = cloud(degree=3)
    for settings in (PHYSICAL, PLAYCANVAS, replace(COMPACT, tone="aces")):
        got = Compositor(splats, settings).colors(VIEW)
        wrong = np.abs(got - reference.splat_colors(splats, VIEW, settings)) > 1e-4
        assert np.count_nonzero(wrong) <= 20  # a colour at half a step of the work buffer


@PROFILES
def test_a_camera_that_is_held_gives_the_same_pictures(settings: CompositorSettings) -> None:
    splats = cloud()
    compositor, other = Compositor(splats, settings), CAMERAS["off-centre"]
    values = np.random.default_rng(1).normal(size=(len(splats), 2)).astype(np.float32)
    alone, away = compositor.composite(VIEW), compositor.composite(other)
    _, sums = compositor.composite_with(VIEW, values)
    with compositor.holding(VIEW) as seen:
        assert 0 < len(seen) < len(splats)
        unseen = np.full_like(values, 1e6)
        unseen[seen] = values[seen]
        for _ in range(2):
            assert same_bits(compositor.composite(VIEW), alone)
            assert np.array_equal(compositor.composite_with(VIEW, unseen)[1], sums)
        assert same_bits(compositor.composite(other), away)
    _, twice = compositor.composite_with(VIEW, 2 * values)
    assert np.allclose(twice, 2 * sums, rtol=1e-4, atol=1e-5)


def test_none_is_held_of_finer_pictures() -> None:
    with (
        pytest.raises(ValueError, match="one sample"),
        Compositor(cloud(), replace(PHYSICAL, supersampling=2)).holding(VIEW),
    ):
        pass
