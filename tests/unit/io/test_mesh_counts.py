"""PLY and STL meshes whose headers count other rows than are there: one line that says which, and how many."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest

from mirelight.base.errors import InputError
from mirelight.io.mesh import read_mesh

TEXT = b"0 0 0\n1 0 0\n0 1 0\n3 0 1 2"
BINARY = struct.pack("<9fB3i", 0, 0, 0, 1, 0, 0, 0, 1, 0, 3, 0, 1, 2)


def ply(form: str, vertices: object, faces: object) -> bytes:
    """A triangle under a header with those counts."""
    head = f"""ply
format {form} 1.0
element vertex {vertices}
property float x
property float32 y
property float z
element face {faces}
property list uchar int vertex_indices
end_header
"""
    return head.encode() + (TEXT if form == "ascii" else BINARY)


def stl(count: int) -> bytes:
    """A triangle under a header with that count."""
    return bytes(80) + struct.pack("<I12fH", count, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0)


def refused(tmp_path: Path, name: str, data: bytes) -> str:
    """The line, of a file with that content."""
    (tmp_path / name).write_bytes(data)
    with pytest.raises(InputError) as caught:
        read_mesh(tmp_path / name)
    return str(caught.value).removeprefix(str(tmp_path))


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian"])
def test_counts_of_ply(tmp_path: Path, form: str) -> None:
    (tmp_path / "a.ply").write_bytes(ply(form, 3, 1))
    assert len(read_mesh(tmp_path / "a.ply").faces) == 1
    for count in (2**31, 10**18, 10**25):
        line = refused(tmp_path, "a.ply", ply(form, count, 1))
        assert line.startswith(f"/a.ply: element vertex: {count:,} rows take") and "truncated or damaged" in line
        assert refused(tmp_path, "a.ply", ply(form, 3, count)).startswith(f"/a.ply: element face: {count:,} rows take")
    for word in (-3, "three", "\u00b2"):
        assert "element face: a count of" in refused(tmp_path, "a.ply", ply(form, 3, word))


def test_what_is_left_is_told_in_bytes(tmp_path: Path) -> None:
    line = refused(tmp_path, "a.ply", ply("binary_big_endian", 5, 1))
    assert "5 rows take 60 bytes at least, 49 are left" in line


@pytest.mark.parametrize("count", [0, 2, 2**32 - 1])
def test_count_of_stl(tmp_path: Path, count: int) -> None:
    (tmp_path / "a.stl").write_bytes(stl(1))
    assert len(read_mesh(tmp_path / "a.stl").faces) == 1
    found = f"/a.stl: number of triangles (byte 80): {count:,} triangles take {50 * count:,} bytes, 50 are left"
    assert refused(tmp_path, "a.stl", stl(count)).startswith(found)


def test_stl_that_ends_in_its_header(tmp_path: Path) -> None:
    assert "82 bytes, less than the header's 84" in refused(tmp_path, "a.stl", stl(1)[:82])


def test_stl_of_text_and_binary_ones_that_begin_like_it(tmp_path: Path) -> None:
    corners = "".join(f"vertex {x}\n" for x in ("0 0 0", "1 0 0", "0 1 0"))
    text = f"solid a\nfacet normal 0 0 1\nouter loop\n{corners}endloop\nendfacet\nendsolid a\n"
    (tmp_path / "a.stl").write_text(text)
    assert len(read_mesh(tmp_path / "a.stl").faces) == 1
    (tmp_path / "a.stl").write_bytes(b"solid" + stl(1)[5:])
    assert len(read_mesh(tmp_path / "a.stl").faces) == 1
    assert "7 triangles take 350 bytes" in refused(tmp_path, "a.stl", b"solid" + stl(7)[5:])
