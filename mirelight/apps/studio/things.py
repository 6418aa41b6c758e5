"""Inserted objects as a page draws them: where they stand, in their own colours, shaded so that their shape shows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirelight.base.errors import InputError
from mirelight.lighting.albedo import face_normals
from mirelight.lighting.materials import texels
from mirelight.lighting.objects import inserted
from mirelight.model import F64, Inserted, ProxyMesh, digest

_LIGHT = np.array([0.4, 0.8, 0.45])  # about where it comes from
_DARK = 0.2  # share of light on what looks away from it


@dataclass(frozen=True, slots=True, eq=False)
class Things:
    """Objects for a page."""

    version: int = 0
    number: int = -1  # of the edit that they are of
    told: tuple[dict[str, Any], ...] = ()  # name, middle of the foot, where that was asked for, size, count of corners
    packed: bytes = b""  # of all corners, three a triangle: (n, 3) float32 places, then (n, 4) uint8 linear colours


class SetDown:
    """The objects of a job that is edited, as they stand on its proxy."""

    def __init__(self) -> None:
        self.things = Things()
        self._made_from, self._wrong = "", ""

    def set_down(self, objects: Sequence[Inserted], proxy: ProxyMesh | None, number: int) -> str:
        """Take an edit's objects; what is wrong with them in a line, and then they stand as they did."""
        key = digest(id(proxy), *((x.mesh.digest, x.drop, x.scatter, x.name) for x in objects))
        if key == self._made_from or proxy is None:
            self.things = replace(self.things, number=number)
            return self._wrong
        self._made_from, self._wrong = key, ""
        try:
            self.things = _things(objects, proxy, self.things.version + 1, number)
        except InputError as error:
            self._wrong = f"{error.found}; {error.remedy}" if error.remedy else error.found
        return self._wrong


def _things(objects: Sequence[Inserted], proxy: ProxyMesh, version: int, number: int) -> Things:
    if not objects:
        return Things(version, number)
    placed = inserted(objects, proxy)
    mesh, owners = placed.mesh, placed.owners[placed.first :]
    faces = mesh.faces[placed.first :]
    colors = _colors(mesh, faces, None if mesh.face_materials is None else mesh.face_materials[placed.first :])
    light = np.clip(face_normals(mesh)[placed.first :] @ (_LIGHT / np.linalg.norm(_LIGHT)), -1, 1) / 2 + 0.5
    shown = colors * (_DARK + (1 - _DARK) * light)[:, None, None]
    rgba = np.concatenate([np.clip(shown, 0, 1), np.ones((*shown.shape[:2], 1))], axis=2)
    told: list[dict[str, Any]] = []
    order = np.argsort(owners, kind="stable")
    for index, one in enumerate(objects):
        corners = mesh.vertices[faces[owners == index]].reshape(-1, 3).astype(np.float64)
        place, size = _foot(corners)
        told.append(
            {
                "name": one.name,
                "place": place.tolist(),
                "asked": _foot(one.mesh.value.vertices.astype(np.float64))[0].tolist(),
                "size": size,
                "count": len(corners),
            }
        )
    places = mesh.vertices[faces[order]].astype("<f4").tobytes()
    return Things(version, number, tuple(told), places + np.round(255 * rgba[order]).astype(np.uint8).tobytes())


def _foot(vertices: F64) -> tuple[F64, float]:
    """The middle of a mesh at its lowest (3,), and how wide it is."""
    if not len(vertices):
        return np.zeros(3), 1.0
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    middle = (low + high) / 2
    return np.array([middle[0], low[1], middle[2]]), float((high - low).max())


def _colors(mesh: ProxyMesh, faces: NDArray[np.integer], owners: NDArray[np.integer] | None) -> F64:
    """(F, 3, 3) linear base colours of the faces' corners."""
    assert mesh.vertex_colors is not None and owners is not None
    out = mesh.vertex_colors[faces].astype(np.float64)
    for index, material in enumerate(mesh.materials):
        own = owners == index
        if not own.any():
            continue
        out[own] *= material.base_color
        picture = material.base_color_texture
        if picture is not None and mesh.uvs is not None:
            out[own] *= texels(picture, material.base_color_wrap, np.moveaxis(mesh.uvs[faces[own]], -1, 0))
    return np.asarray(out)
