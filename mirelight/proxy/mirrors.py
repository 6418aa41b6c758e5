"""Mirrors: where a wall is looked through, and what lies behind is what stands before it.

To an optimiser a mirror is a window onto a second room, whose lamps and windows are as real as the first one's. As a
surface that room has holes where nothing was mirrored, and windows that let a sun in; its light is the first one's. So
a mirror is told by its geometry: turned over at the wall, what is seen behind it lies on surfaces that are seen before
it. It is closed in the plane of its wall, and its faces are known as a mirror's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirelight.base.together import each
from mirelight.model import F32, F64
from mirelight.proxy.depth import DepthMap, points_of
from mirelight.proxy.flats import Flat
from mirelight.proxy.mirror_tuning import MIRRORS
from mirelight.proxy.openings import looked_at
from mirelight.proxy.tuning import TUNING
from mirelight.proxy.types import Int, Soup
from mirelight.proxy.views import dot, rays

Bool = NDArray[np.bool_]


def mirrors_of(views: Sequence[DepthMap], flats: Sequence[Flat], spacing: float) -> dict[int, Flat]:
    """Mirrors in planes, by the plane's place among them: its cells `there` are those that mirror.

    Args:
        views: maps of a capture, as its splats show it.
        flats: the planes that they show.
        spacing: of the splats, world units.
    """
    eyes = np.stack([view.camera.position for view in views])
    found = dict[int, Flat]()
    for k, flat in enumerate(flats):
        side = np.sign(flat.off(eyes))
        if not (side == side[0]).all():  # who stood behind it went through a doorway
            continue
        cells = _mirroring(views, flat, float(side[0]), spacing)
        if cells.any():
            found[k] = replace(flat, there=cells)
    return found


def mirroring(soup: Soup, mirrors: Sequence[Flat], spacing: float) -> Bool:
    """(F,) which faces of a surface lie in mirrors.

    Args:
        soup: in the space of the mirrors.
        mirrors: as :func:`mirrors_of` finds them.
        spacing: of the splats, world units.
    """
    corners = soup.vertices[soup.faces]
    out = np.zeros(len(corners), bool)
    for flat in mirrors:
        near = (np.abs(flat.off(corners)) < TUNING.plane_tolerance * spacing).all(axis=1)
        out |= near & flat.inside(corners.mean(axis=1))
    return out


def _mirroring(views: Sequence[DepthMap], flat: Flat, side: float, spacing: float) -> Bool:
    """(I, J) cells of a plane, seen from that side alone, that mirror.

    What a mirror shows of a wall without a pattern an optimiser leaves on the pane. There the colour still is another
    one from every side, and a wall's is not.
    """
    from scipy.ndimage import binary_closing, binary_fill_holes, binary_opening, label, sum_labels

    shape = flat.there.shape
    seen, through = np.sum(each(lambda view: _seen(view, flat, spacing), views), axis=0).reshape(2, *shape)
    often = seen >= MIRRORS.mirror_seen
    part = _framed(binary_opening((through > MIRRORS.mirror_through * seen) & often), flat.there)
    if not part.any():
        return part > 0
    before = _Before.of(views, flat, side, spacing)
    told = np.sum(each(lambda view: _told(view, flat, part > 0, before, spacing), views), axis=0).reshape(4, *shape)
    asked, alike, *chance = (np.atleast_1d(sum_labels(x, part, np.arange(part.max() + 1))) for x in told)
    better = alike - np.maximum(*chance) > MIRRORS.mirror_alike * asked
    certain = (better & (asked > MIRRORS.mirror_asked))[part] & (part > 0)
    changing = binary_opening((_changes(views, flat, spacing) > MIRRORS.mirror_changes) & often)
    part, _ = label(binary_closing(np.pad(changing | certain, 3), iterations=2)[3:-3, 3:-3])
    out = np.zeros(shape, bool)
    for k in np.unique(part[certain]):
        out |= straight(binary_fill_holes(part == k))
    return out


def straight(cells: Bool) -> Bool:
    """(I, J) cells as a rectangle, where they are one but for corners that few pictures show."""
    place = np.argwhere(cells) + 0.5
    every = np.stack(np.meshgrid(*(np.arange(n) + 0.5 for n in cells.shape), indexing="ij"), axis=-1)
    best, found = 0.0, cells
    for angle in np.radians(np.arange(0, 90, MIRRORS.mirror_turn)):
        axes = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        along = np.einsum("ni,ki->nk", place, axes)
        low, high = np.array([_held(x) for x in along.T]).T
        inside = ((along > low) & (along < high)).all(axis=1).mean()
        area = max(float(np.prod(high - low)), 1.0) / len(place)
        alike = inside / (area + 1 - inside)  # what both have, of what either has
        if inside > MIRRORS.mirror_inside and alike > max(MIRRORS.mirror_filled, best):
            along = np.einsum("ijm,km->ijk", every, axes)
            best, found = alike, ((along > low) & (along < high)).all(axis=-1)
    return found


def _held(along: F64) -> tuple[float, float]:
    """From where to where there are at least half as many of values (N,) as anywhere in a step of 1."""
    first = np.floor(along.min())
    count = np.bincount((np.floor(along) - first).astype(np.int64))
    there = np.flatnonzero(count >= 0.5 * count.max())
    return float(first + there[0]), float(first + there[-1] + 1)


def _framed(cells: Bool, there: Bool) -> Int:
    """(I, J) the parts of cells, from 1, that are no crumbs and that a plane frames, which is `there`; 0: none."""
    from scipy.ndimage import binary_dilation, label

    part, count = label(cells)
    out = np.zeros(cells.shape, np.int64)
    for k in range(1, count + 1):
        own = part == k
        rim = binary_dilation(own, iterations=2) & ~own
        if own.sum() >= MIRRORS.mirror_cells and there[rim].mean() > MIRRORS.mirror_framed:
            out[own] = k
    return out


def _seen(view: DepthMap, flat: Flat, spacing: float) -> F64:
    """(2, N) of a plane's cells: 1 where a view sees one, 1 where it sees what lies behind."""
    rows, _, off = _unhidden(view, flat, spacing)
    out = np.zeros((2, flat.there.size))
    out[0, rows], out[1, rows] = 1, off > MIRRORS.mirror_behind
    return out


def _unhidden(view: DepthMap, flat: Flat, spacing: float) -> tuple[Int, Int, F64]:
    """Rows (M,) of a plane's cells that nothing hides from a view, their pixels, and how far behind the plane what is
    seen there lies, in spacings."""
    rows, pixel, off = looked_at(view, flat, flat.middles, spacing)
    there = (off > -TUNING.opening_before) & (view.depth.ravel()[pixel] > 0)
    return rows[there], pixel[there], off[there]


def _changes(views: Sequence[DepthMap], flat: Flat, spacing: float) -> F64:
    """(I, J) deviation of the colour of a plane's cells between views, display values, in the channel where it is
    most."""
    count, total, square = np.zeros(flat.there.size), np.zeros((flat.there.size, 3)), np.zeros((flat.there.size, 3))
    for view in views:
        rows, pixel, _ = _unhidden(view, flat, spacing)
        color = view.color.reshape(-1, 3)[pixel].astype(np.float64)
        count[rows] += 1
        total[rows] += color
        square[rows] += color * color
    mean, mean_square = (x / np.maximum(count, 1)[:, None] for x in (total, square))
    return np.asarray(np.sqrt(np.maximum(mean_square - mean * mean, 0)).max(axis=1)).reshape(flat.there.shape)


@dataclass(frozen=True, slots=True, eq=False)
class _Before:
    """What views see before a plane."""

    tree: Any  # of points
    color: F32  # (N, 3) there, display values

    @staticmethod
    def of(views: Sequence[DepthMap], flat: Flat, side: float, spacing: float) -> _Before:
        """On that side of it."""
        from scipy.spatial import cKDTree

        step = MIRRORS.mirror_step
        points, color = [], []
        for view in views:
            at, _, _ = points_of(view, step)
            there = side * flat.off(at) > MIRRORS.mirror_before * spacing
            points.append(at[there])
            color.append(view.color[::step, ::step][view.depth[::step, ::step] > 0][there])
        return _Before(cKDTree(np.concatenate(points)), np.concatenate(color))

    def has(self, points: F64, color: F32, near: float) -> Bool:
        """(N,) whether points (N, 3) lie so near to one of that colour (N, 3)."""
        away, row = self.tree.query(points, distance_upper_bound=near)
        there = np.isfinite(away)
        there[there] = (np.abs(self.color[row[there]] - color[there]) < MIRRORS.mirror_color).all(axis=1)
        return np.asarray(there)


def _told(view: DepthMap, flat: Flat, cells: Bool, before: _Before, spacing: float) -> F64:
    """(4, N) of a plane's cells (I, J): how much what a view sees behind some of them tells, as floors go on behind any
    door; how much of that lies on what is seen before it, turned over; and turned over at planes that are moved both
    ways, where it does so by chance."""
    rows, pixel, off = _unhidden(view, flat, spacing)
    behind = (off > MIRRORS.mirror_shift) & cells.ravel()[rows]  # nearer it would agree with itself
    rows, pixel = rows[behind], pixel[behind]
    origins, directions = rays(view.camera)
    start = np.broadcast_to(origins, directions.shape).reshape(-1, 3)[pixel]
    point = start + directions.reshape(-1, 3)[pixel] * view.depth.ravel()[pixel, None]
    facing = np.abs(dot(view.normal.reshape(-1, 3)[pixel].astype(np.float64), flat.normal))
    shown = view.color.reshape(-1, 3)[pixel]
    out = np.zeros((4, flat.there.size))
    out[0, rows] = view.trust.ravel()[pixel] * (facing > MIRRORS.mirror_facing) * (shown.min(axis=1) < TUNING.clipped)
    for k, shift in enumerate((0.0, -MIRRORS.mirror_shift, MIRRORS.mirror_shift)):
        turned_over = point - 2 * (flat.off(point) - shift * spacing)[:, None] * flat.normal
        out[1 + k, rows] = out[0, rows] * before.has(turned_over, shown, MIRRORS.mirror_near * spacing)
    return out
