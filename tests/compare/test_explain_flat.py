"""A proxy without normals is flat, to the engine as well."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mirelight.apps.realtime import bundle, engine
from mirelight.io.gltf.scene import read_scene
from mirelight.model import Camera, Deferred, DirectionalLight, Job, Lighting, ProxyMesh


def test_a_flat_proxy_is_exported_flat(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    files = tmp_path / "engine-files"
    files.mkdir()
    for name in engine.FILES.values():
        (files / name).write_text("")
    monkeypatch.setattr(engine, "install", lambda: files)
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=np.float32)
    folded = ProxyMesh(vertices=corners, faces=np.array([[0, 1, 2], [0, 3, 1]], dtype=np.int32))  # share an edge
    job = Job(source=Path("made.toml"), proxy=Deferred.of(folded))
    camera = Camera.look_at((0.3, 2, 3), (0, 0, 0), 32, 24, yfov=40)
    light = DirectionalLight(name="sun", direction=np.array([0.0, -1, 0]))
    bundle.export(job, camera, Lighting(lights=(light,)), tmp_path / "page")
    mesh = read_scene(tmp_path / "page" / "proxy.glb").mesh
    assert mesh is not None
    assert mesh.normals is not None
    np.testing.assert_allclose(mesh.vertices[mesh.faces], corners[folded.faces], atol=1e-6)
    np.testing.assert_allclose(mesh.normals[mesh.faces][0], [[0, 0, 1]] * 3, atol=1e-6)
    np.testing.assert_allclose(mesh.normals[mesh.faces][1], [[0, 1, 0]] * 3, atol=1e-6)
