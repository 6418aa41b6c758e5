"""What most views say of a plane counts for all: a dent that few of them see in a table is none.

Dark and polished tops are fuzzy, and splats that show what they reflect lie a little below them. Looked at from above
that is a dent, from aslant it is the plane; where both are fused islands and holes are left of it, about the feet of
whatever stands there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mirelight.base.together import each
from mirelight.model import F64
from mirelight.proxy.depth import DepthMap
from mirelight.proxy.flats import Flat, depth_of
from mirelight.proxy.labels import Labels
from mirelight.proxy.tuning import TUNING
from mirelight.proxy.types import Int
from mirelight.proxy.views import dot, length, rays


def filled(
    views: Sequence[DepthMap], labels: Sequence[Labels], flats: Sequence[Flat], tolerance: float
) -> list[Labels]:
    """The labels, with pixels a little behind a plane put onto it where more views have those cells of it on it.

    Args:
        views: maps.
        labels: of each.
        flats: the planes that they tell of.
        tolerance: from a plane to what lies on it, world units.
    """
    lead = [np.zeros(flat.there.size) for flat in flats]
    found = each(lambda k: _dents(views[k], labels[k], flats, tolerance), range(len(views)))
    for of_view in found:
        for total, dent in zip(lead, of_view, strict=True):
            total[dent.cells] += dent.votes

    def settled(k: int) -> Labels:
        plane, sure = labels[k].plane.copy(), labels[k].sure.copy()
        for j, dent in enumerate(found[k]):
            held = dent.behind[lead[j][dent.over] > 0]
            plane.ravel()[held], sure.ravel()[held] = j, 1
        return Labels(plane, sure)

    return each(settled, range(len(views)))


@dataclass(frozen=True, slots=True, eq=False)
class _Dent:
    """What a view tells of a plane."""

    cells: Int  # (C,) those of the plane's that it sees
    votes: F64  # (C,) how much it is for them, -1 to 1
    behind: Int  # (M,) pixels that lie on no plane, a little behind this one
    over: Int  # (M,) the cells that they are seen through


def _dents(view: DepthMap, labels: Labels, flats: Sequence[Flat], tolerance: float) -> list[_Dent]:
    """Of each plane."""
    origins, directions = rays(view.camera)
    plane, away, ways = labels.plane.ravel(), view.depth.ravel(), directions.reshape(-1, 3)
    starts = np.broadcast_to(origins, directions.shape).reshape(-1, 3)
    none, out = len(flats), list[_Dent]()
    for k, flat in enumerate(flats):
        depth = depth_of(view, flat, directions).ravel()
        rows = np.flatnonzero((depth > 0) & (away > 0) & ((plane == k) | (plane == none)))
        slope = np.abs(dot(ways[rows], flat.normal))
        off = (away[rows] - depth[rows]) * slope / tolerance
        asked = (plane[rows] == k) | (off > 0) & (off < TUNING.label_dent)
        rows, slope = rows[asked], slope[asked]
        at = starts[rows] + ways[rows] * depth[rows, None]
        within = flat.within(at)
        rows, slope = rows[within], slope[within]
        i, _ = flat.cells(at[within])
        cell, behind = i[:, 0] * flat.there.shape[1] + i[:, 1], plane[rows] == none
        vote = np.where(behind, -1, 1) * slope / length(ways[rows])  # from aslant all looks even
        total, count = (np.bincount(cell, x, flat.there.size) for x in (vote, None))
        seen = np.flatnonzero(count)
        out.append(_Dent(seen, total[seen] / count[seen], rows[behind], cell[behind]))
    return out
