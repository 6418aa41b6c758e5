"""Cells: each disc of a surfel capture becomes a piece of its plane, cut where its neighbours begin."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from mirelight.base.progress import ShareProgress
from mirelight.lighting.sight import Sight
from mirelight.model import F64, triangles
from mirelight.proxy.axes import axes_of
from mirelight.proxy.capture import Capture
from mirelight.proxy.cell_tuning import CELLS
from mirelight.proxy.creases import Creases, wedges_of
from mirelight.proxy.discs import Around, Discs
from mirelight.proxy.polygons import Polygons, octagons
from mirelight.proxy.rods import Rods, rods_of
from mirelight.proxy.sides import seen_sides
from mirelight.proxy.stars import stars_of
from mirelight.proxy.tidy import compact
from mirelight.proxy.turned import neighbourhoods, righted
from mirelight.proxy.types import Int, ProxySettings, Soup

_CHUNK = 200_000  # cells cut at once: memory alone
_FEW = 50_000  # cells cut in wedges at once


def cells_of(capture: Capture, settings: ProxySettings, progress: ShareProgress) -> Soup:
    """Triangles of the cells of all discs of a capture.

    A neighbour on the same sheet cuts at the bisector, moved outwards by a tenth; one on another plane cuts at that
    plane, where its own disc is, so that edges between surfaces stay sharp and no cracks stay open beside them. Faces
    turn their front to the side that was seen.
    """
    axes, scales = axes_of(capture.splats)
    s = capture.spacing
    discs = Discs(capture.splats.means.astype(np.float64), axes, scales, s)
    progress("finding neighbours", 0.0)
    near, distance, local = neighbourhoods(discs.at)
    if (lying := righted(discs, near, local)) is not discs:
        discs = lying
        near, distance, local = neighbourhoods(discs.at)
    radius = np.clip(CELLS.cell_grown * local, CELLS.cell_smallest * s, CELLS.cell_largest * s)
    ends = np.concatenate([_ends(discs, rows, near[rows], local) for rows in _chunks(len(near), _CHUNK)])
    flat, stands_for_more = _flats(discs, near, distance, s)
    kept, flats = np.flatnonzero(~flat | stands_for_more), discs.at[flat]
    radius, ends = np.where(stands_for_more, np.maximum(radius, CELLS.cell_flat_cell * s * 2), radius)[kept], ends[kept]
    discs = discs.where(kept)
    near, _, local = neighbourhoods(discs.at)
    rods = rods_of(discs.at, discs.normal, near, local, flats)
    bars = Soup(np.zeros((0, 3)), np.zeros((0, 3), np.int64))
    parts, whole, creased = _Parts(), list[tuple[Int, Polygons]](), np.zeros(len(discs.at), bool)
    for rows in _chunks(len(discs.at), _CHUNK):
        progress("cutting cells", 0.2 + 0.5 * rows[0] / len(discs.at))
        around = Around.of(discs, rows, near[rows])
        cells = _on_sheets(discs, rows, around, radius[rows], ends[rows])
        before, area = cells.where(np.arange(len(rows))), cells.area()
        Creases.of(discs, rows, near[rows], around, local, cells).cut(cells, np.arange(len(rows)))
        creased[rows] = cells.area() < area
        here = rods.where((rods.rows >= rows[0]) & (rods.rows <= rows[-1]))
        bars = bars.beside(_bars(here, discs, int(rows[0]), cells))
        creased[here.rows] = False
        whole.append((rows[creased[rows]], before.where(np.flatnonzero(creased[rows]))))
        parts.add(discs, rows, cells.simplified(CELLS.cell_straight * s))
    progress("telling the sides apart", 0.7)
    sight = Sight(parts.soup().beside(bars).mesh(), settings.variant, settings.threads)
    front = seen_sides(capture, discs.at, discs.normal, sight)
    parts = parts.without(creased)
    on_rod = np.zeros(len(discs.at), bool)
    on_rod[rods.rows] = True
    told = np.where(on_rod[near].any(axis=1), 0.0, front)  # the sides of a bar that is no wider than its discs are not
    for rows, cells in whole:
        progress("cutting cells at creases", 0.8)
        for some in _chunks(len(rows), _FEW):
            _creased(discs, rows[some], near[rows[some]], cells.where(some), local, told, parts)
    soup = parts.soup()
    behind = (front * np.sign(np.linalg.det(discs.axes)))[np.concatenate(parts.owners)] < 0
    progress("welding cells", 0.95)
    soup = welded(Soup(soup.vertices, np.where(behind[:, None], soup.faces[:, ::-1], soup.faces)), CELLS.cell_weld * s)
    return soup.beside(bars)


def _flats(discs: Discs, near: Int, distance: F64, s: float) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """(N,) discs in the midst of planes, and (N,) which of them stand for the others.

    In the midst of a plane one disc in a voxel of `FLAT_CELL` spacings is enough: its cell grows over the others'.
    """
    n, k = discs.normal, CELLS.cell_flat_neighbours
    step = discs.at[near[:, :k]] - discs.at[:, None]
    level = np.abs(np.einsum("nki,ni->nk", step, n)).max(axis=1) < 0.1 * s
    level &= np.abs(np.einsum("nki,ni->nk", n[near[:, :k]], n)).min(axis=1) > 0.99
    amid = np.linalg.norm(step.mean(axis=1), axis=1) < 0.25 * distance[:, k - 1]
    flat = level & amid & (distance[:, k - 1] < 4 * s)
    rows = np.flatnonzero(flat)
    i = np.floor((discs.at[rows] - discs.at.min(axis=0)) / (CELLS.cell_flat_cell * s)).astype(np.int64)
    axis = np.abs(n[rows]).argmax(axis=1)
    _, first = np.unique(((i[:, 0] * (1 << 20) + i[:, 1]) * (1 << 20) + i[:, 2]) * 3 + axis, return_index=True)
    chosen = np.zeros(len(n), bool)
    chosen[rows[first]] = True
    return flat, chosen


def _ends(discs: Discs, rows: Int, near: Int, local: F64) -> F64:
    """(R, 8) how far a disc's cell may reach along the eight directions of its octagon's sides.

    Where no neighbour carries the surface on, and none turns it, the surface ends where the disc does: where alpha
    passes one half, to which many neighbours add. A neighbour of another normal turns it where the way there meets its
    plane at its disc.
    """
    around, plane, own = Around.of(discs, rows, near), discs.axes[rows][:, :, 1:], local[rows]
    beside = around.on_sheet & (around.run < CELLS.cell_beside * own[:, None])
    deviations = np.where(beside.sum(axis=1) <= CELLS.cell_few, CELLS.cell_half, CELLS.cell_reach)
    out = np.full((len(rows), 8), np.inf)
    row, slot = np.nonzero(~around.same)
    other, step, along = near[row, slot], around.step[row, slot], around.along[row, slot]
    m = discs.normal[other]
    across = np.einsum("pi,pij->pj", m, plane[row])
    level, squared, reach = (m * step).sum(axis=1), (step**2).sum(axis=1), (CELLS.crease_meets * local[other]) ** 2
    for k in range(8):
        way = np.array([np.cos(k * np.pi / 4), np.sin(k * np.pi / 4)])
        goes_on = (beside & (np.einsum("rkj,j->rk", around.along, way) > CELLS.cell_sector * around.run)).any(axis=1)
        slope = across @ way
        far = level / np.where(np.abs(slope) > 1e-30, slope, 1e-30)
        met = (far > 0) & (far < CELLS.cell_grown * own[row])
        met &= np.where(met, far, 0) * (np.where(met, far, 0) - 2 * along @ way) + squared < reach
        goes_on[row[met]] = True
        wide = np.sqrt(((discs.scales[rows, 1:] * way) ** 2).sum(axis=1))
        out[:, k] = np.where(goes_on, np.inf, deviations * wide)
    return out


def _on_sheets(discs: Discs, rows: Int, around: Around, radius: F64, ends: F64) -> Polygons:
    """Cells that end where their sheets do, and half-way to what else lies on them."""
    cells = octagons(radius)
    # bars, twigs: no wider than they look
    thin = np.flatnonzero(discs.scales[rows, 1] < CELLS.cell_narrow * discs.scales[rows, 2])
    for x in (1.0, -1.0):
        cells.cut(thin, np.tile((x, 0.0), (len(thin), 1)), CELLS.cell_half * discs.scales[rows[thin], 1])
    for k in range(8):
        ending = np.flatnonzero(np.isfinite(ends[:, k]))
        way = np.array([np.cos(k * np.pi / 4), np.sin(k * np.pi / 4)])
        cells.cut(ending, np.broadcast_to(way, (len(ending), 2)), ends[ending, k])
    for k in range(around.run.shape[1]):
        beside = np.flatnonzero(around.on_sheet[:, k])
        length = np.maximum(around.run[beside, k], 1e-30)
        cells.cut(beside, around.along[beside, k] / length[:, None], 0.5 * CELLS.cell_overlap * length)
    return cells


def _creased(discs: Discs, rows: Int, near: Int, cells: Polygons, local: F64, front: F64, parts: _Parts) -> None:
    """Cells (R,), cut by their sheets, are cut at creases and added: in wedges where that leaves more of them."""
    creases = Creases.of(discs, rows, near, Around.of(discs, rows, near), local, cells)
    creases = creases.seen_from(front, rows).on(cells)
    wedges, row = wedges_of(cells)
    creases.cut(wedges, row)
    creases.cut(cells, np.arange(len(rows)))
    split = np.bincount(row, wedges.area(), len(rows)) > CELLS.cell_split * cells.area()
    parts.add(discs, rows[~split], cells.where(np.flatnonzero(~split)).simplified(CELLS.cell_straight * discs.spacing))
    some = np.flatnonzero(split[row])
    stars, whole = stars_of(wedges.where(some), row[some], len(rows), CELLS.cell_straight * discs.spacing)
    parts.add(discs, rows[whole], stars)
    some = np.flatnonzero((split & ~whole)[row])
    parts.add(discs, rows[row[some]], wedges.where(some))


def _bars(rods: Rods, discs: Discs, first: int, cells: Polygons) -> Soup:
    """Prisms in place of the cells of discs on rods, as long as those were; `first` is the disc of the first cell."""
    along = np.einsum("rij,ri->rj", discs.axes[rods.rows][:, :, 1:], rods.axis)
    low, high = cells.extent(rods.rows - first, along)
    cells.count[rods.rows - first] = 0
    return rods.prisms(discs.at[rods.rows], low, high)


def _in_space(discs: Discs, rows: Int, cells: Polygons) -> tuple[F64, Int, Int]:
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


def _chunks(count: int, most: int) -> Iterator[Int]:
    for first in range(0, count, most):
        yield np.arange(first, min(first + most, count))


@dataclass(slots=True, eq=False)
class _Parts:
    """Triangles of cells, chunk by chunk."""

    corners: list[F64] = field(default_factory=list)  # (C, 3) each
    faces: list[Int] = field(default_factory=list)  # (T, 3) each, of corners of all
    owners: list[Int] = field(default_factory=list)  # (T,) each: the disc
    start: int = 0  # corners of all

    def add(self, discs: Discs, rows: Int, cells: Polygons) -> None:
        """Cells (R,) of discs (R,)."""
        corners, faces, cell = _in_space(discs, rows, cells)
        self.corners.append(corners)
        self.faces.append(faces + self.start)
        self.owners.append(rows[cell])
        self.start += len(corners)

    def without(self, chosen: NDArray[np.bool_]) -> _Parts:
        """Without those of discs (N,)."""
        kept = [~chosen[owners] for owners in self.owners]
        faces, owners = ([x[k] for x, k in zip(all_of, kept, strict=True)] for all_of in (self.faces, self.owners))
        return _Parts(self.corners, faces, owners, self.start)

    def soup(self) -> Soup:
        """All parts as one mesh."""
        return Soup(np.concatenate(self.corners), np.concatenate(self.faces))


def welded(soup: Soup, reach: float) -> Soup:
    """Corners in one voxel of that size become one, twice with the voxels moved by half; triangles without area go."""
    vertices, faces = soup.vertices, soup.faces
    for offset in (0.0, 0.5):
        i = np.floor((vertices - vertices.min(axis=0)) / reach + offset).astype(np.int64)
        key = (i[:, 0] << 42) | (i[:, 1] << 21) | i[:, 2]
        _, index = np.unique(key, return_inverse=True)
        count = np.bincount(index)
        vertices = np.stack([np.bincount(index, vertices[:, k]) for k in range(3)], axis=1) / count[:, None]
        faces = index[faces]
    there = triangles.areas(vertices[faces]) > CELLS.cell_sliver * reach**2
    merged = compact(Soup(vertices, faces[there]))
    order = np.sort(merged.faces, axis=1)
    _, once = np.unique(order, axis=0, return_index=True)
    return compact(Soup(merged.vertices, merged.faces[np.sort(once)]))
