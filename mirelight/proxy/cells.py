"""Cells: each disc of a surfel capture becomes a piece of its plane, cut where its neighbours begin."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirelight.lighting.sight import Sight
from mirelight.model import F64
from mirelight.proxy.capture import Capture, axes_of
from mirelight.proxy.polygons import Polygons, octagons
from mirelight.proxy.rods import Rods, rods_of
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
REACH = 1.5  # standard deviations that a cell reaches past the middle of its disc where the surface ends
BESIDE = 2.5  # local spacings: neighbours nearer than that carry a surface on
SECTOR = 0.7  # cosine between a direction and that to a neighbour that lies there
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
    local = distance[:, 5] / 1.8
    radius = np.clip(GROWN * local, SMALLEST * s, LARGEST * s)
    ends = np.concatenate(
        [
            _ends(discs, np.arange(k, min(k + _CHUNK, len(near))), near[k : k + _CHUNK], local[k : k + _CHUNK])
            for k in range(0, len(near), _CHUNK)
        ]
    )
    kept, stands_for_more = _without_flats(discs, near, distance, s)
    radius, ends = np.where(stands_for_more, np.maximum(radius, FLAT_CELL * s * 2), radius)[kept], ends[kept]
    discs = _Discs(discs.at[kept], discs.axes[kept], discs.scales[kept])
    near, distance = _neighbours(discs.at, NEIGHBOURS)
    rods = rods_of(discs.at, discs.normal, near, distance[:, 5] / 1.8)
    bars = Soup(np.zeros((0, 3)), np.zeros((0, 3), np.int64))
    corners, faces, owners, start = [], [], [], 0
    for first in range(0, len(discs.at), _CHUNK):
        progress("cutting cells", 0.2 + 0.6 * first / len(discs.at))
        rows = np.arange(first, min(first + _CHUNK, len(discs.at)))
        polygons = _cut(discs, rows, near[rows], radius[rows], ends[rows], s)
        bars = bars.beside(_bars(rods.where((rods.rows >= first) & (rods.rows <= rows[-1])), discs, first, polygons))
        found, triangles, cell = _in_space(discs, rows, polygons)
        corners.append(found)
        faces.append(triangles + start)
        owners.append(rows[cell])
        start += len(found)
    progress("telling the sides apart", 0.8)
    soup = Soup(np.concatenate(corners), np.concatenate(faces))
    sight = Sight(soup.beside(bars).mesh(), settings.variant, settings.threads)
    front = seen_sides(capture, discs.at, discs.normal, sight) * np.sign(np.linalg.det(discs.axes))
    behind = front[np.concatenate(owners)] < 0
    progress("welding cells", 0.95)
    cells = welded(Soup(soup.vertices, np.where(behind[:, None], soup.faces[:, ::-1], soup.faces)), WELD * s)
    return cells.beside(bars)


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


@dataclass(frozen=True, slots=True, eq=False)
class _Around:
    """Neighbours (R, K) as discs (R) see them in their planes."""

    step: F64  # (R, K, 3)
    along: F64  # (R, K, 2) the step in the plane
    run: F64  # (R, K) its length
    same: NDArray[np.bool_]  # (R, K) normals alike
    on_sheet: NDArray[np.bool_]  # (R, K) and on the same surface

    @staticmethod
    def of(discs: _Discs, rows: Int, near: Int) -> _Around:
        n = discs.normal[rows]
        step = discs.at[near] - discs.at[rows][:, None]
        along = np.einsum("rki,rij->rkj", step, discs.axes[rows][:, :, 1:])
        run = np.linalg.norm(along, axis=2)
        same = np.abs(np.einsum("rki,ri->rk", discs.normal[near], n)) > SAME_PLANE
        rise = np.abs(np.einsum("rki,ri->rk", step, n))
        return _Around(step, along, run, same, same & (rise < STEEP * run))


def _ends(discs: _Discs, rows: Int, near: Int, local: F64) -> F64:
    """(R, 8) how far a disc's cell may reach along the eight directions of its octagon's sides.

    Where no neighbour carries the surface on, and none turns it, the surface ends where the disc does.
    """
    around, plane = _Around.of(discs, rows, near), discs.axes[rows][:, :, 1:]
    beside = around.on_sheet & (around.run < BESIDE * local[:, None])
    out = np.full((len(rows), 8), np.inf)
    m = np.where(around.same[..., None], 0.0, discs.normal[near])
    g = np.einsum("rki,rij->rkj", m, plane)
    steep = np.linalg.norm(g, axis=2)
    turns = ~around.same & (
        np.abs(np.einsum("rki,ri->rk", around.step, discs.normal[rows])) < BESIDE * local[:, None] * steep
    )
    c = (m * around.step).sum(axis=2) / np.maximum(steep, 1e-30)
    g *= (np.where(c < 0, -1.0, 1.0) / np.maximum(steep, 1e-30))[..., None]
    for k in range(8):
        way = np.array([np.cos(k * np.pi / 4), np.sin(k * np.pi / 4)])
        goes_on = beside & (np.einsum("rkj,j->rk", around.along, way) > SECTOR * around.run)
        edge = turns & (np.einsum("rkj,j->rk", g, way) > SECTOR)
        wide = np.sqrt(((discs.scales[rows, 1:] * way) ** 2).sum(axis=1))
        out[:, k] = np.where((goes_on | edge).any(axis=1), np.inf, REACH * wide)
    return out


def _cut(discs: _Discs, rows: Int, near: Int, radius: F64, ends: F64, s: float) -> Polygons:
    cells = octagons(radius)
    plane = discs.axes[rows][:, :, 1:]  # (R, 3, 2)
    around = _Around.of(discs, rows, near)
    step, along, run, same, on_sheet = around.step, around.along, around.run, around.same, around.on_sheet
    inwards = 0.3 * (along * on_sheet[..., None]).sum(axis=1) / np.maximum(on_sheet.sum(axis=1), 1)[:, None]
    thin = np.flatnonzero(
        discs.scales[rows, 1] < NARROW * discs.scales[rows, 2]
    )  # bars, twigs: no wider than they look
    across = np.zeros((len(rows), 2))
    for way in (1.0, -1.0):
        across[:, 0] = way
        cells.cut(thin, across, WIDTH * discs.scales[rows, 1])
    for k in range(8):
        across[:] = np.cos(k * np.pi / 4), np.sin(k * np.pi / 4)
        cells.cut(np.flatnonzero(np.isfinite(ends[:, k])), across, ends[:, k])
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


def _bars(rods: Rods, discs: _Discs, first: int, cells: Polygons) -> Soup:
    """Prisms in place of the cells of discs on rods, as long as those were; `first` is the disc of the first cell."""
    along = np.einsum("rij,ri->rj", discs.axes[rods.rows][:, :, 1:], rods.axis)
    low, high = cells.extent(rods.rows - first, along)
    cells.count[rods.rows - first] = 0
    return rods.prisms(discs.at[rods.rows], low, high)


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
