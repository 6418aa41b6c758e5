"""Several processes in one folder, killed ones, damaged files: every frame once, none lost, nothing left over."""

from __future__ import annotations

import errno
import json
import os
import platform
import random
import shutil
import signal
import subprocess
import time
from contextlib import AbstractContextManager
from pathlib import Path
from types import SimpleNamespace
from typing import Any, TypeVar, cast

import numpy as np
import pytest

from mirelight.base.errors import OutputError
from mirelight.io import owner
from mirelight.io.atomic import atomic_path, clear, owner_of
from mirelight.io.exr import read_exr
from mirelight.io.image import read_fingerprint
from mirelight.model import Job, OutputSettings
from mirelight.pipeline.artefact_cache import NullCache, made_once
from mirelight.pipeline.codecs import ARRAY, Codec
from mirelight.store import Store, artefacts
from mirelight.store.ballast import Ballast
from mirelight.store.claims import Claims
from mirelight.store.index import Index
from mirelight.store.journal import FileRow, Journal, Row
from mirelight.store.touching import Toucher

from .conftest import COMMAND, Run

T = TypeVar("T")
TURN = ("--set", "cameras[1].frames=12", "--camera", "orbit")  # 12 cameras under 2 lightings


def start(folder: Path, *more: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [*COMMAND, "render", "job.toml", *TURN, *more],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def rows(out: Path) -> list[str]:
    """Names of the frames that processes have written, as often as they have."""
    journals = (out / ".mirelight" / "journal").glob("*.jsonl")
    return [json.loads(line)["frame"] for file in journals for line in file.read_text().splitlines()]


def left_over(out: Path) -> list[str]:
    """Temporary files and claims."""
    hidden = [x.name for x in out.rglob(".*") if x.is_file()]
    return hidden + [x.name for x in (out / ".mirelight" / "claims").iterdir()]


@pytest.mark.parametrize("count", [2, 3])
def test_processes_share_a_folder(folder: Path, count: int) -> None:
    processes = [start(folder) for _ in range(count)]
    said = [process.communicate(timeout=300) for process in processes]
    assert [process.returncode for process in processes] == [0] * count, said
    out = folder / "out"
    made = rows(out)
    assert len(made) == len(set(made)) == 24  # each frame once
    assert all(stdout.startswith("24 frames in out") for stdout, _ in said)
    assert len(list(out.glob("*.exr"))) == len(list(out.glob("*.png"))) == 24
    assert not left_over(out)
    assert not any("Traceback" in stderr for _, stderr in said)


def test_killed_processes_lose_nothing(folder: Path, run: Run) -> None:
    """Killed again and again at random moments, some beside another that lives on: the same bits as undisturbed."""
    whole = run("render", "job.toml", *TURN, "--out", "whole")
    assert whole.returncode == 0, whole.stderr
    chance = random.Random(7)
    for _ in range(4):
        doomed, other = start(folder, "--out", "parts"), start(folder, "--out", "parts")
        time.sleep(chance.uniform(0.5, 3.0))
        doomed.send_signal(signal.SIGKILL)
        time.sleep(chance.uniform(0, 0.5))
        other.send_signal(signal.SIGKILL)
        for process in (doomed, other):
            process.communicate()
    done = run("render", "job.toml", *TURN, "--out", "parts")
    assert done.returncode == 0 and done.stdout.startswith("24 frames in parts"), done.stderr
    assert not left_over(folder / "parts")
    for path in sorted((folder / "whole").glob("[!.]*")):
        if path.suffix == ".png":
            assert path.read_bytes() == (folder / "parts" / path.name).read_bytes()
        else:
            ours, theirs = (read_exr(folder / name / path.name).channels for name in ("whole", "parts"))
            assert all(np.array_equal(ours[x], theirs[x]) for x in ours)
    again = run("render", "job.toml", *TURN, "--out", "parts")
    assert "24 of them already there" in again.stdout


def test_a_file_damaged_in_its_middle_is_made_again(folder: Path, run: Run) -> None:
    job = ("render", "job.toml", "--camera", "front", "--lighting", "day")
    assert run(*job).returncode == 0
    path = folder / "out" / "front.day.exr"
    good = path.read_bytes()
    middle = len(good) // 2
    path.write_bytes(good[:middle] + bytes(64) + good[middle + 64 :])
    assert run(*job).stdout.startswith("1 frame in out; ")
    assert path.read_bytes() == good


def test_a_moved_folder_is_known_by_its_files(folder: Path, run: Run) -> None:
    """Copied without its journal, or with files of another time: headers and digests tell."""
    job = ("render", "job.toml", "--camera", "front")
    assert run(*job).returncode == 0
    for path in (folder / "out").glob("front.*"):
        path.touch()
    assert "2 of them already there" in run(*job).stdout
    for path in (folder / "out" / ".mirelight" / "journal").iterdir():
        path.unlink()
    assert "2 of them already there" in run(*job).stdout


def test_a_changed_exposure_writes_pictures_alone(folder: Path, run: Run) -> None:
    job = ("render", "job.toml", "--camera", "front")
    assert run(*job).returncode == 0
    out = folder / "out"
    exr, light = (out / "front.night.exr").stat(), sorted((out / ".mirelight" / "light").iterdir())
    png = read_fingerprint(out / "front.night.png")
    assert run(*job, "--set", "display.exposure=1").returncode == 0
    assert (out / "front.night.exr").stat().st_mtime_ns == exr.st_mtime_ns
    assert read_fingerprint(out / "front.night.png") != png
    assert sorted((out / ".mirelight" / "light").iterdir()) == light


# --- parts -----------------------------------------------------------------------------------------------------------


def ended_process() -> str:
    """The token of a process that has ended."""
    process = subprocess.Popen(["true"])
    process.wait()
    return f"{owner.machine()}-{process.pid}"


def test_tokens_tell_who_runs() -> None:
    assert owner.runs(owner.token()) is True
    assert owner.runs(ended_process()) is False
    assert owner.runs("0123456789-1") is None and owner.runs("nonsense") is None


def test_a_number_that_lives_again_is_another_process() -> None:
    """A container that is started anew numbers its processes from 1 again: what tells them apart is when they began."""
    token = owner.token()
    start = token.rpartition("-t")[2]
    assert token != start and owner.runs(token.replace(f"-t{start}", f"-t{int(start) - 1}")) is False
    assert owner.runs(token.replace(f"-t{start}", "")) is True  # as written before there was a start in it
    assert owner.process_of(token) == os.getpid()


def test_temporary_files_name_their_process(tmp_path: Path) -> None:
    with atomic_path(tmp_path / "a.b~c.exr") as temporary:
        assert owner_of(temporary.name) == owner.token()
    assert owner_of("a.b~c.exr") is None and owner_of(".bashrc") is None


def test_a_claim_is_one_process_alone(tmp_path: Path) -> None:
    here, there = Claims(tmp_path), Claims(tmp_path)
    with here.claim("front") as mine, there.claim("front") as also, there.claim("side") as other:
        assert (mine, also, other) == (True, False, True)
    with there.claim("front") as now:
        assert now
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("holder", "taken"), [("ended", True), ("elsewhere", False), ("elsewhere, long ago", True)])
def test_a_claim_of_a_process_that_is_gone_is_taken_over(tmp_path: Path, holder: str, taken: bool) -> None:
    claims = Claims(tmp_path)
    with claims.claim("front"):
        (path,) = tmp_path.iterdir()
    path.write_text(f"{ended_process() if holder == 'ended' else '0123456789-12'}\n{{}}\n")
    if "long ago" in holder:
        old = time.time() - 3600
        os.utime(path, (old, old))
    with claims.claim("front") as mine:
        assert mine is taken


def test_a_claim_of_an_earlier_process_of_this_number_is_taken_over(tmp_path: Path) -> None:
    """The number lives, as another process; or its token is our own, and we do not hold it."""
    claims = Claims(tmp_path)
    start = owner.token().rpartition("-t")[2]
    for token in (owner.token().replace(f"-t{start}", f"-t{int(start) - 1}"), owner.token()):
        claims._path("front").write_text(f"{token}\n{{}}\n")
        assert not claims.held()[0].alive
        with claims.claim("front") as mine:
            assert mine
    assert not list(tmp_path.iterdir())


def test_the_last_sign_of_life_counts_even_where_the_number_lives(tmp_path: Path) -> None:
    here, there = Claims(tmp_path), Claims(tmp_path)
    with here.claim("front") as mine:
        (path,) = tmp_path.iterdir()
        os.utime(path, (time.time() - 3600, time.time() - 3600))
        assert mine and not there.held()[0].alive
        with there.claim("front") as now:
            assert now
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("change", ["taken over", "touched"])
def test_a_claim_that_was_just_taken_over_is_put_back(tmp_path: Path, change: str) -> None:
    """Two look at a dead claim; one takes it over before the other comes to rename it."""
    quick = Claims(tmp_path)
    held: list[AbstractContextManager[bool]] = []

    class Late(Claims):
        def _removed(self, path: Path, seen: Any) -> bool:
            if change == "touched":
                os.utime(path)
            elif not held:
                held.append(quick.claim("front"))
                assert held[0].__enter__()
            return super()._removed(path, seen)

    late = Late(tmp_path)
    path = late._path("front")
    path.write_text(f"{ended_process() if change == 'taken over' else '0123456789-12'}\n{{}}\n")
    os.utime(path, (time.time() - 3600, time.time() - 3600))
    before = path.read_text()
    with late.claim("front") as mine:
        assert not mine
    (only,) = tmp_path.iterdir()
    assert only == path and (path.read_text() == before) is (change == "touched")
    if held:
        assert quick.held()[0].alive
        held[0].__exit__(None, None, None)
        assert not list(tmp_path.iterdir())


def test_what_was_made_while_a_claim_was_taken_is_not_made_again(tmp_path: Path) -> None:
    """Another process makes it and gives its claim up between the look and the claim."""
    looks = iter([None, np.ones(7)])

    class Late(NullCache):
        def get(self, key: str, codec: Codec[T]) -> T | None:
            return cast("T | None", next(looks))

    assert made_once(Late(), "work", "a", ARRAY, lambda: pytest.fail("made twice")).shape == (7,)


def test_ballast_shows_signs_of_life(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Another machine takes away what is old; a run of an hour is touched."""
    monkeypatch.setattr(shutil, "disk_usage", lambda path: SimpleNamespace(free=1_000_000))
    toucher = Toucher()
    ballast = Ballast(tmp_path, toucher)
    ballast.take()
    (path,) = tmp_path.iterdir()
    assert path.stat().st_size <= 1_000_000 // 10  # frames come first
    os.utime(path, (time.time() - 3600, time.time() - 3600))
    toucher.touch()
    toucher.close()
    true = owner.machine()
    monkeypatch.setattr(owner, "machine", lambda: "b" * 10)
    clear(tmp_path)
    assert path.exists()
    os.utime(path, (time.time() - 3600, time.time() - 3600))
    clear(tmp_path)
    assert not path.exists() and true != owner.machine()


def test_claims_that_nobody_comes_for_are_cleared(tmp_path: Path) -> None:
    """A process that is killed between its camera's last frame and the end of its claim leaves nothing to make."""
    claims = Claims(tmp_path)
    with claims.claim("front"), claims.claim("side"), claims.claim("back"):
        for path in tmp_path.iterdir():
            if not path.name.startswith("front"):
                path.write_text(f"{ended_process() if path.name.startswith('side') else '0123456789-12'}\n{{}}\n")
        claims.clear()
        assert {path.name.partition("-")[0] for path in tmp_path.iterdir()} == {"front", "back"}


def test_a_claim_says_who_and_since_when(tmp_path: Path) -> None:
    claims = Claims(tmp_path)
    with claims.claim("front.day"):
        (held,) = claims.held()
        assert (held.name, held.process, held.alive) == ("front.day", os.getpid(), True)
        assert held.host == platform.node() and 0 <= held.silent <= held.age < 60
    assert claims.held() == []


def test_a_process_killed_while_it_claims_holds_nothing(tmp_path: Path) -> None:
    """Between making the file and signing it, where there are no links."""
    claims = Claims(tmp_path)
    with claims.claim("front"):
        (path,) = tmp_path.iterdir()
    path.touch()
    with claims.claim("front") as now:
        assert not now  # it may be about to be signed
    os.utime(path, (time.time() - 60, time.time() - 60))
    with claims.claim("front") as now:
        assert now


@pytest.mark.parametrize("links", [True, False])
def test_a_claim_is_made_once_and_signed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, links: bool) -> None:
    true, held = os.link, []

    def link(ready: Path, path: Path, **more: Any) -> None:
        held.append(Path(ready).read_text().partition("\n")[0])
        if not links:
            raise PermissionError(errno.EPERM, "Operation not permitted")
        true(ready, path, **more)

    monkeypatch.setattr(os, "link", link)
    claims, other = Claims(tmp_path), Claims(tmp_path)
    with claims.claim("front") as first, other.claim("front") as second:
        assert first and not second
        assert held == [owner.token()] * 2  # whole before it has its name
        (path,) = tmp_path.iterdir()
        assert path.read_text().startswith(f"{owner.token()}\n")
    assert not list(tmp_path.iterdir())


def test_a_claim_taken_over_is_left_to_its_new_holder(tmp_path: Path) -> None:
    """A machine that slept for an hour wakes up, and ends its work on a camera that another has taken."""
    claims = Claims(tmp_path)
    with claims.claim("front"):
        (path,) = tmp_path.iterdir()
        path.write_text("0123456789-12\n{}\n")
    assert path.exists()


@pytest.mark.parametrize(("run", "taken"), [("r1", True), ("r2", False), ("", False)])
def test_a_scheduler_gives_a_camera_to_another_at_once(tmp_path: Path, run: str, taken: bool) -> None:
    """The claim of a process on a machine that died, of the same run."""
    with Claims(tmp_path).claim("front", "r1"):
        (path,) = tmp_path.iterdir()
        path.write_text("0123456789-12\n" + path.read_text().partition("\n")[2])
        with Claims(tmp_path).claim("front", run) as mine:
            assert mine is taken


@pytest.mark.parametrize("shift", [-7200.0, 7200.0])
def test_clocks_may_differ(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, shift: float) -> None:
    """Two machines whose clocks are two hours apart: a claim that lives is nobody else's, a dead one is taken over."""
    true = time.time
    monkeypatch.setattr(owner, "machine", lambda: "a" * 10)
    here = Claims(tmp_path)
    with here.claim("front"):
        monkeypatch.setattr(owner, "machine", lambda: "b" * 10)
        monkeypatch.setattr(time, "time", lambda: true() + shift)  # the folder's clock is the server's
        there = Claims(tmp_path)
        with there.claim("front") as mine:
            assert not mine
        (held,) = there.held()
        assert held.alive and held.age < 60
        (path,) = tmp_path.glob("[!.]*")
        old = true() - 601
        os.utime(path, (old, old))
        assert not there.held()[0].alive
        with there.claim("front") as mine:
            assert mine
    monkeypatch.setattr(owner, "machine", lambda: "a" * 10)


def test_a_journal_outlives_a_torn_line(tmp_path: Path) -> None:
    journal = Journal(tmp_path)
    row = Row("front.day", {".exr": FileRow("key", 5, 7, "ab")}, 1.5)
    journal.add(row)
    journal.close()
    (file,) = tmp_path.iterdir()
    file.write_bytes(file.read_bytes() + b'{"frame": "front.ni')
    (tmp_path / "other.jsonl").write_bytes(b"[1]\n\xff\xfe\n{}\n")
    assert list(Journal(tmp_path).rows()) == [row]


def test_a_write_that_stops_half_way_loses_no_other_row(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Short writes go on; a row that is torn for good does not swallow the next one."""
    true, room = os.write, [10**6]

    def short(handle: int, data: bytes) -> int:
        if not room[0]:
            raise OSError(errno.ENOSPC, "No space left on device")
        room[0] -= (size := min(len(data), 20, room[0]))
        return true(handle, data[:size])

    monkeypatch.setattr(os, "write", short)
    journal = Journal(tmp_path)
    journal.add(Row("a.day", {}, 1.0))
    room[0] = 25
    with pytest.raises(OutputError, match="the disk is full"):
        journal.add(Row("b.day", {}, 1.0))
    room[0] = 10**6
    journal.add(Row("c.day", {}, 1.0))
    journal.close()
    reader = Journal(tmp_path)
    assert sorted(row.frame for row in reader.rows()) == ["a.day", "c.day"] and reader.bad == 0


def test_a_long_row_hides_nothing(tmp_path: Path) -> None:
    journal = Journal(tmp_path)
    journal.add(Row("a.day", {}, 0.0, "x" * (3 << 20) + "\nlast line"))
    journal.add(Row("b.day", {}, 1.0))
    journal.close()
    first, second = Journal(tmp_path).rows()
    assert first.error.endswith("\nlast line") and second.frame == "b.day"
    (file,) = tmp_path.iterdir()
    file.write_bytes(b'{"frame": "' + b"x" * (3 << 20) + b'"}\n' + file.read_bytes())
    reader = Journal(tmp_path)
    assert [row.frame for row in reader.rows()] == ["a.day", "b.day"] and reader.bad == 1


@pytest.mark.parametrize(
    "change",
    [
        {"files": {".png": {"key": [], "bytes": 1, "mtime_ns": 1, "sha256": ""}}},
        {"files": {".png": {"key": "k", "bytes": "1", "mtime_ns": 1, "sha256": ""}}},
        {"files": {".png": {"key": "k", "bytes": 1, "mtime_ns": 1}}},
        {"files": []},
        {"frame": ["a"]},
        {"seconds": 10**400},
        {"seconds": None},
        {"error": {}},
        {"wanted": {".png": []}},
    ],
)
def test_rows_are_checked(tmp_path: Path, change: dict[str, object]) -> None:
    (tmp_path / "a.jsonl").write_text(json.dumps({"frame": "a.b", "files": {}, "seconds": 1, **change}) + "\n")
    reader = Journal(tmp_path)
    assert list(reader.rows()) == [] and reader.bad == 1
    assert list(reader.rows()) == [] and reader.bad == 1  # counted once
    assert Index(tmp_path, reader.rows()).rows_of("a.b.png", "k") == []


def test_a_bad_row_is_said_by_every_command(folder: Path, run: Run) -> None:
    job = ("render", "job.toml", "--camera", "front", "--lighting", "day")
    assert run(*job).returncode == 0
    entry = {"frame": "front.day", "files": {".png": {key: [] for key in ("key", "bytes", "mtime_ns", "sha256")}}}
    (folder / "out" / ".mirelight" / "journal" / "a.jsonl").write_text(json.dumps({**entry, "seconds": 1}) + "\n")
    said = "a row of the journal is damaged and left out"
    for command in (job, ("status", "out"), ("verify", "out"), ("verify", "out", "--rebuild")):
        done = run(*command)  # none ends in a traceback
        assert said in done.stdout + done.stderr, done
    assert "1 of them already there" in run(*job).stdout


def test_kept_light_that_has_rotted_is_made_again_and_said(folder: Path, run: Run) -> None:
    job = ("render", "job.toml", "--camera", "front")
    assert run(*job).returncode == 0
    out = folder / "out"
    good = {path.name: path.read_bytes() for path in out.glob("front.*")}
    for path in (out / ".mirelight" / "light").iterdir():
        data = bytearray(path.read_bytes())
        data[len(data) // 2] ^= 4
        path.write_bytes(data)
    for name in good:
        (out / name).unlink()
    done = run(*job)
    assert done.returncode == 0 and "is damaged; what it held is made again" in done.stderr
    assert {path.name: path.read_bytes() for path in out.glob("front.*")} == good
    assert "damaged" not in run("verify", "out").stdout


def test_layers_of_another_job_in_the_folder_stay(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where they are the product, also those that another job has found made; its own that are out of use go."""
    monkeypatch.setattr(artefacts, "_MOST_UNUSED", 0)
    stores = [Store(Job(source=tmp_path / name, splats=None, output=OutputSettings(directory=tmp_path / "out")))
              for name in ("a.toml", "b.toml")]  # fmt: skip
    for name, store in zip("ab", stores, strict=True):
        store.open()
        for i in range(3):
            store._light.put(f"{name * 20}{i}", np.zeros(9), ARRAY)
    plan = {
        "job": str(tmp_path / "b.toml"),
        "settings": [],
        "whole": True,
        "frames": [],
        "layers": {"x": ["a" * 20 + "1"]},
    }
    aside = tmp_path / "out" / ".mirelight"
    (aside / "plans" / "0.json").write_text(json.dumps(plan))
    (aside / "dataset.json").write_text(json.dumps({"views": ["a" * 20 + "2"]}))
    stores[0].tidy({"b" * 20})
    left = [path.stem[-2:] for path in stores[0]._light.files()]
    assert left == ["a1", "a2", "b0", "b1", "b2"]
    for store in stores:
        store.close()
