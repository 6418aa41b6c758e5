"""Proxy meshes of every format: glTF, GLB, OBJ and OpenUSD by this package's own readers, PLY and STL by trimesh's."""

from __future__ import annotations

import io
import logging
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mirelight.base import colour
from mirelight.base.errors import InputError, printable
from mirelight.io.gltf.document import Document
from mirelight.io.gltf.scene import read_node, read_scene
from mirelight.io.ldr import decode_srgb_image
from mirelight.io.mesh_counts import check_counts
from mirelight.io.obj import obj_companions, read_obj
from mirelight.io.safety import contained, existing, open_binary, read_whole, require_memory
from mirelight.io.suffixes import GLTF, MESHES, USD
from mirelight.io.surface import filled_normals, transformed_normals
from mirelight.model import F32, I32, Material, ProxyMesh, triangles

_FARTHEST = 1e9  # world units, the bound of all lengths in a job; squares of much more have no place in float32
_MAX_HEADER = 1 << 16  # bytes of a PLY header that are looked at
_SPLAT_MARKS = (b"f_dc_0", b"packed_position")

Attributes = Mapping[str, Any]


def read_mesh(
    path: str | Path,
    *,
    textures: bool = True,
    finish: bool = False,
    node: str | None = None,
    document: Document | None = None,
) -> ProxyMesh:
    """A proxy mesh, its vertices neither merged nor reordered.

    The `albedo` is left at its gray default; the file's colours are in `materials` and `vertex_colors`. Vertex colours
    in PLY and OBJ files are taken as display-encoded (as scanning tools write them) and decoded to linear light; those
    of glTF files are linear by specification. An OBJ material's map_Kd replaces its Kd.

    Args:
        path: .glb, .gltf, .usd, .usda, .usdc, .usdz, .ply, .obj or .stl.
        textures: read textures too. Without, no image is opened.
        finish: read those of metallic and roughness, too, where the format has them (glTF).
        node: of a glTF file this node alone, and what hangs on it, its origin at the world's.
        document: a glTF file that is open already.

    Raises:
        InputError: missing, damaged, without that node, without triangles or area, or with vertices that are NaN or
            beyond all bounds.
    """
    path = existing(path)
    if node is None:
        mesh = _read(path, textures, finish, document)
    else:
        mesh = _read_node(path, node, textures, finish, document)
    farthest = float(np.abs(mesh.vertices).max())
    if farthest > _FARTHEST:
        raise InputError(path, f"corners as far as {farthest:.3g} units from the origin", "give it in metres")
    if not triangles.crossed(mesh.vertices[mesh.faces].astype(np.float64)).any():
        raise InputError(path, "a mesh without area: corners that coincide or lie on a line", "give one with surfaces")
    return mesh


def _read(path: Path, textures: bool, finish: bool, document: Document | None) -> ProxyMesh:
    suffix = path.suffix.lower()
    if path.is_dir() or suffix not in MESHES:
        raise InputError(path, "not a mesh file", "give one of " + ", ".join(MESHES))
    if suffix in GLTF:
        mesh = read_scene(document or path, textures=textures, finish=finish).mesh
        if mesh is None:
            raise InputError(path, "no triangles in its scene (points and lines do not count)", "give a mesh")
        return mesh
    if suffix in USD:
        from mirelight.io.usd.mesh import read_proxy

        found = read_proxy(path, textures=textures)
        if found is None:
            raise InputError(path, "no meshes in it", "give a stage with a mesh")
        return found
    if suffix == ".obj":
        return read_obj(path, textures)
    return _read_with_trimesh(path, suffix, textures)


def _read_node(path: Path, node: str, textures: bool, finish: bool, document: Document | None) -> ProxyMesh:
    if path.suffix.lower() not in GLTF:
        found = f"a node, {printable(node)!r}, of a file that is no glTF"
        raise InputError(path, found, "leave it out, or give a .glb or .gltf", field="node")
    mesh = read_node(document or path, node, textures=textures, finish=finish)
    if mesh is None:
        raise InputError(path, f"no triangles at the node {printable(node)!r}", "name one with a mesh", field="node")
    return mesh


def companions(path: Path) -> tuple[Path, ...]:
    """The other files that an OBJ or PLY names and that reading it opens, as far as they exist.

    Raises:
        InputError: it cannot be read, or a name leaves the folder.
    """
    return obj_companions(path) if path.suffix.lower() == ".obj" else _ply_texture(path)


def transform(mesh: ProxyMesh, matrix: ArrayLike) -> ProxyMesh:
    """The mesh moved by an affine matrix (4, 4).

    Normals go by the inverse transpose. A mirroring matrix also turns each triangle's winding, so that the outside
    stays outside.
    """
    m = np.asarray(matrix, dtype=np.float64)
    if np.array_equal(m, np.eye(4)):
        return mesh
    linear = m[:3, :3]
    vertices = (mesh.vertices.astype(np.float64) @ linear.T + m[:3, 3]).astype(np.float32)
    faces = mesh.faces[:, ::-1] if np.linalg.det(linear) < 0 else mesh.faces
    normals = None if mesh.normals is None else transformed_normals(mesh.normals, linear)
    return replace(mesh, vertices=vertices, faces=faces, normals=normals)


# --- PLY and STL -----------------------------------------------------------------------------------------------------


class _Neighbours:
    """Opens the texture that a PLY names, from its folder or below (trimesh's resolver interface)."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.picture: F32 | None = None
        self.refused: InputError | None = None

    def get(self, name: str) -> bytes:
        """The bytes of a neighbouring file."""
        try:
            target = contained(self.path.parent, name.strip().replace("\\", "/"), self.path, "TextureFile")
            data = read_whole(target, "its bytes", 2)
            self.picture = decode_srgb_image(io.BytesIO(data), target)
        except InputError as e:
            self.refused = e
            raise
        return data


def _ply_texture(path: Path) -> tuple[Path, ...]:
    """The texture that a PLY's header names, where it exists."""
    name = re.search(rb"(?im)^comment[ \t]+texturefile[ \t]+(.+)$", _ply_header(path))
    if name is None:
        return ()
    text = name[1].decode("utf-8", "replace").strip().replace("\\", "/")
    target = contained(path.parent, text, path, "TextureFile")
    return (target,) if target.is_file() else ()


def _ply_header(path: Path) -> bytes:
    with open_binary(path) as stream:
        return stream.read(_MAX_HEADER).partition(b"end_header")[0]


def _read_with_trimesh(path: Path, suffix: str, textures: bool) -> ProxyMesh:
    from trimesh.exchange import ply, stl

    logging.getLogger("trimesh").addHandler(logging.NullHandler())  # it prints what it passes over, with tracebacks
    neighbours = _Neighbours(path)
    require_memory(path, path.stat().st_size * 4, "its triangles")
    if suffix == ".ply" and any(mark in _ply_header(path) for mark in _SPLAT_MARKS):
        raise InputError(path, "Gaussian splats, not a mesh", "name it under splats and give a mesh as proxy")
    check_counts(path, suffix)
    try:
        with open_binary(path) as stream, np.errstate(all="ignore"):
            if suffix == ".ply":
                piece = ply.load_ply(stream, resolver=neighbours, skip_materials=not textures)
            else:
                piece = stl.load_stl(stream)
                piece = next(iter(piece["geometry"].values()), {}) if "geometry" in piece else piece
    except InputError:
        raise
    except Exception as e:  # trimesh raises whatever its parsing runs into
        reason = f"a {suffix[1:].upper()} file that cannot be read ({type(e).__name__})"
        raise InputError(path, reason, "the file is damaged or of another kind") from None
    if neighbours.refused is not None:
        raise neighbours.refused
    if piece.get("faces") is None or not len(piece["faces"]):
        raise InputError(path, "no triangles (a point cloud, or an empty file)", "give a mesh")
    return _proxy(path, piece, neighbours.picture)


def _proxy(path: Path, piece: Attributes, picture: F32 | None) -> ProxyMesh:
    vertices, faces = _geometry(path, piece)
    colors, face_colors = (_linear_colors(path, piece.get(f"{kind}_colors")) for kind in ("vertex", "face"))
    normals, uvs = piece.get("vertex_normals"), _uvs(path, piece.get("visual"))
    mesh = ProxyMesh(
        vertices=vertices,
        faces=faces,
        normals=None if normals is None else _checked_normals(path, vertices, faces, normals),
        uvs=None if uvs is None or len(uvs) != len(vertices) else uvs,
        vertex_colors=colors if colors is not None and len(colors) == len(vertices) else None,
        materials=(Material(base_color_texture=picture if uvs is not None else None),),
    )
    if face_colors is not None and mesh.vertex_colors is None and len(face_colors) == len(faces):
        return replace(_unshared(mesh), vertex_colors=np.repeat(face_colors, 3, axis=0))
    return mesh


def _geometry(path: Path, piece: Attributes) -> tuple[F32, I32]:
    with np.errstate(over="ignore"):
        vertices = np.asarray(piece["vertices"], dtype=np.float32)
    faces = np.asarray(piece["faces"])
    if vertices.ndim != 2 or vertices.shape[1] != 3 or faces.ndim != 2 or faces.shape[1] != 3:
        raise InputError(path, f"vertices {vertices.shape} and faces {faces.shape}", "give a triangle mesh")
    bad = int(np.count_nonzero(~np.isfinite(vertices).all(axis=1)))
    if bad:
        raise InputError(path, f"{bad} of {len(vertices)} vertices are NaN or infinite", "repair the mesh")
    if not 0 <= int(faces.min()) <= int(faces.max()) < len(vertices):
        raise InputError(path, f"a face with an index outside 0..{len(vertices) - 1}", "the file is damaged")
    return vertices, faces.astype(np.int32)


def _checked_normals(path: Path, vertices: F32, faces: I32, normals: ArrayLike) -> F32:
    found = np.asarray(normals, dtype=np.float32)
    if found.shape != vertices.shape or not np.all(np.isfinite(found)):
        raise InputError(path, f"normals of shape {found.shape} or not finite", "repair the mesh or drop its normals")
    return filled_normals(vertices, faces, found)


def _linear_colors(path: Path, values: ArrayLike | None) -> F32 | None:
    """Display-encoded RGB or RGBA, integer or 0..1, as linear RGB."""
    if values is None:
        return None
    raw: NDArray[Any] = np.asarray(values)
    if raw.ndim != 2 or raw.shape[1] < 3 or not np.all(np.isfinite(raw)):
        raise InputError(path, f"colours of shape {raw.shape} or not finite", "repair the mesh")
    scale = np.iinfo(raw.dtype).max if raw.dtype.kind in "iu" else 1
    return colour.srgb_decode(np.clip(raw[:, :3].astype(np.float32) / np.float32(scale), 0, 1))


def _uvs(path: Path, visual: Any) -> F32 | None:
    """Texture coordinates with v = 0 at the top; PLY counts v from the bottom."""
    found = getattr(visual, "uv", None)
    if found is None or np.ndim(found) != 2 or np.shape(found)[1] < 2:
        return None
    uvs = np.array(found, dtype=np.float32)[:, :2]
    uvs[:, 1] = 1 - uvs[:, 1]
    if not np.all(np.isfinite(uvs)):
        raise InputError(path, "texture coordinates that are NaN or infinite", "repair the mesh")
    return uvs


def _unshared(mesh: ProxyMesh) -> ProxyMesh:
    """Three vertices of its own for each face."""
    order = mesh.faces.reshape(-1)
    return replace(
        mesh,
        vertices=mesh.vertices[order],
        faces=np.arange(len(order), dtype=np.int32).reshape(-1, 3),
        normals=None if mesh.normals is None else mesh.normals[order],
        uvs=None if mesh.uvs is None else mesh.uvs[order],
        vertex_colors=None if mesh.vertex_colors is None else mesh.vertex_colors[order],
    )
