"""The part of a true surface that splats tell of: what a proxy made from them can have at most."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from mirelight.model import ProxyMesh, SplatCloud

EDGE = 0.0045  # of the capture's size, 6 cm of 13 m: pieces are small enough to be seen or not
REACH = 0.006  # of its size, 8 cm of 13 m: how near a splat's centre comes to the middle of a piece that was seen

F64 = NDArray[np.float64]
Int = NDArray[np.int64]


def seen_of(mesh: ProxyMesh, splats: SplatCloud, size: float) -> ProxyMesh:
    """The part of a mesh that has splats near it: faces that were seen all over, and pieces of the others.

    Args:
        mesh: vertices and faces; the rest is left out.
        splats: whose centres tell what was seen.
        size: of the capture, world units.
    """
    whole = mesh.vertices[mesh.faces].astype(np.float64)
    pieces, face = split(whole, EDGE * size)
    away, _ = cKDTree(splats.means).query(pieces.mean(axis=1), distance_upper_bound=REACH * size, workers=2)
    near = np.isfinite(away)
    broken = np.zeros(len(whole), bool)
    broken[face[~near]] = True
    corners = np.concatenate([whole[~broken], pieces[near & broken[face]]])
    vertices, faces = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    return ProxyMesh(vertices=vertices.astype(np.float32), faces=faces.reshape(-1, 3).astype(np.int32))


def split(corners: F64, longest: float) -> tuple[F64, Int]:
    """Triangles (F, 3, 3) halved across their longest edge until none is longer; and (G,) which each piece is of.

    Both sides of an edge halve it at the same points, so no seam opens.
    """
    done, of, face = list[F64](), list[Int](), np.arange(len(corners))
    while len(corners):
        length = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
        side = length.argmax(axis=1)
        small = length[np.arange(len(corners)), side] <= longest
        done.append(corners[small])
        of.append(face[small])
        side, corners, face = side[~small, None], corners[~small], face[~small]
        a, b, c = (np.take_along_axis(corners, ((side + k) % 3)[:, :, None], axis=1)[:, 0] for k in range(3))
        middle = (a + b) / 2
        corners = np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
        face = np.concatenate([face, face])
    return np.concatenate(done), np.concatenate(of)
