"""Objects in whole frames: in the captured light nothing else changes, and what is in front veils them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mirelight
from mirelight.batch.forecast import forecast
from mirelight.io import splats
from mirelight.io.gltf.write import write_glb
from mirelight.lighting import albedo, detail
from mirelight.model import Camera, Frame, Material, ProxyMesh, SplatCloud
from mirelight.pipeline import frame_diagnostics, stages
from mirelight.pipeline.plan import plan
from mirelight.store import Store

JOB = """splats = "splats.ply"
proxy = "proxy.glb"
cameras_from = "proxy"
lightings = "captured"
resolution = [60, 40]

[captured]
environment = { radiance = 0.5 }

[[captured.lights]]
type = "sun"
name = "sun"
direction = [-0.5, -1, -0.3]
intensity = 2
angular_diameter = 3

[render]
spp = 16
"""
BALL = """
[[objects]]
path = "ball.glb"
drop = true
base_color = 0.9
roughness = 0.4
transform = { translation = [0, 3, 0] }
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A floor of splats on a floor, a curtain of splats before its right half, and an octahedron to put there."""
    here = tmp_path_factory.mktemp("yard")
    x, z = np.meshgrid(np.linspace(-3, 3, 41), np.linspace(-3, 3, 41))
    floor = np.stack([x.ravel(), np.zeros(x.size), z.ravel()], axis=1)
    a, b = np.meshgrid(np.linspace(0.1, 1.2, 12), np.linspace(0.1, 1.6, 16))
    curtain = np.stack([a.ravel(), b.ravel(), np.full(a.size, 1.5)], axis=1)
    means = np.concatenate([floor, curtain]).astype(np.float32)
    n = len(means)
    scales = np.tile(np.array([0.09, 0.01, 0.09], np.float32), (n, 1))
    scales[len(floor) :] = [0.06, 0.06, 0.01]
    cloud = SplatCloud(
        means=means,
        quats=np.tile(np.array([1, 0, 0, 0], np.float32), (n, 1)),
        scales=scales,
        opacities=np.full(n, 0.95, np.float32),
        sh=np.zeros((n, 1, 3), np.float32),
    )
    splats.write(cloud, here / "splats.ply")
    ground = ProxyMesh(
        vertices=np.array([[-3, 0, -3], [-3, 0, 3], [3, 0, 3], [3, 0, -3]], np.float32),
        faces=np.array([[0, 1, 2], [0, 2, 3]], np.int32),
    )
    camera = Camera.look_at((0, 1.4, 5), (0, 0.4, 0), 60, 40, yfov=45, name="front")
    write_glb(here / "proxy.glb", ground, (), (camera,))
    tips = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], np.float32) * 0.7
    faces = [[i, j, k] if (i + j + k) % 2 else [j, i, k] for i in (0, 1) for j in (2, 3) for k in (4, 5)]
    ball = ProxyMesh(vertices=tips, faces=np.array(faces, np.int32), materials=(Material(name="white"),))
    write_glb(here / "ball.glb", ball, (), ())
    return here


def frame(folder: Path, text: str) -> Frame:
    path = folder / "job.toml"
    path.write_text(text, encoding="utf-8")
    scene = mirelight.prepare(mirelight.load(path))
    camera, lighting = scene.job.cameras[0], scene.job.lightings[0]
    light = mirelight.light(scene, camera, lighting)
    return mirelight.relight(scene, mirelight.composite(scene, camera), light)


def test_in_the_captured_light_nothing_but_the_object_changes_the_picture(folder: Path) -> None:
    text = JOB + '\n[output]\naovs = ["shadow"]\n'
    bare = frame(folder, text)
    assert bare.factor is not None and bare.unlit is not None
    np.testing.assert_array_equal(bare.factor, 1)
    np.testing.assert_array_equal(bare.rgba, bare.unlit)
    made = frame(folder, text + BALL)
    assert bare.shadow is None and made.shadow is not None  # in the captured light the factor is that shadow
    assert made.factor is not None and made.lighting is not None and made.lighting.objects is not None
    objects = made.lighting.objects
    seen = objects.coverage > 0.99
    assert seen.sum() > 40
    # in its shadow the floor is darker, beside it what the object reflects changes little, far away nothing
    beside = (objects.coverage == 0) & (made.lighting.coverage > 0)
    assert (made.factor[beside] < 0.75).any()
    np.testing.assert_allclose(made.shadow[beside], made.factor[beside], atol=0.05)
    far = beside & (np.abs(made.lighting.position[..., 0]) > 2)
    assert np.mean(np.abs(made.factor[far] - 1) < 0.02) > 0.9
    np.testing.assert_allclose(made.factor[far].mean(), 1, rtol=0.01)
    # left of the curtain the object is seen as it is lit; behind the curtain it is veiled
    left = seen & (np.arange(60) < 27)
    np.testing.assert_allclose(made.rgba[left][:, :3], objects.beauty[left], rtol=1e-3)
    behind = seen & (np.arange(60) >= 32)
    assert behind.any()
    gap = np.abs(made.rgba[behind][:, :3] - objects.beauty[behind]).mean()
    assert gap > 0.1 * float(objects.beauty[behind].mean())


def test_an_object_around_the_camera_is_told(folder: Path) -> None:
    around = BALL.replace("drop = true\n", "").replace("[0, 3, 0]", "[0, 1.4, 5], scale = 3")
    (folder / "around.toml").write_text(JOB + around, encoding="utf-8")
    job = mirelight.load(folder / "around.toml")
    frame = stages.frame(mirelight.prepare(job), job.cameras[0], job.lightings[0])
    (found,) = frame_diagnostics.of_frame(frame, job.display)
    assert found.kind == "objects" and "hide 100% of the picture: the camera stands in one" in found.text


def test_what_an_object_hides_of_the_proxy_is_no_hole_in_it(folder: Path) -> None:
    cloud = splats.read(folder / "splats.ply")
    floor = replace(cloud, **{x: getattr(cloud, x)[: 41 * 41] for x in ("means", "quats", "scales", "opacities", "sh")})
    splats.write(floor, folder / "floor.ply")
    corners = np.array([[-2, 0, 1], [2, 0, 1], [2, 1, 1], [-2, 1, 1]], np.float32)
    write_glb(
        folder / "board.glb", ProxyMesh(vertices=corners, faces=np.array([[0, 1, 2], [0, 2, 3]], np.int32)), (), ()
    )
    large = JOB.replace("splats.ply", "floor.ply") + '[[objects]]\npath = "board.glb"\n'
    (folder / "large.toml").write_text(large, encoding="utf-8")
    job = mirelight.load(folder / "large.toml")
    made = stages.frame(mirelight.prepare(job), job.cameras[0], job.lightings[0])
    assert made.lighting is not None and made.lighting.objects is not None and made.splats is not None
    hidden = (made.lighting.objects.coverage > 0.5) & (made.splats.transmittance < 0.5)
    assert hidden.sum() > 0.2 * (made.splats.transmittance < 0.5).sum()
    assert [x.kind for x in frame_diagnostics.of_frame(made, job.display) if x.kind == "uncovered"] == []


def test_light_of_four_times_the_pixels_shows_the_same_objects(folder: Path) -> None:
    whole, fine = (frame(folder, f"{JOB}\n[relight]\ntexture_scale = {scale}\n{BALL}") for scale in (1, 2))
    assert fine.lighting is not None and fine.lighting.objects is not None
    assert fine.lighting.objects.coverage.shape == whole.rgba.shape[:2]
    np.testing.assert_allclose(fine.rgba.mean((0, 1)), whole.rgba.mean((0, 1)), rtol=0.01)
    assert np.abs(fine.rgba - whole.rgba).mean() < 0.01 * whole.rgba.mean()


def test_the_same_object_and_seed_are_the_same_bits(folder: Path) -> None:
    first, again = frame(folder, JOB + BALL), frame(folder, JOB + BALL)
    np.testing.assert_array_equal(first.rgba, again.rgba)


def test_a_forecast_does_not_take_what_mirrors_show_for_light(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is found once for all frames, and takes longer than a small one."""
    (folder / "forecast.toml").write_text(
        JOB.replace('"proxy.glb"', '{ path = "proxy.glb", albedo = "splats" }') + BALL
    )
    made = mirelight.load(folder / "forecast.toml")
    told, own, light = [0], detail.told, stages.light
    inside: list[int] = []

    def counted(*given: Any, **named: Any) -> Any:
        told[0] += 1
        return own(*given, **named)

    def lit(*given: Any, **named: Any) -> Any:
        before = told[0]
        found = light(*given, **named)
        inside.append(told[0] - before)
        return found

    colored, colors = [0], albedo.vertex_colors

    def found_colors(*given: Any, **named: Any) -> Any:
        colored[0] += 1
        return colors(*given, **named)

    monkeypatch.setattr(detail, "told", counted)
    monkeypatch.setattr(stages, "light", lit)
    monkeypatch.setattr(albedo, "vertex_colors", found_colors)
    assert forecast(plan(made)).traces > 0
    assert inside == [0, 0, 0, 0]  # what compiles, and what is timed
    assert (told, colored) == ([1], [1])
    assert not (folder / "out").exists()


def test_what_mirrors_show_is_made_once_for_every_output(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It takes long. What is made by other settings is another."""
    text = JOB.replace('"proxy.glb"', '{ path = "proxy.glb", albedo = "splats" }') + BALL
    own, told = detail.told, []

    def counted(*given: Any, **named: Any) -> Any:
        told.append(own(*given, **named))
        return told[-1]

    monkeypatch.setattr(detail, "told", counted)
    shown = []
    for output in ("one", "other"):
        (folder / "mirrors.toml").write_text(f'{text}\n[output]\ndirectory = "{output}"\n')
        made = mirelight.load(folder / "mirrors.toml")
        scene = mirelight.prepare(made, Store(made).artefacts)
        shown.append(scene._with(made.objects_of(made.lightings[0]))._mirrored)
    first, again = shown
    assert len(told) == 1 and first is not None and again is not None
    np.testing.assert_array_equal(first.colors, again.colors)
    np.testing.assert_array_equal(first.steps, again.steps)
    made = replace(made, render=replace(made.render, seed=made.render.seed + 1))
    assert mirelight.prepare(made)._with(made.objects_of(made.lightings[0]))._mirrored is not None
    assert len(told) == 2


def test_a_forecast_counts_that_objects_which_move_are_put_elsewhere(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each frame, and each pinhole of an open shutter, has them at another place."""
    keys = "keys = [{ frame = 1 }, { frame = 9, translation = [0.2, 0, 0] }]\n"
    turn = '\n[[cameras]]\ntype = "turntable"\nname = "turn"\nframes = 4\nelevation = 1.5\n'
    (folder / "moving.toml").write_text(JOB.replace('cameras_from = "proxy"\n', "") + BALL + keys + turn)
    made = mirelight.load(folder / "moving.toml")
    own, moments = stages.light, []

    def lit(scene: Any, camera: Camera, *given: Any, **named: Any) -> Any:
        moments.append(camera.frame)
        return own(scene, camera, *given, **named)

    monkeypatch.setattr(stages, "light", lit)
    assert forecast(plan(made)).seconds > 0
    assert len(set(moments)) == len(moments) == 4
