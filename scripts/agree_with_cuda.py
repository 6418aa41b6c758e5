"""Does the CUDA variant make the pictures of the LLVM variant, the same ones every time, and how much sooner?

    python scripts/agree_with_cuda.py [--quick] [--json FILE]     # on a machine with an NVIDIA GPU; minutes

One view of each shipped scene under its last lighting, made three times by each variant in a process of its own. Exits
1 where two pictures of one variant differ in a bit, or where those of both differ by more than rounding and what hangs
on it (rays that pass an edge on the other side, paths that end a bounce earlier): a mean difference above a thousandth
of the mean. Splats in a wrong order differ by a hundredth.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from itertools import pairwise
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import mirelight
from mirelight.base.errors import MirelightError
from mirelight.model import Variant

ROOT = Path(__file__).resolve().parent.parent
SCENES = ("courtyard", "stage")
MOST = 1e-3  # mean difference over mean value
TIMES = 3  # the first compiles, and is not counted


@dataclass(frozen=True, slots=True)
class Made:
    """Pictures of one variant, by name, and what they took when nothing was compiled any more."""

    pictures: dict[str, NDArray[np.float32]]  # (H, W, C) each
    same: bool  # every time the same bits
    seconds: dict[str, float]  # by the clock, median


@dataclass(frozen=True, slots=True)
class Row:
    """One picture by both variants."""

    scene: str
    picture: str
    mean: float  # of absolute differences, over the mean of absolute values
    worst: float  # 99.9th percentile of them, over the same
    same_twice: bool  # CUDA's are the same bits every time
    llvm_seconds: float
    cuda_seconds: float


def make(scene: str, variant: Variant, sets: list[str]) -> Made:
    """The pictures of one scene."""
    job = mirelight.load(ROOT / "scenes" / scene / "job.toml", [*sets, f"render.variant={variant}"])
    camera, lighting = job.cameras[0], job.lightings[-1]
    runs: list[dict[str, NDArray[np.float32]]] = []
    clock: dict[str, list[float]] = {"splats": [], "light": [], "relit": []}
    for _ in range(TIMES):
        prepared = mirelight.prepare(job)
        marks = [time.perf_counter()]
        splats = mirelight.composite(prepared, camera)
        marks.append(time.perf_counter())
        lit = mirelight.light(prepared, camera, lighting)
        marks.append(time.perf_counter())
        frame = mirelight.relight(prepared, splats, lit)
        marks.append(time.perf_counter())
        assert splats is not None  # the shipped jobs have some
        runs.append({"splats": splats.color, "light": lit.new.beauty, "relit": frame.rgba})
        for name, (before, after) in zip(clock, pairwise(marks), strict=True):
            clock[name].append(after - before)
    same = all(np.array_equal(run[name], runs[0][name]) for run in runs for name in run)
    return Made(runs[0], same, {name: float(np.median(x[1:])) for name, x in clock.items()})


def compared(scene: str, sets: list[str]) -> list[Row]:
    """One scene by both variants, one after the other: each has the whole machine."""
    made: list[Made] = []
    variants: tuple[Variant, ...] = ("llvm_ad_rgb", "cuda_ad_rgb")
    for variant in variants:
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
            made.append(pool.submit(make, scene, variant, sets).result())
    llvm, cuda = made
    rows = []
    for name, picture in llvm.pictures.items():
        apart = np.abs(cuda.pictures[name].astype(np.float64) - picture)
        level = float(np.abs(picture).mean())
        worst = float(np.quantile(apart, 0.999))
        times = llvm.seconds[name], cuda.seconds[name]
        rows.append(Row(scene, name, float(apart.mean()) / level, worst / level, cuda.same, *times))
    return rows


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="one scene, few samples")
    parser.add_argument("--json", type=Path, help="write all rows here")
    chosen = parser.parse_args()
    sets = ["resolution=[320,180]", "render.spp=16"] if chosen.quick else ["resolution=[640,360]", "render.spp=64"]
    try:
        rows = [row for scene in SCENES[: 1 if chosen.quick else None] for row in compared(scene, sets)]
    except MirelightError as error:
        print(f"agree_with_cuda: {error}", file=sys.stderr)
        return 2
    print("scene      picture   mean difference  99.9 %     same bits twice  LLVM s   CUDA s   LLVM / CUDA")
    for row in rows:
        ratio = row.llvm_seconds / row.cuda_seconds
        print(
            f"{row.scene:10} {row.picture:8} {row.mean:16.1e} {row.worst:8.1e} {'yes' if row.same_twice else 'NO':>16}"
            f"{row.llvm_seconds:9.3f}{row.cuda_seconds:9.3f}{ratio:10.1f}"
        )
    if chosen.json is not None:
        chosen.json.write_text(json.dumps([asdict(row) for row in rows], indent=1), encoding="utf-8")
    return 1 if any(row.mean > MOST or not row.same_twice for row in rows) else 0


if __name__ == "__main__":
    sys.exit(main())
