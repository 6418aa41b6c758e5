"""From a clone to pictures: what each step takes in a new folder, and how long commands take to answer.

python scripts/bench start
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from bench.common import Table, table

ROOT = Path(__file__).resolve().parents[2]
STEPS = (
    ("clone", ("git", "clone", "-q", "--depth", "1", ROOT.as_uri(), ".")),
    ("set-up: Python packages", ("bash", "-ec", ". scripts/lib/setup.sh; set_up requirements.lock")),
    ("`bash scripts/demo`: four frames and their sheet", ("bash", "scripts/demo")),
    ("`bash scripts/demo` again", ("bash", "scripts/demo")),
)
ANSWERS = (
    "--version",
    "--help",
    "render --help",
    "inspect scenes/stage/job.toml",
    "render scenes/stage/job.toml --dry-run",
)
REPEATS = 5


def options(parser: argparse.ArgumentParser) -> None:
    """It has none of its own."""


def run(chosen: argparse.Namespace) -> list[Table]:
    """The tables."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "clone"
        for made in (folder, folder.parent / "kernels"):
            made.mkdir()
        steps = [(what, f"{_spent(command, folder):.0f} s") for what, command in STEPS[: 1 if chosen.quick else None]]
    answers = []
    for words in ANSWERS:
        command = (sys.executable, "-m", "mirelight", *words.split())
        spent = [_spent(command, ROOT) for _ in range(1 if chosen.quick else REPEATS)]
        answers.append((f"`mirelight {words}`", f"{min(spent):.2f} s"))
    columns = ["", "CPU"]
    return [table("From a clone to pictures", columns, steps), table("Until a command answers", columns, answers)]


def _spent(command: Sequence[str], folder: Path) -> float:
    """CPU seconds of a command and of all that it starts; kernels that it compiles are kept beside its folder."""
    own = {**os.environ, "DRJIT_CACHE_DIR": str(folder.parent / "kernels")} if folder != ROOT else None
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, cwd=folder, env=own, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime
