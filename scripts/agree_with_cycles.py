"""Do Blender Cycles and this tracer show the same light? Means of blocks over independent seeds, by z-test.

    python scripts/agree_with_cycles.py PYTHON     # an interpreter with the bpy package; four minutes of CPU

Exits 1 where a block of a benchmark scene differs by more than both renderers' noise explains (Welch's t, Šidák's
correction over all blocks and channels, one false alarm in 10,000).
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from bench_lighting import Cycles, ours
from bench_lighting_scenes import scenes

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from tests.statistical.ztest import worst_and_allowed

WIDTH, HEIGHT, CELLS, SPP, SEEDS, BLOCK = 160, 90, 160, 64, 12, 15


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("python", help="a Python interpreter with the bpy package")
    blender = parser.parse_args().python
    apart = 0
    for scene in scenes(WIDTH, HEIGHT, CELLS):
        cycles, tracer = Cycles(blender, scene), ours(scene)
        pairs = [(tracer(SPP, seed)[0], cycles(SPP, seed)[0]) for seed in range(1, SEEDS + 1)]
        cycles.close()
        a, b = (np.stack(pictures).astype(np.float64) for pictures in zip(*pairs, strict=True))
        worst, allowed = worst_and_allowed(a, b, block=BLOCK)
        apart += worst > allowed
        print(
            f"{scene.name:10} mean of ours / Cycles {a.mean() / b.mean():.4f}, |t| up to {worst:.1f} of {allowed:.1f}"
        )
    return 1 if apart else 0


if __name__ == "__main__":
    sys.exit(main())
