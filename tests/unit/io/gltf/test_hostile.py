"""Meshes that mean harm: much memory for few bytes, light without bounds, names that lead elsewhere."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mirelight.base.errors import InputError
from mirelight.io.gltf.scene import read_scene
from mirelight.io.mesh import read_mesh
from mirelight.io.splats import read as read_splats

from .conftest import TRIANGLE

PLY = """\
ply
format ascii 1.0
comment TextureFile {name}
element vertex 3
property float x
property float y
property float z
property float s
property float t
element face 1
property list uchar int vertex_indices
end_header
0 0 0 0 0
1 0 0 1 0
0 1 0 0 1
3 0 1 2
"""


def nothing(glb: Any, count: int, kind: str, code: int = 5126) -> int:
    """An accessor of `count` zeros that no bytes stand behind."""
    return int(glb.put("accessors", {"componentType": code, "count": count, "type": kind}))


def test_gigabytes_of_zeros_are_refused(glb: Any) -> None:
    count = 1 << 26
    primitive = {
        "attributes": {"POSITION": nothing(glb, count, "VEC3")},
        "indices": nothing(glb, count, "SCALAR", 5125),
    }
    glb.node(mesh=glb.mesh(primitive))
    with pytest.raises(InputError, match=r"67108864 elements without a bufferView; at most 64 MiB of such zeros"):
        read_mesh(glb.save())


def test_many_small_accessors_over_nothing_are_refused(glb: Any) -> None:
    count = 1 << 20
    targets = [{"POSITION": nothing(glb, count, "VEC3")} for _ in range(20)]
    glb.node(
        mesh=glb.mesh({"attributes": {"POSITION": nothing(glb, count, "VEC3")}, "targets": targets}, weights=[1] * 20)
    )
    with pytest.raises(InputError, match="without a bufferView"):
        read_mesh(glb.save())


def test_what_a_mesh_takes_is_known_before_it_is_read(glb: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mirelight.io.safety.free_memory", lambda: 10 * 2**20)
    targets = [{"POSITION": glb.accessor(TRIANGLE)}] * 300_000
    glb.node(mesh=glb.mesh(glb.primitive(targets=targets)))
    with pytest.raises(InputError, match="GiB are free"):
        read_mesh(glb.save())


def test_a_million_instances_of_nothing(glb: Any) -> None:
    count = 1 << 20
    attributes = {"TRANSLATION": nothing(glb, count, "VEC3")}
    glb.node(mesh=glb.mesh(glb.primitive()), extensions={"EXT_mesh_gpu_instancing": {"attributes": attributes}})
    mesh = read_mesh(glb.save())
    assert mesh.vertices.shape == (3 * count, 3)
    assert np.array_equal(mesh.faces[-1], 3 * (count - 1) + np.arange(3))


def test_instances_stand_where_each_alone_would(new_glb: Any) -> None:
    rng = np.random.default_rng(0)
    count = 7
    parts = {
        "TRANSLATION": rng.normal(size=(count, 3)).astype(np.float32),
        "ROTATION": rng.normal(size=(count, 4)).astype(np.float32),
        "SCALE": rng.normal(size=(count, 3)).astype(np.float32),  # some mirror
    }
    normals = np.tile(np.array([0.6, 0, 0.8], dtype=np.float32), (3, 1))
    glb = new_glb()
    instancing = {"attributes": {name: glb.accessor(values) for name, values in parts.items()}}
    mesh = glb.mesh(glb.primitive(attributes={"NORMAL": glb.accessor(normals)}))
    glb.node(mesh=mesh, translation=[1, 2, 3], extensions={"EXT_mesh_gpu_instancing": instancing})
    together = read_mesh(glb.save("together.glb"))
    glb = new_glb()
    mesh = glb.mesh(glb.primitive(attributes={"NORMAL": glb.accessor(normals)}))
    rows = [
        glb.node(root=False, mesh=mesh, **{name.lower(): values[i].tolist() for name, values in parts.items()})
        for i in range(count)
    ]
    glb.node(translation=[1, 2, 3], children=rows)
    alone = read_mesh(glb.save("alone.glb"))
    assert np.array_equal(together.faces, alone.faces)
    assert np.allclose(together.vertices, alone.vertices, atol=1e-6)
    assert together.normals is not None and alone.normals is not None
    assert np.allclose(together.normals, alone.normals, atol=1e-6)


def test_instances_of_length_zero_or_at_infinity(new_glb: Any) -> None:
    for name, values, message in (
        ("ROTATION", np.zeros((2, 4)), "length zero"),
        ("SCALE", np.full((2, 3), 3e38), "not finite in world space"),
    ):
        glb = new_glb()
        attributes = {name: glb.accessor(values.astype(np.float32))}
        mesh = glb.mesh(glb.primitive(TRIANGLE * np.float32(10)))
        glb.node(mesh=mesh, extensions={"EXT_mesh_gpu_instancing": {"attributes": attributes}})
        with pytest.raises(InputError, match=message):
            read_mesh(glb.save())


def test_weights_that_move_vertices_to_infinity(glb: Any) -> None:
    target = {"POSITION": glb.accessor(TRIANGLE)}
    glb.node(mesh=glb.mesh(glb.primitive(targets=[target]), weights=[1e308]))
    with pytest.raises(InputError, match=r"meshes\[0\]\.weights: weights up to 1e\+308 move vertices to infinity"):
        read_mesh(glb.save())


@pytest.mark.parametrize("field", ["intensity", "emissiveFactor", "emissiveStrength"])
def test_light_without_bounds(glb: Any, field: str) -> None:
    material: dict[str, Any] = {"emissiveFactor": [1e308 if field == "emissiveFactor" else 1, 1, 1]}
    if field == "emissiveStrength":
        material["extensions"] = {"KHR_materials_emissive_strength": {"emissiveStrength": 1e308}}
    glb.node(mesh=glb.mesh(glb.primitive(material=glb.put("materials", material))))
    glb.light(type="point", intensity=1e308 if field == "intensity" else 1.0)
    with pytest.raises(InputError, match=r"1e\+308.* 1e\+12"):
        read_scene(glb.save())


def test_obj_emission_without_bounds(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text("mtllib a.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", encoding="utf-8")
    (tmp_path / "a.mtl").write_text("newmtl m\nKe 1e308 0 0\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"a\.mtl: line 2: a colour '1e308 0 0'"):
        read_mesh(tmp_path / "a.obj")


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("/etc/passwd", "not a relative path"),
        ("../skin.png", "leaves the folder"),
        ("link.png", "leaves the folder"),
        ("pipe", "pipe: not a file; a folder, a pipe or a device cannot be read"),
        ("folder", "folder: not a file"),
        ("\x1b[2J", r"x1b\[2J: cannot be read"),
    ],
)
def test_texture_names_of_a_ply(tmp_path: Path, name: str, message: str) -> None:
    folder = tmp_path / "mesh"
    (folder / "folder").mkdir(parents=True)
    os.mkfifo(folder / "pipe")
    (tmp_path / "skin.png").write_bytes(b"secret")
    (folder / "link.png").symlink_to(tmp_path / "skin.png")
    (folder / "a.ply").write_text(PLY.format(name=name), encoding="utf-8")
    with pytest.raises(InputError, match=message) as caught:
        read_mesh(folder / "a.ply")
    assert str(caught.value).isprintable()


@pytest.mark.parametrize("suffix", ["obj", "stl", "ply"])
def test_terabytes_of_nothing(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a.{suffix}"
    with path.open("wb") as file:
        file.truncate(2**42)
    with pytest.raises(InputError, match="GiB"):
        read_mesh(path)


def test_splats_by_thousands_of_instances(glb: Any) -> None:
    names = {"POSITION": 3, "KHR_gaussian_splatting:ROTATION": 4, "KHR_gaussian_splatting:SCALE": 3}
    names |= {"KHR_gaussian_splatting:OPACITY": 1, "KHR_gaussian_splatting:SH_DEGREE_0_COEF_0": 3}
    attributes = {name: glb.accessor(np.ones((1, width), dtype=np.float32)) for name, width in names.items()}
    extension = {"KHR_gaussian_splatting": {"kernel": "ellipse", "colorSpace": "srgb_rec709_display"}}
    instancing = {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": nothing(glb, 1 << 20, "VEC3")}}}
    mesh = glb.mesh({"attributes": attributes, "mode": 0, "extensions": extension})
    glb.node(mesh=mesh, extensions=instancing)
    with pytest.raises(InputError, match="1048576 instances of splats; at most 1000 are read"):
        read_splats(glb.save())
