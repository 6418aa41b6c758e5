"""Light read from the surface against traced light: how large its bias is, and whether its error bars hold."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from ztest import Array, worst_and_allowed

from mirelight.lighting import Tracer
from mirelight.model import Indirect, LightingBuffer, RenderSettings

from ..analytic.test_surface_cache import stage

SEEDS = 12
BIAS = 0.02  # of a block of 8 x 8 pixels, relative: what a cell's width may shift
DEPTH = 24


@pytest.fixture(scope="module")
def traced() -> Array:
    proxy, lighting, view = stage()
    tracer = Tracer(proxy, RenderSettings(spp=64, max_depth=DEPTH), layers=False, aovs=False)
    return np.stack([_seeded(tracer, 100 + k).trace(lighting, view).beauty.astype(np.float64) for k in range(SEEDS)])


def _seeded(tracer: Tracer, seed: int) -> Tracer:
    tracer.settings = replace(tracer.settings, seed=seed)
    return tracer


def frames(indirect: Indirect, count: int, samples: int, *, spp: int = 32) -> list[LightingBuffer]:
    """Of independent seeds, each with a fill of its own."""
    proxy, lighting, view = stage()
    tracer = Tracer(proxy, RenderSettings(spp=spp, max_depth=DEPTH, indirect=indirect), aovs=False)
    cells = tracer.cells(0.12)
    out = []
    for seed in range(count):
        cache = _seeded(tracer, seed).fill(cells, lighting, samples=samples)
        out.append(tracer.trace(lighting, view, cache=cache))
    return out


def test_a_frame_is_the_traced_one_within_the_bias(traced: Array) -> None:
    read = np.stack([x.beauty.astype(np.float64) for x in frames("surface", SEEDS, 128)])
    worst, allowed = worst_and_allowed(read, traced, rounding=BIAS)
    assert worst < allowed
    worst, allowed = worst_and_allowed(1.04 * read, traced, rounding=BIAS)
    assert worst > allowed


def test_error_bars_hold_the_cache_s_own_error() -> None:
    """A point lamp's own light has no noise, so with few samples of a cell its layer's error is the cache's.

    Deviations of a whole picture, stated and true, agree within 30 %, of layers within 50 %: smooth light's batches
    differ more than its mean errs, but few pixels are sampled twice to tell.
    """
    made = frames("surface", 16, 32, spp=64)
    ratios = []
    for k in range(3):
        spread = np.var(np.stack([x.layers[k].total for x in made]).astype(np.float64), axis=0, ddof=1).mean()
        ratios.append(np.mean([np.asarray(x.layers[k].variance) for x in made]) / spread)
    assert made[0].layers[0].name == "lamp" and 0.8 < ratios[0] < 1.4
    whole = np.var(np.stack([x.beauty for x in made]).astype(np.float64), axis=0, ddof=1).mean()
    assert 0.7**2 < np.mean([np.asarray(x.variance) for x in made]) / whole < 1.3**2
    assert min(ratios) > 0.7**2 and max(ratios) < 1.5**2
    sharp = frames("surface", 1, 1024, spp=64)[0]
    for k in range(3):
        assert np.mean(np.asarray(sharp.layers[k].variance)) < np.mean(np.asarray(made[0].layers[k].variance))
