"""Mesh primitives of a glTF file as triangle pieces in their own space (glTF §3.7)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirelight.base.errors import InputError
from mirelight.io.gltf.accessors import accessor_count, read_accessor
from mirelight.io.gltf.document import Document
from mirelight.io.gltf.draco import DracoData, decode_draco
from mirelight.io.gltf.fields import Fields
from mirelight.io.gltf.materials import TexturedMaterial
from mirelight.io.gltf.textures import UvSource
from mirelight.io.safety import require_memory
from mirelight.model import F32, I32

TRIANGLES, STRIP, FAN = 4, 5, 6
_TRIANGLE_MODES = (TRIANGLES, STRIP, FAN)
_MAX_ELEMENTS = 1 << 27  # vertices and indices of all placed meshes together
_BYTES_PER_VALUE = 16  # of an attribute or index: as float32 or int32 while it is read, checked, placed and merged


@dataclass(frozen=True, slots=True, eq=False)
class Piece:
    """Triangles that share one set of vertices, in the space of their mesh."""

    fields: Fields  # the first primitive, for messages
    positions: F32  # (V, 3)
    faces: I32  # (F, 3)
    face_materials: I32  # (F,) index into the file's materials; -1: the default material
    normals: F32 | None  # (V, 3) unit
    uvs: F32 | None  # (V, 2) as the material's texture reads them
    colors: F32 | None  # (V, 3) linear
    joints: I32 | None = None  # (V, n) indices into the skin's joints
    weights: F32 | None = None  # (V, n)
    targets: tuple[tuple[F32 | None, F32 | None], ...] = ()  # morph offsets of positions and normals


def triangle_primitives(mesh: Fields) -> list[Fields]:
    """The primitives of a mesh that are triangles; points and lines cast no shadow and are left out."""
    modes = [(p, p.integer("mode", TRIANGLES, high=6)) for p in mesh.children("primitives")]
    return [primitive for primitive, mode in modes if mode in _TRIANGLE_MODES]


def check_size(document: Document, placed: list[tuple[Fields, int]]) -> None:
    """Refuse a scene too large to hold, before anything is read.

    Args:
        document: the open file.
        placed: each mesh with how many times it stands in the scene.

    Raises:
        InputError: more than 134 million vertices and indices, or more than fit into memory.
    """
    total = memory = 0
    for mesh, times in placed:
        for primitive in triangle_primitives(mesh):
            indices, attributes = primitive.integer("indices", None), _attributes(primitive)
            size = accessor_count(document, attributes["POSITION"], primitive)
            corners = accessor_count(document, indices, primitive) if indices is not None else size
            total += times * (size + corners)
            targets = sum(len(target.values) for target in primitive.children("targets"))
            memory += _BYTES_PER_VALUE * ((times + 1) * (size * len(attributes) + corners) + size * targets)
    if total > _MAX_ELEMENTS:
        found = f"{total} vertices and indices in the scene"
        raise InputError(document.path, found, f"at most {_MAX_ELEMENTS} are read; simplify the mesh")
    require_memory(document.path, memory, f"{total} vertices and indices")


def read_mesh_pieces(document: Document, mesh: Fields, surfaces: dict[int, TexturedMaterial]) -> list[Piece]:
    """The triangles of one mesh; primitives that share their vertices become one piece.

    Args:
        document: the open file.
        mesh: the ``meshes`` entry.
        surfaces: the materials in use, which say where texture coordinates come from.

    Raises:
        InputError: counts that disagree, indices out of range, values that are not finite.
    """
    groups: dict[object, list[Fields]] = {}
    for primitive in triangle_primitives(mesh):
        groups.setdefault(_sharing_key(primitive, surfaces), []).append(primitive)
    pieces = [_read_group(document, primitives, surfaces) for primitives in groups.values()]
    return [piece for piece in pieces if len(piece.faces)]


def _attributes(primitive: Fields) -> dict[str, int]:
    attributes = primitive.indices("attributes")
    if "POSITION" not in attributes:
        raise primitive.fail("attributes", "no POSITION", "the file is damaged")
    return attributes


def _surface(primitive: Fields, surfaces: dict[int, TexturedMaterial]) -> TexturedMaterial | None:
    index = primitive.integer("material", None)
    return None if index is None else surfaces[index]


def _uv_source(primitive: Fields, surfaces: dict[int, TexturedMaterial]) -> UvSource | None:
    surface = _surface(primitive, surfaces)
    return surface.uv if surface else None


def _sharing_key(primitive: Fields, surfaces: dict[int, TexturedMaterial]) -> object:
    draco = primitive.extension("KHR_draco_mesh_compression")
    if draco is not None:
        return primitive.where
    uv = _uv_source(primitive, surfaces) or UvSource()
    targets = tuple(tuple(sorted(t.values.items())) for t in primitive.children("targets"))
    return tuple(sorted(_attributes(primitive).items())), repr(targets), uv.key()


def _read_group(document: Document, primitives: list[Fields], surfaces: dict[int, TexturedMaterial]) -> Piece:
    first = primitives[0]
    attributes = _attributes(first)
    draco = decode_draco(document, first)
    reader = _AttributeReader(document, first, attributes, draco)
    positions = reader.vectors("POSITION", 3)
    assert positions is not None
    faces, materials = [], []
    for primitive in primitives:
        index = primitive.integer("material", None)
        part = draco.faces if draco else _faces(document, primitive, len(positions))
        _check_range(primitive, part, len(positions))
        faces.append(part)
        materials.append(np.full(len(part), -1 if index is None else index, dtype=np.int32))
    return Piece(
        fields=first,
        positions=positions,
        faces=np.concatenate(faces),
        face_materials=np.concatenate(materials),
        normals=reader.vectors("NORMAL", 3),
        uvs=_uvs(reader, [(p, _uv_source(p, surfaces)) for p in primitives]),
        colors=_colors(reader, first),
        joints=reader.joints(),
        weights=reader.weights(),
        targets=tuple(reader.target(t) for t in first.children("targets")),
    )


@dataclass(frozen=True, slots=True)
class _AttributeReader:
    """Vertex attributes of one primitive, each checked against the positions' count."""

    document: Document
    primitive: Fields
    attributes: dict[str, int]
    draco: DracoData | None

    def values(self, name: str, user: Fields | None = None, index: int | None = None) -> NDArray[Any] | None:
        """(V, n) in the file's type, or None where the primitive lacks it."""
        user = user or self.primitive.child("attributes")
        index = self.attributes.get(name) if index is None else index
        if index is None:
            return None
        count = accessor_count(self.document, index, user)
        if count != accessor_count(self.document, self.attributes["POSITION"], user):
            raise user.fail(name, f"{count} values, not one per vertex", "the file is damaged")
        if self.draco is not None and name in self.draco.attributes:
            return self.draco.attributes[name]
        return read_accessor(self.document, index, user)

    def vectors(self, name: str, width: int) -> F32 | None:
        """(V, width) finite float32, or None; wider attributes lose what comes after (a colour's alpha)."""
        values = self.values(name)
        return None if values is None else self._finite(name, values, width)

    def target(self, target: Fields) -> tuple[F32 | None, F32 | None]:
        """Position and normal offsets of one morph target."""

        def offsets(name: str) -> F32 | None:
            if name not in target:
                return None
            values = self.values(name, target, target.integer(name))
            assert values is not None
            return self._finite(name, values, 3)

        return offsets("POSITION"), offsets("NORMAL")

    def joints(self) -> I32 | None:
        """(V, 4 k) joint indices of all sets side by side."""
        sets = self._sets("JOINTS_")
        return np.concatenate(sets, axis=1).astype(np.int32) if sets else None

    def weights(self) -> F32 | None:
        """(V, 4 k) joint weights of all sets side by side."""
        sets = self._sets("WEIGHTS_")
        return np.concatenate([self._finite("WEIGHTS_0", x, 4) for x in sets], axis=1) if sets else None

    def _sets(self, prefix: str) -> list[NDArray[Any]]:
        names = sorted(name for name in self.attributes if name.startswith(prefix))
        return [x for name in names if (x := self.values(name)) is not None and x.shape[1] == 4]

    def _finite(self, name: str, values: NDArray[Any], width: int) -> F32:
        if values.shape[1] < width:
            raise self.primitive.fail(f"attributes.{name}", f"{values.shape[1]} components", f"expected {width}")
        out = np.ascontiguousarray(values[:, :width], dtype=np.float32)
        bad = int(np.count_nonzero(~np.isfinite(out).all(axis=1)))
        if bad:
            found = f"{bad} of {len(out)} vertices are NaN or infinite"
            raise self.primitive.fail(f"attributes.{name}", found, "repair the mesh")
        return out


def _uvs(reader: _AttributeReader, users: list[tuple[Fields, UvSource | None]]) -> F32 | None:
    """Texture coordinates as the textures of a group read them; set 0 where none has a texture."""
    textured = [(primitive, source) for primitive, source in users if source is not None]
    if not textured:
        return reader.vectors("TEXCOORD_0", 2)
    primitive, source = textured[0]
    name = f"TEXCOORD_{source.texcoord}"
    uvs = reader.vectors(name, 2)
    if uvs is None:
        raise primitive.fail("attributes", f"no {name}, which its material's texture needs", "unwrap the mesh")
    if source.transform is not None:
        uvs = (uvs @ source.transform[:, :2].T + source.transform[:, 2]).astype(np.float32)
    return uvs


def _colors(reader: _AttributeReader, primitive: Fields) -> F32 | None:
    """COLOR_0 as linear RGB; unnormalised integers, which the specification forbids, are taken as normalised."""
    raw = reader.values("COLOR_0")
    if raw is not None and raw.dtype.kind == "u":
        raw = raw.astype(np.float32) / np.float32(np.iinfo(raw.dtype).max)
    colors = None if raw is None else reader._finite("COLOR_0", raw, 3)
    if colors is not None and float(colors.min()) < 0:
        raise primitive.fail("attributes.COLOR_0", "negative colours", "repair the mesh")
    return colors


def _faces(document: Document, primitive: Fields, vertices: int) -> I32:
    """(F, 3) triangles of an indexed or plain list, strip or fan; an incomplete last triangle is dropped."""
    index = primitive.integer("indices", None)
    if index is None:
        corners: NDArray[Any] = np.arange(vertices, dtype=np.int64)
    else:
        values = read_accessor(document, index, primitive)
        if values.shape[1] != 1 or values.dtype.kind != "u":
            raise primitive.fail("indices", f"{values.dtype} with {values.shape[1]} components", "the file is damaged")
        corners = values[:, 0]
    highest = int(corners.max(initial=0))
    if highest >= vertices:
        raise primitive.fail("indices", f"index {highest} of {vertices} vertices", "the file is damaged")
    corners = corners.astype(np.int32)
    mode = primitive.integer("mode", TRIANGLES)
    if mode == TRIANGLES:
        return corners[: len(corners) // 3 * 3].reshape(-1, 3)
    i = np.arange(max(len(corners) - 2, 0))
    if mode == STRIP:
        return np.stack([corners[i], corners[i + 1 + i % 2], corners[i + 2 - i % 2]], axis=1)
    return np.stack([corners[i + 1], corners[i + 2], corners[np.zeros_like(i)]], axis=1)


def _check_range(primitive: Fields, faces: I32, vertices: int) -> None:
    if len(faces) and not 0 <= int(faces.min()) <= int(faces.max()) < vertices:
        raise primitive.fail("indices", f"an index outside 0..{vertices - 1}", "the file is damaged")
