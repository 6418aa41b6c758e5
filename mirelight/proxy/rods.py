"""Rods: bars and twigs so thin that the discs on them are wider than they are.

Normals of the discs around a bar lie across its axis and turn about it, and their middles lie close to it. So the axis
is known from them, and how far out the bar's sides are from their planes. Cells of such discs would stick out past the
bar, and leave gaps where no camera saw it; a prism about the axis does neither. It is square, or has eight sides where
a rod is so slender that few discs tell of it (`slender`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirelight.model import F64
from mirelight.proxy.cell_tuning import CELLS
from mirelight.proxy.slender import Slender, beside, flattened, frame_of, nearness, slender_of
from mirelight.proxy.types import Int, Soup

_CHUNK = 100_000  # discs looked at at once


@dataclass(frozen=True, slots=True, eq=False)
class Rods:
    """Discs that lie on rods, and what they tell of them."""

    rows: Int  # (M,) which discs
    axis: F64  # (M, 3) unit
    across: F64  # (M, 3) unit, in the disc's plane
    normal: F64  # (M, 3) axis x across, about along the disc's normal
    middle: F64  # (M, 3) from the disc's middle straight to the axis
    ring: F64  # (M, SIDES, 2) corners around the axis, across and along the normal, turning from the one to the other
    ahead: F64  # (M, 2) either way along the axis from the disc's middle, how far others carry the rod on; 0: none does

    def where(self, chosen: NDArray[np.bool_]) -> Rods:
        """The M rods that are chosen, of a mask (N,)."""
        return Rods(*(getattr(self, x)[chosen] for x in Rods.__slots__))

    def beside(self, other: Rods) -> Rods:
        """Both, the discs in their order."""
        both = Rods(*(np.concatenate([getattr(self, x), getattr(other, x)]) for x in Rods.__slots__))
        order = np.argsort(both.rows, kind="stable")
        return Rods(*(getattr(both, x)[order] for x in Rods.__slots__))

    def prisms(self, at: F64, low: F64, high: F64) -> Soup:
        """Sides about each axis, fronts outwards, open at both ends.

        Args:
            at: (M, 3) middles of the discs.
            low: (M,) where the prism begins along the axis, from the disc's middle, if no other carries the rod on.
            high: (M,) and where it ends.
        """
        behind, ahead = self.ahead.T
        low, high = np.where(behind > 0, -behind, low), np.where(ahead > 0, ahead, high)
        there = np.flatnonzero(np.isfinite(low) & np.isfinite(high) & (high > low))
        plane = np.stack([self.across[there], self.normal[there]], axis=1)
        ring = np.einsum("mkj,mji->mki", self.ring[there], plane) + (at + self.middle)[there][:, None]
        ends = np.stack([low, high], axis=1)[there]
        corners = ring[:, None] + (ends[..., None] * self.axis[there][:, None])[:, :, None]
        k = np.arange(CELLS.rod_sides)
        after = (k + 1) % CELLS.rod_sides
        own = np.concatenate(
            [
                np.stack([k, after, after + CELLS.rod_sides], axis=1),
                np.stack([k, after + CELLS.rod_sides, k + CELLS.rod_sides], axis=1),
            ]
        )
        faces = 2 * CELLS.rod_sides * np.arange(len(there))[:, None, None] + own
        return Soup(corners.reshape(-1, 3), faces.reshape(-1, 3))


def rods_of(at: F64, normals: F64, near: Int, local: F64, flats: F64) -> Rods:
    """Which discs lie on rods: those that look so, where most of what is around them does.

    Args:
        at: (N, 3) middles of discs.
        normals: (N, 3) unit, of either sign.
        near: (N, K) their neighbours.
        local: (N,) their distance from each other there.
        flats: (F, 3) middles of discs in the midst of planes, where others may stand for them.
    """
    parts = [
        _looking_so(at, normals, np.arange(k, min(k + _CHUNK, len(at))), near, local) for k in range(0, len(at), _CHUNK)
    ]
    found = Rods(*(np.concatenate([getattr(part, x) for part in parts]) for x in Rods.__slots__))
    looks = np.zeros(len(at), bool)
    looks[found.rows] = True
    some = near[found.rows]
    weight = nearness(at[some] - at[found.rows][:, None], local[found.rows], CELLS.rod_near)
    agreed = (weight * looks[some]).sum(axis=1) >= CELLS.rod_agreed * weight.sum(axis=1)
    slender = slender_of(at, normals, near, local, flats)
    bars = found.where(agreed & ~slender.there[found.rows])
    return bars.beside(_shaped(slender, at, normals, near, local))


def _looking_so(at: F64, normals: F64, rows: Int, near: Int, local: F64) -> Rods:
    some = np.concatenate([rows[:, None], near[rows]], axis=1)
    weight = nearness(at[some] - at[rows][:, None], local[rows], CELLS.rod_near)
    weight /= weight.sum(axis=1, keepdims=True)
    # squares of normals off a disc's own bound what they can have on either side of an axis
    level = (weight * np.einsum("rki,ri->rk", normals[some], normals[rows]) ** 2).sum(axis=1)
    asked = np.flatnonzero(1 - level > CELLS.rod_turned)
    rows, weight, some = rows[asked], weight[asked], some[asked]
    step, m, n = at[some] - at[rows][:, None], normals[some], normals[rows]
    squares, vectors = np.linalg.eigh(np.einsum("rk,rki,rkj->rij", weight, m, m))
    axis = vectors[:, :, 0]
    there = (
        (squares[:, 0] < CELLS.rod_along_axis)
        & (squares[:, 1] > CELLS.rod_turned)
        & (np.abs((axis * n).sum(axis=1)) < CELLS.rod_upright)
    )
    across = np.cross(axis, n)
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-30)
    axis = np.cross(n, across)
    along = np.einsum("rki,ri->rk", step, axis)
    aside = np.abs(np.einsum("rki,ri->rk", step, across))
    rise = np.abs(np.einsum("rki,ri->rk", step, n))
    same = np.abs(np.einsum("rki,ri->rk", m, n)) > CELLS.rod_sheet
    wide = same & (aside > np.abs(along)) & (aside > 2 * rise) & (aside < CELLS.rod_beside * local[rows][:, None])
    there &= ~wide.any(axis=1)
    off = step - along[..., None] * axis[:, None]
    middle = (weight[..., None] * off).sum(axis=1)
    off -= middle[:, None]
    squared = (off**2).sum(axis=2)
    spread = (weight * squared).sum(axis=1)
    mean = (weight * along).sum(axis=1)
    there &= spread < CELLS.rod_round**2 * (weight * (along - mean[:, None]) ** 2).sum(axis=1)
    heard = (squared < CELLS.rod_stray**2 * spread[:, None]) & (
        weight > CELLS.rod_heard * weight.max(axis=1, keepdims=True)
    )
    half = np.zeros((len(rows), 2))
    for k, way in enumerate((across, n)):
        facing = heard & (np.abs(np.einsum("rki,ri->rk", m, way)) > CELLS.rod_facing)
        at_way = np.einsum("rki,ri->rk", step, way)
        low, high = np.where(facing, at_way, np.inf).min(axis=1), np.where(facing, at_way, -np.inf).max(axis=1)
        both = np.flatnonzero(facing.any(axis=1) & (high > low))  # else one side was seen, or none
        low, high = low[both], high[both]
        half[both, k] = (high - low) / 2
        now = (middle[both] * way[both]).sum(axis=1)
        middle[both] += ((high + low) / 2 - now)[:, None] * way[both]
    half = np.where(half > CELLS.rod_one_sided * half[:, ::-1], half, half[:, ::-1])
    turn = np.arange(CELLS.rod_sides) * (2 * np.pi / CELLS.rod_sides)
    ring = half[:, None] * np.round(np.stack([np.cos(turn), np.sin(turn)], axis=1))
    return Rods(rows, -axis, across, n, middle, ring, np.zeros_like(half)).where(there & (half > 0).all(axis=1))


def _shaped(found: Slender, at: F64, normals: F64, near: Int, local: F64) -> Rods:
    """Slender rods as wide as the planes of the discs on them say together."""
    rows = np.flatnonzero(found.there)
    some = np.concatenate([rows[:, None], near[rows]], axis=1)
    n, s, r = normals[rows], local[rows], found.radius[rows]
    frame = frame_of(found.axis[rows], n)
    step = at[some] - at[rows][:, None]
    own = np.einsum("ri,rij->rj", found.middle[rows], frame)[:, :2]
    q = np.einsum("rki,rij->rkj", step, frame)
    along = q[..., 2]
    step = step - along[..., None] ** 2 / 2 * found.bend[rows][:, None]  # as if the axis did not bend
    q, theirs = (np.einsum("rki,rij->rkj", x, frame)[..., :2] for x in (step, step + found.middle[some]))
    mate = found.there[some] & (np.linalg.norm(theirs - own[:, None], axis=2) < r[:, None])
    weight = mate * nearness(step, s, CELLS.slender_wide)
    total = weight.sum(axis=1, keepdims=True)
    weight /= np.maximum(total, 1e-30)
    middle = (weight[..., None] * theirs).sum(axis=1)
    m, _ = flattened(normals[some], frame)
    _, out = beside(q - middle[:, None], m)
    m, out = m * np.where(out < 0, -1.0, 1.0)[..., None], np.abs(out)
    mean = (weight * out).sum(axis=1)
    far, turn = np.empty((len(rows), CELLS.rod_sides)), np.arange(CELLS.rod_sides) * (2 * np.pi / CELLS.rod_sides)
    way = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    for k in range(CELLS.rod_sides):
        facing = m @ way[k]
        share = weight * np.where(facing > CELLS.rod_faces, facing, 0.0) ** CELLS.rod_sharp
        seen = share.sum(axis=1)
        plane = (share * out / np.maximum(facing, CELLS.rod_faces)).sum(axis=1) / np.maximum(seen, 1e-30)
        far[:, k] = np.where(seen > 1e-9, plane, np.nan)
    far = np.where(np.isnan(far), np.roll(far, CELLS.rod_sides // 2, axis=1), far)  # seen from one side alone
    far = np.where(np.isnan(far), mean[:, None], far)
    ahead = np.empty((len(rows), 2))
    for k, side in enumerate((-1.0, 1.0)):
        next_ = np.where(mate & (side * along > CELLS.rod_ahead * s[:, None]), side * along, np.inf).min(axis=1)
        ahead[:, k] = np.where(np.isfinite(next_), np.minimum(CELLS.rod_half_way * next_, s), 0.0)
    across = np.einsum("rij,rj->ri", frame[:, :, :2], middle)
    made = Rods(rows, frame[:, :, 2], frame[:, :, 0], frame[:, :, 1], across, far[..., None] * way, ahead)
    return made.where(total[:, 0] > 0)  # not where discs are far apart for their size
