"""The sky through a window: less noise where its light is looked for, and the same light wherever it is looked for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from mirelight.lighting import Tracer
from mirelight.lighting.sky_guiding import STEPS, WHOLE
from mirelight.model import Camera, Environment, Lighting, ProxyMesh, RenderSettings, SurfaceCache

from .lighting_scenes import Array, join, quad

SETTINGS = RenderSettings(spp=16, indirect="surface")


def with_a_window() -> ProxyMesh:
    """A room of 4 x 2 x 4 whose wall at x = 2 has an opening of 0.8 x 0.8 in its middle."""
    x, y, z = np.diag([2.0, 1.0, 2.0])
    return join(
        quad(-y, z, x),
        quad(y, x, z),
        quad(-x, y, z),
        quad(z, x, y),
        quad(-z, y, x),
        *(quad([2, s * 0.7, 0], [0, 0.3, 0], [0, 0, 2]) for s in (-1, 1)),
        *(quad([2, 0, s * 1.2], [0, 0.4, 0], [0, 0, 0.8]) for s in (-1, 1)),
    )


def scene() -> tuple[ProxyMesh, Lighting, Camera]:
    """Under a sky that is brightest where no window looks."""
    v, u = np.meshgrid((np.arange(32) + 0.5) / 32, (np.arange(64) + 0.5) / 64, indexing="ij")
    bright = np.where(v < 0.5, 1.0, 0.1) + 3 * np.exp(-30 * ((u - 0.1) ** 2 + (v - 0.3) ** 2))
    sky = Environment(radiance=(bright[..., None] * np.array([0.8, 0.9, 1.0])).astype(np.float32))
    view = Camera.look_at([-1.7, 0.5, 1.7], [1.0, -0.7, -0.5], 32, 24, yfov=70)
    return with_a_window(), Lighting(environment=sky), view


def spread_as(cache: SurfaceCache, table: NDArray[np.uint16] | None) -> SurfaceCache:
    return replace(cache, lights=tuple(replace(x, spread=table) for x in cache.lights))


@pytest.fixture(scope="module")
def lit() -> tuple[Tracer, Lighting, Camera, SurfaceCache]:
    proxy, lighting, view = scene()
    tracer = Tracer(proxy, SETTINGS, aovs=False)
    return tracer, lighting, view, tracer.fill(tracer.cells(0.15), lighting, samples=256)


def direct(lit: tuple[Tracer, Lighting, Camera, SurfaceCache], cache: SurfaceCache, seeds: int) -> Array:
    """(seeds, pixels, 3) the sky's own light in frames."""
    tracer, lighting, view, _ = lit
    out = []
    for seed in range(seeds):
        tracer.settings = replace(SETTINGS, seed=seed)
        out.append(tracer.trace(lighting, view, cache=cache).layers[0].direct.reshape(-1, 3).astype(np.float64))
    return np.stack(out)


def test_a_window_is_found(lit: tuple[Tracer, Lighting, Camera, SurfaceCache]) -> None:
    """A variance of less than a third, and the mean of what is sampled everywhere alike."""
    cache = lit[3]
    table = cache.lights[0].spread
    assert table is not None and table.shape[1] == STEPS
    looked_for, even = direct(lit, cache, 8), direct(lit, spread_as(cache, None), 8)
    assert looked_for.var(axis=0, ddof=1).mean() < 0.33 * even.var(axis=0, ddof=1).mean()
    _agree(looked_for, even)


def test_where_light_is_looked_for_does_not_change_it(lit: tuple[Tracer, Lighting, Camera, SurfaceCache]) -> None:
    """Tables that have nothing to do with the room, one of them with shares of no width, only cost noise."""
    cache, rng = lit[3], np.random.default_rng(4)
    assert cache.lights[0].spread is not None
    rows = len(cache.lights[0].spread)
    wrong = np.sort(rng.integers(0, WHOLE, (rows, STEPS)), axis=1)
    wrong[:, 0], wrong[:, 20:24] = 0, wrong[:, 20:21]
    _agree(direct(lit, spread_as(cache, wrong.astype(np.uint16)), 12), direct(lit, cache, 12))


def _agree(some: Array, others: Array) -> None:
    """The picture's mean, within four standard errors; a tenth more light is seen."""
    one, other = some.mean(axis=(1, 2)), others.mean(axis=(1, 2))
    error = np.sqrt(one.var(ddof=1) / len(one) + other.var(ddof=1) / len(other))
    assert abs(one.mean() - other.mean()) < 4 * error < 0.1 * other.mean()


def test_cells_have_the_light_of_the_window(lit: tuple[Tracer, Lighting, Camera, SurfaceCache]) -> None:
    """What is read and what is sampled together are what is traced; the fill and the traced mean err by 2 % each."""
    tracer, lighting, view, cache = lit
    tracer.settings = replace(SETTINGS, spp=512, indirect="traced")
    traced = tracer.trace(lighting, view).layers[0].direct.mean()
    assert abs(direct(lit, cache, 2).mean() / traced - 1) < 0.08
