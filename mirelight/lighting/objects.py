"""Inserted objects as meshes: set down on the proxy, and joined with it to what is traced. NumPy only."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np

from mirelight.lighting.ground import Ground, box_round, dropped
from mirelight.lighting.scattered import scattered
from mirelight.model import F32, F64, I32, Inserted, Material, ProxyMesh


@dataclass(frozen=True, slots=True, eq=False)
class Placed:
    """The proxy with objects where they belong, as one mesh with the file's colours."""

    mesh: ProxyMesh
    first: int  # face of theirs
    owners: I32  # (F,) index of the object that a face is of, -1: the proxy
    boxes: F64  # (n, 4, 4) of each object: world from the cube of side 1 about 0, along its own axes

    @property
    def alone(self) -> ProxyMesh:
        """The objects without the proxy."""
        mesh, faces = self.mesh, self.mesh.faces[self.first :]
        start = int(faces.min(initial=len(mesh.vertices)))

        def theirs(values: F32 | None) -> F32 | None:
            return None if values is None else values[start:]

        return replace(
            mesh,
            vertices=mesh.vertices[start:],
            faces=faces - np.int32(start),
            normals=theirs(mesh.normals),
            uvs=theirs(mesh.uvs),
            vertex_colors=theirs(mesh.vertex_colors),
            face_materials=None if mesh.face_materials is None else mesh.face_materials[self.first :],
            face_nodes=None,
        )


def inserted(objects: Sequence[Inserted], proxy: ProxyMesh) -> Placed:
    """Objects set down and joined with the proxy; those that are scattered come after the rest, and keep clear of it.

    Raises:
        InputError: one that is to be dropped where there is no proxy below or above, or that fits nowhere.
    """
    placed: dict[int, ProxyMesh] = {}
    boxes: dict[int, F64] = {}
    ground = cache(partial(Ground.of, proxy))
    for place, one in sorted(enumerate(objects), key=lambda x: x[1].scatter is not None):
        mesh, turn = one.mesh.value, np.eye(3)
        if one.scatter is not None:
            mesh, turn = scattered(one, place, ground(), tuple(boxes.values()))
        elif one.drop:
            mesh, turn = dropped(one, mesh, ground())
        placed[place], boxes[place] = mesh, box_round(turn @ one.world_from_object[:3, :3], mesh)
    set_down = [placed[place] for place in range(len(objects))]
    counts = [len(proxy.faces), *(len(x.faces) for x in set_down)]
    return Placed(
        mesh=joined([_with_own_colors(proxy), *map(_with_own_colors, set_down)]),
        first=len(proxy.faces),
        owners=np.repeat(np.arange(-1, len(set_down), dtype=np.int32), counts),
        boxes=np.array([boxes[place] for place in range(len(objects))]).reshape(-1, 4, 4),
    )


def _with_own_colors(mesh: ProxyMesh) -> ProxyMesh:
    """The same look told by vertex colours and materials alone, both there."""
    colors = np.ones_like(mesh.vertices) if mesh.vertex_colors is None else mesh.vertex_colors
    materials = mesh.materials
    if mesh.albedo is not None:
        colors = np.broadcast_to(mesh.albedo.astype(np.float32), mesh.vertices.shape)
        materials = tuple(replace(m, base_color=np.ones(3), base_color_texture=None) for m in materials)
    return replace(mesh, vertex_colors=colors, materials=materials, face_materials=mesh.owners, albedo=None)


def joined(meshes: Sequence[ProxyMesh]) -> ProxyMesh:
    """One mesh of several that have vertex colours and materials of faces; normals of one without are 0: flat."""
    vertices = np.cumsum([0] + [len(m.vertices) for m in meshes])
    materials = np.cumsum([0] + [len(m.materials) for m in meshes])
    own: list[Material] = [x for m in meshes for x in m.materials]
    return ProxyMesh(
        vertices=np.concatenate([m.vertices for m in meshes]),
        faces=np.concatenate([m.faces + np.int32(k) for m, k in zip(meshes, vertices, strict=False)]),
        normals=_filled([m.normals for m in meshes], meshes, 3),
        uvs=_filled([m.uvs for m in meshes], meshes, 2),
        vertex_colors=np.concatenate([_there(m.vertex_colors) for m in meshes]),
        face_materials=np.concatenate(
            [_there(m.face_materials) + np.int32(k) for m, k in zip(meshes, materials, strict=False)]
        ),
        materials=tuple(own),
        albedo=None,
    )


def _there(values: F32 | I32 | None) -> F32 | I32:
    assert values is not None
    return values


def _filled(parts: Sequence[F32 | None], meshes: Sequence[ProxyMesh], width: int) -> F32 | None:
    if all(x is None for x in parts):
        return None
    blanks = (np.zeros((len(m.vertices), width), np.float32) for m in meshes)
    return np.concatenate([blank if x is None else x for x, blank in zip(parts, blanks, strict=True)])
