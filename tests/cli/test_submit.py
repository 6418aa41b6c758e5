"""Scripts for batch systems: checked by their own tools, and run where that needs no cluster."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from .conftest import COMMAND, Run, environment


def commands(folder: Path) -> dict[str, str]:
    """An environment whose PATH has this very mirelight and the tools beside this Python."""
    tools = folder / "tools"
    tools.mkdir()
    script = tools / "mirelight"
    script.write_text(f'#!/bin/sh\nexec {" ".join(COMMAND)} "$@"\n', encoding="utf-8")
    script.chmod(0o755)
    beside = str(Path(sys.executable).parent)
    return environment(PATH=os.pathsep.join([str(tools), beside, os.environ["PATH"]]))


def test_a_slurm_array_renders_all(folder: Path, run: Run) -> None:
    made = run("submit", "job.toml", "--slurm", "--shards", "2", "--set", "render.spp=1", "-o", "batch.sh")
    assert made.returncode == 0, made.stderr
    subprocess.run(["bash", "-n", "batch.sh"], cwd=folder, check=True)
    env = commands(folder)
    for task in ("1", "2"):
        tried = {**env, "SLURM_ARRAY_TASK_ID": task, "SLURM_CPUS_PER_TASK": "1"}
        subprocess.run(["bash", str(folder / "batch.sh")], cwd="/", env=tried, check=True, capture_output=True)
    assert len(list((folder / "out").glob("*.png"))) == 6


def test_an_openjd_template_is_sound_and_runs(folder: Path, run: Run) -> None:
    made = run("submit", "job.toml", "--openjd", "--shards", "2", "--camera", "orbit", "--set", "render.spp=1")
    assert made.returncode == 0, made.stderr
    (folder / "batch.json").write_text(made.stdout, encoding="utf-8")
    env = commands(folder)
    for command in (["check", "batch.json"], ["run", "batch.json", "--step", "render"]):
        done = subprocess.run(["openjd", *command], cwd=folder, env=env, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
    assert len(list((folder / "out").glob("*.png"))) == 4


def test_mistakes_are_said_before_anything_is_submitted(run: Run, folder: Path) -> None:
    assert "no camera named 'back'" in run("submit", "job.toml", "--slurm", "--camera", "back").stderr
    assert "--slurm" in run("submit", "job.toml").stderr
