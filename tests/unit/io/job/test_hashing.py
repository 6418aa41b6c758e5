"""Digests of inputs: of single files, of heads with the files they name, of folders."""

from __future__ import annotations

import hashlib
import json
import os
import struct
from pathlib import Path
from typing import Any

import pytest

from mirelight.base.errors import InputError
from mirelight.io.job.hashing import digest


def sha(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def listed(files: dict[str, bytes]) -> str:
    return sha("".join(f"{name}\0{sha(data)}\n" for name, data in sorted(files.items())).encode())


def write(folder: Path, files: dict[str, bytes]) -> None:
    for name, data in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(data)


def test_a_file_has_the_digest_that_sha256sum_prints(tmp_path: Path) -> None:
    (tmp_path / "a.ply").write_bytes(b"abc")
    assert digest(tmp_path / "a.ply") == "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"


def test_the_folder_of_a_training_counts_as_its_last_splats(tmp_path: Path) -> None:
    write(tmp_path, {f"point_cloud/iteration_{n}/point_cloud.ply": f"{n}".encode() for n in (7000, 30_000)})
    assert digest(tmp_path) == sha(b"30000")


def test_a_streamed_sog_counts_with_all_levels(tmp_path: Path) -> None:
    meta = json.dumps({"means": {"files": ["means_l.webp"]}}).encode()
    files = {
        "lod-meta.json": json.dumps({"filenames": ["0_0/meta.json"], "count": 3}).encode(),
        "0_0/meta.json": meta,
        "0_0/means_l.webp": b"pixels",
    }
    write(tmp_path, {**files, "unrelated.txt": b"x"})
    before = digest(tmp_path / "lod-meta.json")
    assert before == listed(files)
    (tmp_path / "unrelated.txt").write_bytes(b"y")
    assert digest(tmp_path / "lod-meta.json") == before
    (tmp_path / "0_0" / "means_l.webp").write_bytes(b"Pixels")
    assert digest(tmp_path / "lod-meta.json") != before


def test_a_folder_counts_with_the_files_that_its_index_names(tmp_path: Path) -> None:
    files = {"meta.json": b'{"means": {"files": ["means_l.webp"]}}', "means_l.webp": b"pixels"}
    write(tmp_path, {**files, "unrelated.txt": b"x"})
    assert digest(tmp_path) == listed(files)


def test_a_folder_without_an_index_is_not_read(tmp_path: Path) -> None:
    (tmp_path / "large").mkdir()
    os.mkfifo(tmp_path / "large" / "pipe")
    with pytest.raises(InputError, match=r"a folder, and no SOG"):
        digest(tmp_path)


def test_names_that_leave_the_folder_are_not_followed(tmp_path: Path) -> None:
    uris = [{"uri": uri} for uri in ("../secret", "/etc/passwd", "link", "b%20c.bin")]
    write(tmp_path, {"secret": b"s", "in/a.gltf": json.dumps({"buffers": uris}).encode()})
    (tmp_path / "in" / "link").symlink_to(tmp_path / "secret")
    alone = digest(tmp_path / "in" / "a.gltf")
    assert alone == sha((tmp_path / "in" / "a.gltf").read_bytes())
    (tmp_path / "in" / "b c.bin").write_bytes(b"1")
    assert digest(tmp_path / "in" / "a.gltf") != alone


def test_companions_of_meshes_count(tmp_path: Path) -> None:
    top = json.dumps({"asset": {"version": "2.0"}, "images": [{"uri": "skin.png"}]}).encode()
    top += b" " * (-len(top) % 4)
    glb = struct.pack("<4s4I", b"glTF", 2, 20 + len(top), len(top), 0x4E4F534A) + top
    write(
        tmp_path,
        {
            "a.glb": glb,
            "a.gltf": top,
            "a.obj": b"mtllib a.mtl\nv 0 0 0\n",
            "a.mtl": b"newmtl red\nmap_Kd skin.png\n",
            "a.ply": b"ply\ncomment TextureFile skin.png\nend_header\n",
            "skin.png": b"1",
        },
    )
    heads = ("a.glb", "a.gltf", "a.obj", "a.ply")
    first = [digest(tmp_path / head) for head in heads]
    assert len({*first}) == len(heads)
    (tmp_path / "skin.png").write_bytes(b"22")
    second = [digest(tmp_path / head) for head in heads]
    assert not {*first} & {*second}
    (tmp_path / "a.mtl").write_bytes(b"newmtl blue\nmap_Kd skin.png\n")
    assert [digest(tmp_path / head) != old for head, old in zip(heads, second, strict=True)] == [
        False,
        False,
        True,
        False,
    ]


def test_index_files_that_name_each_other_end(tmp_path: Path) -> None:
    names = [f"{i}/lod-meta.json" for i in range(30)]
    body = json.dumps({"filenames": ["lod-meta.json", *names, *(f"../{x}" for x in names)]}).encode()
    write(tmp_path, dict.fromkeys(("lod-meta.json", *names), body))
    assert digest(tmp_path / "lod-meta.json") == listed(dict.fromkeys(("lod-meta.json", *names), body))


def test_a_file_is_read_once_until_it_changes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read: list[str] = []
    real = hashlib.file_digest

    def counted(file: Any, kind: str) -> Any:
        read.append(file.name)
        return real(file, kind)

    monkeypatch.setattr(hashlib, "file_digest", counted)
    file = tmp_path / "sky.hdr"
    file.write_bytes(b"one")
    assert {digest(file) for _ in range(50)} == {sha(b"one")}
    assert len(read) == 1
    file.write_bytes(b"three")
    assert digest(file) == sha(b"three")
    assert len(read) == 2


def test_terabytes_of_nothing_are_refused_at_once(tmp_path: Path) -> None:
    with (tmp_path / "large.ply").open("wb") as file:
        file.truncate(2**42)
    with pytest.raises(InputError, match=r"its bytes take 4,096\.0 GiB"):
        digest(tmp_path / "large.ply")


def test_names_that_are_not_utf8_have_a_digest(tmp_path: Path) -> None:
    name = os.fsdecode(b"\xff.bin")
    write(tmp_path, {name: b"x", "a.gltf": json.dumps({"buffers": [{"uri": name}]}).encode()})
    assert len(digest(tmp_path / "a.gltf")) == 64
