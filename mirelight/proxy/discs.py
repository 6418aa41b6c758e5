"""Discs of a surfel capture, and their neighbours as they see them in their planes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirelight.model import F64
from mirelight.proxy.cell_tuning import CELLS
from mirelight.proxy.types import Int


@dataclass(frozen=True, slots=True, eq=False)
class Discs:
    """Flat discs that stand for splats."""

    at: F64  # (N, 3) their middles
    axes: F64  # (N, 3, 3) columns: normal, then along the disc
    scales: F64  # (N, 3) standard deviations, thinnest first
    spacing: float  # of the capture

    @property
    def normal(self) -> F64:
        """(N, 3) unit, of either sign."""
        return self.axes[:, :, 0]

    def where(self, chosen: Int) -> Discs:
        """The discs of some rows (N,) alone."""
        return Discs(self.at[chosen], self.axes[chosen], self.scales[chosen], self.spacing)


def neighbours_of(points: F64, count: int) -> tuple[Int, F64]:
    """(N, count) nearest other points, nearest first, and how far they are."""
    from scipy.spatial import cKDTree

    distance, index = cKDTree(points).query(points, k=min(count + 1, len(points)), workers=-1)
    return index[:, 1:].astype(np.int64), distance[:, 1:]


@dataclass(frozen=True, slots=True, eq=False)
class Around:
    """Neighbours (R, K) as discs (R) see them in their planes."""

    step: F64  # (R, K, 3)
    along: F64  # (R, K, 2) the step in the plane
    run: F64  # (R, K) its length
    same: NDArray[np.bool_]  # (R, K) normals alike
    on_sheet: NDArray[np.bool_]  # (R, K) and on the same surface

    @staticmethod
    def of(discs: Discs, rows: Int, near: Int) -> Around:
        """Of discs (R,) and their neighbours (R, K).

        Two points of a round surface lie on one level along the mean of their normals; a step lies across it.
        """
        n, m = discs.normal[rows], discs.normal[near]
        step = discs.at[near] - discs.at[rows][:, None]
        along = np.einsum("rki,rij->rkj", step, discs.axes[rows][:, :, 1:])
        run = np.linalg.norm(along, axis=2)
        cosine = np.einsum("rki,ri->rk", m, n)
        same = np.abs(cosine) > CELLS.disc_same_plane
        over = np.einsum("rki,ri->rk", step, n) + np.where(cosine < 0, -1.0, 1.0) * np.einsum("rki,rki->rk", step, m)
        rise = np.abs(over) / np.sqrt(2 + 2 * np.abs(cosine))
        return Around(step, along, run, same, same & (rise < CELLS.disc_steep * run + CELLS.disc_level * discs.spacing))
