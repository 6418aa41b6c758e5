"""The rasteriser's inner loop on the compute device: of all triangles that cover a pixel's centre, the nearest.

Each lane walks along one row of one triangle; depth and face are one 64-bit number, so that an atomic minimum finds the
same face in any order. Edge functions are in double precision, which is exact on the vertices' subpixel grid.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from mirelight.lighting.kernel.memory import integers
from mirelight.model import F64, Camera

BATCH = 1 << 24  # rows at once; bounds the memory
_NOTHING = (1 << 64) - 1


@dataclass(frozen=True, slots=True, eq=False)
class Triangles:
    """What the inner loop needs of T triangles. Functions of a pixel's centre are columns over (x, y, 1)."""

    edges: F64  # (T, 3, 3) one column per edge, positive inside
    inclusive: NDArray[np.bool_]  # (T, 3) edges that own the centres on them
    depth: F64  # (T, 3, 2) view depth as a quotient
    boxes: NDArray[np.int64]  # (T, 4) pixels x0, y0, x1, y1 (exclusive)


def nearest(triangles: Triangles, camera: Camera) -> NDArray[np.int64]:
    """(H * W) index of the nearest triangle at each pixel's centre between the near and far plane; -1: none."""
    best = dr.full(mi.UInt64, _NOTHING, camera.width * camera.height)
    dr.make_opaque(best)
    table = _Table(triangles, camera)
    boxes = triangles.boxes
    rows = boxes[:, 3] - boxes[:, 1]
    ends = np.cumsum(rows)
    start = 0
    while start < len(boxes):
        done = int(ends[start - 1]) if start else 0
        stop = max(start + 1, int(np.searchsorted(ends, done + BATCH, side="right")))
        triangle = np.repeat(np.arange(start, stop, dtype=np.uint32), rows[start:stop])
        first = np.repeat(boxes[start:stop, 1] - (ends[start:stop] - rows[start:stop] - done), rows[start:stop])
        table.fill(integers(triangle), integers(first + np.arange(len(triangle))), best)
        start = stop
    found = best.numpy()
    return np.where(found == np.uint64(_NOTHING), -1, (found & np.uint64(0xFFFFFFFF)).astype(np.int64))


class _Table:
    """The triangles in device memory."""

    def __init__(self, triangles: Triangles, camera: Camera) -> None:
        self._edges = mi.Float64(np.append(triangles.edges.ravel(), 0.0))
        self._depth = mi.Float64(np.append(triangles.depth.ravel(), 0.0))
        self._inclusive = mi.Bool(np.append(triangles.inclusive.ravel(), False))
        self._boxes = integers(np.append(triangles.boxes.ravel(), 0))
        self._width = dr.opaque(mi.UInt32, camera.width)
        self._near, self._far = (dr.opaque(mi.Float64, x) for x in (camera.near, camera.far))

    def fill(self, triangle: mi.UInt32, row: mi.UInt32, best: mi.UInt64) -> None:
        """Put a row each of the triangles' pixels into `best` where they are nearer."""
        y = mi.Float64(row) + 0.5
        edges = [self._along(self._edges, triangle * 9 + edge, 3, y) for edge in range(3)]
        owns = [dr.gather(mi.Bool, self._inclusive, triangle * 3 + edge) for edge in range(3)]
        over, under = (self._along(self._depth, triangle * 6 + k, 2, y) for k in range(2))
        low, high = (mi.Float64(dr.gather(mi.UInt32, self._boxes, triangle * 4 + k)) for k in (0, 2))
        for a, c in edges:  # where the edge crosses the row, and a pixel more for rounding
            crossing = -c / a
            low = dr.select(a > 0, dr.maximum(low, dr.minimum(crossing - 2, high)), low)
            high = dr.select(a < 0, dr.minimum(high, dr.maximum(crossing + 2, low)), high)

        def pending(x: mi.UInt32) -> mi.Bool:
            return x < last

        def test(x: mi.UInt32) -> tuple[mi.UInt32]:
            at = mi.Float64(x) + 0.5
            inside = mi.Bool(True)
            for (a, c), own in zip(edges, owns, strict=True):
                e = a * at + c
                inside &= (e > 0) | ((e == 0) & own)
            depth = (over[0] * at + over[1]) / (under[0] * at + under[1])
            inside &= (depth >= self._near) & (depth <= self._far)
            key = mi.UInt64(dr.reinterpret_array(mi.UInt32, mi.Float(depth))) << 32
            dr.scatter_reduce(dr.ReduceOp.Min, best, key | mi.UInt64(triangle), row * self._width + x, inside)
            return (x + 1,)

        last = mi.UInt32(high)
        dr.while_loop((mi.UInt32(low),), pending, test, labels=("x",))
        dr.eval(best)

    def _along(
        self, columns: mi.Float64, first: mi.UInt32, stride: int, y: mi.Float64
    ) -> tuple[mi.Float64, mi.Float64]:
        """A function of (x, y, 1) on a row: (a, c) of a x + c."""
        a, b, c = (dr.gather(mi.Float64, columns, first + k * stride) for k in range(3))
        return a, b * y + c
