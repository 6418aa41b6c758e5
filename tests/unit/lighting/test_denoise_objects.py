"""Denoising of inserted objects: only as far as it lessens their error."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from mirelight.lighting.denoise import denoise
from mirelight.model import Camera, LightingBuffer, LightLayer

SIZE = 96
Y, X = np.mgrid[:SIZE, :SIZE] / SIZE - 0.5
DISC = np.hypot(X, Y) < 0.3
SMOOTH = 0.4 + 0.5 * X
CHECKED = np.where((np.arange(SIZE)[:, None] // 2 + np.arange(SIZE) // 2) % 2, 0.2, 0.9)  # as a mirror may show it

Array = NDArray[np.float64]


def buffer(truth: Array, sigma: float, coverage: Array) -> LightingBuffer:
    """That light with that noise, and the same of halves and quarters of its samples; guides know the disc alone."""
    rng = np.random.default_rng(5)
    cover = coverage.astype(np.float32)
    first, second, third = (
        ((truth + rng.normal(0, 2 * sigma * s, truth.shape)) * coverage)[..., None].repeat(3, -1).astype(np.float32)
        for s in (0.5**0.5, 1, 1)
    )
    mean = np.asarray(first / 2 + second / 4 + third / 4, dtype=np.float32)
    dark, normal = np.zeros(mean.shape, np.float32), np.zeros(mean.shape, np.float32)
    normal[..., 2] = coverage > 0
    layer = LightLayer(name="sky", direct=mean, indirect=dark, half=first, quarter=second, other_quarter=third)
    camera = Camera.look_at((0, 0, 1), (0, 0, 0), SIZE, SIZE, yfov=40, name="front")
    return LightingBuffer(
        camera=camera,
        coverage=cover,
        layers=(layer,),
        depth=cover,
        position=dark,
        normal=normal,
        geometric_normal=normal,
        albedo=np.where((cover > 0)[..., None], np.full(mean.shape, 0.5, np.float32), np.float32(0)),
        variance=np.full(mean.shape, sigma**2, np.float32) * cover[..., None],
        spp=64,
    )


def cleaned(truth: Array, sigma: float, coverage: Array) -> tuple[LightingBuffer, LightingBuffer]:
    """Objects with that light before and after, beside a surface that has none."""
    objects = buffer(truth, sigma, coverage)
    made = denoise(replace(buffer(truth, sigma, 1 - coverage), objects=objects)).objects
    assert made is not None
    return objects, made


def error(found: LightingBuffer, truth: Array, where: NDArray[np.bool_]) -> float:
    """Mean square error."""
    return float(((found.beauty[..., 0] - truth)[where] ** 2).mean())


def test_grain_on_matt_objects_goes() -> None:
    before, after = cleaned(SMOOTH, 0.1, DISC * 1.0)
    left = error(after, SMOOTH, DISC)
    assert left < 0.35 * error(before, SMOOTH, DISC)
    assert after.variance is not None and left < 2 * after.variance[DISC].mean()


@pytest.mark.parametrize("sigma", [0.002, 0.01, 0.05])
def test_what_mirrors_show_stays(sigma: float) -> None:
    before, after = cleaned(CHECKED, sigma, DISC * 1.0)
    assert error(after, CHECKED, DISC) < 1.3 * error(before, CHECKED, DISC)


def test_lamps_in_mirrors_do_not_bleed() -> None:
    truth = np.where(np.hypot(X - 0.1, Y) < 0.03, 200.0, 0.3)
    before, after = cleaned(truth, 0.01, DISC * 1.0)
    dark = DISC & (truth < 1)
    assert error(after, truth, dark) < 1.5 * error(before, truth, dark)


def test_edges_stay_as_they_were_and_nothing_is_lit_beside_objects() -> None:
    coverage = np.where(DISC, 1.0, 0.0)
    coverage[SIZE // 2 :] *= 0.5
    before, after = cleaned(SMOOTH, 0.1, coverage)
    assert np.array_equal(after.beauty[coverage < 1], before.beauty[coverage < 1])
    assert not np.array_equal(after.beauty[coverage == 1], before.beauty[coverage == 1])
    assert before.variance is not None and after.variance is not None
    assert np.array_equal(after.variance[coverage < 1], before.variance[coverage < 1])


def test_layers_add_up_and_objects_out_of_sight_do_no_harm() -> None:
    _, after = cleaned(SMOOTH, 0.1, np.zeros_like(SMOOTH))
    assert not after.beauty.any()


def test_it_is_told_of_each_picture_and_ends_where_a_listener_raises() -> None:
    light = buffer(SMOOTH, 0.05, np.ones_like(SMOOTH))
    heard: list[tuple[str, float]] = []
    denoise(light, progress=lambda what, done: heard.append((what, done)))
    assert heard == [("removing noise", k / 4) for k in (0, 1, 2)]  # beauty, direct light, half: nothing is indirect

    def stop(what: str, done: float) -> None:
        if done:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        denoise(light, progress=stop)


def test_their_sum_alone_is_the_same() -> None:
    light = buffer(SMOOTH, 0.05, np.ones_like(SMOOTH))
    each, alone = denoise(light), denoise(light, layers=False)
    assert np.allclose(alone.beauty, each.beauty, rtol=1e-5, atol=1e-6)
    assert alone.variance is not None and each.variance is not None and np.array_equal(alone.variance, each.variance)
