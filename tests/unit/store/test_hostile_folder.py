"""Output folders that mean harm: pipes, devices, terabytes and broken rows where runs keep what they know."""

from __future__ import annotations

import json
import os
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mirelight.base.errors import InputError
from mirelight.io import image, owner, safety
from mirelight.model import Camera, ProxyMesh, SplatLayer
from mirelight.pipeline.codecs import ARRAY, CELLS, MESH, Codec, composite_of, light_of, lights_on, transport_between
from mirelight.store import arrays, artefacts, layer_index
from mirelight.store.artefacts import Artefacts
from mirelight.store.claims import Claims
from mirelight.store.index import Index, digest_of, is_one_of
from mirelight.store.journal import FileRow, Journal, Row
from mirelight.store.planned import PlannedRuns

CAMERA = Camera.look_at((0, 0, 5), (0, 0, 0), 16, 12, yfov=40)
COMPOSITE = composite_of(CAMERA, "physical", True)
DEEP = b"[" * 100_000
PLAN = {
    "job": "/a.toml",
    "settings": [],
    "whole": True,
    "frames": [["a.b", "a", "b", {".exr": "k"}, "a"]],
    "layers": {},
}


def pipe(path: Path) -> None:
    os.mkfifo(path)


def device(path: Path) -> None:
    path.symlink_to("/dev/zero")


def loop(path: Path) -> None:
    path.symlink_to(path)


def terabytes(path: Path) -> None:
    with path.open("wb") as file:
        file.truncate(2**42)


def deep(path: Path) -> None:
    path.write_bytes(DEEP)


KINDS = [pipe, device, loop, terabytes, deep, Path.mkdir]
each = pytest.mark.parametrize("make", KINDS, ids=lambda x: x.__name__)
Make = Callable[[Path], None]


@each
def test_files_that_are_left_out(tmp_path: Path, make: Make) -> None:
    make(tmp_path / "a")
    if make is deep:
        assert safety.read_file(tmp_path / "a") == DEEP
    else:
        with pytest.raises(OSError, match=r"not a file|too large|symbolic links"):
            safety.read_file(tmp_path / "a")


@each
def test_plans(tmp_path: Path, make: Make) -> None:
    for name in ("0.json", "z.json"):
        make(tmp_path / name)
    (tmp_path / "m.json").write_text(json.dumps(PLAN))
    assert [frame.name for frame in PlannedRuns(tmp_path).frames()] == ["a.b"]


@each
def test_journals(tmp_path: Path, make: Make) -> None:
    journal = Journal(tmp_path)
    journal.add(Row("a.b", {".exr": FileRow("k", 1, 2, "0")}, 1.0))
    journal.close()
    for name in ("0.jsonl", "~.jsonl"):
        make(tmp_path / name)
    reader = Journal(tmp_path)
    assert [row.frame for row in reader.rows()] == ["a.b"]
    assert list(reader.new_rows()) == []


def test_a_row_that_grows_is_read_when_it_is_whole(tmp_path: Path) -> None:
    whole = json.dumps({"frame": "a.b", "files": {}, "seconds": 1}).encode() + b"\n"
    path = tmp_path / "a.jsonl"
    path.write_bytes(b"torn\n" + whole + whole[:10])
    reader = Journal(tmp_path)
    assert len(list(reader.rows())) == 1
    with path.open("ab") as file:
        file.write(whole[10:] + whole)
    assert len(list(reader.new_rows())) == 2


@each
def test_artefacts(tmp_path: Path, make: Make) -> None:
    for suffix in ("array", "light"):
        make(tmp_path / f"a.{suffix}")
    kept = Artefacts(tmp_path)
    assert kept.get("a", ARRAY) is None
    assert kept.get("a", MESH) is None
    assert kept.get("a", light_of(CAMERA)) is None
    assert kept.get("a", COMPOSITE) is None
    assert kept.get("a", CELLS) is None
    assert kept.get("a", lights_on(1)) is None
    assert kept.get("a", transport_between(1)) is None


@pytest.mark.parametrize(
    "head",
    [
        b"[]",
        b"{}",
        b'{"bytes":4}',
        b'{"bytes":4,"arrays":[],"about":{}}',
        b'{"bytes":4,"arrays":{"depth":["|O",[1],0]},"about":{}}',
        b'{"bytes":4,"arrays":{"depth":["<f4",[1000000000000],0]},"about":{}}',
        b'{"bytes":4,"arrays":{"depth":["<f4",[1],99]},"about":{}}',
        b'{"bytes":4,"arrays":{"depth":["<f4",[1],0]},"about":[]}',
        b'{"bytes":4,"arrays":{"depth":["<f4",[1],0]},"about":{"size":0,"names":["a"],"kinds":7,"layers":3}}',
        DEEP,
    ],
)
def test_artefacts_with_other_heads(tmp_path: Path, head: bytes) -> None:
    line = head.replace(b'"bytes":4', b'"crc":%d,"bytes":4' % zlib.crc32(b"1234")) + b"\n"
    start = len(arrays._MAGIC) + 9
    line = line[:-1].ljust(-(start + len(line)) % arrays._ALIGN + len(line) - 1) + b"\n"
    for suffix in ("array", "light"):
        whole = arrays._MAGIC + b"%08x\n" % zlib.crc32(line) + line + b"1234"
        (tmp_path / f"a.{suffix}").write_bytes(whole)
    kept = Artefacts(tmp_path)
    assert kept.get("a", ARRAY) is None and kept.get("a", MESH) is None
    assert kept.get("a", light_of(CAMERA)) is None
    assert kept.get("a", COMPOSITE) is None
    assert kept.get("a", CELLS) is None
    assert kept.get("a", lights_on(1)) is None
    assert kept.get("a", transport_between(1)) is None


@each
def test_claims(tmp_path: Path, make: Make) -> None:
    claims = Claims(tmp_path)
    path = claims._path("front")
    make(path)
    assert [x.process for x in claims.held()] == [0]
    with claims.claim("front") as mine:
        assert not mine  # as long as it looks like one that was just begun
    os.utime(path, (1, 1), follow_symlinks=False)
    with claims.claim("front") as mine:
        assert mine
    claims.close()


def test_claims_of_nobody(tmp_path: Path) -> None:
    for i, text in enumerate(
        ("a-x\n", f"{owner.machine()}-{'9' * 5000}\n", f"{owner.token()}\n[[", "\n" + "[" * 100_000, "\xff")
    ):
        (tmp_path / f"front-{i}").write_text(text, encoding="latin-1")
    (tmp_path / "nan").write_text(owner.token() + '\n{"since": NaN, "name": 1e999}')
    held = Claims(tmp_path).held()
    assert len(held) == 6
    assert all(np.isfinite(x.age) for x in held)


@each
def test_frames(tmp_path: Path, make: Make) -> None:
    """What lies in a frame's place is no frame, and does not hide the others."""
    make(tmp_path / "a.b.exr")
    make(tmp_path / "a.b.png")
    (tmp_path / "c.d.png").write_bytes(b"1")
    status = (tmp_path / "c.d.png").stat()
    rows = [
        Row("a.b", {".exr": FileRow("k", 5, 2, "0"), ".png": FileRow("k", 5, 2, "0")}, 1.0),
        Row("c.d", {".png": FileRow("k", 1, status.st_mtime_ns, "0")}, 1.0),
    ]
    found = Index(tmp_path, iter(rows))
    assert not found.has_file(tmp_path / "a.b.exr", "k")
    assert not found.has_file(tmp_path / "a.b.png", "k")
    assert found.has_file(tmp_path / "c.d.png", "k")
    for name in ("a.b.exr", "a.b.png"):
        assert not image.is_intact(tmp_path / name)
        assert image.read_fingerprint(tmp_path / name) is None


def test_terabytes_in_a_frames_place_are_not_read(tmp_path: Path) -> None:
    path = tmp_path / "a.exr"
    path.write_bytes(b"whole")
    row = FileRow("k", 5, 0, digest_of(path))
    assert is_one_of(path, [row])
    path.write_bytes(b"other")
    assert not is_one_of(path, [row])
    terabytes(path)
    assert not is_one_of(path, [row]) and not is_one_of(tmp_path / "none", [row])


@each
def test_data_sets(tmp_path: Path, make: Make) -> None:
    (tmp_path / layer_index.FILE).parent.mkdir(exist_ok=True)
    make(tmp_path / layer_index.FILE)
    with pytest.raises(InputError, match=r"no kept layers|not an index|a damaged index"):
        layer_index.read(tmp_path)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 3e38])
def test_kept_values_that_are_none(tmp_path: Path, value: float) -> None:
    """A bit that has changed on disk makes the light anew, not a frame of NaN."""
    kept = Artefacts(tmp_path)
    values = np.ones((4, 3), np.float32)
    kept.put("a", values, ARRAY)
    layer = SplatLayer(
        camera=CAMERA,
        profile="physical",
        linear=True,
        color=np.ones((12, 16, 3), np.float32),
        transmittance=np.zeros((12, 16), np.float32),
        depth=np.ones((12, 16), np.float32),
        median_depth=np.ones((12, 16), np.float32),
    )
    kept.put("b", layer, COMPOSITE)
    assert kept.get("a", ARRAY) is not None and kept.get("b", COMPOSITE) is not None
    for name in ("a.array", "b.light"):
        data = (tmp_path / name).read_bytes()
        (tmp_path / name).write_bytes(data[:-64] + np.full(16, value, np.float32).tobytes())
    assert kept.get("a", ARRAY) is None and kept.get("b", COMPOSITE) is None


def test_any_bit_that_has_changed_is_found(tmp_path: Path) -> None:
    """Wherever it is, in values, names or what fills up between them; and it is said, once for each read."""
    kept, said = Artefacts(tmp_path, "job"), list[str]()
    kept.tell = said.append
    kept.put("a", np.arange(5, dtype=np.float32), ARRAY)
    kept.put("b", ProxyMesh(vertices=np.eye(3, dtype=np.float32), faces=np.array([[0, 1, 2]], np.int32)), MESH)
    kinds: dict[str, Codec[Any]] = {"a": ARRAY, "b": MESH}
    for name, codec in kinds.items():
        path = tmp_path / f"{name}.array"
        sound = path.read_bytes()
        assert kept.get(name, codec) is not None
        for at in range(len(sound)):
            path.write_bytes(sound[:at] + bytes([sound[at] ^ (1 << at % 8)]) + sound[at + 1 :])
            assert kept.get(name, codec) is None, at
        assert len(said) == len(sound) and str(path) in said[0] and "is made again" in said[0]
        path.write_bytes(sound)
        assert kept.get(name, codec) is not None and kept.get("none", codec) is None and len(said) == len(sound)
        said.clear()


@pytest.mark.parametrize("shape", [(), (0, 7), (2, 3)])
def test_arrays_of_any_shape_come_back(tmp_path: Path, shape: tuple[int, ...]) -> None:
    kept = Artefacts(tmp_path)
    kept.put("a", np.full(shape, 2.5, np.float64), ARRAY)
    found = kept.get("a", ARRAY)
    assert found is not None and found.shape == shape and found.dtype == np.float64 and (found == 2.5).all()


def test_light_of_the_first_version_is_read(tmp_path: Path) -> None:
    head = b'{"about":{"size":0.5},"arrays":{"values":["<f4",[2],0]},"bytes":64}\n'
    text = arrays._MAGIC_1 + head
    path = tmp_path / "a.array"
    path.write_bytes(text + bytes(-len(text) % 64) + np.array([1, 2], "<f4").tobytes().ljust(64, b"\0"))
    found = Artefacts(tmp_path).get("a", ARRAY)
    assert found is not None and found.tolist() == [1, 2] and arrays.maker_of(path) == ""


def test_what_a_job_did_not_make_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The oldest of what it made itself goes, but what is in use and a reserve."""
    monkeypatch.setattr(artefacts, "_MOST_UNUSED", 1000)
    one, other = Artefacts(tmp_path, "one"), Artefacts(tmp_path, "other")
    for i in range(6):
        (one if i % 2 else other).put(f"a{i}", np.zeros(40), ARRAY)
        os.utime(tmp_path / f"a{i}.array", (1000 + i, 1000 + i))
    one.tidy({"a1"}, since=1000)
    assert len(one.files()) == 6  # made or used after that
    one.tidy({"a1"}, since=2000)
    assert [path.stem for path in one.files()] == ["a0", "a1", "a2", "a4", "a5"]
    assert one.get("a1", ARRAY) is not None
    other.get("a0", ARRAY)
    other.tidy((), since=2000)
    assert [path.stem for path in one.files()] == ["a0", "a1", "a4", "a5"]  # what was read is in use
