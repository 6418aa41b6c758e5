"""Which pieces of the proxy light is kept on: those of both its sides where light goes that can be seen.

Voxels of one edge length, times six facing directions, split so that no cell lies on both sides of a wall: every point
of a cell sees its anchor, a place just above one of them. The mesh alone decides, so that all cameras and all jobs read
the same light. Insides of solids have no cell, nor has the underside of the ground; there the tracer goes on as if
there were none.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mirelight.lighting.develop import refuse_if_too_many_places
from mirelight.model import F32, F64, ProxyMesh, SurfaceCells, triangles

if TYPE_CHECKING:
    from mirelight.lighting.kernel.cells import Grid
    from mirelight.lighting.kernel.proxy import DeviceProxy

Words = NDArray[np.uint32]
Ints = NDArray[np.integer[Any]]

PER_CELL = 8  # places of the surface that are looked at, for as much of it as a voxel's side
MOST_PLACES = 1 << 20  # on each of its sides, which bounds the memory that finding cells takes
MOST = 1 << 18  # cells: what has fewest places has none
RAYS = 4  # that each place looks along
PLACES = 1 << 14  # by which a mesh is judged
FAR = 0.1  # of the proxy's diagonal
SHOWN, OPEN, ROOMY = 1 / 16, 1 / 16, 1 / 4  # of a cell's rays
PARTS = 4  # most that a voxel's side is split into by what sees what; what is left has no cell
POINTS = 16  # most of a cell that its light is gathered at
FINEST = 1 << 14  # voxels along the proxy's diagonal at most
SLACK = 1.37  # voxels before the proxy's lowest corner, so that walls at round coordinates lie inside of them


def make(surface: DeviceProxy, proxy: ProxyMesh, size: float, most: int | None = None) -> SurfaceCells:
    """The cells of a mesh.

    Args:
        surface: the proxy on the device.
        proxy: the same.
        size: edge of a voxel, world units.
        most: bytes that finding them may take; None: what the machine has free.

    Raises:
        RenderError: it would take more.
    """
    from mirelight.lighting.kernel.cells import Grid

    low, high = (x.astype(np.float64) for x in surface.bounds)
    size = max(size, float(np.linalg.norm(high - low)) / FINEST)
    origin = low - SLACK * size
    area = triangles.areas(proxy.vertices[proxy.faces].astype(np.float64)).sum()
    count = int(np.clip(np.ceil(PER_CELL * area / size**2), POINTS, MOST_PLACES))
    refuse_if_too_many_places(2 * count, most)
    return _table(surface, *_looked(surface, proxy, count, Grid(origin, size)), origin, size)


def openness(surface: DeviceProxy, proxy: ProxyMesh) -> float:
    """What share of the sky is seen from places of a mesh, each as much as it sees of the mesh itself: 0 in a closed
    room, 1 where nothing stands in front of anything."""
    from mirelight.lighting.kernel.cells import Grid

    low, high = (x.astype(np.float64) for x in surface.bounds)
    size = float(np.linalg.norm(high - low)) / FINEST
    _, _, seen = _looked(surface, proxy, PLACES, Grid(low - SLACK * size, size))
    sky = seen[_matters(np.arange(len(seen)), seen), 2].astype(np.float64)
    # of two rays of a place, one that meets the surface and another: so the outside of a house counts for nothing
    met = (RAYS - sky).sum()
    return float((sky * (RAYS - sky)).sum() / ((RAYS - 1) * met)) if met > 0 else 1.0


def _looked(surface: DeviceProxy, proxy: ProxyMesh, count: int, grid: Grid) -> tuple[Words, F32, Ints]:
    """Places on both sides of a mesh, `count` on each, as `_table` takes them."""
    from mirelight.lighting.kernel.cells import look

    corners = proxy.vertices[proxy.faces].astype(np.float64)
    face, weights = triangles.strewn(corners, count)
    places = weights[:, 1:].astype(np.float32)
    normals = triangles.normals(corners)[face].astype(np.float32)
    far = FAR * float(np.linalg.norm(surface.bounds[1].astype(np.float64) - surface.bounds[0]))
    views = [look(surface, face.astype(np.int32), places, n, grid, RAYS, far) for n in (normals, -normals)]
    keys, above, met = (np.concatenate(x) for x in zip(*views, strict=True))
    there = np.tile(places, (2, 1)), np.concatenate([normals, -normals]), above
    front = np.arange(len(keys)) < len(face)
    return (
        np.column_stack([keys, np.tile(face, 2)]).astype(np.uint32),
        np.column_stack(there),
        np.column_stack([met, front * RAYS]).astype(np.int32),
    )


def _table(surface: DeviceProxy, keys: Words, values: F32, seen: Ints, origin: F64, size: float) -> SurfaceCells:
    """Cells of places with a key and a face (n, 3), and corner, normal and place above (n, 8), and what rays from there
    meet (n, 4), see `_matters`."""
    from mirelight.lighting.kernel.cells import buckets

    shuffled = np.random.default_rng(0).permutation(len(keys))  # so that a cell's first points are any of its points
    code = keys[shuffled, 0].astype(np.uint64) << np.uint64(32) | keys[shuffled, 1]
    order = shuffled[np.argsort(code, kind="stable")]
    keys, values, seen = keys[order], values[order], seen[order]
    starts = _runs(keys[:, :2])
    voxel = np.repeat(np.arange(len(starts)), np.diff(np.append(starts, len(keys))))
    part, anchor = _parts(surface, values[:, 5:8], starts, voxel)

    cell = np.where(part < 0, -1, voxel * PARTS + part)
    kept = (part >= 0) & _matters(cell, seen)[cell]
    keys, values, anchor, cell = keys[kept], values[kept], anchor[kept], cell[kept]
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


def _matters(cell: Ints, seen: Ints) -> NDArray[np.bool_]:
    """By number of a cell, whether it is kept.

    Args:
        cell: (n,) of each place; below 0: of none.
        seen: (n, 4) how many of its RAYS meet the front of a face, go far to a face, and meet none; RAYS where a place
            itself is on a front.
    """
    there = cell >= 0
    count = np.bincount(cell[there])
    shares = (np.bincount(cell[there], seen[there, k]) / np.maximum(RAYS * count, 1) for k in range(4))
    shown, roomy, opened, front = (x >= least for x, least in zip(shares, (SHOWN, ROOMY, OPEN, 0.5), strict=True))
    useful = roomy | (opened & (front | shown)) | (front & shown)
    useful &= count > 0
    if useful.sum() > MOST:
        first = np.argsort(np.where(useful, -count, 1), kind="stable")[:MOST]
        useful = np.isin(np.arange(len(count)), first)
    return useful


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
