"""The container: chunks, buffers, views, accessors, and what is refused."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from mirelight.base.errors import InputError
from mirelight.io.gltf.accessors import read_accessor
from mirelight.io.gltf.document import read_document


def read(glb: Any, index: int = 0) -> NDArray[Any]:
    return read_accessor(read_document(glb.save()), index)


@pytest.mark.parametrize("kind", ["i1", "u1", "i2", "u2", "u4", "f4"])
@pytest.mark.parametrize("width", [1, 2, 3, 4])
def test_every_component_type(glb: Any, kind: str, width: int) -> None:
    values = np.random.default_rng(3).integers(0, 100, (7, width)).astype(kind)
    glb.view(b"x")  # so that offsets are not zero
    glb.accessor(values)
    found = read(glb)
    assert found.dtype == np.dtype(kind)
    assert np.array_equal(found, values)


def test_normalised_integers_follow_the_specification(glb: Any) -> None:
    glb.accessor(np.array([0, 51, 255], dtype=np.uint8), normalized=True)
    glb.accessor(np.array([-128, -127, 0, 127], dtype=np.int8), normalized=True)
    glb.accessor(np.array([-32768, -32767, 16384], dtype=np.int16), normalized=True)
    document = read_document(glb.save())
    assert read_accessor(document, 0)[:, 0].tolist() == pytest.approx([0, 0.2, 1])
    assert read_accessor(document, 1)[:, 0].tolist() == pytest.approx([-1, -1, 0, 1])
    assert read_accessor(document, 2)[:, 0].tolist() == pytest.approx([-1, -1, 16384 / 32767])


@pytest.mark.parametrize("stride", [12, 16, 28])
def test_interleaved_vertices(glb: Any, stride: int) -> None:
    values = np.arange(15, dtype=np.float32).reshape(5, 3)
    data = np.zeros((5, stride), dtype=np.uint8)
    data[:, :12] = values.view(np.uint8).reshape(5, 12)
    view = glb.view(data.tobytes()[: 4 * stride + 12], byteStride=stride)
    glb.put("accessors", {"bufferView": view, "componentType": 5126, "count": 5, "type": "VEC3"})
    assert np.array_equal(read(glb), values)


def test_unaligned_bytes_are_read_right(glb: Any) -> None:
    values = np.arange(6, dtype=np.float32)
    view = glb.view(b"\1" + values.tobytes())
    glb.put("accessors", {"bufferView": view, "byteOffset": 1, "componentType": 5126, "count": 6, "type": "SCALAR"})
    assert np.array_equal(read(glb)[:, 0], values)


def test_matrix_columns_start_on_four_bytes(glb: Any) -> None:
    columns = np.arange(1, 10, dtype=np.uint8).reshape(3, 3)
    padded = np.zeros((3, 4), dtype=np.uint8)
    padded[:, :3] = columns
    view = glb.view(padded.tobytes() * 2)
    glb.put("accessors", {"bufferView": view, "componentType": 5121, "count": 2, "type": "MAT3"})
    assert np.array_equal(read(glb), np.tile(columns.reshape(1, 9), (2, 1)))


@pytest.mark.parametrize("based", [True, False])
def test_sparse_substitution(glb: Any, based: bool) -> None:
    base = np.ones((6, 3), dtype=np.float32)
    rows, values = np.array([1, 4], dtype=np.uint16), np.full((2, 3), 9, dtype=np.float32)
    index = glb.accessor(base)
    glb.top["accessors"][index]["sparse"] = {
        "count": 2,
        "indices": {"bufferView": glb.view(rows.tobytes()), "componentType": 5123},
        "values": {"bufferView": glb.view(values.tobytes())},
    }
    if not based:
        del glb.top["accessors"][index]["bufferView"]
    expected = base if based else np.zeros_like(base)
    expected = expected.copy()
    expected[rows] = 9
    assert np.array_equal(read(glb), expected)


def test_data_uri_and_neighbouring_file(glb: Any, tmp_path: Path) -> None:
    values = np.arange(9, dtype=np.float32).reshape(3, 3)
    glb.accessor(values)
    assert np.array_equal(read_accessor(read_document(glb.save_gltf()), 0), values)
    (tmp_path / "sub folder").mkdir()
    (tmp_path / "sub folder" / "data.bin").write_bytes(glb.binary)
    path = glb.save_gltf("sub%20folder/data.bin")
    assert np.array_equal(read_accessor(read_document(path), 0), values)


@pytest.mark.parametrize(
    "uri",
    [
        "../secret.bin",
        "/etc/passwd",
        "a/../../secret.bin",
        "http://x/y.bin",
        "file:///etc/passwd",
        "link.bin",
        "",
        "%00",
    ],
)
def test_no_uri_leaves_the_folder(glb: Any, tmp_path: Path, uri: str) -> None:
    inner = tmp_path / "inner"
    inner.mkdir()
    (tmp_path / "secret.bin").write_bytes(b"\0" * 64)
    (inner / "link.bin").symlink_to(tmp_path / "secret.bin")
    glb.folder = inner
    glb.accessor(np.zeros((3, 3), dtype=np.float32))
    path = glb.save_gltf(uri or "x")
    if not uri:
        top = json.loads(path.read_text(encoding="utf-8"))
        top["buffers"][0]["uri"] = ""
        path.write_text(json.dumps(top), encoding="utf-8")
    with pytest.raises(InputError, match=r"buffers\[0\]\.uri"):
        read_accessor(read_document(path), 0)


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ({"count": 4}, "accessors\\[0\\].count: 4 elements need 48 bytes, the buffer view has 36"),
        ({"count": 2**40}, "accessors\\[0\\].count"),
        ({"count": 0}, "accessors\\[0\\].count: 0"),
        ({"count": -1}, "accessors\\[0\\].count: -1"),
        ({"count": "3"}, "accessors\\[0\\].count: '3', expected an integer"),
        ({"count": 1e300}, "accessors\\[0\\].count: a huge integer"),
        ({"byteOffset": 30}, "accessors\\[0\\].count"),
        ({"componentType": 5130}, "componentType: 5130"),
        ({"type": "VEC9"}, "accessors\\[0\\].type"),
        ({"bufferView": 7}, "there is no bufferViews\\[7\\]"),
        ({"bufferView": None}, "accessors\\[0\\].bufferView: null"),
        ({"normalized": 1}, "normalized: 1, expected true or false"),
    ],
)
def test_bad_accessors_are_refused_before_memory_is_taken(glb: Any, entry: dict[str, Any], message: str) -> None:
    glb.accessor(np.zeros((3, 3), dtype=np.float32))
    glb.top["accessors"][0] |= entry
    with pytest.raises(InputError, match=message):
        read(glb)


def test_a_huge_count_without_bytes_is_refused(glb: Any) -> None:
    glb.put("accessors", {"componentType": 5126, "count": 2**40, "type": "VEC3"})
    with pytest.raises(InputError, match="without a bufferView"):
        read(glb)


def test_views_stay_inside_their_buffer(glb: Any) -> None:
    glb.accessor(np.zeros((3, 3), dtype=np.float32))
    glb.top["bufferViews"][0]["byteLength"] = 64
    with pytest.raises(InputError, match=r"bufferViews\[0\]\.byteLength: bytes 0 to 64 of a buffer of 36"):
        read(glb)


def test_a_required_extension_that_is_not_handled_is_named(glb: Any) -> None:
    glb.top["extensionsRequired"] = ["KHR_mesh_quantization", "KHR_texture_basisu"]
    with pytest.raises(InputError, match=r"extensionsRequired: the extension 'KHR_texture_basisu'.*ktxdecompress"):
        read_document(glb.save())


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "no glTF file: it is empty; give a"),
        (b"glTF", "truncated"),
        (b"hello world, this is not glTF", "no glTF file: there is no JSON in it; give a"),
        (b"{hello world", "line 1, column 2: bad JSON"),
        (b"\xff\xfe\x00{}", "no glTF file: neither GLB nor UTF-8 JSON; give a"),
        (b"[]", "no glTF file: its JSON is not an object"),
        (b"[" * 100_000, "nesting too large"),
        (b'{"asset": {"version": "1.0"}}', "asset.version: glTF 1.0"),
        (b'{"asset": {}}', "asset.version: missing"),
        (b'{"asset": {"version": ' + b"9" * 5000 + b"}}", "too large to read|expected a string"),
        (struct.pack("<5I", 0x46546C67, 1, 20, 0, 0x4E4F534A), "GLB version 1"),
        (struct.pack("<5I", 0x46546C67, 2, 999, 0, 0x4E4F534A), "promises 999 bytes"),
        (struct.pack("<5I", 0x46546C67, 2, 20, 99, 0x4E4F534A), "JSON chunk"),
    ],
)
def test_files_that_are_not_gltf(tmp_path: Path, data: bytes, message: str) -> None:
    path = tmp_path / "x.glb"
    path.write_bytes(data)
    with pytest.raises(InputError, match=message) as error:
        read_document(path)
    assert "\n" not in str(error.value)


def test_missing_file_and_folder(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        read_document(tmp_path / "absent.glb")
    with pytest.raises(InputError, match="not a file"):
        read_document(tmp_path)


def test_a_truncated_glb_is_one_clear_line(glb: Any, tmp_path: Path) -> None:
    glb.node(mesh=glb.mesh(glb.primitive()))
    data = glb.bytes()
    for length in range(0, len(data), 7):
        path = tmp_path / "cut.glb"
        path.write_bytes(data[:length])
        with pytest.raises(InputError):
            read_document(path)
