"""A proxy's materials as tables of floats for the device. NumPy only."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirelight.model import F32, ProxyMesh


@dataclass(frozen=True, slots=True, eq=False)
class Atlas:
    """Rows of 12 floats a material: base colour, 0 | emission, 0 | texture width, height, first texel (low, high 16)."""

    rows: F32  # (materials + 1, 12)
    texels: F32 | None  # flat groups of four floats; None: no texture
    of_face: NDArray[np.uint32]  # (F + 2,) row of each face


def pack_materials(proxy: ProxyMesh) -> Atlas:
    """The materials of a proxy; a material without a texture points at one white texel."""
    textured = proxy.uvs is not None and any(m.base_color_texture is not None for m in proxy.materials)
    rows = np.zeros((len(proxy.materials) + 1, 12), np.float32)
    parts = [np.ones((2, 4), np.float32)]
    first = 2
    for row, material in zip(rows, proxy.materials, strict=False):
        row[0:3] = material.base_color
        row[4:7] = material.emissive
        texture = material.base_color_texture if textured else None
        if texture is None:
            row[8:12] = (1, 1, 0, 0)
            continue
        h, w = texture.shape[:2]
        row[8:12] = (w, h, first & 0xFFFF, first >> 16)
        part = np.zeros((h * w, 4), np.float32)
        part[:, :3] = texture.reshape(-1, 3)
        parts.append(part)
        first += h * w
    faces = len(proxy.faces)
    of_face = np.zeros(faces + 2, np.uint32)
    if proxy.face_materials is not None:
        of_face[:faces] = proxy.face_materials
    return Atlas(rows, np.concatenate(parts).ravel() if textured else None, of_face)
