"""What takes work away: power loss between any two writes, a full disk, two machines with clocks of their own."""

from __future__ import annotations

import errno
import json
import os
import resource
import signal
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mirelight.base.errors import OutputError
from mirelight.io import image
from mirelight.io.atomic import output_error
from mirelight.model import Camera, Frame, Job, OutputSettings, Provenance
from mirelight.pipeline.plan import FrameTask
from mirelight.store import Store
from mirelight.store.claims import Claims
from mirelight.store.index import Index
from mirelight.store.journal import Journal

from .conftest import COMMAND, Run, environment
from .said import said_until
from .test_store import left_over, rows

CAMERA = Camera.look_at((0, 0, 3), (0, 0, 0), 8, 6, name="front")


def job(folder: Path) -> Job:
    return Job(source=Path("job.toml"), splats=None, cameras=(CAMERA,), output=OutputSettings(directory=folder))


def task(name: str) -> FrameTask:
    return FrameTask(camera=CAMERA, lighting=None, name=name, files={".exr": f"e{name}", ".png": f"p{name}"})


def frame(seed: int) -> Frame:
    rgba = np.random.default_rng(seed).random((6, 8, 4)).astype(np.float32)
    made_by = Provenance(mirelight="0", fingerprint="x")
    return Frame(camera=CAMERA, rgba=rgba, unlit=None, factor=None, lighting=None, splats=None, made_by=made_by)


# --- power loss ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Step:
    """What the system was asked for: sync, rename or append."""

    kind: str
    path: Path
    data: bytes = b""
    mtime: int = 0


@pytest.fixture
def steps(monkeypatch: pytest.MonkeyPatch) -> list[Step]:
    """Every step of writing, in order."""
    seen: list[Step] = []
    fsync, replace, write = os.fsync, os.replace, os.write

    def named(handle: int) -> Path:
        return Path(f"/proc/self/fd/{handle}").readlink()

    def synced(handle: int) -> None:
        fsync(handle)
        seen.append(Step("sync", named(handle)))

    def replaced(source: Any, target: Any) -> None:
        replace(source, target)
        path = Path(target)
        seen.append(Step("rename", path, path.read_bytes(), path.stat().st_mtime_ns))
        # what was synced under the temporary name
        seen[:] = [Step(x.kind, path) if x == Step("sync", Path(source)) else x for x in seen]

    def written(handle: int, data: bytes) -> int:
        if named(handle).suffix == ".jsonl":
            seen.append(Step("append", named(handle), data))
        return write(handle, data)

    monkeypatch.setattr(os, "fsync", synced)
    monkeypatch.setattr(os, "replace", replaced)
    monkeypatch.setattr(os, "write", written)
    return seen


def survived(steps: list[Step], folder: Path, kind: str) -> None:
    """A folder after the power went behind these steps. What was not synced is there, gone, or of the right size and
    empty, as file systems have it."""
    (folder / "journal").mkdir(parents=True)
    for i, step in enumerate(steps):
        after = [x.path for x in steps[i:] if x.kind == "sync"]
        safe = step.path.parent in after if step.kind == "rename" else step.path in after
        before = [x.path for x in steps[:i] if x.kind == "sync"]
        data = step.data
        if step.kind == "rename" and step.path not in before and kind != "there":
            data = bytes(len(data))
        if step.kind == "sync" or (not safe and kind == "gone"):
            continue
        if step.kind == "append":
            torn = data if safe or kind == "there" else data[: len(data) // 2]
            with (folder / "journal" / step.path.name).open("ab") as file:
                file.write(torn)
        else:
            (folder / step.path.name).write_bytes(data)
            os.utime(folder / step.path.name, ns=(step.mtime, step.mtime))


def test_power_loss_between_any_two_writes(tmp_path: Path, steps: list[Step]) -> None:
    """What counts as there afterwards is there, whole; and the order of steps is what makes it so."""
    store = Store(job(tmp_path / "out"))
    store.open()
    steps.clear()
    tasks = [task("a"), task("b")]
    for i, one in enumerate(tasks):
        store.put(one, frame(i))
    recorded = list(steps)
    store.close()
    good = {path.name: path.read_bytes() for path in (tmp_path / "out").glob("[ab].*")}
    assert len(good) == 4

    for one in tasks:
        renames = [i for i, x in enumerate(recorded) if x.kind == "rename" and x.path.stem == one.name]
        (line,) = (i for i, x in enumerate(recorded) if x.kind == "append" and json.loads(x.data)["frame"] == one.name)
        assert len(renames) == 2
        assert all(Step("sync", recorded[i].path) in recorded[:i] for i in renames)
        assert Step("sync", tmp_path / "out") in recorded[renames[-1] : line]
        assert Step("sync", recorded[line].path) in recorded[line:]

    for count in range(len(recorded) + 1):
        for kind in ("there", "gone", "empty"):
            folder = tmp_path / f"{count}-{kind}"
            survived(recorded[:count], folder, kind)
            index = Index(folder, Journal(folder / "journal").rows())
            for one in tasks:
                if index.has(one):
                    assert all((folder / f"{one.name}{x}").read_bytes() == good[f"{one.name}{x}"] for x in one.files)
            if count == len(recorded):
                assert all(index.has(one) for one in tasks)


# --- a full disk -----------------------------------------------------------------------------------------------------


class Disk:
    """A disk of so many bytes for everything in a folder."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.folder, self.room = folder, 1 << 40
        write, append = image.write, os.write

        def written(picture: Frame, path: Path, *rest: Any) -> None:
            write(picture, path, *rest)
            if self.used() > self.room:
                path.unlink()
                raise output_error(path, OSError(errno.ENOSPC, "No space left on device"))

        def appended(handle: int, data: bytes) -> int:
            if self.used() + len(data) > self.room:
                raise OSError(errno.ENOSPC, "No space left on device")
            return append(handle, data)

        monkeypatch.setattr(image, "write", written)
        monkeypatch.setattr(os, "write", appended)

    def used(self) -> int:
        return sum(path.stat().st_size for path in self.folder.rglob("*") if path.is_file())


def test_a_full_disk_leaves_room_to_say_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = tmp_path / "out"
    disk = Disk(out, monkeypatch)
    store = Store(job(out))
    store.open()
    assert disk.used() >= 16 * 2**20
    store.put(task("a"), frame(0))
    disk.room = disk.used() + 100  # not enough for another frame, nor for a line in the journal
    with pytest.raises(OutputError, match="the disk is full"):
        store.put(task("b"), frame(1))
    last = list(store.rows())[-1]
    assert last.frame == "b" and "the disk is full" in last.error and last.wanted == task("b").files
    assert sorted(path.name for path in out.glob("[ab].*")) == ["a.exr", "a.png"]
    store.close()
    assert disk.used() < 2**20  # the ballast is gone
    disk.room = 1 << 40
    store = Store(job(out))
    store.open()
    assert store.has(task("a")) and not store.has(task("b"))
    store.put(task("b"), frame(1))
    assert store.has(task("b"))
    store.close()


def test_a_claim_that_a_full_disk_does_not_take(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    Disk(tmp_path, monkeypatch).room = 0
    with pytest.raises(OutputError, match="the disk is full"), Claims(tmp_path).claim("front"):
        pass
    assert list(tmp_path.iterdir()) == []


def test_workers_that_meet_a_full_disk_all_end(folder: Path) -> None:
    """A limit on the size of files stands in for it: pictures are over it, lines of the journal are not."""
    done = subprocess.run(
        [*COMMAND, "render", "job.toml", "--workers", "2"],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        env=environment(PYTHONDONTWRITEBYTECODE="1"),  # which Python would cut off, and fail by ever after
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000)),
    )
    assert done.returncode == 2 and "Traceback" not in done.stderr
    last = done.stderr.strip().splitlines()[-1]
    assert ".exr: cannot be written" in last and "File too large" in last
    assert not left_over(folder / "out") and not list((folder / "out").glob("*.exr"))


# --- two machines ----------------------------------------------------------------------------------------------------

ELSEWHERE = """\
import os, platform, time
host = os.environ.get("PRETENDED_HOST")
if host:
    name, clock = host.split()
    platform.node = lambda: name
    true = time.time
    time.time = lambda: true() + float(clock)
"""


def test_two_machines_share_a_folder(folder: Path, run: Run) -> None:
    """One of them, whose clock is two hours behind, dies; the other, two hours ahead, waits for a sign of life of the
    camera that it was at, and then takes it over."""
    (folder / "elsewhere").mkdir()
    (folder / "elsewhere" / "sitecustomize.py").write_text(ELSEWHERE, encoding="utf-8")
    path = os.pathsep.join([str(folder / "elsewhere"), *sys.path])

    def start(host: str) -> subprocess.Popen[str]:
        return subprocess.Popen(
            [*COMMAND, "render", "job.toml", "--set", "cameras[1].frames=5", "--set", "render.spp=1"],
            cwd=folder,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            env=environment(PRETENDED_HOST=host, PYTHONPATH=path),
        )

    one = start("hal -7200")
    said_until(one, "made in")
    one.send_signal(signal.SIGSTOP)  # in the middle of a camera
    claims = list((folder / "out" / ".mirelight" / "claims").iterdir())
    other = start("eve 7200")
    said = said_until(other, "waiting for 1 camera that other processes render")
    one.kill()
    one.communicate()
    status = json.loads(run("status", "out", "--json").stdout)
    (flight,) = status["in_flight"]
    assert flight["host"] == "hal" and flight["seconds"] < 600 and status["there"] >= 10
    old = claims[0].stat().st_mtime - 700
    os.utime(claims[0], (old, old))
    _, rest = other.communicate(timeout=120)
    assert other.returncode == 0 and "Traceback" not in said + rest
    made = rows(folder / "out")
    assert len(set(made)) == 12 and len(made) == 12
    for name in left_over(folder / "out"):  # of the dead machine: cleared away once it is old
        for path_ in (folder / "out").rglob(name):
            os.utime(path_, (old, old))
    assert run("render", "job.toml", "--set", "cameras[1].frames=5", "--set", "render.spp=1").returncode == 0
    assert not left_over(folder / "out")
