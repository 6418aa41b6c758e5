"""Light between cells: what another sky costs and how right it is, and a flat whose walls are thin.

    python scripts/bench_transport.py                     # indirect light on cells: rays between cells, a fill of
                                                          # their own for each sky, and patches or SH of the sky
    python scripts/bench_transport.py --sizes             # cells of other sizes, with as many rays in all
    python scripts/bench_transport.py --flat FLAT.png     # traced, read from the surface, their difference x 10

Errors are root mean squares over all cells, over the mean, against a fill by generations of many samples.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np
from bench_lighting_scenes import Array, BenchScene, box, merged, scenes
from PIL import Image

from mirelight.base.colour import srgb_encode
from mirelight.lighting import Tracer
from mirelight.lighting.fill import fill
from mirelight.lighting.frame import LitProxy
from mirelight.lighting.kernel.sky import Sky
from mirelight.lighting.sunsky import plain
from mirelight.model import (
    Camera,
    CellLight,
    Environment,
    Lighting,
    LightingBuffer,
    PointLight,
    RenderSettings,
    SurfaceCells,
    SurfaceTransport,
)

T = TypeVar("T")
ROWS, COLUMNS = 128, 256
V, U = np.meshgrid((np.arange(ROWS) + 0.5) / ROWS, (np.arange(COLUMNS) + 0.5) / COLUMNS, indexing="ij")
THETA, PHI = np.pi * V, 2 * np.pi * (U - 0.5)
WAY = np.stack([np.cos(PHI) * np.sin(THETA), np.cos(THETA), np.sin(PHI) * np.sin(THETA)], axis=-1)
SIZE = np.sin(THETA) * (np.pi / ROWS) * (2 * np.pi / COLUMNS)  # solid angle of a pixel
SUN = np.array([0.55, 0.65, 0.52]) / np.linalg.norm([0.55, 0.65, 0.52])
TURNED = 130.0  # degrees
WALLS = (0.001, 0.004, 0.015, 0.06, 0.25, 1.0)


def smooth() -> Array:
    """A bright horizon, a blue zenith, dark ground."""
    up = WAY[..., 1:2]
    return np.asarray(
        np.array([0.5, 0.7, 1.0]) * (0.4 + 0.8 * np.exp(-4 * np.maximum(up, 0))) * np.where(up > 0, 1, 0.15)
    )


def with_sun() -> Array:
    """The same and a sun of three degrees, four times as bright as all of it."""
    out = smooth()
    disc = np.cos(np.radians(1.5)) < WAY @ SUN
    out[disc] += 4 / SIZE[disc].sum() * np.array([1.0, 0.9, 0.7])
    return out


def lamps() -> Array:
    """A night with two dozen bright windows."""
    rng, out = np.random.default_rng(3), np.full((ROWS, COLUMNS, 3), 0.02)
    for _ in range(24):
        row, column = rng.integers(20, 80), rng.integers(0, COLUMNS - 8)
        height, width = rng.integers(2, 10, 2)
        out[row : row + height, column : column + width] += rng.random(3) * rng.choice([1, 5, 30])
    return out


def patches(picture: Array, rows: int, columns: int) -> Array:
    """The picture's mean over patches of equal area."""
    row = np.minimum(((1 - np.cos(THETA)) / 2 * rows).astype(int), rows - 1)
    patch = (row * columns + np.minimum((U * columns).astype(int), columns - 1)).ravel()
    area = np.bincount(patch, SIZE.ravel(), rows * columns)
    sums = [np.bincount(patch, (picture[..., k] * SIZE).ravel(), rows * columns) for k in range(3)]
    return np.stack([(x / np.maximum(area, 1e-12))[patch] for x in sums], axis=-1).reshape(picture.shape)


def harmonics(picture: Array, bands: int) -> Array:
    """The picture's first bands of spherical harmonics, without what is negative."""
    from scipy.special import lpmv

    out = np.zeros_like(picture)
    for band in range(bands):
        for order in range(-band, band + 1):
            turn = np.cos(order * PHI) if order >= 0 else np.sin(-order * PHI)
            basis = lpmv(abs(order), band, np.cos(THETA)) * turn
            basis /= np.sqrt((basis**2 * SIZE).sum())
            out += basis[..., None] * (basis[..., None] * SIZE[..., None] * picture).sum(axis=(0, 1))
    return np.maximum(out, 0)


def timed(make: Callable[[], T]) -> tuple[T, float]:
    """What it makes, and the CPU seconds that it takes."""
    start = time.process_time()
    made = make()
    return made, time.process_time() - start


def by_generations(tracer: Tracer, cells: SurfaceCells, lighting: Lighting, samples: int, seed: int) -> CellLight:
    """The sky's light by a fill of its own, which shares no ray with any other."""
    settings, sky = replace(tracer.settings, seed=seed), Sky(plain(lighting).environment)
    lit = LitProxy(tracer._on_device(), sky, lighting, emission=False)
    made = fill(lit, cells, settings, samples, lambda done, total: None)
    return made.lights[0]


def _by_rays(tracer: Tracer, cells: SurfaceCells, lighting: Lighting, between: SurfaceTransport) -> CellLight:
    return tracer.fill(cells, lighting, transport=between).lights[0]


def off(one: CellLight, other: CellLight) -> tuple[float, float]:
    """(root mean square difference over the mean, difference of means over it) of reflected light."""
    a, b = (x.indirect.mean(axis=0).astype(np.float64) for x in (one, other))
    return float(np.sqrt(((a - b) ** 2).mean()) / b.mean()), float(a.mean() / b.mean() - 1)


def measure(scene: BenchScene, truth: int) -> None:
    """Print one scene's figures."""
    tracer = Tracer(scene.proxy, RenderSettings(), aovs=False)
    cells = tracer.cells([scene.camera])
    tracer.fill(cells, scene.lighting)  # compiles
    between, seconds = timed(lambda: tracer.transport(cells))
    size = between.nbytes / len(cells)
    print(f"{scene.name}: {len(cells)} cells, {seconds:.1f} s of CPU for rays, {size:.0f} bytes a cell", flush=True)
    for what, picture in (("smooth", smooth()), ("sun", with_sun()), ("windows", lamps())):

        def around(shown: Array, degrees: float = 0.0) -> Lighting:
            return Lighting(environment=Environment(radiance=shown.astype(np.float32), rotation=degrees))

        light = around(picture, TURNED)
        true = by_generations(tracer, cells, light, truth, 50)
        own, cost = timed(partial(_by_rays, tracer, cells, light, between))
        alone, fill_cost = timed(partial(by_generations, tracer, cells, light, 256, 0))
        (error, bias), (noise, _) = off(own, true), off(alone, true)
        print(
            f"  {what}, turned: error {error:.4f}, of the mean {bias:+.4f}, {cost:.1f} s; "
            f"a fill {noise:.4f}, {fill_cost:.1f} s",
            flush=True,
        )
        own = _by_rays(tracer, cells, around(picture), between)
        for basis, shown, numbers in (
            ("128 patches", patches(picture, 8, 16), 128),
            ("512 patches", patches(picture, 16, 32), 512),
            ("SH of 4 bands", harmonics(picture, 4), 16),
            ("SH of 6 bands", harmonics(picture, 6), 36),
        ):
            lost, bias = off(_by_rays(tracer, cells, around(shown), between), own)
            print(f"    {basis}, {24 * numbers} bytes: loses {lost:.4f}, of the mean {bias:+.4f}", flush=True)


def measure_sizes(scene: BenchScene, spp: int) -> None:
    """Print the error of a frame's reflected light, relative to each pixel's, for cells of three sizes; two fills each.

    The truth's own noise is taken off.
    """
    tracer = Tracer(scene.proxy, RenderSettings(spp=spp, max_depth=24, seed=777), aovs=False)
    traced = tracer.trace(scene.lighting, scene.camera)
    covered = traced.coverage > 0
    true = _reflected(traced)[covered]
    weight = 1 / (true**2 + 0.01 * true.mean() ** 2)
    own = float((np.asarray(traced.variance)[covered] * weight).mean())
    tracer.settings = RenderSettings(spp=64, indirect="surface")
    size = tracer.cells([scene.camera]).size
    for factor, rays in ((2.0, 1024), (1.0, 256), (0.5, 64)):
        cells, squared = tracer.cells([scene.camera], factor * size), []
        for seed in (1, 2):
            tracer.settings = replace(tracer.settings, seed=seed)
            cache = tracer.fill(cells, scene.lighting, samples=rays)
            made = _reflected(tracer.trace(scene.lighting, scene.camera, cache=cache))[covered]
            squared.append(float(((made - true) ** 2 * weight).mean()) - own)
        error = max(float(np.mean(squared)), 0.0) ** 0.5
        print(f"{scene.name}: {len(cells)} cells of {cells.size:.3f}, {rays} rays each: error {error:.4f}", flush=True)


def _reflected(made: LightingBuffer) -> Array:
    return np.asarray(np.sum([x.indirect for x in made.layers], axis=0, dtype=np.float64))


def flat() -> BenchScene:
    """Two rows of seven rooms on one floor, walls of a millimetre to a metre between; every other room has a lamp and a
    door to the one behind."""
    width, depth, height, x = 3.0, 6.1, 2.5, 0.0
    end = (len(WALLS) + 1) * width + sum(WALLS)
    outer = ([-0.2, 0.0, -0.2], [0.0, height, depth + 0.2]), ([end, 0.0, -0.2], [end + 0.2, height, depth + 0.2])
    across = ([-0.2, 0.0, -0.2], [end + 0.2, height, 0.0]), ([-0.2, 0.0, depth], [end + 0.2, height, depth + 0.2])
    parts = [box([-0.3, -0.2, -0.3], [end + 0.3, 0.0, depth + 0.3])] + [box(a, b) for a, b in (*outer, *across)]
    lights = []
    for k, thick in enumerate((*WALLS, 0.0)):
        for a, b in ((x, x + 1.0), (x + 1.9, x + width)):
            parts.append(box([a, 0.0, 3.0], [b, height, 3.02]))
        parts.append(box([x + 1.0, 2.0, 3.0], [x + 1.9, height, 3.02]))
        parts.append(box([x + 0.3, 0.0, 0.4], [x + 1.1, 0.8, 1.0]))
        if k % 2 == 0:
            lights.append(PointLight(name=f"{k}", position=np.array([x + 1.5, 1.6, 1.5]), intensity=4.0))
        x += width
        if thick:
            parts.append(box([x, 0.0, 0.0], [x + thick, height, depth]))
            x += thick
    mesh = replace(merged(parts), albedo=np.array([0.7, 0.65, 0.6]))
    view = Camera.look_at([end / 2, 26, depth + 3], [end / 2, 0, depth / 2], 840, 260, yfov=17)
    return BenchScene("flat", mesh, Lighting(lights=tuple(lights)), view)


def picture_of_flat(path: Path, spp: int) -> None:
    """Write it, and print how far the means are apart and what is lit in the dark."""
    scene = flat()
    settings = RenderSettings(spp=spp, max_depth=24, seed=3)
    traced = Tracer(scene.proxy, settings, layers=False, aovs=False).trace(scene.lighting, scene.camera)
    tracer = Tracer(scene.proxy, replace(settings, indirect="surface"), layers=False, aovs=False)
    cells = tracer.cells([scene.camera])
    read = tracer.trace(scene.lighting, scene.camera, cache=tracer.fill(cells, scene.lighting))
    one, other = (x.beauty.astype(np.float64) for x in (traced, read))
    dark = one.max(axis=-1) == 0
    print(f"flat: {len(cells)} cells of {cells.size:.3f}; mean {other.mean() / one.mean() - 1:+.4f}")
    print(f"  {(other[dark].max(axis=-1) > 0).sum()} of {dark.sum()} pixels that are black are lit")
    level = 0.35 / one[~dark].mean()
    rows = [srgb_encode(np.clip(x * level, 0, 1)) for x in (one, other, 10 * np.abs(other - one))]
    Image.fromarray(np.round(255 * np.concatenate(rows)).astype(np.uint8)).save(path)


def main() -> None:
    """Measure, or draw."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--scenes", nargs="+", default=["interior", "courtyard"])
    parser.add_argument("--truth", type=int, default=1024, help="samples of a cell, or of a pixel of the flat")
    parser.add_argument("--sizes", action="store_true")
    parser.add_argument("--flat", type=Path)
    chosen = parser.parse_args()
    if chosen.flat:
        picture_of_flat(chosen.flat, chosen.truth)
        return
    for scene in scenes(96, 54, 60):
        if scene.name in chosen.scenes:
            (measure_sizes if chosen.sizes else measure)(scene, chosen.truth)


if __name__ == "__main__":
    main()
