"""`mirelight watch`: saved changes are shown and rendered, mistakes are a line, Ctrl-C ends it."""

from __future__ import annotations

import os
import signal
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from mirelight.apps.watch.files import Files, files_of
from mirelight.apps.watch.session import Session
from mirelight.base.errors import InputError
from mirelight.batch.executor import Progress
from mirelight.batch.order import Order
from mirelight.lighting import frame
from mirelight.pipeline.plan import FrameTask

from .conftest import COMMAND, Run

JOB = """\
splats = "splats.ply"
proxy = "proxy.glb"
resolution = [64, 48]

[[cameras]]
name = "front"
position = [0, 1, 6]
target = [0, 0, 0]

[[lightings]]
name = "night"

[[lightings.lights]]
type = "point"
name = "lamp"
position = [1, 3, 1]
intensity = 20

[render]
spp = 64
"""


def saved(job: Path, text: str) -> None:
    """As editors save: another file takes the name."""
    other = job.with_suffix(".tmp")
    other.write_text(text, encoding="utf-8")
    other.replace(job)


def picture(path: Path) -> np.ndarray:
    with Image.open(path) as image:
        return np.asarray(image).astype(int)


# --- the session ---


class Watched:
    """A session, and what its last update has shown."""

    def __init__(self, folder: Path) -> None:
        self.job, self.out = folder / "job.toml", folder / "out"
        self.session = Session(Order(job=str(self.job), out=str(self.out)))

    def update(self, text: str) -> list[tuple[str, tuple[int, ...]]]:
        saved(self.job, text)
        shown: list[tuple[str, tuple[int, ...]]] = []

        def note(task: FrameTask, what: str) -> None:
            shown.append((what, picture(self.live).shape))

        self.session.update(Progress(), note)
        return [x for x in shown if x[0] != "so far"]

    @property
    def live(self) -> Path:
        return self.out / ".mirelight" / "watch" / "front.night.png"


@pytest.fixture
def watched(folder: Path) -> Iterator[Watched]:
    made = Watched(folder)
    yield made
    made.session.close()


def test_an_edit_makes_again_what_it_touches(watched: Watched, folder: Path, run: Run) -> None:
    large = JOB.replace("[64, 48]", "[320, 240]")
    full, quick = (240, 320, 3), (120, 160, 3)
    assert watched.update(large) == [("quick", quick), ("done", full)]
    first = watched.session._scene
    assert first is not None
    parts = first.compositor, first.splats, first.proxy

    assert watched.update(large) == []  # saved without a change

    brighter = large.replace("intensity = 20", "intensity = 30")
    assert watched.update(brighter) == [("full", full), ("done", full)]
    second = watched.session._scene
    assert second is not None and second is not first
    assert (second.compositor, second.splats, second.proxy) == parts  # the very same
    assert second.tracer is first.tracer

    moved = brighter.replace("position = [1, 3, 1]", "position = [-1, 3, 1]")
    before = picture(watched.live)
    assert watched.update(moved) == [("quick", quick), ("done", full)]
    assert np.abs(picture(watched.live) - before).max() > 8
    third = watched.session._scene
    assert third is not None and third.compositor is parts[0] and third.tracer is first.tracer

    fewer = moved.replace("spp = 64", "spp = 32")
    assert watched.update(fewer) == [("quick", quick), ("done", full)]
    watched.session.close()
    assert not watched.live.exists()

    there = run("render", "job.toml", "-o", "out")
    assert "1 of them already there" in there.stdout
    fresh = run("render", "job.toml", "-o", "fresh")
    assert fresh.returncode == 0, fresh.stderr
    for name in ("front.night.png", "front.night.exr"):
        assert (folder / "out" / name).read_bytes() == (folder / "fresh" / name).read_bytes()


def test_a_mistake_leaves_everything_ready(watched: Watched) -> None:
    watched.update(JOB)
    with pytest.raises(InputError, match=r"job\.toml:.*not TOML"):
        watched.update(JOB + "intensity = = 3\n")
    with pytest.raises(InputError, match=r"no file 'other.ply'"):
        watched.update(JOB.replace("splats.ply", "other.ply"))
    assert [x for x, _ in watched.update(JOB.replace("intensity = 20", "intensity = 5"))] == ["full", "done"]
    assert [x for x, _ in watched.update(JOB.replace("front", "side").replace('side"\n', 'front"\n'))]


def test_what_is_in_progress_is_given_up_for_a_change(watched: Watched, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(frame, "FEW_LANES", 0)  # pictures as small as these are one launch, and are not given up

    class Changed(BaseException):
        pass

    class Stops(Progress):
        def samples(self, task: FrameTask, done: int, total: int) -> None:
            if 0 < done < total:
                raise Changed

    saved(watched.job, JOB)
    with pytest.raises(Changed):
        watched.session.update(Stops(), lambda task, what: None)
    assert not list(watched.out.glob("*.partial.*"))
    assert [x for x, _ in watched.update(JOB)] == ["quick", "done"]


# --- the files ---


def test_files_that_are_written_replaced_removed_or_made(tmp_path: Path) -> None:
    job, texture = tmp_path / "job.toml", tmp_path / "sky.hdr"
    job.write_text('splats = "cloud.ply"\nsky = { path = "sky.hdr" }\n')
    texture.write_bytes(b"one")
    files = Files(job)
    files.follow(files_of(job))
    assert len(files) == 2 and not files.changed()
    texture.write_bytes(b"others")
    assert files.changed()
    files.settle()
    assert not files.changed()
    saved(job, job.read_text())
    assert files.changed()
    files.settle()
    (tmp_path / "cloud.ply").write_bytes(b"there now")
    assert files.changed()
    files.settle()
    texture.unlink()
    assert files.changed()


def test_a_file_that_is_away_for_a_moment_is_waited_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    job = tmp_path / "job.toml"
    job.write_text("a = 1\n")
    files = Files(job)
    job.unlink()
    assert files.changed()
    pauses: list[float] = []

    def pause(seconds: float) -> None:
        pauses.append(seconds)
        if len(pauses) == 3:
            job.write_text("a = 2\n")

    monkeypatch.setattr(time, "sleep", pause)
    files.settle()
    assert job.read_text() == "a = 2\n" and not files.changed()


def test_what_a_file_names_is_watched_and_mistakes_are_no_hindrance(folder: Path) -> None:
    job = folder / "own.toml"
    (folder / "mesh.obj").write_text("mtllib mesh.mtl\nv 0 0 0\n")
    (folder / "mesh.mtl").write_text("newmtl a\n")
    job.write_text('proxy = "mesh.obj"\nsplats = "' + "x" * 5000 + '"\nname = "a\\u0000b"\nup = ".."\n')
    found = files_of(job)
    assert {job, folder / "mesh.obj", folder / "mesh.mtl"} <= found
    job.write_text("proxy = = \n")
    assert files_of(job, ["mesh.obj"]) == {job, folder / "mesh.obj", folder / "mesh.mtl"}


def test_a_folder_of_the_users_stays_as_it_is(watched: Watched) -> None:
    own = watched.out / "watch"
    own.mkdir(parents=True)
    for name in ("front.night.png", "notes.txt"):
        (own / name).write_text("mine")
    watched.update(JOB.replace("spp = 64", "spp = 1"))
    assert watched.live.is_file()
    watched.session.close()
    assert not watched.live.exists()
    assert {path.name: path.read_text() for path in own.iterdir()} == {
        "front.night.png": "mine",
        "notes.txt": "mine",
    }


def test_a_setting_for_speed_writes_over_no_finished_frames(folder: Path) -> None:
    job = folder / "job.toml"
    text = JOB.replace("spp = 64", "spp = 1")
    saved(job, text)

    def begin(*settings: str, out: str | None = None) -> Session:
        session = Session(Order(job=str(job), settings=settings, out=out))
        session.update(Progress(), lambda task, what: None)
        return session

    begin().close()
    finals = {path: path.read_bytes() for path in (folder / "out").glob("front.*")}
    assert finals
    with pytest.raises(InputError, match=r"front\.night\.\w+ is 64 x 48, which --set would write over; name another"):
        begin("resolution_scale=0.5")
    assert {path: path.read_bytes() for path in finals} == finals
    session = begin("resolution_scale=0.5", out=str(folder / "small"))
    saved(job, text.replace("[64, 48]", "[48, 48]"))  # the job itself changes: its frames follow
    session.update(Progress(), lambda task, what: None)
    session.close()
    assert picture(folder / "small" / "front.night.png").shape == (24, 24, 3)
    begin("display.exposure=1").close()


# --- the command ---


class Process:
    """`mirelight watch job.toml`, and the lines that it has said."""

    def __init__(self, folder: Path) -> None:
        self.job, self.said = folder / "job.toml", list[str]()
        self.process = subprocess.Popen([*COMMAND, "watch", "job.toml"], cwd=folder, stderr=subprocess.PIPE, text=True)
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stderr is not None
        self.said.extend(line.rstrip("\n") for line in self.process.stderr)

    @property
    def mistakes(self) -> list[str]:
        """What was said of anything but pictures."""
        return [line for line in self.said if "front.night: " not in line and "out/.mirelight/watch" not in line]

    def wait(self, text: str, count: int) -> None:
        self._until(lambda: sum(text in line for line in self.said) >= count, 240)

    def wait_for_mistakes(self, count: int) -> None:
        self._until(lambda: len(self.mistakes) >= count, 240)

    def _until(self, met: Callable[[], bool], seconds: float) -> None:
        end = time.monotonic() + seconds
        while not met():
            assert self.process.poll() is None and time.monotonic() < end, self.said
            time.sleep(0.05)

    def end(self) -> int:
        self.process.send_signal(signal.SIGINT)
        code = self.process.wait(timeout=120)
        self._reader.join(timeout=60)
        return code


@pytest.fixture
def process(folder: Path) -> Iterator[Process]:
    (folder / "job.toml").write_text(JOB)
    made = Process(folder)
    yield made
    made.process.kill()


def test_a_process_follows_edits_until_ctrl_c(process: Process, folder: Path) -> None:
    process.wait("front.night: done", 1)
    assert (folder / "out" / ".mirelight" / "watch" / "front.night.png").is_file()
    saved(process.job, JOB.replace("intensity = 20", "intensity = 'bright'"))
    process.wait("job.toml:", 1)
    assert "lights[0].intensity" in next(x for x in process.said if "job.toml:" in x)
    lines = len(process.said)
    time.sleep(0.5)
    assert len(process.said) == lines  # it stays the last thing on the screen
    saved(process.job, JOB.replace("intensity = 20", "intensity = 40"))
    process.wait("front.night: shown in full", 1)
    process.wait("front.night: done", 2)
    assert process.end() == 0
    assert not any("Traceback" in line for line in process.said), process.said
    assert not (folder / "out" / ".mirelight" / "watch").exists()
    assert not list((folder / "out").glob(".front*"))


def test_whatever_is_saved_is_a_line_and_ends_nothing(process: Process, folder: Path) -> None:
    os.mkfifo(folder / "pipe")
    hostile = [
        b"",
        b"a = " + b"[" * 5000,
        b"[" + b"a." * 5000 + b"a]",
        b"resolution = [" + b"9" * 5000 + b", 1]",
        b"\xff\xfe\x00splats",
        *(
            JOB.replace("splats.ply", x).encode()
            for x in ("\\u001b]0;title\\u0007.ply", "pipe", "/dev/zero", ".", "x" * 5000)
        ),
        *(JOB.replace("proxy.glb", x).encode() for x in ("/dev/zero", "pipe", "job.toml")),
        JOB.replace("intensity = 20", "intensity = 1e400").encode(),
    ]
    process.wait("front.night: done", 1)
    for k, content in enumerate(hostile, start=1):
        other = folder / "next"
        other.write_bytes(content)
        other.replace(process.job)
        process.wait_for_mistakes(k)
    saved(process.job, JOB.replace("intensity = 20", "intensity = 40"))
    process.wait("front.night: done", 2)
    assert process.end() == 0
    assert not any("Traceback" in line for line in process.said), process.said
    assert all(line.isprintable() for line in process.said)
    assert len(process.mistakes) == len(hostile), process.mistakes


@pytest.mark.parametrize(
    ("arguments", "found"), [(["nothing.toml"], "nothing.toml: no such file"), (["splats.ply"], "splats.ply")]
)
def test_wrong_use_is_one_line(folder: Path, run: Run, arguments: list[str], found: str) -> None:
    done = run("watch", *arguments)
    assert done.returncode == 2
    assert found in done.stderr and done.stderr.count("\n") == 1
