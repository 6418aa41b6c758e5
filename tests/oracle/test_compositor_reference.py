"""The oracle itself, against closed forms worked out by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mirelight.base import sh as spherical
from mirelight.compositor import reference, source
from mirelight.model import CompositorSettings

from .compositor_clouds import COMPACT, PHYSICAL, PLAYCANVAS, VIEW, changed, cloud, front, one, stacked

EXACT = CompositorSettings(profile="playcanvas", work_buffer="large", min_pixel_size=0)


def offsets(width: int, height: int) -> tuple[np.ndarray, np.ndarray]:
    """Distances of pixel centres from the image's middle, px."""
    y, x = np.mgrid[:height, :width]
    return x + 0.5 - width / 2, y + 0.5 - height / 2


@pytest.mark.parametrize("opacity", [0.3, 0.995])
def test_one_splat_follows_the_3dgs_kernel(opacity: float) -> None:
    camera = front()
    layer = reference.composite(one(opacity=opacity), camera, PHYSICAL)
    x, y = offsets(64, 48)
    variance = (60 / 4 * 0.1) ** 2 + 0.3  # px²
    alpha = np.minimum(opacity * np.exp(-0.5 * (x * x + y * y) / variance), 0.99)
    alpha = np.where(alpha < 1 / 255, 0, alpha)
    np.testing.assert_allclose(1 - layer.transmittance, alpha, atol=1e-6)
    np.testing.assert_allclose(layer.color, alpha[..., None] * [0.2, 0.5, 0.9], atol=1e-6)
    np.testing.assert_allclose(layer.depth[alpha > 0], 4, atol=1e-5)


def test_one_splat_follows_the_engines_kernel() -> None:
    camera = front()
    layer = reference.composite(one(opacity=0.75, scale=0.125), camera, EXACT)  # exact in half floats
    x, y = offsets(64, 48)
    reach = 8 * ((60 / 4 * 0.125) ** 2 + 0.075)
    share = (x * x + y * y) / reach
    alpha = 0.75 * (np.exp(-4 * share) - np.exp(-4)) / (1 - np.exp(-4))
    alpha = np.where((share > 1) | (alpha < 1 / 255), 0, alpha)
    np.testing.assert_allclose(1 - layer.transmittance, alpha, atol=1e-6)


def test_nearer_splats_hide_farther_ones_whatever_their_order_in_the_file() -> None:
    near = one(mean=(0, 0, 1), scale=5, opacity=0.6, rgb=(1, 0, 0))
    far = one(mean=(0, 0, -1), scale=5, opacity=0.5, rgb=(0, 1, 0))
    camera = front(8, 8, f=400)
    for order in ((near, far), (far, near)):
        layer = reference.composite(stacked(*order), camera, PHYSICAL)
        np.testing.assert_allclose(layer.color[4, 4], [0.6, 0.4 * 0.5, 0], atol=2e-3)
        np.testing.assert_allclose(layer.transmittance[4, 4], 0.2, atol=2e-3)
        np.testing.assert_allclose(layer.depth[4, 4], (0.6 * 3 + 0.2 * 5) / 0.8, atol=1e-2)
        assert layer.median_depth[4, 4] == pytest.approx(3)


def test_median_depth_is_where_half_the_light_is_gone() -> None:
    layers = [one(mean=(0, 0, z), scale=5, opacity=0.3) for z in (1.5, 0.5, -0.5)]
    camera = front(4, 4, f=400)
    assert reference.composite(stacked(*layers[:1]), camera, PHYSICAL).median_depth[2, 2] == 0
    # 0.7, 0.49: the second splat takes it below one half
    assert reference.composite(stacked(*layers), camera, PHYSICAL).median_depth[2, 2] == pytest.approx(3.5)


def test_a_pixel_stops_before_the_fragment_that_would_take_it_below_a_ten_thousandth() -> None:
    wall = [one(mean=(0, 0, 1 - 0.1 * i), scale=5, opacity=1, rgb=(1, 1, 1)) for i in range(4)]
    layer = reference.composite(stacked(*wall), front(4, 4, f=400), PHYSICAL)
    # alpha is capped at 0.99f: 1e-2, and the next would leave 0.99998e-4
    assert layer.transmittance[2, 2] == pytest.approx(1e-2, rel=1e-5)
    engine = reference.composite(stacked(*wall), front(64, 48, f=400), EXACT)
    assert engine.transmittance[24, 32] < 1e-8


def test_same_depth_keeps_the_order_of_the_file() -> None:
    red, green = one(scale=5, opacity=0.5, rgb=(1, 0, 0)), one(scale=5, opacity=0.5, rgb=(0, 1, 0))
    layer = reference.composite(stacked(red, green), front(2, 2, f=400), PHYSICAL)
    np.testing.assert_allclose(layer.color[1, 1], [0.5, 0.25, 0], atol=1e-3)


def test_sh_colour_looks_along_the_ray_and_is_not_negative() -> None:
    splats = cloud(1, degree=3)
    splats = changed(splats, means=np.array([[0.3, -0.2, 0.1]]), opacities=np.ones(1))
    rgb = reference.splat_colors(splats, VIEW, PHYSICAL)[0]
    direction = splats.means[0] - VIEW.position
    values = spherical.basis(direction / np.linalg.norm(direction), 3)
    np.testing.assert_allclose(rgb, np.maximum(0.5 + values @ splats.sh[0], 0), atol=1e-6)


def test_antialiased_clouds_keep_a_small_splats_light() -> None:
    small = replace(one(scale=0.001, opacity=1), antialiased=True)
    camera = front(65, 49)  # a pixel's centre lies on the splat's
    compensated = reference.composite(small, camera, PHYSICAL)
    variance = (60 / 4 * 0.001) ** 2  # px²
    share = variance / (variance + 0.3)  # sqrt of the ratio of the two determinants
    assert share < 0.005 and compensated.transmittance.min() == pytest.approx(1 - 0.005)  # its floor
    larger = replace(one(scale=0.05, opacity=1), antialiased=True)
    peak = 1 - reference.composite(larger, front(), PHYSICAL).transmittance.min()
    variance = (60 / 4 * 0.05) ** 2
    assert peak == pytest.approx(variance / (variance + 0.3) * np.exp(-0.25 / (variance + 0.3)), rel=1e-4)


def test_the_engine_drops_splats_below_its_least_pixel_size() -> None:
    sigma = np.sqrt(0.05)  # px, where 2 sqrt(8 (sigma² + 0.075)) is 2
    for factor, drawn in ((1.05, True), (0.95, False)):
        layer = reference.composite(one(scale=factor * sigma * 4 / 60, opacity=1), front(), PLAYCANVAS)
        assert (layer.transmittance.min() < 1) == drawn


def test_the_engine_limits_quads_to_the_smaller_side() -> None:
    layer = reference.composite(one(scale=4, opacity=1), front(64, 48), EXACT)  # sigma 60 px
    x, y = offsets(64, 48)
    np.testing.assert_array_equal(layer.transmittance < 1, layer.transmittance < 1)
    covered = 1 - layer.transmittance > 0
    radius = np.sqrt(x * x + y * y)
    assert covered[radius < 39].all() and covered.any()  # quad half extent 48 px; alpha meets the clip nearer in
    share = (x * x + y * y) / 48**2
    alpha = (np.exp(-4 * share) - np.exp(-4)) / (1 - np.exp(-4))
    np.testing.assert_allclose(1 - layer.transmittance, np.where(alpha < 1 / 255, 0, alpha), atol=2e-6)


def test_near_and_far_belong_to_the_physical_profile() -> None:
    camera = replace(front(), near=4.5)
    assert reference.composite(one(), camera, PHYSICAL).transmittance.min() == 1
    assert reference.composite(one(), replace(camera, near=1, far=3.0), PHYSICAL).transmittance.min() == 1
    assert reference.composite(one(), camera, PLAYCANVAS).transmittance.min() < 1


def test_values_are_blended_like_colours() -> None:
    splats = cloud(100, degree=1)
    rgb = reference.splat_colors(splats, VIEW, PHYSICAL)
    blended = reference.composite_channels(splats, VIEW, rgb.astype(np.float32), PHYSICAL)
    np.testing.assert_allclose(blended, reference.composite(splats, VIEW, PHYSICAL).color, atol=1e-6)


def test_the_compact_work_buffer_is_what_its_bits_hold() -> None:
    """Packed into the engine's 32-bit words and read back by its formulas, written out here a second time."""
    splats = cloud(200)
    wide = changed(splats, scales=np.exp(np.linspace(-30, 12, 600)).reshape(200, 3))
    quats, scales, opacities = source.shape_of(wide, COMPACT)
    for i in range(len(wide)):
        q = wide.quats[i] * (1 if wide.quats[i][0] >= 0 else -1)
        p = q[1:] / np.sqrt(1 + q[0])
        word = 0
        for axis, (bits, shift) in enumerate(((11, 0), (11, 11), (10, 22))):
            top = (1 << bits) - 1
            word |= int(min(max((float(p[axis]) * 0.5 + 0.5) * top + 0.5, 0), top)) << shift
        back = np.array([(word & 0x7FF) / 2047, (word >> 11 & 0x7FF) / 2047, (word >> 22) / 1023]) * 2 - 1
        d = float(back @ back)
        np.testing.assert_allclose(quats[i], [1 - d, *(np.sqrt(max(0, 2 - d)) * back)], atol=1e-6)
        for value, got in zip(wide.scales[i], scales[i], strict=True):
            level = 0 if value < 1e-10 else int(min(max((np.log(float(value)) + 12) * 255 / 21 + 0.5, 1), 255))
            assert got == pytest.approx(np.exp(level * 21 / 255 - 12) if level else 0, rel=1e-5)
        assert opacities[i] == pytest.approx(int(float(wide.opacities[i]) * 255 + 0.5) / 255, abs=1e-6)


def test_the_large_work_buffer_holds_half_floats() -> None:
    splats = cloud(200)
    quats, scales, opacities = source.shape_of(splats, PLAYCANVAS)
    for got, given in ((scales, splats.scales), (opacities, splats.opacities)):
        np.testing.assert_array_equal(got, given.astype(np.float16).astype(np.float32))
    np.testing.assert_allclose(np.linalg.norm(quats, axis=1), 1, atol=1e-3)  # w is restored, but not below 0
    upper = splats.quats * np.where(splats.quats[:, :1] < 0, -1, 1)  # the same rotation with w >= 0
    np.testing.assert_allclose(quats[:, 1:], upper[:, 1:], atol=2.0**-12)
    np.testing.assert_allclose(quats[:, 0], upper[:, 0], atol=0.03)  # near 0 its square root magnifies the rounding
