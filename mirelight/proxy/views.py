"""Cameras to look at a capture from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirelight.base import conventions
from mirelight.model import F32, F64, Camera
from mirelight.proxy.tuning import TUNING
from mirelight.proxy.types import corners_of


def around(points: F32, radius: float, count: int, pixels: int) -> tuple[Camera, ...]:
    """Views of points (N, 3) about the origin from evenly spread sides, so no axis need be up.

    Each shows just what holds the points, `pixels` along its longer side.
    """
    away = radius / np.sin(np.radians(TUNING.view_yfov / 2))
    return tuple(
        _framed(
            Camera.look_at(
                way * away, (0, 0, 0), pixels, pixels, yfov=TUNING.view_yfov, near=1e-3 * radius, name=f"around-{i}"
            ),
            points,
            pixels,
        )
        for i, way in enumerate(lattice(count))
    )


def lattice(count: int) -> F64:
    """(count, 3) unit directions, evenly spread (a Fibonacci lattice)."""
    k = np.arange(count) + 0.5
    z, turn = 1 - 2 * k / count, k * np.pi * (3 - np.sqrt(5))
    flat = np.sqrt(1 - z * z)
    return np.stack([flat * np.cos(turn), z, flat * np.sin(turn)], axis=1)


def _framed(camera: Camera, points: F32, pixels: int) -> Camera:
    """The same view of what holds the points alone."""
    inverse = camera.camera_from_world
    own = turned(points, inverse[:3, :3].astype(np.float32)) + inverse[:3, 3].astype(np.float32)
    slopes = own[:, :2] / np.maximum(-own[:, 2:], np.float32(1e-12))
    low, high = slopes.min(axis=0).astype(np.float64), slopes.max(axis=0).astype(np.float64)
    border = TUNING.view_border * float((high - low).max())
    low, high = low - border, high + border
    focal = pixels / float((high - low).max())
    width, height = (max(round(float(x) * focal), 1) for x in high - low)
    return replace(
        camera, width=width, height=height, fx=focal, fy=focal, cx=float(-low[0] * focal), cy=float(high[1] * focal)
    )


def mean_up(cameras: Sequence[Camera]) -> F64:
    """(3,) the mean of what is up for cameras: the shorter, the less they agree."""
    return np.asarray(np.mean([camera.world_from_camera[:3, 1] for camera in cameras], axis=0))


def held_up(cameras: Sequence[Camera], shown: F32 | F64) -> F64 | None:
    """(3,) unit: which way is up for most cameras, across the right of all; None where they are held in all ways, or
    there are none.

    Those that look down lean forward, and their mean to where most of them look; all from one side have but the mean.
    A drone that maps a land looks straight down, and what is up in its pictures is where it heads.

    Args:
        cameras: the capture's.
        shown: (N, 3) points of what they show.
    """
    if not cameras:
        return None
    if (above := _from_above(cameras, shown)) is not None:
        return above
    mean = mean_up(cameras)
    long = float(np.linalg.norm(mean))
    rights = np.stack([camera.world_from_camera[:3, 0] for camera in cameras])
    values, vectors = np.linalg.eigh(np.einsum("ci,cj->ij", rights, rights) / len(rights))
    if long <= TUNING.view_upright or values[0] > TUNING.view_rolled:
        return None
    if values[1] < TUNING.view_rolled:
        return mean / long
    way = vectors[:, 0]
    return np.asarray(way * np.sign(dot(way, mean)))


def _from_above(cameras: Sequence[Camera], shown: F32 | F64) -> F64 | None:
    """(3,) unit against where cameras look, where all look one way and their strips are as far apart as what they show
    (N, 3) is away: people who go along a wall do not climb it as well. None of others."""
    ahead = -np.mean([camera.world_from_camera[:3, 2] for camera in cameras], axis=0)
    long = float(np.linalg.norm(ahead))
    if long < TUNING.view_one_way or not len(shown):
        return None
    ahead /= long
    places = np.stack([camera.position for camera in cameras])
    about = places - places.mean(axis=0)
    across = about - np.outer(about @ ahead, ahead)
    strips = np.ptp(across @ np.linalg.svd(across)[2][1])
    away = float(np.median(shown @ ahead)) - float(places.mean(axis=0) @ ahead)
    return -ahead if strips > TUNING.view_survey * away > 0 else None


def fewer(cameras: Sequence[Camera]) -> tuple[Camera, ...]:
    """Of a capture's cameras at most `view_most` of `TUNING`, evenly taken, in pictures of at most `view_all_pixels`
    together.

    Tiny pictures are enlarged: splats are never narrower than a pixel, and stand out of their surface.
    """
    return _together(evenly(cameras, TUNING.view_most))


def close_ups(cameras: Sequence[Camera], low: F64, high: F64) -> tuple[Camera, ...]:
    """At most half as many as :func:`fewer`'s, of what is seen of a box alone: in as many pixels it is seen closer.

    Args:
        cameras: the capture's.
        low, high: (3,) corners of the box.
    """
    whole = evenly(cameras, TUNING.view_most // 2)
    frames = np.array([_frame(camera, low, high) for camera in whole])
    width, height = (int(x) for x in np.ceil(frames[:, 2:] - frames[:, :2]).max(axis=0))
    return _together([_cut(x, frame, width, height) for x, frame in zip(whole, frames, strict=True)])


def _frame(camera: Camera, low: F64, high: F64) -> F64:
    """(4,) left, top, right and bottom in pixels of what a picture shows of a box; all of it where that reaches to
    behind the eye."""
    size = np.array([camera.width, camera.height], np.float64)
    corners = corners_of(low, high)
    own = turned(corners - camera.position, camera.camera_from_world[:3, :3])
    if camera.projection == "perspective" and (own[:, 2] > -camera.near).any():
        return np.concatenate([[0, 0], size])
    w = -own[:, 2:] if camera.projection == "perspective" else np.ones((8, 1))
    at = [camera.cx, camera.cy] + [camera.fx, -camera.fy] * own[:, :2] / w
    return np.concatenate([np.clip(at.min(axis=0), 0, size - 1), np.clip(at.max(axis=0), 1, size)])


def _cut(camera: Camera, frame: F64, width: int, height: int) -> Camera:
    """So many pixels of a picture, or all where it is smaller, about the middle of a frame."""
    width, height = min(width, camera.width), min(height, camera.height)
    left, top = (frame[:2] + frame[2:] - [width, height]) / 2
    left = int(np.clip(round(left), 0, camera.width - width))
    top = int(np.clip(round(top), 0, camera.height - height))
    return replace(camera, width=width, height=height, cx=camera.cx - left, cy=camera.cy - top)


def _together(cameras: Sequence[Camera]) -> tuple[Camera, ...]:
    share = min((TUNING.view_all_pixels / sum(x.width * x.height for x in cameras)) ** 0.5, 1.0)
    return tuple(x.scaled(share) for x in cameras)


def evenly(cameras: Sequence[Camera], most: int) -> list[Camera]:
    """Every so many-th of them, at most `most`; tiny pictures are enlarged."""
    return [_enlarged(camera) for camera in cameras[:: -(-len(cameras) // most) or 1]]


def _enlarged(camera: Camera) -> Camera:
    return camera.scaled(max(TUNING.view_least_pixels / max(camera.width, camera.height), 1.0))


def from_points(points: F64, pixels: int, near: float) -> tuple[Camera, ...]:
    """Six views from each point (N, 3), along the axes and against them."""
    directions = np.concatenate([np.eye(3), -np.eye(3)])
    return tuple(
        Camera.look_at(p, p + way, pixels, pixels, yfov=TUNING.view_inside_yfov, near=near, name=f"inside-{i}-{k}")
        for i, p in enumerate(points)
        for k, way in enumerate(directions)
    )


@lru_cache(maxsize=16)  # by identity: steps ask for those of one view again and again, some of them at once
def rays(camera: Camera) -> tuple[F64, F64]:
    """Origins and directions (H, W, 3), as :meth:`Camera.rays`; not to be written to."""
    origins, directions = camera.rays()
    directions.flags.writeable = False
    return origins, directions


def turned(rows: NDArray[Any], matrix: NDArray[Any]) -> NDArray[Any]:
    """Rows (..., 3) multiplied by a matrix (K, 3), without BLAS, whose bits depend on its threads."""
    if rows.dtype == matrix.dtype == np.float32:  # the same bits as einsum's, in a third of the time
        out = np.empty((*rows.shape[:-1], len(matrix)), np.float32)
        for k, row in enumerate(matrix):
            out[..., k] = dot(rows, row)
        return out
    return np.asarray(np.einsum("...j,ij->...i", rows, matrix))


def dot(a: NDArray[Any], b: NDArray[Any]) -> NDArray[Any]:
    """(...,) dot products of vectors (..., 3): numpy's sums along an axis of three are slow."""
    return np.asarray(a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2])


def length(vectors: NDArray[Any]) -> NDArray[Any]:
    """(...,) of vectors (..., 3)."""
    return np.asarray(np.sqrt(dot(vectors, vectors)))


def placed(camera: Camera, m: F64) -> Camera:
    """A camera that sees the same of what is carried along by a similarity (4, 4)."""
    if np.array_equal(m, np.eye(4)):
        return camera
    scale = float(np.cbrt(np.linalg.det(m[:3, :3])))
    pose = conventions.rigid_part(turned(m, camera.world_from_camera.T))
    return replace(camera, world_from_camera=pose, near=scale * camera.near, far=scale * camera.far)


def moved(camera: Camera, by: F64) -> Camera:
    """The camera moved by (3,), looking the same way."""
    return replace(camera, world_from_camera=conventions.compose(by) @ camera.world_from_camera)
