"""Meshes of a stage as one proxy, in its world: metres, Y up."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mirelight.base import colour
from mirelight.base.errors import InputError
from mirelight.io.environment import read_environment
from mirelight.io.surface import filled_normals
from mirelight.io.usd.process import Read, ask
from mirelight.io.usd.rows import MaterialRow, Request
from mirelight.model import F32, Material, ProxyMesh
from mirelight.model.scene import Wraps

_SCENE_LIGHT = (".exr", ".hdr")  # pictures that hold linear values by themselves


def read_proxy(path: str | Path, *, textures: bool = True) -> ProxyMesh | None:
    """The meshes of a stage: those of purpose proxy where it has some, else all that is drawn; None without any.

    Args:
        path: the stage.
        textures: read base colour and emission textures too.

    Raises:
        InputError: it cannot be used.
    """
    with ask(path, Request(path=str(path), part="mesh", textures=textures)) as read:
        vertices, faces = read.array("vertices"), read.array("faces")
        if vertices is None or faces is None:
            return None
        points, corners = np.array(vertices, np.float32), np.array(faces, np.int32)
        normals, uvs = _own(read, "normals"), _own(read, "uvs")
        if uvs is not None:
            uvs[:, 1] = 1 - uvs[:, 1]  # a stage counts v from the bottom
        used, compact = np.unique(np.array(read.array("face_materials")), return_inverse=True)
        nodes = read.array("face_nodes")
        return ProxyMesh(
            vertices=points,
            faces=corners,
            normals=None if normals is None else filled_normals(points, corners, normals),
            uvs=uvs,
            vertex_colors=_own(read, "colors"),
            face_materials=None if len(used) == 1 else compact.astype(np.int32),
            materials=tuple(Material() if i < 0 else _material(read, read.answer.materials[i]) for i in used),
            face_nodes=None if nodes is None else np.array(nodes, np.int32),
            nodes=tuple(read.answer.nodes),
        )


def _own(read: Read, name: str) -> F32 | None:
    found = read.array(name)
    return None if found is None else np.array(found, np.float32)


def _material(read: Read, row: MaterialRow) -> Material:
    return Material(
        name=row.name,
        base_color=np.array(row.base_color),
        base_color_texture=_texture(read, row.base_color_file, row.base_color_raw, row.prim),
        base_color_wrap=_wraps(row.base_color_wrap),
        emissive=np.array(row.emissive),
        emissive_texture=_texture(read, row.emissive_file, row.emissive_raw, row.prim),
        emissive_wrap=_wraps(row.emissive_wrap),
    )


def _wraps(found: list[str]) -> Wraps:
    u, v = found
    return u, v  # type: ignore[return-value]


def _texture(read: Read, name: str, raw: bool, prim: str) -> F32 | None:
    if not name:
        return None
    picture = read.folder / name
    try:
        found = read_environment(picture)
    except InputError as e:
        raise InputError(read.path, f"a texture: {e.found}", e.remedy, field=prim) from None
    return colour.srgb_encode(found) if raw and picture.suffix not in _SCENE_LIGHT else found
