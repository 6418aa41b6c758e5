"""How much CPU time each renderer needs for a given error, on procedural scenes, and what else a frame costs.

errors: ours (for the sum alone, and with every layer), Mitsuba's `path` and, through --cycles, Blender Cycles with its
light tree on and off render the same mesh, lights and bounces, interleaved. All are unbiased, so the error comes from
the spread of independent seeds: error² = mean(variance / (r² + 0.01 mean²)) over covered pixels, and the figure is
error² x CPU seconds of a warm frame. Smaller is better; `path` is 1.
denoised: ours and Cycles, both through Open Image Denoise, against a frame of many samples.
threads: wall time of one thread against two. overheads: what a new camera and a new environment cost.

    python scripts/bench_lighting.py [--quick] [--json FILE] [--cycles PYTHON_WITH_BPY] [--parts errors ...]
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import path_oracle
from bench_lighting_scenes import BOUNCES, Array, BenchScene, crowds, panorama, scenes

from mirelight.base import backend
from mirelight.lighting import Tracer, finished
from mirelight.model import Camera, DirectionalLight, Lighting, PointLight, RenderSettings, SpotLight, SunLight

Timed: TypeAlias = Callable[[int, int], tuple[Array, float]]  # (spp, seed) -> (H, W, 3) and CPU seconds


# --- renderers -------------------------------------------------------------------------------------------------------


def timed(render: Callable[[int, int], Array]) -> Timed:
    """A renderer that also says how much CPU time it took."""

    def run(spp: int, seed: int) -> tuple[Array, float]:
        start = time.process_time()
        picture = render(spp, seed)
        return picture, time.process_time() - start

    return run


def ours(scene: BenchScene, *, layers: bool = False, denoise: bool = False) -> Timed:
    """mirelight's tracer, warm."""
    tracer = Tracer(scene.proxy, RenderSettings(max_depth=BOUNCES, denoise=denoise), layers=layers, aovs=layers)

    def render(spp: int, seed: int) -> Array:
        tracer.settings = replace(tracer.settings, spp=spp, seed=seed)
        buffer = tracer.trace(scene.lighting, scene.camera)
        return finished(buffer, tracer.settings, layers=layers).beauty.astype(np.float64)

    return timed(render)


def mitsuba_path(scene: BenchScene) -> Timed:
    """Mitsuba's path integrator on the same scene."""
    mi = backend.mitsuba("llvm_ad_rgb")
    world = path_oracle.scene(mi, scene.proxy, scene.lighting, scene.camera)

    def render(spp: int, seed: int) -> Array:
        picture, _ = path_oracle.path_beauty(mi, world, spp=spp, max_depth=BOUNCES, seed=seed)
        return picture.astype(np.float64)

    return timed(render)


class Cycles:
    """Blender Cycles in a process of its own, asked over pipes; see bench_lighting_cycles.py."""

    def __init__(self, python: str, scene: BenchScene, *, tree: bool = True, denoise: bool = False) -> None:
        self._folder = tempfile.TemporaryDirectory()
        write_scene(Path(self._folder.name) / "scene.npz", scene)
        helper = Path(__file__).with_name("bench_lighting_cycles.py")
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


def error2(pictures: list[Array]) -> float:
    """mean(variance / (r² + 0.01 mean²)) over covered pixels."""
    stack = np.stack(pictures)
    mean, variance = stack.mean(axis=0), stack.var(axis=0, ddof=1)
    seen = mean.max(axis=-1) > 0
    return float(np.mean(variance[seen] / (mean[seen] ** 2 + 0.01 * mean[seen].mean() ** 2)))


def median(values: Iterable[float]) -> float:
    return float(statistics.median(values))


def interleaved(
    renderers: dict[str, Timed], spp: int, seeds: int
) -> tuple[dict[str, list[Array]], dict[str, list[float]]]:
    """Pictures and CPU seconds of each, by turns, after one that compiles and builds."""
    pictures: dict[str, list[Array]] = {name: [] for name in renderers}
    seconds: dict[str, list[float]] = {name: [] for name in renderers}
    for render in renderers.values():
        render(spp, 9999)
    for seed in range(seeds):
        for name, render in renderers.items():
            picture, spent = render(spp, 1 + seed)
            pictures[name].append(picture)
            seconds[name].append(spent)
    return pictures, seconds


def errors(scene: BenchScene, spp: int, seeds: int, cycles: str | None) -> dict[str, Any]:
    """Rows of the table of errors."""
    renderers = {"path": mitsuba_path(scene), "mirelight": ours(scene), "all layers": ours(scene, layers=True)}
    trees = [Cycles(cycles, scene, tree=tree) for tree in (True, False)] if cycles else []
    renderers |= dict(zip(("cycles, tree", "cycles, no tree"), trees, strict=False))
    pictures, seconds = interleaved(renderers, spp, seeds)
    for process in trees:
        process.close()
    out: dict[str, Any] = {"scene": scene.name, "triangles": len(scene.proxy.faces), "spp": spp}
    for name in renderers:
        cpu, error = median(seconds[name]), error2(pictures[name])
        out[name] = {"cpu": cpu, "error2": error, "cost": cpu * error, "mean": float(np.mean(pictures[name]))}
    rivals = [name for name in renderers if name.startswith("cycles")]
    better = min(rivals, key=lambda name: float(out[name]["cost"])) if rivals else None
    print(
        f"{'scene':20} {'spp':>4} {'renderer':16} {'CPU s':>8} {'error':>8} {'vs path':>8} {'vs cycles':>9} {'mean':>8}"
    )
    for name in renderers:
        row = out[name]
        row["against path"] = row["cost"] / out["path"]["cost"]
        row["against cycles"] = row["cost"] / out[better]["cost"] if better else float("nan")
        figures = f"{row['cpu']:8.3f} {np.sqrt(row['error2']):8.4f} {row['against path']:8.4f}"
        print(
            f"{scene.name:20} {spp:4} {name:16} {figures} {row['against cycles']:9.4f} {row['mean']:8.4f}", flush=True
        )
    return out


def denoised(scene: BenchScene, spp: int, seeds: int, cycles: str | None) -> dict[str, Any]:
    """Error of denoised frames, ours also of fewer samples, against many of ours (Cycles' mean agrees to 0.2 %)."""
    truth, _ = ours(scene)(64 * spp, 77)
    seen = truth.max(axis=-1) > 0
    floor = 0.01 * float(truth[seen].mean()) ** 2
    out: dict[str, Any] = {"scene": scene.name}
    process = Cycles(cycles, scene, denoise=True) if cycles else None
    for count in (spp, spp // 2, spp // 4):
        renderers: dict[str, Timed] = {f"mirelight {count}": ours(scene, denoise=True)}
        if process and count == spp:
            renderers[f"cycles {count}"] = process
        pictures, seconds = interleaved(renderers, count, seeds)
        for name in renderers:
            squared = [np.mean((picture - truth)[seen] ** 2 / (truth[seen] ** 2 + floor)) for picture in pictures[name]]
            row = out[name] = {"cpu": median(seconds[name]), "error": float(np.sqrt(np.mean(squared)))}
            print(f"{scene.name:20} {name:16} {row['cpu']:8.3f} s {row['error']:8.4f} denoised", flush=True)
    if process:
        process.close()
    return out


def wall(render: Callable[[], object]) -> float:
    """Seconds on the clock."""
    start = time.perf_counter()
    render()
    return time.perf_counter() - start


def threads(scene: BenchScene, repeats: int) -> dict[str, Any]:
    """Wall time with one thread over that with two, by turns. Says something on an idle machine only."""
    import drjit as dr

    render, before = ours(scene), dr.thread_count()
    spent: dict[int, list[float]] = {1: [], 2: []}
    render(16, 0)
    for repeat in range(repeats):
        for count, times in spent.items():
            dr.set_thread_count(count)
            times.append(wall(lambda seed=repeat: render(16, seed)))  # type: ignore[misc]
    dr.set_thread_count(before)
    one, two = median(spent[1]), median(spent[2])
    print(f"{scene.name:20} one thread {one:.3f} s, two {two:.3f} s: {one / two:.2f} times", flush=True)
    return {"scene": scene.name, "one thread": one, "two threads": two}


def overheads(scene: BenchScene, width: int, height: int, repeats: int) -> dict[str, Any]:
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
    out = {what: 1000 * (median(times) - base) for what, times in spent.items() if what != "nothing new"}
    line = ", ".join(f"new {what} {ms:.1f} ms" for what, ms in out.items())
    print(f"{width} x {height}: frame {1000 * base:.0f} ms of CPU; {line}", flush=True)
    return {"frame ms": 1000 * base, **out}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="small pictures, few seeds: does it run?")
    parser.add_argument("--json", type=Path, help="write the figures there")
    parser.add_argument("--cycles", metavar="PYTHON", help="a Python interpreter with the bpy package")
    parser.add_argument("--spp", type=int, nargs="+", default=[16, 64])
    parser.add_argument("--scenes", nargs="+", help="only those whose name starts so")
    parts = ["errors", "denoised", "threads", "overheads"]
    parser.add_argument("--parts", nargs="+", choices=parts, default=["errors", "threads", "overheads"])
    chosen = parser.parse_args()
    width, height, cells, seeds = (96, 54, 40, 3) if chosen.quick else (320, 180, 220, 6)
    three = scenes(width, height, cells)
    wanted = tuple(chosen.scenes or [""])
    every = [s for s in three + crowds(three[0]) if s.name.startswith(wanted)]
    out: dict[str, list[Any]] = {part: [] for part in chosen.parts}
    for scene in every:
        many = len(scene.lighting.lights) > 50
        for spp in chosen.spp if "errors" in out else []:
            # cost at a given error does not depend on the size; Cycles is left out of crowds: its lamps have no range
            few, rival = max(2, min(seeds, 256 // spp)), None if many else chosen.cycles
            view = scene.camera.resized(width // 2, height // 2) if spp > 64 else scene.camera
            out["errors"].append(errors(replace(scene, camera=view), spp, few, rival))
        if "denoised" in out and not many:
            out["denoised"].append(denoised(scene, min(chosen.spp), seeds, chosen.cycles))
        if "threads" in out and not many:
            out["threads"].append(threads(scene, seeds))
    if "overheads" in out:
        out["overheads"].append(overheads(three[0], *((320, 180) if chosen.quick else (1280, 720)), seeds))
    if chosen.json:
        chosen.json.write_text(json.dumps(out, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
