"""A corner of two walls in splats, and the mesh below them: what the mixer's tests light."""

from __future__ import annotations

import numpy as np

from mirelight.base import sh
from mirelight.model import ProxyMesh, SplatCloud


def walls(side: int = 40) -> tuple[SplatCloud, ProxyMesh]:
    """A floor and a wall of `side` x `side` flat splats each, in a coarse pattern, and the mesh below them."""
    s = np.linspace(-1.95, 1.95, side)
    wide, thin = 3.2 / side, 0.08 / side
    a, b = (x.ravel() for x in np.meshgrid(s, s))
    floor = np.stack([a, np.zeros_like(a), b], axis=1)
    wall = np.stack([a, b + 2, np.full_like(a, -2)], axis=1)
    pattern = np.where((np.floor(a) + np.floor(b)) % 2 > 0, 0.7, 0.4)
    shown = np.concatenate([pattern[:, None] * [1, 0.9, 0.8], pattern[:, None] * [0.7, 0.9, 1]])
    flat = np.tile([[wide, thin, wide]], (len(a), 1)), np.tile([[wide, wide, thin]], (len(a), 1))
    count = 2 * len(a)
    cloud = SplatCloud(
        means=np.concatenate([floor, wall]).astype(np.float32),
        quats=np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1)),
        scales=np.concatenate(flat).astype(np.float32),
        opacities=np.full(count, 0.95, np.float32),
        sh=((shown - 0.5) / sh.C0)[:, None].astype(np.float32),
    )
    corners = [[-2, 0, -2], [2, 0, -2], [2, 0, 2], [-2, 0, 2], [-2, 4, -2], [2, 4, -2]]
    faces = [[0, 2, 1], [0, 3, 2], [0, 1, 5], [0, 5, 4]]
    return cloud, ProxyMesh(vertices=np.array(corners, np.float32), faces=np.array(faces, np.int32))
