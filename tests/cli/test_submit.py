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


SBATCH = """\
#!/bin/bash
# Runs the tasks of an array one after the other, as a cluster with one node would.
script="${@: -1}"
last=$(sed -n 's/^#SBATCH --array=1-//p' "$script")
for task in $(seq "$last"); do
    SLURM_ARRAY_TASK_ID=$task SLURM_CPUS_PER_TASK=1 bash "$script" || echo "task $task failed"
done
"""
PAGE = Path(__file__).parents[2] / "docs" / "guides" / "farm.md"


def test_the_page_on_slurm_does_what_it_says(folder: Path, run: Run) -> None:
    """Its commands to the letter but for 100 tasks; a task that is lost is made up for by the same command."""
    part = PAGE.read_text(encoding="utf-8").partition("## 10,000 frames on Slurm")[2].partition("\n## ")[0]
    lines = [line.strip() for line in part.splitlines() if line.startswith("    ")]
    submit, sbatch = next(x for x in lines if "--slurm" in x), next(x for x in lines if x.startswith("sbatch"))
    (folder / "job.toml").rename(folder / "film.toml")
    env = commands(folder)
    (folder / "tools" / "sbatch").write_text(SBATCH, encoding="utf-8")
    (folder / "tools" / "sbatch").chmod(0o755)
    for command in (submit.replace("--shards 100", "--shards 3"), "bash -n film.sh"):
        subprocess.run(["bash", "-c", command], cwd=folder, env=env, check=True)
    script = folder / "film.sh"
    whole = script.read_text()
    assert "#SBATCH --array=1-3\n" in whole and "--threads=$SLURM_CPUS_PER_TASK" in whole
    script.write_text(whole.replace("set -e", 'set -e; [ "$SLURM_ARRAY_TASK_ID" != 2 ]'))  # a node that fails
    first = subprocess.run(["bash", "-c", sbatch], cwd=folder, env=env, check=True, capture_output=True, text=True)
    assert "task 2 failed" in first.stdout and "4 frames in" not in first.stdout
    assert run("status", "out").stdout.startswith("out: 4 of 6 frames there, 2 missing\n")
    script.write_text(whole)
    again = subprocess.run(["bash", "-c", sbatch], cwd=folder, env=env, check=True, capture_output=True, text=True)
    assert again.stdout.count("2 of them already there") == 2
    assert run("status", "out").returncode == 0


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
    before = (folder / "job.toml").read_text(encoding="utf-8")
    made = run("submit", "job.toml", "--slurm", "-o", "job.toml")
    assert made.returncode == 2
    assert "job.toml: it is read here" in made.stderr
    assert (folder / "job.toml").read_text(encoding="utf-8") == before
