"""Rods: bars and twigs so thin that the discs on them are wider than they are.

Normals of the discs around a bar lie across its axis and turn about it, and their middles lie close to it. So the axis
is known from them, and how far out the bar's sides are from their planes. Cells of such discs would stick out past the
bar, and leave gaps where no camera saw it; a square prism about the axis does neither.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirelight.model import F64
from mirelight.proxy.types import Int, Soup

NEAR = 0.6  # local spacings: standard deviation of the weights by which neighbours tell the axis
ALONG_AXIS = 0.06  # share of the normals' squares that may lie along the axis
TURNED = 0.12  # share that must lie across it on either side, or the discs are those of a sheet
ROUND = 0.8  # of the discs' spread along the axis: how far from it they may lie
UPRIGHT = 0.3  # cosine between a disc's normal and the axis, above which it closes the rod's end
FACING = 0.7  # cosine, from which a neighbour's plane tells how far out a side is
HEARD = 0.02  # of the largest weight: neighbours below it do not
SHEET = 0.8  # cosine between normals of discs of one side
BESIDE = 1.5  # local spacings: a disc of the same side that near across the axis means that it is no bar
AGREED = 0.6  # of what is around a disc on a rod: how much must be on one, too
ONE_SIDED = 0.2  # of a rod's width: it is no flatter, but was seen from one side alone, and is as deep as wide
STRAY = 3.0  # times the discs' distance from the axis: neighbours farther off lie on something else
_CHUNK = 100_000  # discs looked at at once


@dataclass(frozen=True, slots=True, eq=False)
class Rods:
    """Discs that lie on rods, and what they tell of them."""

    rows: Int  # (M,) which discs
    axis: F64  # (M, 3) unit, in the disc's plane
    across: F64  # (M, 3) unit, in the disc's plane
    normal: F64  # (M, 3) across x axis, along the disc's normal
    middle: F64  # (M, 3) from the disc's middle straight to the axis
    half: F64  # (M, 2) half the rod's width across and along the normal

    def where(self, chosen: NDArray[np.bool_]) -> Rods:
        """Some of them (M,)."""
        return Rods(*(getattr(self, x)[chosen] for x in Rods.__slots__))

    def prisms(self, at: F64, low: F64, high: F64) -> Soup:
        """Four sides about each axis, fronts outwards, open at both ends.

        Args:
            at: (M, 3) middles of the discs.
            low: (M,) where the prism begins along the axis, from the disc's middle.
            high: (M,) and where it ends.
        """
        there = np.flatnonzero(high > low)
        ends = np.stack([low, high], axis=1)[there]
        side = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)])[None, None] * self.half[there][:, None, None]
        ring = side[..., :1] * self.across[there][:, None, None] + side[..., 1:] * self.normal[there][:, None, None]
        corners = (
            (at + self.middle)[there][:, None, None] + ring + (ends[..., None] * self.axis[there][:, None])[:, :, None]
        )
        k = np.arange(4)
        after = (k + 1) % 4
        own = np.concatenate([np.stack([k, after + 4, after], axis=1), np.stack([k, k + 4, after + 4], axis=1)])
        faces = 8 * np.arange(len(there))[:, None, None] + own
        return Soup(corners.reshape(-1, 3), faces.reshape(-1, 3))


def rods_of(at: F64, normals: F64, near: Int, local: F64) -> Rods:
    """Which discs lie on rods: those that look so, where most of what is around them does.

    Args:
        at: (N, 3) middles of discs.
        normals: (N, 3) unit, of either sign.
        near: (N, K) their neighbours.
        local: (N,) their distance from each other there.
    """
    parts = [
        _looking_so(at, normals, np.arange(k, min(k + _CHUNK, len(at))), near, local) for k in range(0, len(at), _CHUNK)
    ]
    found = Rods(*(np.concatenate([getattr(part, x) for part in parts]) for x in Rods.__slots__))
    looks = np.zeros(len(at), bool)
    looks[found.rows] = True
    some = near[found.rows]
    weight = _weights(at[some] - at[found.rows][:, None], local[found.rows])
    agreed = (weight * looks[some]).sum(axis=1) >= AGREED * weight.sum(axis=1)
    return found.where(agreed)


def _weights(step: F64, local: F64) -> F64:
    return np.asarray(np.exp(-0.5 * (step**2).sum(axis=2) / (NEAR * local[:, None]) ** 2))


def _looking_so(at: F64, normals: F64, rows: Int, near: Int, local: F64) -> Rods:
    some = np.concatenate([rows[:, None], near[rows]], axis=1)
    weight = _weights(at[some] - at[rows][:, None], local[rows])
    weight /= weight.sum(axis=1, keepdims=True)
    # squares of normals off a disc's own bound what they can have on either side of an axis
    level = (weight * np.einsum("rki,ri->rk", normals[some], normals[rows]) ** 2).sum(axis=1)
    asked = np.flatnonzero(1 - level > TURNED)
    rows, weight, some = rows[asked], weight[asked], some[asked]
    step, m, n = at[some] - at[rows][:, None], normals[some], normals[rows]
    squares, vectors = np.linalg.eigh(np.einsum("rk,rki,rkj->rij", weight, m, m))
    axis = vectors[:, :, 0]
    there = (squares[:, 0] < ALONG_AXIS) & (squares[:, 1] > TURNED) & (np.abs((axis * n).sum(axis=1)) < UPRIGHT)
    across = np.cross(axis, n)
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-30)
    axis = np.cross(n, across)
    along = np.einsum("rki,ri->rk", step, axis)
    aside = np.abs(np.einsum("rki,ri->rk", step, across))
    rise = np.abs(np.einsum("rki,ri->rk", step, n))
    same = np.abs(np.einsum("rki,ri->rk", m, n)) > SHEET
    wide = same & (aside > np.abs(along)) & (aside > 2 * rise) & (aside < BESIDE * local[rows][:, None])
    there &= ~wide.any(axis=1)
    off = step - along[..., None] * axis[:, None]
    middle = (weight[..., None] * off).sum(axis=1)
    off -= middle[:, None]
    squared = (off**2).sum(axis=2)
    spread = (weight * squared).sum(axis=1)
    mean = (weight * along).sum(axis=1)
    there &= spread < ROUND**2 * (weight * (along - mean[:, None]) ** 2).sum(axis=1)
    heard = (squared < STRAY**2 * spread[:, None]) & (weight > HEARD * weight.max(axis=1, keepdims=True))
    half = np.zeros((len(rows), 2))
    for k, way in enumerate((across, n)):
        facing = heard & (np.abs(np.einsum("rki,ri->rk", m, way)) > FACING)
        at_way = np.einsum("rki,ri->rk", step, way)
        low, high = np.where(facing, at_way, np.inf).min(axis=1), np.where(facing, at_way, -np.inf).max(axis=1)
        both = np.flatnonzero(facing.any(axis=1) & (high > low))  # else one side was seen, or none
        low, high = low[both], high[both]
        half[both, k] = (high - low) / 2
        now = (middle[both] * way[both]).sum(axis=1)
        middle[both] += ((high + low) / 2 - now)[:, None] * way[both]
    half = np.where(half > ONE_SIDED * half[:, ::-1], half, half[:, ::-1])
    return Rods(rows, axis, across, n, middle, half).where(there & (half > 0).all(axis=1))
