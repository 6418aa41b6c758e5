"""Which faces of a proxy are mirrors, and that this is kept wherever the mesh goes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from mirelight.estimate.finish import Finish, finished, regions_of
from mirelight.io.gltf.write import write_glb
from mirelight.io.mesh import read_mesh, transform
from mirelight.model import Material, ProxyMesh
from mirelight.model.dressing import Dress, dressed
from mirelight.pipeline.codecs import MESH

TWO = ProxyMesh(
    vertices=np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [0, 1, 1]], np.float32),
    faces=np.array([[0, 1, 2], [3, 4, 5]], np.int32),
)
PANE = np.array([False, True])


def mirrors(mesh: ProxyMesh) -> list[bool]:
    assert mesh.mirrors is not None
    return [bool(x) for x in mesh.mirrors]


def test_faces_are_marked_and_others_keep_their_materials() -> None:
    assert TWO.mirrors is None
    assert TWO.with_mirrors(np.zeros(2, bool)) is TWO
    painted = replace(
        TWO, materials=(Material(name="wall"), Material(name="door")), face_materials=np.array([1, 0], np.int32)
    )
    made = painted.with_mirrors(PANE)
    assert mirrors(made) == [False, True]
    assert made.materials[made.face_materials[0]].name == "door"  # type: ignore[index]


def test_files_and_kept_meshes_keep_them(tmp_path: Path) -> None:
    write_glb(tmp_path / "room.glb", TWO.with_mirrors(PANE))
    read = read_mesh(tmp_path / "room.glb")
    assert sorted(mirrors(read)) == [False, True]
    assert mirrors(transform(read, np.diag([2.0, 2, 2, 1]))) == mirrors(read)
    assert mirrors(MESH.unpack(MESH.pack(TWO.with_mirrors(PANE)))) == [False, True]
    assert MESH.unpack(MESH.pack(TWO)).mirrors is None


def test_a_smooth_metal_of_another_name_is_none() -> None:
    chrome = replace(TWO, materials=(Material(name="chrome", metallic=1.0, roughness=0.0),))
    assert chrome.mirrors is None
    blind = replace(TWO, materials=(Material(name="mirror", metallic=1.0, roughness=0.4),))
    assert blind.mirrors is None


def test_what_is_said_of_all_is_not_said_of_the_mirror() -> None:
    room = TWO.with_mirrors(PANE)
    assert mirrors(dressed(room, [Dress(roughness=0.4)])) == [False, True]
    assert dressed(room, [Dress(name="mirror", roughness=0.4)]).mirrors is None


def test_materials_that_are_told_from_pictures_leave_it() -> None:
    room = replace(TWO.with_mirrors(PANE), vertex_colors=np.full((6, 3), 0.5, np.float32), albedo=None)
    _, names = regions_of(replace(room, materials=(Material(name="wall"), Material(name="door"), room.materials[1])))
    assert names == ("wall", "door", "mirror")
    made = finished(room, np.array([0, 1], np.int32), [Finish(name, 9, 0.3, 0.0, 0.5) for name in ("wall", "door")])
    assert mirrors(made) == [False, True]
    assert made.materials[made.face_materials[0]].roughness == 0.3  # type: ignore[index]
