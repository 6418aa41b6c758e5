"""Points that views see, and which of them on a plane are a surface of it: others are slices of what is round.

Through a bush, a body or a beard many planes go that hold as many points as a table does.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirelight.model import F64
from mirelight.proxy.depth import DepthMap, points_of
from mirelight.proxy.tuning import TUNING
from mirelight.proxy.types import Int
from mirelight.proxy.views import dot, length

Bool = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Points:
    """Points on surfaces that cameras saw."""

    at: F64  # (N, 3)
    normal: F64  # (N, 3) unit, to the side that was seen
    weight: F64  # (N,) 0..1: trust in those that were joined, and how far their normals agree

    @staticmethod
    def of(views: Sequence[DepthMap], spacing: float, radius: float) -> Points:
        """What views see within the radius, one point a voxel."""
        at, normal, weight = [], [], []
        for view in views:
            here, facing, trust = points_of(view, TUNING.flat_step)
            at.append(here)
            normal.append(facing)
            weight.append(trust.astype(np.float64) + 1e-3)
        points, normals, weights = np.concatenate(at), np.concatenate(normal), np.concatenate(weight)
        near = dot(points, points) < radius * radius
        points, normals, weights = points[near], normals[near], weights[near]
        i = np.floor(points / (TUNING.flat_voxel * spacing)).astype(np.int64) + (1 << 20)
        _, index, count = np.unique(
            (i[:, 0] << 42) | (i[:, 1] << 21) | i[:, 2], return_inverse=True, return_counts=True
        )
        total = np.bincount(index, weights)

        def mean(rows: F64) -> F64:
            return np.stack([np.bincount(index, rows[:, k] * weights) for k in range(3)], axis=1) / total[:, None]

        turned_to = mean(normals)
        agreed = length(turned_to)
        return Points(
            mean(points),
            turned_to / np.maximum(agreed, 1e-12)[:, None],
            agreed * np.minimum(count / TUNING.flat_step, 1) * total / count,
        )


def surface_rows(points: Points, rows: Int, normal: F64, offset: float, tolerance: float) -> Int:
    """Of the points on a plane, rows (N,), those in pieces of it that are no slices.

    A slice has much beside it, is bent, or the surface goes on beyond it nearly all around, less and less in the plane.
    """
    off = dot(points.at, normal) - offset
    near = np.abs(off) < TUNING.plane_beside * tolerance
    piece = _pieces(points.at[rows], normal, tolerance)
    own, beside = piece(points.at[rows]), piece(points.at[near])
    held, all_ = np.bincount(own, points.weight[rows]), np.bincount(beside, points.weight[near])
    kept = held > TUNING.plane_alone * all_
    goes_on = np.abs(dot(points.normal, normal)) > TUNING.plane_goes_on
    around = np.flatnonzero((np.abs(off) < TUNING.plane_fades_to * tolerance) & goes_on)
    around = around[~np.isin(around, rows)]
    for k in np.flatnonzero(kept & (np.bincount(own, minlength=len(kept)) >= TUNING.plane_few)):
        some = rows[own == k]
        kept[k] = not (
            _is_bent(points, some, normal, tolerance) or _fades(points.at[some], points.at[around], normal, tolerance)
        )
    return np.asarray(rows[kept[own]])


def _is_bent(points: Points, rows: Int, normal: F64, tolerance: float) -> bool:
    """Whether points that lie about a plane are a slice of something round: a parabola through them differs from it by
    as much as they may lie off it, one deviation over them. A large old table sags by that much: it is far wider."""
    place = turned_to(points.at[rows], axes_of(normal))
    place = place - place.mean(axis=0)
    along = max(float(place.std()), 1e-300)  # a quarter of a disc's width
    x, y = place.T / along
    basis = np.stack([np.ones(len(x)), x, y, x * x, x * y, y * y], axis=1)
    weight = np.sqrt(points.weight[rows])[:, None]
    found = np.linalg.lstsq(weight * basis, weight[:, 0] * dot(points.at[rows], normal), rcond=None)[0]
    most = max(TUNING.plane_bent * tolerance, TUNING.plane_sags * 4 * along)
    return float((basis[:, 3:] @ found[3:]).std()) > most


def _fades(piece: F64, around: F64, normal: F64, tolerance: float) -> bool:
    """Whether a small piece of a plane, points (N, 3), has at nearly all of its rim some of what is around, (M, 3)."""
    from scipy.ndimage import binary_closing, binary_dilation

    axes, cell = axes_of(normal), TUNING.plane_cell * tolerance
    i, other = (np.floor(turned_to(x, axes) / cell).astype(np.int64) for x in (piece, around))
    low = i.min(axis=0) - 2
    own, there = np.zeros((2, *(i.max(axis=0) + 3 - low)), bool)
    own[tuple((i - low).T)] = True
    own = binary_closing(own)
    if own.sum() >= TUNING.plane_large:
        return False
    other = other[((other >= low) & (other < low + own.shape)).all(axis=1)] - low
    there[tuple(other.T)] = True
    rim = binary_dilation(own, np.ones((3, 3), bool)) & ~own
    return bool(there[rim].mean() > TUNING.plane_fades)


def one_piece(points: Points, rows: Int, normal: F64, tolerance: float) -> Bool:
    """(N,) which of these points of a plane are in its largest piece."""
    if not len(rows):
        return np.zeros(0, bool)
    own = _pieces(points.at[rows], normal, tolerance)(points.at[rows])
    return np.asarray(own == np.bincount(own, points.weight[rows]).argmax())


def _pieces(points: F64, normal: F64, tolerance: float) -> Callable[[F64], Int]:
    """Tells over which piece of a plane, from 1, points (M, 3) lie, 0: none; it is cells that hold points (N, 3), small
    gaps closed."""
    from scipy.ndimage import binary_closing, label

    axes = axes_of(normal)

    def cells(some: F64) -> Int:
        return np.floor(turned_to(some, axes) / (TUNING.plane_cell * tolerance)).astype(np.int64)

    i = cells(points)
    low = i.min(axis=0) - 1  # a rim that is in no piece
    there = np.zeros(tuple(i.max(axis=0) + 2 - low), bool)
    there[tuple((i - low).T)] = True
    part, _ = label(binary_closing(there))
    return lambda some: part[tuple(np.clip(cells(some) - low, 0, np.array(part.shape) - 1).T)]


def axes_of(normal: F64) -> F64:
    """(2, 3) unit vectors across it."""
    first = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(normal, first)])


def turned_to(points: F64, axes: F64) -> F64:
    """(N, 2) places of points (N, 3) along two axes."""
    return np.asarray(np.einsum("ni,ki->nk", points, axes))
