"""Things on a ground that are as plain as it: lacquer and smooth plastic hang as a sky does, but before what they hide.

Where something surely stands, and none sees the ground, pixels that look otherwise than the ground around show that
thing, though they do not tell how far off it is. They would be taken for the ground, or for a sky.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mirelight.base.together import each
from mirelight.model import F64
from mirelight.proxy.depth import DepthMap, sure_points
from mirelight.proxy.flats import Flat, depth_of
from mirelight.proxy.labels import Labels
from mirelight.proxy.looks import Look
from mirelight.proxy.thing_tuning import THINGS
from mirelight.proxy.tuning import TUNING
from mirelight.proxy.types import Int
from mirelight.proxy.views import dot, rays

Bool = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Things:
    """Where on a ground something stands that hides it."""

    ground: Flat
    front: float  # the side of its plane that is seen: 1 that of its normal, or -1
    height: F64  # (I, J) of its cells, world units; 0: nothing stands there, or some view surely shows the ground
    reach: F64  # (I, J) how high something of a thing may be there, as close to it as its pixels are off

    @staticmethod
    def on(ground: Flat, views: Sequence[DepthMap], spacing: float) -> Things:
        """What views surely show above a ground, small gaps closed.

        Args:
            ground: a plane.
            views: maps of a capture's own cameras.
            spacing: of the splats, world units.
        """
        eyes = np.stack([view.camera.position for view in views])
        front = float(np.sign(np.median(ground.off(eyes))))
        return Things.of(ground, front, np.concatenate(each(sure_points, views)), spacing)

    @staticmethod
    def of(ground: Flat, front: float, at: F64, spacing: float) -> Things:
        """The same by points (N, 3) that are sure, of a plane that is seen from its side `front`."""
        from scipy.ndimage import grey_dilation, grey_opening

        i, inner = ground.cells(at)
        height, top = _heights(ground, i[inner], front * ground.off(at[inner]), TUNING.plane_tolerance * spacing)
        wide = 2 * THINGS.thing_around + 1
        reach = grey_dilation(np.maximum(height, grey_opening(top, (3, 3))), (wide, wide))  # spires are no strays
        return Things(ground, front, height, THINGS.thing_over * reach)

    @property
    def hidden(self) -> Bool:
        """(I, J) the ground's cells that they hide."""
        return np.asarray(self.height > 0)

    def kept(self, pair: tuple[DepthMap, Labels], look: Look, k: int, none: int) -> tuple[DepthMap, Labels]:
        """The view and its labels with the pixels of things on no plane, and trusted as much as what is no sky.

        Args:
            pair: a view, and the labels of its pixels.
            look: the ground's.
            k: the ground's place among the planes.
            none: how many planes there are.
        """
        from scipy.ndimage import binary_closing

        view, labels = pair
        origins, directions = rays(view.camera)
        depth = depth_of(view, self.ground, directions)
        other = look.other(view.color, origins + directions * depth[..., None]) > 0
        before = (view.depth > 0) & (view.depth < depth)
        thing = other & before
        thing[thing] = self._met(
            np.broadcast_to(origins, directions.shape)[thing], directions[thing], depth[thing].astype(np.float64)
        )
        thing |= _without_spots(binary_closing(thing)) & before & (view.trust < TUNING.fog)
        trust = np.where(thing, np.maximum(view.trust, np.float32(TUNING.fog)), view.trust)
        plane = np.where(thing & (labels.plane == k), none, labels.plane)
        away = np.zeros_like(thing)
        if not self.ground.told:  # all else hangs in the air
            away = (plane == none) & ~self.hold(origins + directions * view.depth[..., None])
        shown = np.where(away, np.float32(0), view.depth)
        return replace(view, depth=shown, trust=trust), Labels(plane, labels.sure)

    def hold(self, points: F64) -> Bool:
        """(...,) which points (..., 3) are part of a thing, or close to it."""
        i, inner = self.ground.cells(points)
        return np.asarray(inner & (self.front * self.ground.off(points) < self.reach[i[..., 0], i[..., 1]]))

    def _met(self, starts: F64, ways: F64, depth: F64) -> Bool:
        """(N,) whether rays from starts (N, 3) along ways (N, 3), which meet the ground at depths (N,), pass where a
        thing stands as high."""
        fall = np.maximum(-self.front * dot(ways, self.ground.normal), 1e-12)
        met = np.zeros(len(depth), bool)
        for high in np.linspace(0, self.height.max(), THINGS.thing_heights, endpoint=False):
            i, inner = self.ground.cells(starts + ways * (depth - high / fall)[:, None])
            met |= inner & (self.height[i[:, 0], i[:, 1]] > high)
        return met


def _heights(ground: Flat, cells: Int, high: F64, tolerance: float) -> tuple[F64, F64]:
    """(I, J) how high what stands on a ground's cells is; 0 where nothing does, or the ground is surely seen. And how
    high the highest point above each cell of it is.

    Args:
        ground: a plane.
        cells: (N, 2) over which sure points are.
        high: (N,) how far these are above it.
        tolerance: how far what lies on it may be from it, world units.
    """
    from scipy.ndimage import binary_closing, binary_fill_holes

    i, shape = tuple(cells.T), ground.there.shape
    top, low, shown = np.zeros(shape), np.full(shape, np.inf), np.zeros(shape, bool)
    np.maximum.at(top, i, high)
    np.minimum.at(low, i, np.where(high > tolerance, high, np.inf))
    shown[tuple(x[np.abs(high) < tolerance] for x in i)] = True
    there, gap = top > THINGS.thing_height * tolerance, THINGS.thing_gap
    closed = binary_closing(np.pad(there, gap), iterations=gap)[gap:-gap, gap:-gap]
    piece, tall = _standing(binary_fill_holes(closed) & (there | ~shown), low, top)
    height = np.asarray(tall[piece])  # what is sure of a side may be its foot alone
    return height, np.where(height > 0, top, 0.0)


def _standing(there: Bool, low: F64, high: F64) -> tuple[Int, F64]:
    """(I, J) the piece that each of cells (I, J) belongs to, 0: none, and (P,) how high each is, 0 where its lowest
    point hangs far above the ground.

    Args:
        there: cells with something above them.
        low, high: (I, J) the lowest and the highest point above each.
    """
    from scipy.ndimage import label, labeled_comprehension, minimum

    of, many = label(there, np.ones((3, 3)))
    if not many:
        return of, np.zeros(1)
    pieces, known = np.arange(1, many + 1), np.where(np.isfinite(low), of, 0)
    top = labeled_comprehension(high, known, pieces, lambda x: np.quantile(x, THINGS.thing_top), float, 0.0)
    stands = np.asarray(minimum(low, of, pieces)) < THINGS.thing_foot * top
    return of, np.concatenate([[0.0], np.where(stands, top, 0.0)])


def _without_spots(there: Bool) -> Bool:
    """(H, W) with the small holes of a mask (H, W) filled, as what shines in a thing looks like anything."""
    from scipy.ndimage import binary_fill_holes, label

    holes = binary_fill_holes(there) & ~there
    of, _ = label(holes)
    size = np.bincount(of.ravel())
    size[0] = there.sum() + 1
    return np.asarray(there | (size < THINGS.thing_spot * there.sum())[of])
