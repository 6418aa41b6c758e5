"""The scene of tests that run commands: it renders in a blink."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mirelight.io import splats
from mirelight.io.gltf.write import write_glb
from mirelight.model import PointLight, ProxyMesh, SplatCloud


def write_ball(folder: Path) -> None:
    """splats.ply, a ball, and proxy.glb, a floor with a lamp."""
    rng = np.random.default_rng(1)
    means = rng.normal(size=(300, 3))
    cloud = SplatCloud(
        means=(means / np.linalg.norm(means, axis=1, keepdims=True)).astype(np.float32),
        quats=np.tile(np.array([1, 0, 0, 0], dtype=np.float32), (300, 1)),
        scales=np.full((300, 3), 0.1, dtype=np.float32),
        opacities=np.full(300, 0.9, dtype=np.float32),
        sh=rng.normal(size=(300, 1, 3)).astype(np.float32),
    )
    splats.write(cloud, folder / "splats.ply")
    floor = ProxyMesh(
        vertices=np.array([[-3, -1, -3], [3, -1, -3], [3, -1, 3], [-3, -1, 3]], dtype=np.float32),
        faces=np.array([[0, 2, 1], [0, 3, 2]], dtype=np.int32),
    )
    write_glb(
        folder / "proxy.glb", floor, [PointLight(name="lamp", position=np.array([1.0, 3.0, 1.0]), intensity=20.0)]
    )
