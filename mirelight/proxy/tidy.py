"""Tidying a mesh: crumbs dropped, small holes closed, ripples smoothed away."""

from __future__ import annotations

import numpy as np

from mirelight.model import F64
from mirelight.proxy.tuning import TUNING
from mirelight.proxy.types import Int, Soup

_SHRINK, _GROW = 0.5, -0.53  # Taubin's two factors: what one takes from large shapes, the other gives back


def without_crumbs(soup: Soup) -> Soup:
    """Connected parts of fewer than `tidy_fewest_faces` of `TUNING` dropped; the largest stays in any case."""
    if not len(soup.faces):
        return soup
    part = parts_of(soup.faces)
    count = np.bincount(part)
    return compact(Soup(soup.vertices, soup.faces[count[part] >= min(TUNING.tidy_fewest_faces, int(count.max()))]))


def parts_of(faces: Int) -> Int:
    """(F,) which part each face belongs to: faces that share a vertex are connected."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]]])
    n = int(faces.max(initial=-1)) + 1
    graph = coo_matrix((np.ones(len(edges), np.int8), (edges[:, 0], edges[:, 1])), shape=(n, n))
    return np.asarray(connected_components(graph, directed=False)[1][faces[:, 0]], np.int64)


def compact(soup: Soup) -> Soup:
    """Without vertices that no face uses, and without faces that use a vertex twice."""
    f = soup.faces
    f = f[(f[:, 0] != f[:, 1]) & (f[:, 1] != f[:, 2]) & (f[:, 2] != f[:, 0])]
    used = np.zeros(len(soup.vertices), bool)
    used[f.ravel()] = True
    return Soup(soup.vertices[used], (np.cumsum(used) - 1)[f])


def closed(soup: Soup, longest: int = TUNING.tidy_longest_rim) -> Soup:
    """Holes with a rim of at most so many edges filled by a fan around the rim's middle."""
    following = _rims(soup.faces)
    vertices, faces, extra = [soup.vertices], [soup.faces], len(soup.vertices)
    todo = set(following)
    for start in sorted(following):
        if start not in todo:
            continue
        loop: list[int] = []
        at = start
        while at in todo and len(loop) <= longest:
            todo.discard(at)
            loop.append(at)
            at = following[at]
        if at != start or not 3 <= len(loop) <= longest:
            continue
        rim = np.array(loop)
        vertices.append(soup.vertices[rim].mean(axis=0)[None])
        faces.append(np.stack([np.roll(rim, -1), rim, np.full(len(rim), extra)], axis=1))
        extra += 1
    return Soup(np.concatenate(vertices), np.concatenate(faces))


def _rims(faces: Int) -> dict[int, int]:
    """The next vertex along the rim of each vertex that lies on one and only one, in the direction of its faces."""
    half = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    n = int(faces.max(initial=0)) + 1
    there, back = half[:, 0] * n + half[:, 1], half[:, 1] * n + half[:, 0]
    open_edges = half[~np.isin(there, back)]
    count = np.bincount(open_edges[:, 0], minlength=n)
    once = open_edges[count[open_edges[:, 0]] == 1]
    return dict(zip(once[:, 0].tolist(), once[:, 1].tolist(), strict=True))


def smoothed(soup: Soup) -> Soup:
    """Taubin smoothing (1995): a step towards the neighbours' mean and one away, so that the shape does not shrink.

    Vertices on a rim stay.
    """
    from scipy.sparse import coo_matrix, diags

    f, n = soup.faces, len(soup.vertices)
    if not n:
        return soup
    edges = np.concatenate([f[:, [0, 1]], f[:, [1, 2]], f[:, [2, 0]]])
    edges = np.concatenate([edges, edges[:, ::-1]])
    graph = coo_matrix((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(n, n)).tocsr()
    rim = np.asarray((graph == 1).sum(axis=1)).ravel() > 0  # an edge of one face alone
    graph.data[:] = 1.0
    mean = diags(1 / np.maximum(np.asarray(graph.sum(axis=1)).ravel(), 1)) @ graph
    v: F64 = soup.vertices
    for _ in range(TUNING.tidy_rounds):
        for factor in (_SHRINK, _GROW):
            step = mean @ v - v
            step[rim] = 0
            v = v + factor * step
    return Soup(v, f)
