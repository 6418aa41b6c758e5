"""What light on the surface gains beside the traced one, Mitsuba's `path` and Blender Cycles, all in one run.

frame: error² x CPU seconds of a picture of 16 samples with every layer, fill and bias counted: errors are against a
traced picture of many samples, whose own variance is taken off, half of the frames read one fill, half another. One
picture of 1280 x 720 has so many times the pixels of the bench's; the bench's gets that share of what finding and
filling cells costs. The errors of `path` and Cycles, which have no bias here, come from the spread of their seeds.
points: light on many points, traced and read. bars: error bars. noise: a noise target.

    python scripts/bench surface [--scenes interior courtyard night] [--cycles PYTHON_WITH_BPY]
                                 [--points 250000 | --bars 5 | --noise 0.03]
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

import mirelight
from bench.common import Array, Table, Timed, error2, interleaved, median, relative, table, timed
from bench.lighting import Cycles, mitsuba_path
from bench.scenes import BenchScene, scenes
from mirelight.lighting import Tracer
from mirelight.lighting.albedo import face_normals
from mirelight.model import (
    Deferred,
    Indirect,
    Job,
    LightingBuffer,
    PointLayers,
    RenderSettings,
    SurfaceCache,
    triangles,
)
from mirelight.pipeline.splat_light import by_sharpness

Row = tuple[object, ...]
MODES: tuple[Indirect, ...] = ("traced", "surface")
SPP = 16
LARGE = 1280 * 720  # pixels of the picture that a fill's share is told for
FRAMES_OF_A_FILL = 4  # where error bars are measured


def frame(scene: BenchScene, seeds: int, truth_spp: int, cycles: str | None) -> list[Row]:
    """One picture of 16 samples by every renderer."""
    tracer = Tracer(scene.proxy, RenderSettings(), aovs=False)

    def filled(seed: int) -> SurfaceCache:
        tracer.settings = RenderSettings(seed=seed)
        cells = tracer.cells()
        return tracer.fill(cells, scene.lighting, transport=tracer.transport(cells))

    caches, spent = zip(*(timed(lambda seed=seed: filled(seed)) for seed in (100, 101)), strict=True)  # type: ignore[misc]
    tracer.settings = RenderSettings(spp=truth_spp, max_depth=24, seed=777)
    truth = tracer.trace(scene.lighting, scene.camera)
    bright = truth.beauty.astype(np.float64)
    weight = relative(bright)
    own = float((np.asarray(truth.variance) * weight).sum())

    def ours(mode: Indirect) -> Timed:
        def render(spp: int, seed: int) -> Array:
            tracer.settings = RenderSettings(spp=spp, seed=seed, indirect=mode)
            return tracer.trace(scene.lighting, scene.camera, cache=caches[seed % 2]).beauty.astype(np.float64)

        return lambda spp, seed: timed(lambda: render(spp, seed))

    renderers: dict[str, Timed] = {mode: ours(mode) for mode in MODES} | {"path": mitsuba_path(scene)}
    trees = [Cycles(cycles, scene, tree=tree) for tree in (True, False)] if cycles else []
    renderers |= dict(zip(("cycles, tree", "cycles, no tree"), trees, strict=False))
    pictures, seconds = interleaved(renderers, SPP, seeds)
    for process in trees:
        process.close()
    rows: list[Row] = []
    for name in renderers:
        squared = [float((np.square(x - bright) * weight).sum()) - own for x in pictures[name]]
        error = float(np.mean(squared)) if name in MODES else error2(pictures[name])
        cpu, fill = median(seconds[name]), spent[1] if name == "surface" else 0.0
        share = scene.camera.width * scene.camera.height / LARGE * fill
        rows.append((scene.name, name, error**0.5, cpu, fill, error * (cpu + share)))
    return rows


def points(scene: BenchScene, count: int, truth_spp: int) -> list[Row]:
    """What light on points costs as `mirelight mix` makes it at 64 samples: traced, and read from the surface."""
    mesh, lighting = scene.proxy, scene.lighting
    corners = mesh.vertices[mesh.faces].astype(np.float64)
    area = triangles.areas(corners)
    rng = np.random.default_rng(1)
    face = rng.choice(len(corners), count, p=area / area.sum())
    places = (corners[face] * rng.dirichlet((1, 1, 1), count)[:, :, None]).sum(axis=1)
    normals, some = face_normals(mesh)[face], slice(0, 2000)
    tracer = Tracer(mesh, RenderSettings(max_depth=24, seed=777, indirect="surface"), aovs=False)
    truth = tracer.point_layers(lighting, places[some], normals[some], truth_spp)
    tracer.settings = replace(tracer.settings, max_depth=8, seed=0)

    def row(what: str, made: PointLayers, cpu: float) -> Row:
        sums = [x.direct.astype(np.float64)[:, some] + x.indirect[:, some] for x in (made, truth)]
        layers = np.sqrt(((sums[0] - sums[1]) ** 2).mean(axis=(1, 2))) / sums[1].mean(axis=(1, 2))
        both = sums[0].sum(axis=0), sums[1].sum(axis=0)
        whole = np.sqrt(((both[0] - both[1]) ** 2).mean()) / both[1].mean()
        return scene.name, len(truth.names), what, float(whole), float(layers.mean()), cpu

    tracer.point_layers(lighting, places[:64], normals[:64], 64)  # compiles
    traced = row("traced", *timed(lambda: tracer.point_layers(lighting, places, normals, 64)))

    def read() -> PointLayers:
        cache = tracer.fill(tracer.cells(), lighting, samples=64)
        parts = list(by_sharpness(lighting, 32, glow=False))
        made = [tracer.point_layers(part, places, normals, spp, cache=cache) for part, spp in parts]
        rows = {name: (x.direct[k], x.indirect[k]) for x in made for k, name in enumerate(x.names)}
        direct, indirect = (np.stack([rows[name][k] for name in truth.names]) for k in range(2))
        return PointLayers(names=truth.names, direct=direct, indirect=indirect, variance=None)

    return [traced, row("read", *timed(read))]


def bars(scene: BenchScene, fills: int) -> list[Row]:
    """Stated over true deviations of a picture of 16 samples, also relative to brightness, and of its layers.

    True is the spread of frames of different seeds, some on each of several fills: that of frames on one fill, and that
    of the fills, which is what their frames' means differ by beyond it.
    """
    tracer = Tracer(scene.proxy, RenderSettings(spp=16), aovs=False)
    cells = tracer.cells()
    caches = []
    for seed in range(fills):
        tracer.settings = RenderSettings(spp=16, seed=1000 + seed)
        caches.append(tracer.fill(cells, scene.lighting))
    rows: list[Row] = []
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
        weight = relative(bright)
        said = np.mean(stated, axis=0)
        plain = np.sqrt(said.mean(axis=(1, 2, 3)) / true.mean(axis=(1, 2, 3)))
        share = np.sqrt((said[0] * weight).sum() / (true[0] * weight).sum())
        layers = " to ".join(f"{x:.2f}" for x in (plain[1:].min(), plain[1:].max()))
        rows.append((scene.name, mode, float(plain[0]), float(share), layers))
    return rows


def target(scene: BenchScene, noise: float, seeds: int) -> Row:
    """What a noise target of one picture takes, fills and all, and the error that is reached."""
    frames, costs = [], []
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
        costs.append(cpu)
    pictures = [x.beauty.astype(np.float64) for x in frames]
    samples = [0.0 if x.samples is None else float(x.samples.mean()) for x in frames]
    said = np.mean([x.relative_noise for x in frames])
    rays = f"{frames[-1].cell_rays}"
    return scene.name, noise, rays, float(np.mean(samples)), median(costs), float(said), error2(pictures) ** 0.5


def options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--scenes", nargs="+", default=["interior", "courtyard", "night"])
    parser.add_argument("--resolution", type=int, nargs=2, default=[320, 180])
    parser.add_argument("--cycles", metavar="PYTHON", help="a Python interpreter with the bpy package")
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--points", type=int, help="measure light on so many points of the surface instead of frames")
    what.add_argument("--bars", type=int, help="measure error bars instead, with so many fills")
    what.add_argument("--noise", type=float, help="measure a noise target instead")


def run(chosen: argparse.Namespace) -> list[Table]:
    """One table of what was asked for."""
    width, height, cells = (96, 54, 40) if chosen.quick else (*chosen.resolution, 220)
    seeds, truth = (2, 64) if chosen.quick else (4, 512)
    wanted = [scene for scene in scenes(width, height, cells) if scene.name in chosen.scenes]
    if chosen.points:
        layers = ("scene", "layers", "", "error of the sum", "of a layer", "CPU s")
        return [table("Light on points", layers, [row for x in wanted for row in points(x, chosen.points, truth)])]
    if chosen.bars:
        bar = ("scene", "", "stated / true deviation", "relative to brightness", "of layers")
        return [table("Error bars, measured", bar, [row for x in wanted for row in bars(x, chosen.bars)])]
    if chosen.noise:
        aim = ("scene", "target", "rays a cell", "samples a pixel", "CPU s", "stated", "true")
        return [table("Noise targets of light on the surface", aim, [target(x, chosen.noise, 2) for x in wanted])]
    columns = ("scene", "renderer", "error", "CPU s", "fill, CPU s", "error² x CPU, share of the fill counted")
    rows = [row for x in wanted for row in frame(x, seeds, truth, chosen.cycles)]
    return [table("Light on the surface, measured", columns, rows)]
