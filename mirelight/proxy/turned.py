"""Discs that training has turned out of their surface; they lie on it all the same, so their neighbours tell its plane.

A picture hardly shows how a small disc is turned, so an optimiser turns discs by ten degrees and more, and moves them
by less than a tenth of their spacing. Cells of such discs would be shingles. Where most are turned, each gets the plane
of weighted least squares through its neighbours, in rounds in which what lies off it weighs less (Geman and McClure's
weights): what lies beyond a crease, or on another level, soon does not count.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mirelight.model import F64
from mirelight.proxy.cell_tuning import CELLS
from mirelight.proxy.discs import Discs, neighbours_of
from mirelight.proxy.types import Int

_CHUNK = 100_000  # discs looked at at once: memory alone


def righted(discs: Discs, near: Int, local: F64) -> Discs:
    """The discs, turned and moved into their neighbours' planes where most are turned out of them, else as they are.

    Args:
        discs: (N,) on a surface, about.
        near: (N, K) their neighbours.
        local: (N,) their distance from each other there.
    """
    some = np.arange(0, len(discs.at), max(len(discs.at) // CELLS.turned_sample, 1))
    plane, _ = _planes(discs, discs.normal, some, near, local, 0)
    cosine = np.abs((plane * discs.normal[some]).sum(axis=1))
    if np.degrees(np.arccos(np.minimum(np.median(cosine), 1))) < CELLS.turned_least:
        return discs
    normals, over = discs.normal, np.zeros(len(discs.at))
    for k in range(len(CELLS.turned_off)):
        now = normals.copy()
        for first in range(0, len(normals), _CHUNK):
            rows = np.arange(first, min(first + _CHUNK, len(normals)))
            now[rows], over[rows] = _planes(discs, normals, rows, near, local, k)
        normals = now
    return replace(discs, at=discs.at + over[:, None] * normals, axes=_turned_to(discs.axes, normals))


def neighbourhoods(points: F64) -> tuple[Int, F64, F64]:
    """(N, K) neighbours, (N, K) how far they are, and (N,) how far points are from each other there."""
    near, distance = neighbours_of(points, CELLS.cell_neighbours)
    return near, distance, distance[:, 5] / 1.8


def _planes(discs: Discs, normals: F64, rows: Int, near: Int, local: F64, k: int) -> tuple[F64, F64]:
    """(R, 3) normals of the planes through discs (R,) and their neighbours, and (R,) how far those are over the discs;
    `normals` (N, 3) are those of round `k`, of either sign."""
    n, m = normals[rows], normals[near[rows]]
    step = (discs.at[near[rows]] - discs.at[rows][:, None]) / local[rows][:, None, None]
    weight = np.exp(-0.5 * (step**2).sum(axis=2) / CELLS.turned_wide**2)
    for off in (np.einsum("rki,ri->rk", step, n), (step * m).sum(axis=2)):
        weight /= (1 + (off / CELLS.turned_off[k]) ** 2) ** 2
    weight /= (1 + (1 - np.einsum("rki,ri->rk", m, n) ** 2) / CELLS.turned_sine[k] ** 2) ** 2
    total = weight.sum(axis=1)[:, None] + 1  # with the disc itself
    mean = np.einsum("rk,rki->ri", weight, step) / total
    square = np.einsum("rk,rki,rkj->rij", weight, step, step) - total[..., None] * mean[:, :, None] * mean[:, None]
    own = discs.normal[rows]
    told = np.einsum("rk,rki,rkj->rij", weight, m, m) + own[:, :, None] * own[:, None]
    plane = np.linalg.eigh(square - CELLS.turned_own**2 * told)[1][:, :, 0]
    plane *= np.where((plane * n).sum(axis=1) < 0, -1.0, 1.0)[:, None]
    return plane, (mean * plane).sum(axis=1) * local[rows]


def _turned_to(axes: F64, normals: F64) -> F64:
    """Axes (N, 3, 3) turned the shortest way so that the first is a normal (N, 3), each less than a right angle off."""
    first = axes[:, :, 0]
    about, cosine = np.cross(first, normals), (first * normals).sum(axis=1)
    out = np.empty_like(axes)
    for k in range(3):
        once = np.cross(about, axes[:, :, k])
        out[:, :, k] = axes[:, :, k] + once + np.cross(about, once) / (1 + cosine)[:, None]  # Rodrigues' formula
    return out
