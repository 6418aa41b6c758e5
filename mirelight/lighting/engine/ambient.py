"""The engine's image-based diffuse light in NumPy, with its approximations.

`EnvLighting` resamples the map to a cube of 128 texels a face, draws 2048 cosine-distributed samples from its mip
levels for each of 62 x 30 directions, stores the means in 8 bits (RGBP), and looks them up bilinearly by the normal.
Samples at grazing angles come from coarse mip levels, so light leaks round the horizon by a few per cent; that is kept.
Source: PlayCanvas 2.23, `env-lighting.js`, `reproject-texture.js`, chunks ambient, envAtlas, encode, decode.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from mirelight.model import F64, Environment
from mirelight.model.playcanvas_lights import engine_rotation

WIDTH, HEIGHT, SEAM = 64, 32, 1  # pixels of the ambient tile; the map lies inside a seam
SAMPLES = 2048
FACE = 128  # texels of the lighting cube's edge
_SUBSAMPLES = 4  # per texel and axis, from the map to the cube
_RGBP_RANGE = 7.0
_RGBE_GAIN = 256 / 255  # the engine reads a Radiance file's mantissa m as m / 255 where the format means m / 256


def ambient_light(environment: Environment, normals: F64) -> F64:
    """What the engine takes for E(n) / pi.

    Args:
        environment: with mirelight's rotation.
        normals: (N, 3) unit, world space.

    Returns:
        (N, 3) linear, intensity multiplied in.
    """
    turn = np.radians(engine_rotation(environment.rotation))
    x, y, z = normals.T
    # the engine turns the normal by its rotation and mirrors x before it looks into the map
    mirrored, ahead = -(x * np.cos(turn) + z * np.sin(turn)), z * np.cos(turn) - x * np.sin(turn)
    u = np.arctan2(mirrored, ahead) / (2 * np.pi) + 0.5
    v = 0.5 - np.arcsin(np.clip(y, -1, 1)) / np.pi
    column, row = SEAM + u * (WIDTH - 2 * SEAM) - 0.5, SEAM + v * (HEIGHT - 2 * SEAM) - 0.5
    return _decoded(_bilinear(_encoded(ambient_tile(environment)), column, row)) * environment.intensity


@lru_cache(maxsize=8)  # by identity: the frames of a job share their environments
def ambient_tile(environment: Environment) -> F64:
    """(HEIGHT, WIDTH, 3) mean radiance about each direction of the map, seam included, before encoding."""
    if environment.is_constant:
        return np.broadcast_to(environment.pixels[0, 0].astype(np.float64) * _RGBE_GAIN, (HEIGHT, WIDTH, 3))
    first, shares = _shares()
    levels = _cube_levels(environment.pixels.astype(np.float64) * _RGBE_GAIN)[first:]
    return np.asarray(shares @ np.concatenate([x.reshape(-1, 3) for x in levels])).reshape(HEIGHT, WIDTH, 3)


@lru_cache(maxsize=1)
def _shares() -> tuple[int, F64]:
    """(the finest mip level that samples come from; how much each texel of that and of all coarser ones brings to each
    direction of the map (HEIGHT * WIDTH, texels)): of all environments alike."""
    local, level = _samples()
    last = FACE.bit_length() - 1
    lower = np.minimum(np.floor(level).astype(np.int64), last)
    ends = [0, *np.flatnonzero(np.diff(lower)) + 1, SAMPLES]  # samples go from fine levels to coarse ones
    first = int(lower[0])
    sizes = [FACE >> k for k in range(first, last + 1)]
    starts = np.cumsum([0, *(6 * n * n for n in sizes)])
    longitude = np.pi * (2 * (np.arange(WIDTH) + 0.5 - SEAM) / (WIDTH - 2 * SEAM) - 1)
    latitude = np.pi / 2 * (1 - 2 * (np.arange(HEIGHT) + 0.5 - SEAM) / (HEIGHT - 2 * SEAM))
    rows, of_row = [], np.arange(WIDTH)[:, None] * starts[-1]
    for angle in latitude:
        face, s, t = _on_cube(np.einsum("wij,sj->wsi", _frames(angle, longitude), local))
        row = np.zeros(WIDTH * starts[-1])
        for a, b in pairwise(ends):
            k = int(lower[a])
            blend = level[a:b] - k if k < last else np.zeros(b - a)
            for m, share in ((k, 1 - blend), (min(k + 1, last), blend)):
                for place, weight in _around(sizes[m - first], face[:, a:b], s[:, a:b], t[:, a:b]):
                    index = of_row + starts[m - first] + place
                    row += np.bincount(index.ravel(), (weight * share).ravel(), len(row))
        rows.append(row.reshape(WIDTH, -1) / SAMPLES)
    return first, np.concatenate(rows)


def _frames(latitude: float, longitude: F64) -> F64:
    """(W, 3, 3) right, up and the direction itself as columns, of directions of the map."""
    normal = np.stack(
        [
            np.cos(latitude) * np.sin(longitude),
            np.full(len(longitude), np.sin(latitude)),
            np.cos(latitude) * np.cos(longitude),
        ],
        axis=-1,
    )
    right = np.cross([0.0, 1.0, 0.0], normal)
    right /= np.linalg.norm(right, axis=-1, keepdims=True)
    return np.stack([right, np.cross(normal, right), normal], axis=-1)


def _samples() -> tuple[F64, F64]:
    """Cosine-distributed directions (SAMPLES, 3) about +Z, and the mip level of each."""
    i = np.arange(SAMPLES, dtype=np.uint32)
    bits = i.copy()
    for shift, mask in ((16, 0x0000FFFF), (8, 0x00FF00FF), (4, 0x0F0F0F0F), (2, 0x33333333), (1, 0x55555555)):
        bits = ((bits & np.uint32(mask)) << np.uint32(shift)) | ((bits >> np.uint32(shift)) & np.uint32(mask))
    share, phi = i / SAMPLES, 2 * np.pi * bits * 2.0**-32  # Hammersley
    sine, cosine = np.sqrt(share), np.sqrt(1 - share)
    level = 0.5 * np.log2(6 * FACE * FACE / SAMPLES * np.pi / cosine)
    return np.stack([np.cos(phi) * sine, np.sin(phi) * sine, cosine], axis=-1), np.clip(level, 0, 8)


# --- the cube --------------------------------------------------------------------------------------------------------


def _cube_levels(radiance: F64) -> list[F64]:
    """The map as cubes (6, n, n, 3), n = FACE down to 1; faces in OpenGL's order and orientation."""
    faces = radiance.reshape(-1, 3)[_texels(*radiance.shape[:2])]
    level = _halved(_halved(faces))
    levels = [level]
    while level.shape[1] > 1:
        level = _halved(level)
        levels.append(level)
    return levels


@lru_cache(maxsize=2)
def _texels(h: int, w: int) -> NDArray[np.int32]:
    """(6, n, n) which of a map's texels each of the cube's subsamples takes, n = FACE * _SUBSAMPLES."""
    n = FACE * _SUBSAMPLES
    t, s = np.meshgrid(2 * (np.arange(n) + 0.5) / n - 1, 2 * (np.arange(n) + 0.5) / n - 1, indexing="ij")
    one = np.ones_like(s)
    axes = ((one, -t, -s), (-one, -t, s), (s, one, t), (s, -one, -t), (s, -t, one), (-s, -t, -one))
    faces = []
    for x, y, z in axes:
        column = (np.floor((np.arctan2(x, z) / (2 * np.pi) + 0.5) * w)).astype(np.int32) % w
        row = np.floor((0.5 - np.arcsin(y / np.sqrt(x * x + y * y + z * z)) / np.pi) * h).astype(np.int32)
        faces.append(np.clip(row, 0, h - 1) * w + column)
    return np.stack(faces)


def _halved(faces: F64) -> F64:
    count, n = faces.shape[:2]
    return np.asarray(faces.reshape(count, n // 2, 2, n // 2, 2, 3).mean(axis=(2, 4)))


def _on_cube(directions: F64) -> tuple[NDArray[np.int64], F64, F64]:
    """(face, s, t) of directions (..., 3)."""
    x, y, z = np.moveaxis(directions, -1, 0)
    size = np.abs(directions)
    axis = size.argmax(axis=-1)
    face = 2 * axis + (np.take_along_axis(directions, axis[..., None], axis=-1)[..., 0] < 0)
    s = np.choose(face, [-z, z, x, x, x, -x]) / size.max(axis=-1)
    t = np.choose(face, [-y, -y, z, -z, -y, -y]) / size.max(axis=-1)
    return face, s, t


def _around(n: int, face: NDArray[np.int64], s: F64, t: F64) -> Iterator[tuple[NDArray[np.int64], F64]]:
    """(texel of a cube of n texels an edge, weight) of each of the four that are blended, within one face: neighbours
    across an edge are left out."""
    x, y = (np.clip((v + 1) / 2 * n - 0.5, 0, n - 1) for v in (s, t))
    x0, y0 = np.minimum(x.astype(np.int64), max(n - 2, 0)), np.minimum(y.astype(np.int64), max(n - 2, 0))
    fx, fy, beside = x - x0, y - y0, min(1, n - 1)
    corner = (face * n + y0) * n + x0
    yield corner, (1 - fx) * (1 - fy)
    yield corner + beside, fx * (1 - fy)
    yield corner + n * beside, (1 - fx) * fy
    yield corner + (n + 1) * beside, fx * fy


# --- the tile --------------------------------------------------------------------------------------------------------


def _encoded(linear: F64) -> F64:
    """RGBP in 8 bits, (..., 4) of 0..1: square root, and a common scale of 1 to 8 in the last channel."""
    root = np.sqrt(np.maximum(linear, 0))
    peak = np.clip(root.max(axis=-1, keepdims=True), 1, 1 + _RGBP_RANGE)
    share = np.ceil((1 - (peak - 1) / _RGBP_RANGE) * 255) / 255
    color = np.rint(np.clip(root / (1 + _RGBP_RANGE - share * _RGBP_RANGE), 0, 1) * 255) / 255
    return np.concatenate([color, share], axis=-1)


def _decoded(raw: F64) -> F64:
    return np.asarray((raw[..., :3] * (1 + _RGBP_RANGE - raw[..., 3:] * _RGBP_RANGE)) ** 2)


def _bilinear(image: F64, x: F64, y: F64) -> F64:
    """(N, channels); the seam keeps every lookup inside."""
    h, w = image.shape[:2]
    x0, y0 = (np.clip(np.floor(v).astype(np.int64), 0, n - 2) for v, n in ((x, w), (y, h)))
    fx, fy = (x - x0)[:, None], (y - y0)[:, None]
    upper = image[y0, x0] * (1 - fx) + image[y0, x0 + 1] * fx
    lower = image[y0 + 1, x0] * (1 - fx) + image[y0 + 1, x0 + 1] * fx
    return np.asarray(upper * (1 - fy) + lower * fy)
