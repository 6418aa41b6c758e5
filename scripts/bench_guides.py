"""What rays that are sent where a light's reflected light was found would gain in a fill of light on the surface.

A table of directions for each group of neighbouring voxels is filled by the rays that the cells have; for some cells
the variance that such a table would leave is told from 4096 rays of each, relative to that of 256 rays without.
`known`: a table for each of those cells alone, from its own 4096 rays, in place of the 256.

    python scripts/bench_guides.py [--scenes interior courtyard night]
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass, replace

import numpy as np
from bench_lighting_scenes import Array, BenchScene, scenes
from numpy.typing import NDArray

from mirelight.lighting import Tracer
from mirelight.lighting.fill import on_device
from mirelight.lighting.sky_guiding import groups
from mirelight.model import F32, RenderSettings, SurfaceCells

SIDE = 16  # of a table
RAYS, NET, MANY = 256, 128, 4096  # of a cell; of one of its halves, a Sobol' net; of cells that are judged by
JUDGED = 300  # cells
STEP = 8192  # cells at once
ANYWHERE = 0.15  # of the guided rays
GUIDED = (32, 64, 128)  # in each half


@dataclass(frozen=True, slots=True, eq=False)
class Sent:
    """Rays of n cells, R each."""

    target: NDArray[np.uint32]  # (n, R)
    albedo: Array  # (n, R, 3)
    bins: NDArray[np.int64]  # (n, R) of a table

    def brought(self, light: F32) -> Array:
        """(n, R) what they bring of cells' light (C, 3), its channels added."""
        there = self.target < len(light)
        values = light[np.where(there, self.target, 0)] * self.albedo
        return np.asarray(np.where(there, values.sum(axis=2), 0), np.float64)


def sent(tracer: Tracer, cells: SurfaceCells, some: NDArray[np.int64], rays: int, seed: int) -> Sent:
    """Cosine-distributed rays of some of the cells."""
    from mirelight.lighting.kernel.cell_points import CellPoints
    from mirelight.lighting.kernel.transport import cast

    own = replace(
        cells,
        keys=cells.keys[some],
        anchors=cells.anchors[some],
        faces=cells.faces[some],
        corners=cells.corners[some],
        normals=cells.normals[some],
        starts=np.array([0, 0, len(some)], np.uint32),
    )
    table = on_device(cells, np.zeros((1, 1, 3), np.float32), nearest=0.0)
    ends, _, where = cast(tracer._on_device(), table, CellPoints(own), seed, 0, len(some), rays)
    steps = ends[1].reshape(-1, rays)
    albedo = np.stack([(steps >> k) & 1023 for k in (20, 10, 0)], axis=-1) / 1023
    return Sent(
        ends[0].reshape(-1, rays),
        albedo,
        _bins(where[:, 2:5].reshape(-1, rays, 3), (own.keys[:, 1] >> 16).astype(np.int64)),
    )


def _bins(ways: F32, facing: NDArray[np.int64]) -> NDArray[np.int64]:
    """Azimuth and squared sine about the axis that a cell faces along."""
    up = np.concatenate([s * np.eye(3)[[k]] for k in range(3) for s in (1, -1)])[facing]
    s = np.roll(up, 1, axis=1)
    x, y = (np.einsum("crk,ck->cr", ways, q) for q in (s, np.cross(up, s)))
    u, v = np.arctan2(y, x) / (2 * np.pi) % 1, np.clip(x * x + y * y, 0, 1)
    column, row = (np.minimum((q * SIDE).astype(np.int64), SIDE - 1) for q in (u, v))
    return np.asarray(column * SIDE + row)


def measure(scene: BenchScene) -> None:
    """Print one scene's figures."""
    tracer = Tracer(scene.proxy, RenderSettings(spp=16, indirect="surface"), aovs=False)
    cells = tracer.cells([scene.camera])
    start = time.process_time()
    between = tracer.transport(cells)
    found = time.process_time() - start
    cache = tracer.fill(cells, scene.lighting, transport=between)
    print(f"{scene.name}: {len(cells)} cells, {found:.1f} s of CPU for {RAYS} rays of each", flush=True)
    group, tables = groups(cells), SIDE * SIDE
    sums = np.zeros((len(cache.lights) + 1, (int(group.max()) + 1) * tables))
    whole = [(x.direct + x.indirect + (0 if x.met is None else x.met)).mean(axis=0) for x in cache.lights]
    for first in range(0, len(cells), STEP):
        some = np.arange(first, min(first + STEP, len(cells)))
        rays = sent(tracer, cells, some, RAYS, 99 + first)
        rows = (rays.bins + group[some, None] * tables).ravel()
        sums[-1] += np.bincount(rows, minlength=sums.shape[1])
        for k, light in enumerate(whole):
            sums[k] += np.bincount(rows, np.square(rays.brought(light)).ravel(), sums.shape[1])
    some = np.sort(np.random.default_rng(0).choice(len(cells), JUDGED, replace=False))
    rays = sent(tracer, cells, some, MANY, 12345)
    for k, light in enumerate(cache.lights):
        brought = rays.brought(whole[k])
        squares = np.sqrt(sums[k] / np.maximum(sums[-1], 1)).reshape(-1, tables)[group[some]]
        own = np.stack([np.bincount(b, x * x, tables) for b, x in zip(rays.bins, brought, strict=True)])
        counts = np.stack([np.bincount(b, minlength=tables) for b in rays.bins])
        left = [_left(brought, np.take_along_axis(_density(squares), rays.bins, 1), n) for n in GUIDED]
        known = _density(np.sqrt(own / np.maximum(counts, 1)))
        left.append(_left(brought, np.take_along_axis(known, rays.bins, 1), NET, plain=0))
        says = ", ".join(f"{x:.2f}" for x in left)
        noise = np.sqrt(np.mean(np.square(light.indirect[0] - light.indirect[1]) / 4)) / light.indirect.mean()
        print(
            f"  {light.name}: noise {noise:.3f}; {', '.join(str(2 * n) for n in GUIDED)} more, known: {says}",
            flush=True,
        )


def _density(wanted: Array) -> Array:
    """(n, bins) relative to the cosine's, of which each bin has about the same."""
    mean = wanted.mean(axis=1, keepdims=True)
    return np.asarray(np.where(mean > 0, (1 - ANYWHERE) * wanted / np.where(mean > 0, mean, 1) + ANYWHERE, 1))


def _left(brought: Array, density: Array, guided: int, plain: int = NET) -> float:
    """Variance with so many guided rays beside the plain ones (balance heuristic), of that of NET plain ones."""
    mean = brought.mean(axis=1)
    weight = 1 / (mean**2 + 0.01 * mean.mean() ** 2)

    def of_nets(values: Array) -> Array:
        return np.asarray(values.reshape(len(values), -1, NET).mean(axis=2).var(axis=1, ddof=1))

    shared = brought / (plain + guided * density)
    by_guide = guided * ((density * shared**2).mean(axis=1) - (density * shared).mean(axis=1) ** 2)
    by_plain = of_nets(plain * shared)
    return float(((by_guide + by_plain) * weight).mean() / (of_nets(brought) * weight).mean())


def main() -> None:
    """Measure the scenes that were asked for."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0] if __doc__ else "")
    parser.add_argument("--scenes", nargs="+", default=["interior", "courtyard", "night"])
    chosen = parser.parse_args()
    for scene in scenes(160, 90, 220):
        if scene.name in chosen.scenes:
            measure(scene)


if __name__ == "__main__":
    main()
