"""The axis of a slender rod near a disc, which may bend: a ring, a hoop, a handle.

The normal of a disc on a rod leads to the axis, one radius from the disc. So discs of one rod, moved by its radius
along their normals to the one side or the other, lie on a curve. Ways and depths of the axis are tried at a disc, and
the best becomes a parabola by weighted least squares with the radius as one of the unknowns, in rounds in which what
lies off counts less (Geman and McClure's weights).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from mirelight.model import F64
from mirelight.proxy.cell_tuning import CELLS

Bool = NDArray[np.bool_]
Int = NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class Axes:
    """A parabola for each of R discs, and what its K neighbours have to do with it; the first is the disc itself."""

    row: Int  # (R,) of the discs that were asked for
    frame: F64  # (R, 3, 3) columns: a way along the axis, across, the disc's normal
    middle: F64  # (R, 2) where the axis is beside the disc, across and along the normal
    slope: F64  # (R, 2) of the axis there, per length along the way
    bend: F64  # (R, 2) change of the slope per length
    radius: F64  # (R,)
    at: F64  # (R, K, 3) discs in the frame
    normals: F64  # (R, K, 3) theirs
    on: Bool  # (R, K) whether they lie on the rod's sides

    def beside(self, along: F64) -> F64:
        """(R, K, 2) where the axis is at (R, K)."""
        return _parabola(np.stack([self.middle, self.slope, self.bend], axis=1), along)


def bent_axes(step: F64, normals: F64, weight: F64, local: F64) -> Axes:
    """The best for each disc about which enough of its neighbours agree; whether it is a rod, its caller decides.

    Args:
        step: (R, K, 3) from a disc to itself and its neighbours.
        normals: (R, K, 3) unit, of either sign.
        weight: (R, K) of them.
        local: (R,) how far they are from each other.
    """
    helper = np.eye(3)[np.abs(normals[:, 0]).argmin(axis=1)]
    u = np.cross(normals[:, 0], helper)
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    plane = np.stack([u, np.cross(normals[:, 0], u), normals[:, 0]], axis=2)
    s = local[:, None]
    p, q = (np.einsum("rki,rij->rkj", x, plane) / y for x, y in ((step, s[..., None]), (normals, 1.0)))
    angle, depth, score = _tried(p, q, weight)
    row = np.flatnonzero(score >= CELLS.bent_agreeing * weight.sum(axis=1))
    p, q, s, plane, weight, angle, depth = (x[row] for x in (p, q, s, plane, weight, angle, depth))
    cos, sin, zero = np.cos(angle), np.sin(angle), np.zeros_like(angle)
    turn = np.stack([np.stack([cos, -sin, zero], 1), np.stack([sin, cos, zero], 1), np.eye(3)[2] + 0 * s], axis=1)
    p, q = (np.einsum("rki,rij->rkj", x, turn) for x in (p, q))
    curve, radius, on = _fitted(p, q, weight, depth)
    powers = (s / s ** np.arange(3))[..., None]  # from local spacings
    middle, slope, bend = (curve * powers).transpose(1, 0, 2)
    frame = np.einsum("rij,rjk->rik", plane, turn)
    return Axes(row, frame, middle, slope, bend, radius * s[:, 0], p * s[..., None], q, on)


def _parabola(curve: F64, along: F64) -> F64:
    t = along[..., None]
    middle, slope, bend = (curve[:, None, k] for k in range(3))
    return np.asarray(middle + slope * t + bend * t**2 / 2)


def _tried(p: F64, q: F64, weight: F64) -> tuple[F64, F64, F64]:
    """(R,) angle of the best way in the disc's plane, (R,) depth of the axis under it, below 0 over it, and (R,) weight
    of the neighbours that lie about it."""
    best, angle, depth = (np.zeros(len(p)) for _ in range(3))
    for r, side in product(CELLS.bent_depths, (1.0, -1.0)):
        moved = [p + x * r * q - (0, 0, side * r) for x in (1.0, -1.0)]
        for a in np.arange(CELLS.bent_ways) * (np.pi / CELLS.bent_ways):
            way, across = np.array([np.cos(a), np.sin(a)]), np.array([-np.sin(a), np.cos(a)])
            near = np.zeros(weight.shape, bool)
            for x in moved:
                t = np.abs(x[..., :2] @ way)
                off = (x[..., :2] @ across) ** 2 + x[..., 2] ** 2
                turned = np.abs(q[..., :2] @ way) < CELLS.bent_turn + t / CELLS.bent_tightest
                near |= (
                    (off < (CELLS.bent_lax + t**2 / (2 * CELLS.bent_tightest)) ** 2) & turned & (t < CELLS.bent_reach)
                )
            score = (weight * near).sum(axis=1)
            better = score > best
            best[better], angle[better], depth[better] = score[better], a, side * r
    return angle, depth, best


def _fitted(p: F64, q: F64, weight: F64, depth: F64) -> tuple[F64, F64, Bool]:
    """(R, 3, 2) middle, slope and bend, (R,) radius and (R, K) which discs lie on the sides, in local spacings."""
    curve, r = np.zeros((len(p), 3, 2)), np.abs(depth)
    curve[:, 0, 1] = depth
    for k in range(CELLS.bent_rounds):
        t, side, squared, upright = _apart(p, q, curve, r)
        off, lean = CELLS.bent_off * r[:, None] + CELLS.bent_slack, np.full_like(t, CELLS.bent_upright)
        if not k:  # the tried axis does not bend
            off, lean = 2 * off + t**2 / (4 * CELLS.bent_tightest), CELLS.bent_turn + np.abs(t) / CELLS.bent_tightest
        own = weight * ((upright < lean) & (np.abs(t) < CELLS.bent_reach)) / (1 + squared / off**2) ** 2
        row = np.zeros((*p.shape[:2], 2, 7))
        for i in (0, 1):
            row[:, :, i, i], row[:, :, i, 2 + i], row[:, :, i, 4 + i] = 1, t, t**2 / 2
            row[:, :, i, 6] = -side * q[..., 1 + i]
        square = np.einsum("rk,rkai,rkaj->rij", own, row, row)
        square += np.diag(CELLS.bent_damping) * np.maximum(own.sum(axis=1), 1e-9)[:, None, None]
        found = np.linalg.solve(square, np.einsum("rk,rkai,rka->ri", own, row, p[..., 1:])[..., None])[..., 0]
        curve, r = found[:, :6].reshape(-1, 3, 2), np.abs(found[:, 6])
    t, _, squared, upright = _apart(p, q, curve, r)
    on = (
        (squared < (CELLS.bent_off * r[:, None] + CELLS.bent_slack) ** 2)
        & (upright < CELLS.bent_upright)
        & (np.abs(t) < CELLS.bent_reach)
    )
    return curve, r, on


def _apart(p: F64, q: F64, curve: F64, r: F64) -> tuple[F64, F64, F64, F64]:
    """Of discs moved by a radius: (R, K) where along the axis they are, to which side they were moved to be nearer to
    it, the square of how far they are, and the cosine of their normals with it."""
    both = []
    for side in (1.0, -1.0):
        moved = p + side * r[:, None, None] * q
        t = moved[..., 0]
        both.append((t, ((moved[..., 1:] - _parabola(curve, t)) ** 2).sum(axis=2)))
    (t, squared), (t_other, squared_other) = both
    first = squared < squared_other
    t = np.where(first, t, t_other)
    way = curve[:, None, 1] + curve[:, None, 2] * t[..., None]
    upright = np.abs(q[..., 0] + (way * q[..., 1:]).sum(axis=2)) / np.sqrt(1 + (way**2).sum(axis=2))
    return t, np.where(first, 1.0, -1.0), np.where(first, squared, squared_other), upright
