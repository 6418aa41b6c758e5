"""The proxy: the true surface, what is solid of it simplified, and all of it slightly wrong."""

from __future__ import annotations

import importlib

import numpy as np
from numpy.typing import NDArray

from mirelight.model import ProxyMesh
from scenegen.geometry import F64, I64, noise
from scenegen.recipe import Recipe
from scenegen.truth import Looks

BUMP = 0.5  # metres between bumps of the error
WELDS = 1e4  # per metre: corners within a tenth of a millimetre are one vertex
LEAF = 4  # triangles of a leaf of `geometry.leaves`


def proxy_of(recipe: Recipe, looks: Looks) -> ProxyMesh:
    """A gray mesh: what is solid has its edges collapsed to the recipe's count; leaves, bars and wires stay.

    Vertices are off by smooth noise, so that what is thin is moved and not torn.
    """
    pyfqmr = importlib.import_module("pyfqmr")

    simplifier = pyfqmr.Simplify()
    simplifier.setMesh(*welded(np.concatenate([s.positions for s in looks.soups if s.solid]))[:2])
    simplifier.simplify_mesh(target_count=recipe.proxy_faces, aggressiveness=3, preserve_border=True, verbose=False)
    solid, solid_faces, _ = simplifier.getMesh()
    used, solid_faces = np.unique(solid_faces, return_inverse=True)
    thin, thin_faces, _ = welded(np.concatenate([_unfolded(s.positions) for s in looks.soups if not s.solid]))
    vertices = np.concatenate([solid[used], thin])
    faces = np.concatenate([solid_faces.reshape(-1, 3), thin_faces + len(used)])
    error = np.stack([noise(vertices / BUMP, seed, octaves=3) for seed in (1, 2, 3)], axis=1)
    moved = vertices + recipe.proxy_error * error
    return ProxyMesh(vertices=moved.astype(np.float32), faces=faces.astype(np.int32))


def welded(triangles: F64) -> tuple[F64, I64, NDArray[np.bool_]]:
    """Vertices (V, C) and faces (F, 3) of triangles (N, 3, C), those without area left out; and (N,) which are left."""
    corners = triangles.reshape(-1, triangles.shape[2])
    keys = np.round(corners * WELDS).astype(np.int64)
    _, first, which = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    faces = which.reshape(-1, 3)
    flat = (faces[:, 0] == faces[:, 1]) | (faces[:, 1] == faces[:, 2]) | (faces[:, 2] == faces[:, 0])
    return corners[first], faces[~flat], ~flat


def _unfolded(triangles: F64) -> F64:
    """Leaves without the vertex in their middle: two triangles for four. Other triangles (N, 3, 3) as they are."""
    if len(triangles) % LEAF:
        return triangles
    parts = triangles.reshape(-1, LEAF, 3, 3)
    middle = parts[:, [0, 1, 2, 3], [2, 1, 2, 0]]
    if not (middle == middle[:, :1]).all():
        return triangles
    base, right, left, tip = parts[:, 0, 0], parts[:, 0, 1], parts[:, 1, 2], parts[:, 2, 1]
    return np.stack([base, right, tip, base, tip, left], axis=1).reshape(-1, 3, 3)
