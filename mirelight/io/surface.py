"""Normals of triangle meshes, shared by the mesh readers."""

from __future__ import annotations

import numpy as np

from mirelight.model import F32, F64, I32, triangles


def flat_shaded(vertices: F32, faces: I32) -> tuple[I32, F32]:
    """Vertex order (3 F,) that gives every face its own vertices, and their normals (3 F, 3)."""
    normals = np.repeat(_unit(_crossed(vertices, faces)), 3, axis=0)
    return faces.reshape(-1), normals


def filled_normals(vertices: F32, faces: I32, normals: F32) -> F32:
    """(V, 3) unit normals, with those of length zero replaced by the mean of the faces around them.

    Normals that are already unit to single precision are left as they are, bit for bit.
    """
    length = np.linalg.norm(normals.astype(np.float64), axis=1)
    off = np.abs(length - 1) > 1e-4
    if not bool(off.any()):
        return normals
    out = normals.copy()
    out[off] = _unit(normals[off].astype(np.float64))
    zero = length < 1e-12
    if bool(zero.any()):
        around = np.zeros((len(vertices), 3))
        touching = faces[zero[faces].any(axis=1)]
        for i in range(3):
            np.add.at(around, touching[:, i], _crossed(vertices, touching))
        out[zero] = _unit(around[zero])
    return out


def _crossed(vertices: F32, faces: I32) -> F64:
    """(F, 3) normals of faces, as long as twice their areas."""
    return triangles.crossed(vertices[faces].astype(np.float64))


def _unit(vectors: F64) -> F32:
    """Each row scaled to length 1; rows of length zero become +Y."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    flat = length[:, 0] < 1e-300
    out = vectors / np.where(flat[:, None], 1.0, length)
    out[flat] = (0.0, 1.0, 0.0)
    return out.astype(np.float32)


def transformed_normals(normals: F32, linear: F64) -> F32:
    """Unit normals (V, 3) under linear maps (3, 3) or one per vertex (V, 3, 3): the inverse transpose, normalised.

    Written with cofactors, det(M) M^-T, which also exist where the map flattens the mesh.
    """
    a, b, c = linear[..., 0, :], linear[..., 1, :], linear[..., 2, :]
    cofactor = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=-2)
    turned = np.einsum("...ij,...j->...i", cofactor, normals.astype(np.float64))
    sign = np.where(np.linalg.det(linear) < 0, -1.0, 1.0)
    length = np.linalg.norm(turned, axis=-1) * sign
    return np.asarray(turned / np.where(length != 0, length, 1.0)[..., None], dtype=np.float32)
