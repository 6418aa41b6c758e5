"""Plain walls: a room of which its pictures tell too little is taken for a box.

To an optimiser a wall without a pattern is a sky: its splats hang anywhere before or behind it. People capture what
stands amid a room so, and see its walls in passing. What is sure in it, as skirting boards, shelves and what stands
along the walls, tells how far off they are (the layout of a room as a box: Hedau, Hoiem and Forsyth, 2009).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mirelight.base.together import each
from mirelight.model import F64
from mirelight.proxy.depth import DepthMap, sure_points
from mirelight.proxy.flats import Flat, depth_of, seen_through
from mirelight.proxy.labels import Labels
from mirelight.proxy.openings import Window
from mirelight.proxy.skies import fog_of
from mirelight.proxy.tuning import TUNING
from mirelight.proxy.types import Int
from mirelight.proxy.views import length, rays, turned

Bool = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Room:
    """A box that all cameras stand in."""

    middle: F64  # (3,) of the cameras
    axes: F64  # (3, 3) unit, its rows: along the floor, up, along the floor
    low: F64  # (3,) where its sides are along these from the middle
    high: F64
    roofed: bool = False  # whether pictures show a ceiling

    @property
    def cut(self) -> bool:
        """Whether its walls end where pictures do, lower than cameras stood."""
        return bool(self.high[1] < 0)

    @property
    def top(self) -> tuple[F64, float] | None:
        """(3,) unit, up, and how far along it nothing is higher; None: as high as anything."""
        return (self.axes[1], float(self.axes[1] @ self.middle + self.high[1])) if self.cut else None

    def floored(self, flats: Sequence[Flat], walls: Sequence[Flat]) -> tuple[list[Flat], list[Flat]]:
        """Planes, with its whole floor in place of the one that tells it, if any, and those of its sides that none is.

        Args:
            flats: the planes that are seen.
            walls: its sides, the floor first.
        """
        near = TUNING.wall_floor * (self.high[1] - self.low[1])
        same = [abs(_height(flat, self) - self.low[1]) < near for flat in flats]
        if not any(same):
            return list(flats), list(walls)
        kept = [flat for flat, own in zip(flats, same, strict=True) if not own]
        floor = replace(walls[0], lift=np.zeros(walls[0].there.shape)) if self.cut else walls[0]
        return [floor, *kept], list(walls[1:])

    def left(self, view: DepthMap) -> tuple[F64, F64, Bool]:
        """(H, W) depths at which the view's rays leave the room, (H, W, 3) where along its axes, and (H, W) whether
        through a wall."""
        origins, directions = rays(view.camera)
        start, way = turned(origins - self.middle, self.axes), turned(directions, self.axes)
        ahead = np.where(np.abs(way) > 1e-12, way, 1e-12)
        away = (np.where(ahead > 0, self.high, self.low) - start) / ahead
        depth = away.min(axis=-1)
        return depth, start + way * depth[..., None], away.argmin(axis=-1) != 1

    def looked_up(self, view: DepthMap) -> float:
        """The share of a view's pixels whose rays leave the room above its walls."""
        _, place, wall = self.left(view)
        return float((~wall & (place[..., 1] > 0)).mean())

    def highest(self, view: DepthMap) -> float:
        """How high, from its middle, the view shows its walls, if those are there."""
        _, place, wall = self.left(view)
        return float(place[..., 1].max(where=wall & (view.alpha > TUNING.depth_opaque), initial=-np.inf))

    def is_shown_level(self, views: Sequence[DepthMap]) -> bool:
        """Whether views show its walls all round higher than they were taken from; else little tells where those are,
        and nothing how they end."""
        shown = np.sum(each(self._ways, views), axis=0)
        return bool((shown >= TUNING.wall_views).mean() > TUNING.wall_round)

    def _ways(self, view: DepthMap) -> Bool:
        """(K,) the ways round the room in which a view shows a wall higher than cameras stood."""
        _, place, wall = self.left(view)
        at = place[wall & (place[..., 1] > 0) & (view.alpha > TUNING.depth_opaque)]
        turn = (np.arctan2(at[:, 2], at[:, 0]) / (2 * np.pi) + 0.5) * TUNING.ceiling_ways
        return np.isin(np.arange(TUNING.ceiling_ways), turn.astype(np.int64) % TUNING.ceiling_ways)

    def shown_above(self, view: DepthMap) -> tuple[int, int]:
        """How many of the view's pixels whose rays leave the room above its walls are sure, and how many of those are
        on its ceiling."""
        depth, place, wall = self.left(view)
        sure = ~wall & (place[..., 1] > 0) & (view.trust > TUNING.sure)
        on = sure & (np.abs(view.depth / depth - 1) < TUNING.wall_on)
        return int(sure.sum()), int(on.sum())

    def shone(self, view: DepthMap) -> DepthMap:
        """The view with what is white about its walls and ceiling behind them, as windows and skylights are looked for
        there: the sky in them hangs anywhere, too."""
        depth, white = self._white(view)
        return replace(view, depth=np.where(white, TUNING.wall_white[1] * depth, view.depth).astype(np.float32))

    def sunlit(self, view: DepthMap) -> DepthMap:
        """The view with what is white and hangs about its walls and ceiling on them, as a patch of sun is."""
        depth, white = self._white(view)
        white &= view.trust < TUNING.fog
        return replace(view, depth=np.where(white, depth, view.depth).astype(np.float32))

    def _white(self, view: DepthMap) -> tuple[F64, Bool]:
        """(H, W) depths at which the view's rays leave the room, and which pixels near there are white."""
        depth, place, wall = self.left(view)
        near, behind = TUNING.wall_white
        white = (wall | (place[..., 1] > 0)) & (view.color.min(axis=2) > TUNING.clipped)
        return depth, white & (view.depth > near * depth) & (view.depth < behind * depth)

    def lets_in(self, window: Window) -> bool:
        """Whether a window in one of its walls is higher than cameras stood: what is white below may be a patch of sun,
        as nobody knows the wall's place well enough to tell them apart by depth."""
        top = window.face.middles[window.face.there.ravel()]
        return len(top) > 0 and float(turned(top - self.middle, self.axes)[:, 1].max()) > 0

    def flats(self, views: Sequence[DepthMap], spacing: float) -> list[Flat]:
        """Its floor, walls and ceiling if any, but for what of them views surely see through."""
        walls = [(k, x[k], front) for k in (0, 2) for x, front in ((self.low, 1.0), (self.high, -1.0))]
        sides = [(1, self.low[1], 1.0), *walls, (1, self.high[1], -1.0)][: 6 if self.roofed else 5]
        return each(lambda side: self._flat(*side, views, spacing), sides)

    def _flat(self, axis: int, place: float, front: float, views: Sequence[DepthMap], spacing: float) -> Flat:
        others = [(axis + 1) % 3, (axis + 2) % 3]
        long = float((self.high - self.low).max())
        along, cell = self.axes[others], max(TUNING.plane_cell * spacing, long / TUNING.wall_cells)
        start = turned(self.middle, along)
        first = np.floor((start + self.low[others]) / cell).astype(np.int64)
        size = np.ceil((start + self.high[others]) / cell).astype(np.int64) - first
        normal = front * self.axes[axis]
        offset = float(normal @ (self.middle + place * self.axes[axis]))
        whole = Flat(normal, offset, along, cell, first, np.ones(tuple(size), bool))
        return replace(whole, there=~seen_through(whole, views, TUNING.plane_tolerance * spacing))


def room_of(views: Sequence[DepthMap], flats: Sequence[Flat], up: F64 | None) -> Room | None:
    """The room about what views show; None where all is told, where they show a sky, or `up` (3,) is not known.

    Args:
        views: maps of a capture's own cameras.
        flats: the planes that they show.
        up: (3,) unit, as cameras were held.
    """
    if up is None or not fog_of(views, flats):
        return None
    found = _box(views, _axes(flats, up))
    if found is None or not _is_closed(found, views, flats):
        return None
    return _as_shown(found, views, flats)


def _as_shown(room: Room, views: Sequence[DepthMap], flats: Sequence[Flat]) -> Room:
    """The room with its floor on the plane that tells it best, if any, and walls that end where pictures do if these
    show none as high as they were taken from: who looks down at a table sees what stands around it, and no walls."""
    low, high = room.low.copy(), room.high.copy()
    off = [_height(flat, room) - low[1] for flat in flats]
    nearest = min(off, key=abs, default=np.inf)
    if abs(nearest) < TUNING.wall_beside * (high[1] - low[1]):
        low[1] += nearest
    top = max(each(room.highest, views))
    if top < 0:
        high[1] = top
    return replace(room, low=low, high=high)


def _height(flat: Flat, room: Room) -> float:
    """How high a plane lies in a room, from its middle; infinite where it is not level."""
    cosine = float(flat.normal @ room.axes[1])
    level = abs(cosine) > TUNING.wall_square
    return float(np.sign(cosine) * (flat.offset - flat.normal @ room.middle)) if level else np.inf


def hung(
    views: Sequence[DepthMap], labels: Sequence[Labels], flats: Sequence[Flat], walls: Sequence[int]
) -> list[Labels]:
    """The labels, with unsure pixels of no plane put onto the wall behind them where they look like it: along its
    edges, and about what stands before it. A plain thing before a wall has another colour.

    Args:
        views: maps.
        labels: of each.
        flats: the planes that they tell of.
        walls: which of them are sides of a room.
    """
    behind = each(lambda view: _behind(view, flats, walls), views)
    looks = {k: _looks(k, views, labels, flats[k], behind) for k in walls}

    def put(i: int) -> Labels:
        view, (wall, cell) = views[i], behind[i]
        plane, sure = labels[i].plane.copy(), labels[i].sure.copy()
        unsure = (plane == len(flats)) & (view.depth > 0) & (view.trust < TUNING.fog)
        for k in walls:
            there = unsure & (wall == k)
            off = np.abs(view.color[there] - looks[k][cell[there]]).sum(axis=1)
            there[there] = off < TUNING.wall_alike
            plane[there], sure[there] = k, 1
        return Labels(plane, sure)

    return each(put, range(len(views)))


def _behind(view: DepthMap, flats: Sequence[Flat], walls: Sequence[int]) -> tuple[Int, Int]:
    """(H, W) the wall that each of a view's rays meets first, -1: none, and which of its cells."""
    origins, directions = rays(view.camera)
    nearest = np.full(view.depth.shape, np.inf)
    wall, cell = np.full(view.depth.shape, -1), np.zeros(view.depth.shape, np.int64)
    for k in walls:
        depth = depth_of(view, flats[k], directions)
        first = (depth > 0) & (depth < nearest)
        i, _ = flats[k].cells((origins + directions * depth[..., None])[first])
        nearest[first], wall[first] = depth[first], k
        cell[first] = i[:, 0] * flats[k].there.shape[1] + i[:, 1]
    return wall, cell


def _looks(
    k: int, views: Sequence[DepthMap], labels: Sequence[Labels], flat: Flat, behind: Sequence[tuple[Int, Int]]
) -> F64:
    """(C, 3) what the cells of a wall look like, the mean over pixels that lie on it; as those beside it where none
    does; infinite where none does at all."""
    from scipy.ndimage import distance_transform_edt

    there = [(label.plane == k) & (wall == k) for label, (wall, _) in zip(labels, behind, strict=True)]
    cell = np.concatenate([of[x] for x, (_, of) in zip(there, behind, strict=True)])
    color = np.concatenate([view.color[x] for x, view in zip(there, views, strict=True)])
    count = np.bincount(cell, minlength=flat.there.size)
    if not count.any():
        return np.full((flat.there.size, 3), np.inf)
    mean = _means(color.astype(np.float64), cell, np.maximum(count, 1))
    at = distance_transform_edt((count == 0).reshape(flat.there.shape), return_distances=False, return_indices=True)
    return np.asarray(mean.reshape(*flat.there.shape, 3)[tuple(at)].reshape(-1, 3))


def _axes(flats: Sequence[Flat], up: F64) -> F64:
    """(3, 3) along the largest wall that was found, if any, and upright as the largest level plane is."""
    size = [int(flat.there.sum()) for flat in flats]
    order = sorted(range(len(flats)), key=lambda k: -size[k])
    level = next((k for k in order if abs(float(flats[k].normal @ up)) > TUNING.wall_level), None)
    if level is not None:
        up = flats[level].normal * np.sign(float(flats[level].normal @ up))
    across = np.linalg.svd(up[None])[2][1]
    wall = next((k for k in order if abs(float(flats[k].normal @ up)) < TUNING.wall_upright), None)
    along = across if wall is None else flats[wall].normal
    along = along - up * float(along @ up)
    along = along / np.linalg.norm(along)
    return np.stack([along, up, np.cross(along, up)])


def _box(views: Sequence[DepthMap], axes: F64) -> Room | None:
    """As far as what is sure in views reaches on each side, and no nearer than cameras stood. None where a camera
    stands below it, and where it is higher than most rooms are and has no sure ceiling, as a street."""
    eyes = np.stack([view.camera.position for view in views])
    middle = np.median(eyes, axis=0)
    at, stood = turned(np.concatenate(each(sure_points, views)) - middle, axes), turned(eyes - middle, axes)
    if len(at) < TUNING.flat_fewest:
        return None
    low, high = np.zeros(3), np.zeros(3)
    low[1], seen = np.quantile(at[:, 1], [TUNING.wall_floor, TUNING.ceiling_seen])
    high[1] = low[1] + TUNING.ceiling_most * (stood[:, 1].max() - low[1])
    tall = bool(seen > high[1])
    for k in (0, 2):
        for side, out in ((1.0, high), (-1.0, low)):
            away = side * at[:, k]
            there = away > np.abs(at[:, 2 - k])
            far = np.quantile(away[there], TUNING.wall_far) if there.sum() >= TUNING.flat_fewest else 0.0
            out[k] = side * max(float(far), TUNING.wall_eyes * float((side * stood[:, k]).max()))
    if not ((low < stood) & (stood < high)).all():
        return None
    # pictures that look up in a room show its ceiling; where that meets the walls is sure
    over = low[1] + TUNING.ceiling_over * (stood[:, 1].max() - low[1])
    below = Room(middle, axes, low, np.array([high[0], over, high[2]]), roofed=True)
    if np.mean(each(below.looked_up, views)) < TUNING.wall_sky:
        return None if tall else Room(middle, axes, low, high)
    over = max(over, float(np.quantile(at[:, 1], 1 - TUNING.wall_floor)))
    room = replace(below, high=np.array([high[0], over, high[2]]))
    return None if tall and not _has_ceiling(room, views) else room


def _has_ceiling(room: Room, views: Sequence[DepthMap]) -> bool:
    """Whether much of what views show surely above the walls is on one plane; fronts of a street end anywhere."""
    sure, on = np.sum(each(room.shown_above, views), axis=0)
    return bool(on > TUNING.wall_ceiling * sure)


def _is_closed(room: Room, views: Sequence[DepthMap], flats: Sequence[Flat]) -> bool:
    """Whether what views show unsurely past the floor is on walls: it has one colour in one place for all of them.
    What is far away, and a sky most of all, has one in one direction."""
    rows = np.concatenate(each(lambda k: _beyond(room, views[k], flats, k), range(len(views))))
    total = sum(int((view.alpha > TUNING.depth_opaque).sum()) for view in views)
    above, nearer = rows[:, 1] > 0, _nearer(rows)
    if above.sum() * TUNING.wall_step**2 > TUNING.wall_sky * total and nearer < TUNING.wall_nearest:
        return min(nearer / TUNING.wall_nearer[1], _nearer(rows[above]) / TUNING.wall_nearer[0]) > 1
    return nearer > TUNING.wall_nearer[1]


def _nearer(rows: F64) -> float:
    """The share of rows of :func:`_beyond` that differ less from what other pictures show in their place than from what
    these show in their direction; 0 where none can be told."""
    colors, of = rows[:, 6:9], rows[:, 9].astype(np.int64)
    by_place, by_way = _differing(rows[:, 3:6], colors, of), _differing(rows[:, :3], colors, of)
    told = np.isfinite(by_place) & np.isfinite(by_way)
    return float((by_place < by_way)[told].mean()) if told.any() else 0.0


def _beyond(room: Room, view: DepthMap, flats: Sequence[Flat], k: int) -> F64:
    """(N, 10) of unsure pixels past the floor and on no plane, as the fronts of a street are: the direction, that of
    the place where rays leave the room from its middle, the colour; and the view's number."""
    step = (slice(None, None, TUNING.wall_step),) * 2
    _, directions = rays(view.camera)
    _, place, wall = room.left(view)
    way = turned(directions, room.axes)[step]
    unsure = (
        (view.alpha > TUNING.depth_opaque)[step] & (view.trust < TUNING.fog)[step] & (wall[step] | (way[..., 1] > 0))
    )
    for flat in flats:
        unsure &= depth_of(view, flat, directions)[step] == 0
    way, place = way[unsure], place[step][unsure]
    units = [way / length(way)[:, None], place / np.maximum(length(place), 1e-12)[:, None]]
    return np.concatenate([*units, view.color[step][unsure], np.full((len(way), 1), k)], axis=1)


def _differing(ways: F64, colors: F64, of: NDArray[np.int64]) -> F64:
    """(N,) by how much colours differ from those that other pictures show in the same small solid angle, as a mean;
    infinite where fewer than two others do.

    Args:
        ways: (N, 3) unit.
        colors: (N, 3).
        of: (N,) the picture that each is of.
    """
    turn = np.degrees(np.arctan2(ways[:, 2], ways[:, 0])) // TUNING.wall_degrees
    rise = np.degrees(np.arcsin(np.clip(ways[:, 1], -1, 1))) // TUNING.wall_degrees
    around = 2 * int(360 / TUNING.wall_degrees)
    cell = ((rise + around) * around + turn + around).astype(np.int64)
    pictures = int(of.max(initial=0)) + 1
    spots, spot, count = np.unique(cell * pictures + of, return_inverse=True, return_counts=True)
    mean = _means(colors, spot, count)
    _, cell, views = np.unique(spots // pictures, return_inverse=True, return_counts=True)
    shown = views[cell]
    off = length(mean - _means(mean, cell, views)[cell]) * shown / np.maximum(shown - 1, 1)  # itself is in the mean
    return np.where(shown > 2, off, np.inf)[spot]


def _means(rows: F64, of: NDArray[np.int64], count: NDArray[np.int64]) -> F64:
    """(K, 3) of rows (N, 3) of groups."""
    return np.stack([np.bincount(of, rows[:, k], len(count)) / count for k in range(3)], axis=1)
