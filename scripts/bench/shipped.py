"""Frames of the shipped capture that was trained on pictures, beside its shipped path-traced truth.

    python scripts/bench shipped [--width 320] [--pictures DIR]

Its proxy is made from the splats. Frames have half the job's pixels, so their splats are composited finer. Scored where
the true surface is, and in the whole picture, with what splats show behind it. Needs the extra `scenes`.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scenegen.truth import Truth
from trained_scene import recipe

from bench.common import Table, path, side_by_side, table
from bench.modes import decibels, opened, shown, truth
from mirelight.io import job as jobs
from mirelight.model import Job
from mirelight.pipeline import stages
from mirelight.relighting import unlit_rgba

ROOT = Path(__file__).resolve().parents[2]
COVERAGE_SPP, WHOLE = 16, 0.99  # samples that say where the surface is, and the share of them that meets it

Bool = NDArray[np.bool_]


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


def options(parser: argparse.ArgumentParser) -> None:
    """The part's own."""
    parser.add_argument("--spp", type=int, default=64)
    parser.add_argument("--width", type=int, default=320)
    parser.add_argument("--cache", type=path, default=ROOT / "out" / "bench_shipped", help="where artefacts are kept")
    parser.add_argument("--pictures", type=path, help="capture | tint | as shipped | light known | truth go there")


def run(chosen: argparse.Namespace) -> list[Table]:
    """The table."""
    spp, width = (1, 64) if chosen.quick else (chosen.spp, chosen.width)
    settings = [f"render.spp={spp}", "output.layers=false", "compositor.supersampling=2"]
    job = jobs.load(ROOT / "scenes" / "plinth" / "job.toml", settings)
    job = replace(job, cameras=(job.cameras[0].resized(width, width * 9 // 16),))
    job = replace(job, output=replace(job.output, directory=chosen.cache))
    columns = ("", "unchanged capture", "tint", "as shipped", "light known")
    return [table("A trained capture", columns, rows(job, chosen.pictures))]
