"""Depth maps fused into a grid of truncated signed distances (Curless and Levoy, 1996)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mirelight.base.progress import ShareProgress
from mirelight.base.together import each
from mirelight.model import F32, F64, Camera
from mirelight.proxy.depth import DepthMap, points_of
from mirelight.proxy.tuning import TUNING
from mirelight.proxy.types import Int
from mirelight.proxy.views import dot, length, rays, turned

MOST_NODES = 160_000_000  # of the grid: more would take too much memory
_CHUNK = 1 << 18  # nodes at once


@dataclass(frozen=True, slots=True, eq=False)
class Grid:
    """Distances at the nodes that views have seen; node (i, j, k) stands at low + cell (i, j, k)."""

    low: F64  # (3,)
    cell: float
    shape: tuple[int, int, int]
    nodes: Int  # (M,) ascending flat indices of nodes that are known
    distance: F32  # (M,) signed, positive outside, at most TRUNCATION cells


def fuse(
    views: Sequence[DepthMap],
    half: F64,
    cell: float,
    progress: ShareProgress,
    middle: F64 | None = None,
    up: F64 | None = None,
) -> Grid:
    """One mesh from many depth maps.

    Where a sheet thinner than a few cells is seen from both sides, the views on the side of the middle count, as a
    floor or a wall has its scene on that side; their average would be no surface at all. But where none looks from
    inside, those count that look from higher up, as into a hollow thing views see from below; where up is not known,
    those on the other side, if they are nearly all.

    Args:
        views: the maps.
        half: (3,) half extents of the box that the grid fills.
        cell: distance of nodes; made larger where the grid would have more than `MOST_NODES`.
        progress: called after each view.
        middle: (3,) of the box; None: the origin.
        up: (3,) unit; None: not known.
    """
    middle = np.zeros(3) if middle is None else middle
    cell = max(cell, float((8 * np.prod(half) / MOST_NODES) ** (1 / 3)))
    size = np.ceil(2 * (half + (TUNING.fused_truncation + 1) * cell) / cell).astype(int) + 1
    shape = (int(size[0]), int(size[1]), int(size[2]))
    low = middle - (size - 1) * cell / 2
    inside = any((np.abs(view.camera.position - middle) < half).all() for view in views)
    clean = _one_sided(views, TUNING.fused_sheet * cell, middle, inside, up)
    nodes = _near_surface(clean, low, cell, shape)
    at = (np.stack(np.unravel_index(nodes, shape), axis=1) * cell + low).astype(np.float32)
    total, weight = np.zeros(len(nodes), np.float32), np.zeros(len(nodes), np.float32)
    for done, view in enumerate(clean):
        progress("fusing depth maps", done / len(clean))
        planes = _Planes.of(view)

        def add(start: int, planes: _Planes = planes) -> None:
            rows, d, w = planes.distances(at[start : start + _CHUNK], TUNING.fused_truncation * cell)
            total[start + rows] += d * w
            weight[start + rows] += w

        each(add, range(0, len(nodes), _CHUNK))
    known = weight > 0
    return Grid(low, cell, shape, nodes[known], total[known] / weight[known])


def _near_surface(views: Sequence[DepthMap], low: F64, cell: float, shape: tuple[int, int, int]) -> Int:
    """Nodes within the band around a point that some view sees, ascending."""
    from scipy.ndimage import maximum_filter1d

    marked = np.zeros(shape, np.uint8)
    for view in views:
        i = np.rint((_marks(view, 2 * TUNING.fused_band * cell) - low) / cell).astype(np.int64)
        i = i[((i >= 0) & (i < shape)).all(axis=1)]
        marked[i[:, 0], i[:, 1], i[:, 2]] = 1
    for axis in range(3):
        marked = maximum_filter1d(marked, 2 * TUNING.fused_band + 1, axis=axis)
    return np.flatnonzero(marked)


def _marks(view: DepthMap, apart: float) -> F64:
    """(N, 3) points of the surface that a view sees, no farther than `apart` (world units) from each other.

    Where it looks along a floor, the surface of one pixel is long.
    """
    points, normals, _ = points_of(view)
    ways = points - view.camera.position
    ways = ways / np.maximum(length(ways), 1e-30)[:, None]
    along = ways - dot(ways, normals)[:, None] * normals  # in the surface, the way that recedes
    along = along / np.maximum(length(along)[:, None], 1e-30)
    long = _long(view)[view.depth > 0]
    many = np.clip(np.ceil(long / apart), 1, TUNING.fused_marks).astype(np.int64)
    rows = np.repeat(np.arange(len(points)), many)
    turn = np.arange(len(rows)) - np.repeat(np.cumsum(many) - many, many)
    share = (turn + 0.5) / many[rows] - 0.5
    return np.asarray(points[rows] + (share * long[rows])[:, None] * along[rows])


def _long(view: DepthMap) -> F64:
    """(H, W) how long the surface of a pixel is, along the way that it recedes."""
    _, directions = rays(view.camera)
    side = view.depth * np.maximum(length(directions), 1e-30) / min(view.camera.fx, view.camera.fy)
    return np.asarray(side / np.maximum(np.abs(_facing(view, directions)), TUNING.label_facing))


def _facing(view: DepthMap, directions: F64) -> F64:
    """(H, W) cosine between the surface and a view's pixels, which look along directions (H, W, 3)."""
    return np.asarray(-dot(view.normal, directions) / np.maximum(length(directions), 1e-30))


@dataclass(frozen=True, slots=True, eq=False)
class _Planes:
    """What the nodes need of one view, in single precision: a plane for each pixel."""

    camera: Camera
    rows: F32  # (H W, 6) depth, normal, offset of the plane from the origin, weight

    @staticmethod
    def of(view: DepthMap) -> _Planes:
        origins, directions = rays(view.camera)
        spot = origins + directions * view.depth[..., None]
        facing = np.clip(_facing(view, directions), TUNING.fused_facing, 1) * view.trust
        offset = dot(view.normal, spot)
        rows = np.concatenate([view.depth[..., None], view.normal, offset[..., None], facing[..., None]], axis=-1)
        return _Planes(view.camera, rows.reshape(-1, 6).astype(np.float32))

    def distances(self, at: F32, most: float) -> tuple[Int, F32, F32]:
        """(M,) which of points (N, 3) a pixel tells of, (M,) their signed distance to its plane, and its weight."""
        far = np.float32(most)
        seen, row, z = self._shown(at)
        ahead = row[:, 0] - z  # positive before the surface
        plane = dot(at[seen], row[:, 1:4]) - row[:, 4]
        # along a floor a ray is long beneath it before it is deep: what lies over a node tells of it
        aslant = np.flatnonzero((np.abs(ahead) > 2 * far) & (np.abs(plane) < far))
        foot = at[seen[aslant]] - plane[aslant, None] * row[aslant, 1:4]
        held, over, _ = self._shown(foot)
        on = np.abs(dot(foot[held], over[:, 1:4]) - over[:, 4]) < TUNING.fused_foot * far
        on &= dot(over[:, 1:4], row[aslant[held], 1:4]) > TUNING.fused_alike
        rows = aslant[held[on]]
        row[rows], plane[rows], ahead[rows] = over[on], dot(at[seen[rows]], over[on, 1:4]) - over[on, 4], 0
        distance = np.where(ahead > 2 * far, far, np.clip(plane, -far, far))
        # A node far behind is hidden; one little behind counts less the deeper: a thin part's far side stays whole.
        hidden = (ahead < -2 * far) | (plane <= -far)
        fading = np.clip((plane + far) * np.float32(2 / most), 0, 1)
        return seen, distance, np.where(hidden, np.float32(0), row[:, 5] * fading)

    def _shown(self, at: F32) -> tuple[Int, F32, F32]:
        """(M,) which of points (N, 3) lie in pixels that show a surface, those (M, 6), and the points' depths (M,)."""
        camera = self.camera
        matrix = camera.camera_from_world.astype(np.float32)
        own = turned(at, matrix[:3, :3]) + matrix[:3, 3]
        z = -own[:, 2]
        w = np.maximum(z, np.float32(1e-12))
        x = np.floor(np.float32(camera.cx) + np.float32(camera.fx) * own[:, 0] / w)
        y = np.floor(np.float32(camera.cy) - np.float32(camera.fy) * own[:, 1] / w)
        seen = np.flatnonzero((z > camera.near) & (x >= 0) & (x < camera.width) & (y >= 0) & (y < camera.height))
        row = self.rows[(y[seen] * camera.width + x[seen]).astype(np.int64)]
        there = row[:, 0] > 0
        return seen[there], row[there], z[seen[there]]


def _one_sided(views: Sequence[DepthMap], cell: float, middle: F64, inside: bool, up: F64 | None) -> list[DepthMap]:
    """The maps without pixels that see the far side of a sheet thinner than `cell`."""
    found = each(points_of, views)
    points, normals = np.concatenate([p for p, _, _ in found]), np.concatenate([n for _, n, _ in found])
    if not len(points):
        return list(views)
    side = dot(points - middle, normals) < 0  # facing it
    around = _voxel(points / (TUNING.sheet_around * cell))
    if up is not None and not inside:
        eyes = np.repeat([view.camera.position for view in views], [len(p) for p, _, _ in found], axis=0)
        alike = 3 * around + np.argmax(np.abs(normals), axis=1)  # a top, and the sides below it, each on its own
        kept = _from_higher(alike, side, dot(eyes - points, up) / length(eyes - points))
    else:
        kept = inside | ~_mostly(around, ~side)
    # both sides of a sheet may fall into two voxels of one grid, not of both
    torn = each(lambda offset: _both_sides(_voxel(points / cell + offset), side, normals), (0.0, 0.5))
    drop = (torn[0] | torn[1]) & (side != kept)
    out, start = [], 0
    for view, (own, _, _) in zip(views, found, strict=True):
        depth = view.depth.copy()
        seen = np.flatnonzero(depth.ravel() > 0)
        depth.ravel()[seen[drop[start : start + len(own)]]] = 0
        start += len(own)
        out.append(replace(view, depth=depth))
    return out


def _mostly(voxel: Int, of: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(N,) whether far more of the points of a point's voxel are of a kind than not."""
    _, index = np.unique(voxel, return_inverse=True)
    share = np.bincount(index, of) / np.bincount(index)
    return np.asarray(share[index] > TUNING.sheet_outside)


def _from_higher(voxel: Int, of: NDArray[np.bool_], height: F64) -> NDArray[np.bool_]:
    """(N,) whether the points of a point's voxel that are of a kind are looked at from higher up than the others."""
    _, index = np.unique(voxel, return_inverse=True)
    one, other = (np.bincount(index, height * w) / np.maximum(np.bincount(index, w), 1) for w in (of, ~of))
    return np.asarray((one > other)[index])


def _both_sides(voxel: Int, side: NDArray[np.bool_], normals: F64) -> NDArray[np.bool_]:
    """(N,) whether a point's voxel holds points whose normals are opposite."""
    key, index = np.unique(voxel, return_inverse=True)
    sums = np.zeros((2, len(key), 3))
    for way in (0, 1):
        of = side == bool(way)
        for k in range(3):
            sums[way, :, k] = np.bincount(index[of], normals[of, k], minlength=len(key))
    one, other = length(sums)
    cosine = dot(sums[0], sums[1]) / np.maximum(one * other, 1e-30)
    few = np.minimum(one, other) < TUNING.fused_few * np.maximum(one, other)
    return np.asarray(((cosine < TUNING.fused_opposite) & ~few)[index])


def _voxel(places: F64) -> Int:
    i = np.floor(places).astype(np.int64) + (1 << 20)
    return np.asarray((i[:, 0] << 42) | (i[:, 1] << 21) | i[:, 2])
