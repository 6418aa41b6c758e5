"""Benchmark of the splat compositor: stages, CPU per blended fragment, and its ratio to a Numba port in the same run.

    python scripts/bench compositor [--memory] [--splats FILE --eye X Y Z --target X Y Z]

Times are process CPU time on one thread (medians), so that other work on the machine disturbs them least; the ratio is
taken interleaved. A fragment counts as blended where its alpha reaches 1/255 and its pixel is still open. Numba is an
optional extra; without it fragments are not counted and no ratio is given.
"""

from __future__ import annotations

import argparse
import multiprocessing
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median

import numpy as np

from bench.common import Table, peak_mb, table
from mirelight.compositor import Compositor
from mirelight.compositor.bin import Band, TileLists, sorted_records, tile_lists
from mirelight.compositor.blend import Source, blend
from mirelight.compositor.cloud import upload, view_of
from mirelight.compositor.device import Device, open_device
from mirelight.compositor.kernel import splat_kernel
from mirelight.compositor.order import depth_order
from mirelight.compositor.project import project
from mirelight.compositor.resolve import new_frame
from mirelight.io import splats as splat_files
from mirelight.io.splats.edit import transform
from mirelight.model import Camera, CompositorSettings, SplatCloud

try:
    from bench import numba_tiles
except ImportError:  # numba is not installed
    numba_tiles = None  # type: ignore[assignment]

SETTINGS = CompositorSettings()


@dataclass(frozen=True)
class Scene:
    """What is timed."""

    name: str
    splats: SplatCloud
    camera: Camera

    @property
    def size(self) -> str:
        """Of its picture."""
        return f"{self.camera.width} x {self.camera.height}"


@dataclass
class Result:
    """Medians of one scene; milliseconds of CPU on one thread unless said."""

    scene: str
    splats: int
    frame: str
    visible: int
    pairs: int  # of splats and tiles
    stages: dict[str, float] = field(default_factory=dict)
    whole: float = 0.0  # a composite, to NumPy arrays, without depths
    with_depth: float = 0.0
    wall_one_thread: float = 0.0
    wall_all_threads: float = 0.0
    threads: int = 1
    fragments: int = 0
    numba: float = 0.0


def room(count: int, degree: int = 3, seed: int = 0) -> SplatCloud:
    """A synthetic room: flat splats on its six sides, needles and balls on twelve spheres inside."""
    r = np.random.default_rng(seed)
    on_walls = count * 7 // 10
    side = r.integers(0, 6, on_walls)
    walls = r.uniform(-1, 1, (on_walls, 3))
    walls[np.arange(on_walls), side // 2] = np.where(side % 2, 1, -1)
    rest = count - on_walls
    out = r.normal(size=(rest, 3))
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    ball = r.integers(0, 12, rest)
    centers, radii = r.uniform(-0.7, 0.7, (12, 3)), r.uniform(0.1, 0.3, 12)
    size = np.array([4, 2.5, 4])
    means = np.concatenate([walls * size, centers[ball] * size + out * radii[ball, None]])
    scales = np.exp(r.normal(np.log(4.8 / np.sqrt(count)), 0.5, (count, 3)))
    scales[:, 2] *= 0.15
    quats = r.normal(size=(count, 4))
    sh = r.standard_normal((count, (degree + 1) ** 2, 3), dtype=np.float32)
    sh *= np.float32(0.08)
    sh[:, 0] = np.sin(means * [3, 4, 2]).astype(np.float32)
    return SplatCloud(
        means=means.astype(np.float32),
        quats=(quats / np.linalg.norm(quats, axis=1, keepdims=True)).astype(np.float32),
        scales=scales.astype(np.float32),
        opacities=(1 / (1 + np.exp(-r.normal(0.5, 2, count)))).astype(np.float32),
        sh=sh,
    )


def inside_room(width: int, height: int) -> Camera:
    """The room's camera."""
    return Camera.look_at((2.8, 0.6, 2.9), (-1, -0.3, -0.6), width, height, yfov=60)


def cpu(work: Callable[[], object], clock: Callable[[], float] = time.process_time) -> float:
    """Milliseconds of one run."""
    start = clock()
    work()
    return (clock() - start) * 1e3


def stages(device: Device, scene: Scene, result: Result, repeats: int) -> None:
    """Time every stage of a frame, waiting for each."""
    kernel = splat_kernel(SETTINGS, scene.camera)
    cloud = upload(device, scene.splats, SETTINGS)
    camera = scene.camera
    band = Band(-(-camera.width // device.tile_width), -(-camera.height // device.tile_height), 0)
    taken: dict[str, list[float]] = {}
    for _ in range(repeats):
        clock = [time.process_time()]

        def mark(name: str, clock: list[float] = clock) -> None:
            device.dr.sync_thread()
            clock.append(time.process_time())
            taken.setdefault(name, []).append((clock[-1] - clock[-2]) * 1e3)

        projected = project(device, cloud, view_of(device, camera, kernel), kernel, SETTINGS)
        mark("project and SH")
        order = depth_order(device, projected.key, projected.visible)
        mark("depth order")
        records = sorted_records(device, projected.records, order)
        mark("records in order")
        lists = tile_lists(device, records, band, 1 << 62)
        mark("tile lists")
        if not isinstance(lists, TileLists):
            raise SystemExit(f"{scene.name}: too many pairs of splats and tiles")
        frame = new_frame(device, band, depth=False, channels=0)
        blend(Source(device, kernel.fragment, 0, False), [records], lists, band, frame)
        mark("blend and untile")
        result.visible, result.pairs = len(order), lists.pairs
    result.stages = {name: median(times) for name, times in taken.items()}


def bench(scene: Scene, repeats: int) -> Result:
    """Everything about one scene."""
    camera = scene.camera
    result = Result(scene.name, len(scene.splats), scene.size, 0, 0)
    device = open_device("llvm_ad_rgb", None)
    cores = device.dr.thread_count()
    device = open_device("llvm_ad_rgb", 1)
    stages(device, scene, result, repeats)

    compositor = Compositor(scene.splats, SETTINGS, threads=1)
    compositor.composite(camera, depth=False)
    compositor.composite(camera)
    prepared = numba_tiles.prepare(scene.splats) if numba_tiles else None
    if numba_tiles and prepared:
        result.fragments = numba_tiles.rasterise(prepared, camera)[1]  # and compiles it
    plain, deep, wall, other = [], [], [], []
    for i in range(repeats):
        plain.append(cpu(lambda: compositor.composite(camera, depth=False)))
        deep.append(cpu(lambda: compositor.composite(camera)))
        wall.append(cpu(lambda: compositor.composite(camera, depth=False), time.perf_counter))
        if numba_tiles and prepared and i < max(1, repeats // 3):
            other.append(cpu(lambda: numba_tiles.rasterise(prepared, camera)))
    result.whole, result.with_depth, result.wall_one_thread = median(plain), median(deep), median(wall)
    result.numba = median(other) if other else 0.0

    compositor = Compositor(scene.splats, SETTINGS, threads=cores)
    compositor.composite(camera, depth=False)
    result.wall_all_threads = median(
        cpu(lambda: compositor.composite(camera, depth=False), time.perf_counter) for _ in range(repeats)
    )
    result.threads = cores
    return result


def _composite_alone(folder: str, camera: Camera) -> float:
    arrays = {f.stem: np.load(f) for f in Path(folder).glob("*.npy")}
    Compositor(SplatCloud(**arrays), SETTINGS, threads=1).composite(camera)
    return peak_mb() / 1024


def peak_memory(scene: Scene) -> float:
    """GiB that a process of its own takes at most to read the scene's arrays and composite them, depths included."""
    with tempfile.TemporaryDirectory() as folder:
        for name in ("means", "quats", "scales", "opacities", "sh"):
            np.save(Path(folder) / f"{name}.npy", getattr(scene.splats, name))
        with multiprocessing.get_context("spawn").Pool(1) as pool:
            return pool.apply(_composite_alone, (folder, scene.camera))


def row(r: Result) -> list[str]:
    """A row of the table."""
    gain = r.wall_one_thread / r.wall_all_threads
    return [
        r.scene,
        f"{r.splats:,}",
        r.frame,
        *(f"{x:.1f}" for x in r.stages.values()),
        f"{r.whole:.1f}",
        f"{r.with_depth:.1f}",
        f"{r.fragments / 1e6:.1f} M",
        f"{r.whole / r.fragments * 1e6:.1f}" if r.fragments else "–",
        f"{r.numba / r.whole:.0f}x" if r.numba else "–",
        f"{gain:.2f}x",
    ]


def scenes(arguments: argparse.Namespace) -> list[Scene]:
    """Those asked for."""
    if arguments.splats:
        cloud = splat_files.read(arguments.splats)
        turn = np.diag([-1.0, -1.0, 1.0, 1.0]) if arguments.upside_down else np.eye(4)
        camera = Camera.look_at(arguments.eye, arguments.target, 1280, 720, yfov=45)
        return [Scene(Path(arguments.splats).name, transform(cloud, turn), camera)]
    if arguments.quick:
        return [Scene("room", room(100_000), inside_room(640, 360))]
    return [
        Scene("room", room(1_000_000), inside_room(1280, 720)),
        Scene("room", room(1_000_000), inside_room(1920, 1080)),
        Scene("room", room(3_000_000), inside_room(1920, 1080)),
    ]


def options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--memory", action="store_true", help="only the peak memory of each scene, in its own process")
    parser.add_argument("--splats", metavar="FILE", help="a capture instead of the synthetic rooms")
    parser.add_argument("--upside-down", action="store_true", help="turn the capture by 180 degrees about Z")
    parser.add_argument("--eye", type=float, nargs=3, default=(5.4, 2.6, 1.6), help="camera of the capture")
    parser.add_argument("--target", type=float, nargs=3, default=(0.0, 2.1, 0.0))


def run(chosen: argparse.Namespace) -> list[Table]:
    """Milliseconds of CPU, medians, one thread; or GiB."""
    if chosen.memory:
        rows = [
            (x.name, f"{len(x.splats):,}", f"{x.camera.width} x {x.camera.height}", peak_memory(x))
            for x in scenes(chosen)
        ]
        return [table("Memory, measured", ("scene", "splats", "frame", "GiB"), rows)]
    results = [bench(scene, 3 if chosen.quick else 9) for scene in scenes(chosen)]
    head = ["scene", "splats", "frame", *results[0].stages, "whole frame", "with depths", "fragments", "ns / fragment"]
    return [
        table("Milliseconds a frame", [*head, "Numba port", f"{results[0].threads} threads, wall"], map(row, results))
    ]
