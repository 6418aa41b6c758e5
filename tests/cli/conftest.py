"""The command line as a real process, on a scene that renders in a blink."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from tests import forked

from .ball import write_ball

Run = Callable[..., subprocess.CompletedProcess[str]]
COMMAND = [sys.executable, "-m", "mirelight"]

JOB = """\
splats = "splats.ply"
proxy = "proxy.glb"
resolution = [64, 48]

[[cameras]]
name = "front"
position = [0, 1, 6]
target = [0, 0, 0]

[[cameras]]
type = "turntable"
name = "orbit"
target = [0, 0, 0]
radius = 6
frames = 2

[[lightings]]
name = "day"
environment = { radiance = 1 }

[[lightings]]
name = "night"
lights_from = "proxy"

[render]
spp = 2
"""


@pytest.fixture(scope="session")
def assets(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A ball of splats over a floor with a lamp."""
    folder = tmp_path_factory.mktemp("assets")
    write_ball(folder)
    return folder


@pytest.fixture
def folder(assets: Path, tmp_path: Path) -> Path:
    """A folder of its own with the scene and job.toml: 3 cameras, 2 lightings, so 6 frames."""
    for file in assets.iterdir():
        (tmp_path / file.name).symlink_to(file)
    (tmp_path / "job.toml").write_text(JOB, encoding="utf-8")
    return tmp_path


@pytest.fixture
def run(tmp_path: Path, tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Runs `mirelight` in the test's folder; no command may end in a traceback."""
    aside = tmp_path_factory.mktemp("streams")

    def run(*arguments: str, timeout: float = 300) -> subprocess.CompletedProcess[str]:
        done = forked.run(arguments, tmp_path, aside, timeout)
        assert "Traceback" not in done.stderr, done.stderr
        return done

    return run


def environment(**extra: str) -> dict[str, str]:
    """This process's environment and more."""
    return {**os.environ, **extra}
