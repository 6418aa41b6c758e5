"""Damaged and hostile splat files: one clear line each, and no memory taken for what they only claim."""

from __future__ import annotations

import io
import json
import os
import shutil
import stat
import struct
import subprocess
import sys
import tracemalloc
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zstandard
from PIL import Image

from mirelight.base.errors import InputError
from mirelight.io import safety, splats

from . import truth

MOST_MEMORY = 24 << 20  # bytes; no file here has more than 400 splats


def refused(path: Path, said: str) -> str:
    """Both calls refuse the file in one line that names it, with little memory; `summary` may also accept it."""
    tracemalloc.start()
    try:
        with pytest.raises(InputError, match=said) as raised:
            splats.read(path)
        assert tracemalloc.get_traced_memory()[1] < MOST_MEMORY
    finally:
        tracemalloc.stop()
    try:
        splats.summary(path)
    except InputError as error:
        assert "\n" not in str(error)
    text = str(raised.value)
    assert "\n" not in text
    assert path.name in text or path.parent.name in text
    return text


# --- SPZ -------------------------------------------------------------------------------------------------------------


def gzipped(data: bytes) -> bytes:
    packer = zlib.compressobj(9, wbits=31)
    return packer.compress(data) + packer.flush()


def spz_head(version: int = 3, count: int = 1, degree: int = 0, bits: int = 12, magic: bytes = b"NGSP") -> bytes:
    return struct.pack("<4sIIBBBB", magic, version, count, degree, bits, 0, 0)


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (gzipped(spz_head(count=4_000_000_000) + bytes(1000)), "damaged or hostile"),
        (gzipped(spz_head(count=0)), "damaged or hostile"),
        (gzipped(spz_head(count=100) + bytes(1000)), "ends early"),
        (gzipped(spz_head(version=9) + bytes(1000)), "version 9"),
        (gzipped(spz_head(degree=7) + bytes(1000)), "SH degree 7"),
        (gzipped(spz_head(bits=60) + bytes(1000)), "60 fractional bits"),
        (gzipped(spz_head(magic=b"NOPE") + bytes(1000)), "not an SPZ"),
        (gzipped(b"too short"), "ends early"),
        (gzipped(spz_head() + bytes(100))[:-12], "ends early|gzip"),
        (b"\x1f\x8b" + bytes(50), "gzip"),
        (b"NGSP" + bytes(5), "truncated"),
        (b"NGSP" + struct.pack("<IIBBBBI", 4, 2**31, 0, 12, 0, 5, 32) + bytes(112), "damaged or hostile"),
        (b"NGSP" + struct.pack("<IIBBBBI", 4, 10, 0, 12, 0, 5, 32) + bytes(112), "for 0, expected 90"),
        (b"NGSP" + struct.pack("<IIBBBBI", 4, 10, 0, 12, 0, 5, 9999) + bytes(112), "table at byte 9999"),
        (b"NGSP" + struct.pack("<IIBBBBI", 4, 10, 0, 12, 0, 200, 32) + bytes(112), "200 streams"),
    ],
)
def test_spz(tmp_path: Path, data: bytes, said: str) -> None:
    path = tmp_path / "bad.spz"
    path.write_bytes(data)
    refused(path, said)


def test_spz_that_inflates_to_gigabytes(tmp_path: Path) -> None:
    """A splat is there, and then zeros without end: they are not inflated beyond what is looked at."""
    packer = zlib.compressobj(9, wbits=31)
    data = packer.compress(spz_head() + bytes([0] * 9 + [255] + [128] * 6 + [0, 0, 0, 192]))
    zeros = bytes(1 << 20)
    data += b"".join(packer.compress(zeros) for _ in range(512)) + packer.flush()
    path = tmp_path / "bomb.spz"
    path.write_bytes(data)
    tracemalloc.start()
    assert len(splats.read(path)) == 1
    assert tracemalloc.get_traced_memory()[1] < MOST_MEMORY
    tracemalloc.stop()


def ngsp(streams: list[bytes], sizes: list[int], count: int) -> bytes:
    head = b"NGSP" + struct.pack("<IIBBBBI", 4, count, 0, 12, 0, len(streams), 32) + bytes(12)
    table = b"".join(struct.pack("<QQ", len(s), size) for s, size in zip(streams, sizes, strict=True))
    return head + table + b"".join(streams)


def test_zstd_streams_that_lie(tmp_path: Path) -> None:
    path = tmp_path / "lie.spz"
    sizes = [9, 1, 3, 3, 4]
    honest = [zstandard.compress(bytes([200]) * n) for n in sizes]
    path.write_bytes(ngsp(honest, sizes, 1))
    assert len(splats.read(path)) == 1
    bomb = zstandard.compress(bytes(1 << 28))
    path.write_bytes(ngsp([bomb, *honest[1:]], sizes, 1))
    tracemalloc.start()
    assert len(splats.read(path)) == 1  # its first nine bytes are as good as any
    assert tracemalloc.get_traced_memory()[1] < MOST_MEMORY
    tracemalloc.stop()
    path.write_bytes(ngsp([zstandard.compress(b"1234"), *honest[1:]], sizes, 1))
    refused(path, "'positions' ends early")
    path.write_bytes(ngsp([b"no zstd", *honest[1:]], sizes, 1))
    refused(path, "zstd")


# --- SOG -------------------------------------------------------------------------------------------------------------


@pytest.fixture
def sog(tmp_path: Path) -> Path:
    folder = tmp_path / "capture"
    with zipfile.ZipFile(truth.DATA / "small.sog") as archive:
        archive.extractall(folder)
    return folder


def change_meta(folder: Path, change: Callable[[dict[str, Any]], None]) -> None:
    meta = json.loads((folder / "meta.json").read_text())
    change(meta)
    (folder / "meta.json").write_text(json.dumps(meta))


def set_file(name: str) -> Callable[[dict[str, Any]], None]:
    return lambda meta: meta["quats"].update(files=[name])


META = {
    "huge count": (lambda m: m.update(count=2**31 - 1), "free|pixels"),
    "count too large for the images": (lambda m: m.update(count=100000), "pixels for 100,000"),
    "no count": (lambda m: m.pop("count"), "count: missing"),
    "count of nothing": (lambda m: m.update(count=0), "no splats"),
    "count of text": (lambda m: m.update(count="many"), "expected an integer"),
    "version 3": (lambda m: m.update(version=3), "versions 1 and 2"),
    "no means": (lambda m: m.pop("means"), "means.files"),
    "nan bounds": (lambda m: m["means"].update(mins=[float("nan"), 0, 0]), "finite"),
    "two bounds": (lambda m: m["means"].update(mins=[0, 0]), "expected 3"),
    "short codebook": (lambda m: m["scales"].update(codebook=[1, 2]), "expected 256"),
    "bands": (lambda m: m["shN"].update(bands=9), "bands"),
    "wrong bands": (lambda m: m["shN"].update(bands=1), "SH palette"),
    "files of numbers": (lambda m: m["quats"].update(files=[3]), "expected a string"),
    "no files": (lambda m: m["quats"].update(files=[]), "expected 1"),
    "parent": (set_file("../quats.webp"), "leaves the folder"),
    "absolute": (set_file("/etc/passwd"), "not a relative path"),
    "drive": (set_file("C:/secret.webp"), "not a relative path"),
    "backslash": (set_file("..\\quats.webp"), "not a relative path"),
    "null": (set_file("a\0b"), "not a relative path"),
    "missing": (set_file("other.webp"), "other.webp"),
    "itself": (set_file("meta.json"), "not a readable image"),
    "itself as a folder": (set_file("."), "not a relative path"),
    "a folder": (set_file("sub"), "no file 'sub'"),
    "long": (set_file("x" * 5000), "is too long for a file name"),
}


@pytest.mark.parametrize("name", META)
def test_sog_meta(sog: Path, name: str) -> None:
    (sog.parent / "quats.webp").write_bytes((sog / "quats.webp").read_bytes())
    (sog / "sub").mkdir()
    change, said = META[name]
    change_meta(sog, change)
    refused(sog / "meta.json", said)


@pytest.mark.parametrize(
    "text", ["{", "[]", '"x"', "{}", "[" * 100000, '{"count": 1e999}', "\xff\xfe", '{"version":' + "9" * 5000 + "}"]
)
def test_sog_meta_that_is_no_meta(sog: Path, text: str) -> None:
    (sog / "meta.json").write_bytes(text.encode("latin-1"))
    with pytest.raises(InputError):
        splats.read(sog)


def test_sog_link_out_of_the_folder(sog: Path) -> None:
    outside = sog.parent / "outside.webp"
    (sog / "quats.webp").rename(outside)
    (sog / "quats.webp").symlink_to(outside)
    refused(sog / "meta.json", "leaves the folder")


def test_sog_images_of_other_kinds(sog: Path) -> None:
    image = sog / "quats.webp"
    Image.new("RGBA", (5000, 5000)).save(image, lossless=True)  # a few hundred bytes that decode to 100 MB
    refused(sog / "meta.json", "5000 x 5000 pixels")
    Image.new("RGBA", (4, 4)).save(image, lossless=True)
    refused(sog / "meta.json", "4 x 4 pixels for 60")
    noise = np.random.default_rng(0).integers(0, 255, (8, 8, 3), dtype=np.uint8)
    Image.fromarray(noise).save(image, lossless=False)
    refused(sog / "meta.json", "lossy")
    Image.new("RGB", (8, 8)).save(image, format="GIF")
    refused(sog / "meta.json", "not a readable image")
    image.write_bytes((truth.DATA / "small.sog").read_bytes()[:200])
    refused(sog / "meta.json", "not a readable image")


def test_sog_images_may_be_png(sog: Path) -> None:
    wanted = splats.read(sog)
    with Image.open(sog / "quats.webp") as image:
        image.convert("RGBA").save(sog / "quats.png")
    change_meta(sog, set_file("quats.png"))
    np.testing.assert_array_equal(splats.read(sog).quats, wanted.quats)


def bundle(folder: Path, replaced: dict[str, bytes]) -> Path:
    """The .sog again with some members replaced, deflated."""
    path = folder / "bundle.sog"
    with zipfile.ZipFile(truth.DATA / "small.sog") as old, zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as new:
        for name in old.namelist():
            new.writestr(name, replaced.get(name, old.read(name)))
    return path


@pytest.mark.parametrize("member", ["quats.webp", "means_l.webp", "meta.json"])
def test_sog_members_that_unpack_to_gigabytes(tmp_path: Path, member: str) -> None:
    refused(bundle(tmp_path, {member: bytes(200 << 20)}), "unpacks to more than")


def test_sog_member_that_hides_its_size(tmp_path: Path) -> None:
    """The directory says 100 bytes where 50 MB are packed."""
    path = bundle(tmp_path, {"quats.webp": bytes(50 << 20)})
    data = bytearray(path.read_bytes())
    size = struct.pack("<I", 50 << 20)
    while (at := data.find(size)) >= 0:
        data[at : at + 4] = struct.pack("<I", 100)
    path.write_bytes(bytes(data))
    refused(path, r"quats\.webp")


def test_sog_without_members(tmp_path: Path) -> None:
    path = tmp_path / "empty.sog"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("readme.txt", "no splats")
    refused(path, r"meta\.json")
    path.write_bytes(b"PK\x03\x04 and nothing more")
    refused(path, "ZIP")
    path.write_bytes((truth.DATA / "small.sog").read_bytes()[:-30])
    refused(path, "ZIP")


# --- streamed SOG ----------------------------------------------------------------------------------------------------


def leaf(**values: int) -> dict[str, Any]:
    return {"lods": {"0": {"file": 0, "offset": 0, "count": 60} | values}}


STREAMED = {
    "range beyond": ({"tree": leaf(offset=1)}, "1 to 61 of 60"),
    "huge range": ({"tree": leaf(count=2**40)}, "of 60"),
    "twice": ({"tree": {"children": [leaf(), leaf()]}}, "two leaves"),
    "file number": ({"tree": leaf(file=77)}, "expected 0 to 1"),
    "no tree": ({"tree": {}, "environment": None}, "no splats of level 0"),
    "no levels": ({"lodLevels": 0}, "lodLevels"),
    "version": ({"version": 7}, "version 1"),
    "traversal": ({"filenames": ["../../x/meta.json", "1_0/meta.json"]}, "leaves the folder"),
    "absent": ({"filenames": ["9_9/meta.json", "1_0/meta.json"]}, "no file '9_9"),
    "environment": ({"environment": "/etc/meta.json"}, "not a relative path"),
}


@pytest.mark.parametrize("name", STREAMED)
def test_streamed_sog(tmp_path: Path, name: str) -> None:
    change, said = STREAMED[name]
    folder = tmp_path / "streamed"
    shutil.copytree(truth.DATA / "streamed", folder)
    meta = json.loads((folder / "lod-meta.json").read_text()) | change
    (folder / "lod-meta.json").write_text(json.dumps({k: v for k, v in meta.items() if v is not None}))
    refused(folder / "lod-meta.json", said)


READ_WATCHED = """
import os, sys
from mirelight.io import splats
opened = []
watched = "open", "os.scandir", "os.listdir"
sys.addaudithook(lambda event, args: opened.append(args[0]) if event in watched else None)
splats.read(sys.argv[1])
for path in opened:
    if isinstance(path, (str, os.PathLike)):
        print(os.path.realpath(path))
"""


@pytest.mark.parametrize(("name", "head"), [("streamed", "lod-meta.json"), ("sog", "meta.json")])
def test_only_files_that_the_index_names_are_read(tmp_path: Path, name: str, head: str) -> None:
    """Whatever else lies in the folder, pipes and files with the names of a set among them, is not opened."""
    folder = tmp_path / name
    if name == "streamed":
        shutil.copytree(truth.DATA / name, folder)
    else:
        with zipfile.ZipFile(truth.DATA / "small.sog") as archive:
            archive.extractall(folder)
    named = {str(x.relative_to(folder)) for x in folder.rglob("*") if x.is_file()}
    for other in ("9_9", "."):
        (folder / other).mkdir(exist_ok=True)
        for more in ("centroids.webp", "extra.ply", "meta.json.bak"):
            (folder / other / more).write_bytes(b"x")
        os.mkfifo(folder / other / "quats.png")
    command = [sys.executable, "-c", READ_WATCHED, str(folder / head)]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=120)
    own = f"{folder.resolve()}/"
    inside = {x.removeprefix(own) for x in done.stdout.splitlines() if x.startswith(own)}
    assert head in inside
    assert inside <= named


# --- anything --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "data", "said"),
    [
        ("a.txt", b"hello", "not a splat file"),
        ("a.splat", bytes(33), "32-byte"),
        ("a.ply", b"ply", "not a PLY"),
        ("a.ply", b"plywood", "not a PLY"),
        ("a.glb", b"glTF", "truncated"),
        ("a.glb", b"", "no glTF file: it is empty"),
        ("a.glb", b"\x93\xf1" * 40, "no glTF file"),
        ("a.gltf", b"{}", "asset"),
        ("a.compressed.ply", b"", "empty"),
    ],
)
def test_files_of_no_format(tmp_path: Path, name: str, data: bytes, said: str) -> None:
    path = tmp_path / name
    path.write_bytes(data)
    refused(path, said)


def test_paths_that_lead_nowhere(tmp_path: Path) -> None:
    for path, said in (
        (tmp_path / "none.ply", "no such file"),
        (tmp_path, "and no SOG"),
        (tmp_path / ("x" * 400), "cannot be read|no such file"),
        (tmp_path / "a\0b", "cannot be read|no such file"),
    ):
        with pytest.raises(InputError, match=said):
            splats.read(path)
    os.mkfifo(tmp_path / "pipe.ply")
    with pytest.raises(InputError, match="neither a file nor a folder"):
        splats.read(tmp_path / "pipe.ply")


@pytest.mark.parametrize(
    "name", ["cloud.compressed.ply", "cloud_v3.spz", "cloud_v4.spz", "small.sog", "small.glb", "small.splat"]
)
def test_more_than_the_memory_that_is_free(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    monkeypatch.setattr(safety, "free_memory", lambda: 1000)
    with pytest.raises(InputError, match=r"0\.0 GiB are free"):
        splats.read(truth.DATA / name)


# --- other tools' formats --------------------------------------------------------------------------------------------


def put_tool(folder: Path, monkeypatch: pytest.MonkeyPatch, script: str) -> None:
    """A command splat-transform, alone on the search path with the system's own."""
    tool = folder / "bin" / "splat-transform"
    tool.parent.mkdir(exist_ok=True)
    tool.write_text("#!/bin/sh\n" + script, encoding="utf-8")
    tool.chmod(tool.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("PATH", f"{tool.parent}:/usr/bin:/bin")


@pytest.mark.parametrize(("name", "lod", "level"), [("b.lcc", 2, "2"), ("c.LCC2", None, "0")])
def test_handing_to_splat_transform(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, lod: int | None, level: str
) -> None:
    splats.write(truth.cloud(7, 1), tmp_path / "ready.ply")
    (tmp_path / name).write_bytes(b"whatever")
    script = f'echo "$@" > {tmp_path}/said\nfor last; do :; done\ncp {tmp_path}/ready.ply "$last"\n'
    put_tool(tmp_path, monkeypatch, script)
    found = splats.read(tmp_path / name, lod=lod)
    np.testing.assert_array_equal(found.means, truth.cloud(7, 1).means)
    said = (tmp_path / "said").read_text().split()
    assert str(tmp_path / name) in said
    assert said[1:3] == ["--lod-select", level]
    assert splats.summary(tmp_path / name, lod=lod).count == 7
    assert not Path(said[-1]).exists()  # the temporary folder is gone


def test_a_tool_that_fails_or_is_absent(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.lcc"
    path.write_bytes(b"whatever")
    monkeypatch.setenv("PATH", str(tmp_path / "nothing"))
    refused(path, "npm install -g @playcanvas/splat-transform")
    put_tool(tmp_path, monkeypatch, "echo reading >&2; echo bad header >&2; exit 1\n")
    refused(path, "bad header")
    put_tool(tmp_path, monkeypatch, "echo '  ✗ Error: bad version' >&2; echo '  at file.mjs:3' >&2; exit 1\n")
    refused(path, "convert it: Error: bad version")


def test_in_memory_helpers_agree() -> None:
    """The bomb tests rest on zlib and zipfile packing zeros small."""
    assert len(gzipped(bytes(1 << 20))) < 2000
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("zeros", bytes(1 << 20))
    assert len(packed.getvalue()) < 2000
