"""Cells: each disc of a surfel capture becomes a piece of its plane, cut where its neighbours begin."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirelight.lighting.sight import Sight
from mirelight.model import F64
from mirelight.proxy.capture import Capture, axes_of
from mirelight.proxy.polygons import Polygons, octagons
from mirelight.proxy.sides import seen_sides
from mirelight.proxy.tidy import compact
from mirelight.proxy.types import Int, Progress, ProxySettings, Soup

NEIGHBOURS = 20  # that cut a cell
SAME_PLANE = 0.8  # cosine between normals of discs of one surface
STEEP = 0.5  # rise over run to a neighbour, above which it lies on another sheet even if its normal is the same
GROWN = 1.9  # radius of a cell before cutting, in local spacings
SMALLEST, LARGEST = 2.2, 8.0  # radius, in the capture's spacing
OVERLAP = 1.1  # how far past the bisector a cell reaches: no cracks for light to leak through
WELD = 0.2  # of the spacing: corners nearer than that become one
NARROW = 0.6  # middle over longest axis, below which a disc lies at an edge or on something thin
WIDTH = 1.5  # standard deviations to either side that such a disc's cell is wide: there its alpha has fallen to a third
FLAT_CELL = 2.5  # spacings: in the midst of a plane one disc in a voxel of this size stands for the others
FLAT_NEIGHBOURS = 12  # that must lie on a disc's plane, all around it, for it to be in the midst of one
_CHUNK = 200_000  # cells cut at once


def cells_of(capture: Capture, settings: ProxySettings, progress: Progress) -> Soup:
    """Triangles of the cells of all discs of a capture.

    A neighbour on the same plane cuts at the bisector, moved outwards by a tenth; one on another plane cuts at that
    plane, so that edges between surfaces stay sharp. Faces turn their front to the side that was seen.
    """
    axes, scales = axes_of(capture.splats)
    discs, s = _Discs(capture.splats.means.astype(np.float64), axes, scales), capture.spacing
    progress("finding neighbours", 0.0)
    near, distance = _neighbours(discs.at, NEIGHBOURS)
    radius = np.clip(GROWN * distance[:, 5] / 1.8, SMALLEST * s, LARGEST * s)
    kept, stands_for_more = _without_flats(discs, near, distance, s)
    radius = np.where(stands_for_more, np.maximum(radius, FLAT_CELL * s * 2), radius)[kept]
    discs = _Discs(discs.at[kept], discs.axes[kept], discs.scales[kept])
    near, distance = _neighbours(discs.at, NEIGHBOURS)
    corners, faces, owners, start = [], [], [], 0
    for first in range(0, len(discs.at), _CHUNK):
        progress("cutting cells", 0.2 + 0.6 * first / len(discs.at))
        rows = np.arange(first, min(first + _CHUNK, len(discs.at)))
        cells = _cut(discs, rows, near[rows], radius[rows], s)
        found, triangles, cell = _in_space(discs, rows, cells)
        corners.append(found)
        faces.append(triangles + start)
        owners.append(rows[cell])
        start += len(found)
    progress("telling the sides apart", 0.8)
    soup = Soup(np.concatenate(corners), np.concatenate(faces))
    sight = Sight(soup.mesh(), settings.variant, settings.threads)
    front = seen_sides(capture, discs.at, discs.normal, sight) * np.sign(np.linalg.det(discs.axes))
    behind = front[np.concatenate(owners)] < 0
    progress("welding cells", 0.95)
    return welded(Soup(soup.vertices, np.where(behind[:, None], soup.faces[:, ::-1], soup.faces)), WELD * s)


@dataclass(frozen=True, slots=True, eq=False)
class _Discs:
    at: F64  # (N, 3)
    axes: F64  # (N, 3, 3) columns: normal, then along the disc
    scales: F64  # (N, 3) thinnest first

    @property
    def normal(self) -> F64:
        return self.axes[:, :, 0]


def _neighbours(points: F64, count: int) -> tuple[Int, F64]:
    """(N, count) nearest other points, nearest first, and how far they are."""
    from scipy.spatial import cKDTree

    distance, index = cKDTree(points).query(points, k=min(count + 1, len(points)), workers=-1)
    return index[:, 1:].astype(np.int64), distance[:, 1:]


def _without_flats(discs: _Discs, near: Int, distance: F64, s: float) -> tuple[Int, NDArray[np.bool_]]:
    """Discs that are kept, and (N,) whether one stands for others around it.

    In the midst of a plane one disc in a voxel of `FLAT_CELL` spacings is enough: its cell grows over the others'.
    """
    n, k = discs.normal, FLAT_NEIGHBOURS
    step = discs.at[near[:, :k]] - discs.at[:, None]
    level = np.abs(np.einsum("nki,ni->nk", step, n)).max(axis=1) < 0.1 * s
    level &= np.abs(np.einsum("nki,ni->nk", n[near[:, :k]], n)).min(axis=1) > 0.99
    amid = np.linalg.norm(step.mean(axis=1), axis=1) < 0.25 * distance[:, k - 1]
    flat = level & amid & (distance[:, k - 1] < 4 * s)
    rows = np.flatnonzero(flat)
    i = np.floor((discs.at[rows] - discs.at.min(axis=0)) / (FLAT_CELL * s)).astype(np.int64)
    axis = np.abs(n[rows]).argmax(axis=1)
    _, first = np.unique(((i[:, 0] * (1 << 20) + i[:, 1]) * (1 << 20) + i[:, 2]) * 3 + axis, return_index=True)
    chosen = np.zeros(len(n), bool)
    chosen[rows[first]] = True
    return np.flatnonzero(~flat | chosen), chosen


def _cut(discs: _Discs, rows: Int, near: Int, radius: F64, s: float) -> Polygons:
    cells = octagons(radius)
    p, n = discs.at[rows], discs.normal[rows]
    plane = discs.axes[rows][:, :, 1:]  # (R, 3, 2)
    step = discs.at[near] - p[:, None]  # (R, K, 3)
    along = np.einsum("rki,rij->rkj", step, plane)
    run = np.linalg.norm(along, axis=2)
    rise = np.abs(np.einsum("rki,ri->rk", step, n))
    same = np.abs(np.einsum("rki,ri->rk", discs.normal[near], n)) > SAME_PLANE
    on_sheet = same & (rise < STEEP * run)
    inwards = 0.3 * (along * on_sheet[..., None]).sum(axis=1) / np.maximum(on_sheet.sum(axis=1), 1)[:, None]
    thin = np.flatnonzero(
        discs.scales[rows, 1] < NARROW * discs.scales[rows, 2]
    )  # bars, twigs: no wider than they look
    across = np.zeros((len(rows), 2))
    for way in (1.0, -1.0):
        across[:, 0] = way
        cells.cut(thin, across, WIDTH * discs.scales[rows, 1])
    for k in range(near.shape[1]):
        # the bisector
        length = np.maximum(run[:, k], 1e-30)
        cells.cut(np.flatnonzero(on_sheet[:, k]), along[:, k] / length[:, None], 0.5 * OVERLAP * length)
        # another surface's plane
        m = discs.normal[near[:, k]]
        g = np.einsum("ri,rij->rj", m, plane)
        steep = np.maximum(np.linalg.norm(g, axis=1), 1e-30)
        g, c = g / steep[:, None], (m * step[:, k]).sum(axis=1) / steep
        side = c - (g * inwards).sum(axis=1)
        flip = side < 0
        cells.cut(
            np.flatnonzero(~same[:, k] & (np.abs(side) > 1e-3 * s)),
            np.where(flip[:, None], -g, g),
            np.where(flip, -c, c),
        )
    return cells


def _in_space(discs: _Discs, rows: Int, cells: Polygons) -> tuple[F64, Int, Int]:
    """Corners (C, 3) of all cells, one after the other, the triangles of their fans, and (T,) the cell of each."""
    plane = discs.axes[rows][:, :, 1:]
    corners = discs.at[rows][:, None] + np.einsum("rvj,rij->rvi", cells.corners, plane)
    used = np.arange(cells.corners.shape[1]) < cells.count[:, None]
    first = np.cumsum(cells.count) - cells.count
    fan = np.arange(cells.corners.shape[1] - 2)
    there = fan < (cells.count - 2)[:, None]
    cell, k = np.nonzero(there)
    faces = first[cell][:, None] + np.stack([np.zeros_like(k), k + 1, k + 2], axis=1)
    return corners[used], faces, cell


def welded(soup: Soup, reach: float) -> Soup:
    """Corners in one voxel of that size become one, twice with the voxels moved by half; flat triangles go."""
    vertices, faces = soup.vertices, soup.faces
    for offset in (0.0, 0.5):
        i = np.floor((vertices - vertices.min(axis=0)) / reach + offset).astype(np.int64)
        key = (i[:, 0] << 42) | (i[:, 1] << 21) | i[:, 2]
        _, index = np.unique(key, return_inverse=True)
        count = np.bincount(index)
        vertices = np.stack([np.bincount(index, vertices[:, k]) for k in range(3)], axis=1) / count[:, None]
        faces = index[faces]
    merged = compact(Soup(vertices, faces))
    order = np.sort(merged.faces, axis=1)
    _, once = np.unique(order, axis=0, return_index=True)
    return compact(Soup(merged.vertices, merged.faces[np.sort(once)]))
