"""Light on the surface among processes: gathered once, found by all, and the same bits however the work is cut."""

from __future__ import annotations

import subprocess
from pathlib import Path

from .conftest import COMMAND, Run
from .test_workers import same

SURFACE = ("--set", "render.indirect=surface", "--set", "render.max_depth=3")
FILL = "gathering the light of lighting "


def start(folder: Path, *more: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [*COMMAND, "render", "job.toml", *SURFACE, *more],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def test_two_processes_gather_light_once(folder: Path, run: Run) -> None:
    both = [start(folder, "--set", f"render.threads={threads}") for threads in (1, 2)]
    said = "".join(process.communicate(timeout=300)[1] for process in both)
    assert [process.returncode for process in both] == [0, 0], said
    assert said.count(FILL) == 2  # the sky and the lamp
    assert f"{FILL}day (1 of 2, 1 source) on " in said and f"{FILL}night (2 of 2, 1 source) on " in said

    found = run("render", "job.toml", *SURFACE, "--set", "render.spp=4")
    assert found.returncode == 0 and FILL not in found.stderr and "0 of them" not in found.stdout

    alone = run("render", "job.toml", *SURFACE, "--camera", "orbit", "--lighting", "night", "--out", "alone")
    assert alone.returncode == 0 and alone.stderr.count(FILL) == 1
    every = run("render", "job.toml", *SURFACE, "--workers", "2", "--out", "every")
    assert every.returncode == 0 and 1 <= every.stderr.count(FILL) <= 2  # the same words of both workers are said once
    for path in folder.joinpath("every").glob("[!.]*.*"):
        if "orbit" not in path.name or "night" not in path.name:
            path.unlink()
    same(folder / "alone", folder / "every")
