"""Whether Blender Cycles and this tracer show the same light: means of blocks over independent seeds, by z-test.

    python scripts/bench cycles PYTHON     # an interpreter with the bpy package; four minutes of CPU

Ends with an error where a block of a benchmark scene differs by more than both renderers' noise explains (Welch's t,
Šidák's correction over all blocks and channels, one false alarm in 10,000).
"""

from __future__ import annotations

import argparse
import sys

import numpy as np
from ztest import worst_and_allowed

from bench.common import Table, table
from bench.lighting import Cycles, ours
from bench.scenes import scenes

WIDTH, HEIGHT, CELLS, SPP, SEEDS, BLOCK = 160, 90, 160, 64, 12, 15


def options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("python", help="a Python interpreter with the bpy package")


def run(chosen: argparse.Namespace) -> list[Table]:
    rows, apart = [], []
    for scene in scenes(WIDTH, HEIGHT, CELLS):
        cycles, tracer = Cycles(chosen.python, scene), ours(scene)
        seeds = range(1, 1 + (3 if chosen.quick else SEEDS))
        pairs = [(tracer(SPP, seed)[0], cycles(SPP, seed)[0]) for seed in seeds]
        cycles.close()
        a, b = (np.stack(pictures).astype(np.float64) for pictures in zip(*pairs, strict=True))
        worst, allowed = worst_and_allowed(a, b, block=BLOCK)
        apart += [scene.name] * (worst > allowed)
        rows.append((scene.name, f"{a.mean() / b.mean():.4f}", f"{worst:.1f}", f"{allowed:.1f}"))
    found = table("Agreement with Cycles", ["scene", "mean of ours / Cycles", "|t| up to", "allowed"], rows)
    if apart:
        sys.exit(f"{found}\napart: {', '.join(apart)}")
    return [found]
