"""What light on the surface costs beside today's tracer, Mitsuba's `path` and Blender Cycles, all in one run.

frame: error² x CPU seconds of a picture of 16 samples with every layer, fill and bias counted: errors are against a
traced picture of many samples, whose own variance is taken off, half of the frames read one fill, half another. One
picture of 1280 x 720 has so many times the pixels of the bench's; the bench's gets that share of what finding and
filling cells costs. The errors of `path` and Cycles, which have no bias here, come from the spread of their seeds.
cameras: 24 of a scene, each really rendered with read light; one in three is traced, too, twice. Error² of what is read
is the mean product of its differences to both, so that neither's noise is in it. CPU is told as traced frames of that
error: theirs falls with more samples, as CPU grows.
lamps: a frame with all layers against today's, and filling the cells with one more lamp against filling them with all.

    python scripts/bench_surface_goals.py [--quick] [--json FILE] [--cycles PYTHON_WITH_BPY] [--scenes interior ...]
                                          [--resolution 320 180] [--parts frame cameras lamps]
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TypeVar

import numpy as np
from bench_lighting import Cycles, error2, interleaved, median, mitsuba_path
from bench_lighting_scenes import Array, BenchScene, scenes

from mirelight.lighting import Tracer
from mirelight.model import Camera, Indirect, Lighting, RenderSettings, SurfaceCache

T = TypeVar("T")
LARGE = 1280 * 720  # pixels of the picture that a fill's share is told for
SPP = 16
CAMERAS = 24
TRACED_EVERY = 3  # of them
LAYERS_SPP = 64  # where layers' cost is measured


@dataclass(frozen=True, slots=True)
class Cost:
    """Of one way of rendering one scene."""

    scene: str
    way: str
    error2: float  # mean of (error / brightness)²
    cpu: float  # seconds of a warm frame of the bench's size
    fill: float  # CPU seconds to find cells and the rays between them, and to light them

    def figure(self, share: float) -> float:
        """error² x CPU, where `share` of the fill is this picture's."""
        return self.error2 * (self.cpu + share * self.fill)


@dataclass(frozen=True, slots=True)
class Cameras:
    """24 cameras of a scene."""

    scene: str
    traced_error2: float
    read_error2: float
    traced_cpu: float  # seconds a frame
    read_cpu: float
    fill: float  # for all of them

    def frames(self, share: float) -> float:
        """How many frames of today all of them cost at equal error, `share` of the fill being a picture's."""
        one = self.traced_error2 * self.traced_cpu
        return self.read_error2 * (CAMERAS * self.read_cpu + share * self.fill) / one


@dataclass(frozen=True, slots=True)
class Lamps:
    """What layers and lamps cost."""

    layers: int
    traced_cpu: float  # seconds of a frame with every layer
    read_cpu: float
    fill: float  # of all, with finding cells and rays
    fill_of_one: float


def timed(make: Callable[[], T]) -> tuple[T, float]:
    """What it makes, and the CPU seconds that it takes."""
    start = time.process_time()
    made = make()
    return made, time.process_time() - start


def tracer_of(scene: BenchScene) -> Tracer:
    return Tracer(scene.proxy, RenderSettings(), aovs=False)


def filled(tracer: Tracer, scene: BenchScene, cameras: list[Camera], seed: int) -> tuple[SurfaceCache, float]:
    """Light on the surface as a job makes it, and the CPU seconds to find its cells and the rays between them and to
    light them."""
    tracer.settings = RenderSettings(seed=seed)

    def make() -> SurfaceCache:
        cells = tracer.cells(cameras)
        return tracer.fill(cells, scene.lighting, transport=tracer.transport(cells))

    return timed(make)


def weights(bright: Array) -> Array:
    """(H, W, 3) of squared errors, so that their sum is the mean relative one over lit pixels."""
    lit = bright.max(axis=-1, keepdims=True) > 0
    level = bright[lit[..., 0]].mean()
    return np.asarray(lit / (bright**2 + 0.01 * level**2) / (3 * lit.sum()))


def frame(scene: BenchScene, seeds: int, truth_spp: int, cycles: str | None) -> list[Cost]:
    """One picture by every renderer."""
    tracer = tracer_of(scene)
    caches, spent = zip(*(filled(tracer, scene, [scene.camera], 100 + k) for k in range(2)), strict=True)
    tracer.settings = RenderSettings(spp=truth_spp, max_depth=24, seed=777)
    truth = tracer.trace(scene.lighting, scene.camera)
    bright = truth.beauty.astype(np.float64)
    weight = weights(bright)
    own = float((np.asarray(truth.variance) * weight).sum())

    def ours(mode: Indirect) -> Callable[[int, int], tuple[Array, float]]:
        def render(spp: int, seed: int) -> tuple[Array, float]:
            tracer.settings = RenderSettings(spp=spp, seed=seed, indirect=mode)
            made, cpu = timed(lambda: tracer.trace(scene.lighting, scene.camera, cache=caches[seed % 2]))
            return made.beauty.astype(np.float64), cpu

        return render

    renderers = {"traced": ours("traced"), "surface": ours("surface"), "path": mitsuba_path(scene)}
    trees = [Cycles(cycles, scene, tree=tree) for tree in (True, False)] if cycles else []
    renderers |= dict(zip(("cycles, tree", "cycles, no tree"), trees, strict=False))
    pictures, seconds = interleaved(renderers, SPP, seeds)
    for process in trees:
        process.close()
    out = []
    for way in renderers:
        biased = way in ("traced", "surface")
        squared = [float((np.square(x - bright) * weight).sum()) - own for x in pictures[way]]
        error = float(np.mean(squared)) if biased else error2(pictures[way])
        out.append(Cost(scene.name, way, error, median(seconds[way]), spent[1] if way == "surface" else 0.0))
    return out


def around(scene: BenchScene, width: int, height: int) -> list[Camera]:
    """24 cameras of a scene: round the room, or along the yard's open side."""
    turns = np.arange(CAMERAS) / CAMERAS
    if scene.name == "interior":
        angle, distance, height_of, towards = 2 * np.pi * turns, 3.0, 1.7, [0.2, 0.8, -0.2]
    else:
        angle, distance, height_of, towards = np.radians(70 * turns - 35), 8.5, 3.2, [-0.6, 0.9, 0.0]
    places = np.stack([distance * np.sin(angle), np.full(CAMERAS, height_of), distance * np.cos(angle)], axis=1)
    return [Camera.look_at(p, towards, width, height, yfov=55, name=f"{k}") for k, p in enumerate(places)]


def cameras(scene: BenchScene, width: int, height: int) -> Cameras:
    """Every camera of a scene read, some traced."""
    tracer, views = tracer_of(scene), around(scene, width, height)
    cache, fill = filled(tracer, scene, views, 0)

    def render(view: Camera, mode: Indirect, spp: int, seed: int) -> tuple[Array, float]:
        tracer.settings = RenderSettings(spp=spp, seed=seed, indirect=mode)
        made, cpu = timed(lambda: tracer.trace(scene.lighting, view, cache=cache))
        return made.beauty.astype(np.float64), cpu

    render(views[0], "traced", SPP, 0)  # compiles
    render(views[0], "surface", SPP, 0)
    traced_error, read_error, traced_cpu, read_cpu = [], [], [], []
    for k, view in enumerate(views):
        read, cpu = render(view, "surface", SPP, k + 1000)
        read_cpu.append(cpu)
        if k % TRACED_EVERY:
            continue
        (one, first), (other, second) = (render(view, "traced", SPP, 2 * k + j) for j in (1, 2))
        weight = weights(read)  # the cleanest; weights that know the noise of the others would bias the products
        traced_error.append(0.5 * float((np.square(one - other) * weight).sum()))
        read_error.append(float(((read - one) * (read - other) * weight).sum()))
        traced_cpu += [first, second]
    errors = float(np.mean(traced_error)), float(np.mean(read_error))
    return Cameras(scene.name, *errors, median(traced_cpu), median(read_cpu), fill)


def lamps(scene: BenchScene) -> Lamps:
    """A frame with every layer, and one more lamp."""
    tracer, one = tracer_of(scene), Lighting(lights=scene.lighting.lights[:1])
    tracer.settings = RenderSettings(spp=LAYERS_SPP)
    cells, cells_cpu = timed(lambda: tracer.cells([scene.camera]))
    between, rays = timed(lambda: tracer.transport(cells))
    for lighting in (scene.lighting, one):
        tracer.fill(cells, lighting, transport=between)  # compiles
    cache, lit = timed(lambda: tracer.fill(cells, scene.lighting, transport=between))
    _, fill_of_one = timed(lambda: tracer.fill(cells, one, transport=between))
    fill = cells_cpu + rays + lit
    spent: dict[Indirect, list[float]] = {"traced": [], "surface": []}
    for seed in range(4):
        for mode, found in spent.items():
            tracer.settings = replace(tracer.settings, indirect=mode, seed=seed)
            _, cpu = timed(lambda: tracer.trace(scene.lighting, scene.camera, cache=cache))
            if seed:
                found.append(cpu)
    return Lamps(len(cache.lights), median(spent["traced"]), median(spent["surface"]), fill, fill_of_one)


def main() -> None:
    """Measure and print what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="small pictures, few seeds: does it run?")
    parser.add_argument("--json", type=Path, help="write the figures there")
    parser.add_argument("--cycles", metavar="PYTHON", help="a Python interpreter with the bpy package")
    parser.add_argument("--scenes", nargs="+", default=["interior", "courtyard", "night"])
    parser.add_argument("--resolution", type=int, nargs=2, default=[320, 180])
    parts = ["frame", "cameras", "lamps"]
    parser.add_argument("--parts", nargs="+", choices=parts, default=parts)
    chosen = parser.parse_args()
    width, height = (96, 54) if chosen.quick else chosen.resolution
    seeds, truth_spp = (2, 64) if chosen.quick else (4, 512)
    share = width * height / LARGE
    costs: list[Cost] = []
    views: list[Cameras] = []
    lit: list[Lamps] = []
    for scene in scenes(width, height, 220):
        if scene.name not in chosen.scenes:
            continue
        if "frame" in chosen.parts:
            found = frame(scene, seeds, truth_spp, chosen.cycles)
            costs += found
            cycles = min((x.figure(0) for x in found if x.way.startswith("cycles")), default=float("nan"))
            today, path = (next(x.figure(0) for x in found if x.way == way) for way in ("traced", "path"))
            for x in found:
                print(
                    f"{scene.name:10} {x.way:16} error {np.sqrt(x.error2):.4f}, {x.cpu:.2f} + {share * x.fill:.2f} s "
                    f"of CPU; figure over Cycles' {x.figure(share) / cycles:.4f}, path's {x.figure(share) / path:.4f}, "
                    f"today's {x.figure(share) / today:.4f} (alone {x.figure(1) / today:.3f})",
                    flush=True,
                )
        if "cameras" in chosen.parts:
            y = cameras(scene, width, height)
            views.append(y)
            print(
                f"{scene.name:10} {CAMERAS} cameras: error {np.sqrt(y.read_error2):.4f}, "
                f"traced {np.sqrt(y.traced_error2):.4f}; {y.read_cpu:.3f} s and {y.traced_cpu:.3f} s a frame, "
                f"fill {y.fill:.1f} s: {y.frames(share):.2f} frames of today ({y.frames(1):.1f} at this size)",
                flush=True,
            )
        if "lamps" in chosen.parts and len(scene.lighting.lights) > 4:
            z = lamps(scene)
            lit.append(z)
            print(
                f"{scene.name:10} {z.layers} layers at {LAYERS_SPP} samples: {z.read_cpu:.3f} s a frame, traced "
                f"{z.traced_cpu:.3f}: "
                f"{z.read_cpu / z.traced_cpu:.2f}, with the fill's share "
                f"{(z.read_cpu + share * z.fill) / z.traced_cpu:.2f}; fill of one lamp {z.fill_of_one:.2f} s, of all "
                f"{z.fill:.2f} s: 1 / {z.fill / z.fill_of_one:.1f}",
                flush=True,
            )
    if chosen.json:
        tables = {
            "frame": [asdict(x) for x in costs],
            "cameras": [asdict(x) for x in views],
            "lamps": [asdict(x) for x in lit],
        }
        chosen.json.write_text(json.dumps(tables, indent=1))


if __name__ == "__main__":
    main()
