"""A Dask scheduler: workers that die, a camera that kills them, a scheduler that goes; always one line, and all frames
there in the end, to the bit."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from .conftest import COMMAND, JOB, Run, environment
from .said import said_until
from .test_store import left_over, rows
from .test_workers import same

ORBIT = ("--set", "cameras[1].frames=6", "--camera", "orbit", "--set", "render.spp=1")  # under 2 lightings
FAULT = """\
import os, signal, sys
if "dask_worker" in " ".join(sys.orig_argv) or "multiprocessing" in " ".join(sys.orig_argv):
    import mirelight.pipeline.stages as stages
    composite = stages.composite
    def faulty(scene, camera):
        if camera.name == "poison":
            os.kill(os.getpid(), signal.SIGKILL)
        return composite(scene, camera)
    stages.composite = faulty
"""


class Cluster:
    """A scheduler and two workers as processes of their own, whose nannies replace a dead one."""

    def __init__(self, folder: Path) -> None:
        self.file = folder / "scheduler.json"
        (folder / "sitecustomize.py").write_text(FAULT, encoding="utf-8")
        paths = [str(folder), os.environ.get("PYTHONPATH", ""), str(Path(__file__).parents[2])]
        env = environment(PYTHONPATH=os.pathsep.join(x for x in paths if x), DASK_DISTRIBUTED__ADMIN__TICK__LIMIT="1h")
        common = ["--scheduler-file", str(self.file), "--no-dashboard"]
        self.scheduler = self._start("dask_scheduler", env, *common, "--port", "0", "--host", "127.0.0.1")
        self.workers = self._start(
            "dask_worker", env, *common, "--nworkers", "2", "--nthreads", "1", "--memory-limit", "0"
        )

    @staticmethod
    def _start(module: str, env: dict[str, str], *arguments: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", f"distributed.cli.{module}", *arguments]
        return subprocess.Popen(command, env=env, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    @property
    def address(self) -> str:
        until = time.monotonic() + 60
        while time.monotonic() < until:
            try:
                return str(json.loads(self.file.read_text())["address"])
            except (OSError, ValueError):
                time.sleep(0.1)
        raise AssertionError("no scheduler came up")

    def processes(self) -> list[int]:
        """Numbers of the worker processes."""
        from distributed import Client

        with Client(self.address, set_as_default=False, timeout=20) as client:
            client.wait_for_workers(2, timeout=60)
            found: dict[str, Any] = client.run(os.getpid)
        return list(found.values())

    def close(self) -> None:
        for process in (self.workers, self.scheduler):
            process.terminate()
        for process in (self.workers, self.scheduler):
            try:
                process.wait(timeout=20)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    cluster = Cluster(tmp_path_factory.mktemp("cluster"))
    yield cluster
    cluster.close()


def render(folder: Path, cluster: Cluster, *more: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [*COMMAND, "render", "job.toml", "--scheduler", cluster.address, *more],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def test_a_worker_dies_and_all_is_there(folder: Path, run: Run, cluster: Cluster) -> None:
    doomed = cluster.processes()[0]
    process = render(folder, cluster, *ORBIT, "--out", "parts")
    before = said_until(process, "made in")
    os.kill(doomed, signal.SIGKILL)
    out, err = process.communicate(timeout=240)
    assert process.returncode == 0 and out.startswith("12 frames in parts"), before + err
    assert "[12/12]" in err and "Traceback" not in err
    assert not left_over(folder / "parts")
    made = rows(folder / "parts")
    names = {f"orbit.{i:04}.{light}" for i in range(1, 7) for light in ("day", "night")}
    assert {path.stem for path in (folder / "parts").glob("*.exr")} == names
    assert set(made) <= names and len(set(made)) >= 11  # killed between files and line: known by the files
    assert len(made) - len(set(made)) <= 2  # written twice: what was in flight
    assert run("render", "job.toml", *ORBIT, "--out", "whole").returncode == 0
    same(folder / "whole", folder / "parts")
    again = run("render", "job.toml", *ORBIT, "--out", "parts", "--scheduler", cluster.address)
    assert "12 of them already there" in again.stdout


def test_a_camera_that_kills_workers_is_recorded(folder: Path, cluster: Cluster) -> None:
    (folder / "job.toml").write_text(JOB.replace('"front"', '"poison"'), encoding="utf-8")
    process = render(folder, cluster, "--set", "render.spp=1")
    out, err = process.communicate(timeout=240)
    assert process.returncode == 2 and out.startswith("4 frames in out"), err
    assert "poison.day: failed twice: its worker process ended again and again" in err
    assert "2 frames failed; the others are there" in err and "Traceback" not in err


def test_ctrl_c_ends_the_workers_part_too(folder: Path, run: Run, cluster: Cluster) -> None:
    process = render(folder, cluster, *ORBIT)
    said_until(process, "made in")
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=120)
    assert process.returncode == 130 and "the same command goes on from there" in err

    def unfinished() -> list[str]:
        return [x for x in left_over(folder / "out") if "ballast" not in x]

    end = time.monotonic() + 120
    while unfinished() and time.monotonic() < end:  # what a worker is in the middle of
        time.sleep(0.1)
    assert not unfinished()
    made = rows(folder / "out")
    time.sleep(1.0)
    assert rows(folder / "out") == made  # nobody goes on


def test_a_scheduler_that_goes_is_said_in_a_line(folder: Path, run: Run, cluster: Cluster) -> None:
    process = render(folder, cluster, *ORBIT)
    said_until(process, "made in")
    cluster.scheduler.kill()
    _, err = process.communicate(timeout=120)
    assert process.returncode == 2 and "Traceback" not in err
    assert err.strip().splitlines()[-1].startswith("mirelight: job.toml: the Dask scheduler at tcp://127.0.0.1:")
    assert "the same command goes on once a scheduler runs" in err
    cluster.workers.wait(timeout=60)  # they end by themselves
    done = run("render", "job.toml", *ORBIT)
    assert done.returncode == 0 and "of them already there" in done.stdout
    away = "cameras[0].target=[0, 1, 60]"  # what cameras are of no use is said before any worker is asked
    nobody = run("render", "job.toml", "--scheduler", cluster.address, "--out", "other", "--set", away)
    said, last = nobody.stderr.strip().splitlines()
    assert nobody.returncode == 2
    assert "front" in said and "nothing of the proxy" in said and "no Dask scheduler answers there" in last


@pytest.mark.parametrize("kind", ["silent", "other", "name", "file", "empty"])
def test_what_is_no_scheduler_is_said_in_a_line(folder: Path, run: Run, kind: str) -> None:
    """What listens and says nothing, or something else than Dask; addresses and files that are none."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = f"tcp://127.0.0.1:{server.getsockname()[1]}"
        if kind == "other":
            threading.Thread(target=lambda: server.accept()[0].sendall(b"HTTP/1.1 200 OK" * 99), daemon=True).start()
        (folder / "s.json").write_text("[" if kind == "file" else "{}")
        where = {"name": "ftp://[", "file": "s.json", "empty": "s.json"}.get(kind, address)
        done = run("render", "job.toml", "--scheduler", where, timeout=60)
    assert done.returncode == 2
    (line,) = done.stderr.strip().splitlines()
    assert line.startswith(f"mirelight: --scheduler {where}: no Dask scheduler answers there")


def test_without_the_extra_nothing_is_begun(folder: Path, run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    (folder / "distributed.py").write_text('raise ImportError("none")\n')  # the current folder comes first
    done = run("render", "job.toml", "--scheduler", "tcp://127.0.0.1:1")
    assert done.returncode == 2 and "pip install 'mirelight[dask]'" in done.stderr
    assert not (folder / "out").exists()
    done = run("render", "job.toml", "--scheduler", "tcp://127.0.0.1:1", "--workers", "2")
    assert done.returncode == 2 and "--workers: given together with --scheduler" in done.stderr
