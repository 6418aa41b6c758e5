"""A small glTF builder, independent of the package's own writer."""

from __future__ import annotations

import base64
import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

_CODES = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
_TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}

TRIANGLE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], dtype=np.float32)


class Glb:
    """JSON and binary chunk of a file under construction."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.top: dict[str, Any] = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": []}]}
        self.binary = b""

    def put(self, kind: str, entry: dict[str, Any]) -> int:
        """Append to a top-level array; returns the index."""
        self.top.setdefault(kind, []).append(entry)
        return len(self.top[kind]) - 1

    def view(self, data: bytes, **more: Any) -> int:
        """A buffer view of these bytes."""
        self.binary += b"\0" * (-len(self.binary) % 4)
        start = len(self.binary)
        self.binary += data
        return self.put("bufferViews", {"buffer": 0, "byteOffset": start, "byteLength": len(data), **more})

    def accessor(self, values: NDArray[Any], **more: Any) -> int:
        """An accessor over (n,) or (n, k) values in their own type."""
        values = np.ascontiguousarray(values)
        width = 1 if values.ndim == 1 else values.shape[1]
        entry = {"bufferView": self.view(values.tobytes()), "componentType": _CODES[values.dtype.str[1:]]}
        return self.put("accessors", entry | {"count": len(values), "type": _TYPES[width]} | more)

    def mesh(self, *primitives: dict[str, Any], **more: Any) -> int:
        """A mesh of these primitives."""
        return self.put("meshes", {"primitives": list(primitives), **more})

    def primitive(self, positions: NDArray[Any] = TRIANGLE, **more: Any) -> dict[str, Any]:
        """A primitive with these positions; `attributes` and other fields as given."""
        attributes = {"POSITION": self.accessor(positions), **more.pop("attributes", {})}
        return {"attributes": attributes, **more}

    def node(self, root: bool = True, **fields: Any) -> int:
        """A node; a root of the scene unless told otherwise."""
        index = self.put("nodes", fields)
        if root:
            self.top["scenes"][0]["nodes"].append(index)
        return index

    def light(self, node: dict[str, Any] | None = None, **fields: Any) -> int:
        """A node with a punctual light of these fields."""
        extension = self.top.setdefault("extensions", {}).setdefault("KHR_lights_punctual", {"lights": []})
        extension["lights"].append(fields)
        reference = {"KHR_lights_punctual": {"light": len(extension["lights"]) - 1}}
        return self.node(**(node or {}), extensions=reference)

    def camera(self, node: dict[str, Any] | None = None, **fields: Any) -> int:
        """A node with a camera of these fields."""
        return self.node(**(node or {}), camera=self.put("cameras", fields))

    def bytes(self) -> bytes:
        """The GLB."""
        body = self.binary + b"\0" * (-len(self.binary) % 4)
        top = self.top | ({"buffers": [{"byteLength": len(body)}]} if body and "buffers" not in self.top else {})
        text = json.dumps(top).encode()
        text += b" " * (-len(text) % 4)
        chunks = struct.pack("<2I", len(text), 0x4E4F534A) + text
        if body:
            chunks += struct.pack("<2I", len(body), 0x004E4942) + body
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks

    def save(self, name: str = "scene.glb") -> Path:
        """Write the GLB."""
        path = self.folder / name
        path.write_bytes(self.bytes())
        return path

    def save_gltf(self, uri: str | None = None, name: str = "scene.gltf") -> Path:
        """Write JSON with the buffer at `uri`, or inside as a data URI."""
        data = "data:application/octet-stream;base64," + base64.b64encode(self.binary).decode()
        top = self.top | {"buffers": [{"byteLength": len(self.binary), "uri": uri or data}]}
        path = self.folder / name
        path.write_text(json.dumps(top), encoding="utf-8")
        return path


@pytest.fixture
def glb(tmp_path: Path) -> Glb:
    """An empty file in a folder of its own."""
    return Glb(tmp_path)


@pytest.fixture
def new_glb(tmp_path: Path) -> Callable[[], Glb]:
    """Makes empty files."""
    return lambda: Glb(tmp_path)
