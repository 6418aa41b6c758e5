"""What is painted over a camera's picture, on the surface: faces are cut along it, and those behind others left."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mirelight.model import F32, F64, Camera, LightingBuffer, ProxyMesh, RenderSettings
from mirelight.model.dressing import Dress, Mask, dressed
from mirelight.pipeline import reads

if TYPE_CHECKING:
    from mirelight.lighting.sight import Sight

Bool = NDArray[np.bool_]

_LEVELS = 12  # halvings of a face's edges
_LEVELS_BEHIND = 6  # of one that reaches behind the camera
_SMALLEST = 1.5  # pixels of the mask across, below which faces are not cut
_BEFORE = 1 - 1e-3  # of the way from the camera to a face, that must be free


def dressed_by(mesh: ProxyMesh, dresses: Sequence[Dress], source: str, settings: RenderSettings) -> ProxyMesh:
    """A mesh whose faces have what is said of them, painted ones too; see :func:`mirelight.model.dressing.dressed`.

    Raises:
        InputError: one speaks of no face; a mask cannot be read, or has another shape than its camera's pictures.
    """
    masks = {x.mask.painted.digest: x.mask for x in dresses if x.mask is not None}
    if not masks:
        return dressed(mesh, dresses, source)
    from mirelight.lighting.sight import Sight

    painted = partial(_painted, Sight(mesh, settings.variant, settings.threads))
    for mask in masks.values():
        mesh = _cut(mesh, *_pictured(mask))
    return dressed(mesh, dresses, source, painted)


def paint_of(masks: Sequence[Mask], seen: LightingBuffer, sight: Sight) -> Bool:
    """(H, W) where a camera sees what is painted in any of the masks, and not behind something else.

    Args:
        masks: painted over frames of any cameras.
        seen: what it sees of the proxy.
        sight: into that.

    Raises:
        InputError: a mask cannot be read, or has another shape than its camera's pictures.
    """
    covered = seen.coverage > 0
    out = np.zeros(covered.shape, np.bool_)
    points = seen.position[covered].astype(np.float64)
    for mask in masks:
        out[covered] |= _painted(None if _same_view(mask.camera.pinhole, seen.camera) else sight, mask, points)
    return out


def _same_view(one: Camera, other: Camera) -> bool:
    """Whether both see the same, on any number of pixels: then nothing of it is hidden from either."""
    one = one.resized(other.width, other.height)
    return reads.view(one) == reads.view(other)


def _painted(sight: Sight | None, mask: Mask, points: F64) -> Bool:
    """(N,) which points (N, 3) lie in a mask's paint and are seen by its camera; `sight` None: all are."""
    camera, shown = _pictured(mask)
    at, ahead = _projected(camera, points)
    row, column = (np.floor(np.clip(x, -1, 1e6)).astype(np.int64) for x in (at[:, 1], at[:, 0]))
    inside = ahead & (row >= 0) & (row < camera.height) & (column >= 0) & (column < camera.width)
    inside[inside] = shown[row[inside], column[inside]]
    if sight is not None:
        eyes = _eyes(camera, points[inside])
        _, distance = sight.first_hits(eyes, points[inside] - eyes)
        inside[inside] = distance > _BEFORE
    return inside


def _pictured(mask: Mask) -> tuple[Camera, Bool]:
    """A mask's camera with as many pixels as it has, and (H, W) where it is painted."""
    shown = mask.painted.value > 0.5
    return mask.camera.pinhole.resized(shown.shape[1], shown.shape[0]), shown


def _projected(camera: Camera, points: F64) -> tuple[F64, Bool]:
    """(..., 2) x and y in pixels of points (..., 3), and (...) whether they lie before the camera."""
    own = points @ camera.camera_from_world[:3, :3].T + camera.camera_from_world[:3, 3]
    ahead = -own[..., 2] > camera.near
    depth = np.where(ahead, -own[..., 2], 1.0) if camera.projection == "perspective" else np.ones(own.shape[:-1])
    x, y = camera.cx + camera.fx * own[..., 0] / depth, camera.cy - camera.fy * own[..., 1] / depth
    return np.stack([x, y], axis=-1), ahead


def _eyes(camera: Camera, points: F64) -> F64:
    """(N, 3) where points (N, 3) are seen from."""
    if camera.projection == "perspective":
        return np.broadcast_to(camera.position, points.shape)
    back = camera.world_from_camera[:3, 2]
    return points + ((camera.position - points) @ back)[:, None] * back


def _cut(mesh: ProxyMesh, camera: Camera, shown: Bool) -> ProxyMesh:
    """A mesh with faces that are painted in part cut in four, again and again, as far as the mask's pixels tell."""
    sums = np.zeros((camera.height + 1, camera.width + 1), np.int64)
    sums[1:, 1:] = shown.cumsum(axis=0).cumsum(axis=1)
    for level in range(_LEVELS):
        at, ahead = _projected(camera, mesh.vertices[mesh.faces].astype(np.float64))
        some, all_ = ahead.any(axis=1), np.asarray(ahead.all(axis=1, keepdims=True))
        size = np.array([camera.width, camera.height])
        low = np.where(all_, at.min(axis=1), 0)
        high = np.where(all_, at.max(axis=1), size)
        large = (high - low).max(axis=1) > _SMALLEST
        left, top = np.clip(np.floor(low), 0, size).astype(np.int64).T
        right, bottom = np.clip(np.ceil(high), 0, size).astype(np.int64).T
        count = sums[bottom, right] - sums[top, right] - sums[bottom, left] + sums[top, left]
        whole = (high > low).all(axis=1) & (low >= 0).all(axis=1) & (high <= size).all(axis=1)
        partly = (count > 0) & ~(whole & (count == (right - left) * (bottom - top)))
        chosen = some & large & partly & (all_[:, 0] | (level < _LEVELS_BEHIND))
        if not chosen.any():
            break
        mesh = _quartered(mesh, chosen)
    return mesh


def _quartered(mesh: ProxyMesh, chosen: Bool) -> ProxyMesh:
    """A mesh with some faces (F,) cut at the middles of their edges."""
    faces = mesh.faces[chosen]
    first, count = len(mesh.vertices), len(faces)
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])

    def longer(values: F32 | None) -> F32 | None:
        if values is None:
            return None
        return np.concatenate([values, (values[edges[:, 0]] + values[edges[:, 1]]) * np.float32(0.5)])

    ab, bc, ca = (np.arange(count, dtype=np.int32) + np.int32(first + k * count) for k in range(3))
    a, b, c = faces.T
    parts = [np.stack(x, axis=1) for x in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
    vertices, normals = longer(mesh.vertices), longer(mesh.normals)
    assert vertices is not None
    if normals is not None:
        length = np.linalg.norm(normals[first:], axis=1, keepdims=True)
        normals[first:] /= np.maximum(length, np.float32(1e-12))

    def owners(values: NDArray[np.int32] | None) -> NDArray[np.int32] | None:
        return None if values is None else np.concatenate([values[~chosen], np.tile(values[chosen], 4)])

    return replace(
        mesh,
        vertices=vertices,
        faces=np.concatenate([mesh.faces[~chosen], *parts]),
        normals=normals,
        uvs=longer(mesh.uvs),
        vertex_colors=longer(mesh.vertex_colors),
        face_materials=owners(mesh.face_materials),
        face_nodes=owners(mesh.face_nodes),
    )
