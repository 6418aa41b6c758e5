"""Layers of lights, groups, re-weighting, and where the next samples go: arithmetic without a tracer."""

from __future__ import annotations

import numpy as np
import pytest

from mirelight.lighting.adaptive import MOST_SAMPLES, STEP, WINDOW, Estimate, window_sum
from mirelight.lighting.develop import SURFACE, Sums, develop
from mirelight.lighting.frame import batch_size
from mirelight.lighting.layers import MAX_LAYERS, Layers, sun_shares
from mirelight.model import (
    F32,
    Camera,
    DirectionalLight,
    Environment,
    Lighting,
    LightingBuffer,
    LightLayer,
    PointLight,
    SunLight,
)

H, W = 6, 8
VIEW = Camera.look_at([0, 0, 3], [0, 0, 0], W, H)
DOWN = np.array([0.0, -1, 0])
SKY = Environment(radiance=np.ones((1, 1, 3), np.float32))


def lamp(name: str, group: str | None = None) -> PointLight:
    return PointLight(name=name, position=np.zeros(3), group=group)


# --- which light goes where ------------------------------------------------------------------------------------------


def test_lights_of_a_group_share_a_layer_of_its_name() -> None:
    lights = (lamp("a", "keys"), lamp("b"), lamp("c", "keys"), lamp("d"))
    layers = Layers.of(Lighting(lights=lights, environment=SKY), emissive=True)
    assert layers.names == ("keys", "b", "d", "environment", "emission")
    assert layers.of_light.tolist() == [0, 1, 0, 2]
    assert (layers.environment, layers.emission) == (3, 4)


def test_lights_named_as_the_environment_or_emission_do_not_collide() -> None:
    lights = (lamp("emission"), lamp("a", "environment"), lamp("environment-2"))
    layers = Layers.of(Lighting(lights=lights, environment=SKY), emissive=True)
    assert layers.names == ("emission", "environment", "environment-2", "environment-3", "emission-2")
    assert layers.of_light.tolist() == [0, 1, 2]
    assert (layers.environment, layers.emission) == (3, 4)


def test_too_many_layers_become_one_and_groups_keep_them_few() -> None:
    many = tuple(lamp(str(k)) for k in range(MAX_LAYERS + 1))
    assert Layers.of(Lighting(lights=many), emissive=False).names == ("lights",)
    grouped = tuple(lamp(str(k), f"row {k % 3}") for k in range(1000))
    layers = Layers.of(Lighting(lights=grouped), emissive=False)
    assert layers.names == ("row 0", "row 1", "row 2") and layers.of_light.max() == 2


def test_one_layer_for_everything() -> None:
    layers = Layers.of(Lighting(lights=(lamp("a"), lamp("b", "g")), environment=SKY), emissive=True, separate=False)
    assert layers.names == ("beauty",) and not layers.of_light.any() and not layers.separate


def test_suns_share_visibility_by_illuminance() -> None:
    sun = SunLight(name="sun", direction=DOWN, intensity=3.0)
    dim = DirectionalLight(name="moon", direction=DOWN, color=np.array([0.5, 0.5, 0.5]), intensity=2.0)
    np.testing.assert_allclose(sun_shares(Lighting(lights=(sun, lamp("a"), dim))), [0.75, 0, 0.25])
    assert not sun_shares(Lighting(lights=(lamp("a"),))).any()


@pytest.mark.parametrize(("spp", "size"), [(1, 1), (7, 1), (18, 2), (16, 4), (64, 16), (40, 8), (96, 16), (1024, 16)])
def test_batches_divide_the_samples_and_are_four_at_least(spp: int, size: int) -> None:
    assert batch_size(spp) == size and spp % size == 0


# --- from sums to means ----------------------------------------------------------------------------------------------


def test_means_and_variances_of_pixels_with_different_numbers_of_samples() -> None:
    """Against the textbook's formula, on batches drawn here."""
    rng = np.random.default_rng(4)
    samples = (rng.integers(2, 9, (H, W)) * 4).astype(np.int64)
    draws = rng.random((2, 2, 8, H, W, 3)).astype(np.float32)  # layer, direct and indirect, batch: the batch's mean
    taken = (np.arange(8)[:, None, None] < samples // 4)[..., None]
    light = (4 * draws * taken).sum(axis=2)
    totals = draws.sum(axis=1) * taken
    squares = np.concatenate([totals, totals.sum(axis=0, keepdims=True)]) ** 2 * 16
    layers = Layers.of(Lighting(lights=(lamp("a"), lamp("b"))), emissive=False)
    sums = Sums(light.ravel(), squares.sum(axis=1).astype(np.float32).ravel(), np.zeros(H * W * SURFACE, np.float32))
    buffer = develop(VIEW, layers, sums, samples.ravel(), batch=4)
    assert buffer.spp == samples.min()
    assert buffer.samples is not None and np.array_equal(buffer.samples, samples)
    for y, x in ((0, 0), (2, 5), (5, 7)):
        n = samples[y, x] // 4
        for k, layer in enumerate(buffer.layers):
            own = draws[k, :, :n, y, x].astype(np.float64)
            np.testing.assert_allclose(layer.direct[y, x], own[0].mean(axis=0), rtol=1e-5)
            np.testing.assert_allclose(layer.indirect[y, x], own[1].mean(axis=0), rtol=1e-5)
            assert layer.variance is not None
            np.testing.assert_allclose(layer.variance[y, x], own.sum(axis=0).var(axis=0, ddof=1) / n, rtol=1e-3)
        every = draws[:, :, :n, y, x].astype(np.float64).sum(axis=(0, 1))
        assert buffer.variance is not None
        np.testing.assert_allclose(buffer.variance[y, x], every.var(axis=0, ddof=1) / n, rtol=1e-3)


# --- re-weighting ----------------------------------------------------------------------------------------------------


def lit(correlation: float = 0.0) -> LightingBuffer:
    rng = np.random.default_rng(1)

    def plane() -> F32:
        return rng.random((H, W, 3)).astype(np.float32)

    layers = tuple(LightLayer(name=n, direct=plane(), indirect=plane(), variance=plane()) for n in "abc")
    sigma = [np.sqrt(x.variance) for x in layers if x.variance is not None]
    variance = (1 - correlation) * sum(s**2 for s in sigma) + correlation * np.asarray(sum(sigma)) ** 2
    one = np.ones((H, W, 3), np.float32)
    return LightingBuffer(
        camera=VIEW,
        coverage=one[..., 0],
        layers=layers,
        depth=one[..., 0],
        position=one,
        normal=one,
        geometric_normal=one,
        albedo=one,
        variance=np.asarray(variance, np.float32),
    )


def test_reweighting_multiplies_layers_and_their_noise() -> None:
    before = lit()
    after = before.reweighted({"a": 2.0, "c": (0.0, 0.5, 1.0)})
    assert np.array_equal(after.layers[0].direct, 2 * before.layers[0].direct)
    assert np.array_equal(after.layers[1].indirect, before.layers[1].indirect)
    assert not after.layers[2].direct[..., 0].any()
    assert after.layers[0].variance is not None and before.layers[0].variance is not None
    assert np.array_equal(after.layers[0].variance, 4 * before.layers[0].variance)
    np.testing.assert_allclose(after.beauty, sum(x.total for x in after.layers), rtol=1e-6)


@pytest.mark.parametrize("correlation", [0.0, 0.3, 1.0])
def test_the_variance_of_a_reweighted_sum_keeps_the_layers_correlation(correlation: float) -> None:
    before = lit(correlation)
    same, some = before.reweighted({}), before.reweighted({"a": 3.0, "b": 0.0})
    assert same.variance is not None and before.variance is not None and some.variance is not None
    np.testing.assert_allclose(same.variance, before.variance, rtol=1e-4)
    s = [np.sqrt(np.asarray(x.variance)) for x in before.layers]
    truth = 9 * s[0] ** 2 + s[2] ** 2 + 2 * correlation * 3 * s[0] * s[2]
    np.testing.assert_allclose(some.variance, truth, rtol=1e-3)


def test_what_cannot_be_reweighted_is_refused_by_name() -> None:
    with pytest.raises(ValueError, match="no layer named 'key'; there are: a, b, c"):
        lit().reweighted({"key": 1.0})
    with pytest.raises(ValueError, match="'a': factor -1"):
        lit().reweighted({"a": -1.0})


# --- where the next samples go ---------------------------------------------------------------------------------------

SHAPE = (24, 32)


def estimate(spread: F32, samples: int = 64, batch: int = 16, seed: int = 0) -> Estimate:
    """Of pixels of brightness 1 whose samples have that standard deviation."""
    rng = np.random.default_rng(seed)
    batches = 1 + spread.reshape(1, -1, 1) * rng.standard_normal((samples // batch, spread.size, 3)) / np.sqrt(batch)
    sums, squares = batch * batches.sum(axis=0), (batch * batches) ** 2
    taken = np.full(spread.size, samples, np.int64)
    hits = np.full(spread.size, samples, np.float32)
    flat = [x.astype(np.float32).ravel() for x in (sums, squares.sum(axis=0))]
    return Estimate.of(flat[0], flat[1], hits, taken, batch, SHAPE)


def test_window_sums_are_those_of_a_loop() -> None:
    image = np.random.default_rng(2).random((7, 5))
    for reach in (1, 3):
        for y in range(7):
            for x in range(5):
                part = image[max(y - reach, 0) : y + reach + 1, max(x - reach, 0) : x + reach + 1]
                assert window_sum(image, reach)[y, x] == pytest.approx(part.sum())


def test_samples_are_in_proportion_to_the_spread() -> None:
    spread = np.where(np.arange(SHAPE[1]) < 16, 0.2, 0.8)[None, :] * np.ones(SHAPE)
    found = estimate(spread.astype(np.float32))
    assert found.relative_noise == pytest.approx(np.sqrt(np.mean(spread**2) / 64), rel=0.1)
    assert np.allclose(found.spread.reshape(SHAPE)[:, :10], 0.2, rtol=0.3)
    wanted = found.wanted(0.04).reshape(SHAPE)
    quiet, noisy = wanted[:, :10].mean(), wanted[:, -10:].mean()
    assert noisy / quiet == pytest.approx(4, rel=0.15)
    reached = np.sqrt(np.mean(spread**2 / wanted))
    assert reached == pytest.approx(0.04, rel=0.1)
    assert wanted.mean() < 0.8 * 64 * (found.relative_noise / 0.04) ** 2  # fewer than everywhere alike would need
    assert not np.any((wanted - 64) % STEP)


def test_a_pixels_own_samples_have_no_say_in_its_number() -> None:
    spread = np.full(SHAPE, 0.5, np.float32)
    calm = estimate(spread)
    spread[12, 16] = 40.0
    loud = estimate(spread)
    at = 12 * SHAPE[1] + 16
    assert loud.spread[at] == pytest.approx(calm.spread[at], rel=1e-4)
    assert loud.spread[at + 1] > 5 * calm.spread[at + 1]
    assert loud.spread[at + WINDOW + 1] == pytest.approx(calm.spread[at + WINDOW + 1], rel=1e-4)


def test_a_reached_target_asks_for_nothing_and_an_unreachable_one_ends() -> None:
    found = estimate(np.full(SHAPE, 0.5, np.float32))
    assert np.array_equal(found.wanted(found.relative_noise), found.samples)
    assert np.all(found.wanted(0.999 * found.relative_noise).sum() > found.samples.sum())
    high = Estimate(1.0, found.spread, np.full(SHAPE[0] * SHAPE[1], MOST_SAMPLES), found.covered)
    assert np.array_equal(high.wanted(1e-6), high.samples)
    assert found.wanted(1e-6).max() == 4 * 64  # one look at most quadruples


def test_a_black_or_empty_frame_needs_no_samples() -> None:
    size = SHAPE[0] * SHAPE[1]
    black, taken = np.zeros(size * 3, np.float32), np.full(size, 32)
    for hits in (0.0, 32.0):
        found = Estimate.of(black, black, np.full(size, hits, np.float32), taken, 16, SHAPE)
        assert found.relative_noise == 0 and np.array_equal(found.wanted(0.01), taken)
