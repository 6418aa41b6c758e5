"""Whatever the bytes, reading ends in a scene or in an InputError of one line."""

from __future__ import annotations

import copy
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mirelight.base.errors import InputError
from mirelight.io.gltf.animation import sample_cameras
from mirelight.io.gltf.scene import read_scene
from mirelight.io.gltf.write import write_glb
from mirelight.model import Camera, PointLight, ProxyMesh

SETTINGS = settings(
    max_examples=200, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A small file with a mesh, a light and a camera."""
    path = tmp_path_factory.mktemp("fuzz") / "sound.glb"
    mesh = ProxyMesh(
        vertices=np.eye(3, dtype=np.float32),
        faces=np.array([[0, 1, 2]], dtype=np.int32),
        uvs=np.zeros((3, 2), dtype=np.float32),
        vertex_colors=np.ones((3, 3), dtype=np.float32),
    )
    camera = Camera.look_at((1, 2, 3), (0, 0, 0), 4, 3)
    write_glb(path, mesh, [PointLight(name="lamp", position=np.zeros(3))], [camera])
    return path.read_bytes()


def outcome(folder: Path, data: bytes) -> None:
    path = folder / "fuzz.glb"
    path.write_bytes(data)
    for read in (read_scene, lambda p: sample_cameras(p, count=2)):
        try:
            read(path)
        except InputError as e:
            assert "\n" not in str(e) and str(path) in str(e)


@SETTINGS
@given(edits=st.lists(st.tuples(st.integers(0, 10**6), st.integers(0, 255)), min_size=1, max_size=8))
def test_changed_bytes(tmp_path: Path, sound: bytes, edits: list[tuple[int, int]]) -> None:
    data = bytearray(sound)
    for at, value in edits:
        data[at % len(data)] = value
    outcome(tmp_path, bytes(data))


@SETTINGS
@given(data=st.binary(max_size=200), head=st.sampled_from([b"", b"glTF\2\0\0\0", b"{", b'{"asset":{"version":"2.0"},']))
def test_arbitrary_bytes(tmp_path: Path, data: bytes, head: bytes) -> None:
    outcome(tmp_path, head + data)


def places(value: Any, here: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Paths of every value in a JSON tree."""
    found = [here] if here else []
    entries = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, child in entries:
        found += places(child, (*here, key))
    return found


ODD: list[Any] = [
    None,
    True,
    -1,
    0,
    1,
    3,
    0.5,
    1e30,
    2**31,
    2**63,
    10**25,
    "",
    "x",
    "data:,",
    [],
    [0],
    {},
    {"a": 1},
    "../x",
]


@SETTINGS
@given(choices=st.lists(st.tuples(st.integers(0, 10**6), st.sampled_from(ODD)), min_size=1, max_size=3))
def test_odd_values_in_any_field(tmp_path: Path, sound: bytes, choices: list[tuple[int, Any]]) -> None:
    length = struct.unpack("<I", sound[12:16])[0]
    top = json.loads(sound[20 : 20 + length])
    for number, odd in choices:
        paths = places(top)
        path = paths[number % len(paths)]
        owner = top
        for key in path[:-1]:
            owner = owner[key]
        owner[path[-1]] = copy.deepcopy(odd)
    text = json.dumps(top).encode()
    text += b" " * (-len(text) % 4)
    rest = sound[20 + length :]
    outcome(tmp_path, struct.pack("<4s4I", b"glTF", 2, 20 + len(text) + len(rest), len(text), 0x4E4F534A) + text + rest)
