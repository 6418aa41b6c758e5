"""Worker processes: the same bits as one process, killed at any moment, and frames that cannot be made."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from mirelight.io.exr import read_exr
from mirelight.store.claims import Claims

from .conftest import COMMAND, Run, environment
from .said import said_until
from .test_store import left_over

TURN = ("--set", "cameras[1].frames=8", "--camera", "orbit")  # 8 cameras under 2 lightings


def start(folder: Path, *more: str, **extra: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [*COMMAND, "render", "job.toml", *TURN, "--workers", "2", *more],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment(**extra),
    )


def children(process: int) -> list[int]:
    """Numbers of the worker processes of a render."""
    found = []
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            parent = int(entry.joinpath("stat").read_text().rpartition(")")[2].split()[1])
            command = entry.joinpath("cmdline").read_bytes()
        except (OSError, ValueError):
            continue
        if parent == process and b"mirelight.batch.worker" in command:
            found.append(int(entry.name))
    return found


def same(ours: Path, theirs: Path) -> None:
    """Every frame of one folder is in the other, to the bit."""
    names = [{x.name for x in folder.glob("[!.]*.*")} for folder in (ours, theirs)]
    assert names[0] == names[1] and names[0]
    for name in names[0]:
        if name.endswith(".png"):
            assert (ours / name).read_bytes() == (theirs / name).read_bytes(), name
        else:
            one, other = (read_exr(folder / name).channels for folder in (ours, theirs))
            assert one.keys() == other.keys() and all(np.array_equal(one[x], other[x], equal_nan=True) for x in one)


@pytest.fixture
def whole(folder: Path, run: Run) -> Path:
    """The frames of an undisturbed run of one process."""
    done = run("render", "job.toml", *TURN, "--out", "whole")
    assert done.returncode == 0, done.stderr
    return folder / "whole"


def test_killed_workers_and_parents_lose_nothing() -> None:
    """Three runs, one for each victim; `kill_runs.py` does thirty."""
    command = [sys.executable, "-m", "tests.cli.kill_runs", "--runs", "3"]
    root = Path(__file__).resolve().parents[2]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=root)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "3 runs of 24 frames" in done.stdout and "0 files with other bits" in done.stdout


FAULT = """\
import os, signal, sys
if "mirelight" in " ".join(sys.orig_argv):
    import mirelight.pipeline.stages as stages
    composite = stages.composite
    def faulty(scene, camera):
        if camera.name == "orbit.0002":
            os.kill(os.getpid(), signal.SIGKILL)
        if camera.name == "orbit.0005":
            raise ValueError("no such view")
        return composite(scene, camera)
    stages.composite = faulty
"""


def test_what_cannot_be_made_is_recorded_and_the_rest_goes_on(folder: Path, run: Run) -> None:
    (folder / "faults").mkdir()
    (folder / "faults" / "sitecustomize.py").write_text(FAULT, encoding="utf-8")
    path = os.pathsep.join([str(folder / "faults"), *sys.path])
    process = start(folder, PYTHONPATH=path)
    out, err = process.communicate(timeout=300)
    assert process.returncode == 2 and out.startswith("12 frames in out"), err
    assert "orbit.0005.day: failed twice: ValueError: no such view" in err
    assert "orbit.0002.night: failed twice: its worker process ended 2 times (by SIGKILL)" in err
    assert "4 frames failed; the others are there" in err and "Traceback" not in err
    entries = [
        json.loads(line)
        for file in (folder / "out" / ".mirelight" / "journal").glob("*.jsonl")
        for line in file.read_text().splitlines()
    ]
    failed = {x["frame"] for x in entries if x.get("error")}
    assert failed == {f"orbit.000{i}.{light}" for i in (2, 5) for light in ("day", "night")}
    done = run("render", "job.toml", *TURN, "--workers", "2")  # the fault is mended
    assert done.returncode == 0 and "12 of them already there" in done.stdout
    assert not left_over(folder / "out")


def test_idle_workers_that_are_killed_are_replaced(folder: Path) -> None:
    """All that is left is another process's, and given up once the workers are dead."""
    claims = folder / "out" / ".mirelight" / "claims"
    claims.mkdir(parents=True)
    other = Claims(claims)
    with other.claim("front.day") as mine:
        process = subprocess.Popen(
            [*COMMAND, "render", "job.toml", "--camera", "front", "--workers", "2", "--set", "render.spp=1"],
            cwd=folder,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        assert mine
        said = said_until(process, "waiting for 1 camera ")
        for worker in children(process.pid):
            os.kill(worker, signal.SIGKILL)
    out, err = process.communicate(timeout=120)
    assert process.returncode == 0 and out.startswith("2 frames in out"), said + err
    assert len(list((folder / "out").glob("front.*.exr"))) == 2 and not left_over(folder / "out")


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_signals_end_all(folder: Path, number: signal.Signals, code: int) -> None:
    process = start(folder)
    said_until(process, "made in")
    workers = children(process.pid)
    process.send_signal(number)
    _, err = process.communicate(timeout=120)
    assert process.returncode == code and "Traceback" not in err
    assert "interrupted; " in err and "the same command goes on from there" in err
    assert workers and not any(Path(f"/proc/{worker}").exists() for worker in workers)
    assert not left_over(folder / "out")


def test_shards_are_parts_of_the_whole(folder: Path, run: Run, whole: Path) -> None:
    for part in ("1/3", "2/3", "3/3"):
        done = run("render", "job.toml", *TURN, "--out", "parts", "--shard", part)
        assert done.returncode == 0 and "already there" not in done.stdout, done.stderr
    same(whole, folder / "parts")
    refused = run("render", "job.toml", "--shard", "4/3")
    assert refused.returncode == 2 and "write 1/8" in refused.stderr


@pytest.mark.parametrize("option", ["0", "x", "-1"])
def test_workers_are_counted(run: Run, folder: Path, option: str) -> None:
    done = run("render", "job.toml", f"--workers={option}")
    assert done.returncode == 2 and "give a whole number from 1 on" in done.stderr
