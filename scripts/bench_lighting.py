"""How much CPU time each renderer needs for a given error, on three procedural scenes.

Ours and Mitsuba's `path` (and Blender Cycles, through --cycles) render the same mesh, lights and bounces, interleaved.
All are unbiased, so the error comes from the spread of independent seeds: error² = mean(variance / (r² + 0.01 mean²))
over covered pixels, and the figure is error² x CPU seconds of a warm frame. Smaller is better; `path` is 1.

    python scripts/bench_lighting.py [--quick] [--json FILE] [--cycles PYTHON_WITH_BPY]
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirelight import backend
from mirelight.lighting import Tracer, oracle
from mirelight.model import (
    Camera,
    DirectionalLight,
    Environment,
    Light,
    Lighting,
    PointLight,
    ProxyMesh,
    RenderSettings,
    SpotLight,
    SunLight,
)

BOUNCES = 8
Array = NDArray[np.float64]
Render = Callable[[int, int], Array]  # (spp, seed) -> (H, W, 3)


@dataclass(frozen=True, slots=True)
class BenchScene:
    """What is rendered."""

    name: str
    proxy: ProxyMesh
    lighting: Lighting
    camera: Camera


# --- scenes ----------------------------------------------------------------------------------------------------------


def box(low: list[float], high: list[float]) -> tuple[Array, Array]:
    """Vertices (8, 3) and faces (12, 3) of an axis-aligned box."""
    a, b = np.array(low, float), np.array(high, float)
    v = np.array([[(a, b)[i][0], (a, b)[j][1], (a, b)[k][2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return v, np.array([t for q in quads for t in ((q[0], q[1], q[2]), (q[0], q[2], q[3]))])


def ground(size: float, cells: int, bump: float) -> tuple[Array, Array]:
    """A gently uneven square of 2 cells² triangles."""
    t = np.linspace(-size, size, cells + 1)
    x, z = np.meshgrid(t, t)
    y = bump * (np.sin(3.1 * x) * np.cos(2.3 * z) + 0.5 * np.sin(9.7 * x + 1) * np.sin(8.3 * z))
    i = np.arange((cells + 1) ** 2).reshape(cells + 1, cells + 1)
    a, b, c, d = (q.ravel() for q in (i[:-1, :-1], i[:-1, 1:], i[1:, :-1], i[1:, 1:]))
    return np.stack([x, y, z], -1).reshape(-1, 3), np.concatenate([np.stack([a, c, b], 1), np.stack([b, c, d], 1)])


def ball(centre: list[float], radius: float, rings: int) -> tuple[Array, Array]:
    """A sphere of facets."""
    t, f = np.meshgrid(np.linspace(0, np.pi, rings + 1), np.arange(2 * rings) * np.pi / rings, indexing="ij")
    v = np.stack([np.sin(t) * np.cos(f), np.cos(t), np.sin(t) * np.sin(f)], -1).reshape(-1, 3)
    n = 2 * rings
    i, j = (q.ravel() for q in np.meshgrid(np.arange(rings), np.arange(n), indexing="ij"))
    a, b = i * n + j, i * n + (j + 1) % n
    faces = np.concatenate([np.stack([a, b, a + n], 1), np.stack([b, b + n, a + n], 1)])
    area = np.linalg.norm(np.cross(v[faces[:, 1]] - v[faces[:, 0]], v[faces[:, 2]] - v[faces[:, 0]]), axis=1)
    return v * radius + np.array(centre), faces[area > 1e-9]


def merged(parts: list[tuple[Array, Array]]) -> ProxyMesh:
    """One proxy of many pieces."""
    starts = np.cumsum([0] + [len(v) for v, _ in parts[:-1]])
    return ProxyMesh(
        vertices=np.concatenate([v for v, _ in parts]).astype(np.float32),
        faces=np.concatenate([f + s for (_, f), s in zip(parts, starts, strict=True)]).astype(np.int32),
    )


def sky(sun: float) -> Environment:
    """A bright horizon, a blue zenith, dark ground and a glow round the sun, 512 x 1024."""
    v, u = np.meshgrid((np.arange(512) + 0.5) / 512, (np.arange(1024) + 0.5) / 1024, indexing="ij")
    theta, phi = np.pi * v, 2 * np.pi * (u - 0.5)
    way = np.stack([np.cos(phi) * np.sin(theta), np.cos(theta), np.sin(phi) * np.sin(theta)], -1)
    up = way[..., 1:2]
    color = np.where(up > 0, np.array([0.5, 0.7, 1.0]) * (0.4 + 0.8 * np.exp(-4 * np.maximum(up, 0))), 0.08)
    toward = np.array([0.55, 0.65, 0.52])
    glow = sun * np.exp(400 * (way @ (toward / np.linalg.norm(toward)) - 1))
    return Environment(radiance=(color + glow[..., None] * np.array([1.0, 0.9, 0.7])).astype(np.float32))


def courtyard_mesh(cells: int) -> ProxyMesh:
    """Walls round a square, columns, balls."""
    parts = [ground(6, cells, 0.03)]
    parts += [box([-6, 0, -6.3], [6, 4, -6]), box([-6.3, 0, -6], [-6, 4, 6]), box([6, 0, -6], [6.3, 3, 6])]
    parts += [box([x - 0.25, 0, z - 0.25], [x + 0.25, 3, z + 0.25]) for x in (-4, -1.5, 1.5, 4) for z in (-4, 0)]
    parts += [box([-4.6, 3, -4.6], [4.6, 3.3, -3.4])]
    parts += [ball([x, 0.6, z], 0.6, 48) for x, z in ((-2.5, 2), (0.5, 1.5), (2.8, 2.6))]
    return merged(parts)


def scenes(width: int, height: int, cells: int) -> list[BenchScene]:
    """Courtyard by day, interior through windows, courtyard by night."""
    yard = courtyard_mesh(cells)
    view = Camera.look_at([4.5, 3.2, 7.5], [-0.6, 0.9, 0], width, height, yfov=50, name="yard")
    towards = np.array([-0.55, -0.65, -0.52])
    lamp = PointLight(name="lamp", position=np.array([-2.5, 2.4, 0.8]), color=np.array([1.0, 0.7, 0.4]), intensity=6.0)
    spot = SpotLight(
        name="spot",
        position=np.array([3.0, 3.5, 3.0]),
        direction=np.array([-0.4, -1.0, -0.3]),
        intensity=25.0,
        inner_cone_angle=0.49,
        outer_cone_angle=0.5,
    )
    day: tuple[Light, ...] = (SunLight(name="sun", direction=towards, intensity=4.0), lamp, spot)
    rng = np.random.default_rng(5)
    spots = [[x, 1.9 + 0.5 * rng.random(), z] for x in (-5, -2.8, 0.2, 2.8) for z in (-2.0, 1.0, 4.0)]
    lamps = tuple(
        PointLight(name=f"lamp {k}", position=np.array(p), color=0.4 + 0.6 * rng.random(3), intensity=2.0)
        for k, p in enumerate(spots)
    )
    room = merged(
        [
            ground(4, cells, 0.0),
            box([-4, 3, -4], [4, 3.2, 4]),
            box([-4.2, 0, -4], [-4, 3, 4]),
            box([-4, 0, -4.2], [4, 3, -4]),
            box([-4, 0, 4], [4, 3, 4.2]),
            *(box([4, a, c], [4.2, b, d]) for a, b, c, d in ((0, 1, -4, 4), (2.4, 3, -4, 4))),
            *(box([4, 1, c], [4.2, 2.4, d]) for c, d in ((-4, -3), (-1.6, -0.4), (1.0, 1.6), (3, 4))),
            box([-1.5, 0, -1.5], [0.5, 0.8, -0.5]),
            *(ball([x, 0.5, z], 0.5, 32) for x, z in ((-2.5, 1.5), (1.5, 0.8))),
        ]
    )
    inside = Camera.look_at([-3.4, 1.7, 3.4], [0.8, 0.8, -0.6], width, height, yfov=60, name="room")
    through = SunLight(name="sun", direction=np.array([-0.75, -0.5, -0.25]), intensity=6.0)
    return [
        BenchScene("courtyard", yard, Lighting(lights=day, environment=sky(30.0)), view),
        BenchScene("interior", room, Lighting(lights=(through,), environment=sky(5.0)), inside),
        BenchScene("night", yard, Lighting(lights=lamps), view),
    ]


# --- renderers -------------------------------------------------------------------------------------------------------


def ours(scene: BenchScene) -> Render:
    """mirelight's tracer, warm."""
    tracer = Tracer(scene.proxy, RenderSettings(max_depth=BOUNCES))

    def render(spp: int, seed: int) -> Array:
        tracer.settings = replace(tracer.settings, spp=spp, seed=seed)
        return tracer.trace(scene.lighting, scene.camera).beauty.astype(np.float64)

    return render


def mitsuba_path(scene: BenchScene) -> Render:
    """Mitsuba's path integrator on the same scene."""
    mi = backend.mitsuba("llvm_ad_rgb")
    world = oracle.scene(mi, scene.proxy, scene.lighting, scene.camera)

    def render(spp: int, seed: int) -> Array:
        picture, _ = oracle.path_beauty(mi, world, spp=spp, max_depth=BOUNCES, seed=seed)
        return picture.astype(np.float64)

    return render


class Cycles:
    """Blender Cycles in a process of its own, asked over pipes; see bench_lighting_cycles.py."""

    def __init__(self, python: str, scene: BenchScene) -> None:
        self._folder = tempfile.TemporaryDirectory()
        write_scene(Path(self._folder.name) / "scene.npz", scene)
        helper = Path(__file__).with_name("bench_lighting_cycles.py")
        self._process = subprocess.Popen(
            [python, str(helper), self._folder.name], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
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
            lights.append([2, *light.position, *light.direction, *strength, 0, light.outer_cone_angle, 0])
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
        sky=np.zeros((0, 0, 3), np.float32) if environment is None else environment.radiance,
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


def timed(render: Render) -> Callable[[int, int], tuple[Array, float]]:
    """A renderer that also says how much CPU time it took."""

    def run(spp: int, seed: int) -> tuple[Array, float]:
        start = time.process_time()
        picture = render(spp, seed)
        return picture, time.process_time() - start

    return run


def measure(scene: BenchScene, spp: int, seeds: int, cycles: str | None) -> dict[str, Any]:
    """One row of the table."""
    renderers: dict[str, Callable[[int, int], tuple[Array, float]]] = {
        "path": timed(mitsuba_path(scene)),
        "mirelight": timed(ours(scene)),
    }
    blender = Cycles(cycles, scene) if cycles else None
    if blender is not None:
        renderers["cycles"] = blender
    pictures: dict[str, list[Array]] = {name: [] for name in renderers}
    seconds: dict[str, list[float]] = {name: [] for name in renderers}
    for render in renderers.values():
        render(spp, 9999)  # compiles, builds
    for seed in range(seeds):
        for name, render in renderers.items():
            picture, spent = render(spp, 1 + seed)
            pictures[name].append(picture)
            seconds[name].append(spent)
    if blender is not None:
        blender.close()
    out: dict[str, Any] = {"scene": scene.name, "triangles": len(scene.proxy.faces), "spp": spp}
    for name in renderers:
        cpu = float(np.median(seconds[name]))
        error = error2(pictures[name])
        mean = float(np.mean(pictures[name]))
        out[name] = {"cpu": cpu, "error2": error, "cost": cpu * error, "mean": mean}
    for name in renderers:
        out[name]["against path"] = out[name]["cost"] / out["path"]["cost"]
    return out


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="small pictures, few seeds: does it run?")
    parser.add_argument("--json", type=Path, help="write the figures there")
    parser.add_argument("--cycles", metavar="PYTHON", help="a Python interpreter with the bpy package")
    parser.add_argument("--spp", type=int, nargs="+", default=[16, 64])
    chosen = parser.parse_args()
    width, height, cells, seeds = (96, 54, 40, 4) if chosen.quick else (320, 180, 220, 8)
    rows = []
    print(f"{'scene':10} {'spp':>4} {'renderer':10} {'CPU s':>8} {'error':>8} {'vs path':>8} {'mean':>8}")
    for scene in scenes(width, height, cells):
        for spp in chosen.spp:
            row = measure(scene, spp, seeds, chosen.cycles)
            rows.append(row)
            for name in ("cycles", "path", "mirelight"):
                if name in row:
                    r = row[name]
                    figures = f"{r['cpu']:8.3f} {np.sqrt(r['error2']):8.4f} {r['against path']:8.3f} {r['mean']:8.4f}"
                    print(f"{scene.name:10} {spp:4} {name:10} {figures}", flush=True)
    if chosen.json:
        chosen.json.write_text(json.dumps(rows, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
