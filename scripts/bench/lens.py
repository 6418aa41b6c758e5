"""What samples of light a lens' pinholes need: the courtyard's evening by mode `ratio`, through a very small lens.

    python scripts/bench lens

Such a frame is that of one pinhole but for noise, and for what quotients of noisy light are too bright.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

import mirelight
from bench.common import Table, table, timed
from mirelight.base import colour
from mirelight.model import F32, Exposure
from mirelight.pipeline import frames

JOB = Path(__file__).resolve().parents[2] / "scenes" / "courtyard" / "job.toml"
SPP, REFERENCE = 64, 512
LENS = Exposure(aperture_radius=1e-6, focus_distance=5.0)


def options(parser: argparse.ArgumentParser) -> None:
    """None of its own."""


def run(chosen: argparse.Namespace) -> list[Table]:
    """The table."""
    size = "resolution_scale=0.03" if chosen.quick else "resolution_scale=0.15"
    job = mirelight.load(JOB, [size, f"render.spp={SPP}", "render.indirect='traced'"])
    camera, lighting, scene = job.cameras[0], job.lightings[0], mirelight.prepare(job)
    fine = mirelight.prepare(replace(job, render=replace(job.render, spp=REFERENCE)), like=scene)
    truth = frames.frame(fine, camera, lighting).rgba

    def row(what: str, each: int, count: int, made: F32, seconds: float) -> tuple[object, ...]:
        error = np.mean((_shown(made) - _shown(truth)) ** 2)
        level = 100 * (float(made[..., :3].mean()) / float(truth[..., :3].mean()) - 1)
        return what, each, count * each, f"{-10 * np.log10(error):.1f} dB", f"{level:+.2f} %", f"{seconds:.1f} s"

    plain, seconds = timed(lambda: frames.frame(scene, camera, lighting).rgba)
    rows = [row("one pinhole", SPP, 1, plain, seconds)]
    for count, least in ((4, 1), (8, 1), (32, 1), (32, 4), (32, 8)):
        frames._LEAST_COMPARED = least
        own = mirelight.prepare(replace(job, render=replace(job.render, lens_samples=count)), like=scene)
        made, seconds = timed(partial(frames.frame, own, replace(camera, exposure=LENS), lighting))
        rows.append(row(f"{count} pinholes", max(SPP // count, least), count, made.rgba, seconds))
    return [table("Samples of a lens' pinholes", ["frame", "samples each", "in all", "PSNR", "level", "CPU"], rows)]


def _shown(rgba: F32) -> F32:
    return colour.srgb_encode(np.clip(rgba[..., :3], 0, 1))
