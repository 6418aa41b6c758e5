"""The command line as a real process, on a scene that renders in a blink."""

from __future__ import annotations

import multiprocessing
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from mirelight.cli import main
from tests.threads import share_cores

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
        streams = aside / "stdout", aside / "stderr"
        process = _SERVER.Process(target=_main, args=(arguments, tmp_path, dict(os.environ), *streams))
        process.start()
        process.join(timeout)
        if process.exitcode is None:
            process.kill()
            raise subprocess.TimeoutExpired(arguments, timeout)
        out, err = (x.read_text(encoding="utf-8") for x in streams)
        assert "Traceback" not in err, err
        return subprocess.CompletedProcess(arguments, process.exitcode, out, err)

    return run


# Half of what a small command takes is the import of its modules: processes are forked from one that has them.
_SERVER = multiprocessing.get_context("forkserver")
_SERVER.set_forkserver_preload(["mirelight.cli.render", "mirelight.pipeline.scene", "mirelight.pipeline.stages"])


def _main(arguments: tuple[str, ...], folder: Path, variables: dict[str, str], out: Path, err: Path) -> None:
    """The command in a process of its own, as `python -m mirelight` runs it."""
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(variables)
    for number, path, flags in (
        (0, os.devnull, os.O_RDONLY),
        (1, out, os.O_CREAT | os.O_WRONLY | os.O_TRUNC),
        (2, err, os.O_CREAT | os.O_WRONLY | os.O_TRUNC),
    ):
        os.dup2(os.open(path, flags), number)
    sys.path.insert(0, str(folder))
    share_cores(pytest.MonkeyPatch())
    sys.exit(main(arguments))


def environment(**extra: str) -> dict[str, str]:
    """This process's environment and more."""
    return {**os.environ, **extra}
