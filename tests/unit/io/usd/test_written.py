"""Stages as they are written: sound by USD's own checker, and read back as what they were, in every bit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mirelight.apps.bake import write_stage
from mirelight.base import colour
from mirelight.base.conventions import look_at
from mirelight.io import splats
from mirelight.io.job.shutters import open_between
from mirelight.io.mesh import read_mesh
from mirelight.io.usd.cameras import read_cameras, sample_cameras
from mirelight.io.usd.lights import read_lights
from mirelight.model import (
    AreaLight,
    Camera,
    Deferred,
    DirectionalLight,
    Environment,
    Exposure,
    Job,
    Light,
    Lighting,
    Material,
    PointLight,
    ProxyMesh,
    SpotLight,
    SunLight,
    digest,
)
from tests.unit.io.splats import truth
from tests.unit.io.usd.checking import faults

pytest.importorskip("pxr")

_DOWN = np.array([0.1, -1.0, 0.3])
_LIGHTS: tuple[Light, ...] = (
    DirectionalLight(name="parallel", direction=_DOWN, intensity=3.3),
    SunLight(name="sun", direction=_DOWN, color=np.array([1.0, 0.9, 0.7]), intensity=1.1, angular_diameter=0.7),
    PointLight(name="dot", position=np.array([0.1, 2.0, 0.3]), intensity=7.7),
    PointLight(name="ball", position=np.array([0.1, 2.0, 0.3]), intensity=7.7, radius=0.3, range=9.0),
    SpotLight(name="spot", position=np.array([0.1, 2.0, 0.3]), direction=_DOWN, intensity=5.5, inner_cone_angle=0.2),
    AreaLight(name="panel", shape="rectangle", world_from_light=look_at([0, 3, 1], [0, 0, 0]), size=(1.2, 0.7)),
    AreaLight(name="plate", shape="disk", world_from_light=look_at([0, 3, 1], [0, 0, 0]), size=(0.9, 0.9)),
)


def _job(tmp_path: Path, camera: Camera) -> tuple[Job, Lighting]:
    cloud = truth.cloud(100)
    vertices = np.array([[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0.1, 1]], np.float32)
    mesh = ProxyMesh(vertices=vertices, faces=np.array([[0, 2, 1], [0, 3, 2]], np.int32))
    sky = np.random.default_rng(0).random((8, 16, 3)).astype(np.float32)
    around = Environment(radiance=sky, rotation=0.0)
    lighting = Lighting(name="night", lights=_LIGHTS, environment=around)
    job = Job(
        source=tmp_path / "job.toml",
        splats=Deferred("a", lambda: cloud),
        proxy=Deferred("b", lambda: mesh),
        cameras=(camera,),
        lightings=(lighting,),
    )
    return job, lighting


@pytest.mark.parametrize("suffix", [".usda", ".usdz"])
def test_a_stage_is_sound_and_comes_back_in_every_bit(tmp_path: Path, suffix: str) -> None:
    camera = Camera(
        name="view",
        world_from_camera=look_at([0.3, 1.7, 4.1], [0.1, 0.2, 0.0]),
        width=321,
        height=240,
        fx=299.7,
        fy=299.7,
        cx=150.3,
        cy=121.9,
        exposure=Exposure(aperture_radius=0.013, focus_distance=3.1),
    )
    job, lighting = _job(tmp_path, camera)
    path = tmp_path / f"stage{suffix}"
    write_stage(path, replace(truth.cloud(100), sh=2 * truth.cloud(100).sh), job, lighting, {"view": "out/view.exr"})
    assert faults(path) == []

    assert job.splats is not None and job.proxy is not None
    found = splats.read(path)  # those as captured, which are not seen, stand for those relit from them
    assert digest(found.sh) == digest(job.splats.value.sh)
    assert digest(read_mesh(path).vertices, read_mesh(path).faces) == digest(
        job.proxy.value.vertices, job.proxy.value.faces
    )
    lights = read_lights(path)
    assert digest(lights.lights) == digest(_LIGHTS)
    assert lighting.environment is not None and lights.environment is not None
    np.testing.assert_array_equal(lights.environment, lighting.environment.pixels)
    assert digest(read_cameras(path)[0].to_camera(321, 240)) == digest(camera)


def test_usds_own_words_say_the_same_but_for_single_precision(tmp_path: Path) -> None:
    lens = Exposure(aperture_radius=0.013, focus_distance=3.1)
    camera = replace(Camera.look_at([0, 1, 4], [0, 0, 0], 64, 48), exposure=lens)
    job, lighting = _job(tmp_path, camera)
    path = tmp_path / "stage.usda"
    write_stage(path, truth.cloud(100), job, lighting, {"view": "out/view.night.exr"})
    path.write_text(path.read_text().replace("string exact", "string other"))
    for was, now in zip(_LIGHTS, read_lights(path).lights, strict=True):
        assert now.color == pytest.approx(was.color, rel=1e-6)
        if not isinstance(was, SpotLight):  # whose edge is a table of directions then
            assert type(now) is type(was) or was.name == "ball"
        factor = np.pi * 0.3**2 if was.name == "ball" else 1.0  # a sphere of a luminance
        assert now.intensity * factor == pytest.approx(was.intensity, rel=1e-5)
    found = read_cameras(path)[0].to_camera(64, 48)
    assert found.fx == pytest.approx(camera.fx, rel=1e-6) and found.exposure is not None
    assert found.exposure.aperture_radius == pytest.approx(lens.aperture_radius, rel=1e-6)
    assert found.exposure.focus_distance == pytest.approx(lens.focus_distance, rel=1e-6)


def test_cameras_of_an_animation_are_one_that_moves(tmp_path: Path) -> None:
    from pxr import Usd, UsdRender

    from mirelight.io.usd.write import StageWriter
    from mirelight.io.usd.write_lights import add_camera

    shots = [Camera.look_at([0, 1, 4 + k], [0, 0, 0], 64, 48, yfov=40 + k, name=f"dolly.{k + 1:04d}") for k in range(3)]
    lenses = [Exposure(aperture_radius=0.01, focus_distance=4.1 + k) for k in range(3)]
    timed = [replace(shot, time=k / 12, exposure=lenses[k]) for k, shot in enumerate(shots)]
    open_ = open_between(timed, -0.25, 0.25)
    writer = StageWriter(tmp_path / "dolly.usdc")
    add_camera(writer, open_, {shot.name: f"out/{shot.name}.night.exr" for shot in timed})
    writer.save()
    found = sample_cameras(tmp_path / "dolly.usdc", "dolly", fps=12)
    assert len(found) == 3 and found[0][1].shutter == pytest.approx((-0.25 / 12, 0.25 / 12))
    for (time, one), shot in zip(found, timed, strict=True):
        assert time == pytest.approx(shot.time)
        back = one.to_camera(64, 48)
        assert digest(replace(back, name=shot.name, time=shot.time)) == digest(shot)
    stage = Usd.Stage.Open(str(tmp_path / "dolly.usdc"))
    name = UsdRender.Product(stage.GetPrimAtPath("/Render/products/dolly")).GetProductNameAttr()
    assert [name.Get(2 * k) for k in range(3)] == [f"out/{shot.name}.night.exr" for shot in timed]


def test_a_proxy_comes_back_with_its_objects_materials_and_textures(tmp_path: Path) -> None:
    from mirelight.io.usd.write import StageWriter
    from mirelight.io.usd.write_mesh import add_proxy

    bricks = colour.srgb_decode(np.random.default_rng(0).integers(0, 256, (4, 6, 3)) / 255)
    glow = np.random.default_rng(1).random((3, 2, 3)).astype(np.float32) * 9
    vertices = np.random.default_rng(2).random((9, 3)).astype(np.float32)
    mesh = ProxyMesh(
        vertices=vertices,
        faces=np.arange(9, dtype=np.int32).reshape(3, 3),
        uvs=(np.arange(18, dtype=np.float32) / np.float32(16)).reshape(9, 2),
        materials=(
            Material(name="wall", base_color_texture=bricks, base_color_wrap=("mirror", "clamp"), emissive=np.ones(3)),
            Material(name="lamp", base_color=np.array([0.5, 0.25, 0.125]), emissive=np.ones(3), emissive_texture=glow),
        ),
        face_materials=np.array([0, 1, 1], np.int32),
        face_nodes=np.array([0, 0, 1], np.int32),
        nodes=("room", "shade"),
        albedo=None,
    )
    for suffix in (".usda", ".usdz"):
        writer = StageWriter(tmp_path / f"room{suffix}")
        add_proxy(writer, mesh)
        writer.save()
        assert faults(tmp_path / f"room{suffix}") == []
        found = read_mesh(tmp_path / f"room{suffix}")
        assert digest(replace(found, albedo=None)) == digest(mesh)
    assert {x.suffix for x in tmp_path.iterdir()} == {".usda", ".usdz", ".png", ".exr"}
    painted = replace(mesh, vertex_colors=vertices, materials=(Material(name="paint"),), face_materials=None)
    writer = StageWriter(tmp_path / "painted.usda")
    add_proxy(writer, painted)
    writer.save()
    assert digest(replace(read_mesh(tmp_path / "painted.usda"), albedo=None)) == digest(painted)
