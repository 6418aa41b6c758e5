"""A glTF file as relighting sees it: one proxy mesh in world space, its lights and its cameras."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from pathlib import Path

import numpy as np

from mirelight.base.errors import InputError, printable
from mirelight.io.gltf import blender
from mirelight.io.gltf.animation import animated_nodes
from mirelight.io.gltf.cameras import GltfCamera, read_node_cameras
from mirelight.io.gltf.deform import joint_matrices, morphed, vertex_matrices
from mirelight.io.gltf.document import Document, read_document
from mirelight.io.gltf.geometry import Piece, check_size, read_mesh_pieces, triangle_primitives
from mirelight.io.gltf.lights import read_node_lights
from mirelight.io.gltf.materials import TexturedMaterial, read_materials
from mirelight.io.gltf.nodes import Matrix, Node, below, called, instance_worlds, moved_to_origin, place_nodes
from mirelight.io.surface import filled_normals, flat_shaded, transformed_normals
from mirelight.model import F32, I32, Light, Material, ProxyMesh
from mirelight.model.shown import names

_BATCH = 1 << 20  # vertices that are placed at once


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GltfScene:
    """What a glTF file holds for relighting."""

    path: Path
    mesh: ProxyMesh | None  # every triangle of the scene in world space; None where there is none
    lights: tuple[Light, ...]  # KHR_lights_punctual, in node order
    cameras: tuple[GltfCamera, ...]  # in node order
    animated_cameras: tuple[str, ...]  # names of the cameras that an animation moves
    blender: str | None  # Blender's exporter with its version, where that wrote the file


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GltfLights:
    """The punctual lights of a glTF file."""

    lights: tuple[Light, ...]  # in node order, lux and candela as in the file
    blender: str | None  # Blender's exporter with its version, where that wrote the file


def read_scene(path: str | Path | Document, *, textures: bool = True, finish: bool = False) -> GltfScene:
    """Read a .glb or .gltf file.

    The mesh's `albedo` is left at its gray default; the file's colours are in `materials` and `vertex_colors`.

    Args:
        path: the file, or what `read_document` gave of it.
        textures: decode base colour textures. Without, no image is opened, and files whose textures cannot be read
            still serve as a plain proxy.
        finish: decode textures of metallic and roughness, too.

    Raises:
        InputError: anything in the file that cannot be used, with its field.
    """
    document = read_document(path)
    nodes = place_nodes(document)
    cameras = read_node_cameras(document, nodes.values())
    moving = animated_nodes(document, nodes)
    return GltfScene(
        path=document.path,
        mesh=_read_proxy(document, nodes, nodes.keys(), textures, finish),
        lights=read_node_lights(document, nodes.values()),
        cameras=cameras,
        animated_cameras=tuple(x.name for x in cameras if x.node in moving),
        blender=blender.exporter(document),
    )


def read_node(
    path: str | Path | Document, name: str, *, textures: bool = True, finish: bool = False
) -> ProxyMesh | None:
    """One node of a file, and all that hang on it, as a mesh: as turned and as large as in the file, with the node's
    own origin at the world's. None where there are no triangles.

    Args:
        path: as for :func:`read_scene`.
        name: the node's, or its mesh's where it has none; of several the first in the file's hierarchy.
        textures: as for :func:`read_scene`.
        finish: as for :func:`read_scene`.

    Raises:
        InputError: as there; there is no such node.
    """
    document = read_document(path)
    nodes = place_nodes(document)
    top = next((x for x in nodes.values() if called(document, x) == name), None)
    if top is None:
        there = _with_triangles(document, nodes)
        near = get_close_matches(name, there, n=3)
        remedy = f"give one of {names([*near, *(x for x in there if x not in near)])}" if there else "leave it out"
        raise InputError(document.path, f"no node named {printable(name)!r}", remedy, field="node")
    return _read_proxy(document, moved_to_origin(nodes, top), below(nodes, top), textures, finish)


def _with_triangles(document: Document, nodes: dict[int, Node]) -> list[str]:
    """Names of the nodes that have a mesh, or on which one hangs that has; parents before children."""
    carry = {x.index for x in nodes.values() if "mesh" in x.fields}
    for node in reversed(nodes.values()):
        if node.index in carry and node.parent is not None:
            carry.add(node.parent)
    return list(dict.fromkeys(called(document, x) for x in nodes.values() if x.index in carry))


def name_groups(path: str | Path | Document, groups: Sequence[Collection[str]]) -> list[str | None]:
    """For groups of a file's nodes that have meshes, by their names: the name of the node on which all of a group hang
    and nothing else, the nearest such; None where there is none.

    Raises:
        InputError: as :func:`read_scene`.
    """
    document = read_document(path)
    nodes = place_nodes(document)
    group_of = {name: k for k, group in enumerate(groups) for name in group}
    counts = [0] * len(groups)
    held: dict[int, tuple[int, int]] = {}  # by node: the one group that it holds, -1 for several; and how many of it
    found: list[str | None] = [None] * len(groups)
    every = list(reversed(nodes.values()))
    for node in every:
        if "mesh" in node.fields and (group := group_of.get(called(document, node))) is not None:
            counts[group] += 1
            held[node.index] = group, 1
    for node in every:  # children before parents
        if node.index not in held:
            continue
        group, count = held[node.index]
        if group >= 0 and found[group] is None and count == counts[group]:
            found[group] = called(document, node)
        if node.parent is not None:
            other, more = held.get(node.parent, (group, 0))
            held[node.parent] = (group, count + more) if other == group else (-1, 0)
    return found


def read_lights(path: str | Path) -> tuple[Light, ...]:
    """The punctual lights of a .glb or .gltf file, without reading its meshes (see :func:`read_scene`)."""
    return read_lights_of(path).lights


def read_lights_of(path: str | Path) -> GltfLights:
    """The same with what wrote them."""
    document = read_document(path)
    lights = read_node_lights(document, place_nodes(document).values())
    return GltfLights(lights=lights, blender=blender.exporter(document))


def read_cameras(path: str | Path) -> tuple[GltfCamera, ...]:
    """The cameras of a .glb or .gltf file, without reading its meshes (see :func:`read_scene`)."""
    document = read_document(path)
    return read_node_cameras(document, place_nodes(document).values())


def _read_proxy(
    document: Document, nodes: dict[int, Node], wanted: Collection[int], textures: bool, finish: bool
) -> ProxyMesh | None:
    carriers = [
        (node, document.entry("meshes", node.fields.integer("mesh"), node.fields, "mesh"))
        for node in nodes.values()
        if "mesh" in node.fields and node.index in wanted
    ]
    worlds = [instance_worlds(document, node) for node, _ in carriers]
    check_size(document, [(mesh, len(w)) for (_, mesh), w in zip(carriers, worlds, strict=True)])
    primitives = [p for mesh in {m.where: m for _, m in carriers}.values() for p in triangle_primitives(mesh)]
    used = {index for p in primitives if (index := p.integer("material", None)) is not None}
    surfaces = read_materials(document, used, textures, finish)
    cache: dict[str, list[Piece]] = {}
    placed: list[Piece] = []
    owners: list[str] = []
    for (node, mesh), poses in zip(carriers, worlds, strict=True):
        if mesh.where not in cache:
            cache[mesh.where] = read_mesh_pieces(document, mesh, surfaces)
        joints = joint_matrices(document, nodes, node)
        owners += [called(document, node)] * len(cache[mesh.where])
        for piece in cache[mesh.where]:
            shape = morphed(piece, mesh, node)
            if joints is not None:
                placed.append(_moved(shape, vertex_matrices(shape, joints)))
            else:
                placed.append(_moved(shape, poses[0]) if len(poses) == 1 else _instanced(shape, poses))
    return _merged(placed, owners, surfaces) if placed else None


def _moved(piece: Piece, world: Matrix) -> Piece:
    """The piece in world space; `world` is one matrix (4, 4) or one per vertex (V, 4, 4).

    Normals go by the inverse transpose; a mirrored piece's winding is turned, so that its outside stays outside
    (glTF §3.7.4).
    """
    if np.array_equal(world, np.eye(4)):
        return piece
    linear, offset = world[..., :3, :3], world[..., :3, 3]
    placed = np.einsum("...ij,...j->...i", linear, piece.positions.astype(np.float64)) + offset
    with np.errstate(over="ignore"):
        positions = placed.astype(np.float32)
    if not np.all(np.isfinite(positions)):
        raise piece.fields.fail("attributes.POSITION", "positions that are not finite in world space", "scale it down")
    faces, normals = piece.faces, piece.normals
    if np.median(np.linalg.det(linear)) < 0:
        faces = np.ascontiguousarray(faces[:, ::-1])
    if normals is not None:
        normals = transformed_normals(normals, linear)
    return replace(piece, positions=positions, faces=faces, normals=normals)


def _instanced(piece: Piece, worlds: Matrix) -> Piece:
    """The piece once for each of N world matrices (N, 4, 4), one after the other, as :func:`_moved` places each.

    All at once: a file of a few hundred bytes may ask for a million.
    """
    count, vertices = len(worlds), len(piece.positions)
    positions = np.empty((count, vertices, 3), dtype=np.float32)
    normals = None if piece.normals is None else np.empty_like(positions)
    step = max(1, _BATCH // vertices)
    for at in range(0, count, step):
        some = slice(at, at + step)
        linear, offset = worlds[some, None, :3, :3], worlds[some, None, :3, 3]
        with np.errstate(over="ignore"):
            positions[some] = np.einsum("...ij,...j->...i", linear, piece.positions.astype(np.float64)) + offset
        if normals is not None and piece.normals is not None:
            normals[some] = transformed_normals(piece.normals, linear)
    if not np.all(np.isfinite(positions)):
        raise piece.fields.fail("attributes.POSITION", "positions that are not finite in world space", "scale it down")
    mirrored = np.linalg.det(worlds[:, :3, :3]) < 0
    faces = np.where(mirrored[:, None, None], piece.faces[None, :, ::-1], piece.faces[None])
    faces = faces + (np.arange(count, dtype=np.int32) * np.int32(vertices))[:, None, None]
    return replace(
        piece,
        positions=positions.reshape(-1, 3),
        faces=faces.reshape(-1, 3).astype(np.int32),
        face_materials=np.tile(piece.face_materials, count),
        normals=None if normals is None else normals.reshape(-1, 3),
        uvs=None if piece.uvs is None else np.tile(piece.uvs, (count, 1)),
        colors=None if piece.colors is None else np.tile(piece.colors, (count, 1)),
    )


def _merged(pieces: list[Piece], owners: list[str], surfaces: dict[int, TexturedMaterial]) -> ProxyMesh:
    """One mesh of all pieces and their nodes' names. Attributes that only some have are filled in: white, uv 0, the
    faces' own normals."""
    if any(p.normals is not None for p in pieces):
        pieces = [p if p.normals is not None else _with_flat_normals(p) for p in pieces]
    offsets = np.cumsum([0] + [len(p.positions) for p in pieces])
    faces = np.concatenate([p.faces + np.int32(at) for p, at in zip(pieces, offsets, strict=False)])
    positions = np.concatenate([p.positions for p in pieces])
    normals = _joined([p.normals for p in pieces], pieces, 3, 0.0)
    materials, face_materials = _material_table(pieces, surfaces)
    names = tuple(dict.fromkeys(owners))
    of_piece = {name: i for i, name in enumerate(names)}
    return ProxyMesh(
        vertices=positions,
        faces=faces,
        normals=None if normals is None else filled_normals(positions, faces, normals),
        uvs=_joined([p.uvs for p in pieces], pieces, 2, 0.0),
        vertex_colors=_joined([p.colors for p in pieces], pieces, 3, 1.0),
        face_materials=face_materials,
        materials=materials,
        face_nodes=np.repeat([of_piece[x] for x in owners], [len(p.faces) for p in pieces]).astype(np.int32),
        nodes=names,
    )


def _joined(parts: list[F32 | None], pieces: list[Piece], width: int, fill: float) -> F32 | None:
    if all(x is None for x in parts):
        return None
    blanks = [np.full((len(p.positions), width), fill, dtype=np.float32) for p in pieces]
    return np.concatenate([blank if x is None else x for x, blank in zip(parts, blanks, strict=True)])


def _material_table(
    pieces: list[Piece], surfaces: dict[int, TexturedMaterial]
) -> tuple[tuple[Material, ...], I32 | None]:
    """The materials in use and each face's index into them; None where there is only one."""
    indices = np.concatenate([p.face_materials for p in pieces])
    used, compact = np.unique(indices, return_inverse=True)
    materials = tuple(Material(metallic=1.0) if i < 0 else surfaces[int(i)].material for i in used)
    return materials, None if len(used) == 1 else compact.astype(np.int32)


def _with_flat_normals(piece: Piece) -> Piece:
    """The piece with three vertices of its own for each face and the face's normal on them (glTF §3.7.2.1)."""
    order, normals = flat_shaded(piece.positions, piece.faces)
    return replace(
        piece,
        positions=piece.positions[order],
        faces=np.arange(len(order), dtype=np.int32).reshape(-1, 3),
        normals=normals,
        uvs=None if piece.uvs is None else piece.uvs[order],
        colors=None if piece.colors is None else piece.colors[order],
    )
