"""Depth maps put right by each other: where the surface is, neighbouring views of the splats look alike.

What an optimiser leaves lies off the surface by a pixel nearly everywhere, and by far where it was free to; what it
shows was fitted to pictures, and looks right. PatchMatch stereo (Bleyer et al., 2011; Schönberger et al., 2016) begins
with the splats' own planes here: each pixel tries those of pixels beside it and some by chance, and keeps the one by
which other views look most alike. What several views find in one place is taken. Elsewhere splats tell the depth, moved
as what was found around moves them; and beneath a sky it counts little, and for nothing where views that are sure look
through. The capture's own pictures in place of the splats' tell no more.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mirelight.base import backend
from mirelight.base.progress import ShareProgress
from mirelight.base.together import each
from mirelight.model import F32, F64
from mirelight.proxy.depth import DepthMap
from mirelight.proxy.skies import fog_of
from mirelight.proxy.tuning import TUNING
from mirelight.proxy.types import Int, ProxySettings
from mirelight.proxy.views import dot, length, rays, turned

if TYPE_CHECKING:
    from mirelight.lighting.kernel.correlation import Correlation

Bool = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Planes:
    """A plane through each pixel of a grid over several views, one view after the other."""

    depth: F32  # (P,) along the view axis, world units
    normal: F32  # (P, 3) unit, facing the eye


@dataclass(frozen=True, slots=True, eq=False)
class Pixels:
    """Every `stereo_step`-th pixel both ways of some views."""

    views: tuple[DepthMap, ...]
    start: Int  # (V + 1,) where a view's pixels begin
    shapes: tuple[tuple[int, int], ...]  # of the views' grids, rows by columns
    view: Int  # (P,)
    column: Int  # (P,) px
    row: Int  # (P,) px
    ray: F32  # (P, 3) one deep along the view axis
    side: F32  # (P,) of a pixel, one away, world units

    @staticmethod
    def of(views: Sequence[DepthMap]) -> Pixels:
        """Of views whose depths are (H, W)."""
        step = TUNING.stereo_step
        parts = []
        for view in views:
            row, column = np.mgrid[0 : view.depth.shape[0] : step, 0 : view.depth.shape[1] : step]
            parts.append((row, column, rays(view.camera)[1][row, column]))
        shapes = tuple((x.shape[0], x.shape[1]) for x, _, _ in parts)
        counts = [a * b for a, b in shapes]
        side = [1 / x.camera.fx for x in views]
        return Pixels(
            tuple(views),
            np.concatenate([[0], np.cumsum(counts)]),
            shapes,
            np.repeat(np.arange(len(views)), counts),
            np.concatenate([x.ravel() for _, x, _ in parts]),
            np.concatenate([x.ravel() for x, _, _ in parts]),
            np.concatenate([x.reshape(-1, 3) for _, _, x in parts]).astype(np.float32),
            np.repeat(side, counts).astype(np.float32),
        )

    def part(self, view: int) -> slice:
        """The pixels of one view."""
        return slice(int(self.start[view]), int(self.start[view + 1]))

    def splats(self) -> Planes:
        """The splats' own planes; the median depth of a view where they show none."""
        depth, normal = [], []
        for view in self.views:
            grid = (slice(None, None, TUNING.stereo_step),) * 2
            z = view.depth[grid]
            depth.append(np.where(z > 0, z, np.median(z[z > 0]) if (z > 0).any() else 1).ravel())
            normal.append(view.normal[grid].reshape(-1, 3))
        facing = -self.ray / np.linalg.norm(self.ray, axis=1, keepdims=True)
        normals = np.concatenate(normal)
        flat = length(normals) < 0.5
        normals[flat] = facing[flat]
        return Planes(np.concatenate(depth).astype(np.float32), normals.astype(np.float32))

    def beside(self, planes: Planes, down: int, across: int) -> Planes:
        """The planes of pixels so many further, where each pixel's own ray meets them."""
        depth, normal = np.empty_like(planes.depth), np.empty_like(planes.normal)
        for k, (rows, columns) in enumerate(self.shapes):
            part = self.part(k)
            at = np.ix_(
                np.clip(np.arange(rows) + down, 0, rows - 1), np.clip(np.arange(columns) + across, 0, columns - 1)
            )
            ray = self.ray[part].reshape(rows, columns, 3)
            other, away = (
                planes.normal[part].reshape(rows, columns, 3)[at],
                planes.depth[part].reshape(rows, columns)[at],
            )
            facing = np.minimum(dot(other, ray), np.float32(-0.1))
            met = dot(other, ray[at]) * away / facing
            near = (met > 0.5 * away) & (met < 2 * away)
            depth[part] = np.where(near, met, away).ravel()
            normal[part] = other.reshape(-1, 3)
        return Planes(depth, normal)

    def turned_by_chance(self, planes: Planes, by: float, chance: np.random.Generator) -> Planes:
        """With normals turned by about so many radians."""
        other = planes.normal + np.float32(by) * chance.standard_normal(planes.normal.shape, np.float32)
        other /= np.linalg.norm(other, axis=1, keepdims=True)
        away = dot(other, self.ray) > -0.1
        other[away] = planes.normal[away]
        return Planes(planes.depth, other)

    def moved_by_chance(self, planes: Planes, by: float, chance: np.random.Generator) -> Planes:
        """With depths off by about so many pixels' sides."""
        way = np.float32(by) * chance.standard_normal(len(planes.depth), np.float32)
        return Planes(np.maximum(planes.depth * (1 + way * self.side), planes.depth * 0.1), planes.normal)


def agreed(
    views: Sequence[DepthMap], settings: ProxySettings, spacing: float, report: ShareProgress, *, guessed: bool = False
) -> list[DepthMap]:
    """The views with the surface where what they show agrees on one.

    Args:
        views: smoothed maps of a capture's cameras.
        settings: of these the variant and its threads.
        spacing: of the splats, world units.
        report: hears how far it is.
        guessed: no pictures were taken where the views are: what some look through may be there.

    Returns:
        The maps; as they are where too few look at one place, or what they show does not agree.
    """
    perspective = all(x.camera.projection == "perspective" for x in views)
    near = neighbours(views) if perspective else []
    if not any(len(x) > 1 for x in near):
        return list(views)
    backend.mitsuba(settings.variant, settings.threads)
    from mirelight.lighting.kernel.correlation import Correlation, Windows

    pixels = Pixels.of(views)
    white = [x.color.min(axis=2) > TUNING.clipped for x in views]
    shown = [_shown(x, y) for x, y in zip(views, white, strict=True)]
    windows = Windows(TUNING.stereo_window, TUNING.stereo_color, TUNING.stereo_noise, TUNING.stereo_best)
    correlation = Correlation([x.camera for x in views], shown, near, pixels.view, pixels.column, pixels.row, windows)
    planes, alike = _sought(pixels, correlation, report)
    agree, through = _agreement(pixels, planes, alike, near)
    found = (agree >= TUNING.stereo_agree) & (alike > TUNING.stereo_alike)
    there = np.concatenate([x.depth[:: TUNING.stereo_step, :: TUNING.stereo_step].ravel() for x in views]) > 0
    if found.sum() < TUNING.stereo_least * there.sum():
        return list(views)
    # of a room, what is in doubt counts as before: see `fog_of`
    doubt = TUNING.stereo_doubt if fog_of(views) else 1.0
    merged = _Merged(pixels, planes, found, through & ~found & (not guessed), spacing, doubt)
    return each(lambda k: merged.view(k, white[k]), range(len(views)))


def _shown(view: DepthMap, white: Bool) -> F32:
    """(H, W, 4) display values, and whether a pixel tells something."""
    return np.concatenate([np.clip(view.color, 0, 1), np.where(white, 0, 1)[..., None]], axis=2, dtype=np.float32)


def neighbours(views: Sequence[DepthMap]) -> list[list[int]]:
    """Of each view the others that show most of what it shows, from another side."""

    def beside(k: int) -> list[int]:
        view = views[k]
        there = view.depth > 0
        origins, directions = rays(view.camera)
        every = max(int(there.sum()) // TUNING.stereo_points, 1)
        points = (np.broadcast_to(origins, directions.shape)[there] + directions[there] * view.depth[there][:, None])[
            ::every
        ]
        shown = np.array([0.0 if j == k else _common(view, other, points) for j, other in enumerate(views)])
        order = np.argsort(-shown, kind="stable")[: TUNING.stereo_beside]
        return [int(j) for j in order if shown[j] > TUNING.stereo_common * len(points)]

    return each(beside, range(len(views)))


def _common(view: DepthMap, other: DepthMap, points: F64) -> float:
    """How many of a view's points another shows as large, and from where depth is told."""
    away = [x.camera.position - points for x in (view, other)]
    far = [np.maximum(length(x), 1e-12) for x in away]
    angle = np.degrees(np.arccos(np.clip(dot(away[0], away[1]) / (far[0] * far[1]), -1, 1)))
    told = np.minimum(angle / TUNING.stereo_angles[0], 1) * np.clip(2 - angle / TUNING.stereo_angles[1], 0, 1)
    large = np.clip(far[0] / view.camera.fx * other.camera.fx / far[1], 0, 1)
    depth, at, seen = _onto(other, points, 1)
    there = other.depth.ravel()[at]
    seen &= (there == 0) | (depth < there * (1 + TUNING.stereo_hidden))
    return float((seen * told * large).sum())


def _onto(view: DepthMap, points: F64, step: int) -> tuple[F64, Int, Bool]:
    """(N,) depths of points in a view, the pixel of its grid of every `step`-th that shows them, whether one does."""
    camera = view.camera
    own = turned(points - camera.position, camera.camera_from_world[:3, :3])
    depth = np.maximum(-own[:, 2], 1e-12)
    column = np.floor((camera.cx + camera.fx * own[:, 0] / depth) / step)
    row = np.floor((camera.cy - camera.fy * own[:, 1] / depth) / step)
    rows, columns = (-(-n // step) for n in view.depth.shape)
    seen = (own[:, 2] < 0) & (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
    return depth, np.where(seen, row * columns + column, 0).astype(np.int64), seen


def _sought(pixels: Pixels, correlation: Correlation, report: ShareProgress) -> tuple[Planes, F32]:
    """The planes by which other views look most alike, and how much."""
    chance = np.random.default_rng(0)
    best = pixels.splats()
    alike = correlation.of(best.depth, best.normal)
    for done in range(TUNING.stereo_rounds):
        report("comparing views", done / TUNING.stereo_rounds)
        for other in _others(pixels, done, chance):
            tried = other(best)
            found = correlation.of(tried.depth, tried.normal)
            better = found > alike + TUNING.stereo_gain
            best = Planes(
                np.where(better, tried.depth, best.depth), np.where(better[:, None], tried.normal, best.normal)
            )
            alike = np.where(better, found, alike)
    return best, alike


def _others(pixels: Pixels, done: int, chance: np.random.Generator) -> Iterator[Callable[[Planes], Planes]]:
    """What is tried in place of the planes in a round: those of pixels beside, and some by chance."""
    far, by, turn = TUNING.stereo_beside_px[done], TUNING.stereo_moves[done], TUNING.stereo_turns
    for down, across in ((far, 0), (-far, 0), (0, far), (0, -far)):
        yield partial(pixels.beside, down=down, across=across)
    yield partial(pixels.moved_by_chance, by=by, chance=chance)
    yield lambda x: pixels.turned_by_chance(pixels.moved_by_chance(x, by / 2, chance), turn, chance)
    yield partial(pixels.turned_by_chance, by=turn, chance=chance)


def _agreement(pixels: Pixels, planes: Planes, alike: F32, near: Sequence[Sequence[int]]) -> tuple[Int, Bool]:
    """(P,) how many other views have a surface in the same place, and whether some that are sure look through it."""
    agree, through = np.zeros(len(planes.depth), np.int64), np.zeros(len(planes.depth), np.int64)
    spot = np.stack([x.camera.position for x in pixels.views])[pixels.view] + pixels.ray * planes.depth[:, None]
    for k, others in enumerate(near):
        part = pixels.part(k)
        for j in others:
            depth, at, seen = _onto(pixels.views[j], spot[part], TUNING.stereo_step)
            at = at + pixels.start[j]
            off = np.abs(dot(spot[part] - spot[at], planes.normal[at]))
            side, ahead = depth * pixels.side[at], planes.depth[at] - depth
            hidden = TUNING.stereo_behind * side
            agree[part] += seen & (off < TUNING.stereo_apart * side) & (np.abs(ahead) < hidden)
            through[part] += seen & (ahead > hidden) & (alike[at] > TUNING.stereo_sure)
    return agree, through >= TUNING.stereo_through


@dataclass(frozen=True, slots=True, eq=False)
class _Merged:
    """What was found, and what splats tell elsewhere."""

    pixels: Pixels
    planes: Planes
    found: Bool  # (P,)
    through: Bool  # (P,) looked through, and not found
    spacing: float  # world units
    doubt: float  # how much pixels count that are not found

    def view(self, k: int, white: Bool) -> DepthMap:
        """Of one view, at all of its pixels; those that are white (H, W) stay, as they tell where windows are."""
        view = self.pixels.views[k]
        sure, normal, middle = (
            self._whole(k, self.found),
            self._whole(k, self.planes.normal),
            self._whole(k, self.planes.depth),
        )
        _, directions = rays(view.camera)
        facing = np.minimum(dot(normal, directions), -1e-3)
        depth = dot(normal, self._whole(k, self.pixels.ray)) * middle / facing
        depth = np.where((depth > 0.8 * middle) & (depth < 1.25 * middle), depth, middle)
        there = view.depth > 0
        moved = _moves(
            view, np.where(there, depth / np.maximum(view.depth, 1e-12) - 1, 0) * view.camera.fx, sure & there
        )
        rest = np.where(there & ~self._whole(k, self.through), view.depth * (1 + moved / view.camera.fx), 0)
        sure, rest = sure & ~white, np.where(white, view.depth, rest)
        return replace(
            view,
            depth=np.where(sure, depth, rest).astype(np.float32),
            normal=np.where(sure[..., None], normal, view.normal).astype(np.float32),
            trust=np.where(sure, 1, np.where(white, 1, self.doubt) * view.trust).astype(np.float32),
            spread=np.where(sure, np.minimum(view.spread, self.spacing), view.spread).astype(np.float32),
        )

    def _whole(self, k: int, values: NDArray[Any]) -> NDArray[Any]:
        """(H, W, ...) what the grid's pixels have, at those about them."""
        at = np.ix_(*(np.arange(n) // TUNING.stereo_step for n in self.pixels.views[k].depth.shape))
        return values[self.pixels.part(k)].reshape(*self.pixels.shapes[k], *values.shape[1:])[at]


def _moves(view: DepthMap, moves: F64, told: Bool) -> F64:
    """(H, W) by how many pixels' sides depths of splats move: as those around do that were found."""
    from scipy.ndimage import gaussian_filter

    told = told & (np.abs(moves) < TUNING.stereo_behind)
    out = np.zeros(view.depth.shape)
    for wide in TUNING.stereo_around:  # from far to near, the nearer taken where it has enough
        count = gaussian_filter(told.astype(np.float64), wide) * wide**2
        mean = gaussian_filter(np.where(told, moves, 0.0), wide) * wide**2 / np.maximum(count, 1e-9)
        share = count / (count + TUNING.stereo_enough)
        out = share * mean + (1 - share) * out
    return out
