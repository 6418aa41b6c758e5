"""What the engine's rasteriser sees of the proxy: the nearest front face at every pixel centre, one sample a pixel.

Homogeneous rasterisation (Olano and Greer 1997, "Triangle scan conversion using 2D homogeneous coordinates"): edge
functions come from the inverse of the triangle's matrix of homogeneous pixel coordinates, so that triangles which cross
the eye's plane need no clipping.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirelight.model import F32, F64, Camera, ProxyMesh
from mirelight.model.arrays import freeze

SUBPIXEL_BITS = 4  # SwiftShader's, on which headless Chromium renders; graphics cards have 8
_FRAGMENTS = 1 << 20  # candidates tested at once; bounds the memory


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Surface:
    """The first front face behind each pixel centre; zeros where there is none."""

    coverage: NDArray[np.bool_]  # (H, W)
    depth: F32  # (H, W) view depth, world units
    position: F32  # (H, W, 3) world space
    normal: F32  # (H, W, 3) unit shading normal
    face: NDArray[np.int32]  # (H, W) index of the triangle; -1 where there is none

    def __post_init__(self) -> None:
        h, w = self.coverage.shape
        freeze(self, "depth", (h, w))
        freeze(self, "position", (h, w, 3))
        freeze(self, "normal", (h, w, 3))


def rasterise(proxy: ProxyMesh, camera: Camera, subpixel_bits: int = SUBPIXEL_BITS) -> Surface:
    """The proxy as the engine's relighting camera sees it: back faces culled, no antialiasing.

    Args:
        proxy: world space, counter-clockwise front faces.
        camera: any projection; its near and far planes hold.
        subpixel_bits: of the grid to which the rasteriser snaps vertices.
    """
    view = proxy.vertices.astype(np.float64) @ camera.camera_from_world[:3, :3].T + camera.camera_from_world[:3, 3]
    corners = _homogeneous_pixels(view, camera)[proxy.faces]  # (F, 3 corners, 3)
    front = np.flatnonzero(np.linalg.det(corners) < -1e-12)  # rows run downwards: counter-clockwise is negative
    corners, depths = corners[front], -view[proxy.faces[front], 2]
    inverse = np.asarray(np.linalg.inv(corners), dtype=np.float64)  # (x, y, 1) @ inverse = barycentric / w
    edges, inclusive = _edges(corners, inverse, camera, 2.0**subpixel_bits)

    nearest = np.full(camera.width * camera.height, np.inf)
    face = np.full(nearest.shape, -1, dtype=np.int32)
    weights = np.zeros((nearest.size, 3))
    for triangle, x, y in _candidates(_boxes(corners, camera)):
        e = _at_centres(edges[triangle], x, y)
        inside = ((e > 0) | ((e == 0) & inclusive[triangle])).all(axis=1)
        triangle, x, y = triangle[inside], x[inside], y[inside]
        b = _at_centres(inverse[triangle], x, y)
        b = b / b.sum(axis=1, keepdims=True)
        depth = np.einsum("fi,fi->f", b, depths[triangle])
        pixel = y * camera.width + x
        order = np.lexsort((triangle, depth, pixel))
        order = order[(depth[order] >= camera.near) & (depth[order] <= camera.far)]
        first = order[np.unique(pixel[order], return_index=True)[1]]
        first = first[depth[first] < nearest[pixel[first]]]
        nearest[pixel[first]], weights[pixel[first]] = depth[first], b[first]
        face[pixel[first]] = front[triangle[first]]
    return _resolve(proxy, camera, nearest, face, weights)


def _homogeneous_pixels(view: F64, camera: Camera) -> F64:
    """Camera-space points (N, 3) as homogeneous pixel coordinates (N, 3)."""
    x, y, z = view.T
    w = -z if camera.projection == "perspective" else np.ones_like(z)
    return np.stack([camera.cx * w + camera.fx * x, camera.cy * w - camera.fy * y, w], axis=-1)


def _edges(corners: F64, inverse: F64, camera: Camera, grid: float) -> tuple[F64, NDArray[np.bool_]]:
    """Edge functions (F, 3, 3), positive inside, as columns over (x, y, 1); and which edges own their pixels (F, 3).

    Vertices are snapped to the rasteriser's grid, so that a centre on an edge is met exactly; a left edge owns it, and
    so does a horizontal one with the inside below (the top-left rule). Triangles that reach behind the eye have no such
    vertices: their edges come from the inverse.
    """
    ahead = (corners[..., 2] > 0).all(axis=1)
    edges = inverse.copy()
    x, y = np.moveaxis(np.rint(corners[ahead, :, :2] / corners[ahead, :, 2:] * grid) / grid, -1, 0)
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        a, b = y[:, j] - y[:, i], x[:, i] - x[:, j]
        edges[ahead, :, k] = np.stack([a, b, -(a * x[:, i] + b * y[:, i])], axis=-1)
    inclusive = (edges[:, 0] > 0) | ((edges[:, 0] == 0) & (edges[:, 1] > 0))
    flat = np.zeros(len(corners), dtype=bool)
    flat[ahead] = (x[:, 1] - x[:, 0]) * (y[:, 2] - y[:, 0]) >= (y[:, 1] - y[:, 0]) * (x[:, 2] - x[:, 0])
    edges[flat] = -1.0  # snapped to a line or turned over: covers nothing
    return edges, inclusive


def _boxes(corners: F64, camera: Camera) -> NDArray[np.int64]:
    """Pixel ranges (F, 4) x0, y0, x1, y1 (exclusive) that hold each triangle; all pixels where it crosses w = 0."""
    w = corners[..., 2]
    size = np.array([camera.width, camera.height])
    with np.errstate(divide="ignore", invalid="ignore"):
        pixels = corners[..., :2] / w[..., None]
    low = np.floor(np.nan_to_num(pixels.min(axis=1), nan=0.0, posinf=1e9, neginf=-1e9) - 0.5)
    high = np.ceil(np.nan_to_num(pixels.max(axis=1), nan=0.0, posinf=1e9, neginf=-1e9) + 0.5)
    crossing = (w <= 0).any(axis=1)
    low[crossing], high[crossing] = 0, size
    behind = (w <= 0).all(axis=1)
    high[behind] = 0
    low, high = np.clip(low, 0, size), np.clip(high, 0, size)
    return np.concatenate([low, np.maximum(high, low)], axis=1).astype(np.int64)


def _candidates(boxes: NDArray[np.int64]) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]]:
    """(triangle, x, y) of every pixel in every box, in batches of bounded size."""
    widths, heights = boxes[:, 2] - boxes[:, 0], boxes[:, 3] - boxes[:, 1]
    areas = widths * heights
    ends = np.cumsum(areas)
    start = 0
    while start < len(boxes):
        done = ends[start - 1] if start else 0
        stop = max(start + 1, int(np.searchsorted(ends, done + _FRAGMENTS, side="right")))
        triangle = np.repeat(np.arange(start, stop), areas[start:stop])
        within = np.arange(len(triangle)) - np.repeat(ends[start:stop] - areas[start:stop] - done, areas[start:stop])
        width = np.maximum(widths[triangle], 1)
        yield triangle, boxes[triangle, 0] + within % width, boxes[triangle, 1] + within // width
        start = stop


def _at_centres(columns: F64, x: NDArray[np.int64], y: NDArray[np.int64]) -> F64:
    """(x, y, 1) @ columns (N, 3, 3) at pixel centres: (N, 3)."""
    return np.asarray((x + 0.5)[:, None] * columns[:, 0] + (y + 0.5)[:, None] * columns[:, 1] + columns[:, 2])


def _resolve(proxy: ProxyMesh, camera: Camera, depth: F64, face: NDArray[np.int32], weights: F64) -> Surface:
    """Interpolate what the visible triangles carry."""
    h, w = camera.height, camera.width
    hit = np.flatnonzero(face >= 0)
    corner = proxy.faces[face[hit]]
    position = np.zeros((h * w, 3), dtype=np.float32)
    normal = np.zeros((h * w, 3), dtype=np.float32)
    points = proxy.vertices[corner].astype(np.float64)
    position[hit] = np.einsum("fi,fic->fc", weights[hit], points)
    if proxy.normals is None:
        n = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
    else:
        n = np.einsum("fi,fic->fc", weights[hit], proxy.normals[corner].astype(np.float64))
    normal[hit] = n / np.maximum(np.linalg.norm(n, axis=-1, keepdims=True), 1e-30)
    return Surface(
        coverage=(face >= 0).reshape(h, w),
        depth=np.where(face >= 0, depth, 0).reshape(h, w),
        position=position.reshape(h, w, 3),
        normal=normal.reshape(h, w, 3),
        face=face.reshape(h, w),
    )
