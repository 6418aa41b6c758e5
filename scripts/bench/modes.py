"""Ways of relighting on the shipped scenes: modes, per pixel and per splat; and what formats lose of a bake.

    python scripts/bench modes SCENE LIGHTING [--ways] [--bake] [--spp 16] [--width 320]

The camera is the scene's first, and the truth its shipped path-traced picture. Light alone: the true captured picture
times the frame's factor, so that the splats' own error is not in it. Light is denoised where pixels are relit.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from bench.common import Table, averaged, table
from mirelight import prepare
from mirelight.apps import bake as baking
from mirelight.base import colour
from mirelight.compositor import Compositor
from mirelight.io import job as jobs
from mirelight.io import splats
from mirelight.model import F32, F64, Deferred, Frame, Job, Lighting, RelightMode, RelightSettings
from mirelight.model.profiles import Per
from mirelight.pipeline import stages
from mirelight.pipeline.scene import Scene
from mirelight.relighting import unlit_rgba
from mirelight.store import Store

ROOT = Path(__file__).resolve().parents[2]
CAPTURED = {"stage": "studio", "courtyard": "day"}
AWAY = np.array([1.0, 0.8, -0.6]) / np.sqrt(2.0)  # which way a proxy is moved
MODES: tuple[RelightMode, ...] = ("ratio", "albedo", "tint")
PER: tuple[Per, ...] = ("pixel", "splat")
FORMATS = (".ply", ".compressed.ply", ".sog", ".spz", ".glb")


def shown(linear: NDArray[np.floating]) -> F64:
    """Display values, clipped."""
    return np.clip(colour.srgb_encode(linear[..., :3]), 0, 1).astype(np.float64)


def decibels(a: F64, b: F64) -> float:
    """PSNR."""
    return float(-10 * np.log10(max(float(np.mean((a - b) ** 2)), 1e-16)))


def truth(scene: str, name: str, size: tuple[int, int]) -> F64:
    """(H, W, 3) the shipped picture, linear, averaged down to a divisor of its size."""
    with Image.open(ROOT / "scenes" / scene / "truth" / f"front.{name}.png") as image:
        linear = colour.srgb_decode(np.asarray(image.convert("RGB"), np.float64) / 255)
    return np.asarray(averaged(linear, linear.shape[0] // size[0], linear.shape[1] // size[1]), np.float64)


def made(job: Job, like: Scene | None = None) -> tuple[Frame, Scene]:
    """The job's only frame."""
    scene = opened(job, like)
    return stages.frame(scene, job.cameras[0], job.lightings[0]), scene


def opened(job: Job, like: Scene | None = None) -> Scene:
    """The job made ready; what it has of light stays in its folder."""
    store = Store(job)
    store.open()
    return prepare(job, store.artefacts, like=like)


def moved(job: Job) -> Job:
    """The proxy 1 % of the splats' extent off its place."""
    assert job.proxy is not None and job.splats is not None
    mesh = job.proxy.value
    low, high = np.quantile(job.splats.value.means.astype(np.float64), [0.002, 0.998], axis=0)
    step = 0.01 * float(np.linalg.norm(high - low)) * AWAY
    return replace(job, proxy=Deferred.of(replace(mesh, vertices=(mesh.vertices + step).astype(np.float32))))


def ways(scene: str, job: Job, settings: Sequence[RelightSettings]) -> Iterator[tuple[str, ...]]:
    """A row for each way to relight."""
    size = job.cameras[0].height, job.cameras[0].width
    before, after = (truth(scene, name, size) for name in (CAPTURED[scene], job.lightings[0].name))
    like: Scene | None = None
    for one in settings:
        start = time.process_time()
        frame, like = made(replace(job, relight=one), like)
        assert frame.factor is not None
        alone, whole = decibels(shown(before * frame.factor), shown(after)), decibels(shown(frame.rgba), shown(after))
        seconds = time.process_time() - start
        yield f"`{one.mode}`", one.per, f"{alone:.1f}", f"{whole:.1f}", f"{seconds:.0f}"


def bake(job: Job, lighting: Lighting, spp: int) -> Iterator[tuple[str, ...]]:
    """A row for each format: PSNR against the frame relit per splat, bytes a splat."""
    frame, scene = made(replace(job, relight=replace(job.relight, per="splat")))
    factor = baking.factors(scene, lighting, spp=spp)
    (file,) = job.splat_files
    assert job.splats is not None
    own, world = splats.read(file.path), job.splats.value
    with tempfile.TemporaryDirectory() as folder:
        for suffix in FORMATS:
            path, in_world = Path(folder) / f"relit{suffix}", suffix == ".glb"
            splats.write(baking.relit(world if in_world else own, factor, job.relight), path)
            back = splats.read(path)
            seen = back if in_world else splats.transform(back, file.world_from_file)
            picture: F32 = unlit_rgba(Compositor(seen).composite(job.cameras[0], depth=False))
            size = path.stat().st_size / len(back)
            yield f"`{suffix}`", f"{decibels(shown(picture), shown(frame.rgba)):.1f}", f"{size:.0f}"


def options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("scene", choices=sorted(CAPTURED))
    parser.add_argument("lighting")
    parser.add_argument("--ways", action="store_true", help="modes, per pixel and per splat, proxy as it is and moved")
    parser.add_argument("--bake", action="store_true", help="formats")
    parser.add_argument("--spp", type=int, default=16)
    parser.add_argument("--width", type=int, default=320)


def run(chosen: argparse.Namespace) -> list[Table]:
    """The tables that were asked for."""
    with tempfile.TemporaryDirectory() as folder:  # where light is kept meanwhile
        return list(tables(chosen, Path(folder)))


def tables(chosen: argparse.Namespace, folder: Path) -> Iterator[Table]:
    """Ways to relight, and formats of a bake."""
    spp, width = (1, 64) if chosen.quick else (chosen.spp, chosen.width)
    settings = [f"render.spp={spp}", "output.layers=false", "output.aovs=false"]
    job = jobs.load(ROOT / "scenes" / chosen.scene / "job.toml", [*settings, "render.denoise=true"])
    lighting = next(x for x in job.lightings if x.name == chosen.lighting)
    job = replace(job, output=replace(job.output, directory=folder))
    job = replace(job, cameras=(job.cameras[0].resized(width, width * 9 // 16),), lightings=(lighting,))
    name = f"{chosen.scene}, {lighting.name}"
    if chosen.ways:
        every = [replace(job.relight, mode=m, per=p) for m in MODES for p in PER]
        for title, one in (("as it is", job), ("moved 1 %", moved(job))):
            columns = ("mode", "per", "light alone, dB", "frame, dB", "CPU s")
            yield table(f"{name}, proxy {title}", columns, ways(chosen.scene, one, every))
    if chosen.bake:
        yield table(f"{name}, baked", ("format", "dB", "bytes a splat"), bake(job, lighting, spp))
