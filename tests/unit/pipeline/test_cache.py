"""What is kept for all commands of a user: whole or not at all, no more than so much, by any number of processes."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from mirelight import cli
from mirelight.io import owner
from mirelight.model import ProxyMesh
from mirelight.pipeline.cache import UserCache, folder
from mirelight.pipeline.codecs import ARRAY, MESH

ROW = np.arange(250, dtype=np.float32)
TRIANGLE = ProxyMesh(vertices=np.eye(3, dtype=np.float32), faces=np.array([[0, 1, 2]], np.int32))


def test_what_is_kept_is_found_to_the_bit(cache: Path) -> None:
    assert UserCache().get("a", ARRAY) is None and not cache.exists()
    UserCache().put("a", ROW, ARRAY)
    UserCache().put("b", TRIANGLE, MESH)
    found, mesh = UserCache().get("a", ARRAY), UserCache().get("b", MESH)
    assert found is not None and mesh is not None
    assert found.tobytes() == ROW.tobytes()
    np.testing.assert_array_equal(mesh.vertices, TRIANGLE.vertices)
    np.testing.assert_array_equal(mesh.faces, TRIANGLE.faces)
    assert UserCache().get("a", MESH) is None and UserCache().get("b", ARRAY) is None
    assert {x.name for x in cache.iterdir()} == {"a.kept", "b.kept"}


def test_what_has_rotted_is_not_there(cache: Path) -> None:
    UserCache().put("a", ROW, ARRAY)
    path = cache / "a.kept"
    whole = path.read_bytes()
    for at in range(0, len(whole), 37):
        path.write_bytes(whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :])
        assert UserCache().get("a", ARRAY) is None, at
        path.write_bytes(whole[:at])
        assert UserCache().get("a", ARRAY) is None, at
    UserCache().put("a", ROW, ARRAY)
    assert UserCache().get("a", ARRAY) is not None


def test_what_was_not_used_for_longest_goes(cache: Path) -> None:
    small = UserCache(most=5000)  # three of them
    for age, key in enumerate("abc"):
        small.put(key, ROW, ARRAY)
        os.utime(cache / f"{key}.kept", (1000 + age, 1000 + age))
    assert small.get("a", ARRAY) is not None  # used now
    small.put("d", ROW, ARRAY)
    assert {x.name[0] for x in cache.iterdir()} == {"a", "c", "d"}
    assert small.held()[0] == 3 and small.held()[1] <= 5000


def test_what_a_killed_process_left_goes(cache: Path) -> None:
    cache.mkdir(parents=True)
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    names = [f".a~{owner.machine()}-{process}-0123456789ab.kept" for process in (ended.pid, os.getpid())]
    for name in names:
        (cache / name).touch()
    UserCache().put("b", ROW, ARRAY)
    assert {x.name for x in cache.iterdir()} == {names[1], "b.kept"}


WRITER = """
import sys, numpy as np
from mirelight.pipeline.cache import UserCache
from mirelight.pipeline.codecs import ARRAY
for turn in range(40):
    for key in "abcd":
        UserCache(most=3000).put(key, np.arange(250, dtype=np.float32), ARRAY)
        found = UserCache(most=3000).get("abcd"[turn % 4], ARRAY)
        assert found is None or (found == np.arange(250)).all()
"""


def test_several_processes_share_it(cache: Path) -> None:
    """They write, read and remove the same things at once; each is whole or not there."""
    writers = [subprocess.Popen([sys.executable, "-c", WRITER]) for _ in range(3)]
    assert [x.wait() for x in writers] == [0, 0, 0]
    assert all(x.name.endswith(".kept") and x.name[0] != "." for x in cache.iterdir())
    assert UserCache().held()[1] <= 3000


def test_a_place_that_cannot_be_used_is_no_error(
    cache: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    cache.parent.mkdir(exist_ok=True)
    cache.write_text("a file")
    UserCache().put("a", ROW, ARRAY)
    assert UserCache().get("a", ARRAY) is None and UserCache().held() == (0, 0)
    UserCache().clear()

    def nobody() -> Path:
        raise RuntimeError("no home")

    monkeypatch.delenv("MIRELIGHT_CACHE_DIR")
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr(Path, "home", nobody)
    assert folder() is None
    UserCache().put("a", ROW, ARRAY)
    assert UserCache().get("a", ARRAY) is None
    assert cli.main(["cache", "--clear"]) == 0
    assert "no home folder" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("system", "variables", "expected"),
    [
        ("Linux", {}, "/home/me/.cache/mirelight/made"),
        ("Linux", {"XDG_CACHE_HOME": "/var/me"}, "/var/me/mirelight/made"),
        ("Linux", {"XDG_CACHE_HOME": "relative"}, "/home/me/.cache/mirelight/made"),
        ("Darwin", {}, "/home/me/Library/Caches/mirelight/made"),
        ("Windows", {"LOCALAPPDATA": "/local"}, "/local/mirelight/made"),
        ("Linux", {"MIRELIGHT_CACHE_DIR": "/mine"}, "/mine"),
    ],
)
def test_it_is_where_the_platform_has_such_things(
    monkeypatch: pytest.MonkeyPatch, system: str, variables: dict[str, str], expected: str
) -> None:
    for name in ("MIRELIGHT_CACHE_DIR", "XDG_CACHE_HOME", "LOCALAPPDATA"):
        monkeypatch.delenv(name, raising=False)
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr("platform.system", lambda: system)
    monkeypatch.setattr(Path, "home", lambda: Path("/home/me"))
    assert folder() == Path(expected)


def test_the_command_says_what_there_is_and_clears_it(cache: Path, capsys: pytest.CaptureFixture[str]) -> None:
    UserCache().put("a", ROW, ARRAY)
    UserCache().put("b", TRIANGLE, MESH)
    (cache / "mine.txt").write_text("not mirelight's")
    assert cli.main(["cache"]) == 0
    assert capsys.readouterr().out == f"{cache}: 2 things, 0.0 MB of at most 1074 MB\n"
    assert cli.main(["cache", "--clear"]) == 0
    assert capsys.readouterr().out == f"{cache}: 2 things removed\n"
    assert [x.name for x in cache.iterdir()] == ["mine.txt"]
