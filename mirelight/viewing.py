"""What cameras see, found out before anything is rendered: inside the proxy, looking at nothing, how near.

A quick look at points of the proxy's surface and at the splats' centres; where it finds a camera that may be of no use,
rays against every triangle decide.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mirelight.model import F64, Camera, ProxyMesh, SplatCloud

_POINTS = 50_000  # spread evenly over the proxy, on its triangles in turn, and of the splats
_CELLS = 24  # along the picture's longer side
_SIDE = 8  # cells along each edge of the cube of directions
_RAYS = 8  # along each side of the picture, where rays decide
_BALL = 32  # rays all around, where rays decide
_ENCLOSED = 0.75  # share of all directions that end on a back face, above which a camera is inside
_SUSPECT = 0.05  # share of the picture below which rays decide
_LITTLE = 0.01  # share of the picture that is hardly a picture
_TRIANGLES = 1 << 14  # looked at together
_NEAREST = 64  # points whose triangles are measured


@dataclass(frozen=True, slots=True)
class View:
    """What one camera has before it."""

    camera: str  # its name
    seen: float  # share of the picture, 0 to 1, in which there is something
    nearest: float  # world units to the nearest surface or splat centre, in any direction; inf: there is none
    inside: bool  # enclosed by the proxy's back faces (a room whose faces look inwards does not count)

    @property
    def problem(self) -> str:
        """Why the camera is of no use, in words that follow its name; empty where it is."""
        if self.inside:
            return "stands inside the proxy"
        if self.seen == 0:
            return "sees nothing"
        return f"sees hardly anything ({100 * self.seen:.1f}% of its picture)" if self.seen < _LITTLE else ""


def views(
    cameras: Sequence[Camera], *, proxy: ProxyMesh | None = None, splats: SplatCloud | None = None
) -> tuple[View, ...]:
    """What each camera has before it.

    Args:
        cameras: in the world of the scene.
        proxy: its triangles' winding says which side is the back.
        splats: their centres count.
    """
    surface = None if proxy is None or not len(proxy.faces) else _Surface.of(proxy)
    means = np.zeros((0, 3))
    if splats is not None:
        means = splats.means[:: max(1, math.ceil(len(splats) / _POINTS))].astype(np.float64)
    return tuple(_view(camera, surface, means) for camera in cameras)


@dataclass(frozen=True, slots=True, eq=False)
class _Surface:
    """A mesh and points on it: half spread evenly, half on its triangles in turn, so that small ones have some."""

    triangles: F64  # (F, 3, 3)
    points: F64  # (N, 3)
    faces: np.ndarray  # (N,) the triangle of each
    normals: F64  # (N, 3) by the winding, of any length

    @staticmethod
    def of(mesh: ProxyMesh) -> _Surface:
        triangles = mesh.vertices.astype(np.float64)[mesh.faces]
        a, b, c = np.moveaxis(triangles, 1, 0)
        normals = np.cross(b - a, c - a)
        areas = np.linalg.norm(normals, axis=1)
        count = np.arange(2 * _POINTS) + 0.5
        whole = np.cumsum(areas)
        evenly = np.minimum(np.searchsorted(whole, count[:_POINTS] / _POINTS * whole[-1]), len(areas) - 1)
        stride = max(1, math.ceil(len(areas) / _POINTS))
        faces = np.concatenate([evenly, np.arange(_POINTS) * stride % len(areas)])
        # The R2 sequence (M. Roberts, 2018), folded into the triangle.
        u, v = np.mod(count * 0.7548776662466927, 1), np.mod(count * 0.5698402909980532, 1)
        folded = u + v > 1
        u, v = np.where(folded, 1 - u, u)[:, None], np.where(folded, 1 - v, v)[:, None]
        points = a[faces] + u * (b - a)[faces] + v * (c - a)[faces]
        return _Surface(triangles, points, faces, normals[faces])


def _view(camera: Camera, surface: _Surface | None, means: F64) -> View:
    points = means if surface is None else np.concatenate([surface.points, means])
    away = points - camera.position
    distances = np.linalg.norm(away, axis=1)
    nearest = float(distances.min()) if len(distances) else math.inf
    seen = _share(camera, points)
    enclosed = 0.0
    if surface is not None:
        on_surface = distances[: len(surface.points)]
        distance, is_back = _nearest(surface, camera.position, on_surface)
        nearest = min(nearest, distance)
        enclosed = _back_share(away[: len(on_surface)], on_surface, surface.normals)
        if seen < _SUSPECT:
            seen = max(
                seen, float(np.mean(_hits(surface.triangles, *_picture_rays(camera), camera.near, camera.far) != 0))
            )
        if is_back or enclosed > _ENCLOSED / 2:
            ball = _ball()
            sides = _hits(surface.triangles, np.broadcast_to(camera.position, ball.shape), ball, 0.0, math.inf)
            enclosed = float(np.mean(sides < 0))
    return View(camera.name, seen, nearest, enclosed > _ENCLOSED)


def _share(camera: Camera, points: F64) -> float:
    """Share of coarse cells of the picture on which points land."""
    m = camera.camera_from_world
    x, y, z = (points @ m[:3, :3].T + m[:3, 3]).T
    ahead = (-z > camera.near) & (-z < camera.far)
    x, y, w = x[ahead], y[ahead], -z[ahead] if camera.projection == "perspective" else np.ones(int(ahead.sum()))
    size = max(camera.width, camera.height) / _CELLS
    columns, rows = max(1, round(camera.width / size)), max(1, round(camera.height / size))
    u = (camera.cx + camera.fx * x / w) / camera.width
    v = (camera.cy - camera.fy * y / w) / camera.height
    on = (u >= 0) & (u < 1) & (v >= 0) & (v < 1)
    cells = (v[on] * rows).astype(np.intp) * columns + (u[on] * columns).astype(np.intp)
    return len(np.unique(cells)) / (rows * columns)


def _back_share(away: F64, distances: F64, normals: F64) -> float:
    """Share of all directions, as cells of a cube, in which the nearest point shows its back."""
    axis = np.argmax(np.abs(away), axis=1)
    row = np.arange(len(away))
    major = away[row, axis]
    with np.errstate(divide="ignore", invalid="ignore"):
        u = np.nan_to_num(away[row, (axis + 1) % 3] / np.abs(major))
        v = np.nan_to_num(away[row, (axis + 2) % 3] / np.abs(major))
    iu, iv = (np.minimum(((x + 1) / 2 * _SIDE).astype(np.intp), _SIDE - 1) for x in (u, v))
    cell = ((axis * 2 + (major > 0)) * _SIDE + iu) * _SIDE + iv
    first = np.full(6 * _SIDE * _SIDE, np.inf)
    np.minimum.at(first, cell, distances)
    front = distances == first[cell]
    back = np.einsum("ni,ni->n", away[front], normals[front]) > 0
    return len(np.unique(cell[front][back])) / len(first)


def _nearest(surface: _Surface, position: F64, distances: F64) -> tuple[float, bool]:
    """Distance to the nearest of the triangles around the nearest points, and whether its back is seen."""
    from trimesh.triangles import closest_point

    count = min(_NEAREST, len(distances))
    faces = np.unique(surface.faces[np.argpartition(distances, count - 1)[:count]])
    found = closest_point(surface.triangles[faces], np.broadcast_to(position, (len(faces), 3)))
    away = np.linalg.norm(found - position, axis=1)
    nearest = int(np.argmin(away))
    a, b, c = surface.triangles[faces[nearest]]
    return float(away[nearest]), bool(np.cross(b - a, c - a) @ (a - position) > 0)


def _picture_rays(camera: Camera) -> tuple[F64, F64]:
    """Origins and directions (R, 3), the directions of length 1 along the view axis."""
    u = (np.arange(_RAYS) + 0.5) / _RAYS
    x, y = np.meshgrid((u * camera.width - camera.cx) / camera.fx, (camera.cy - u * camera.height) / camera.fy)
    flat = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    r = camera.world_from_camera[:3, :3]
    if camera.projection == "perspective":
        return np.broadcast_to(camera.position, flat.shape), np.add(flat, (0, 0, -1)) @ r.T
    return camera.position + flat @ r.T, np.broadcast_to(-r[:, 2], flat.shape)


def _ball() -> F64:
    """Directions (R, 3) all around: a Fibonacci lattice."""
    i = np.arange(_BALL)
    y = 1 - (2 * i + 1) / _BALL
    flat, turn = np.sqrt(1 - y * y), i * math.pi * (3 - math.sqrt(5))
    return np.stack([flat * np.sin(turn), y, flat * np.cos(turn)], axis=1)


def _hits(triangles: F64, origins: F64, directions: F64, near: float, far: float) -> F64:
    """What each ray meets first: 1 a front, -1 a back, 0 nothing (R,). Möller and Trumbore (1997), by brute force."""
    first = np.full(len(origins), np.inf)
    side = np.zeros(len(origins))
    for start in range(0, len(triangles), _TRIANGLES):
        a, b, c = np.moveaxis(triangles[start : start + _TRIANGLES], 1, 0)
        e1, e2 = b - a, c - a
        normals = np.cross(e1, e2)
        for i, (o, d) in enumerate(zip(origins, directions, strict=True)):
            p = np.cross(d, e2)
            det = np.einsum("ni,ni->n", e1, p)
            s = o - a
            q = np.cross(s, e1)
            with np.errstate(divide="ignore", invalid="ignore"):
                u = np.einsum("ni,ni->n", s, p) / det
                v = q @ d / det
                t = np.einsum("ni,ni->n", e2, q) / det
                met = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > near) & (t < min(far, first[i]))
            if met.any():
                nearest = int(np.argmin(np.where(met, t, np.inf)))
                first[i] = t[nearest]
                side[i] = 1.0 if normals[nearest] @ d < 0 else -1.0
    return side
