"""What light on the surface gains: error² x CPU seconds of a frame, against the traced one of as many samples.

The benchmark's scenes, every layer, error against a frame of many samples and more bounces, whose own variance is taken
off; bias and the cache's noise are in it (half of the frames read one fill, half another). The fill is stated apart: it
serves every camera and every mix of the lights.

    python scripts/bench_surface.py [--scenes interior courtyard night] [--size 0.1] [--samples 256] [--frames 4]
                                    [--truth 1024] [--picture FILE.png] [--points 250000] [--bars 5] [--noise 0.03]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import numpy as np
from bench_lighting_scenes import Array, BenchScene, scenes
from PIL import Image

import mirelight
from mirelight.base.colour import srgb_encode
from mirelight.lighting import Tracer
from mirelight.lighting.albedo import face_normals
from mirelight.model import Deferred, Indirect, Job, LightingBuffer, PointLayers, RenderSettings, triangles
from mirelight.pipeline.splat_light import by_sharpness

T = TypeVar("T")
MODES: tuple[Indirect, ...] = ("traced", "surface")
FRAMES_OF_A_FILL = 4  # where error bars are measured


def timed(make: Callable[[], T]) -> tuple[T, float]:
    """What it makes, and the CPU seconds that it takes."""
    start = time.process_time()
    made = make()
    return made, time.process_time() - start


def measure(scene: BenchScene, size: float | None, samples: int, frames: int, truth_spp: int) -> list[Array]:
    """Print one scene's figures; the truth's beauty and the last frame of each mode."""
    tracer = Tracer(scene.proxy, RenderSettings(spp=truth_spp, max_depth=24, seed=777), aovs=False)
    truth = tracer.trace(scene.lighting, scene.camera)
    covered = truth.coverage > 0
    bright = truth.beauty[covered].astype(np.float64)
    weight = 1 / (bright**2 + 0.01 * bright.mean() ** 2)

    def weighted(values: Array) -> float:
        return float((values[covered] * weight).mean())

    own = weighted(np.asarray(truth.variance, np.float64))
    settings = RenderSettings(spp=16)
    tracer.settings = settings
    cells, found = timed(lambda: tracer.cells([scene.camera], size))
    caches = []
    for seed in (100, 101):
        tracer.settings = replace(settings, seed=seed)
        cache, filled = timed(lambda: tracer.fill(cells, scene.lighting, samples=samples))
        caches.append(cache)
    print(f"{scene.name}: {len(cells)} cells of {cells.size:.3f}, {found:.1f} + {filled:.1f} s of CPU to find and fill")
    pictures, base = [truth.beauty.astype(np.float64)], 0.0
    for mode in MODES:
        squared, stated, cpu = [], [], []
        for k in range(frames + 1):
            tracer.settings = replace(settings, indirect=mode, seed=k)

            def render(cache: int = k % 2) -> LightingBuffer:
                return tracer.trace(scene.lighting, scene.camera, cache=caches[cache])

            made, seconds = timed(render)
            if k == 0:  # compiles
                continue
            squared.append(weighted((made.beauty - truth.beauty).astype(np.float64) ** 2) - own)
            stated.append(weighted(np.asarray(made.variance, np.float64)))
            cpu.append(seconds)
        figure = float(np.mean(squared)) * min(cpu)
        base = base or figure
        print(
            f"  {mode:8} error {np.sqrt(np.mean(squared)):.4f} (stated {np.sqrt(np.mean(stated)):.4f}), "
            f"{min(cpu):.3f} s of CPU, gain {base / figure:.1f}",
            flush=True,
        )
        pictures.append(made.beauty.astype(np.float64))
    return pictures


def measure_points(scene: BenchScene, count: int, truth_spp: int) -> None:
    """Print what light on points costs as `mirelight mix` makes it at 64 samples: traced, and read from the surface."""
    mesh, lighting = scene.proxy, scene.lighting
    corners = mesh.vertices[mesh.faces].astype(np.float64)
    area = triangles.areas(corners)
    rng = np.random.default_rng(1)
    face = rng.choice(len(corners), count, p=area / area.sum())
    points = (corners[face] * rng.dirichlet((1, 1, 1), count)[:, :, None]).sum(axis=1)
    normals, some = face_normals(mesh)[face], slice(0, 2000)
    tracer = Tracer(mesh, RenderSettings(max_depth=24, seed=777, indirect="surface"), aovs=False)
    truth = tracer.point_layers(lighting, points[some], normals[some], truth_spp)
    tracer.settings = replace(tracer.settings, max_depth=8, seed=0)

    def say(what: str, made: PointLayers, cpu: float) -> None:
        sums = [x.direct.astype(np.float64)[:, some] + x.indirect[:, some] for x in (made, truth)]
        layers = np.sqrt(((sums[0] - sums[1]) ** 2).mean(axis=(1, 2))) / sums[1].mean(axis=(1, 2))
        both = sums[0].sum(axis=0), sums[1].sum(axis=0)
        whole = np.sqrt(((both[0] - both[1]) ** 2).mean()) / both[1].mean()
        print(f"  {what:8} error {whole:.4f}, of a layer {layers.mean():.4f}; {cpu:.1f} s of CPU", flush=True)

    print(f"{scene.name}: {count} points, {len(truth.names)} layers")
    tracer.point_layers(lighting, points[:64], normals[:64], 64)  # compiles
    say("traced", *timed(lambda: tracer.point_layers(lighting, points, normals, 64)))

    def read() -> PointLayers:
        cache = tracer.fill(tracer.cells_at(points, normals), lighting, samples=64)
        parts = list(by_sharpness(lighting, 32, glow=False))
        made = [tracer.point_layers(part, points, normals, spp, cache=cache) for part, spp in parts]
        rows = {name: (x.direct[k], x.indirect[k]) for x in made for k, name in enumerate(x.names)}
        direct, indirect = (np.stack([rows[name][k] for name in truth.names]) for k in range(2))
        return PointLayers(names=truth.names, direct=direct, indirect=indirect, variance=None)

    say("read", *timed(read))


def measure_bars(scene: BenchScene, size: float | None, samples: int, fills: int) -> None:
    """Print stated over true deviations of a picture of 16 samples, also relative to brightness, and of its layers.

    True is the spread of frames of different seeds, some on each of several fills: that of frames on one fill, and that
    of the fills, which is what their frames' means differ by beyond it.
    """
    tracer = Tracer(scene.proxy, RenderSettings(spp=16), aovs=False)
    cells = tracer.cells([scene.camera], size)
    caches = []
    for seed in range(fills):
        tracer.settings = RenderSettings(spp=16, seed=1000 + seed)
        caches.append(tracer.fill(cells, scene.lighting, samples=samples))
    print(f"{scene.name}: {fills} fills, {FRAMES_OF_A_FILL} frames on each")
    for mode in MODES:
        totals, stated = [], []
        for seed in range(fills * FRAMES_OF_A_FILL):
            tracer.settings = RenderSettings(spp=16, indirect=mode, seed=seed)
            made = tracer.trace(scene.lighting, scene.camera, cache=caches[seed // FRAMES_OF_A_FILL])
            totals.append(np.stack([made.beauty, *(x.total for x in made.layers)]).astype(np.float64))
            stated.append(
                np.stack([np.asarray(x, np.float64) for x in (made.variance, *(y.variance for y in made.layers))])
            )
        found = np.stack(totals).reshape(fills, FRAMES_OF_A_FILL, *totals[0].shape)
        of_samples = found.var(axis=1, ddof=1).mean(axis=0)
        of_fill = found.mean(axis=1).var(axis=0, ddof=1) - of_samples / FRAMES_OF_A_FILL
        true = of_samples + (of_fill if mode != "traced" else 0)
        bright = found[..., 0, :, :, :].mean(axis=(0, 1))
        weight = (made.coverage[..., None] > 0) / (bright**2 + 0.01 * bright[made.coverage > 0].mean() ** 2)
        said = np.mean(stated, axis=0)
        plain = np.sqrt(said.mean(axis=(1, 2, 3)) / true.mean(axis=(1, 2, 3)))
        relative = np.sqrt((said[0] * weight).mean() / (true[0] * weight).mean())
        layers = ", ".join(f"{x:.2f}" for x in plain[1:])
        print(f"  {mode:8} stated / true {plain[0]:.2f}, relative {relative:.2f}; of layers {layers}", flush=True)


def measure_target(scene: BenchScene, noise: float, seeds: int) -> None:
    """Print what a noise target of one picture takes, fills and all, and the error that is reached."""
    frames = []
    for seed in range(1, seeds + 1):
        job = Job(
            source=Path("job.toml"),
            splats=None,
            proxy=Deferred.of(scene.proxy),
            cameras=(scene.camera,),
            lightings=(replace(scene.lighting, name=scene.name),),
            render=RenderSettings(spp=32, noise=noise, indirect="surface", seed=seed),
        )

        def render(job: Job = job) -> LightingBuffer:
            return mirelight.light(mirelight.prepare(job), job.cameras[0], job.lightings[0]).new

        made, cpu = timed(render)
        frames.append(made)
        samples = 0.0 if made.samples is None else made.samples.mean()
        print(
            f"{scene.name}: for {noise:g} {made.cell_rays} rays a cell and {samples:.0f} samples a pixel, "
            f"{cpu:.1f} s of CPU; stated {made.relative_noise:.4f}",
            flush=True,
        )
    pictures = np.stack([x.beauty for x in frames]).astype(np.float64)
    mean, seen = pictures.mean(axis=0), frames[0].coverage > 0
    error = pictures.var(axis=0, ddof=1) / (mean**2 + 0.01 * mean[seen].mean() ** 2)
    print(f"  true {np.sqrt(error[seen].mean()):.4f}", flush=True)


def main() -> None:
    """Measure the scenes that were asked for."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0] if __doc__ else "")
    parser.add_argument("--scenes", nargs="+", default=["interior", "courtyard", "night"])
    parser.add_argument("--size", type=float, help="edge of a cell; default: from the mesh")
    parser.add_argument("--samples", type=int, default=256, help="of a cell")
    parser.add_argument("--frames", type=int, default=4)
    parser.add_argument("--truth", type=int, default=1024, help="samples a pixel of the truth")
    parser.add_argument("--resolution", type=int, nargs=2, default=[160, 90])
    parser.add_argument("--points", type=int, help="measure light on so many points of the surface instead of frames")
    parser.add_argument("--bars", type=int, help="measure error bars instead, with so many fills")
    parser.add_argument("--picture", type=Path, help="truth | surface | difference x 10, one row a scene")
    parser.add_argument("--noise", type=float, help="measure a noise target instead")
    chosen = parser.parse_args()
    rows = []
    for scene in scenes(chosen.resolution[0], chosen.resolution[1], 220):
        if scene.name in chosen.scenes and chosen.points:
            measure_points(scene, chosen.points, chosen.truth)
        elif scene.name in chosen.scenes and chosen.noise:
            measure_target(scene, chosen.noise, 2)
        elif scene.name in chosen.scenes and chosen.bars:
            measure_bars(scene, chosen.size, chosen.samples, chosen.bars)
        elif scene.name in chosen.scenes:
            truth, _, surface, _ = measure(scene, chosen.size, chosen.samples, chosen.frames, chosen.truth)
            level = 0.3 / truth.mean()
            parts = [truth * level, surface * level, 10 * level * np.abs(surface - truth)]
            rows.append(np.concatenate([srgb_encode(np.clip(x, 0, 1)) for x in parts], axis=1))
    if chosen.picture:
        Image.fromarray(np.round(255 * np.concatenate(rows)).astype(np.uint8)).save(chosen.picture)


if __name__ == "__main__":
    main()
