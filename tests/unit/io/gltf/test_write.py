"""The GLB writer: what is written comes back, and the reference renderer's files are read right."""

from __future__ import annotations

import json
import math
import re
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from mirelight.base import colour, conventions
from mirelight.base.errors import InputError, OutputError
from mirelight.io.gltf.scene import read_lights, read_scene
from mirelight.io.gltf.write import write_glb, write_lights
from mirelight.model import (
    F32,
    F64,
    AreaLight,
    Camera,
    DirectionalLight,
    IesProfile,
    Light,
    Material,
    PointLight,
    ProxyMesh,
    SpotLight,
    SunLight,
)
from mirelight.model.ies import AROUND, DOWN

RNG = np.random.default_rng(11)
KHRONOS = Path(__file__).parents[3] / "data" / "khronos"


def mesh() -> ProxyMesh:
    """A sphere with every attribute and three materials."""
    sphere = trimesh.creation.icosphere(subdivisions=2)
    count = len(sphere.vertices)
    stored = RNG.integers(0, 256, (8, 16, 3)).astype(np.float32) / np.float32(255)
    return ProxyMesh(
        vertices=(sphere.vertices * (0.1, 1e4, 3)).astype(np.float32),
        faces=sphere.faces.astype(np.int32),
        normals=sphere.vertex_normals.astype(np.float32),
        uvs=RNG.normal(size=(count, 2)).astype(np.float32),
        vertex_colors=RNG.random((count, 3), dtype=np.float32),
        face_materials=np.sort(RNG.integers(0, 3, len(sphere.faces))).astype(np.int32),
        materials=(
            Material(name="plaster", base_color=np.array([0.1, 0.7, 1 / 3])),
            Material(name="tiles", base_color_texture=colour.srgb_decode(stored), base_color_wrap=("mirror", "clamp")),
            Material(
                name="lamp",
                emissive=np.array([17.3, 1 / 7, 0]),
                emissive_texture=colour.srgb_decode(stored[::-1]),
                emissive_wrap=("clamp", "repeat"),
            ),
        ),
        albedo=None,
    )


LIGHTS: tuple[Light, ...] = (
    DirectionalLight(name="sun", direction=np.array([0.3, -0.9, 0.1]), color=np.array([1, 0.9, 1 / 3]), intensity=1e5),
    PointLight(name="bulb", position=np.array([1 / 3, 2, -7]), intensity=0.1, range=4.5),
    SpotLight(
        name="spot",
        position=np.array([0, 3, 0]),
        direction=np.array([0, -1, 0]),
        inner_cone_angle=0.2,
        outer_cone_angle=math.pi / 2,
    ),
)
CAMERAS = (
    Camera.look_at((1, 2, 3), (0, 0, 0), 640, 360, yfov=37, name="front", near=0.25, far=80),
    Camera(
        name="plan",
        world_from_camera=Camera.look_at((0, 9, 0), (0, 0, 0), 4, 4).world_from_camera,
        width=200,
        height=100,
        fx=20,
        fy=20,
        cx=100,
        cy=50,
        projection="orthographic",
        far=30,
    ),
)


def test_everything_comes_back(tmp_path: Path) -> None:
    before = mesh()
    write_glb(tmp_path / "a.glb", before, LIGHTS, CAMERAS)
    scene = read_scene(tmp_path / "a.glb")
    after = scene.mesh
    assert after is not None
    for name in ("vertices", "faces", "normals", "uvs", "vertex_colors", "face_materials"):
        assert np.array_equal(getattr(before, name), getattr(after, name)), name
    for old, new in zip(before.materials, after.materials, strict=True):
        assert old.name == new.name
        assert np.array_equal(old.base_color, new.base_color)
        assert np.array_equal(old.emissive, new.emissive)
        assert (old.base_color_wrap, old.emissive_wrap) == (new.base_color_wrap, new.emissive_wrap)
    for name, index in (("base_color_texture", 1), ("emissive_texture", 2)):
        assert getattr(after.materials[index], name) is not None
        assert np.array_equal(getattr(before.materials[index], name), getattr(after.materials[index], name))
    for light, found in zip(LIGHTS, scene.lights, strict=True):
        assert type(light) is type(found)
        for name in (
            "name",
            "intensity",
            "color",
            "position",
            "direction",
            "range",
            "inner_cone_angle",
            "outer_cone_angle",
        ):
            if hasattr(light, name):
                assert np.array_equal(getattr(light, name), getattr(found, name)), (light.name, name)
    for camera, read in zip(CAMERAS, scene.cameras, strict=True):
        back = read.to_camera(camera.width, camera.height)
        assert np.allclose(camera.world_from_camera, back.world_from_camera, rtol=0, atol=1e-15)
        for name in ("fx", "fy", "cx", "cy", "near", "far"):
            assert getattr(back, name) == pytest.approx(getattr(camera, name), rel=1e-12), name
        assert (back.name, back.projection) == (camera.name, camera.projection)
        assert read.aspect == pytest.approx(camera.width / camera.height)


def test_all_that_objects_have_of_materials_comes_back(tmp_path: Path) -> None:
    """Finish, normals, cut-outs, half clear parts, reflectances, lacquer and glass, with their maps."""

    def numbers(channels: int = 3, size: tuple[int, int] = (6, 5)) -> F32:
        return np.asarray(RNG.integers(0, 256, (*size, channels)) / np.float32(255), np.float32)

    once, twice = numbers(1), numbers(1, (12, 10))
    layers = numbers()
    before = (
        Material(
            name="brushed", metallic=0.7, roughness=0.3, finish_texture=numbers(), finish_wrap=("clamp", "mirror")
        ),
        Material(name="stitched", normal_texture=numbers(), normal_wrap=("mirror", "repeat"), normal_scale=0.6),
        Material(
            name="leaf",
            base_color_texture=colour.srgb_decode(numbers()),
            base_color_wrap=("clamp", "clamp"),
            alpha=0.9,
            alpha_texture=np.repeat(once, 3, axis=2),
            cutoff=0.35,
        ),
        Material(name="gauze", base_color=np.array([0.2, 0.3, 0.4]), alpha_texture=np.repeat(twice, 3, axis=2)),
        Material(name="veil", alpha=0.25),
        Material(name="diamond", specular=np.full(3, 0.17)),
        Material(name="dull", specular=np.full(3, 0.04 * 0.3), specular_weight=0.3),
        Material(
            name="silk",
            specular=np.array([0.02, 0.3, 0.04]) * 0.5,
            specular_weight=0.5,
            specular_texture=np.concatenate([colour.srgb_decode(numbers()), numbers(1)], axis=2),
            specular_wrap=("mirror", "mirror"),
        ),
        Material(name="mirror", specular=np.ones(3)),
        Material(
            name="lens",
            roughness=0.05,
            clearcoat=0.8,
            clearcoat_roughness=0.2,
            transmission=0.9,
            layer_texture=layers,
            layer_wrap=("clamp", "clamp"),
        ),
    )
    count = len(before)
    corners = RNG.random((3 * count, 3), dtype=np.float32)
    flat = ProxyMesh(
        vertices=corners,
        faces=np.arange(3 * count, dtype=np.int32).reshape(-1, 3),
        uvs=np.ascontiguousarray(corners[:, :2]),
        face_materials=np.arange(count, dtype=np.int32),
        materials=before,
    )
    write_glb(tmp_path / "a.glb", flat)
    after = read_scene(tmp_path / "a.glb", finish=True).mesh
    assert after is not None and trimesh.load_scene(tmp_path / "a.glb", process=False).geometry
    for old, new in zip(before, after.materials, strict=True):
        for field in fields(Material):
            name = (old.name, field.name)
            was, now = getattr(old, field.name), getattr(new, field.name)
            if name == ("gauze", "base_color_texture"):  # alpha alone: white
                assert (now == 1).all()
            elif isinstance(was, np.ndarray | float):
                np.testing.assert_allclose(now, was, atol=1e-6, err_msg=str(name))
            else:
                assert now == was, name


def test_a_second_writing_gives_the_same_bytes(tmp_path: Path) -> None:
    before = mesh()
    write_glb(tmp_path / "a.glb", before, LIGHTS, CAMERAS)
    write_glb(tmp_path / "b.glb", read_scene(tmp_path / "a.glb").mesh, LIGHTS, CAMERAS)
    assert (tmp_path / "a.glb").read_bytes() == (tmp_path / "b.glb").read_bytes()


def test_trimesh_reads_what_is_written(tmp_path: Path) -> None:
    before = mesh()
    write_glb(tmp_path / "a.glb", before)
    scene = trimesh.load_scene(tmp_path / "a.glb", process=False)
    faces = sum(len(g.faces) for g in scene.geometry.values())
    assert faces == len(before.faces)
    assert np.allclose(scene.bounds, [before.vertices.min(axis=0), before.vertices.max(axis=0)])


def test_faces_out_of_order_are_grouped_by_material(tmp_path: Path) -> None:
    vertices = RNG.random((9, 3), dtype=np.float32)
    faces = np.arange(9, dtype=np.int32).reshape(3, 3)
    two = (Material(name="a"), Material(name="b"))
    write_glb(
        tmp_path / "a.glb",
        ProxyMesh(vertices=vertices, faces=faces, face_materials=np.array([1, 0, 1], np.int32), materials=two),
    )
    after = read_scene(tmp_path / "a.glb").mesh
    assert after is not None and after.face_materials is not None
    assert after.faces.tolist() == [[3, 4, 5], [0, 1, 2], [6, 7, 8]]
    assert [after.materials[i].name for i in after.face_materials] == ["a", "b", "b"]


def test_lights_and_cameras_alone(tmp_path: Path) -> None:
    write_glb(tmp_path / "a.glb", lights=LIGHTS, cameras=CAMERAS)
    scene = read_scene(tmp_path / "a.glb")
    assert scene.mesh is None and len(scene.lights) == 3 and len(scene.cameras) == 2
    write_glb(tmp_path / "b.glb")
    assert read_scene(tmp_path / "b.glb").lights == ()


def tilted() -> F64:
    """A place, and a turn about no axis of the world."""
    pose = np.eye(4)
    pose[:3, :3] = conventions.rotation_from_euler((30, 40, 50))
    pose[:3, 3] = (1, 2, -3)
    return pose


BEYOND: tuple[Light, ...] = (
    SunLight(name="hazy sun", direction=np.array([0.3, -0.8, 0.2]), intensity=3.3, angular_diameter=4.5),
    PointLight(name="globe", position=np.array([1, 2, 3]), intensity=2.2, radius=0.05),
    SpotLight(
        name="beam",
        position=np.array([1, 2, 3]),
        direction=np.array([0, -1, 0.1]),
        inner_cone_angle=0.2,
        outer_cone_angle=0.5,
        cone="playcanvas",
        radius=0.02,
    ),
    AreaLight(name="window", shape="rectangle", world_from_light=tilted(), size=(1.2, 0.1), intensity=100),
    AreaLight(name="panel", shape="disk", world_from_light=tilted(), size=(0.2, 0.2), color=np.array([1, 0.5, 0.2])),
    AreaLight(name="moon", shape="sphere", world_from_light=tilted(), size=(0.3, 0.3), intensity=7),
)


@pytest.mark.parametrize("suffix", [".glb", ".gltf"])
def test_lights_that_khr_has_no_words_for_come_back(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    write_lights(path, [*BEYOND, *LIGHTS], ["what for"])
    for light, found in zip([*BEYOND, *LIGHTS], read_lights(path), strict=True):
        assert type(light) is type(found)
        for field in fields(light):
            old, new = getattr(light, field.name), getattr(found, field.name)
            same = np.allclose(old, new, rtol=1e-12) if isinstance(old, np.ndarray | float) else old == new
            assert same, (light.name, field.name)
    assert b'"what for"' in path.read_bytes()


def test_other_programs_see_the_punctual_light_of_the_same_strength(tmp_path: Path) -> None:
    """Along its axis a panel of radiance L and area A shines with L A candela, a sphere with L pi r^2."""
    write_lights(tmp_path / "a.gltf", BEYOND)
    top = json.loads((tmp_path / "a.gltf").read_text())
    entries = top["extensions"]["KHR_lights_punctual"]["lights"]
    assert [x["type"] for x in entries] == ["directional", "point", "spot", "spot", "spot", "point"]
    expected = [3.3, 2.2, 1.0, 100 * 1.2 * 0.1, math.pi * 0.1**2, 7 * math.pi * 0.15**2]
    assert [x["intensity"] for x in entries] == pytest.approx(expected)
    for entry in entries:
        entry["intensity"] *= 2  # an edit in another program counts
    (tmp_path / "b.gltf").write_text(json.dumps(top))
    for light, found in zip(BEYOND, read_lights(tmp_path / "b.gltf"), strict=True):
        assert found.intensity == pytest.approx(2 * light.intensity)
        assert type(found) is type(light)


@pytest.mark.parametrize(
    ("kind", "extras", "said"),
    [
        ("directional", {"mirelight_angular_diameter": 0}, "extras.mirelight_angular_diameter"),
        ("directional", {"mirelight_angular_diameter": "wide"}, "expected a number"),
        ("point", {"mirelight_radius": -1}, "must not be negative"),
        ("point", {"mirelight_shape": "cube", "mirelight_size": [1, 1]}, "expected rectangle, disk, sphere"),
        ("point", {"mirelight_shape": "sphere"}, "extras.mirelight_size: missing"),
        ("spot", {"mirelight_shape": "disk", "mirelight_size": [1, 0]}, "both must be positive"),
        ("spot", {"mirelight_cone": "blender"}, "expected khr or playcanvas"),
    ],
)
def test_extras_that_no_light_has_are_refused(glb: Any, kind: str, extras: dict[str, object], said: str) -> None:
    glb.light(type=kind, extras=extras, **({"spot": {}} if kind == "spot" else {}))
    with pytest.raises(InputError, match=re.escape(said)):
        read_lights(glb.save())


@pytest.mark.parametrize("extras", ["a word", {"radius": 3}, {"mirelight_shape": "disk"}, None])
def test_extras_of_others_mean_nothing(glb: Any, extras: object) -> None:
    glb.light(type="directional", extras=extras)
    (light,) = read_lights(glb.save())
    assert isinstance(light, DirectionalLight)


def test_what_gltf_cannot_hold_is_refused(tmp_path: Path) -> None:
    measured = IesProfile(share=np.ones((AROUND, DOWN), np.float32))
    lamps: list[Light] = [
        PointLight(name="office", position=np.zeros(3), profile=measured),
        SpotLight(name="office", position=np.zeros(3), direction=measured.nadir, profile=measured),
    ]
    for lamp in lamps:
        with pytest.raises(OutputError, match="'office'"):
            write_glb(tmp_path / "a.glb", lights=[lamp])
    crooked = Camera(world_from_camera=np.eye(4), width=10, height=10, fx=5, fy=5, cx=3, cy=5)
    with pytest.raises(OutputError, match="off-centre"):
        write_glb(tmp_path / "a.glb", cameras=[crooked])
    assert list(tmp_path.iterdir()) == []


def test_the_reference_renderer_s_files() -> None:
    """Lights and camera of the Khronos cases, by hand from their JSON."""
    sun = read_scene(KHRONOS / "dir_nested.glb")
    (light,) = sun.lights
    assert isinstance(light, DirectionalLight) and (light.name, light.intensity) == ("sun", 3)
    yaw, tilt, tip = math.radians(35), math.radians(-20), math.radians(-35)
    # rig: 35 degrees about Y; arm: -20 about X; light: -35 about X; uniform and outermost scale do not bend -Z here.
    pitch = tilt + tip
    away = np.array([0, math.sin(pitch), -math.cos(pitch)])
    turned = [away[2] * math.sin(yaw), away[1], away[2] * math.cos(yaw)]
    assert np.allclose(light.direction, turned, atol=1e-6)
    spots = read_scene(KHRONOS / "spot_default_range.glb")
    first, second = spots.lights
    assert isinstance(first, SpotLight) and isinstance(second, SpotLight)
    assert (first.intensity, first.range, first.inner_cone_angle, first.outer_cone_angle) == (25, 4.5, 0, math.pi / 4)
    assert (second.intensity, second.range, second.outer_cone_angle) == (9, math.inf, math.pi / 2)
    assert np.allclose(first.position, (-1.5, 2.6, 1.5)) and np.allclose(second.position, (2, 1.2, 1))
    for scene in (sun, spots):
        assert scene.mesh is not None and scene.mesh.normals is not None
        assert (len(scene.mesh.vertices), len(scene.mesh.faces)) == (9216, 18050)
        camera = scene.cameras[0].to_camera(320, 240)
        assert np.allclose(camera.position, (3.5, 3, 5))
        assert camera.fy == pytest.approx(120 / math.tan(math.radians(20)))


@pytest.mark.parametrize("case", ["dir_nested", "spot_default_range"])
def test_the_reference_renderer_s_light_from_what_is_read(case: str) -> None:
    """Radiance at projected vertices: what is read, put into the extension's formulas, is what Khronos rendered."""
    scene = read_scene(KHRONOS / f"{case}.glb")
    with np.load(KHRONOS / f"{case}.npz") as frame:
        rendered, coverage = frame["radiance"], frame["coverage"]
    assert scene.mesh is not None and scene.mesh.normals is not None
    camera = scene.cameras[0].to_camera(320, 240)
    points, normals = scene.mesh.vertices.astype(np.float64), scene.mesh.normals.astype(np.float64)
    light = np.zeros((len(points), 3))
    for source in scene.lights:
        assert isinstance(source, (DirectionalLight, SpotLight))
        if isinstance(source, DirectionalLight):
            toward, strength = np.broadcast_to(-source.direction, points.shape), np.full(len(points), source.intensity)
        else:
            path = source.position - points
            distance = np.linalg.norm(path, axis=1)
            toward = path / distance[:, None]
            inner, outer = math.cos(source.inner_cone_angle), math.cos(source.outer_cone_angle)
            cone = np.clip((-toward @ source.direction - outer) / max(inner - outer, 1e-3), 0, 1) ** 2
            window = np.clip(1 - (distance / source.range) ** 4, 0, 1)
            strength = source.intensity * window * cone / distance**2
        light += np.maximum(np.sum(normals * toward, axis=1), 0)[:, None] * strength[:, None] * source.color
    expected = 0.5 / math.pi * light
    seen = np.concatenate([points, np.ones((len(points), 1))], axis=1) @ camera.camera_from_world.T
    column = camera.cx + camera.fx * seen[:, 0] / -seen[:, 2]
    row = camera.cy - camera.fy * seen[:, 1] / -seen[:, 2]
    inside = (column > 2) & (column < 318) & (row > 2) & (row < 238)
    j, i = np.floor(column[inside]).astype(int), np.floor(row[inside]).astype(int)
    near = np.all([coverage[i + a, j + b] == 1 for a in (-1, 0, 1) for b in (-1, 0, 1)], axis=0)
    difference = rendered[i, j][near] - expected[inside][near]
    assert np.count_nonzero(near) > 4000
    assert abs(difference.mean()) < 0.003 * expected.mean()  # nearest pixel instead of the vertex' own place
    assert np.percentile(np.abs(difference), 95) < 0.02 * expected.max()
