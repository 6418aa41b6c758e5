"""A proxy's materials as tables of floats for the device. NumPy only."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirelight.model import F32, F64, Material, ProxyMesh, Wraps, triangles

GLOW_SLOTS = 1 << 18  # draws of an emissive face come in so many equal shares
TEXTURED = 7  # groups of a material's row that a texture may multiply:
BASE_COLOR, EMISSION, FINISH, NORMAL, ALPHA, SPECULAR, LAYERS = range(TEXTURED)
ROW = 4 * (2 * TEXTURED + 1)  # floats a material
WRAP_CODE = {"repeat": 0, "mirror": 1, "clamp": 2}
_LOOKUPS = 1 << 22  # texture look-ups that the power of textured faces is taken from
_AT_ONCE = 1 << 20


@dataclass(frozen=True, slots=True, eq=False)
class Atlas:
    """A row a material: colour, wrap | emission, wrap | 1, roughness, metallic, wrap | scale of normals, wrap |
    alpha, cutoff, whether there is one, wrap | specular, wrap | clear coat, its roughness, transmission, wrap | the
    place of each one's texture | weight of specular, 0, 0, 0.

    A place is width, height, first texel (low, high half); a wrap is the code along u plus three times that along v.
    """

    rows: F32  # (materials + 1, ROW)
    texels: F32 | None  # flat groups of four floats; None: no texture
    of_face: NDArray[np.uint32]  # (F + 2,) row of each face


def is_emissive(proxy: ProxyMesh) -> bool:
    """True where some material glows."""
    return any(_glows(m) for m in proxy.materials)


def textured(proxy: ProxyMesh) -> frozenset[int]:
    """Groups of rows that some texture multiplies."""
    if proxy.uvs is None:
        return frozenset()
    return frozenset(k for m in proxy.materials for k, x in enumerate(_textures(m)) if x is not None)


def _textures(material: Material) -> tuple[F32 | None, ...]:
    """(TEXTURED) of each group."""
    return (
        material.base_color_texture,
        material.emissive_texture if _glows(material) else None,
        material.finish_texture,
        material.normal_texture,
        material.alpha_texture,
        material.specular_texture,
        material.layer_texture,
    )


def has_cutouts(proxy: ProxyMesh) -> bool:
    """True where something shows through some material."""
    return any(m.alpha < 1 or m.alpha_texture is not None for m in proxy.materials)


def has_glass(proxy: ProxyMesh) -> bool:
    """True where light goes through some material."""
    return any(m.transmission > 0 for m in proxy.materials)


def has_coats(proxy: ProxyMesh) -> bool:
    """True where some material is lacquered."""
    return any(m.clearcoat > 0 for m in proxy.materials)


def _glows(material: Material) -> bool:
    return bool(np.any(material.emissive > 0))


@dataclass(frozen=True, slots=True, eq=False)
class Glow:
    """Emissive triangles, to be drawn in proportion to the power of each."""

    slots: NDArray[np.uint32]  # (GLOW_SLOTS,) a face each
    density: F32  # (F + 2,) probability per area of a point on each face


def pack_glow(proxy: ProxyMesh) -> Glow:
    """The sampling table of an emissive proxy; a face's share of the slots is its probability.

    Faces whose power comes out as nothing are left to the reflected ray, which finds them with its full weight.
    """
    v = proxy.vertices[proxy.faces].astype(np.float64)
    area = triangles.areas(v)
    power = area * _brightness(proxy)
    ends = np.floor(np.cumsum(power) / max(power.sum(), 1e-300) * GLOW_SLOTS + 0.5).astype(np.int64)
    counts = np.diff(ends, prepend=0)
    slots = np.repeat(np.arange(len(v), dtype=np.uint32), counts)
    density = np.zeros(len(v) + 2, np.float32)
    density[: len(v)] = counts / max(len(slots), 1) / np.maximum(area, 1e-30)
    return Glow(slots if len(slots) else np.zeros(2, np.uint32), density)


def _brightness(proxy: ProxyMesh) -> F64:
    """(F,) mean radiance over channels and over each face."""
    out = np.asarray([m.emissive.mean() for m in proxy.materials])[proxy.owners]
    if proxy.uvs is None:
        return out
    for index, material in enumerate(proxy.materials):
        if material.emissive_texture is not None and _glows(material):
            faces = np.flatnonzero(proxy.owners == index)
            seen = (material.emissive_texture @ material.emissive.astype(np.float32)) / np.float32(3)
            out[faces] = _face_means(seen, material.emissive_wrap, proxy.uvs[proxy.faces[faces]])
    return out


def _face_means(image: F32, wraps: Wraps, uvs: F32) -> F64:
    """(n,) means of an image (h, w) over triangles with coordinates (n, 3, 2), from evenly spread look-ups."""
    if not len(uvs):
        return np.zeros(0)
    count = int(np.clip(_LOOKUPS // len(uvs), 4, 4096))
    k = np.arange(count)
    s, t = (k + 0.5) / count, (k * 0.6180339887498949 + 0.5) % 1  # golden-ratio lattice on the square
    root = np.sqrt(s)
    weights = np.stack([1 - root, root * (1 - t), root * t]).astype(np.float32)  # even over a triangle
    step = max(_AT_ONCE // count, 1)
    means = [_looked_up(image, wraps, uvs[i : i + step], weights) for i in range(0, len(uvs), step)]
    return np.concatenate(means)


def _looked_up(image: F32, wraps: Wraps, uvs: F32, weights: F32) -> F64:
    found = texels(image, wraps, np.einsum("nkc,kp->cnp", uvs, weights))
    return np.asarray(found.mean(axis=1, dtype=np.float64))


def texels(image: F32, wraps: Wraps, at: F32) -> F32:
    """The texels of an image (h, w, ...) at coordinates (2, ...), across and down, wrapped as the image says."""
    height, width = image.shape[:2]
    x, y = (
        np.clip((_wrapped(a, wrap) * size).astype(np.int64), 0, size - 1)
        for a, wrap, size in zip(at, wraps, (width, height), strict=True)
    )
    return np.asarray(image[y, x])


def _wrapped(a: F32, wrap: str) -> F32:
    """Texture coordinates brought into 0..1."""
    if wrap == "clamp":
        return np.clip(a, 0, 1)
    if wrap == "mirror":
        return np.asarray(1 - np.abs(1 - np.mod(a, 2)), np.float32)
    return np.asarray(a - np.floor(a), np.float32)


def is_flat(proxy: ProxyMesh, first: int) -> bool:
    """Whether the faces before `first` have no shading normals but 0."""
    return proxy.normals is None or not proxy.normals[proxy.faces[:first]].any()


def is_plain(proxy: ProxyMesh, first: int) -> bool:
    """Whether the faces before `first` are of the first material, and that has no texture of its base colour."""
    owners = proxy.face_materials
    return proxy.materials[0].base_color_texture is None and (owners is None or not owners[:first].any())


def pack_materials(proxy: ProxyMesh) -> Atlas:
    """The materials of a proxy; a material without a texture points at one white texel."""
    rows = np.zeros((len(proxy.materials) + 1, ROW), np.float32)
    parts = [np.ones((2, 4), np.float32)]
    first = 2
    for row, material in zip(rows, proxy.materials, strict=False):
        row[0:3], row[3] = material.base_color, _wrap_code(material.base_color_wrap)
        row[4:7], row[7] = material.emissive, _wrap_code(material.emissive_wrap)
        row[8:11], row[11] = (1, material.roughness, material.metallic), _wrap_code(material.finish_wrap)
        scale = 0.0 if material.normal_texture is None or proxy.uvs is None else material.normal_scale
        row[12:15], row[15] = scale, _wrap_code(material.normal_wrap)
        row[16:19], row[19] = (material.alpha, material.cutoff or 0, material.cutoff is not None), row[3]
        row[20:23], row[23] = material.specular, _wrap_code(material.specular_wrap)
        row[24:27] = material.clearcoat, material.clearcoat_roughness, material.transmission
        row[27], row[8 * TEXTURED] = _wrap_code(material.layer_wrap), material.specular_weight
        places = row[4 * TEXTURED : 8 * TEXTURED].reshape(TEXTURED, 4)
        for place, texture in zip(places, _textures(material), strict=True):
            if texture is None or proxy.uvs is None:
                place[:] = (1, 1, 0, 0)
                continue
            h, w = texture.shape[:2]
            place[:] = (w, h, first & 0xFFFF, first >> 16)
            part = np.zeros((h * w, 4), np.float32)
            part[:, : texture.shape[2]] = texture.reshape(h * w, -1)
            parts.append(part)
            first += h * w
    faces = len(proxy.faces)
    of_face = np.zeros(faces + 2, np.uint32)
    if proxy.face_materials is not None:
        of_face[:faces] = proxy.face_materials
    return Atlas(rows, np.concatenate(parts).ravel() if len(parts) > 1 else None, of_face)


def _wrap_code(wraps: Wraps) -> float:
    return float(WRAP_CODE[wraps[0]] + 3 * WRAP_CODE[wraps[1]])
