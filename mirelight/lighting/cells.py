"""Which pieces of the proxy light is kept on: those that paths from a scene's cameras, or from points, visit.

Voxels of one edge length, times six facing directions, split so that no cell lies on both sides of a wall: every point
of a cell sees its anchor, a place just above one of them. A piece that no path has visited has no cell; there the
tracer goes on as if there were none.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mirelight.lighting.develop import refuse_if_too_many_paths
from mirelight.model import F32, F64, SurfaceCells

if TYPE_CHECKING:
    from mirelight.lighting.kernel.probes import PointRays
    from mirelight.lighting.kernel.proxy import DeviceProxy
    from mirelight.lighting.kernel.rays import CameraRays

PATHS = 1 << 18  # drawn from all views together
FEWEST_PATHS = 1 << 9  # from each, as long as that makes no more than
MOST_PATHS = 1 << 21  # in all, which bounds the memory that finding cells takes (1 GB)
VERTICES = 4  # of a path: later ones lie where others have been
PARTS = 4  # most that a voxel's side is split into by what sees what; what is left has no cell
POINTS = 16  # most of a cell that its light is gathered at
FINEST = 1 << 14  # voxels along the proxy's diagonal at most
SLACK = 1.37  # voxels before the proxy's lowest corner, so that walls at round coordinates lie inside of them


def make(
    surface: DeviceProxy,
    views: Sequence[tuple[CameraRays | PointRays, int]],
    size: float,
    most: int | None = None,
) -> SurfaceCells:
    """The cells of a scene.

    Args:
        surface: the proxy.
        views: where paths start, and how many pixels each has: every camera of the job, whatever is chosen to render,
            as the same cells serve each frame; or points of the surface.
        size: edge of a voxel, world units.
        most: bytes that finding them may take; None: what the machine has free.

    Raises:
        RenderError: it would take more.
    """
    from mirelight.lighting.kernel.cells import Grid, visit

    low, high = (x.astype(np.float64) for x in surface.bounds)
    size = max(size, float(np.linalg.norm(high - low)) / FINEST)
    origin = low - SLACK * size
    grid, lanes = Grid(origin, size), _paths_of_each(max(len(views), 1))
    refuse_if_too_many_paths(lanes * len(views), most)
    keys, values = [np.zeros((0, 3), np.uint32)], [np.zeros((0, 8), np.float32)]
    for index, (view, pixels) in enumerate(views):
        found = visit(surface, view, grid, lanes, pixels, VERTICES, index)
        keys.append(found[0])
        values.append(found[1])
    return _table(surface, np.concatenate(keys), np.concatenate(values), origin, size)


def _paths_of_each(views: int) -> int:
    return max(PATHS // views, min(FEWEST_PATHS, MOST_PATHS // views), 1)


def _table(surface: DeviceProxy, keys: NDArray[np.uint32], values: F32, origin: F64, size: float) -> SurfaceCells:
    """Cells of points with a key and a face (n, 3), and corner, normal and place above (n, 8)."""
    from mirelight.lighting.kernel.cells import buckets

    shuffled = np.random.default_rng(0).permutation(len(keys))  # so that a cell's first points are any of its points
    code = keys[shuffled, 0].astype(np.uint64) << np.uint64(32) | keys[shuffled, 1]
    order = shuffled[np.argsort(code, kind="stable")]
    keys, values = keys[order], values[order]
    starts = _runs(keys[:, :2])
    voxel = np.repeat(np.arange(len(starts)), np.diff(np.append(starts, len(keys))))
    part, anchor = _parts(surface, values[:, 5:8], starts, voxel)

    kept = part >= 0
    keys, values, anchor = keys[kept], values[kept], anchor[kept]
    cell = voxel[kept] * PARTS + part[kept]
    by_cell = np.argsort(cell, kind="stable")
    keys, values, anchor, cell = keys[by_cell], values[by_cell], anchor[by_cell], cell[by_cell]
    starts = _runs(cell[:, None])
    counts = np.diff(np.append(starts, len(cell)))

    mask = (1 << max(int(len(starts) - 1).bit_length(), 1)) - 1
    bucket = buckets(keys[starts, :2], mask)
    order = np.argsort(bucket, kind="stable")
    # a cell's points, over and over where they are fewer than POINTS
    points = starts[order, None] + np.arange(POINTS) % np.minimum(counts[order], POINTS)[:, None]
    return SurfaceCells(
        size=size,
        origin=origin,
        keys=keys[starts[order], :2],
        starts=np.searchsorted(bucket[order], np.arange(mask + 2)).astype(np.uint32),
        anchors=anchor[starts[order]],
        faces=keys[points, 2].astype(np.int32),
        corners=values[points, 0:2],
        normals=values[points, 2:5],
    )


def _runs(rows: NDArray[np.generic]) -> NDArray[np.int64]:
    """Where each run of equal rows (n, k) starts."""
    new = np.any(rows[1:] != rows[:-1], axis=1)
    return np.flatnonzero(np.append(True, new)) if len(rows) else np.zeros(0, np.int64)


def _parts(
    surface: DeviceProxy, above: F32, starts: NDArray[np.int64], voxel: NDArray[np.int64]
) -> tuple[NDArray[np.int64], F32]:
    """For points sorted by voxel: which part of it each belongs to, -1 for none, and that part's anchor (n, 3).

    A part is what the first point that is left sees.
    """
    from mirelight.lighting.kernel.cells import hidden

    part, anchor = np.full(len(above), -1), np.zeros_like(above)
    left = np.arange(len(above))
    for number in range(PARTS):
        if not len(left):
            break
        first = np.full(len(starts), len(above))
        np.minimum.at(first, voxel[left], left)
        eye = first[voxel[left]]
        sees = ~hidden(surface, above[left], above[eye])
        sees |= left == eye
        part[left[sees]] = number
        anchor[left[sees]] = above[eye[sees]]
        left = left[~sees]
    return part, anchor
