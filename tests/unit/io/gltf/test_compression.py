"""Draco and meshopt: read right, or refused by name."""

from __future__ import annotations

import sys
from typing import Any

import DracoPy
import meshopt
import numpy as np
import pytest
import trimesh

from mirelight.base.errors import InputError
from mirelight.io.gltf.scene import read_scene

SPHERE = trimesh.creation.icosphere(subdivisions=3)


def draco_primitive(glb: Any, ids: dict[str, int] | None = None, bits: int = 14) -> dict[str, Any]:
    """A sphere as a Draco primitive, colours as a generic attribute of known id."""
    colors = (np.abs(SPHERE.vertex_normals) * 255).astype(np.uint8)
    data = DracoPy.encode(
        SPHERE.vertices.astype(np.float32),
        SPHERE.faces.astype(np.uint32),
        quantization_bits=bits,
        preserve_order=True,
        normals=SPHERE.vertex_normals.astype(np.float64),
        generic_attributes={7: np.ascontiguousarray(colors)},
    )
    decoded = {x["attribute_type"]: x["unique_id"] for x in DracoPy.decode(data).attributes}
    names = {"POSITION": decoded[0], "NORMAL": decoded[1], "COLOR_0": decoded[4]} | (ids or {})
    count = len(SPHERE.vertices)
    attributes = {
        "POSITION": glb.put("accessors", {"componentType": 5126, "count": count, "type": "VEC3"}),
        "NORMAL": glb.put("accessors", {"componentType": 5126, "count": count, "type": "VEC3"}),
        "COLOR_0": glb.put("accessors", {"componentType": 5121, "count": count, "type": "VEC3", "normalized": True}),
    }
    indices = glb.put("accessors", {"componentType": 5125, "count": SPHERE.faces.size, "type": "SCALAR"})
    packed = {"bufferView": glb.view(data), "attributes": names}
    extensions = {"KHR_draco_mesh_compression": packed}
    return {"attributes": attributes, "indices": indices, "extensions": extensions}


def test_draco_attributes_by_their_ids(glb: Any) -> None:
    glb.top["extensionsRequired"] = ["KHR_draco_mesh_compression"]
    glb.node(mesh=glb.mesh(draco_primitive(glb)), translation=[5, 0, 0])
    mesh = read_scene(glb.save()).mesh
    assert mesh is not None and mesh.normals is not None and mesh.vertex_colors is not None
    assert np.array_equal(mesh.faces, SPHERE.faces)
    assert np.allclose(mesh.vertices, SPHERE.vertices + np.array((5, 0, 0)), atol=3e-4)  # 14 bits over a size of 2
    assert np.allclose(mesh.normals, SPHERE.vertex_normals, atol=2e-2)
    assert np.array_equal(mesh.vertex_colors, (np.abs(SPHERE.vertex_normals) * 255).astype(np.uint8) / np.float32(255))


def test_draco_that_disagrees_is_refused(glb: Any, new_glb: Any) -> None:
    glb.node(mesh=glb.mesh(draco_primitive(glb, ids={"NORMAL": 99})))
    with pytest.raises(InputError, match=r"attributes\.NORMAL: no attribute with the id 99"):
        read_scene(glb.save())
    other = new_glb()
    primitive = draco_primitive(other)
    other.top["accessors"][primitive["attributes"]["POSITION"]]["count"] += 1
    other.node(mesh=other.mesh(primitive))
    with pytest.raises(InputError, match=r"the accessor says|not one per vertex"):
        read_scene(other.save())


def test_damaged_draco_is_one_line(glb: Any) -> None:
    glb.node(mesh=glb.mesh(draco_primitive(glb)))
    glb.binary = glb.binary[:40] + b"\0" * (len(glb.binary) - 40)
    with pytest.raises(InputError, match="KHR_draco_mesh_compression"):
        read_scene(glb.save())


def meshopt_scene(glb: Any) -> None:
    """The sphere with meshopt-packed 16-bit positions, octahedral normals and triangles."""

    glb.top["extensionsRequired"] = ["EXT_meshopt_compression", "KHR_mesh_quantization"]
    count = len(SPHERE.vertices)
    positions = np.zeros((count, 4), dtype=np.int16)
    positions[:, :3] = np.rint(SPHERE.vertices * 10000)
    normals = np.concatenate([SPHERE.vertex_normals, np.zeros((count, 1))], axis=1).astype(np.float32)
    packed = [
        (meshopt.encode_gltf_buffer(positions, "ATTRIBUTES"), 8, count, "ATTRIBUTES", "NONE"),
        (
            meshopt.encode_gltf_buffer(meshopt.encode_filter_oct(normals, 4, 8), "ATTRIBUTES"),
            4,
            count,
            "ATTRIBUTES",
            "OCTAHEDRAL",
        ),
        (
            meshopt.encode_gltf_buffer(SPHERE.faces.astype(np.uint32), "TRIANGLES"),
            4,
            SPHERE.faces.size,
            "TRIANGLES",
            "NONE",
        ),
    ]
    glb.top["buffers"] = [
        {"byteLength": 0},
        {"byteLength": 1 << 20, "extensions": {"EXT_meshopt_compression": {"fallback": True}}},
    ]
    for data, stride, number, mode, how in packed:
        at = glb.view(data)
        where = glb.top["bufferViews"][at]
        extension = {**where, "byteStride": stride, "count": number, "mode": mode, "filter": how}
        view = {"buffer": 1, "byteLength": stride * number, "extensions": {"EXT_meshopt_compression": extension}}
        if mode == "ATTRIBUTES":
            view["byteStride"] = stride
        glb.put("bufferViews", view)
    glb.top["buffers"][0]["byteLength"] = len(glb.binary)
    views = [i for i, v in enumerate(glb.top["bufferViews"]) if "extensions" in v]
    attributes = {
        "POSITION": glb.put(
            "accessors", {"bufferView": views[0], "componentType": 5122, "count": count, "type": "VEC3"}
        ),
        "NORMAL": glb.put(
            "accessors",
            {"bufferView": views[1], "componentType": 5120, "count": count, "type": "VEC3", "normalized": True},
        ),
    }
    indices = glb.put(
        "accessors", {"bufferView": views[2], "componentType": 5125, "count": SPHERE.faces.size, "type": "SCALAR"}
    )
    glb.node(mesh=glb.mesh({"attributes": attributes, "indices": indices}), scale=[1e-4, 1e-4, 1e-4])


def test_meshopt(glb: Any) -> None:
    meshopt_scene(glb)
    mesh = read_scene(glb.save()).mesh
    assert mesh is not None and mesh.normals is not None
    assert np.allclose(mesh.vertices, np.rint(SPHERE.vertices * 10000) * 1e-4, atol=1e-6)
    assert np.allclose(mesh.normals, SPHERE.vertex_normals, atol=0.03)
    # The codec may rotate a triangle's corners but keeps triangles and winding.
    first = mesh.faces.argmin(axis=1)
    turned = np.stack([np.take_along_axis(mesh.faces, ((first + i) % 3)[:, None], 1)[:, 0] for i in range(3)], axis=1)
    wanted = SPHERE.faces[
        np.arange(len(SPHERE.faces))[:, None], (SPHERE.faces.argmin(axis=1)[:, None] + np.arange(3)) % 3
    ]
    assert np.array_equal(turned, wanted)


def test_meshopt_claims_are_checked_before_memory_is_taken(glb: Any) -> None:
    meshopt_scene(glb)
    view = next(v for v in glb.top["bufferViews"] if "extensions" in v)
    view["byteLength"] = 2**50
    view["extensions"]["EXT_meshopt_compression"]["count"] = 2**40
    with pytest.raises(InputError, match="do not fit"):
        read_scene(glb.save())


def test_meshopt_without_its_package_is_refused_by_name(glb: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    data = glb.view(b"\xa0" + b"\0" * 63)
    packed = {**glb.top["bufferViews"][data], "byteStride": 12, "count": 3, "mode": "ATTRIBUTES"}
    view = glb.put("bufferViews", {"buffer": 0, "byteLength": 36, "extensions": {"EXT_meshopt_compression": packed}})
    accessor = glb.put("accessors", {"bufferView": view, "componentType": 5126, "count": 3, "type": "VEC3"})
    glb.node(mesh=glb.mesh({"attributes": {"POSITION": accessor}}))
    monkeypatch.setitem(sys.modules, "meshopt", None)
    with pytest.raises(InputError, match=r"meshopt compression; pip install 'mirelight\[formats\]', or export"):
        read_scene(glb.save())
