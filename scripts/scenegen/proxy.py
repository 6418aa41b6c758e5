"""The proxy: the true surface seen through a grid, as a reconstruction from depth would give it, and simplified."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirelight.model import ProxyMesh
from scenegen.geometry import noise
from scenegen.recipe import Recipe
from scenegen.surfels import Points, Triangles
from scenegen.truth import Looks, Truth

F64 = NDArray[np.float64]
BAND = 2  # cells on either side of the surface that carry distances
WOBBLE = 0.10  # cells of smooth noise added to the distance
LEAST_PIECE = 60  # triangles; smaller floating pieces are dropped


def open_surface(
    points: Points, truth: Truth, rng: np.random.Generator, rays: int = 12, reach: float = 0.5
) -> NDArray[np.bool_]:
    """Which points (N,) face open space: some ray from them runs `reach` metres. The rest is inside of solids."""
    free = np.zeros(len(points), np.bool_)
    for side in (1.0, -1.0):
        normal = points.normals * side
        start = (points.positions + normal * 1e-3).astype(np.float32)
        for _ in range(rays):
            d = normal + rng.normal(size=normal.shape) * 0.55
            d /= np.linalg.norm(d, axis=1, keepdims=True)
            free |= ~truth.hits(start, d.astype(np.float32), np.full(len(points), reach, np.float32))
        if side > 0:
            front = free.copy()
            free[:] = False
    return np.asarray(front)


def reconstruct(recipe: Recipe, looks: Looks, truth: Truth) -> ProxyMesh:
    """A gray triangle mesh of everything solid, wrong by a fraction of a cell as captured proxies are."""
    import fast_simplification
    from scipy import ndimage
    from scipy.spatial import cKDTree
    from skimage.measure import marching_cubes

    rng = np.random.default_rng(5)
    triangles = Triangles.of([s for s in looks.soups if s.solid])
    points = triangles.points(triangles.spread(4.0 / recipe.cell**2, rng), rng)
    points = points.where(open_surface(points, truth, rng))
    low = points.positions.min(axis=0) - (BAND + 2) * recipe.cell
    size = np.ceil((points.positions.max(axis=0) - low) / recipe.cell).astype(int) + BAND + 3
    near = np.zeros(size, np.bool_)
    cell = np.floor((points.positions - low) / recipe.cell).astype(int)
    near[tuple(cell.T)] = True
    near = ndimage.binary_dilation(near, iterations=BAND, structure=np.ones((3, 3, 3)))
    index = np.argwhere(near)
    centre = low + index * recipe.cell
    distance = _signed_distance(cKDTree(points.positions), points, centre, recipe.cell)
    distance += WOBBLE * recipe.cell * noise(centre / (6 * recipe.cell), 3, octaves=2)
    field = np.zeros(size, np.float32)
    field[near] = distance
    field[~near] = 10 * recipe.cell
    known = near & (np.abs(field) < (BAND + 0.5) * recipe.cell)
    vertices, faces, _, _ = marching_cubes(field, 0.0, mask=known, gradient_direction="ascent")
    vertices, faces = _without_crumbs(vertices, faces)
    vertices = (low + vertices * recipe.cell).astype(np.float32)
    if len(faces) > recipe.proxy_faces:
        vertices, faces = fast_simplification.simplify(
            vertices, faces.astype(np.int32), target_count=recipe.proxy_faces, agg=4
        )
    return ProxyMesh(vertices=vertices, faces=faces)


def _signed_distance(tree: Any, points: Points, centres: F64, cell: float) -> F64:
    """Mean plane distance to the four nearest points, those that face the same way as the nearest."""
    out = np.empty(len(centres))
    for start in range(0, len(centres), 500_000):
        part = slice(start, start + 500_000)
        near, index = tree.query(centres[part], k=4, workers=2)
        normal = points.normals[index]
        plane = np.einsum("nkj,nkj->nk", centres[part][:, None] - points.positions[index], normal)
        like = np.einsum("nkj,nj->nk", normal, normal[:, 0]) > 0.3
        weight = like * np.exp(-near / (0.5 * cell))
        signed = (plane * weight).sum(axis=1) / np.maximum(weight.sum(axis=1), 1e-30)
        out[part] = np.sign(signed) * np.maximum(np.abs(signed), 0.0)
        far = near[:, 0] > 2 * BAND * cell
        out[part][far] = 10 * cell
    return out


def _without_crumbs(vertices: NDArray[Any], faces: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """The mesh without pieces of fewer than `LEAST_PIECE` triangles."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    n = len(vertices)
    a, b = faces[:, [0, 1]].ravel(), faces[:, [1, 2]].ravel()
    _, label = connected_components(coo_matrix((np.ones(len(a)), (a, b)), shape=(n, n)), directed=False)
    keep = np.bincount(label[faces[:, 0]], minlength=label.max() + 1)[label[faces[:, 0]]] >= LEAST_PIECE
    faces = faces[keep]
    used, renumbered = np.unique(faces, return_inverse=True)
    return vertices[used], renumbered.reshape(-1, 3)
