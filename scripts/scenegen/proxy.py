"""The proxy: the true surface without what is too thin for a reconstruction, simplified and slightly wrong."""

from __future__ import annotations

import importlib

import numpy as np

from mirelight.model import ProxyMesh
from scenegen.geometry import noise
from scenegen.recipe import Recipe
from scenegen.truth import Looks

BUMP = 0.5  # metres between bumps of the error


def proxy_of(recipe: Recipe, looks: Looks) -> ProxyMesh:
    """A gray mesh of everything solid: edges collapsed to the recipe's count, vertices off by smooth noise."""
    pyfqmr = importlib.import_module("pyfqmr")

    corners = np.concatenate([s.positions for s in looks.soups if s.solid]).reshape(-1, 3)
    keys = np.round(corners * 1e4).astype(np.int64)  # corners within a tenth of a millimetre are one vertex
    _, first, which = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    faces = which.reshape(-1, 3)
    flat = (faces[:, 0] == faces[:, 1]) | (faces[:, 1] == faces[:, 2]) | (faces[:, 2] == faces[:, 0])
    simplifier = pyfqmr.Simplify()
    simplifier.setMesh(corners[first], faces[~flat])
    simplifier.simplify_mesh(target_count=recipe.proxy_faces, aggressiveness=3, preserve_border=True, verbose=False)
    vertices, faces, _ = simplifier.getMesh()
    error = np.stack([noise(vertices / BUMP, seed, octaves=3) for seed in (1, 2, 3)], axis=1)
    used, faces = np.unique(faces, return_inverse=True)
    moved = (vertices + recipe.proxy_error * error)[used]
    return ProxyMesh(vertices=moved.astype(np.float32), faces=faces.reshape(-1, 3).astype(np.int32))
