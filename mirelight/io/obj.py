"""Wavefront OBJ meshes with their materials, after Wavefront's "Object Files" and "Material Files" appendices.

Read are v (with colours), vt, vn, f, usemtl, mtllib; of materials Kd, Ke, map_Kd and map_Ke. Polygons become fans.
Lines, points, curves, groups and smoothing groups are passed over.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mirelight.base import colour
from mirelight.base.errors import InputError, printable
from mirelight.io.ldr import decode_srgb_image
from mirelight.io.safety import BRIGHTEST, contained, open_binary, read_bytes, read_whole
from mirelight.io.surface import filled_normals
from mirelight.model import F32, I32, Material, ProxyMesh

_MAX_LIBRARY = 16 << 20  # bytes of one .mtl file
_MEMORY_OF_TEXT = 8  # bytes of memory a byte of text: lines, numbers, arrays


@dataclass
class _Text:
    """The file's statements, sorted by kind; numbers are still text."""

    positions: list[str] = field(default_factory=list)
    uvs: list[str] = field(default_factory=list)
    normals: list[str] = field(default_factory=list)
    faces: list[tuple[int, str, str]] = field(default_factory=list)  # line, corners, material
    libraries: list[tuple[int, str]] = field(default_factory=list)
    before: dict[int, tuple[int, int, int]] = field(default_factory=dict)  # v, vt, vn before lines that count back

    @property
    def totals(self) -> tuple[int, int, int]:
        """How many v, vt and vn there are so far."""
        return len(self.positions), len(self.uvs), len(self.normals)


def read_obj(path: Path, textures: bool) -> ProxyMesh:
    """An OBJ file as one mesh, its materials in the order of their first face.

    A file of positions alone keeps its vertices as they are; with texture coordinates or normals there is one vertex
    for each different corner, in the order of the file.

    Args:
        path: the file.
        textures: read the material libraries and their textures. A library that is missing is passed over, as many OBJ
            files have lost theirs; a texture that is missing is not.

    Raises:
        InputError: a statement that cannot be read (its line is named), an index out of range, values not finite.
    """
    text = _sorted_statements(read_whole(path, "its text", _MEMORY_OF_TEXT).decode("utf-8", "replace"))
    if not text.faces:
        raise InputError(path, "no triangles (a point cloud, or an empty file)", "give a mesh")
    positions = _numbers(path, text.positions, "v", 3)
    faces, corners, materials = _triangles(path, text, len(positions))
    rows = corners[:, 0]
    colors = positions[:, 3:6] if positions.shape[1] >= 6 else None
    vertices = positions[rows, :3]
    found = _libraries(path, text.libraries) if textures else {}
    names = list(dict.fromkeys(materials))
    number = {name: i for i, name in enumerate(names)}
    owners = np.array([number[name] for name in materials], dtype=np.int32)
    return ProxyMesh(
        vertices=vertices,
        faces=faces,
        normals=_picked_normals(path, text, corners[:, 2], vertices, faces),
        uvs=_picked_uvs(path, text, corners[:, 1]),
        vertex_colors=None if colors is None else colour.srgb_decode(np.clip(colors[rows], 0, 1)),
        face_materials=owners if len(names) > 1 else None,
        materials=tuple(found.get(name, Material(name=name or "default")) for name in names),
    )


def obj_companions(path: Path) -> tuple[Path, ...]:
    """The material libraries that an OBJ file names and the textures that they name, as far as they exist.

    Raises:
        InputError: it cannot be read, or a name leaves the folder.
    """
    text = read_whole(path, "its text", 3).replace(b"\\\n", b" ").replace(b"\r", b"\n")
    names = re.findall(rb"(?m)^[ \t]*mtllib (.*)$", text)
    found: dict[Path, None] = {}
    for library in _library_files(path, [(0, name.decode("utf-8", "replace").strip()) for name in names]):
        found[library] = None
        for entries in _library_blocks(library).values():
            found |= {x: None for kind in _TEXTURES if (x := _texture_file(library, entries, kind))}
    return tuple(x for x in found if x.is_file())


def _sorted_statements(text: str) -> _Text:
    out, material = _Text(), ""
    kinds = {"v": out.positions, "vt": out.uvs, "vn": out.normals}
    for number, line in enumerate(text.replace("\\\n", " ").splitlines(), start=1):
        kind, _, rest = line.lstrip().partition(" ")
        if kind == "f":
            out.faces.append((number, rest, material))
            if "-" in rest:
                out.before[number] = out.totals
        elif kind in kinds:
            kinds[kind].append(rest)
        elif kind == "usemtl":
            material = printable(rest.strip())
        elif kind == "mtllib":
            out.libraries.append((number, rest.strip()))
    return out


def _numbers(path: Path, lines: list[str], kind: str, least: int) -> F32:
    """(n, k) finite numbers, k as the first line has it."""
    width = len(lines[0].split()) if lines else least
    try:
        with np.errstate(over="ignore"):
            flat = np.array(" ".join(lines).split(), dtype=np.float64).astype(np.float32)
        table = flat.reshape(len(lines), width)
    except ValueError:
        raise InputError(path, f"{kind} lines that are not all {width} numbers", "the file is damaged") from None
    bad = int(np.count_nonzero(~np.isfinite(table).all(axis=1)))
    if bad or width < least:
        found = f"{bad} of {len(table)} vertices are NaN or infinite" if bad else f"{kind} lines of {width} numbers"
        raise InputError(path, found, "repair the mesh")
    return table


def _triangles(path: Path, text: _Text, vertices: int) -> tuple[I32, NDArray[np.int64], list[str]]:
    """(F, 3) faces, (V, 3) position, uv and normal index of each of their vertices (-1: none), F material names."""
    plain = not any("/" in corners for _, corners, _ in text.faces)
    known: dict[tuple[int, int, int], int] = {}
    seen: dict[str, int] = {}  # corners as written -> vertex; most are written about six times
    faces: list[int] = []
    materials: list[str] = []
    totals = text.totals
    for number, corners, material in text.faces:
        try:
            ids = [seen.get(c, -1) for c in corners.split()]
            if -1 in ids:
                counts = text.before.get(number, totals)
                ids = [_vertex(c, counts, known, seen, plain) for c in corners.split()]
        except (ValueError, IndexError):
            raise InputError(path, f"a face {corners[:40]!r}", "the file is damaged", field=f"line {number}") from None
        for i in range(1, len(ids) - 1):
            faces += (ids[0], ids[i], ids[i + 1])
            materials.append(material)
    if not faces:
        raise InputError(path, "no triangles (faces of fewer than three corners)", "give a mesh")
    triangles = np.array(faces, dtype=np.int32).reshape(-1, 3)
    if plain:
        every = np.full((vertices, 3), -1, dtype=np.int64)
        every[:, 0] = np.arange(vertices)
        return triangles, every, materials
    return triangles, np.array(list(known), dtype=np.int64), materials


def _vertex(
    text: str, counts: tuple[int, int, int], known: dict[tuple[int, int, int], int], seen: dict[str, int], plain: bool
) -> int:
    """The vertex of a corner: its position's index, or a number for each different combination."""
    key = _corner(text, counts)
    vertex = key[0] if plain else known.setdefault(key, len(known))
    if "-" not in text:  # counting back means something else on every line
        seen[text] = vertex
    return vertex


def _corner(text: str, counts: tuple[int, int, int]) -> tuple[int, int, int]:
    """Zero-based indices of "v", "v/vt", "v//vn" or "v/vt/vn"; negative ones count back from the face's own line."""
    parts = text.split("/")
    if len(parts) > 3 or not parts[0]:
        raise ValueError(text)
    out = [-1, -1, -1]
    for i, part in enumerate(parts):
        if part:
            index = int(part)
            out[i] = index - 1 if index > 0 else index + counts[i]
            if index == 0 or not 0 <= out[i] < counts[i]:
                raise IndexError(text)
    return out[0], out[1], out[2]


def _picked_uvs(path: Path, text: _Text, rows: NDArray[np.int64]) -> F32 | None:
    """Texture coordinates with v = 0 at the top; OBJ counts v from the bottom."""
    if not text.uvs or bool(np.all(rows < 0)):
        return None
    uvs = _numbers(path, text.uvs, "vt", 2)[:, :2].copy()
    uvs[:, 1] = 1 - uvs[:, 1]
    return np.where(rows[:, None] >= 0, uvs[rows], np.float32(0))


def _picked_normals(path: Path, text: _Text, rows: NDArray[np.int64], vertices: F32, faces: I32) -> F32 | None:
    if not text.normals or bool(np.all(rows < 0)):
        return None
    normals = _numbers(path, text.normals, "vn", 3)[:, :3]
    picked = np.where(rows[:, None] >= 0, normals[rows], np.float32(0))
    return filled_normals(vertices, faces, picked)


# --- materials -------------------------------------------------------------------------------------------------------


def _libraries(path: Path, libraries: list[tuple[int, str]]) -> dict[str, Material]:
    found: dict[str, Material] = {}
    for file in _library_files(path, libraries):
        found |= {name: _material(file, name, entries) for name, entries in _library_blocks(file).items()}
    return found


def _library_files(path: Path, libraries: list[tuple[int, str]]) -> list[Path]:
    targets = [contained(path.parent, name.replace("\\", "/"), path, f"line {n}") for n, name in libraries]
    return [target for target in targets if target.is_file()]


def _library_blocks(path: Path) -> dict[str, dict[str, tuple[int, str]]]:
    """Statements of each material: kind -> line and text."""
    blocks: dict[str, dict[str, tuple[int, str]]] = {}
    block: dict[str, tuple[int, str]] = {}
    lines = read_bytes(path, _MAX_LIBRARY).decode("utf-8", "replace").splitlines()
    for number, line in enumerate(lines, start=1):
        kind, _, rest = line.strip().partition(" ")
        if kind == "newmtl":
            block = blocks.setdefault(printable(rest.strip()), {})
        else:
            block[kind] = (number, rest.strip())
    return blocks


_TEXTURES = ("map_Kd", "map_Ke")


def _texture_file(path: Path, entries: dict[str, tuple[int, str]], kind: str) -> Path | None:
    if kind not in entries:
        return None
    number, file = entries[kind]
    if file.startswith("-"):
        raise InputError(path, f"{kind} with options", "apply them to the image", field=f"line {number}")
    return contained(path.parent, file.replace("\\", "/"), path, f"line {number}")


def _texture(path: Path, entries: dict[str, tuple[int, str]], kind: str) -> F32 | None:
    target = _texture_file(path, entries, kind)
    if target is None:
        return None
    if not target.is_file():
        number, file = entries[kind]
        raise InputError(path, f"the texture {file[:60]!r} is missing", field=f"line {number}")
    with open_binary(target) as stream:
        return decode_srgb_image(stream, target)


def _material(path: Path, name: str, entries: dict[str, tuple[int, str]]) -> Material:
    texture, glow = (_texture(path, entries, kind) for kind in _TEXTURES)
    return Material(
        name=name,
        base_color=np.ones(3) if texture is not None else _rgb(path, entries.get("Kd"), (1, 1, 1)),
        base_color_texture=texture,
        emissive=_rgb(path, entries.get("Ke"), (0, 0, 0) if glow is None else (1, 1, 1)),
        emissive_texture=glow,
    )


def _rgb(path: Path, entry: tuple[int, str] | None, default: Sequence[float]) -> NDArray[np.float64]:
    if entry is None:
        return np.asarray(default, dtype=np.float64)
    number, text = entry
    try:
        value = np.array(text.split(), dtype=np.float64)
    except ValueError:
        value = np.empty(0)
    if value.shape != (3,) or not np.all((value >= 0) & (value <= BRIGHTEST)):
        remedy = f"expected three numbers from 0 to {BRIGHTEST:g}"
        raise InputError(path, f"a colour {text[:40]!r}", remedy, field=f"line {number}")
    return value
