"""Fewer triangles: edges collapsed by quadric error, cheapest first, with rims held by planes of their own.

Garland and Heckbert, "Surface Simplification Using Quadric Error Metrics" (1997). What lies in one plane costs nothing
and goes first. Edges that have nothing to do with each other are collapsed at once, so that arrays do the work.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirelight.model import F64, triangles
from mirelight.proxy.tidy import compact
from mirelight.proxy.tuning import TUNING
from mirelight.proxy.types import Int, Soup

# small enough that nothing else notices, and far above single precision of what they stand beside
_SOFT = 1e-6  # share of a quadric that draws a vertex to the edge's middle where planes leave it free
_LONG = 1e-6  # of an edge's own square: among edges that cost nothing short ones go first

Mask = NDArray[np.bool_]


def decimated(soup: Soup, most: int) -> Soup:
    """About `most` triangles, or the mesh itself where it has no more.

    No collapse turns a face over or joins sheets, but at last at seams, where sheets overlap as cells do. Where that
    leaves no edge there are more than `most`: each closed part keeps a few triangles.
    """
    if len(soup.faces) <= most:
        return soup
    work = _Work.of(soup)
    idle = 0
    while len(work.faces) > most and idle < TUNING.fewer_idle:
        before = len(work.faces)
        work.round((before - most + 1) // 2)
        idle = idle + 1 if len(work.faces) > before - max(before // 2000, 1) else 0
        if idle == TUNING.fewer_idle and not work.joins_seams:
            work.joins_seams, idle = True, 0
    return compact(Soup(work.vertices, work.faces))


@dataclass(slots=True, eq=False)
class _Work:
    """A mesh that loses edges round by round."""

    vertices: F64  # (V, 3); those that no face uses mean nothing
    faces: Int  # (F, 3)
    quadrics: F64  # (V, 10) upper triangle of [A b; bᵀ c], row by row
    refused: Int  # keys of edges that could not go
    rounds: int = 0
    joins_seams: bool = False

    @staticmethod
    def of(soup: Soup) -> _Work:
        soup = compact(soup)
        v, f = soup.vertices, soup.faces
        n = triangles.crossed(v[f])
        area = 0.5 * np.linalg.norm(n, axis=1)
        unit = n / np.maximum(2 * area, 1e-300)[:, None]
        quadrics = np.zeros((len(v), 10))
        _add(quadrics, f, _planes(unit, v[f[:, 0]], area / 3))
        edges, owner, count = _edges(f, len(v))
        rim = count == 1
        a, b, side = v[edges[rim, 0]], v[edges[rim, 1]], unit[owner[rim]]
        along = b - a
        across = np.cross(along, side)
        length = np.linalg.norm(across, axis=1)
        held = _planes(across / np.maximum(length, 1e-300)[:, None], a, TUNING.fewer_rim * length**2 / 3)
        _add(quadrics, edges[rim], held)
        return _Work(v.copy(), f, quadrics, np.zeros(0, np.int64))

    def round(self, most: int) -> None:
        """Collapse up to `most` edges that do not touch each other's faces."""
        self.rounds += 1
        if self.rounds % TUNING.fewer_rested == 0:
            self.refused = self.refused[:0]
        n = len(self.vertices)
        edges, _, count = _edges(self.faces, n)
        at, cost = self._best(edges)
        cost[np.isin(edges[:, 0] * n + edges[:, 1], self.refused)] = np.inf
        looked_at = min(
            len(edges) - 1, max(min(TUNING.fewer_ahead * most, len(edges) // TUNING.fewer_divided), TUNING.fewer_fewest)
        )
        bound = np.partition(cost, looked_at)[looked_at]
        some = np.flatnonzero((cost <= bound) & np.isfinite(cost))
        order = some[np.argsort(cost[some], kind="stable")]
        chosen = self._apart(edges[order])
        rows = order[chosen]
        fits = (
            self._joins_no_sheets(edges[rows], count[rows]) | self._at_seams(edges, count, rows)
        ) & self._turns_nothing(edges[rows], at[rows])
        lost = edges[rows[~fits]]
        self.refused = np.concatenate([self.refused, lost[:, 0] * n + lost[:, 1]])
        self._collapse(edges[rows[fits]][:most], at[rows[fits]][:most])

    def _best(self, edges: Int) -> tuple[F64, F64]:
        """(E, 3) where each edge's vertex would lie, and (E,) what that costs."""
        a, b = self.vertices[edges[:, 0]], self.vertices[edges[:, 1]]
        q = self.quadrics[edges[:, 0]] + self.quadrics[edges[:, 1]]
        middle, length = (a + b) / 2, ((a - b) ** 2).sum(axis=1)
        soft = _SOFT * (q[:, 0] + q[:, 4] + q[:, 7]) + 1e-300
        # relative to the middle, where numbers are small
        g = np.stack(
            [
                q[:, 0] * middle[:, 0] + q[:, 1] * middle[:, 1] + q[:, 2] * middle[:, 2] + q[:, 3],
                q[:, 1] * middle[:, 0] + q[:, 4] * middle[:, 1] + q[:, 5] * middle[:, 2] + q[:, 6],
                q[:, 2] * middle[:, 0] + q[:, 5] * middle[:, 1] + q[:, 7] * middle[:, 2] + q[:, 8],
            ],
            axis=1,
        )
        step = -_solved(q[:, 0] + soft, q[:, 1], q[:, 2], q[:, 4] + soft, q[:, 5], q[:, 7] + soft, g)
        far = (step**2).sum(axis=1) > length
        step[far] = 0
        at = middle + step
        best, cost = at, _error(q, at)
        for end in (a, b):
            other = _error(q, end)
            nearer = other < cost * (1 - 1e-9) - 1e-300
            best, cost = np.where(nearer[:, None], end, best), np.where(nearer, other, cost)
        return best, cost + _LONG * length * (q[:, 0] + q[:, 4] + q[:, 7])

    def _apart(self, edges: Int) -> Int:
        """Rows of edges, cheapest first, that share no face with the faces of one before them that is taken."""
        rank = np.arange(len(edges))
        least = np.full(len(self.vertices), len(edges), np.int64)
        np.minimum.at(least, edges.ravel(), np.repeat(rank, 2))
        around = least[self.faces].min(axis=1)
        most = np.full(len(self.vertices), -1, np.int64)
        np.maximum.at(most, self.faces.ravel(), np.repeat(around, 3))
        return np.flatnonzero((most[edges[:, 0]] == rank) & (most[edges[:, 1]] == rank))

    def _joins_no_sheets(self, edges: Int, count: Int) -> Mask:
        """(E,) whether an edge's ends share no neighbours but those across its own faces."""
        from scipy.sparse import coo_matrix

        n, f = len(self.vertices), self.faces
        pairs = np.concatenate([f[:, [0, 1]], f[:, [1, 2]], f[:, [2, 0]]])
        pairs = np.concatenate([pairs, pairs[:, ::-1]])
        graph = coo_matrix((np.ones(len(pairs), np.int32), (pairs[:, 0], pairs[:, 1])), shape=(n, n)).tocsr()
        graph.data[:] = 1
        shared = np.asarray(graph[edges[:, 0]].multiply(graph[edges[:, 1]]).sum(axis=1)).ravel()
        return np.asarray(shared <= count)

    def _at_seams(self, edges: Int, count: Int, rows: Int) -> Mask:
        """(R,) of some edges, whether sheets may be joined there: both ends lie on edges without two faces."""
        if not self.joins_seams:
            return np.zeros(len(rows), bool)
        open_ends = np.zeros(len(self.vertices), bool)
        open_ends[edges[count != 2]] = True
        return np.asarray(open_ends[edges[rows]].all(axis=1))

    def _turns_nothing(self, edges: Int, at: F64) -> Mask:
        """(E,) whether every face that stays keeps its side; an edge's faces are touched by it alone."""
        owner = np.full(len(self.vertices), -1, np.int64)
        owner[edges.ravel()] = np.repeat(np.arange(len(edges)), 2)
        own = owner[self.faces]
        touched = np.flatnonzero((own >= 0).sum(axis=1) == 1)
        moved = self.vertices.copy()
        moved[edges[:, 0]] = moved[edges[:, 1]] = at
        f = self.faces[touched]
        old, new = triangles.crossed(self.vertices[f]), triangles.crossed(moved[f])
        lengths = np.linalg.norm(old, axis=1) * np.linalg.norm(new, axis=1)
        turned = ((old * new).sum(axis=1) < TUNING.fewer_flipped * lengths) | (lengths <= 0)
        fits = np.ones(len(edges), bool)
        fits[own[touched[turned]].max(axis=1)] = False
        return fits

    def _collapse(self, edges: Int, at: F64) -> None:
        a, b = edges[:, 0], edges[:, 1]
        self.vertices[a] = at
        self.quadrics[a] += self.quadrics[b]
        into = np.arange(len(self.vertices))
        into[b] = a
        f = into[self.faces]
        self.faces = f[(f[:, 0] != f[:, 1]) & (f[:, 1] != f[:, 2]) & (f[:, 2] != f[:, 0])]


def _edges(f: Int, n: int) -> tuple[Int, Int, Int]:
    """(E, 2) edges, lower vertex first; (E,) a face of each; (E,) how many faces it has."""
    half = np.concatenate([f[:, [0, 1]], f[:, [1, 2]], f[:, [2, 0]]])
    low, high = half.min(axis=1), half.max(axis=1)
    key, first, count = np.unique(low * n + high, return_index=True, return_counts=True)
    return np.stack([key // n, key % n], axis=1), first % len(f), count


def _planes(unit: F64, at: F64, weight: F64) -> F64:
    """(P, 10) quadrics of planes through points."""
    p = np.concatenate([unit, -(unit * at).sum(axis=1, keepdims=True)], axis=1)
    i, j = np.triu_indices(4)
    return np.asarray(p[:, i] * p[:, j] * weight[:, None])


def _add(quadrics: F64, corners: Int, of: F64) -> None:
    """To each corner (P, k) its plane's quadric (P, 10)."""
    for k in range(10):
        for c in range(corners.shape[1]):
            quadrics[:, k] += np.bincount(corners[:, c], of[:, k], minlength=len(quadrics))


def _error(q: F64, p: F64) -> F64:
    """(E,) what points (E, 3) cost by quadrics (E, 10)."""
    x, y, z = p.T
    squares = q[:, 0] * x * x + q[:, 4] * y * y + q[:, 7] * z * z + q[:, 9]
    mixed = q[:, 1] * x * y + q[:, 2] * x * z + q[:, 5] * y * z + q[:, 3] * x + q[:, 6] * y + q[:, 8] * z
    return np.asarray(np.maximum(squares + 2 * mixed, 0))


def _solved(xx: F64, xy: F64, xz: F64, yy: F64, yz: F64, zz: F64, g: F64) -> F64:
    """(E, 3) solutions of symmetric 3x3 systems, by cofactors."""
    a, b, c = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
    d, e, h = xx * zz - xz * xz, xy * xz - xx * yz, xx * yy - xy * xy
    det = xx * a + xy * b + xz * c
    det = np.where(np.abs(det) > 0, det, np.inf)
    x, y, z = g.T
    return np.stack([a * x + b * y + c * z, b * x + d * y + e * z, c * x + e * y + h * z], axis=1) / det[:, None]
