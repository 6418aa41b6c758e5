"""The large planes of a surface, and square cells over them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirelight.model import F64, triangles
from mirelight.proxy.tuning import TUNING
from mirelight.proxy.types import Int, Soup, corners_of
from mirelight.proxy.views import lattice, turned

Bool = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Plane:
    """Faces of a surface that lie in one plane, near enough."""

    normal: F64  # (3,) unit, to the side of most of its fronts
    offset: float
    faces: Int
    area: float


@dataclass(frozen=True, slots=True, eq=False)
class Sheet:
    """Square cells of a plane, over the box."""

    origin: F64  # (3,) corner of the first
    axes: F64  # (2, 3) unit, along which they are counted
    cell: float  # their side, world units
    inside: Bool  # (I, J) which are in the box

    @staticmethod
    def of(plane: Plane, planes: Sequence[Plane], low: F64, high: F64, cell: float) -> Sheet:
        """A sheet of cells along the plane's two axes, in the box of the corners (3,)."""
        axes = np.stack(_axes(plane, planes))
        corners = corners_of(low, high)
        flat = turned(corners, axes)
        count = np.ceil((flat.max(axis=0) - flat.min(axis=0)) / cell).astype(int)
        whole = Sheet(plane.normal * plane.offset + flat.min(axis=0) @ axes, axes, cell, np.ones(count, bool))
        at = whole.middles()
        inside = ((at >= low - cell) & (at <= high + cell)).all(axis=1)
        return Sheet(whole.origin, axes, cell, inside.reshape(count))

    def middles(self) -> F64:
        """(I J, 3) of the cells, row by row."""
        return self._at(*(np.indices(self.inside.shape).reshape(2, -1) + 0.5))

    def lattice(self) -> F64:
        """((I + 1) (J + 1), 3) corners of the cells, row by row."""
        return self._at(*np.indices((self.inside.shape[0] + 1, self.inside.shape[1] + 1)).reshape(2, -1))

    def cells(self, points: F64) -> Bool:
        """(I, J) which hold points, however far those are from the plane."""
        out = np.zeros_like(self.inside)
        at = np.floor(turned(points - self.origin, self.axes) / self.cell).astype(int)
        i, j = np.clip(at, 0, np.array(out.shape) - 1).T
        out[i, j] = True
        return out

    def rectangles(self, chosen: Bool) -> Soup:
        """Two triangles for each run of chosen cells (I, J), equal runs of neighbouring rows as one."""
        i, j = np.nonzero(np.diff(np.pad(chosen, ((0, 0), (1, 1))).astype(np.int8), axis=1))
        row, first, past = i[::2], j[::2], j[1::2]  # a run begins and ends
        order = np.lexsort((row, past, first))
        row, first, past = row[order], first[order], past[order]
        fresh = np.ones(len(row), bool)
        fresh[1:] = (first[1:] != first[:-1]) | (past[1:] != past[:-1]) | (row[1:] != row[:-1] + 1)
        tall = np.bincount(np.cumsum(fresh) - 1, minlength=int(fresh.sum()))
        low, left, right = row[fresh], first[fresh], past[fresh]
        x, y = np.stack([low, low + tall, low + tall, low], axis=1), np.stack([left, left, right, right], axis=1)
        at = 4 * np.arange(len(low))[:, None]
        faces = np.concatenate([at + corner for corner in ((0, 1, 2), (0, 2, 3))])
        return Soup(self._at(x.ravel(), y.ravel()), faces)

    def _at(self, i: NDArray[np.number], j: NDArray[np.number]) -> F64:
        """(M, 3) points so many cells along both axes (M,)."""
        u, v = self.axes
        return np.asarray(self.origin + (i * self.cell)[:, None] * u + (j * self.cell)[:, None] * v)


def planes_of(soup: Soup, thick: float, least: float) -> list[Plane]:
    """The planes that hold most of a surface, the largest first.

    Args:
        soup: the surface.
        thick: how far its faces may lie from a plane.
        least: area of a plane.
    """
    area = triangles.areas(soup.vertices[soup.faces])
    normal = triangles.normals(soup.vertices[soup.faces])
    a, b, c = (soup.vertices[soup.faces[:, k]] for k in range(3))
    middle = (a + b + c) / 3
    found: list[Plane] = []
    left = np.arange(len(area))
    tried = lattice(TUNING.mesh_directions)
    tried = tried[: TUNING.mesh_directions // 2]  # a lattice over the sphere, half of it
    while len(found) < TUNING.mesh_planes and len(left):
        plane = _largest(normal, middle, area, left, tried, thick)
        if plane is None or plane.area < least:
            break
        found.append(plane)
        left = np.setdiff1d(left, plane.faces, assume_unique=True)
    return found


def _largest(normal: F64, middle: F64, area: F64, left: Int, tried: F64, thick: float) -> Plane | None:
    """By some of the faces that are left directions are chosen, and by more the best; then it has all its faces."""
    some = left[:: max(len(left) // TUNING.mesh_sample, 1)]
    alike = np.abs(np.einsum("fi,di->df", normal[some], tried)) > TUNING.mesh_alike
    more = left[:: max(len(left) // TUNING.mesh_looked_at, 1)]
    best, most = None, 0.0
    for k in np.argsort(-(alike * area[some]).sum(axis=1), kind="stable")[:4]:
        way = tried[k]
        for _ in range(3):  # towards the mean of those alike
            cosine = turned(normal[more], way[None])[:, 0]
            near = np.abs(cosine) > TUNING.mesh_alike
            mean = (normal[more[near]] * (area[more[near]] * np.sign(cosine[near]))[:, None]).sum(axis=0)
            if not np.linalg.norm(mean) > 0:
                break
            way = mean / np.linalg.norm(mean)
        total = float(area[_on_plane(normal, middle, area, more, way, thick)].sum())
        if best is None or total > most:
            best, most = way, total
    if best is None:
        return None
    faces = _on_plane(normal, middle, area, left, best, thick)
    total = float(area[faces].sum())
    offset = float((turned(middle[faces], best[None])[:, 0] * area[faces]).sum() / max(total, 1e-300))
    fronts = float((np.sign(turned(normal[faces], best[None])[:, 0]) * area[faces]).sum())
    side = -1.0 if fronts < 0 else 1.0
    return Plane(side * best, side * offset, faces, total)


def _on_plane(normal: F64, middle: F64, area: F64, rows: Int, way: F64, thick: float) -> Int:
    """Of some faces those on the largest plane across a direction, no farther than `thick` from its middle."""
    rows = rows[np.abs(turned(normal[rows], way[None])[:, 0]) > TUNING.mesh_alike]
    if not len(rows):
        return rows
    at = turned(middle[rows], way[None])[:, 0]
    bin_of = np.floor((at - at.min()) / thick).astype(np.int64)
    heavy = np.bincount(bin_of, area[rows])
    peak = int(np.argmax(heavy[:-1] + heavy[1:])) if len(heavy) > 1 else 0
    return np.asarray(rows[(bin_of == peak) | (bin_of == peak + 1)])


def _axes(plane: Plane, planes: Sequence[Plane]) -> tuple[F64, F64]:
    """Two unit vectors in the plane: along the largest other plane that stands on it, and across."""
    for other in planes:
        if abs(float(np.dot(other.normal, plane.normal))) < 0.3:
            u = other.normal - plane.normal * np.dot(other.normal, plane.normal)
            break
    else:
        axis = np.eye(3)[int(np.abs(plane.normal).argmin())]
        u = axis - plane.normal * np.dot(axis, plane.normal)
    u = u / np.linalg.norm(u)
    return u, np.cross(plane.normal, u)
