"""The glTF container: a .glb or .gltf file, its JSON, its buffers and its buffer views.

Only bytes and structure here; `accessors` makes arrays of them. Everything is checked before memory is taken, files are
mapped and not copied, and no URI reaches a file outside the document's own folder.
"""

from __future__ import annotations

import base64
import binascii
import json
import struct
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from mirelight.base.errors import InputError
from mirelight.io.gltf.fields import Bytes, Fields
from mirelight.io.gltf.meshopt import decompress
from mirelight.io.safety import contained, require_memory

_JSON, _BIN = 0x4E4F534A, 0x004E4942
_MAX_JSON = 256 << 20  # bytes; the largest real scenes' JSON has some tens of MB
_MEMORY_OF_JSON = 24  # bytes of Python objects a byte of JSON, at worst: "[[],[],"

# What the readers in this package understand, plus the material extensions that shape a reflection which a Lambert
# proxy does not have: ignoring those changes nothing that mirelight renders.
HANDLED_EXTENSIONS = frozenset(
    {
        "EXT_mesh_gpu_instancing",
        "EXT_meshopt_compression",
        "EXT_texture_webp",
        "KHR_animation_pointer",  # followed to lights
        "KHR_draco_mesh_compression",
        "KHR_lights_punctual",
        "KHR_materials_anisotropy",
        "KHR_materials_clearcoat",
        "KHR_materials_diffuse_transmission",
        "KHR_materials_dispersion",
        "KHR_materials_emissive_strength",
        "KHR_materials_ior",
        "KHR_materials_iridescence",
        "KHR_materials_pbrSpecularGlossiness",
        "KHR_materials_sheen",
        "KHR_materials_specular",
        "KHR_materials_transmission",
        "KHR_materials_unlit",
        "KHR_materials_variants",
        "KHR_materials_volume",
        "KHR_mesh_quantization",
        "KHR_texture_transform",
        "KHR_xmp_json_ld",
    }
)
_NO_GLTF, _GIVE = "no glTF file", "give a .glb or .gltf file as programs export it"
_REMEDIES = {
    "KHR_texture_basisu": "convert the textures to PNG, e.g. gltf-transform ktxdecompress",
    "KHR_gaussian_splatting": "name this file under [[splats]], not as a mesh",
}


@dataclass(frozen=True, slots=True, eq=False)
class Document:
    """An open glTF file. `top` is its JSON; `buffer` and `view` give bytes without copying."""

    path: Path
    top: Fields
    binary: Bytes | None  # the GLB's BIN chunk
    _buffers: dict[int, Bytes] = field(default_factory=dict, repr=False)
    _views: dict[int, Bytes] = field(default_factory=dict, repr=False)  # decompressed views only
    _implicit: list[int] = field(default_factory=lambda: [0], repr=False)  # bytes of zeros read for missing views

    def entry(self, kind: str, index: int, user: Fields | None = None, name: str = "") -> Fields:
        """The object ``kind[index]``, e.g. ``entry("accessors", 3)``; `user` and `name` say who asks, for messages."""
        entries = self.top.values.get(kind, [])
        count = len(entries) if isinstance(entries, list) else 0
        if not 0 <= index < count or not isinstance(entries[index], dict):
            asker = user if user is not None else self.top
            raise asker.fail(name or kind, f"there is no {kind}[{index}] ({count} in the file)")
        return Fields(self.path, f"{kind}[{index}]", entries[index])

    def buffer(self, index: int, user: Fields | None = None) -> Bytes:
        """The bytes of ``buffers[index]``, exactly `byteLength` of them.

        Raises:
            InputError: missing, shorter than it says, not decodable, or outside the document's folder.
        """
        if index not in self._buffers:
            entry = self.entry("buffers", index, user, "buffer")
            length = entry.integer("byteLength", low=1)
            if "uri" in entry:
                data = self.resource(entry, "uri")
            elif index == 0 and self.binary is not None:
                data = self.binary
            else:
                raise entry.fail("uri", "missing, and this is not a GLB's first buffer")
            if len(data) < length:
                raise entry.fail("byteLength", f"{length} bytes promised, {len(data)} there", "the file is truncated")
            self._buffers[index] = data[:length]
        return self._buffers[index]

    def view(self, index: int, user: Fields | None = None) -> Bytes:
        """The bytes of ``bufferViews[index]``, decompressed where EXT_meshopt_compression packs them.

        Raises:
            InputError: it reaches outside its buffer, or cannot be decompressed.
        """
        entry = self.entry("bufferViews", index, user, "bufferView")
        packed = entry.extension("EXT_meshopt_compression")
        if packed is None:
            return self.slice(entry)
        if index not in self._views:
            self._views[index] = decompress(packed, self.slice(packed), entry.integer("byteLength", low=1))
        return self._views[index]

    def takes_implicit(self, count: int, most: int) -> bool:
        """Whether `count` more bytes of zeros, with those asked for before, stay within `most`; they count from now on.

        A few characters of JSON can ask for any number of zeros, as often as it likes.
        """
        self._implicit[0] += count
        return self._implicit[0] <= most

    def slice(self, entry: Fields) -> Bytes:
        """The bytes that an object with `buffer`, `byteOffset` and `byteLength` points at."""
        data = self.buffer(entry.integer("buffer"), entry)
        start, length = entry.integer("byteOffset", 0), entry.integer("byteLength", low=1)
        if start + length > len(data):
            found = f"bytes {start} to {start + length} of a buffer of {len(data)}"
            raise entry.fail("byteLength", found, "the file is damaged")
        return data[start : start + length]

    def resource(self, entry: Fields, name: str) -> Bytes:
        """What the URI in a field holds: a base64 data URI, or a file in the document's folder or below it.

        Raises:
            InputError: another scheme, a path that leaves the folder, a missing file, bad base64.
        """
        uri = entry.text(name)
        if uri[:5].lower() == "data:":
            head, comma, body = uri.partition(",")
            if not comma or not head.lower().endswith(";base64"):
                raise entry.fail(name, "a data URI that is not base64")
            try:
                return np.frombuffer(base64.b64decode(body, validate=True), dtype=np.uint8)
            except (binascii.Error, ValueError):
                raise entry.fail(name, "base64 that cannot be decoded", "the file is damaged") from None
        target = contained(self.path.parent, unquote(uri.partition("#")[0]), self.path, entry.at(name))
        return map_file(target, entry, name)


def read_document(path: str | Path | Document, handled: frozenset[str] = HANDLED_EXTENSIONS) -> Document:
    """Open a .glb or .gltf file (told apart by content) and check its head.

    Args:
        path: the file; one that is open already is given back.
        handled: extensions that the caller understands; a file that requires another is refused.

    Raises:
        InputError: unreadable, not glTF 2.x, truncated, or requiring an extension outside `handled` (named).
    """
    if isinstance(path, Document):
        return path
    path = Path(path)
    data = map_file(path)
    if bytes(data[:4]) == b"glTF":
        text, binary = _glb_chunks(path, data)
    else:
        text, binary = data, None
    document = Document(path, Fields(path, "", _parse(path, text)), binary)
    version = document.top.child("asset").text("version")
    if version.partition(".")[0] != "2":
        raise document.top.fail("asset.version", f"glTF {version[:20]}", "export it as glTF 2.0")
    for name in document.top.texts("extensionsRequired"):
        if name not in handled:
            remedy = _REMEDIES.get(name, "export the file without it")
            raise document.top.fail("extensionsRequired", f"the extension {name[:60]!r} is not supported", remedy)
    return document


def map_file(path: Path, entry: Fields | None = None, name: str = "") -> Bytes:
    """A file's bytes, mapped read-only; `entry` and `name` say which field asked for it."""

    def fail(found: str, remedy: str = "") -> InputError:
        return entry.fail(name, f"{path.name}: {found}", remedy) if entry else InputError(path, found, remedy)

    try:
        if not path.is_file():
            raise fail("no such file" if not path.exists() else "not a file", "check the path")
        if path.stat().st_size == 0:
            raise fail("empty file") if entry else InputError(path, f"{_NO_GLTF}: it is empty", _GIVE)
        return np.memmap(path, dtype=np.uint8, mode="r")
    except (OSError, ValueError) as e:
        raise fail(f"cannot be read ({getattr(e, 'strerror', None) or 'bad path'})") from None


def _glb_chunks(path: Path, data: Bytes) -> tuple[Bytes, Bytes | None]:
    """The JSON and the BIN chunk of a GLB (glTF §4.4)."""
    if len(data) < 20:
        raise InputError(path, f"a GLB of {len(data)} bytes", "the file is truncated")
    version, total, length, kind = struct.unpack("<4I", bytes(data[4:20]))
    if version != 2:
        raise InputError(path, f"GLB version {version}", "export it as glTF 2.0")
    if total > len(data):
        raise InputError(path, f"the header promises {total} bytes, {len(data)} are there", "the file is truncated")
    if kind != _JSON or 20 + length > total:
        raise InputError(path, "the first chunk is not a whole JSON chunk", "the file is damaged")
    text, at = data[20 : 20 + length], 20 + length
    while at + 8 <= total:
        length, kind = struct.unpack("<2I", bytes(data[at : at + 8]))
        if at + 8 + length > total:
            raise InputError(path, f"a chunk of {length} bytes reaches past the end", "the file is damaged")
        if kind == _BIN:
            return text, data[at + 8 : at + 8 + length]
        at += 8 + length
    return text, None


def _parse(path: Path, text: Bytes) -> dict[str, Any]:
    if len(text) > _MAX_JSON:
        raise InputError(path, f"{len(text) >> 20} MiB of JSON", f"at most {_MAX_JSON >> 20} MiB are read")
    require_memory(path, len(text) * _MEMORY_OF_JSON, "its JSON")
    try:
        value = json.loads(bytes(text).decode("utf-8-sig"))
    except UnicodeDecodeError:
        raise InputError(path, f"{_NO_GLTF}: neither GLB nor UTF-8 JSON", _GIVE) from None
    except json.JSONDecodeError as e:
        if e.pos == 0:
            raise InputError(path, f"{_NO_GLTF}: there is no JSON in it", _GIVE) from None
        raise InputError(path, f"bad JSON ({e.msg})", field=f"line {e.lineno}, column {e.colno}") from None
    except (ValueError, RecursionError):
        raise InputError(path, "JSON with a number or a nesting too large to read") from None
    if not isinstance(value, dict):
        raise InputError(path, f"{_NO_GLTF}: its JSON is not an object", _GIVE)
    return value
