"""How soon the studio shows a capture in its light: CPU seconds, all threads of its process together.

    python scripts/bench studio scenes/courtyard/job.toml

A job that has its proxy stands for one whose proxy is being made: what is done meanwhile is done first, or left out.
Kernels are compiled anew (as after an installation), or found where an earlier run has left them.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

from bench.common import Table, table

_MEASURE = "import sys; sys.path.insert(0, sys.argv[1]); from bench.studio import measure; measure(*sys.argv[2:])"


def options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("job", type=Path)


def run(chosen: argparse.Namespace) -> list[Table]:
    """A process for each row, as kernels stay in one."""
    rows = []
    with tempfile.TemporaryDirectory() as cache:
        for kernels in ("compiled", "found"):
            for waits in ("yes", "no"):
                if kernels == "compiled":
                    shutil.rmtree(cache)
                    Path(cache).mkdir()
                command = [sys.executable, "-c", _MEASURE, str(Path(__file__).parents[1]), str(chosen.job), waits]
                environment = {**os.environ, "DRJIT_CACHE_DIR": cache}
                said = subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout
                took = json.loads(said.splitlines()[-1])
                rows.append((kernels, waits, *(f"{x:.1f}" for x in took)))
    columns = ("kernels", "waits for its proxy", "opened", "meanwhile", "first whole lighting", "in all")
    return [table("First light in the studio", columns, rows)]


def measure(name: str, waits: str) -> None:
    """Print what the steps take, in JSON."""
    from mirelight.apps.studio import opened
    from mirelight.apps.studio.session import Session

    with tempfile.TemporaryDirectory() as folder:
        document = opened(name, Path(folder) / "job.studio.toml")
        document = replace(
            document, data={**document.data, "output": {"directory": folder}}
        )  # nothing is kept there yet
        session = Session(document, Path(folder))
        marks = [time.process_time()]
        if waits == "yes":
            session._lights.warm(session._scene)
        marks.append(time.process_time())
        session._phase, session._helping = "ready", True  # nothing finer is asked for
        while session._step():
            pass
        marks.append(time.process_time())
        assert session.state().layers
        session.run(lambda: True)
    steps = [marks[0], *(b - a for a, b in pairwise(marks)), marks[-1]]
    print(json.dumps(steps))
