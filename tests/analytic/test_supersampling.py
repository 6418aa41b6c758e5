"""Splats smaller than a pixel: how much light a frame holds of them, by the closed form of a widened Gaussian."""

from __future__ import annotations

import numpy as np
import pytest

from mirelight.compositor import Compositor
from mirelight.compositor.supersample import finer, reduced
from mirelight.model import Camera, CompositorSettings, SplatCloud, SplatLayer
from mirelight.relighting import unlit_rgba

SIDE, DISTANCE = 24, 4.0
OPACITY = 0.6
CAMERA = Camera.look_at((0, 0, DISTANCE), (0, 0, 0), SIDE, SIDE, yfov=40)
PIXEL = DISTANCE / CAMERA.fy  # world units, where the splat is


def splat(pixels: float) -> SplatCloud:
    """One white ball of that deviation, in pixels of the frame."""
    return SplatCloud(
        means=np.zeros((1, 3), np.float32),
        quats=np.array([[1, 0, 0, 0]], np.float32),
        scales=np.full((1, 3), pixels * PIXEL, np.float32),
        opacities=np.array([OPACITY], np.float32),
        sh=np.full((1, 1, 3), 0.5 / 0.28209479, np.float32),
    )


def compositor(pixels: float, count: int) -> Compositor:
    return Compositor(splat(pixels), CompositorSettings(supersampling=count, alpha_clip=0.0))


@pytest.mark.parametrize("count", [1, 2, 4])
def test_a_splat_covers_what_its_gaussian_does_widened_by_a_part_of_a_sample(count: int) -> None:
    """Variance 0.3 of a sample's area is added, so with more of them a pixel adds less."""
    variance = 0.4**2
    covered = float((1 - compositor(0.4, count).composite(CAMERA).transmittance).sum())
    # means of samples are as good as the integral where a sample is no wider than twice the widened deviation
    assert covered == pytest.approx(2 * np.pi * OPACITY * (variance + 0.3 / count**2), rel=0.01)


def test_all_that_a_frame_is_made_of_has_the_same_samples() -> None:
    made = compositor(1.5, 2)
    layer = made.composite(CAMERA, diffuse=True)
    same = made.composite_colors(CAMERA, made.plain_colors)
    with_values, sums = made.composite_with(CAMERA, np.ones((1, 1), np.float32))
    front = made.in_front(CAMERA, np.full((SIDE, SIDE), 2 * DISTANCE, np.float32))
    assert layer.diffuse is not None
    for other in (same, with_values.color, front.color, layer.diffuse):
        np.testing.assert_allclose(other, layer.color, atol=1e-6)
    np.testing.assert_allclose(sums[..., 0], 1 - layer.transmittance, atol=1e-6)
    there = layer.median_depth > 0
    assert there.any()
    np.testing.assert_allclose(layer.median_depth[there], DISTANCE, rtol=1e-3)


def test_light_is_averaged_not_what_displays_show() -> None:
    """Black beside white is half as bright, which displays show as 0.735; nothing beside white is half of it white."""
    seen = CAMERA.resized(2, 1)
    picture = np.array([[1, 0, 1, 0], [1, 0, 1, 0]], np.float32)[..., None] * np.ones(3, np.float32)
    clear = np.array([[0, 0, 0, 1], [0, 0, 0, 1]], np.float32)
    none = np.zeros_like(clear)
    layer = SplatLayer(camera=finer(seen, 2), color=picture, transmittance=clear, depth=none, median_depth=none)
    made = reduced(layer, seen, 2)
    np.testing.assert_allclose(made.color[0, :, 0], [0.7354, 0.5], atol=1e-3)
    np.testing.assert_allclose(unlit_rgba(made)[0, :, 0], 0.5, atol=1e-4)
    np.testing.assert_allclose(made.transmittance[0], [0, 0.5])


def test_the_real_time_profile_has_one_sample() -> None:
    plain, many = (
        Compositor(splat(1.5), CompositorSettings(profile="playcanvas", supersampling=k)).composite(CAMERA)
        for k in (1, 3)
    )
    assert np.array_equal(plain.color, many.color)
