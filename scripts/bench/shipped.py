"""Frames of the shipped scenes beside their shipped path-traced truth.

    python scripts/bench shipped [--width 320] [--pictures DIR]

Courtyard and stage have light that is known, frames of twice that width, and whole pictures are compared: as they are,
and averaged over 4x4 pixels in linear light, which takes out most of the noise of both sides. The plinth's proxy is
made from its splats, and its light is estimated, too. Its frames have half the job's pixels, so their splats are
composited finer; they are scored where the true surface is, and in the whole picture, with what splats show behind it.
Needs the extra `scenes`.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scenegen.truth import Truth
from trained_scene import recipe

from bench.common import Table, averaged, path, side_by_side, table
from bench.modes import CAPTURED, decibels, opened, shown, truth
from mirelight.io import job as jobs
from mirelight.model import Job
from mirelight.pipeline import stages
from mirelight.relighting import unlit_rgba

ROOT = Path(__file__).resolve().parents[2]
COVERAGE_SPP, WHOLE = 16, 0.99  # samples that say where the surface is, and the share of them that meets it

WAYS: dict[str, tuple[str, ...]] = {
    "tint": ("relight.mode=tint",),
    "gray proxy": ('proxy={path="proxy.glb"}',),
    "as shipped": (),
    "own proxy": ('proxy={path="splats",albedo="splats"}', "cameras_from=proxy.glb"),
    "own, with cameras": (
        'proxy={path="splats",albedo="splats",cameras="transforms.json"}',
        "cameras_from=proxy.glb",
    ),
}

Bool = NDArray[np.bool_]
Picture = NDArray[np.floating]


def rows(job: Job, pictures: Path | None) -> Iterator[tuple[object, ...]]:
    """A row for each lighting: decibels by way; the proxy and its colours are made once."""
    camera, made_of = job.cameras[0], recipe()
    size = camera.height, camera.width
    surface: Bool = Truth(made_of.looks(), made_of.captured).picture(camera, COVERAGE_SPP)[..., 3] > WHOLE
    found = opened(job)
    layer = stages.composite(found, camera)
    assert layer is not None
    capture = shown(unlit_rgba(layer))
    ways = {
        "tint": opened(replace(job, relight=replace(job.relight, mode="tint", background=1.0)), found),
        "as shipped": found,
        "light known": opened(replace(job, captured=made_of.captured), found),
    }
    yield "day, as captured", decibels(capture[surface], shown(truth("plinth", "day", size))[surface]), "", "", ""
    for lighting in job.lightings:
        true = shown(truth("plinth", lighting.name, size))
        frames = [capture, *(shown(stages.frame(scene, camera, lighting).rgba) for scene in ways.values())]
        if pictures is not None:
            side_by_side(pictures / f"{lighting.name}.png", [*frames, true])
        yield lighting.name, *(decibels(x[surface], true[surface]) for x in frames)
        yield f"{lighting.name}, whole picture", *(decibels(x, true) for x in frames)


def known(
    scene: str, ways: Mapping[str, Sequence[str]], settings: Sequence[str], chosen: argparse.Namespace, width: int
) -> Iterator[tuple[object, ...]]:
    """A row for each lighting of a scene whose captured light is given: decibels by way, each a job's settings."""
    height = width * 9 // 16
    jobs_by_way = {
        name: jobs.load(ROOT / "scenes" / scene / "job.toml", [*settings, *way]) for name, way in ways.items()
    }
    camera = next(x for x in jobs_by_way["tint"].cameras if x.name == "front").resized(width, height)
    found = [
        opened(replace(job, output=replace(job.output, directory=chosen.cache / scene / name)))
        for name, job in jobs_by_way.items()
    ]
    layer = stages.composite(found[0], camera)
    assert layer is not None
    capture = unlit_rgba(layer)[..., :3]
    own = truth(scene, CAPTURED[scene], (height, width))
    yield f"{scene}, as captured", both(capture, own), *[""] * len(ways)
    for lighting in jobs_by_way["tint"].lightings:
        true = truth(scene, lighting.name, (height, width))
        frames: list[Picture] = [capture, *(stages.frame(x, camera, lighting).rgba[..., :3] for x in found)]
        if chosen.pictures is not None:
            side_by_side(chosen.pictures / f"{scene}.{lighting.name}.png", [shown(x) for x in [*frames, true]])
        yield f"{scene}, {lighting.name}", *(both(x, true) for x in frames)


def both(frame: Picture, true: Picture) -> str:
    """Decibels of a linear picture (H, W, 3), and of means over 4x4 pixels, as PNGs hold them."""
    pictures = [np.clip(x, 0, 1) for x in (frame, true)]
    means = [averaged(x, 4, 4) for x in pictures]
    every, coarse = (decibels(*map(shown, pair)) for pair in (pictures, means))
    return f"{every:.1f} ({coarse:.1f})"


def options(parser: argparse.ArgumentParser) -> None:
    """The part's own."""
    parser.add_argument("--spp", type=int, default=64)
    parser.add_argument("--width", type=int, default=320)
    parser.add_argument("--cache", type=path, default=ROOT / "out" / "bench_shipped", help="where artefacts are kept")
    parser.add_argument("--pictures", type=path, help="capture | tint | as shipped | light known | truth go there")


def run(chosen: argparse.Namespace) -> list[Table]:
    """The tables."""
    spp, width = (1, 64) if chosen.quick else (chosen.spp, chosen.width)
    settings = [f"render.spp={spp}", "output.layers=false", "compositor.supersampling=2"]
    job = jobs.load(ROOT / "scenes" / "plinth" / "job.toml", settings)
    job = replace(job, cameras=(job.cameras[0].resized(width, width * 9 // 16),))
    job = replace(job, output=replace(job.output, directory=chosen.cache))
    columns = ("", "unchanged capture", "tint", "as shipped", "light known")
    plinth = table("A trained capture", columns, rows(job, chosen.pictures))
    ways = WAYS if not chosen.quick else {name: WAYS[name] for name in ("tint", "gray proxy")}
    scenes = ("courtyard",) if chosen.quick else ("courtyard", "stage")
    given = (row for scene in scenes for row in known(scene, ways, settings[:2], chosen, 2 * width))
    return [table("Light that is known", ("", "unchanged capture", *ways), given), plinth]
