"""Digests of inputs: of single files, of heads with the files they name, of folders."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

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


def test_a_folder_counts_with_all_its_files(tmp_path: Path) -> None:
    files = {"meta.json": b"{}", "means_l.webp": b"pixels"}
    write(tmp_path, files)
    assert digest(tmp_path) == listed(files)


def test_names_that_leave_the_folder_are_not_followed(tmp_path: Path) -> None:
    write(
        tmp_path, {"secret": b"s", "in/a.gltf": json.dumps({"uri": ["../secret", "/etc/passwd", "b%20c.bin"]}).encode()}
    )
    alone = digest(tmp_path / "in" / "a.gltf")
    assert alone == sha((tmp_path / "in" / "a.gltf").read_bytes())
    (tmp_path / "in" / "b c.bin").write_bytes(b"1")
    assert digest(tmp_path / "in" / "a.gltf") != alone
