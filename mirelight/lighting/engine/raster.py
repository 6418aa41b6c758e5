"""What the engine's rasteriser sees of the proxy: the nearest front face at every pixel centre, one sample a pixel.

Homogeneous rasterisation (Olano and Greer 1997, "Triangle scan conversion using 2D homogeneous coordinates"): edge
functions come from the inverse of the triangle's matrix of homogeneous pixel coordinates, so that triangles which cross
the eye's plane need no clipping.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mirelight.base import backend
from mirelight.model import F32, F64, Camera, ProxyMesh, Variant, triangles
from mirelight.model.arrays import freeze

_LOOK, _LOOKS, _WORTH_SAYING = 160, 8, 0.01  # pixels across a picture that only counts; most pictures; share
SUBPIXEL_BITS = 4  # SwiftShader's, on which headless Chromium renders; graphics cards have 8


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rasterised:
    """The first front face behind each pixel centre; zeros where there is none."""

    coverage: NDArray[np.bool_]  # (H, W)
    depth: F32  # (H, W) view depth, world units
    position: F32  # (H, W, 3) world space
    normal: F32  # (H, W, 3) unit shading normal
    geometric_normal: F32  # (H, W, 3) unit face normal, towards the viewer
    face: NDArray[np.int32]  # (H, W) index of the triangle; -1 where there is none

    def __post_init__(self) -> None:
        h, w = self.coverage.shape
        freeze(self, "depth", (h, w))
        freeze(self, "position", (h, w, 3))
        freeze(self, "normal", (h, w, 3))
        freeze(self, "geometric_normal", (h, w, 3))


def rasterise(
    proxy: ProxyMesh,
    camera: Camera,
    *,
    subpixel_bits: int = SUBPIXEL_BITS,
    variant: Variant = "llvm_ad_rgb",
    threads: int | None = None,
) -> Rasterised:
    """The proxy as the engine's relighting camera sees it: back faces culled, no antialiasing.

    Args:
        proxy: world space, counter-clockwise front faces.
        camera: any projection; its near and far planes hold.
        subpixel_bits: of the grid to which the rasteriser snaps vertices.
        variant: where it runs.
        threads: as for tracing.

    Raises:
        BackendError: the variant cannot be used on this machine.
    """
    backend.mitsuba(variant, threads)
    from mirelight.lighting.engine.nearest import Triangles, nearest

    view = proxy.vertices.astype(np.float64) @ camera.camera_from_world[:3, :3].T + camera.camera_from_world[:3, 3]
    corners = _homogeneous_pixels(view, camera)[proxy.faces]  # (F, 3 corners, 3)
    front = np.flatnonzero(np.linalg.det(corners) < -1e-12)  # rows run downwards: counter-clockwise is negative
    corners = corners[front]
    pixels, ahead = _snapped(corners, 2.0**subpixel_bits)
    corners[ahead, :, :2] = pixels[ahead] * corners[ahead, :, 2:]  # what lies on a triangle moves with its corners
    boxes = _boxes(pixels, ahead, corners[..., 2], camera)
    some = (boxes[:, 2] > boxes[:, 0]) & (boxes[:, 3] > boxes[:, 1])
    some &= ~ahead | (_area(pixels) < 0)  # not snapped to a line or turned over
    front, corners, pixels, ahead, boxes = front[some], corners[some], pixels[some], ahead[some], boxes[some]

    inverse = np.asarray(np.linalg.inv(corners), dtype=np.float64)  # (x, y, 1) @ inverse = barycentric / w
    edges, inclusive = _edges(inverse, pixels, ahead)
    far = -view[proxy.faces[front], 2]
    depth = np.stack([np.einsum("tci,ti->tc", inverse, far), inverse.sum(axis=2)], axis=-1)
    found = nearest(Triangles(edges, inclusive, depth, boxes), camera)

    hit = np.flatnonzero(found >= 0)
    y, x = np.divmod(hit, camera.width)
    centre = np.stack([x + 0.5, y + 0.5, np.ones(len(hit))], axis=-1)
    weights = np.einsum("pc,pci->pi", centre, inverse[found[hit]])
    weights /= weights.sum(axis=1, keepdims=True)
    return _resolve(proxy, camera, hit, front[found[hit]], weights)


def seen_from_behind(proxy: ProxyMesh, camera: Camera, variant: Variant = "llvm_ad_rgb") -> float:
    """Share of the pixels with a proxy in them where its back is nearest, which the engine culls.

    Args and errors as for :func:`rasterise`; looks at a small picture.
    """
    small = camera.resized(_LOOK, max(1, round(_LOOK * camera.height / camera.width)))
    front = rasterise(proxy, small, variant=variant)
    back = rasterise(replace(proxy, faces=proxy.faces[:, ::-1], normals=None), small, variant=variant)
    nearer = back.coverage & (~front.coverage | (back.depth < front.depth * (1 - 1e-4)))
    return float(nearer.sum() / max((front.coverage | back.coverage).sum(), 1))


def culling_warnings(proxy: ProxyMesh, cameras: Sequence[Camera], variant: Variant = "llvm_ad_rgb") -> tuple[str, ...]:
    """A line for the first of the cameras (of a few, where they are many) that sees the proxy's back."""
    for camera in cameras[:: -(-len(cameras) // _LOOKS)]:
        share = seen_from_behind(proxy, camera, variant)
        if share > _WORTH_SAYING:
            return (
                f"{share:.0%} of what {camera.name} sees of the proxy is its back, which the engine does not draw; "
                "turn those faces round",
            )
    return ()


def _homogeneous_pixels(view: F64, camera: Camera) -> F64:
    """Camera-space points (N, 3) as homogeneous pixel coordinates (N, 3)."""
    x, y, z = view.T
    w = -z if camera.projection == "perspective" else np.ones_like(z)
    return np.stack([camera.cx * w + camera.fx * x, camera.cy * w - camera.fy * y, w], axis=-1)


def _snapped(corners: F64, grid: float) -> tuple[F64, NDArray[np.bool_]]:
    """Corners (T, 3, 2) in pixels, on the rasteriser's grid; and the triangles (T,) that lie ahead of the eye's plane.

    What reaches behind the eye has no such corners; its numbers mean nothing.
    """
    w = corners[..., 2:]
    ahead = np.asarray((w > 0).all(axis=(1, 2)))
    return np.rint(corners[..., :2] / np.where(w > 0, w, 1) * grid) / grid, ahead


def _edges(inverse: F64, pixels: F64, ahead: NDArray[np.bool_]) -> tuple[F64, NDArray[np.bool_]]:
    """Edge functions (T, 3, 3), positive inside, as columns over (x, y, 1); and which edges own their pixels (T, 3).

    On the rasteriser's grid a centre on an edge is met exactly; a left edge owns it, and so does a horizontal one with
    the inside below (the top-left rule). Triangles that reach behind the eye take their edges from the inverse.
    """
    edges = inverse.copy()
    x, y = np.moveaxis(pixels, -1, 0)
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        a, b = y[:, j] - y[:, i], x[:, i] - x[:, j]
        snapped = np.stack([a, b, -(a * x[:, i] + b * y[:, i])], axis=-1)
        edges[ahead, :, k] = snapped[ahead]
    inclusive = (edges[:, 0] > 0) | ((edges[:, 0] == 0) & (edges[:, 1] > 0))
    return edges, inclusive


def _area(pixels: F64) -> F64:
    """(T,) twice the signed area of triangles (T, 3, 2) in pixels: negative for front faces, as rows run downwards."""
    a, b = pixels[:, 1] - pixels[:, 0], pixels[:, 2] - pixels[:, 0]
    return np.asarray(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])


def _boxes(pixels: F64, ahead: NDArray[np.bool_], w: F64, camera: Camera) -> NDArray[np.int64]:
    """Pixels (T, 4) x0, y0, x1, y1 (exclusive) whose centres each triangle may cover; all where it crosses w = 0."""
    size = np.array([camera.width, camera.height])
    low, high = np.ceil(pixels.min(axis=1) - 0.5), np.floor(pixels.max(axis=1) - 0.5) + 1
    low[~ahead], high[~ahead] = 0, size
    high[(w <= 0).all(axis=1)] = 0
    low, high = np.clip(low, 0, size), np.clip(high, 0, size)
    return np.concatenate([low, np.maximum(high, low)], axis=1).astype(np.int64)


def _resolve(
    proxy: ProxyMesh, camera: Camera, hit: NDArray[np.int64], face: NDArray[np.int64], weights: F64
) -> Rasterised:
    """Interpolate what the visible triangles carry, at the pixels that are hit (flat indices)."""
    h, w = camera.height, camera.width
    corner = proxy.faces[face]
    points = proxy.vertices[corner].astype(np.float64)
    position = np.einsum("fi,fic->fc", weights, points)
    flat = _unit(triangles.crossed(points))
    smooth = flat
    if proxy.normals is not None:
        smooth = _unit(np.einsum("fi,fic->fc", weights, proxy.normals[corner].astype(np.float64)))

    def spread(values: F64) -> F32:
        out = np.zeros((h * w, *values.shape[1:]), dtype=np.float32)
        out[hit] = values
        return out.reshape(h, w, *values.shape[1:])

    faces = np.full(h * w, -1, dtype=np.int32)
    faces[hit] = face
    return Rasterised(
        coverage=(faces >= 0).reshape(h, w),
        depth=spread((camera.position - position) @ camera.world_from_camera[:3, 2]),
        position=spread(position),
        normal=spread(smooth),
        geometric_normal=spread(flat),
        face=faces.reshape(h, w),
    )


def _unit(vectors: F64) -> F64:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-30))
