"""Windows: where pictures are clipped to white and what shines lies behind the wall around it, light comes in.

Splats of a sky that a picture shows as white lie anywhere behind a window's frame, as nothing tells their distance;
taken for a surface they would shut the window. A patch of sun on a wall is as bright, but lies on it. To an optimiser
bars before such a sky are fog and dust as well, but pictures show where they are: all of a window's lie in one plane,
that in which its pictures agree best (a plane sweep: Collins, 1996), and there they are cut out of a sheet.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirelight.base.together import each
from mirelight.model import F32, F64
from mirelight.proxy.depth import DepthMap, pixels_of
from mirelight.proxy.flats import Flat
from mirelight.proxy.pieces import turned_to
from mirelight.proxy.planes import Sheet
from mirelight.proxy.tuning import TUNING
from mirelight.proxy.types import Soup
from mirelight.proxy.views import dot, length, rays, turned

Bool = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Window:
    """The plane of a window's bars in small cells."""

    wall: Flat
    face: Flat  # the plane; its cells `there` are those that the window is seen through, bars and panes
    bars: Bool  # (I, J) of its cells: which stop light, the rim among them
    front: float  # 1: it was seen from the side that the plane's normal points to, -1: from the other

    def solid(self) -> Soup:
        """Triangles of the bars, fronts outwards: as deep as most of them are wide."""
        from scipy.ndimage import distance_transform_edt, maximum_filter

        face = self.face
        inside = distance_transform_edt(self.bars & face.there)
        amid = (inside > 0) & (inside == maximum_filter(inside, 5))
        wide = 2 * float(np.median(inside[amid])) if amid.any() else 1.0
        origin = face.normal * face.offset + np.einsum("k,ki->i", face.low * face.cell, face.axes)
        steps, back = face.axes * face.cell, -self.front * wide * face.cell * face.normal
        made = Sheet(origin, face.axes, face.cell, np.ones_like(self.bars)).rectangles(self.bars)
        handed = self.front * float(np.dot(np.cross(face.axes[0], face.axes[1]), face.normal))
        out = made.beside(Soup(made.vertices + back, made.faces[:, ::-1]))
        padded = np.pad(self.bars, 1).astype(np.int8)
        for axis, edge in enumerate((np.diff(padded, axis=0)[:, 1:-1], np.diff(padded, axis=1)[1:-1])):
            i, j = np.nonzero(edge)
            first = origin + i[:, None] * steps[0] + j[:, None] * steps[1]
            ring = np.stack([first, first + steps[1 - axis], first + steps[1 - axis] + back, first + back], axis=1)
            turned_over = (edge[i, j] > 0) == (axis == 0)
            ring = np.where(turned_over[:, None, None], ring, ring[:, ::-1])
            corner = 4 * np.arange(len(ring))[:, None]
            out = out.beside(
                Soup(ring.reshape(-1, 3), np.concatenate([corner + np.array(k) for k in ((0, 1, 2), (0, 2, 3))]))
            )
        return Soup(out.vertices, out.faces if handed > 0 else out.faces[:, ::-1])

    def opened(self, view: DepthMap, spacing: float) -> Bool:
        """(H, W) pixels that are seen through the window, or show its bars."""
        origins, directions = rays(view.camera)
        slack = TUNING.opening_before * spacing * length(directions)
        wall, _ = met(self.wall, origins, directions)
        face, facing = met(self.face, origins, directions)
        hidden = (view.depth > 0) & (view.depth < wall - slack / np.maximum(facing, 0.1))
        return np.asarray((face > 0) & ~hidden & self.face.inside(origins + directions * face[..., None]))


def windows_of(views: Sequence[DepthMap], flats: Sequence[Flat], spacing: float, up: F64 | None = None) -> list[Window]:
    """The windows in planes.

    Args:
        views: maps.
        flats: the planes that they show.
        spacing: of the splats, world units.
        up: (3,) unit, where it is known: the sun makes no patch on what looks down.
    """
    panes = each(lambda flat: _panes(flat, views, spacing), flats)
    found = (_window(flat, x, views, spacing, up) for flat, of in zip(flats, panes, strict=True) for x in of)
    return [window for window in found if window is not None]


def opened(view: DepthMap, looked: DepthMap, windows: Sequence[Window], spacing: float, away: float) -> DepthMap:
    """The view with all that is seen through windows so far away, bars too: those are made apart. `looked`: the same as
    windows were looked for in it."""
    sky = np.any([window.opened(looked, spacing) for window in windows], axis=0)
    _, directions = rays(view.camera)
    facing = -directions / np.linalg.norm(directions, axis=-1, keepdims=True)
    return replace(
        view,
        depth=np.where(sky, np.float32(away), view.depth),
        normal=np.where(sky[..., None], facing, view.normal).astype(np.float32),
        spread=np.where(sky, np.float32(0), view.spread),
        trust=np.where(sky, np.float32(1), view.trust),
    )


def _panes(flat: Flat, views: Sequence[DepthMap], spacing: float) -> list[Bool]:
    """(I, J) each: cells of a plane that light comes through, of one window."""
    from scipy.ndimage import binary_closing, binary_opening, label

    at = flat.middles
    seen, white, behind = np.zeros(len(at)), np.zeros(len(at)), np.zeros(len(at))
    for view in views:
        rows, pixel, off = looked_at(view, flat, at, spacing)
        there = (off > -TUNING.opening_before) & (view.depth.ravel()[pixel] > 0)
        seen[rows] += there
        white[rows] += there & (view.color.min(axis=-1).ravel()[pixel] > TUNING.clipped)
        behind[rows] += there * np.clip(off, -TUNING.opening_far, TUNING.opening_far)
    shape = flat.there.shape
    shines = binary_opening(((white > 0.5 * seen) & (seen > 2)).reshape(shape))
    deep = (behind / np.maximum(seen, 1)).reshape(shape)
    part, count = label(
        binary_closing(np.pad(shines, TUNING.opening_bars), iterations=TUNING.opening_bars)[
            TUNING.opening_bars : -TUNING.opening_bars, TUNING.opening_bars : -TUNING.opening_bars
        ]
    )
    parts = [shines & (part == k) for k in range(1, count + 1)]
    return [
        x
        for x in parts
        if x.sum() >= TUNING.window_cells and np.median(deep[x]) > TUNING.window_depth and flat.there[x].mean() > 0.5
    ]


def _window(wall: Flat, panes: Bool, views: Sequence[DepthMap], spacing: float, up: F64 | None = None) -> Window | None:
    """What is white in the plane where the pictures agree best; None where that is the wall's face, as of a patch of
    sun, and the wall does not look down."""
    from scipy.ndimage import binary_closing, binary_dilation, binary_fill_holes, binary_opening

    eyes = np.stack([view.camera.position for view in views])
    front = 1.0 if float(np.median(wall.off(eyes))) > 0 else -1.0
    cell, margin = TUNING.opening_fine * spacing, (TUNING.opening_deepest + TUNING.opening_rim) * spacing
    place = turned_to(wall.middles[panes.ravel()], wall.axes)
    low = np.floor((place.min(axis=0) - margin) / cell).astype(np.int64)
    size = np.ceil((place.max(axis=0) + margin) / cell).astype(np.int64) - low
    inner = replace(wall, there=panes)

    def looked(deep: float) -> tuple[float, float, Flat, _Shown]:
        face = Flat(wall.normal, wall.offset - front * deep * spacing, wall.axes, cell, low, np.ones(tuple(size), bool))
        shown = _shown(face, wall, views, spacing)
        here = inner.inside(face.middles).reshape(shown.seen.shape) & (shown.seen >= TUNING.opening_seen)
        return (float(shown.spread[here].mean()) if here.any() else np.inf, deep, face, shown)

    found = each(looked, np.arange(-TUNING.opening_depth, TUNING.opening_deepest, TUNING.opening_depth))
    _, deep, face, shown = min(found, key=lambda x: x[:2])
    looks_down = up is not None and float(front * wall.normal @ up) < -TUNING.wall_level
    if deep < TUNING.window_bars and not looks_down:
        return None
    reach = round(TUNING.opening_rim / TUNING.opening_fine)
    square = np.ones((2 * reach + 1,) * 2, bool)
    seen = shown.seen >= TUNING.opening_seen
    near = replace(wall, there=binary_dilation(panes)).inside(face.middles).reshape(seen.shape)
    white = _is_white(shown.white, _usual_white(face, wall, views, spacing), seen)
    white = _behind(white & binary_dilation(near, square), shown.behind)
    whole = binary_fill_holes(binary_closing(np.pad(white, reach), square)[reach:-reach, reach:-reach])
    rim = binary_dilation(whole, square) & seen
    bars = binary_opening((whole | rim) & ~white, np.ones((2, 2), bool))  # no crumbs a cell wide
    return Window(wall, replace(face, there=whole), bars, front)


def _behind(white: Bool, behind: F64) -> Bool:
    """White cells (I, J) of panes: what shines there lies behind the wall; a sill in the sun lies before it."""
    from scipy.ndimage import label, median

    part, count = label(white)
    deep = np.atleast_1d(median(behind, part, np.arange(1, count + 1))) > TUNING.window_depth
    return np.asarray(np.concatenate([[False], deep])[part])


def _is_white(mean: F64, usual: F32, seen: Bool) -> Bool:
    """(I, J) cells nearly as white as the whitest around them, as bars are blurred. What no view sees is
    none: fog hangs before bars.

    Args:
        mean: (I, J) 0 to 1, how white they are to all views.
        usual: the same to the middle one of them. A curtain or a shelf before a window's edge, or dust, is in some
            pictures alone and no bar; but the median thins bars that a sky is blurred over.
        seen: (I, J) whether views see them.
    """
    from scipy.ndimage import maximum_filter, minimum_filter

    def around(white: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
        wide = 2 * round(1 / TUNING.opening_fine) + 1
        high = maximum_filter(white, wide)
        return minimum_filter(np.where(seen, white, high), wide), high

    low, high = around(mean)
    least, most = around(usual)
    part = low + TUNING.opening_part * (high - low)
    even = (high - low < TUNING.opening_even) | (most - least < TUNING.opening_usual)
    return np.asarray(seen & (most > TUNING.opening_white) & ((mean > part) | even))


@dataclass(frozen=True, slots=True, eq=False)
class _Shown:
    """What views show of the cells of a window's plane, (I, J) each."""

    seen: F64  # how many views do
    white: F64  # 0..1, mean
    spread: F64  # variance of that
    behind: F64  # spacings behind the wall's face, mean


def _shown(face: Flat, wall: Flat, views: Sequence[DepthMap], spacing: float) -> _Shown:
    at = face.middles
    seen, total, square, behind = (np.zeros(len(at)) for _ in range(4))
    for rows, white, off in _whites(at, wall, views, spacing):
        seen[rows] += 1
        total[rows] += white
        square[rows] += white * white
        behind[rows] += np.clip(off, -TUNING.opening_far, TUNING.opening_far)
    count = np.maximum(seen, 1)
    mean = total / count
    rows_of = (seen, mean, square / count - mean * mean, behind / count)
    return _Shown(*(x.reshape(face.there.shape) for x in rows_of))


def _usual_white(face: Flat, wall: Flat, views: Sequence[DepthMap], spacing: float) -> F32:
    """(I, J) how white cells of a window's plane are to the middle one of the views, 0 where none sees them."""
    at = face.middles
    white = np.full((len(views), len(at)), np.inf, np.float32)
    for k, (rows, part, _) in enumerate(_whites(at, wall, views, spacing)):
        white[k, rows] = part
    white.sort(axis=0)
    seen = np.isfinite(white).sum(axis=0)
    middle = np.take_along_axis(white, np.maximum(seen[None] - 1, 0) // 2, axis=0)[0]
    return np.where(seen > 0, middle, np.float32(0)).reshape(face.there.shape)


def _whites(
    at: F64, wall: Flat, views: Sequence[DepthMap], spacing: float
) -> Iterator[tuple[NDArray[np.int64], F32, F64]]:
    """For each view: which of points (N, 3) nothing hides before the wall, (M,); how white it is there, 0 to 1; how far
    behind the wall the surface is, in spacings."""
    for view in views:
        rows, pixel, off = looked_at(view, wall, at, spacing)
        off = np.where(view.depth.ravel()[pixel] > 0, off, TUNING.opening_far)  # nothing is there
        there = off > -TUNING.opening_before
        least = view.color.min(axis=-1).ravel()[pixel[there]]
        white: F32 = np.clip((least - TUNING.opening_dark) / (1 - TUNING.opening_dark), 0, 1)
        yield rows[there], white, off[there]


def looked_at(view: DepthMap, flat: Flat, at: F64, spacing: float) -> tuple[NDArray[np.int64], NDArray[np.int64], F64]:
    """Rows (M,) of points (N, 3) that are in a view's picture, their pixels, and how far behind a plane the surface is
    there, in spacings."""
    own = turned(at - view.camera.position, view.camera.camera_from_world[:3, :3])
    pixel = pixels_of(view.camera, own.astype(np.float32))
    rows = np.flatnonzero(pixel >= 0)
    pixel = pixel[rows]
    origins, directions = rays(view.camera)
    ray = directions.reshape(-1, 3)[pixel]
    start = np.broadcast_to(origins, directions.shape).reshape(-1, 3)[pixel]
    slope = dot(ray, flat.normal)
    side = np.where(dot(start, flat.normal) > flat.offset, 1.0, -1.0)
    surface = start + ray * view.depth.ravel()[pixel][:, None]
    off = -side * (dot(surface, flat.normal) - flat.offset) / spacing
    return rows, pixel, np.where(np.abs(slope) > 0, off, 0.0)


def met(flat: Flat, origins: F64, directions: F64) -> tuple[F64, F64]:
    """(H, W) depths at which rays meet a plane, and the cosines between both."""
    slope = dot(directions, flat.normal)
    safe = np.where(np.abs(slope) > 1e-9, slope, 1e-9)
    depth = (flat.offset - dot(origins, flat.normal)) / safe
    return depth, np.abs(slope) / length(directions)
