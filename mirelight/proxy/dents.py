"""What most views say of a plane counts for all: a dent that few of them see in a table is none.

Dark and polished tops are fuzzy, and splats that show what they reflect lie a little below them. Looked at from above
that is a dent, from aslant it is the plane; where both are fused islands and holes are left of it, about the feet of
whatever stands there.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirelight.base.together import each
from mirelight.model import F64
from mirelight.proxy.depth import DepthMap
from mirelight.proxy.flats import Flat
from mirelight.proxy.labels import Labels, depth_of
from mirelight.proxy.tuning import TUNING
from mirelight.proxy.types import Int
from mirelight.proxy.views import dot, length, rays

Bool = NDArray[np.bool_]


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

    def voted(k: int) -> list[F64]:
        return [dent.votes() for dent in _dents(views[k], labels[k], flats, tolerance)]

    lead = [np.sum(of_plane, axis=0) for of_plane in zip(*each(voted, range(len(views))), strict=True)]

    def settled(k: int) -> Labels:
        plane, sure = labels[k].plane.copy(), labels[k].sure.copy()
        for j, dent in enumerate(_dents(views[k], labels[k], flats, tolerance)):
            held = dent.behind & (lead[j][dent.cell[..., 0], dent.cell[..., 1]] > 0)
            plane[held], sure[held] = j, 1
        return Labels(plane, sure)

    return each(settled, range(len(views)))


@dataclass(frozen=True, slots=True, eq=False)
class _Dent:
    """Where a view looks at a plane."""

    cell: Int  # (H, W, 2) of the plane
    on: Bool  # (H, W) pixels that lie on it
    behind: Bool  # (H, W) those that lie on none, a little behind it
    facing: F64  # (H, W) cosine between the ray and the plane: from aslant all looks even
    shape: tuple[int, ...]  # of the plane's cells

    def votes(self) -> F64:
        """(I, J) how much the view is for cells of the plane, -1 to 1."""
        total, count = np.zeros(self.shape), np.zeros(self.shape)
        for pixels, vote in ((self.on, 1), (self.behind, -1)):
            cells = tuple(self.cell[pixels].T)
            np.add.at(total, cells, vote * self.facing[pixels])
            np.add.at(count, cells, 1)
        return np.asarray(total / np.maximum(count, 1))


def _dents(view: DepthMap, labels: Labels, flats: Sequence[Flat], tolerance: float) -> Iterator[_Dent]:
    """Of each plane."""
    origins, directions = rays(view.camera)
    for k, flat in enumerate(flats):
        depth = depth_of(view, flat, directions)
        at = origins + directions * depth[..., None]
        slope = np.abs(dot(directions, flat.normal))
        there = (depth > 0) & (view.depth > 0) & flat.within(at)
        off = (view.depth - depth) * slope / tolerance
        behind = there & (labels.plane == len(flats)) & (off > 0) & (off < TUNING.label_dent)
        yield _Dent(
            flat.cells(at)[0], there & (labels.plane == k), behind, slope / length(directions), flat.there.shape
        )
