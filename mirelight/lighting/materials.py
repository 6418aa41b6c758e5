"""A proxy's materials as tables of floats for the device. NumPy only."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirelight.model import F32, ProxyMesh

GLOW_SLOTS = 1 << 18  # draws of an emissive face come in so many equal shares


@dataclass(frozen=True, slots=True, eq=False)
class Atlas:
    """Rows of 12 floats a material: colour, 0 | emission, 0 | texture width, height, first texel (low, high half)."""

    rows: F32  # (materials + 1, 12)
    texels: F32 | None  # flat groups of four floats; None: no texture
    of_face: NDArray[np.uint32]  # (F + 2,) row of each face


def is_emissive(proxy: ProxyMesh) -> bool:
    """True where some material glows."""
    return any(bool(np.any(m.emissive > 0)) for m in proxy.materials)


@dataclass(frozen=True, slots=True, eq=False)
class Glow:
    """Emissive triangles, to be drawn in proportion to the power of each."""

    slots: NDArray[np.uint32]  # (GLOW_SLOTS,) a face each
    density: F32  # (F + 2,) probability per area of a point on each face


def pack_glow(proxy: ProxyMesh) -> Glow:
    """The sampling table of an emissive proxy; a face's share of the slots is its probability."""
    v = proxy.vertices[proxy.faces].astype(np.float64)
    area = np.linalg.norm(np.cross(v[:, 1] - v[:, 0], v[:, 2] - v[:, 0]), axis=1) / 2
    brightness = np.asarray([m.emissive.mean() for m in proxy.materials])
    material = np.zeros(len(v), np.int64) if proxy.face_materials is None else proxy.face_materials
    power = area * brightness[material]
    ends = np.floor(np.cumsum(power) / max(power.sum(), 1e-300) * GLOW_SLOTS + 0.5).astype(np.int64)
    counts = np.diff(ends, prepend=0)
    slots = np.repeat(np.arange(len(v), dtype=np.uint32), counts)
    density = np.zeros(len(v) + 2, np.float32)
    density[: len(v)] = counts / max(len(slots), 1) / np.maximum(area, 1e-30)
    return Glow(slots if len(slots) else np.zeros(2, np.uint32), density)


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
