"""Proxy meshes: glTF and GLB by this package's own reader, PLY, OBJ and STL by trimesh's."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mirelight import colour
from mirelight.errors import InputError
from mirelight.io.gltf.scene import read_scene
from mirelight.io.ldr import decode_srgb_image
from mirelight.io.safety import contained, existing, open_binary
from mirelight.io.surface import filled_normals, flat_shaded, transformed_normals
from mirelight.model import F32, I32, Material, ProxyMesh

SUFFIXES = (".glb", ".gltf", ".ply", ".obj", ".stl")

Attributes = Mapping[str, Any]


def read_mesh(path: str | Path, *, textures: bool = True) -> ProxyMesh:
    """A proxy mesh, its vertices neither merged nor reordered.

    The `albedo` is left at its gray default; the file's colours are in `materials` and `vertex_colors`. Vertex colours of
    PLY and OBJ files are taken as display-encoded (as scanning tools write them) and decoded to linear light; those of
    glTF files are linear by specification. An OBJ material's map_Kd replaces its Kd.

    Args:
        path: .glb, .gltf, .ply, .obj or .stl.
        textures: read textures too. Without, no image is opened.

    Raises:
        InputError: missing, damaged, without triangles, or with vertices that are NaN or infinite.
    """
    path = existing(path)
    suffix = path.suffix.lower()
    if path.is_dir() or suffix not in SUFFIXES:
        raise InputError(path, "not a mesh file", "give one of " + ", ".join(SUFFIXES))
    if suffix in (".glb", ".gltf"):
        mesh = read_scene(path, textures=textures).mesh
        if mesh is None:
            raise InputError(path, "no triangles in its scene (points and lines do not count)", "give a mesh")
        return mesh
    return _merged(path, _load(path, suffix, textures))


def transform(mesh: ProxyMesh, matrix: ArrayLike) -> ProxyMesh:
    """The mesh moved by an affine matrix (4, 4).

    Normals go by the inverse transpose. A mirroring matrix also turns each triangle's winding, so that the outside stays
    outside.
    """
    m = np.asarray(matrix, dtype=np.float64)
    if np.array_equal(m, np.eye(4)):
        return mesh
    linear = m[:3, :3]
    vertices = (mesh.vertices.astype(np.float64) @ linear.T + m[:3, 3]).astype(np.float32)
    faces = mesh.faces[:, ::-1] if np.linalg.det(linear) < 0 else mesh.faces
    normals = None if mesh.normals is None else transformed_normals(mesh.normals, linear)
    return replace(mesh, vertices=vertices, faces=faces, normals=normals)


# --- PLY, OBJ, STL ---------------------------------------------------------------------------------------------------


class _Neighbours:
    """Opens the files that an OBJ names, from its folder or below; remembers the first that must not be opened."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.refused: InputError | None = None

    def get(self, name: str) -> bytes:
        """The bytes of a neighbouring file (trimesh's resolver interface)."""
        try:
            target = contained(self.path.parent, name.strip().replace("\\", "/"), self.path, "mtllib")
        except InputError as e:
            self.refused = self.refused or e
            raise OSError(str(e)) from None
        return target.read_bytes()

    def __getitem__(self, name: str) -> bytes:
        return self.get(name)


def _load(path: Path, suffix: str, textures: bool) -> list[Attributes]:
    """What trimesh's loader found, one set of attributes per piece."""
    from trimesh.exchange import obj, ply, stl

    neighbours = _Neighbours(path)
    try:
        with open_binary(path) as stream:
            if suffix == ".ply":
                found = ply.load_ply(stream, resolver=neighbours, fix_texture=False, skip_materials=True)
            elif suffix == ".obj":
                found = obj.load_obj(stream, resolver=neighbours, maintain_order=True, skip_materials=not textures)
            else:
                found = stl.load_stl(stream)
    except InputError:
        raise
    except Exception as e:  # trimesh raises whatever its parsing runs into
        reason = f"a {suffix[1:].upper()} file that cannot be read ({type(e).__name__})"
        raise InputError(path, reason, "the file is damaged or of another kind") from None
    if neighbours.refused is not None:
        raise neighbours.refused
    pieces = list(found["geometry"].values()) if "geometry" in found else [found]
    return [piece for piece in pieces if piece.get("faces") is not None and len(piece["faces"])]


def _merged(path: Path, pieces: list[Attributes]) -> ProxyMesh:
    if not pieces:
        raise InputError(path, "no triangles (a point cloud, or an empty file)", "give a mesh")
    parts = [_piece(path, piece) for piece in pieces]
    normals = [part.normals for part in parts]
    if any(n is not None for n in normals) and any(n is None for n in normals):
        parts = [part if part.normals is not None else _with_flat_normals(part) for part in parts]
    offsets = np.cumsum([0] + [len(part.vertices) for part in parts])[:-1]
    owners = np.repeat(np.arange(len(parts), dtype=np.int32), [len(part.faces) for part in parts])
    return ProxyMesh(
        vertices=np.concatenate([part.vertices for part in parts]),
        faces=np.concatenate([part.faces + np.int32(at) for part, at in zip(parts, offsets, strict=True)]),
        normals=_joined([part.normals for part in parts], parts, 3, 0.0),
        uvs=_joined([part.uvs for part in parts], parts, 2, 0.0),
        vertex_colors=_joined([part.vertex_colors for part in parts], parts, 3, 1.0),
        face_materials=owners if len(parts) > 1 else None,
        materials=tuple(part.materials[0] for part in parts),
    )


def _joined(values: list[F32 | None], parts: list[ProxyMesh], width: int, fill: float) -> F32 | None:
    if all(x is None for x in values):
        return None
    blanks = [np.full((len(part.vertices), width), fill, dtype=np.float32) for part in parts]
    return np.concatenate([blank if x is None else x for x, blank in zip(values, blanks, strict=True)])


def _piece(path: Path, piece: Attributes) -> ProxyMesh:
    vertices, faces = _geometry(path, piece)
    colors, face_colors = (_linear_colors(path, piece.get(f"{kind}_colors")) for kind in ("vertex", "face"))
    normals, (uvs, material) = piece.get("vertex_normals"), _surface(path, piece.get("visual"))
    part = ProxyMesh(
        vertices=vertices,
        faces=faces,
        normals=None if normals is None else _checked_normals(path, vertices, faces, normals),
        uvs=None if uvs is None or len(uvs) != len(vertices) else uvs,
        vertex_colors=colors if colors is not None and len(colors) == len(vertices) else None,
        materials=(material,),
    )
    if face_colors is not None and part.vertex_colors is None and len(face_colors) == len(faces):
        part = replace(_unshared(part), vertex_colors=np.repeat(face_colors, 3, axis=0))
    return part


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


def _surface(path: Path, visual: Any) -> tuple[NDArray[Any] | None, Material]:
    """Texture coordinates with v = 0 at the top, and the material, of trimesh's texture visual."""
    uv, material = getattr(visual, "uv", None), getattr(visual, "material", None)
    uvs = None
    if uv is not None and np.ndim(uv) == 2 and np.shape(uv)[1] >= 2:
        uvs = np.asarray(uv, dtype=np.float32)[:, :2] * np.float32((1, -1)) + np.float32((0, 1))
        if not np.all(np.isfinite(uvs)):
            raise InputError(path, "texture coordinates that are NaN or infinite", "repair the mesh")
    if material is None:
        return uvs, Material()
    name = str(getattr(material, "name", None) or "default")
    image = getattr(material, "image", None)
    if image is not None and uvs is not None:
        return uvs, Material(name=name, base_color_texture=_texture(path, image))
    diffuse = np.asarray(getattr(material, "diffuse", (255, 255, 255)), dtype=np.float64)[:3] / 255
    return uvs, Material(name=name, base_color=diffuse)


def _texture(path: Path, image: Any) -> F32:
    """An opened Pillow image, decoded by the common decoder."""
    stream = getattr(image, "fp", None)
    if stream is None:
        raise InputError(path, "a texture that cannot be read", "give a sound PNG or JPEG image")
    stream.seek(0)
    return decode_srgb_image(stream, path, "map_Kd")


def _unshared(part: ProxyMesh) -> ProxyMesh:
    """Three vertices of its own for each face."""
    order = part.faces.reshape(-1)
    return replace(
        part,
        vertices=part.vertices[order],
        faces=np.arange(len(order), dtype=np.int32).reshape(-1, 3),
        normals=None if part.normals is None else part.normals[order],
        uvs=None if part.uvs is None else part.uvs[order],
        vertex_colors=None if part.vertex_colors is None else part.vertex_colors[order],
    )


def _with_flat_normals(part: ProxyMesh) -> ProxyMesh:
    _, normals = flat_shaded(part.vertices, part.faces)
    return replace(_unshared(part), normals=normals)
