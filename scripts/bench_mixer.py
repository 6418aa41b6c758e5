"""What a moved light costs on the mixer's page: CPU seconds until its first light, and for each later stage.

    python scripts/bench_mixer.py scenes/courtyard/job.toml   # first light: 0.9 s of CPU at 251,046 splats

The page's own layers are not traced: what a move costs does not depend on them.
"""

from __future__ import annotations

import argparse
import resource
import time
from pathlib import Path

import numpy as np

from mirelight.apps import mixer as mixing
from mirelight.apps.mixer import rgb9e5
from mirelight.apps.mixer.session import STAGES, Session
from mirelight.io import job as jobs
from mirelight.model import F32
from mirelight.model.lights import position_of
from mirelight.model.unit_lights import terms
from mirelight.pipeline.scene import prepare
from mirelight.store import Store


def cpu() -> float:
    """Seconds of this process, all threads."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


class Timed(Session):
    """Notes what each stage takes, and how far it is from the last."""

    light: dict[int, F32]

    def _trace(self, layer: int) -> None:
        stage, began, used = self._wanted[layer], time.monotonic(), cpu()
        super()._trace(layer)
        took = f"{cpu() - used:6.2f} s of CPU, {time.monotonic() - began:6.2f} s"
        made = self.state().layers[layer]
        light = rgb9e5.decode(np.frombuffer(made.packed, "<u4")) * np.float32(made.scale)
        print(f"{STAGES[stage]:4} samples: {took}, mean {light.mean():.5f}", flush=True)
        self.light = {**getattr(self, "light", {}), stage: light}
        if stage == len(STAGES) - 1:
            for earlier in range(stage):
                off = np.abs(self.light[earlier] - light).mean() / light.mean()
                print(f"     {STAGES[earlier]} samples differ from these by {off:.1%} of the mean", flush=True)


def main() -> None:
    """Move the first light that has a place: once to compile, then three times."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("job", type=Path)
    parser.add_argument("--moves", type=int, default=3)
    parser.add_argument("--first", action="store_true", help="the first stage alone")
    args = parser.parse_args()
    job = jobs.load(args.job)
    store = Store(job)
    store.open()
    try:
        scene = prepare(job, store.artefacts)
        assert scene.splats is not None
        names, units = [], []
        for term in (t for x in job.lightings for t in terms(x)):
            if any(position_of(light) is not None for light in term.unit.lights):
                names.append(term.layer)
                units.append(term.unit)
        blank = np.zeros((1, len(scene.splats), 3), np.float32)
        made = mixing.MixLayers(
            names=tuple(names),
            values=blank,
            constant=(),
            lightings=(),
            limit=None,
            near=1.0,
            units=tuple(units),
            layer_of=lambda light: light,
        )
        session = Timed(scene, made, STAGES[:1] if args.first else STAGES)
        where = position_of(units[0].lights[0])
        assert where is not None
        for k in range(args.moves + 1):
            print(f"{names[0]}, {len(scene.splats)} splats, {'first' if k == 0 else 'warm'}:", flush=True)
            session.move(0, 0, where + 0.05 * k)
            session.run(lambda: True)
    finally:
        store.close()


if __name__ == "__main__":
    main()
