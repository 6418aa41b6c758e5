"""The usual 16 x 16-tile splat rasteriser, ported to Numba in a straightforward way: the benchmark's yardstick.

One thread. Follows the stages of the 3D Gaussian splatting CUDA kernel: preprocess with a 3 sigma square, one key of
(tile, depth) per splat and tile, one sort, then every pixel of a tile walks the tile's list.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from mirelight.base import sh as spherical
from mirelight.compositor.source import factors_of, shape_of
from mirelight.model import F32, Camera, CompositorSettings, SplatCloud

TILE = 16


@dataclass(frozen=True, slots=True, eq=False)
class Prepared:
    """What does not depend on the camera."""

    means: F32  # (N, 3)
    covariances: F32  # (N, 3, 3)
    opacities: F32  # (N,)
    sh: F32  # (N, K, 3)


def prepare(splats: SplatCloud) -> Prepared:
    """Covariances of a cloud."""
    quats, scales, opacities = shape_of(splats, CompositorSettings())
    factors = factors_of(quats, scales)
    covariances = (factors @ np.swapaxes(factors, 1, 2)).astype(np.float32)
    return Prepared(np.array(splats.means), covariances, np.array(opacities), np.array(splats.sh))


@numba.njit(cache=True, fastmath=True)  # type: ignore[untyped-decorator]
def _preprocess(
    means: F32, covariances: F32, opacities: F32, view: F32, numbers: F32, across: int, down: int
) -> tuple[F32, NDArray[np.int32]]:
    """Records x, y, conic (3), opacity, depth; and the tile rectangle (left, top, right, bottom) of each splat."""
    fx, fy, cx, cy, width, height, near = numbers
    limit_x, limit_y = np.float32(1.3) * width / (2 * fx), np.float32(1.3) * height / (2 * fy)
    n = len(means)
    out = np.zeros((n, 7), np.float32)
    rectangles = np.zeros((n, 4), np.int32)
    for i in range(n):
        x = view[0, 0] * means[i, 0] + view[0, 1] * means[i, 1] + view[0, 2] * means[i, 2] + view[0, 3]
        y = -(view[1, 0] * means[i, 0] + view[1, 1] * means[i, 1] + view[1, 2] * means[i, 2] + view[1, 3])
        z = -(view[2, 0] * means[i, 0] + view[2, 1] * means[i, 1] + view[2, 2] * means[i, 2] + view[2, 3])
        if z <= near:
            continue
        tx = min(limit_x, max(-limit_x, x / z)) * z
        ty = min(limit_y, max(-limit_y, y / z)) * z
        a = np.zeros((2, 3), np.float32)
        for k in range(3):
            a[0, k] = fx / z * view[0, k] + fx * tx / (z * z) * view[2, k]
            a[1, k] = -fy / z * view[1, k] + fy * ty / (z * z) * view[2, k]
        c = a @ covariances[i] @ a.T
        xx, xy, yy = c[0, 0] + np.float32(0.3), c[0, 1], c[1, 1] + np.float32(0.3)
        det = xx * yy - xy * xy
        if det <= 0:
            continue
        middle = (xx + yy) / 2
        radius = np.ceil(3 * np.sqrt(middle + np.sqrt(max(np.float32(0.1), middle * middle - det))))
        px, py = fx * x / z + cx - np.float32(0.5), fy * y / z + cy - np.float32(0.5)
        rectangles[i, 0] = min(across, max(0, int((px - radius) / TILE)))
        rectangles[i, 1] = min(down, max(0, int((py - radius) / TILE)))
        rectangles[i, 2] = min(across, max(0, int((px + radius + TILE - 1) / TILE)))
        rectangles[i, 3] = min(down, max(0, int((py + radius + TILE - 1) / TILE)))
        out[i, 0], out[i, 1] = px, py
        out[i, 2], out[i, 3], out[i, 4] = yy / det, -xy / det, xx / det
        out[i, 5], out[i, 6] = opacities[i], z
    return out, rectangles


@numba.njit(cache=True)  # type: ignore[untyped-decorator]
def _keys(records: F32, rectangles: NDArray[np.int32], across: int) -> tuple[NDArray[np.uint64], NDArray[np.uint32]]:
    total = 0
    for i in range(len(records)):
        total += (rectangles[i, 2] - rectangles[i, 0]) * (rectangles[i, 3] - rectangles[i, 1])
    keys, owners = np.empty(total, np.uint64), np.empty(total, np.uint32)
    bits = records[:, 6].copy().view(np.uint32)
    k = 0
    for i in range(len(records)):
        for ty in range(rectangles[i, 1], rectangles[i, 3]):
            for tx in range(rectangles[i, 0], rectangles[i, 2]):
                keys[k] = (np.uint64(ty * across + tx) << np.uint64(32)) | np.uint64(bits[i])
                owners[k] = i
                k += 1
    return keys, owners


@numba.njit(cache=True, fastmath=True)  # type: ignore[untyped-decorator]
def _render(
    records: F32, colors: F32, owners: NDArray[np.uint32], starts: NDArray[np.int64], width: int, height: int
) -> tuple[F32, int]:
    """(H, W, 4) premultiplied colour and transmittance, and how many fragments were blended."""
    across = (width + TILE - 1) // TILE
    out = np.zeros((height, width, 4), np.float32)
    blended = 0
    for tile in range(len(starts) - 1):
        top, left = tile // across * TILE, tile % across * TILE
        for y in range(top, min(top + TILE, height)):
            for x in range(left, min(left + TILE, width)):
                transmittance = np.float32(1)
                r, g, b = np.float32(0), np.float32(0), np.float32(0)
                for k in range(starts[tile], starts[tile + 1]):
                    i = owners[k]
                    dx, dy = records[i, 0] - x, records[i, 1] - y
                    conic = records[i, 2] * dx * dx + records[i, 4] * dy * dy
                    power = np.float32(-0.5) * conic - records[i, 3] * dx * dy
                    if power > 0:
                        continue
                    alpha = min(np.float32(0.99), records[i, 5] * np.exp(power))
                    if alpha < np.float32(1 / 255):
                        continue
                    left_over = transmittance * (1 - alpha)
                    if left_over < np.float32(1e-4):
                        break
                    weight = alpha * transmittance
                    r += weight * colors[i, 0]
                    g += weight * colors[i, 1]
                    b += weight * colors[i, 2]
                    transmittance = left_over
                    blended += 1
                out[y, x, 0], out[y, x, 1], out[y, x, 2], out[y, x, 3] = r, g, b, transmittance
    return out, blended


def rasterise(cloud: Prepared, camera: Camera) -> tuple[F32, int]:
    """(H, W, 4) premultiplied colour and transmittance of a centred perspective camera; fragments blended."""
    across, down = -(-camera.width // TILE), -(-camera.height // TILE)
    view = camera.camera_from_world.astype(np.float32)
    numbers = np.array(
        [camera.fx, camera.fy, camera.cx, camera.cy, camera.width, camera.height, camera.near], dtype=np.float32
    )
    records, rectangles = _preprocess(cloud.means, cloud.covariances, cloud.opacities, view, numbers, across, down)
    offset = cloud.means - camera.position.astype(np.float32)
    directions = offset / np.linalg.norm(offset, axis=1, keepdims=True)
    basis = spherical.basis(directions, round(cloud.sh.shape[1] ** 0.5) - 1).astype(np.float32)
    colors = np.maximum(np.einsum("nk,nkc->nc", basis, cloud.sh, optimize=True) + np.float32(0.5), 0)
    keys, owners = _keys(records, rectangles, across)
    order = np.argsort(keys, kind="stable")
    starts = np.searchsorted(keys[order] >> np.uint64(32), np.arange(across * down + 1, dtype=np.uint64))
    image, blended = _render(records, colors, owners[order], starts, camera.width, camera.height)
    return image, int(blended)
