"""What a moved light costs on the mixer's page: CPU seconds until its first light, and for each later stage.

    python scripts/bench mixer scenes/courtyard/job.toml

The page's own layers are not traced: what a move costs does not depend on them.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from bench.common import Table, table, timed
from mirelight.apps import mixer as mixing
from mirelight.apps.mixer import rgb9e5
from mirelight.apps.mixer.first_light import STAGES
from mirelight.apps.mixer.session import Session
from mirelight.io import job as jobs
from mirelight.model import F32
from mirelight.model.unit_lights import terms
from mirelight.pipeline.scene import prepare
from mirelight.store import Store


class Noting(Session):
    """Notes what each stage takes, and its light."""

    light: dict[int, F32]
    cpu: dict[int, float]

    def _trace(self, layer: int) -> None:
        stage = self._wanted[layer]
        _, spent = timed(lambda: Session._trace(self, layer))
        made = self.state().layers[layer]
        light = rgb9e5.decode(np.frombuffer(made.packed, "<u4")) * np.float32(made.scale)
        self.light = {**getattr(self, "light", {}), stage: light}
        self.cpu = {**getattr(self, "cpu", {}), stage: spent}


def options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("job", type=Path)
    parser.add_argument("--moves", type=int, default=3)
    parser.add_argument("--first", action="store_true", help="the first stage alone")


def run(chosen: argparse.Namespace) -> list[Table]:
    """Move the first light that has a place: once to compile, then some times."""
    job = jobs.load(chosen.job)
    store = Store(job)
    store.open()
    try:
        scene = prepare(job, store.artefacts)
        assert scene.splats is not None
        placed = [
            term
            for term in (t for x in job.lightings for t in terms(x))
            if any(light.place is not None for light in term.unit.lights)
        ]
        made = mixing.MixLayers(
            names=tuple(term.layer for term in placed),
            values=np.zeros((1, len(scene.splats), 3), np.float32),
            constant=(),
            lightings=(),
            limit=None,
            near=1.0,
            units=tuple(term.unit for term in placed),
            layer_of=lambda light: light,
        )
        stages = STAGES[:1] if chosen.first or chosen.quick else STAGES
        session = Noting(scene, made, stages)
        where = placed[0].unit.lights[0].place
        assert where is not None
        rows = []
        for move in range(1 + (1 if chosen.quick else chosen.moves)):
            session.move(0, 0, where + 0.05 * move)
            session.run(lambda: True)
            last = session.light[len(stages) - 1]
            for stage, count in enumerate(stages):
                off = float(np.abs(session.light[stage] - last).mean() / last.mean())
                rows.append((move or "first", str(count), f"{session.cpu[stage]:.2f}", f"{off:.1%}"))
    finally:
        store.close()
    return [table("A moved light, measured", ("move", "samples", "CPU s", "differs from the last stage by"), rows)]
