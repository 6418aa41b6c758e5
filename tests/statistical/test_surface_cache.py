"""Light read from the surface against traced light: how large its bias is, and whether its error bars hold."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mirelight.lighting import Tracer
from mirelight.model import Indirect, LightingBuffer, RenderSettings

from ..analytic.test_surface_cache import stage
from .ztest import Array, worst_and_allowed

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
    cells = tracer.cells([view], 0.12)
    out = []
    for seed in range(count):
        cache = _seeded(tracer, seed).fill(cells, lighting, samples=samples)
        out.append(tracer.trace(lighting, view, cache=cache))
    return out


@pytest.mark.parametrize("indirect", ["surface", "near"])
def test_a_frame_is_the_traced_one_within_the_bias(traced: Array, indirect: Indirect) -> None:
    read = np.stack([x.beauty.astype(np.float64) for x in frames(indirect, SEEDS, 128)])
    worst, allowed = worst_and_allowed(read, traced, rounding=BIAS)
    assert worst < allowed
    worst, allowed = worst_and_allowed(1.04 * read, traced, rounding=BIAS)
    assert worst > allowed


def test_error_bars_hold_the_cache_s_own_error() -> None:
    """Few samples of a cell and many of a pixel: more of a cell make the picture's error and its bars smaller."""
    stated_by_samples = []
    for samples in (32, 1024):
        made = frames("surface", 16 if samples == 32 else 4, samples, spp=64)
        stated = [np.asarray(x.layers[-1].variance) for x in made]
        spread = np.var(np.stack([x.layers[-1].total for x in made]).astype(np.float64), axis=0, ddof=1).mean()
        assert 0.8 < np.mean(stated) / spread < 2.2
        stated_by_samples.append(np.mean(stated))
    assert stated_by_samples[1] < 0.8 * stated_by_samples[0]


def test_error_bars_hold_at_later_hits() -> None:
    made = frames("near", 12, 32)
    spread = np.var(np.stack([x.beauty for x in made]).astype(np.float64), axis=0, ddof=1).mean()
    assert 0.8 < np.mean([np.asarray(x.variance) for x in made]) / spread < 2.2
