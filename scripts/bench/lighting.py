"""How much CPU time each renderer needs for a given error, on procedural scenes, and what else a frame costs.

errors: ours (for the sum alone, and with every layer), Mitsuba's `path` and, through --cycles, Blender Cycles with its
light tree on and off render the same mesh, lights and bounces, interleaved. All are unbiased, so the error comes from
the spread of independent seeds: error² = mean(variance / (r² + 0.01 mean²)) over covered pixels, and the figure is
error² x CPU seconds of a warm frame. Smaller is better; `path` is 1.
denoised: ours and Cycles, both through Open Image Denoise, against a frame of many samples.
threads: wall time of one thread against two. overheads: what a new camera and a new environment cost.

    python scripts/bench lighting [--spp 16 64 256] [--cycles PYTHON_WITH_BPY] [--parts errors ...]
"""

from __future__ import annotations

import argparse
import subprocess
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import path_oracle

from bench.common import Array, Table, Timed, error2, interleaved, median, relative, table, timed
from bench.scenes import BOUNCES, BenchScene, crowds, panorama, scenes
from mirelight.base import backend
from mirelight.lighting import Tracer, finished
from mirelight.model import Camera, DirectionalLight, Lighting, PointLight, RenderSettings, SpotLight, SunLight


def ours(scene: BenchScene, *, layers: bool = False, denoise: bool = False) -> Timed:
    """mirelight's tracer, warm."""
    tracer = Tracer(scene.proxy, RenderSettings(max_depth=BOUNCES, denoise=denoise), layers=layers, aovs=layers)

    def render(spp: int, seed: int) -> Array:
        tracer.settings = replace(tracer.settings, spp=spp, seed=seed)
        buffer = tracer.trace(scene.lighting, scene.camera)
        return finished(buffer, tracer.settings, layers=layers).beauty.astype(np.float64)

    return lambda spp, seed: timed(lambda: render(spp, seed))


def mitsuba_path(scene: BenchScene) -> Timed:
    """Mitsuba's path integrator on the same scene."""
    mi = backend.mitsuba("llvm_ad_rgb")
    world = path_oracle.scene(mi, scene.proxy, scene.lighting, scene.camera)

    def render(spp: int, seed: int) -> Array:
        picture, _ = path_oracle.path_beauty(mi, world, spp=spp, max_depth=BOUNCES, seed=seed)
        return picture.astype(np.float64)

    return lambda spp, seed: timed(lambda: render(spp, seed))


class Cycles:
    """Blender Cycles in a process of its own, asked over pipes; see in_blender.py."""

    def __init__(self, python: str, scene: BenchScene, *, tree: bool = True, denoise: bool = False) -> None:
        self._folder = tempfile.TemporaryDirectory()
        write_scene(Path(self._folder.name) / "scene.npz", scene)
        helper = Path(__file__).with_name("in_blender.py")
        self._process = subprocess.Popen(
            [python, str(helper), self._folder.name, str(int(tree)), str(int(denoise))],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def __call__(self, spp: int, seed: int) -> tuple[Array, float]:
        """A picture (H, W, 3) and the CPU seconds it took."""
        assert self._process.stdin is not None and self._process.stdout is not None
        self._process.stdin.write(f"{spp} {seed}\n")
        self._process.stdin.flush()
        for line in self._process.stdout:
            if line.startswith("DONE"):
                picture = np.load(Path(self._folder.name) / "picture.npy")
                return picture.astype(np.float64), float(line.split()[1])
        raise RuntimeError("Cycles ended; is bpy installed in that Python?")

    def close(self) -> None:
        """End the process."""
        self._process.kill()
        self._folder.cleanup()


def write_scene(path: Path, scene: BenchScene) -> None:
    """The scene as arrays that the helper reads without mirelight."""
    lights = [[0.0] * 13]
    for light in scene.lighting.lights:
        strength = (light.color * light.intensity).tolist()
        if isinstance(light, SunLight):
            lights.append([1, 0, 0, 0, *light.direction, *strength, np.radians(light.angular_diameter), 0, 0])
        elif isinstance(light, SpotLight):
            # Blender's cone ends at once; a squared ramp this narrow lights as much as its first third
            half = light.inner_cone_angle + (light.outer_cone_angle - light.inner_cone_angle) / 3
            lights.append([2, *light.position, *light.direction, *strength, 0, half, 0])
        elif isinstance(light, PointLight):
            lights.append([3, *light.position, 0, -1, 0, *strength, 0, 0, 0])
        elif isinstance(light, DirectionalLight):
            lights.append([1, 0, 0, 0, *light.direction, *strength, 0, 0, 0])
    environment = scene.lighting.environment
    np.savez(
        path,
        vertices=scene.proxy.vertices,
        faces=scene.proxy.faces,
        lights=np.array(lights[1:]),
        sky=np.zeros((0, 0, 3), np.float32) if environment is None else environment.pixels,
        pose=scene.camera.world_from_camera,
        camera=np.array([scene.camera.width, scene.camera.height, scene.camera.fx]),
        bounces=BOUNCES,
    )


# --- measurement -----------------------------------------------------------------------------------------------------


def errors(scene: BenchScene, spp: int, seeds: int, cycles: str | None) -> list[tuple[object, ...]]:
    """Rows of the table of errors."""
    renderers = {"path": mitsuba_path(scene), "mirelight": ours(scene), "all layers": ours(scene, layers=True)}
    trees = [Cycles(cycles, scene, tree=tree) for tree in (True, False)] if cycles else []
    renderers |= dict(zip(("cycles, tree", "cycles, no tree"), trees, strict=False))
    pictures, seconds = interleaved(renderers, spp, seeds)
    for process in trees:
        process.close()
    found = {name: (median(seconds[name]), error2(pictures[name])) for name in renderers}
    cost = {name: cpu * error for name, (cpu, error) in found.items()}
    rival = min((cost[name] for name in cost if name.startswith("cycles")), default=float("nan"))
    return [
        (scene.name, spp, name, cpu, error**0.5, cost[name] / cost["path"], cost[name] / rival, np.mean(pictures[name]))
        for name, (cpu, error) in found.items()
    ]


def denoised(scene: BenchScene, spp: int, seeds: int, cycles: str | None) -> list[tuple[object, ...]]:
    """Error of denoised frames, ours also of fewer samples, against many of ours (Cycles' mean agrees to 0.2 %)."""
    truth, _ = ours(scene)(64 * spp, 77)
    weight = relative(truth)
    out: list[tuple[object, ...]] = []
    process = Cycles(cycles, scene, denoise=True) if cycles else None
    for count in (spp, spp // 2, spp // 4):
        renderers: dict[str, Timed] = {"mirelight": ours(scene, denoise=True)}
        if process and count == spp:
            renderers["cycles"] = process
        pictures, seconds = interleaved(renderers, count, seeds)
        for name in renderers:
            squared = [float(((picture - truth) ** 2 * weight).sum()) for picture in pictures[name]]
            out.append((scene.name, count, name, median(seconds[name]), float(np.sqrt(np.mean(squared)))))
    if process:
        process.close()
    return out


def threads(scene: BenchScene, repeats: int) -> tuple[object, ...]:
    """Wall time with one thread over that with two, by turns. Says something on an idle machine only."""
    import drjit as dr

    render, before = ours(scene), dr.thread_count()
    spent: dict[int, list[float]] = {1: [], 2: []}
    render(16, 0)
    for repeat in range(repeats):
        for count, times in spent.items():
            dr.set_thread_count(count)
            start = time.perf_counter()
            render(16, repeat)
            times.append(time.perf_counter() - start)
    dr.set_thread_count(before)
    one, two = median(spent[1]), median(spent[2])
    return scene.name, one, two, one / two


def overheads(scene: BenchScene, width: int, height: int, repeats: int) -> list[tuple[object, ...]]:
    """Milliseconds of CPU that a new camera and a new environment of 2048 x 1024 add to a frame of one sample."""
    tracer = Tracer(scene.proxy, RenderSettings(spp=1, max_depth=1), layers=False, aovs=False)
    skies = panorama(1), panorama(2)
    views = [Camera.look_at([4.5, 3.2 + 0.1 * k, 7.5], [-0.6, 0.9, 0], width, height, yfov=50) for k in (0, 1)]
    spent: dict[str, list[float]] = {"nothing new": [], "camera": [], "environment": []}
    lighting, camera = Lighting(environment=skies[0]), views[0]
    for repeat in range(2 + repeats):
        for what, times in spent.items():
            if what == "camera":
                camera = views[(repeat + 1) % 2]
            if what == "environment":
                lighting = Lighting(environment=skies[(repeat + 1) % 2])
            start = time.process_time()
            tracer.trace(lighting, camera)
            if repeat >= 2:  # the first two compile and fill caches
                times.append(time.process_time() - start)
    base = median(spent["nothing new"])
    rows = [("a frame", 1000 * base)]
    return [*rows, *((f"a new {what}", 1000 * (median(spent[what]) - base)) for what in ("camera", "environment"))]


PARTS = ("errors", "denoised", "threads", "overheads")


def options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--cycles", metavar="PYTHON", help="a Python interpreter with the bpy package")
    parser.add_argument("--spp", type=int, nargs="+", default=[16, 64])
    parser.add_argument("--scenes", nargs="+", help="only those whose name starts so")
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=["errors", "threads", "overheads"])


def run(chosen: argparse.Namespace) -> list[Table]:
    """The tables of the parts that were asked for."""
    width, height, cells, seeds = (96, 54, 40, 3) if chosen.quick else (320, 180, 220, 6)
    three = scenes(width, height, cells)
    every = [s for s in three + crowds(three[0]) if s.name.startswith(tuple(chosen.scenes or [""]))]
    rows: dict[str, list[tuple[object, ...]]] = {part: [] for part in chosen.parts}
    for scene in every:
        many = len(scene.lighting.lights) > 50
        for spp in chosen.spp if "errors" in rows else []:
            # cost at a given error does not depend on the size; Cycles is left out of crowds: its lamps have no range
            few, rival = max(2, min(seeds, 256 // spp)), None if many else chosen.cycles
            view = scene.camera.resized(width // 2, height // 2) if spp > 64 else scene.camera
            rows["errors"] += errors(replace(scene, camera=view), spp, few, rival)
        if "denoised" in rows and not many:
            rows["denoised"] += denoised(scene, min(chosen.spp), seeds, chosen.cycles)
        if "threads" in rows and not many:
            rows["threads"].append(threads(scene, seeds))
    if "overheads" in rows:
        rows["overheads"] = overheads(three[0], *((320, 180) if chosen.quick else (1280, 720)), seeds)
    columns = {
        "errors": ("scene", "samples", "renderer", "CPU s", "error", "cost, path = 1", "cost, Cycles = 1", "mean"),
        "denoised": ("scene", "samples", "renderer", "CPU s", "error"),
        "threads": ("scene", "one thread, s", "two, s", "times"),
        "overheads": ("what", "ms of CPU"),
    }
    titles = {
        "errors": "Error and time, measured",
        "denoised": "Denoised",
        "threads": "Threads",
        "overheads": "Overheads",
    }
    return [table(titles[part], columns[part], rows[part]) for part in chosen.parts]
