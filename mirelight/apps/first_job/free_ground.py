"""Where a first picture shows free ground: level as far as a foot goes, nothing on or over it, and in full view.

Told by the picture's depths alone: a proxy is made later.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mirelight.model import F64, SplatLayer

_EVERY = 2  # pixels, of those that are tried
_LEVEL = 0.1  # of an object's height: how uneven ground may be
OVER = 1.2  # of its height: what hangs higher is not in its way
_STRAYS = 0.02  # share of what is seen there that may be anything else
_RIM = np.stack([np.cos(np.arange(8) * np.pi / 4), np.sin(np.arange(8) * np.pi / 4)], axis=1)
_HIGHER = 2.0  # units of way that an object is moved for each unit that it would stand above the ground there


@dataclass(slots=True, eq=False)
class FreeGround:
    """The ground of a picture, on which objects are put one after the other."""

    picture: SplatLayer
    _taken: list[tuple[F64, float]] = field(default_factory=list)  # places and radii
    _columns: list[tuple[float, float]] = field(default_factory=list)  # of the picture, that what stands there fills
    _points: F64 = field(init=False)  # (H, W, 3) world units, NaN where nothing is seen
    _tree: Any = field(init=False)  # of those seen, along X and Z
    _seen: F64 = field(init=False)  # (P, 3)

    def __post_init__(self) -> None:
        from scipy.spatial import cKDTree

        camera, depth = self.picture.camera, self.picture.median_depth.astype(np.float64)
        y, x = np.mgrid[: camera.height, : camera.width] + 0.5
        own = np.stack([(x - camera.cx) / camera.fx, (camera.cy - y) / camera.fy, -np.ones_like(x)], axis=-1)
        points = (own * depth[..., None]) @ camera.world_from_camera[:3, :3].T + camera.position
        self._points = np.where(depth[..., None] > 0, points, np.nan)
        self._seen = points[depth > 0]
        self._tree = cKDTree(self._seen[:, [0, 2]])

    def take(self, near: F64, radius: float, height: float) -> F64 | None:
        """(3,) a place for an object's foot, which counts as taken from then on; None where there is none.

        Args:
            near: (3,) where the object should stand, if it can.
            radius: of its foot.
            height: its own.
        """
        tried = self._points[::_EVERY, ::_EVERY].reshape(-1, 3)
        tried = tried[tried[:, 1] < self.picture.camera.position[1] - height * _LEVEL]  # NaN is not
        if not len(tried):
            return None
        higher = tried[:, 1] - self._beneath(near, radius)
        away = np.linalg.norm((tried - near)[:, [0, 2]], axis=1) + np.where(higher > 0, _HIGHER * higher, -higher)
        tried = tried[np.argsort(away, kind="stable")]
        best: tuple[int, F64, tuple[float, float]] | None = None
        for place in tried:
            columns = self._in_view(place, radius, height)
            if columns is None or not self._is_free(place, radius, height):
                continue
            hidden = self._hidden(columns)
            if best is None or hidden < best[0]:
                best = hidden, place, columns
            if not hidden:
                break
        if best is None:
            return None
        _, place, columns = best
        self._taken.append((place, radius))
        self._columns.append(columns)
        return place.copy()

    def _beneath(self, near: F64, radius: float) -> float:
        """The height of most that is seen where an object should stand, as of a table that is looked at; of the lowest
        if nothing is seen there."""
        high = self._seen[self._tree.query_ball_point(near[[0, 2]], radius), 1]
        below = high[high <= near[1]]
        return float(np.median(below) if len(below) else self._seen[:, 1].min())

    def _hidden(self, columns: tuple[float, float]) -> int:
        """In quarters, how much of those columns other objects fill."""
        first, end = columns
        shared = sum(max(min(end, right) - max(first, left), 0.0) for left, right in self._columns)
        return math.ceil(4 * shared / (end - first))

    def _is_free(self, place: F64, radius: float, height: float) -> bool:
        """Whether ground there is level all round and carries nothing."""
        if any(np.linalg.norm((place - other)[[0, 2]]) < radius + own for other, own in self._taken):
            return False
        beside = self._seen[self._tree.query_ball_point(place[[0, 2]], radius)] - place
        beside = beside[beside[:, 1] < min(self.picture.camera.position[1] - place[1], OVER * height)]
        level = np.abs(beside[:, 1]) < _LEVEL * height
        if not level.any() or 1 - level.mean() > _STRAYS:
            return False
        gaps = np.linalg.norm(radius * _RIM[:, None] - beside[level][:, [0, 2]], axis=2).min(axis=1)
        return bool((gaps < max(radius / 2, self._grain(place))).all())

    def _grain(self, place: F64) -> float:
        """How far apart pixels are on level ground at a place (3,), world units."""
        camera = self.picture.camera
        away = float(np.linalg.norm(camera.position - place))
        return away * away / camera.fy / float(camera.position[1] - place[1])

    def _in_view(self, place: F64, radius: float, height: float) -> tuple[float, float] | None:
        """Columns of the picture that an object there fills; None if it is cut off, or the capture hides part of it."""
        camera = self.picture.camera
        rim = np.concatenate([[[0.0, 0.0]], radius * _RIM])
        box = place + np.stack([[x, y, z] for x, z in rim for y in (0.0, height / 2, height)])
        own = (box - camera.position) @ camera.world_from_camera[:3, :3]
        away = -own[:, 2]
        if (away <= camera.near).any():
            return None
        x, y = camera.cx + camera.fx * own[:, 0] / away, camera.cy - camera.fy * own[:, 1] / away
        if min(x.min(), y.min()) < 0 or x.max() >= camera.width or y.max() >= camera.height:
            return None
        depth = self.picture.median_depth[y.astype(np.int64), x.astype(np.int64)]
        return None if ((depth > 0) & (depth < away - radius)).any() else (float(x.min()), float(x.max()))
