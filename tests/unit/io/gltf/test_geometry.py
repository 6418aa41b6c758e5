"""Meshes in world space: topologies, transforms, attributes, skins, morphs, instances."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mirelight.base import conventions
from mirelight.base.errors import InputError
from mirelight.io.gltf.scene import name_groups, read_node, read_scene
from mirelight.io.mesh import read_mesh
from mirelight.model import ProxyMesh

from .conftest import TRIANGLE

GRID = np.array([[x, y, 0] for y in range(3) for x in range(4)], dtype=np.float32)
CELLS = [(0, 1, 4), (1, 5, 4), (1, 2, 5), (2, 6, 5), (4, 5, 8), (5, 9, 8)]


def proxy(glb: Any) -> ProxyMesh:
    mesh = read_scene(glb.save()).mesh
    assert mesh is not None
    return mesh


def corners(mesh: ProxyMesh) -> set[tuple[tuple[float, ...], ...]]:
    """Triangles as coordinates, each starting at its smallest corner, so that only the winding matters."""
    out = set()
    for triangle in mesh.vertices[mesh.faces].tolist():
        k = triangle.index(min(triangle))
        out.add(tuple(tuple(v) for v in triangle[k:] + triangle[:k]))
    return out


@pytest.mark.parametrize("kind", ["u1", "u2", "u4"])
def test_indexed_triangles(glb: Any, kind: str) -> None:
    indices = glb.accessor(np.array(CELLS, dtype=kind).reshape(-1))
    glb.node(mesh=glb.mesh(glb.primitive(GRID, indices=indices)))
    mesh = proxy(glb)
    assert np.array_equal(mesh.faces, CELLS)
    assert np.array_equal(mesh.vertices, GRID)
    assert mesh.normals is None and mesh.uvs is None and mesh.vertex_colors is None and mesh.face_materials is None


def test_triangles_without_indices(glb: Any) -> None:
    glb.node(mesh=glb.mesh(glb.primitive(GRID[np.array(CELLS).reshape(-1)])))
    assert np.array_equal(proxy(glb).faces, np.arange(18).reshape(6, 3))


def test_strips_and_fans_as_the_specification_winds_them(glb: Any) -> None:
    strip = np.array([0, 1, 4, 5, 8], dtype=np.uint16)  # every triangle faces +Z
    fan = np.array([5, 6, 10, 9], dtype=np.uint16)
    glb.node(mesh=glb.mesh(glb.primitive(GRID, indices=glb.accessor(strip), mode=5)))
    glb.node(mesh=glb.mesh(glb.primitive(GRID, indices=glb.accessor(fan), mode=6)))
    mesh = proxy(glb)
    assert mesh.faces[:3].tolist() == [[0, 1, 4], [1, 5, 4], [4, 5, 8]]
    assert (mesh.faces[3:] - 12).tolist() == [[6, 10, 5], [10, 9, 5]]
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    assert np.all(np.cross(b - a, c - a)[:, 2] > 0)


def test_points_and_lines_are_left_out(glb: Any) -> None:
    glb.node(mesh=glb.mesh(glb.primitive(mode=0), glb.primitive(mode=1), glb.primitive()))
    assert len(proxy(glb).faces) == 1
    glb.top["meshes"][0]["primitives"].pop()
    assert read_scene(glb.save()).mesh is None


@pytest.mark.parametrize(
    "change",
    [
        {"translation": [1, 2, 3]},
        {"rotation": [0.5, 0.5, 0.5, 0.5], "scale": [2, 3, 4], "translation": [1, 0, 0]},
        {"scale": [-1, 2, 3]},
        {"rotation": [0, 0, 2.0, 2.0]},
        {"matrix": [1, 0, 0, 0, 0.5, 2, 0, 0, 0, 0, -1, 0, 3, 4, 5, 1]},
    ],
)
def test_against_trimesh_with_nested_nodes(glb: Any, change: dict[str, Any]) -> None:
    normals = conventions.unit(np.random.default_rng(1).normal(size=(12, 3))).astype(np.float32)
    primitive = glb.primitive(
        GRID,
        indices=glb.accessor(np.array(CELLS, dtype=np.uint16).reshape(-1)),
        attributes={"NORMAL": glb.accessor(normals)},
    )
    child = glb.node(root=False, mesh=glb.mesh(primitive), **change)
    glb.node(children=[child], translation=[5, 0, 0], scale=[1, 2, 1])
    ours = proxy(glb)
    theirs = trimesh.load_scene(glb.save(), process=False)
    (name,) = theirs.graph.nodes_geometry
    matrix, _ = theirs.graph[name]
    linear = matrix[:3, :3]
    assert np.allclose(ours.vertices, GRID @ linear.T + matrix[:3, 3], atol=1e-5)
    assert ours.normals is not None
    assert np.allclose(ours.normals, conventions.unit(normals @ np.linalg.inv(linear)), atol=1e-5)
    wound = np.array(CELLS)[:, ::-1] if np.linalg.det(linear) < 0 else CELLS
    assert np.array_equal(ours.faces, wound)


def test_a_mirrored_box_still_faces_outwards(glb: Any) -> None:
    box = trimesh.creation.box()
    indices = glb.accessor(box.faces.astype(np.uint16).reshape(-1))
    normals = glb.accessor(box.vertex_normals.astype(np.float32))
    primitive = glb.primitive(box.vertices.astype(np.float32), indices=indices, attributes={"NORMAL": normals})
    glb.node(mesh=glb.mesh(primitive), scale=[-1, 1, 1], translation=[4, 0, 0])
    mesh = proxy(glb)
    centre = mesh.vertices[mesh.faces].mean(axis=1) - (4, 0, 0)
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    assert np.all(np.einsum("ij,ij->i", np.cross(b - a, c - a), centre) > 0)
    assert mesh.normals is not None
    assert np.all(np.einsum("ij,ij->i", mesh.normals, mesh.vertices - np.array((4, 0, 0), np.float32)) > 0)


def test_instances_of_one_mesh_and_mesh_order(glb: Any) -> None:
    shared = glb.mesh(glb.primitive())
    for x in (0, 10, 20):
        glb.node(mesh=shared, translation=[x, 0, 0])
    mesh = proxy(glb)
    assert mesh.vertices[::3, 0].tolist() == [0, 10, 20]
    assert mesh.faces.tolist() == [[0, 1, 2], [3, 4, 5], [6, 7, 8]]


def test_nodes_outside_the_default_scene_are_not_shown(glb: Any) -> None:
    glb.node(root=False, mesh=glb.mesh(glb.primitive()))
    assert read_scene(glb.save()).mesh is None
    del glb.top["scenes"], glb.top["scene"]
    assert proxy(glb).faces.tolist() == [[0, 1, 2]]  # without scenes every root counts


def test_gpu_instancing(glb: Any) -> None:
    offsets = glb.accessor(np.array([[0, 0, 0], [0, 5, 0]], dtype=np.float32))
    scales = glb.accessor(np.array([[1, 1, 1], [2, 2, 2]], dtype=np.float32))
    turns = glb.accessor(np.array([[0, 0, 0, 127], [0, 0, 127, 0]], dtype=np.int8), normalized=True)
    instancing = {"attributes": {"TRANSLATION": offsets, "SCALE": scales, "ROTATION": turns}}
    glb.node(mesh=glb.mesh(glb.primitive()), extensions={"EXT_mesh_gpu_instancing": instancing}, translation=[1, 0, 0])
    expected = [[1, 0, 0], [2, 0, 0], [1, 1, 0], [1, 5, 0], [-1, 5, 0], [1, 3, 0]]
    assert np.allclose(proxy(glb).vertices, expected, atol=1e-6)


def test_primitives_that_share_vertices_share_them_in_the_proxy(glb: Any) -> None:
    first = glb.primitive(GRID, indices=glb.accessor(np.array(CELLS[:2], dtype=np.uint16).reshape(-1)))
    second = {**first, "indices": glb.accessor(np.array(CELLS[2:], dtype=np.uint16).reshape(-1))}
    for primitive, name in ((first, "red"), (second, "blue")):
        color = [1, 0, 0, 1] if name == "red" else [0, 0, 1, 1]
        primitive["material"] = glb.put("materials", {"name": name, "pbrMetallicRoughness": {"baseColorFactor": color}})
    glb.node(mesh=glb.mesh(first, second))
    mesh = proxy(glb)
    assert len(mesh.vertices) == 12
    assert mesh.face_materials is not None
    assert [mesh.materials[i].name for i in mesh.face_materials] == ["red"] * 2 + ["blue"] * 4
    assert mesh.materials[1].base_color.tolist() == [0, 0, 1]


def test_missing_attributes_are_filled_where_others_have_them(glb: Any) -> None:
    up = glb.accessor(np.tile(np.array([0, 0, 1], np.float32), (3, 1)))
    color = glb.accessor(np.array([[255, 0, 0, 128]] * 3, dtype=np.uint8), normalized=True)
    uv = glb.accessor(np.array([[0, 0], [65535, 0], [0, 65535]], dtype=np.uint16), normalized=True)
    glb.node(mesh=glb.mesh(glb.primitive(attributes={"NORMAL": up, "COLOR_0": color, "TEXCOORD_0": uv})))
    glb.node(mesh=glb.mesh(glb.primitive(np.array([[0, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=np.float32))))
    mesh = proxy(glb)
    assert mesh.normals is not None and mesh.vertex_colors is not None and mesh.uvs is not None
    assert mesh.normals.tolist() == [[0, 0, 1]] * 3 + [[1, 0, 0]] * 3
    assert mesh.vertex_colors.tolist() == [[1, 0, 0]] * 3 + [[1, 1, 1]] * 3
    assert mesh.uvs.tolist() == [[0, 0], [1, 0], [0, 1]] + [[0, 0]] * 3


def test_quantised_positions(glb: Any) -> None:
    glb.top["extensionsRequired"] = ["KHR_mesh_quantization"]
    whole = np.array([[0, 0, 0], [300, 0, 0], [0, -200, 7]], dtype=np.int16)
    share = np.array([[0, 0, 0], [32767, 0, 0], [0, -32767, 16384]], dtype=np.int16)
    normal = np.array([[0, 0, 127, 0]] * 3, dtype=np.int8)  # stored four wide for alignment
    primitive = glb.primitive(whole)
    view = glb.view(normal.tobytes(), byteStride=4)
    entry = {"bufferView": view, "componentType": 5120, "count": 3, "type": "VEC3", "normalized": True}
    primitive["attributes"]["NORMAL"] = glb.put("accessors", entry)
    glb.node(mesh=glb.mesh(primitive), scale=[0.01, 0.01, 0.01])
    glb.node(
        mesh=glb.mesh(
            {
                "attributes": {
                    "POSITION": glb.accessor(share, normalized=True),
                    "NORMAL": primitive["attributes"]["NORMAL"],
                }
            }
        )
    )
    mesh = proxy(glb)
    assert np.allclose(mesh.vertices[:3], whole * 0.01)
    assert np.allclose(mesh.vertices[3:], share / 32767, atol=1e-6)
    assert mesh.normals is not None and np.allclose(mesh.normals, (0, 0, 1))


def test_zero_normals_take_those_of_the_faces_around(glb: Any) -> None:
    normals = glb.accessor(np.array([[0, 0, 0], [0, 0, 2], [0, 0, 1]], dtype=np.float32))
    glb.node(mesh=glb.mesh(glb.primitive(attributes={"NORMAL": normals})))
    mesh = proxy(glb)
    assert mesh.normals is not None and mesh.normals.tolist() == [[0, 0, 1]] * 3


def test_morph_targets_at_their_default_weights(glb: Any) -> None:
    offset = glb.accessor(np.full((3, 3), 2, dtype=np.float32))
    primitive = glb.primitive() | {"targets": [{"POSITION": offset}]}
    glb.node(mesh=glb.mesh(primitive, weights=[0.5]))
    glb.node(mesh=glb.mesh(primitive), weights=[1.0])
    glb.node(mesh=glb.mesh(primitive))
    first = proxy(glb).vertices[::3]
    assert first.tolist() == [[1, 1, 1], [2, 2, 2], [0, 0, 0]]


def test_a_skin_stands_where_its_joints_stand(glb: Any) -> None:
    bind = np.stack([np.eye(4), conventions.compose((0, -1, 0))]).astype(np.float32).transpose(0, 2, 1).reshape(2, 16)
    joints = np.array([[0, 0, 0, 0], [0, 1, 0, 0], [1, 0, 0, 0]], dtype=np.uint8)
    weights = np.array([[1, 0, 0, 0], [0.5, 0.5, 0, 0], [1, 0, 0, 0]], dtype=np.float32)
    attributes = {"JOINTS_0": glb.accessor(joints), "WEIGHTS_0": glb.accessor(weights)}
    tip = glb.node(root=False, translation=[0, 2, 0])
    base = glb.node(children=[tip], translation=[10, 0, 0])
    skin = glb.put("skins", {"joints": [base, tip], "inverseBindMatrices": glb.accessor(bind)})
    glb.node(mesh=glb.mesh(glb.primitive(attributes=attributes)), skin=skin, translation=[99, 99, 99])
    # Joint 0 adds (10, 0, 0), joint 1 adds (10, 1, 0); the node's own transform does not count.
    assert np.allclose(proxy(glb).vertices, np.array([[10, 0, 0], [11, 0.5, 0], [10, 2, 0]]), atol=1e-6)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda g: g.top["nodes"][0].update(children=[0]), "appears twice in the hierarchy"),
        (lambda g: g.top["nodes"][0].update(children=[9]), r"nodes\[0\]\.children\[0\]: there is no nodes\[9\]"),
        (lambda g: g.top["nodes"][0].update(mesh=5), r"nodes\[0\]\.mesh: there is no meshes\[5\]"),
        (lambda g: g.top["nodes"][0].update(rotation=[0, 0, 0, 0]), "quaternion of length zero"),
        (lambda g: g.top["nodes"][0].update(scale=[1, 1]), r"nodes\[0\]\.scale: 2 numbers, expected 3"),
        (lambda g: g.top["nodes"][0].update(translation=[1e308, 1e999, 0]), "expected a finite number"),
        (lambda g: g.top["nodes"][0].update(scale=[1e300, 1e300, 1e300]), "not finite in world space"),
        (lambda g: g.top["meshes"][0]["primitives"][0].update(mode=9), r"primitives\[0\]\.mode"),
        (lambda g: g.top["meshes"][0]["primitives"][0]["attributes"].pop("POSITION"), "no POSITION"),
        (lambda g: g.top["meshes"][0]["primitives"][0].update(material=3), r"there is no materials\[3\]"),
        (lambda g: g.top["scenes"][0].update(nodes=[0, 0]), "appears twice"),
        (lambda g: g.top.update(scene=3), r"there is no scenes\[3\]"),
    ],
)
def test_damaged_structure(glb: Any, spoil: Any, message: str) -> None:
    glb.node(mesh=glb.mesh(glb.primitive()))
    spoil(glb)
    with pytest.raises(InputError, match=message):
        read_scene(glb.save())


def test_damaged_values(glb: Any) -> None:
    for bad in (np.nan, np.inf):
        glb.top["nodes"], glb.top["scenes"][0]["nodes"] = [], []
        positions = np.array([[0, 0, 0], [1, 0, 0], [0, bad, 0]], dtype=np.float32)
        glb.node(mesh=glb.mesh(glb.primitive(positions)))
        with pytest.raises(InputError, match="POSITION: 1 of 3 vertices are NaN or infinite"):
            read_scene(glb.save())
    glb.top["nodes"], glb.top["scenes"][0]["nodes"] = [], []
    glb.node(mesh=glb.mesh(glb.primitive(indices=glb.accessor(np.array([0, 1, 3], dtype=np.uint8)))))
    with pytest.raises(InputError, match=r"indices: index 3 of 3 vertices"):
        read_scene(glb.save())


def test_attributes_must_agree_on_their_count(glb: Any) -> None:
    glb.node(mesh=glb.mesh(glb.primitive(attributes={"NORMAL": glb.accessor(np.zeros((2, 3), dtype=np.float32))})))
    with pytest.raises(InputError, match="NORMAL: 2 values, not one per vertex"):
        read_scene(glb.save())


def test_a_scene_too_large_is_refused_before_it_is_read(glb: Any) -> None:
    count = 1 << 24
    position = glb.put("accessors", {"componentType": 5126, "count": count, "type": "VEC3"})
    shared = glb.mesh({"attributes": {"POSITION": position}})
    for _ in range(5):
        glb.node(mesh=shared)
    with pytest.raises(InputError, match="vertices and indices in the scene"):
        read_scene(glb.save())


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    angles=st.lists(st.floats(-180, 180), min_size=3, max_size=3),
    scale=st.lists(st.floats(0.1, 10) | st.floats(-10, -0.1), min_size=3, max_size=3),
)
def test_triangles_keep_their_outside_under_any_transform(
    new_glb: Any, angles: list[float], scale: list[float]
) -> None:
    glb = new_glb()
    box = trimesh.creation.icosphere(subdivisions=1)
    matrix = conventions.compose((1, 2, 3), conventions.rotation_from_euler(angles), scale)
    normals = glb.accessor(box.vertex_normals.astype(np.float32))
    indices = glb.accessor(box.faces.astype(np.uint16).reshape(-1))
    primitive = glb.primitive(box.vertices.astype(np.float32), indices=indices, attributes={"NORMAL": normals})
    glb.node(mesh=glb.mesh(primitive), matrix=matrix.T.reshape(-1).tolist())
    mesh = proxy(glb)
    a, b, c = (mesh.vertices[mesh.faces[:, i]].astype(np.float64) for i in range(3))
    facing = conventions.unit(np.cross(b - a, c - a))
    assert np.all(np.einsum("ij,ij->i", facing, (a + b + c) / 3 - (1, 2, 3)) > 0)
    assert mesh.normals is not None
    assert np.all(np.einsum("ij,ij->i", facing, mesh.normals[mesh.faces[:, 0]]) > 0)


def kit(glb: Any) -> Path:
    """A table with a foot, a lamp, and something without a mesh, on one root that is turned and moved."""
    mesh = glb.mesh(glb.primitive(), name="triangle")
    foot = glb.node(root=False, name="foot", mesh=mesh, translation=[0, -1, 0])
    table = glb.node(root=False, name="table", children=[foot], mesh=mesh, translation=[1, 2, 3], scale=[2, 2, 2])
    lamp = glb.node(root=False, mesh=glb.mesh(glb.primitive(), name="lamp"), translation=[-4, 0, 0])
    bare = glb.node(root=False, name="eye")
    quarter = [0, float(np.sqrt(0.5)), 0, float(np.sqrt(0.5))]  # x goes to -z
    glb.node(name="kit", children=[table, lamp, bare], translation=[10, 0, 0], rotation=quarter)
    path = glb.save()
    assert isinstance(path, Path)
    return path


def test_a_node_alone_has_its_origin_at_the_worlds(glb: Any) -> None:
    """With what hangs on it, as turned and as large as in the file."""
    path = kit(glb)
    whole, table, lamp = read_mesh(path), read_mesh(path, node="table"), read_mesh(path, node="lamp")
    assert whole.nodes == ("table", "foot", "lamp") and table.nodes == ("table", "foot") and lamp.nodes == ("lamp",)
    np.testing.assert_allclose(table.vertices[:3], [[0, 0, 0], [0, 0, -2], [0, 2, 0]], atol=1e-6)
    np.testing.assert_allclose(table.vertices[3:], table.vertices[:3] - [0, 2, 0], atol=1e-6)
    np.testing.assert_allclose(whole.vertices[:6] - [13, 2, -1], table.vertices, atol=1e-5)
    np.testing.assert_allclose(whole.vertices[6:] - whole.vertices[6], lamp.vertices, atol=1e-5)
    assert read_node(path, "eye") is None


def test_a_node_that_is_not_there_is_a_line_with_those_that_are(glb: Any, tmp_path: Path) -> None:
    path = kit(glb)
    for name, says in (
        ("tabel", "node: no node named 'tabel'; give one of table, kit, foot, lamp$"),
        ("eye", "node: no triangles at the node 'eye'; name one with a mesh$"),
    ):
        with pytest.raises(InputError, match=says):
            read_mesh(path, node=name)
    trimesh.creation.box().export(tmp_path / "box.stl")
    with pytest.raises(InputError, match="node: a node, 'lamp', of a file that is no glTF"):
        read_mesh(tmp_path / "box.stl", node="lamp")


def test_groups_of_nodes_are_called_by_what_they_hang_on(glb: Any) -> None:
    path = kit(glb)
    assert name_groups(path, [{"lamp"}, {"foot", "table"}]) == ["lamp", "table"]
    assert name_groups(path, [{"lamp", "foot"}, {"table"}]) == [None, None]
    assert name_groups(path, [{"lamp", "foot", "table"}]) == ["kit"]


def test_a_skin_alone_stands_as_its_joints_stand_to_what_it_hangs_on(glb: Any) -> None:
    bone = glb.node(root=False, translation=[0, 1, 0])
    shares = {"JOINTS_0": np.zeros((3, 4), np.uint8), "WEIGHTS_0": np.tile(np.array([1, 0, 0, 0], np.float32), (3, 1))}
    mesh = glb.mesh(glb.primitive(attributes={k: glb.accessor(x) for k, x in shares.items()}))
    body = glb.node(
        root=False, name="body", mesh=mesh, skin=glb.put("skins", {"joints": [bone]}), translation=[9, 9, 9]
    )
    glb.node(name="rig", children=[bone, body], translation=[5, 0, 0])
    path = glb.save()
    for name in ("rig", "body"):
        np.testing.assert_allclose(read_mesh(path, node=name).vertices, TRIANGLE + np.array([0, 1, 0]), atol=1e-6)
