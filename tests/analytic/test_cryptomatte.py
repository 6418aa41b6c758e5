"""Cryptomattes: written by the command, decoded here by nothing but the standard and the EXR library, against areas."""

from __future__ import annotations

import json
import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest

import mirelight
from mirelight.cli import main
from mirelight.io.cryptomatte import identity, murmur3
from mirelight.lighting.mattes import RANKS, SAMPLES, Mattes, ranked
from mirelight.model import Camera, Material, ProxyMesh

from .lighting_scenes import join, overhead, quad

CAMERA = overhead(8, 6, extent=8.0)  # a pixel is one unit


def panels(*places: tuple[float, float, float, float]) -> ProxyMesh:
    """Level rectangles from (x0, z0) to (x1, z1) on y = 0, each with a material of its own: wood, stone, ..."""
    made = [
        quad([(x0 + x1) / 2, 0, (z0 + z1) / 2], [(x1 - x0) / 2, 0, 0], [0, 0, (z1 - z0) / 2])
        for x0, z0, x1, z1 in places
    ]
    names = ("wood", "stone", "glass", "straw", "brick", "felt", "sand", "clay")
    return replace(
        join(*made),
        materials=tuple(Material(name=name) for name in names[: len(places)]),
        face_materials=np.repeat(np.arange(len(places)), 2).astype(np.int32),
    )


# --- the hash --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "seed", "expected"),
    [
        ("", 0, 0),
        ("", 1, 0x514E28B7),
        ("", 0xFFFFFFFF, 0x81F16F39),
        ("a", 0x9747B28C, 0x7FA09EA6),
        ("aa", 0x9747B28C, 0x5D211726),
        ("aaa", 0x9747B28C, 0x283E0130),
        ("aaaa", 0x9747B28C, 0x5A97808A),
        ("Hello, world!", 0x9747B28C, 0x24884CBA),
        ("The quick brown fox jumps over the lazy dog", 0x9747B28C, 0x2FA826CD),
    ],
)
def test_the_hash_has_its_published_values(text: str, seed: int, expected: int) -> None:
    assert murmur3(text.encode(), seed) == expected


@pytest.mark.parametrize(
    ("name", "value"),
    [("hello", 6.0705627102400005616e-17), ("cube", -4.08461912519e15), ("sphere", 2.79018604383e15)],
)
def test_a_name_is_the_float_that_other_programs_give_it(name: str, value: float) -> None:
    (found,) = struct.unpack("<f", struct.pack("<I", identity(name)))
    assert found == pytest.approx(value, rel=1e-6)


def test_no_name_is_an_infinite_or_denormal_number() -> None:
    bits = np.array([identity(f"part {i}") for i in range(5000)], dtype=np.uint32)
    exponent = bits >> 23 & 255
    assert exponent.min() >= 1 and exponent.max() <= 254 and len(np.unique(bits)) == 5000


# --- coverage --------------------------------------------------------------------------------------------------------


def test_shares_are_areas_the_largest_first() -> None:
    """A pixel of which 3/4 show wood and 1/4 stone, one with all of each, and one with a half."""
    matte = Mattes(panels((-4, -3, 0.75, 3), (0.75, -3, 2.5, 3))).of(CAMERA, "cryptomatte_material")
    assert matte.names == ("wood", "stone")
    expected = np.zeros((8, 2))
    expected[:4, 0], expected[4], expected[5, 1], expected[6, 1] = 1, (0.75, 0.25), 1, 0.5
    found = np.zeros((6, 8, 2))
    for rank in range(RANKS):
        for part in (0, 1):
            found[..., part] += np.where(matte.index[..., rank] == part, matte.share[..., rank], 0)
    np.testing.assert_allclose(found, np.broadcast_to(expected, (6, 8, 2)), atol=1 / SAMPLES)
    assert (matte.index[:, 4, :3] == (0, 1, -1)).all() and (matte.index[:, 6, :2] == (1, -1)).all()
    assert (matte.share[:, 7] == 0).all() and (matte.index[:, 7] == -1).all()


def test_ranks_count_what_is_seen() -> None:
    seen = np.array([[0, 3, 3, 3], [2, 2, 1, 1], [0, 0, 0, 0], [5, 1, 5, 0]], np.uint16)
    index, share = ranked(seen)
    assert index[:, :3].tolist() == [[2, -1, -1], [0, 1, -1], [-1, -1, -1], [4, 0, -1]]
    assert share[:, :3].tolist() == [[0.75, 0, 0], [0.5, 0.5, 0], [0, 0, 0], [0.5, 0.25, 0]]
    many = np.arange(SAMPLES, dtype=np.uint16)[None] % 8 + 1  # more things than ranks
    index, share = ranked(many)
    assert index.tolist() == [[0, 1, 2, 3, 4, 5]] and np.allclose(share, 1 / 8)


def test_parts_of_one_name_are_one(tmp_path: Path) -> None:
    proxy = panels((-4, -3, 0, 3), (0, -3, 4, 3))
    proxy = replace(proxy, materials=(Material(name="wood"), Material(name="wood")))
    matte = Mattes(proxy).of(CAMERA, "cryptomatte_material")
    assert matte.names == ("wood",) and (matte.share[..., 0] == 1).all()


def test_the_nearest_thing_is_seen_and_an_empty_proxy_shows_nothing() -> None:
    over = join(panels((-4, -3, 4, 3)), quad([0, 1, 0], [1, 0, 0], [0, 0, 1]))
    proxy = replace(over, face_nodes=np.array([0, 0, 1, 1], np.int32), nodes=("floor", "lid"))
    matte = Mattes(proxy).of(CAMERA, "cryptomatte_node")
    assert (matte.index[2:4, 3:5, 0] == 1).all() and (matte.index[..., 0] == 1).sum() == 4
    nothing = ProxyMesh(vertices=np.zeros((0, 3), np.float32), faces=np.zeros((0, 3), np.int32))
    assert (Mattes(nothing).of(CAMERA, "cryptomatte_node").index == -1).all()


# --- files -----------------------------------------------------------------------------------------------------------


def decoded(path: Path, layer: str) -> dict[str, np.ndarray[Any, np.dtype[np.float32]]]:
    """Coverage by name as the standard has it read: metadata of the layer, its manifest, pairs of channels."""
    with OpenEXR.File(str(path), separate_channels=True) as file:
        header, channels = dict(file.header()), {k: v.pixels.copy() for k, v in file.channels().items()}
        (key,) = {k.rsplit("/", 1)[0] for k, v in header.items() if k.endswith("/name") and v == layer}
    assert len(key) == len("cryptomatte/") + 7
    assert header[f"{key}/hash"] == "MurmurHash3_32" and header[f"{key}/conversion"] == "uint32_to_float32"
    assert "\\u" not in header[f"{key}/manifest"]  # letters as they are: Blender's reader drops backslashes
    names = {int(v, 16): k for k, v in json.loads(header[f"{key}/manifest"]).items()}
    out = {name: np.zeros(channels["R"].shape, np.float32) for name in names.values()}
    levels = sorted(
        {k.split(".")[0] for k in channels if k.startswith(layer) and k.split(".")[0][len(layer) :].isdigit()}
    )
    assert levels == [f"{layer}{i:02d}" for i in range(RANKS // 2)]
    before = np.full(channels["R"].shape, np.inf, np.float32)
    for level in levels:
        for ident, share in ("RG", "BA"):
            ids, shares = channels[f"{level}.{ident}"], channels[f"{level}.{share}"]
            assert ids.dtype == shares.dtype == np.float32
            assert (shares <= before).all()
            before = shares
            bits = np.ascontiguousarray(ids).view(np.uint32)
            assert set(np.unique(bits)) <= {0, *names}
            assert ((bits == 0) == (shares == 0)).all()
            for number, name in names.items():
                out[name] += np.where(bits == number, shares, 0)
    return out


def test_the_command_writes_what_other_programs_read(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A glTF file of two objects, the left one of two materials."""
    positions = np.array(
        [[-4, 0, -3], [-1.5, 0, -3], [-1.5, 0, 3], [-4, 0, 3], [1, 0, -3], [1, 0, 3], [4, 0, -3], [4, 0, 3]], np.float32
    )
    faces = [[0, 2, 1, 0, 3, 2], [1, 5, 4, 1, 2, 5], [4, 7, 6, 4, 5, 7]]
    data = positions.tobytes() + b"".join(np.array(x, "<u2").tobytes() for x in faces)
    (tmp_path / "a.bin").write_bytes(data)
    views = [{"buffer": 0, "byteOffset": 0, "byteLength": 96}]
    views += [{"buffer": 0, "byteOffset": 96 + 12 * i, "byteLength": 12} for i in range(3)]
    accessors = [{"bufferView": 0, "componentType": 5126, "count": 8, "type": "VEC3"}]
    accessors += [{"bufferView": 1 + i, "componentType": 5123, "count": 6, "type": "SCALAR"} for i in range(3)]
    part = [{"attributes": {"POSITION": 0}, "indices": 1 + i, "material": i} for i in range(3)]
    top = {
        "asset": {"version": "2.0"},
        "buffers": [{"uri": "a.bin", "byteLength": len(data)}],
        "bufferViews": views,
        "accessors": accessors,
        "materials": [{"name": "wood"}, {"name": "stöne"}, {}],
        "meshes": [{"primitives": part[:2], "name": "unused"}, {"primitives": part[2:], "name": "slab"}],
        "nodes": [{"mesh": 0, "name": "left"}, {"mesh": 1}],
        "scenes": [{"nodes": [0, 1]}],
        "scene": 0,
    }
    (tmp_path / "a.gltf").write_text(json.dumps(top), encoding="utf-8")
    (tmp_path / "job.toml").write_text(
        """
proxy = "a.gltf"
resolution = [8, 6]
render = { spp = 4, max_depth = 1 }
output = { half = true, png = false, aovs = ["cryptomatte_material", "cryptomatte_node"] }
environment = { radiance = 1 }
[[cameras]]
name = "top"
type = "orthographic"
position = [0, 9, 0]
target = [0, 0, 0]
up = [0, 0, -1]
ymag = 3
""",
        encoding="utf-8",
    )
    assert main(["render", str(tmp_path / "job.toml"), "-q"]) == 0, capsys.readouterr().err
    (path,) = (tmp_path / "out").glob("*.exr")
    materials, nodes = decoded(path, "CryptoMaterial"), decoded(path, "CryptoObject")
    assert list(materials) == ["wood", "stöne", "materials[2]"] and list(nodes) == ["left", "slab"]
    row = np.zeros((3, 8))
    row[0, :2], row[0, 2], row[1, 2], row[1, 3:5], row[2, 5:] = 1, 0.5, 0.5, 1, 1
    for found, expected in zip(materials.values(), row, strict=True):
        np.testing.assert_allclose(found, np.broadcast_to(expected, (6, 8)), atol=1 / SAMPLES)
    np.testing.assert_allclose(nodes["left"][:, :5], 1)
    np.testing.assert_allclose(nodes["slab"][:, 5:], 1)
    frame = mirelight.io.image.read(path)
    assert frame.mattes == () and isinstance(frame.camera, Camera)


def test_they_are_made_only_where_they_are_asked_for() -> None:
    output = mirelight.model.OutputSettings
    assert not output().wants("cryptomatte_material")
    assert output(aovs=("cryptomatte_node",)).wants("cryptomatte_node")
    assert not output(aovs=("cryptomatte_node",), compression="dwaa").wants("cryptomatte_node")
