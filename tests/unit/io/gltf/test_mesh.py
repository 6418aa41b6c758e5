"""Meshes of every format as proxies."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

from mirelight.base import colour, conventions
from mirelight.base.errors import InputError
from mirelight.io.mesh import companions, read_mesh, transform
from mirelight.model import ProxyMesh

SPHERE = trimesh.creation.icosphere(subdivisions=2)
FUZZ = settings(
    max_examples=150, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture]
)

OBJ = """mtllib scene.mtl
v 0 0 0
v 1 0 0
v 0 1 0
v 1 1 0
vt 0 0
vt 1 0
vt 0 1
vn 0 0 1
usemtl tiled
f 1/1/1 2/2/1 3/3/1
usemtl plain
f 2/2/1 4/1/1 3/3/1
"""
MTL = "newmtl tiled\nKd 1 1 1\nmap_Kd tiles.png\nnewmtl plain\nKd 0.2 0.4 0.6\n"


def test_ply_keeps_vertices_normals_and_colours(tmp_path: Path) -> None:
    mesh = SPHERE.copy()
    colors = np.random.default_rng(0).integers(0, 256, (len(mesh.vertices), 4)).astype(np.uint8)
    mesh.visual.vertex_colors = colors
    for encoding in ("binary", "ascii"):
        mesh.export(tmp_path / "a.ply", encoding=encoding, vertex_normal=True)
        found = read_mesh(tmp_path / "a.ply")
        assert np.allclose(found.vertices, mesh.vertices, atol=1e-6)
        assert np.array_equal(found.faces, mesh.faces)
        assert found.normals is not None and np.allclose(found.normals, mesh.vertex_normals, atol=1e-6)
        assert found.vertex_colors is not None
        assert np.array_equal(found.vertex_colors, colour.srgb_decode(colors[:, :3] / np.float32(255)))


def test_ply_without_normals_is_flat(tmp_path: Path) -> None:
    SPHERE.export(tmp_path / "a.ply", vertex_normal=False)
    found = read_mesh(tmp_path / "a.ply")
    assert found.normals is None and found.vertex_colors is None


def test_stl(tmp_path: Path) -> None:
    for name, kind in (("a.stl", "stl"), ("b.STL", "stl_ascii")):
        SPHERE.export(tmp_path / name, file_type=kind)
        found = read_mesh(tmp_path / name)
        assert np.allclose(found.vertices[found.faces], SPHERE.vertices[SPHERE.faces], atol=1e-5)


def test_obj_with_materials(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text(OBJ, encoding="utf-8")
    (tmp_path / "scene.mtl").write_text(MTL, encoding="utf-8")
    pixels = np.random.default_rng(0).integers(0, 256, (4, 8, 3)).astype(np.uint8)
    Image.fromarray(pixels).save(tmp_path / "tiles.png")
    mesh = read_mesh(tmp_path / "a.obj")
    materials = {m.name: m for m in mesh.materials}
    assert materials["plain"].base_color.tolist() == pytest.approx([0.2, 0.4, 0.6], abs=1e-3)
    texture = materials["tiled"].base_color_texture
    assert texture is not None
    assert np.array_equal(texture, colour.srgb_decode(pixels / np.float32(255)))
    assert mesh.face_materials is not None and mesh.uvs is not None and mesh.normals is not None
    for face, owner in zip(mesh.faces, mesh.face_materials, strict=True):
        corners = {tuple(mesh.vertices[i].tolist()): tuple(mesh.uvs[i].tolist()) for i in face}
        if mesh.materials[owner].name == "tiled":  # OBJ counts v from the bottom, glTF from the top
            assert corners == {(0, 0, 0): (0, 1), (1, 0, 0): (1, 1), (0, 1, 0): (0, 0)}
    assert np.allclose(mesh.normals, (0, 0, 1))
    plain = read_mesh(tmp_path / "a.obj", textures=False)
    assert all(m.base_color_texture is None for m in plain.materials)


def test_obj_emission_and_its_texture(tmp_path: Path) -> None:
    """map_Ke multiplies Ke, and stands for itself without it; every file is named for the fingerprint."""
    (tmp_path / "a.obj").write_text(OBJ, encoding="utf-8")
    library = "newmtl tiled\nKe 3 2 1\nmap_Ke tiles.png\nnewmtl plain\nmap_Ke tiles.png\n"
    (tmp_path / "scene.mtl").write_text(library, encoding="utf-8")
    pixels = np.random.default_rng(0).integers(0, 256, (4, 8, 3)).astype(np.uint8)
    Image.fromarray(pixels).save(tmp_path / "tiles.png")
    materials = {m.name: m for m in read_mesh(tmp_path / "a.obj").materials}
    assert [materials[name].emissive.tolist() for name in ("tiled", "plain")] == [[3, 2, 1], [1, 1, 1]]
    for found in materials.values():
        assert found.emissive_texture is not None and found.base_color_texture is None
        assert np.array_equal(found.emissive_texture, colour.srgb_decode(pixels / np.float32(255)))
    assert tmp_path / "tiles.png" in companions(tmp_path / "a.obj")


def test_obj_polygons_and_vertex_colours(tmp_path: Path) -> None:
    text = "v 0 0 0 1 0.5 0\nv 1 0 0 1 0.5 0\nv 1 1 0 1 0.5 0\nv 0 1 0 1 0.5 0\nf 1 2 3 4\n"
    (tmp_path / "a.obj").write_text(text, encoding="utf-8")
    mesh = read_mesh(tmp_path / "a.obj")
    assert len(mesh.faces) == 2 and mesh.vertex_colors is not None
    assert np.allclose(mesh.vertex_colors, colour.srgb_decode([1, 0.5, 0]), atol=5e-3)


@pytest.mark.parametrize("name", ["../scene.mtl", "/etc/passwd", "a/../../scene.mtl"])
def test_an_obj_s_files_stay_in_its_folder(tmp_path: Path, name: str) -> None:
    inner = tmp_path / "inner"
    inner.mkdir()
    (tmp_path / "scene.mtl").write_text(MTL, encoding="utf-8")
    (inner / "a.obj").write_text(OBJ.replace("scene.mtl", name), encoding="utf-8")
    with pytest.raises(InputError, match=r"line 1: .*(leaves the folder|not a relative path)"):
        read_mesh(inner / "a.obj")
    assert len(read_mesh(inner / "a.obj", textures=False).faces) == 2


def test_glb_goes_through_our_reader(glb: Any) -> None:
    glb.node(mesh=glb.mesh(glb.primitive()), translation=[0, 0, 7])
    assert read_mesh(glb.save()).vertices[:, 2].tolist() == [7, 7, 7]


def test_what_is_no_mesh(glb: Any, tmp_path: Path) -> None:
    trimesh.PointCloud(SPHERE.vertices).export(tmp_path / "points.ply")
    (tmp_path / "empty.obj").write_text("", encoding="utf-8")
    (tmp_path / "short.stl").write_bytes(b"\0" * 40)
    (tmp_path / "text.ply").write_text("not a ply", encoding="utf-8")
    (tmp_path / "a.fbx").touch()
    (tmp_path / "dir.obj").mkdir()
    glb.node(mesh=glb.mesh(glb.primitive(mode=0)))
    glb.save("points.glb")
    for name, message in (
        ("points.ply", "no triangles \\(a point cloud"),
        ("points.glb", "no triangles"),
        ("empty.obj", "no triangles|cannot be read"),
        ("short.stl", "40 bytes, less than the header"),
        ("text.ply", "cannot be read"),
        ("a.fbx", "not a mesh file; give one of .glb"),
        ("dir.obj", "not a mesh file"),
        ("absent.ply", "no such file"),
    ):
        with pytest.raises(InputError, match=message):
            read_mesh(tmp_path / name)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_vertices_that_are_not_finite_are_counted(tmp_path: Path, bad: float) -> None:
    mesh = trimesh.Trimesh(np.array([[0, 0, 0], [1, 0, 0], [0, bad, 0.0]]), [[0, 1, 2]], process=False)
    for suffix in ("ply", "stl"):
        with np.errstate(invalid="ignore"):
            mesh.export(tmp_path / f"a.{suffix}")
        with pytest.raises(InputError, match="vertices are NaN or infinite"):
            read_mesh(tmp_path / f"a.{suffix}")


@pytest.mark.parametrize("suffix", ["obj", "ply", "stl", "glb"])
@pytest.mark.parametrize(
    ("corners", "found"),
    [
        ([[0, 0, 0], [1, 1, 1], [2, 2, 2]], "a mesh without area: corners that coincide or lie on a line"),
        ([[0, 0, 0], [1, 0, 0], [0, 2e30, 0]], "corners as far as 2e\\+30 units from the origin; give it in metres"),
    ],
)
def test_meshes_that_light_cannot_fall_on(tmp_path: Path, suffix: str, corners: list[list[float]], found: str) -> None:
    path = tmp_path / f"a.{suffix}"
    trimesh.Trimesh(np.array(corners), [[0, 1, 2]], process=False).export(path)
    with pytest.raises(InputError, match=found):
        read_mesh(path)


def test_a_face_outside_the_vertices(tmp_path: Path) -> None:
    head = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    body = "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 9\n"
    (tmp_path / "a.ply").write_text(head + body, encoding="utf-8")
    with pytest.raises(InputError, match=r"index outside 0\.\.2|cannot be read"):
        read_mesh(tmp_path / "a.ply")


@FUZZ
@given(
    suffix=st.sampled_from([".ply", ".obj", ".stl"]),
    edits=st.lists(st.tuples(st.integers(0, 10**6), st.integers(0, 255)), max_size=6),
    cut=st.integers(0, 100),
)
def test_mesh_bytes_of_any_kind(tmp_path: Path, suffix: str, edits: list[tuple[int, int]], cut: int) -> None:
    path = tmp_path / f"a{suffix}"
    trimesh.creation.box().export(path)
    data = bytearray(path.read_bytes())
    for at, value in edits:
        data[at % len(data)] = value
    path.write_bytes(data[: len(data) - cut % 30])
    try:
        read_mesh(path)
    except InputError as e:
        assert "\n" not in str(e)


@pytest.mark.parametrize("scale", [(1, 1, 1), (2, 3, 0.5), (-1, 1, 1)])
def test_transform(scale: tuple[float, float, float]) -> None:
    normals = SPHERE.vertex_normals.astype(np.float32)
    mesh = ProxyMesh(vertices=SPHERE.vertices, faces=SPHERE.faces, normals=normals)
    matrix = conventions.compose((1, 2, 3), conventions.rotation_from_euler((10, 20, 30)), scale)
    moved = transform(mesh, matrix)
    assert np.allclose(moved.vertices, SPHERE.vertices @ matrix[:3, :3].T + (1, 2, 3), atol=1e-5)
    assert moved.normals is not None
    assert np.allclose(moved.normals, conventions.unit(normals @ np.linalg.inv(matrix[:3, :3])), atol=1e-5)
    a, b, c = (moved.vertices[moved.faces[:, i]].astype(np.float64) for i in range(3))
    centre = (a + b + c) / 3 - np.array((1, 2, 3))
    assert np.all(np.einsum("ij,ij->i", np.cross(b - a, c - a), centre) > 0)
    assert transform(mesh, np.eye(4)) is mesh


def test_obj_counts_back_from_the_face_and_continues_lines(tmp_path: Path) -> None:
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 \\\n-1\nv 5 5 5\nf -4 -3 -1\n"
    (tmp_path / "a.obj").write_text(text, encoding="utf-8")
    assert read_mesh(tmp_path / "a.obj").faces.tolist() == [[0, 1, 2], [0, 1, 3]]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("f 1/1/1 2/2/1 3/3/1", "f 1/1/1 2/2/1 9/3/1", "line 11: a face '1/1/1 2/2/1 9/3/1'"),
        ("f 1/1/1 2/2/1 3/3/1", "f 1/1/1 2/2/1 0/3/1", "line 11: a face"),
        ("f 1/1/1 2/2/1 3/3/1", "f a b c", "line 11: a face 'a b c'"),
        ("v 1 0 0", "v 1 x 0", "v lines that are not all 3 numbers"),
        ("v 1 0 0", "v 1 0", "v lines that are not all 3 numbers"),
        ("vt 1 0", "vt nan 0", "1 of 3 vertices are NaN"),
        ("mtllib scene.mtl", "mtllib .", "line 1: '.' is not a relative path"),
    ],
)
def test_damaged_obj_names_the_line(tmp_path: Path, old: str, new: str, message: str) -> None:
    (tmp_path / "a.obj").write_text(OBJ.replace(old, new), encoding="utf-8")
    with pytest.raises(InputError, match=message):
        read_mesh(tmp_path / "a.obj")


@pytest.mark.parametrize(
    ("library", "message"),
    [
        ("newmtl tiled\nmap_Kd absent.png\n", r"scene.mtl: line 2: the texture 'absent.png' is missing"),
        ("newmtl tiled\nmap_Kd ../x.png\n", r"scene.mtl: line 2: .*leaves the folder"),
        ("newmtl tiled\nmap_Kd -s 2 2 2 x.png\n", r"scene.mtl: line 2: map_Kd with options"),
        ("newmtl tiled\nKd 1 1\n", r"scene.mtl: line 2: a colour '1 1'"),
    ],
)
def test_damaged_material_libraries(tmp_path: Path, library: str, message: str) -> None:
    (tmp_path / "a.obj").write_text(OBJ, encoding="utf-8")
    (tmp_path / "scene.mtl").write_text(library, encoding="utf-8")
    with pytest.raises(InputError, match=message):
        read_mesh(tmp_path / "a.obj")


def test_ply_with_a_texture(tmp_path: Path) -> None:
    pixels = np.random.default_rng(0).integers(0, 256, (4, 8, 3)).astype(np.uint8)
    Image.fromarray(pixels).save(tmp_path / "skin.png")
    head = (
        "ply\nformat ascii 1.0\ncomment TextureFile skin.png\nelement vertex 3\nproperty float x\nproperty float y\n"
        "property float z\nproperty float s\nproperty float t\nelement face 1\n"
        "property list uchar int vertex_indices\nend_header\n"
    )
    body = "0 0 0 0 0\n1 0 0 1 0\n0 1 0 0 0.75\n3 0 1 2\n"
    (tmp_path / "a.ply").write_text(head + body, encoding="utf-8")
    mesh = read_mesh(tmp_path / "a.ply")
    texture = mesh.materials[0].base_color_texture
    assert texture is not None and np.array_equal(texture, colour.srgb_decode(pixels / np.float32(255)))
    assert mesh.uvs is not None and mesh.uvs.tolist() == [[0, 1], [1, 1], [0, 0.25]]
    assert read_mesh(tmp_path / "a.ply", textures=False).materials[0].base_color_texture is None
    (tmp_path / "a.ply").write_text(head.replace("skin", "../skin") + body, encoding="utf-8")
    with pytest.raises(InputError, match="leaves the folder"):
        read_mesh(tmp_path / "a.ply")


def test_every_file_that_reading_opens_is_named(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text(OBJ, encoding="utf-8")
    assert companions(tmp_path / "a.obj") == ()
    for name, text in (("scene.mtl", MTL), ("tiles.png", "")):
        (tmp_path / name).write_text(text, encoding="utf-8")
    assert companions(tmp_path / "a.obj") == (tmp_path / "scene.mtl", tmp_path / "tiles.png")
    (tmp_path / "a.ply").write_text(
        "ply\nformat ascii 1.0\ncomment TextureFile tiles.png\nend_header\n", encoding="utf-8"
    )
    assert companions(tmp_path / "a.ply") == (tmp_path / "tiles.png",)


def test_splats_given_as_a_mesh_are_recognised(tmp_path: Path) -> None:
    (tmp_path / "a.ply").write_bytes(b"ply\nformat binary_little_endian 1.0\nproperty float f_dc_0\nend_header\n")
    with pytest.raises(InputError, match="Gaussian splats, not a mesh; name it under splats"):
        read_mesh(tmp_path / "a.ply")
