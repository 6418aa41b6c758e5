"""How samples are shared out: errors of neighbouring pixels cancel, and first hits that are read send many rays."""

from __future__ import annotations

from dataclasses import replace

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from ztest import Array, block_means, worst_and_allowed

from mirelight.base import backend
from mirelight.lighting import Tracer, frame
from mirelight.model import RenderSettings

from ..analytic.test_surface_cache import stage

SEEDS = 12


def test_pixels_of_a_block_have_neighbouring_pieces_of_one_sequence() -> None:
    backend.mitsuba("llvm_ad_rgb")
    from mirelight.lighting.kernel.samples import Tiles, of_pixel

    def numbered(side: int) -> tuple[Array, Array]:
        x, y = (mi.UInt32(v.ravel().astype(np.uint32)) for v in np.meshgrid(np.arange(16), np.arange(16)))
        first, tile = of_pixel(x, y, Tiles(mi.UInt32(side), mi.UInt32(2)))
        dr.eval(first, tile)
        return first.numpy().reshape(16, 16).astype(float), tile.numpy().reshape(16, 16).astype(float)

    first, tile = numbered(3)
    assert len(np.unique(tile)) == 4 and np.ptp(tile[:8, 8:]) == 0
    assert sorted(first[:8, :8].ravel()) == list(range(0, 256, 4))
    for block in (2, 4):
        pieces = first[:8, :8].reshape(8 // block, block, 8 // block, block)
        assert (np.ptp(pieces, axis=(1, 3)) == 4 * (block**2 - 1)).all()
    first, tile = numbered(0)
    assert (first == 0).all() and len(np.unique(tile)) == 256


@pytest.mark.parametrize(("spp", "noise", "side", "most"), [(16, None, 6, 4), (65536, None, 6, 16), (32, 0.01, 0, 0)])
def test_a_tile_s_numbers_fit_in_their_bits(spp: int, noise: float | None, side: int, most: int) -> None:
    """Under a noise target a pixel's neighbours must know nothing of its own samples."""
    found = frame.tile_size(RenderSettings(spp=spp, noise=noise))
    assert found == (side, most) and 2 * side + most <= frame.INDEX_BITS


def test_means_over_neighbours_err_less_than_pixels_on_their_own() -> None:
    """Four independent pixels a side: a sixteenth of their variance; of one sequence it is half of that."""
    proxy, lighting, view = stage()
    view = view.resized(32, 24)
    settings = RenderSettings(spp=4, max_depth=1)
    tracer = Tracer(proxy, settings, layers=False, aovs=False)
    made = []
    for seed in range(2 * SEEDS):
        tracer.settings = replace(settings, seed=seed)
        made.append(tracer.trace(lighting, view).beauty.astype(np.float64))
    single = np.var(np.stack(made), axis=0, ddof=1).mean()
    together = np.var(block_means(np.stack(made), 4), axis=0, ddof=1).mean()
    assert together < 0.7 * single / 16


def test_several_rays_of_a_first_hit_have_the_same_mean_and_less_noise(monkeypatch: pytest.MonkeyPatch) -> None:
    proxy, lighting, view = stage()
    tracer = Tracer(proxy, RenderSettings(spp=16, indirect="surface"))
    cache = tracer.fill(tracer.cells(0.12), lighting, samples=64)

    def made(rays: int, first_seed: int) -> tuple[Array, Array]:
        monkeypatch.setattr(frame, "FIRST_RAYS", rays)
        buffers = []
        for seed in range(SEEDS):
            tracer.settings = replace(tracer.settings, seed=first_seed + seed)
            buffers.append(tracer.trace(lighting, view, cache=cache))
        light = np.stack([x.beauty.astype(np.float64) for x in buffers])
        return light, np.stack([np.asarray(x.sun_visibility, np.float64)[..., None] for x in buffers])

    one, several = made(1, 0), made(8, 100)
    for before, after in zip(one, several, strict=True):
        worst, allowed = worst_and_allowed(after, before, rounding=0.002)
        assert worst < allowed
    light, light_before = (np.var(x[0], axis=0, ddof=1).mean() for x in (several, one))
    assert light < 0.9 * light_before  # the rest is edges within a pixel
