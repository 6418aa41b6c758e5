"""Slender rods: posts, rails and rings that stand free, with so few discs on them that no place shows all their sides.

Lines along the normals of a round rod's discs meet in its axis, however few they are, so a few of them tell it; where
it bends, a parabola does (`bent`). What tells a rod from an edge, a groove or a leaf is that nothing is beside it;
where a rod ends or meets another it goes on by the discs that lie on what was found where it is free.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirelight.model import F64
from mirelight.proxy.bent import bent_axes
from mirelight.proxy.cell_tuning import CELLS
from mirelight.proxy.types import Int

Bool = NDArray[np.bool_]

_CHUNK = 10_000  # discs looked at at once


@dataclass(frozen=True, slots=True, eq=False)
class Slender:
    """Discs on slender rods, as each tells of them."""

    there: Bool  # (N,)
    axis: F64  # (N, 3) unit
    middle: F64  # (N, 3) from the disc's middle straight to the axis
    bend: F64  # (N, 3) change of the axis per length
    radius: F64  # (N,)

    @staticmethod
    def none_of(count: int) -> Slender:
        """No disc tells of any."""
        axis, middle, bend = np.zeros((3, count, 3))
        return Slender(np.zeros(count, bool), axis, middle, bend, np.zeros(count))

    def _take(self, rows: Int, axis: F64, middle: F64, bend: F64, radius: F64) -> None:
        self.there[rows] = True
        self.axis[rows], self.middle[rows], self.bend[rows], self.radius[rows] = axis, middle, bend, radius


def slender_of(at: F64, normals: F64, near: Int, local: F64, flats: F64) -> Slender:
    """Which discs (N, 3) lie on slender rods; arguments as of :func:`mirelight.proxy.rods.rods_of`."""
    n = len(at)
    found = Slender.none_of(n)
    asked = [_with_few_beside(at, normals, rows, near, local) for rows in _chunks(_far_from(flats, at, local))]
    for rows in _chunks(np.concatenate(asked)):
        _fit(found, at, normals, rows, near, local)
        _fit_bent(found, at, normals, rows[~found.there[rows]], near, local)
    for _ in range(CELLS.slender_steps):
        told, found = found, Slender.none_of(n)
        for rows in _chunks(np.flatnonzero(told.there | told.there[near].any(axis=1))):
            _follow(found, told, at, normals, rows, near, local)
    return found


def _chunks(rows: Int) -> list[Int]:
    return [rows[k : k + _CHUNK] for k in range(0, max(len(rows), 1), _CHUNK)]


def _far_from(flats: F64, at: F64, local: F64) -> Int:
    """Discs with no plane around them: an edge or a groove lies in one."""
    from scipy.spatial import cKDTree

    if not len(flats):
        return np.arange(len(at))
    far, _ = cKDTree(flats).query(at, workers=-1)
    return np.flatnonzero(far > CELLS.slender_open * local)


def nearness(step: F64, local: F64, wide: float) -> F64:
    """(R, K) weights of neighbours so far away (R, K, 3): Gaussians of `wide` local spacings (R,)."""
    return np.asarray(np.exp(-0.5 * (step**2).sum(axis=2) / (wide * local[:, None]) ** 2))


def _with_few_beside(at: F64, normals: F64, rows: Int, near: Int, local: F64) -> Int:
    """Those of the discs that have few of their own side around them."""
    step, n, s = at[near[rows]] - at[rows][:, None], normals[rows], local[rows]
    rise = np.abs(np.einsum("rki,ri->rk", step, n)) < CELLS.slender_level * s[:, None]
    alike = np.abs(np.einsum("rki,ri->rk", normals[near[rows]], n)) > CELLS.slender_sheet
    close = (step**2).sum(axis=2) < (CELLS.slender_around * s[:, None]) ** 2
    return np.asarray(rows[(rise & alike & close).sum(axis=1) <= CELLS.slender_few])


def _fit(found: Slender, at: F64, normals: F64, rows: Int, near: Int, local: F64) -> None:
    """Find rods along the lines from discs to their neighbours; those that stand free are put in."""
    step, m, n, s = at[near[rows]] - at[rows][:, None], normals[near[rows]], normals[rows], local[rows]
    weight = nearness(step, s, CELLS.slender_wide)
    axis, score = _best_way(step, m, n, s, weight)
    there = np.flatnonzero(score > 0)
    rows, n, s, axis = rows[there], n[there], s[there], axis[there]
    step = np.concatenate([np.zeros((len(rows), 1, 3)), step[there]], axis=1)
    m = np.concatenate([n[:, None], m[there]], axis=1)
    weight = np.concatenate([np.ones((len(rows), 1)), weight[there]], axis=1)
    along = np.einsum("rki,ri->rk", step, axis)
    own = weight * ((step**2).sum(axis=2) - along**2 < (CELLS.slender_tube * s[:, None]) ** 2)
    own *= np.abs(np.einsum("rki,ri->rk", m, axis)) < CELLS.bent_upright
    off = step - ((own[..., None] * step).sum(axis=1) / own.sum(axis=1, keepdims=True))[:, None]
    axis = np.linalg.eigh(np.einsum("rk,rki,rkj->rij", own, off, off))[1][:, :, 2]
    frame = frame_of(axis, n)
    flat, across = flattened(m, frame)
    q = np.einsum("rki,rij->rkj", step, frame[:, :, :2])
    middle, radius = _middle(q, flat, own * across)
    aside, out = beside(q - middle[:, None], flat)
    lax = CELLS.slender_astray * (radius + CELLS.bent_slack * s)[:, None]
    on = across & (aside < lax) & (np.abs(np.abs(out) - radius[:, None]) < lax)
    along = np.einsum("rki,ri->rk", step, axis)
    good = (on.sum(axis=1) >= CELLS.slender_fewest) & (radius < CELLS.slender_tube * s)
    good &= _stands_free(on, along, q - middle[:, None], flat, weight, radius, s)
    middle = np.einsum("rij,rj->ri", frame[:, :, :2], middle)
    found._take(rows[good], axis[good], middle[good], np.zeros((int(good.sum()), 3)), radius[good])


def _best_way(step: F64, m: F64, n: F64, local: F64, weight: F64) -> tuple[F64, F64]:
    """(R, 3) which way to a neighbour most others lie on the sides of one rod, and (R,) how many more than others."""
    length = np.linalg.norm(step, axis=2)
    way = step / np.maximum(length, 1e-30)[..., None]
    tried = (np.abs(np.einsum("rki,ri->rk", way, n)) < CELLS.bent_upright) & (
        np.abs((way * m).sum(axis=2)) < CELLS.bent_upright
    )
    tried &= length > CELLS.slender_apart * local[:, None]
    best, axis, tube = np.zeros(len(n)), np.zeros((len(n), 3)), (CELLS.slender_tube * local[:, None]) ** 2
    for k in range(step.shape[1]):
        within = weight * (length**2 - np.einsum("rki,ri->rk", step, way[:, k]) ** 2 < tube)
        score = (within * np.where(np.abs(np.einsum("rki,ri->rk", m, way[:, k])) < CELLS.bent_upright, 1.0, -1.0)).sum(
            axis=1
        )
        better = np.flatnonzero(tried[:, k] & (score > best))
        best[better], axis[better] = score[better], way[better, k]
    return axis, best


def _fit_bent(found: Slender, at: F64, normals: F64, rows: Int, near: Int, local: F64) -> None:
    """Find rods that bend; those that stand free are put in."""
    rows = rows[_turning(at, normals, rows, near, local)]
    some, s = np.concatenate([rows[:, None], near[rows]], axis=1), local[rows]
    step = at[some] - at[rows][:, None]
    axes = bent_axes(step, normals[some], nearness(step, s, CELLS.slender_fit), s)
    rows, step, s = rows[axes.row], step[axes.row], s[axes.row]
    weight, radius, on = nearness(step, s, CELLS.slender_wide), axes.radius, axes.on
    along, off = axes.at[..., 0], axes.at[..., 1:]
    flat = axes.normals[..., 1:]
    flat = flat / np.maximum(np.linalg.norm(flat, axis=2, keepdims=True), 1e-30)
    good = (on.sum(axis=1) >= CELLS.slender_fewest_bent) & (radius < CELLS.slender_thickest * s)
    good &= _stands_free(on, along, off - axes.beside(along), flat, weight, radius, s)
    good &= np.linalg.norm(axes.bend, axis=1) * s > CELLS.slender_bent
    way = np.einsum("rij,rj->ri", axes.frame, np.pad(axes.slope, ((0, 0), (1, 0)), constant_values=1.0))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    middle = np.einsum("rij,rj->ri", axes.frame[:, :, 1:], axes.middle)
    middle -= (middle * way).sum(axis=1, keepdims=True) * way
    bend = np.einsum("rij,rj->ri", axes.frame[:, :, 1:], axes.bend)
    found._take(rows[good], way[good], middle[good], bend[good], radius[good])


def _stands_free(on: Bool, along: F64, off: F64, flat: F64, weight: F64, radius: F64, s: F64) -> Bool:
    """(R,) whether discs tell of a rod that stands free.

    Args:
        on: (R, K) which neighbours lie on its sides; the first is the disc itself.
        along: (R, K) where along the axis they are.
        off: (R, K, 2) where they are across it.
        flat: (R, K, 2) their unit normals across it.
        weight: (R, K) of them.
        radius: (R,) the rod's.
        s: (R,) how far discs are from each other.
    """
    reach = np.where(on, along, 0.0)
    good = on[:, 0] & (reach.max(axis=1) - reach.min(axis=1) > CELLS.slender_long * radius)
    total = np.maximum((weight * on).sum(axis=1), 1e-30)
    squares = np.einsum("rk,rki,rkj->rij", weight * on, flat, flat) / total[:, None, None]
    good &= np.linalg.eigvalsh(squares)[:, 0] > CELLS.slender_turned
    close = np.linalg.norm(off, axis=2) < CELLS.slender_free[0] * s[:, None]
    close &= np.abs(along) < CELLS.slender_free[1] * s[:, None]
    good &= (weight * (close & ~on)).sum(axis=1) <= CELLS.slender_others * (weight * close).sum(axis=1)
    return np.asarray(good)


def _turning(at: F64, normals: F64, rows: Int, near: Int, local: F64) -> Bool:
    """(R,) whether normals around a disc turn as those of a rod do: most of what is asked for is a sheet that bends."""
    weight = nearness(at[near[rows]] - at[rows][:, None], local[rows], CELLS.slender_wide)
    squares = np.einsum("rk,rki,rkj->rij", weight, normals[near[rows]], normals[near[rows]])
    squares += normals[rows][:, :, None] * normals[rows][:, None]
    total = 1 + weight.sum(axis=1)
    return np.asarray(np.linalg.eigvalsh(squares)[:, 1] > CELLS.slender_hardly * total)


def _follow(found: Slender, told: Slender, at: F64, normals: F64, rows: Int, near: Int, local: F64) -> None:
    """Discs that lie on rods which others around them tell of, with the mean of what those tell."""
    some = np.concatenate([rows[:, None], near[rows]], axis=1)
    step, s, n = at[some] - at[rows][:, None], local[rows], normals[rows]
    axis, bend, r = told.axis[some], told.bend[some], told.radius[some]
    off = step + told.middle[some]  # from the disc to their axes
    along = -(off * axis).sum(axis=2, keepdims=True)
    off += along * axis + along**2 / 2 * bend
    axis = axis + along * bend
    axis /= np.maximum(np.linalg.norm(axis, axis=2, keepdims=True), 1e-30)
    far = np.linalg.norm(off, axis=2)
    aside = np.linalg.norm(np.cross(off, n[:, None]), axis=2)
    lax = CELLS.slender_astray * (r + CELLS.bent_slack * s[:, None])
    mine = told.there[some] & (np.abs(far - r) < lax) & (aside < lax)
    mine &= np.abs((axis * n[:, None]).sum(axis=2)) < CELLS.bent_upright
    weight = mine * nearness(step, s, CELLS.slender_wide)
    lead = axis[np.arange(len(rows)), weight.argmax(axis=1)]
    sign = np.where(np.einsum("rki,ri->rk", axis, lead) < 0, -1.0, 1.0)
    way = np.einsum("rk,rki->ri", weight * sign, axis)
    way /= np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-30)
    total = np.maximum(weight.sum(axis=1), 1e-30)
    middle, radius = (weight[..., None] * off).sum(axis=1) / total[:, None], (weight * r).sum(axis=1) / total
    middle -= (middle * way).sum(axis=1, keepdims=True) * way
    bend = (weight[..., None] * bend).sum(axis=1) / total[:, None]
    good = mine.sum(axis=1) >= CELLS.slender_mates
    found._take(rows[good], way[good], middle[good], bend[good], radius[good])


def frame_of(axis: F64, n: F64) -> F64:
    """(R, 3, 3) columns: across, about along a disc's normal, and the axis."""
    across = np.cross(axis, n)
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-30)
    return np.stack([across, np.cross(axis, across), axis], axis=2)


def flattened(m: F64, frame: F64) -> tuple[F64, Bool]:
    """Normals (R, K, 3) as (R, K, 2) unit across the axes of frames, and whether they lie across them."""
    flat = np.einsum("rki,rij->rkj", m, frame[:, :, :2])
    size = np.linalg.norm(flat, axis=2)
    return flat / np.maximum(size, 1e-30)[..., None], size > np.sqrt(1 - CELLS.bent_upright**2)


def beside(off: F64, m: F64) -> tuple[F64, F64]:
    """(R, K) how far beside an axis lines through points (R, K, 2) along (R, K, 2) pass, and how far out those lie."""
    return np.abs(off[..., 0] * m[..., 1] - off[..., 1] * m[..., 0]), (off * m).sum(axis=2)


def _middle(q: F64, m: F64, weight: F64) -> tuple[F64, F64]:
    """(R, 2) where lines through points (R, K, 2) along (R, K, 2) meet best, and (R,) how far off the points lie.

    Weighted least squares, in rounds: what lies off counts less (Geman and McClure's weights).
    """
    t = np.stack([-m[..., 1], m[..., 0]], axis=2)
    own, middle, radius = weight, np.zeros((len(q), 2)), np.zeros(len(q))
    for _ in range(CELLS.slender_rounds):
        square = np.einsum("rk,rki,rkj->rij", own, t, t)
        square += 1e-6 * np.trace(square, axis1=1, axis2=2)[:, None, None] * np.eye(2) + 1e-30 * np.eye(2)
        middle = np.linalg.solve(square, np.einsum("rk,rki,rk->ri", own, t, (t * q).sum(axis=2))[..., None])[..., 0]
        aside, out = beside(q - middle[:, None], m)
        radius = (own * np.abs(out)).sum(axis=1) / np.maximum(own.sum(axis=1), 1e-30)
        off = (aside**2 + (np.abs(out) - radius[:, None]) ** 2) / np.maximum(
            CELLS.slender_off * radius[:, None], 1e-30
        ) ** 2
        own = weight / (1 + off) ** 2
    return middle, radius
