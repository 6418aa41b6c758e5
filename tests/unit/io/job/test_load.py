"""What a right job file becomes: every table as the model's types, files read, defaults filled in."""

from __future__ import annotations

import hashlib
import json
import math
import re
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mirelight
from mirelight import model
from mirelight.base import conventions
from mirelight.base.errors import InputError
from mirelight.io import job
from mirelight.io.job.tables import JobTable
from mirelight.model import AreaLight, DirectionalLight, PointLight, SpotLight, SunLight
from mirelight.pipeline import requirements

from .conftest import WriteJob

SCENE = 'splats = "splats.ply"\nproxy = "proxy.glb"\n'


def test_splats_and_proxy_are_enough(write_job: WriteJob) -> None:
    """What the job does not say is taken from the proxy's glTF: its lights and its cameras."""
    path = write_job(SCENE)
    loaded = mirelight.load(path)
    assert loaded.source == path
    assert loaded.splats is not None and len(loaded.splats.value) == 8
    assert loaded.proxy is not None and len(loaded.proxy.value.faces) == 2
    assert loaded.proxy.value.albedo is not None and loaded.proxy.value.albedo.tolist() == [0.5, 0.5, 0.5]
    (lighting,) = loaded.lightings
    assert (lighting.name, [x.name for x in lighting.lights]) == ("lighting", ["lamp", "moon"])
    assert [(c.name, c.width, c.height) for c in loaded.cameras] == [("left", 1280, 720), ("right", 1280, 720)]
    assert loaded.captured is None
    assert loaded.render == model.RenderSettings()
    assert loaded.compositor == model.CompositorSettings()
    assert loaded.relight == model.RelightSettings()
    assert loaded.display == model.DisplaySettings()
    assert loaded.output == model.OutputSettings(directory=path.parent / "out")


@pytest.mark.parametrize(
    ("section", "settings"),
    [
        ("render", model.RenderSettings),
        ("compositor", model.CompositorSettings),
        ("relight", model.RelightSettings),
        ("display", model.DisplaySettings),
        ("output", model.OutputSettings),
    ],
)
def test_tables_hold_every_setting_of_the_model(section: str, settings: type[Any]) -> None:
    """`profile` stands once, at the top; what splats say of themselves is said beside them; a view has three names,
    what lies behind the splats one, masks are the job's; everything else has its key."""
    table = type(getattr(JobTable(), section))
    elsewhere, names = {"profile", "color_space", "cutoff"}, {"config", "display"}
    elsewhere |= {"transparent", "backdrop"}
    if section == "relight":
        names.add("mask")
    if section == "output":
        elsewhere.remove("color_space")
    assert set(table.model_fields) - names == {f.name for f in fields(settings)} - elsewhere


def test_every_setting_arrives(write_job: WriteJob) -> None:
    loaded = job.load(
        write_job(
            SCENE
            + """\
profile = "playcanvas"
captured = { environment = { radiance = 1 } }
[render]
spp = 7
noise = 0.01
max_depth = 3
seed = 11
variant = "cuda_ad_rgb"
denoise = true
threads = 2
max_memory = 3_000_000_000
[compositor]
sort = "radial"
work_buffer = "large"
min_pixel_size = 0.5
alpha_clip = 0.01
supersampling = 2
tone = "aces"
exposure = 1.5
linear = true
eight_bit = true
max_memory = 2_000_000_000
[relight]
mode = "ratio"
space = "linear"
blend = 0.25
brightness = 1
background = 0.5
texture_scale = 0.5
delta = 0.02
max_ratio = 8
[display]
exposure = -1.5
tone = "agx"
background = [0.1, 0.2, 0.3]
[output]
directory = "frames/a"
exr = true
png = false
layers = false
aovs = false
half = true
"""
        )
    )
    assert loaded.render == model.RenderSettings(
        profile="playcanvas",
        spp=7,
        noise=0.01,
        max_depth=3,
        seed=11,
        variant="cuda_ad_rgb",
        denoise=True,
        threads=2,
        max_memory=3_000_000_000,
    )
    assert loaded.compositor == model.CompositorSettings(
        profile="playcanvas",
        sort="radial",
        work_buffer="large",
        min_pixel_size=0.5,
        alpha_clip=0.01,
        supersampling=2,
        tone="aces",
        exposure=1.5,
        linear=True,
        eight_bit=True,
        max_memory=2_000_000_000,
    )
    assert loaded.relight == model.RelightSettings(
        mode="ratio",
        profile="playcanvas",
        space="linear",
        blend=0.25,
        brightness=1,
        background=0.5,
        texture_scale=0.5,
        delta=0.02,
        max_ratio=8,
    )
    assert loaded.display == model.DisplaySettings(exposure=-1.5, tone="agx", background=(0.1, 0.2, 0.3))
    assert loaded.output == model.OutputSettings(
        directory=loaded.source.parent / "frames" / "a", png=False, layers=False, aovs=False, half=True
    )


@pytest.mark.parametrize(
    ("lines", "mode", "space"),
    [
        ("", "tint", "linear"),
        ("captured = { environment = { radiance = 1 } }", "ratio", "linear"),
        ('profile = "playcanvas"', "tint", "display"),
        ('profile = "playcanvas"\ncaptured = { environment = { radiance = 1 } }', "tint", "display"),
        ('profile = "playcanvas"\ncompositor = { linear = true }', "tint", "linear"),
        ('captured = { environment = { radiance = 1 } }\nrelight = { mode = "tint" }', "tint", "linear"),
        ('relight = { space = "display" }', "tint", "display"),
    ],
)
def test_mode_and_space_follow_the_profile_and_the_captured_light(
    write_job: WriteJob, lines: str, mode: str, space: str
) -> None:
    settings = job.load(write_job(SCENE + lines)).relight
    assert (settings.mode, settings.space) == (mode, space)


# --- splats and proxy ------------------------------------------------------------------------------------------------


def test_transforms_place_splats_and_proxy(write_job: WriteJob) -> None:
    plain = job.load(write_job(SCENE))
    placed = job.load(
        write_job(
            """\
splats = [
    { path = "splats.ply", transform = { scale = 2, rotation_euler = [0, 0, 90], translation = [10, 0, 0] } },
    "splats.ply",
]
proxy = { path = "proxy.glb", transform = { rotation_quaternion = [2, 0, 0, 2] }, albedo = [0.1, 0.2, 0.3] }
"""
        )
    )
    assert plain.splats is not None and placed.splats is not None
    cloud, moved = plain.splats.value, placed.splats.value
    x, y, z = cloud.means.T
    np.testing.assert_allclose(moved.means[:8], np.stack([10 - 2 * y, 2 * x, 2 * z], axis=1), atol=1e-5)
    np.testing.assert_allclose(moved.scales[:8], 0.2, rtol=1e-5)
    np.testing.assert_array_equal(moved.means[8:], cloud.means)
    assert plain.proxy is not None and placed.proxy is not None
    x, y, z = plain.proxy.value.vertices.T
    np.testing.assert_allclose(placed.proxy.value.vertices, np.stack([-y, x, z], axis=1), atol=1e-6)
    assert placed.proxy.value.albedo is not None and placed.proxy.value.albedo.tolist() == [0.1, 0.2, 0.3]
    assert plain.splats.digest != placed.splats.digest and plain.proxy.digest != placed.proxy.digest


def test_albedo_of_the_splats(write_job: WriteJob) -> None:
    """Gray in the file's place, until the pipeline colours it."""
    lines = 'splats = "splats.ply"\nproxy = { path = "proxy.glb", albedo = "splats" }\n'
    loaded = job.load(write_job(lines + "captured = { environment = { radiance = 1 } }\n"))
    assert loaded.albedo_from_splats and requirements.colors_proxy(loaded)
    assert loaded.proxy is not None and loaded.proxy.value.albedo is not None
    assert loaded.proxy.value.albedo.tolist() == [0.5, 0.5, 0.5]
    assert not job.load(write_job('proxy = "proxy.glb"')).albedo_from_splats

    lit = 'captured = { environment = { radiance = 1 } }\n[relight]\nmode = "albedo"\n'
    named = 'splats = "splats.ply"\nproxy = { path = "proxy.glb", albedo = 0.4 }\n'
    assert job.load(write_job('splats = "splats.ply"\nproxy = "proxy.glb"\n' + lit)).albedo_from_splats
    assert not job.load(write_job(named + lit)).albedo_from_splats


def test_albedo_of_the_file(write_job: WriteJob) -> None:
    loaded = job.load(write_job('proxy = { path = "proxy.glb", albedo = "file" }'))
    assert loaded.proxy is not None and loaded.proxy.value.albedo is None
    assert loaded.splats is None


def test_a_matrix_is_the_same_as_its_parts(write_job: WriteJob) -> None:
    parts = job.load(
        write_job('splats = { path = "splats.ply", transform = { scale = 2, rotation_euler = [30, 40, 50] } }')
    )
    m = conventions.compose(rotation=conventions.rotation_from_euler([30, 40, 50]), scale=2).tolist()
    whole = job.load(write_job(f'splats = {{ path = "splats.ply", transform = {{ matrix = {m} }} }}'))
    assert parts.splats is not None and whole.splats is not None
    np.testing.assert_array_equal(parts.splats.value.means, whole.splats.value.means)


def test_inputs_are_named_as_in_the_job_and_hashed(write_job: WriteJob) -> None:
    loaded = job.load(write_job(SCENE))
    expected = {
        name: hashlib.sha256((loaded.source.parent / name).read_bytes()).hexdigest()
        for name in ("proxy.glb", "splats.ply")
    }
    assert loaded.inputs == expected


# --- lights ----------------------------------------------------------------------------------------------------------


def only_lights(path: Path) -> tuple[Any, ...]:
    (lighting,) = job.load(path).lightings
    return lighting.lights


def test_every_kind_of_light(write_job: WriteJob) -> None:
    lights = only_lights(
        write_job(
            SCENE
            + """\
[[lights]]
type = "directional"
direction = [0, -2, 0]
intensity = 3
[[lights]]
type = "sun"
name = "low sun"
direction = [1, -1, 0]
color = [1, 0.5, 0.25]
angular_diameter = 4
[[lights]]
type = "point"
position = [1, 2, 3]
intensity = 100
range = 9
radius = 0.25
[[lights]]
type = "spot"
position = [0, 3, 0]
target = [0, 0, 0]
inner_cone_angle = 10
outer_cone_angle = 30
[[lights]]
type = "spot"
name = "pasted"
position = [0, 3, 0]
direction = [0, -1, 0]
spot = { innerConeAngle = 0.25, outerConeAngle = 0.5 }
[[lights]]
type = "area"
position = [0, 4, 0]
direction = [0, -1, 0]
up = [0, 0, -1]
size = [2, 1]
intensity = 50
[[lights]]
type = "area"
shape = "sphere"
position = [5, 0, 0]
size = 0.5
[[lights]]
type = "point"
position = [0, 0, 0]
"""
        )
    )
    directional, sun, point, spot, pasted, area, sphere, second = lights
    assert isinstance(directional, DirectionalLight)
    assert (directional.name, directional.direction.tolist(), directional.intensity) == ("directional", [0, -1, 0], 3)
    assert isinstance(sun, SunLight)
    assert (sun.name, sun.color.tolist(), sun.angular_diameter) == ("low sun", [1, 0.5, 0.25], 4)
    np.testing.assert_allclose(sun.direction, [math.sqrt(0.5), -math.sqrt(0.5), 0])
    assert isinstance(point, PointLight)
    assert (point.position.tolist(), point.intensity, point.range, point.radius) == ([1, 2, 3], 100, 9, 0.25)
    assert isinstance(spot, SpotLight)
    assert (spot.direction.tolist(), spot.range) == ([0, -1, 0], math.inf)
    assert spot.inner_cone_angle == pytest.approx(math.radians(10))
    assert spot.outer_cone_angle == pytest.approx(math.radians(30))
    assert isinstance(pasted, SpotLight)
    assert (pasted.inner_cone_angle, pasted.outer_cone_angle) == (0.25, 0.5)
    assert isinstance(area, AreaLight)
    assert (area.shape, area.size, area.intensity) == ("rectangle", (2, 1), 50)
    pose = area.world_from_light
    np.testing.assert_allclose(-pose[:3, 2], [0, -1, 0], atol=1e-12)  # it shines along its -Z
    np.testing.assert_allclose(pose[:3, 1], [0, 0, -1], atol=1e-12)  # and its height points up
    np.testing.assert_allclose(pose[:3, 3], [0, 4, 0])
    assert isinstance(sphere, AreaLight) and (sphere.shape, sphere.size) == ("sphere", (0.5, 0.5))
    assert [point.name, second.name] == ["point", "point-2"]


def test_lights_of_a_file_go_with_the_proxy(write_job: WriteJob) -> None:
    """Positions and directions follow the transform; range and intensity do not, as in KHR_lights_punctual."""
    lamp, moon = only_lights(
        write_job(
            """\
proxy = { path = "proxy.glb", transform = { scale = 10, rotation_euler = [0, 0, 180], translation = [0, 0, 1] } }
lights_from = "proxy"
"""
        )
    )
    np.testing.assert_allclose(lamp.position, [-10, -20, 31], atol=1e-9)
    assert (lamp.intensity, lamp.range) == (5, 7)
    np.testing.assert_allclose(moon.direction, [0, 1, 0], atol=1e-12)


def test_lights_of_a_file_by_name_scaled_and_placed(write_job: WriteJob) -> None:
    text = """\
[[lights_from]]
path = "proxy.glb"
names = ["lamp"]
intensity = 3
transform = { translation = [1, 0, 0] }
[[lights_from]]
path = "proxy"
names = ["moon", "lamp"]
[[lights]]
type = "point"
name = "lamp"
position = [0, 0, 0]
"""
    lights = only_lights(write_job(SCENE + text))
    assert [x.name for x in lights] == ["lamp", "lamp-2", "moon", "lamp-3"]
    assert lights[1].position.tolist() == [2, 2, 3] and lights[1].intensity == 15
    assert lights[3].position.tolist() == [1, 2, 3] and lights[3].intensity == 5


def test_names_that_the_file_does_not_have(write_job: WriteJob) -> None:
    path = write_job(
        SCENE
        + 'lights_from = { path = "proxy.glb", names = ["lmap", "sun"] }\n'
        + 'cameras_from = { path = "proxy", names = ["top"] }\n'
    )
    with pytest.raises(Exception) as caught:
        job.load(path)
    lines = str(caught.value).replace(f"{path}", "job").splitlines()
    assert lines == [
        "job:3:46: lights_from.names[0]: no light 'lmap' in 'proxy.glb'; did you mean \"lamp\"?",
        "job:3:54: lights_from.names[1]: no light 'sun' in 'proxy.glb'; it has lamp, moon",
        "job:4:43: cameras_from.names[0]: no camera 'top' in 'proxy'; it has left, right",
    ]


def test_several_lightings_and_a_captured_one(write_job: WriteJob) -> None:
    text = """\
captured = "day"
[[lightings]]
name = "day"
environment = { radiance = [1, 2, 3], intensity = 2 }
[[lightings]]
name = "night"
[[lightings.lights]]
type = "point"
position = [0, 1, 0]
[[lightings]]
name = "both"
lights_from = ["proxy"]
environment = { radiance = 0.1 }
"""
    scene = job.load(write_job(SCENE + text))
    assert [(x.name, x.layer_names) for x in scene.lightings] == [
        ("day", ("environment",)),
        ("night", ("point",)),
        ("both", ("lamp", "moon", "environment")),
    ]
    assert scene.captured is scene.lightings[0]
    environment = scene.lightings[0].environment
    assert environment is not None and environment.is_constant
    assert (environment.pixels.tolist(), environment.intensity) == ([[[1, 2, 3]]], 2)


def test_captured_as_a_table(write_job: WriteJob) -> None:
    text = '[captured]\n[[captured.lights]]\ntype = "sun"\ndirection = [0, -1, 0]\n'
    captured = job.load(write_job(SCENE + text)).captured
    assert captured is not None and captured.layer_names == ("sun",)


def test_an_empty_list_of_lights_is_no_light(write_job: WriteJob) -> None:
    assert job.load(write_job(SCENE + "lights = []\n")).lightings == ()


def test_splats_alone_are_shown_as_captured(write_job: WriteJob) -> None:
    scene = job.load(write_job('splats = "splats.ply"'))
    assert scene.lightings == () and scene.proxy is None and len(scene.cameras) == 1


# --- environments ----------------------------------------------------------------------------------------------------


def mirelight_direction(u: float, rotation: float) -> tuple[float, float]:
    """(x, z) of column u, written from mirelight.base.conventions: +X at 0.5, +Z at 0.75; turned about +Y."""
    angle = (u - 0.5) * 2 * math.pi
    x, z = math.cos(angle), math.sin(angle)
    t = math.radians(rotation)  # counter-clockwise seen from above: X goes to -Z
    return x * math.cos(t) + z * math.sin(t), -x * math.sin(t) + z * math.cos(t)


def playcanvas_direction(u: float, rotation: float) -> tuple[float, float]:
    """(x, z) of column u as the engine has it: phi = (u - 0.5) 2 pi + rotation, (-sin phi, cos phi)."""
    phi = (u - 0.5) * 2 * math.pi + math.radians(rotation)
    return -math.sin(phi), math.cos(phi)


@pytest.mark.parametrize("rotation", [0, 30, -90, 170, 400])
def test_playcanvas_orientation_shows_the_same_light(write_job: WriteJob, rotation: float) -> None:
    text = f'environment = {{ radiance = 1, rotation = {rotation}, orientation = "playcanvas" }}\n'
    environment = job.load(write_job(SCENE + text)).lightings[0].environment
    assert environment is not None and -180 < environment.rotation <= 180
    for u in (0.1, 0.5, 0.75):
        ours = mirelight_direction(u, environment.rotation)
        assert ours == pytest.approx(playcanvas_direction(u, rotation), abs=1e-12)


def test_the_engines_axes_by_name() -> None:
    assert playcanvas_direction(0.5, 0) == pytest.approx((0, 1), abs=1e-12)  # u = 0.5 looks to +Z
    assert playcanvas_direction(0.75, 0) == pytest.approx((-1, 0), abs=1e-12)  # u = 0.75 to -X
    assert mirelight_direction(0.5, 0) == pytest.approx((1, 0), abs=1e-12)
    assert mirelight_direction(0.5, 90) == pytest.approx((0, -1), abs=1e-12)


def test_blender_orientation_is_left_alone(write_job: WriteJob) -> None:
    text = "environment = { radiance = 1, rotation = 30 }\n"
    environment = job.load(write_job(SCENE + text)).lightings[0].environment
    assert environment is not None and environment.rotation == 30


# --- cameras ---------------------------------------------------------------------------------------------------------


def cameras(path: Path, *overrides: str) -> tuple[model.Camera, ...]:
    return job.load(path, overrides).cameras


def test_look_at_matrix_intrinsics_and_orthographic(write_job: WriteJob) -> None:
    text = """\
resolution = [400, 300]
[[cameras]]
name = "a"
position = [0, 0, 5]
target = [0, 0, 0]
yfov = 90
near = 0.5
far = 20
[[cameras]]
matrix = [[1, 0, 0, 1], [0, 1, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]]
width = 200
height = 100
fx = 150
cx = 90
[[cameras]]
type = "orthographic"
position = [0, 0, 5]
target = [0, 0, 0]
up = [1, 0, 0]
ymag = 1.5
"""
    a, b, c = cameras(write_job(SCENE + text))
    assert (a.name, a.width, a.height, a.near, a.far) == ("a", 400, 300, 0.5, 20)
    assert a.fx == a.fy == pytest.approx(150)
    assert (b.name, b.width, b.height, b.fx, b.fy, b.cx, b.cy) == ("camera", 200, 100, 150, 150, 90, 50)
    assert b.position.tolist() == [1, 2, 3] and b.far == math.inf
    assert (c.name, c.projection, c.fy) == ("camera-2", "orthographic", 100)
    np.testing.assert_allclose(c.world_from_camera[:3, 1], [1, 0, 0], atol=1e-12)


def test_a_turntable_circles_counter_clockwise(write_job: WriteJob) -> None:
    text = """\
[[cameras]]
type = "turntable"
name = "orbit"
target = [1, 0, 0]
radius = 2
elevation = 0.5
frames = 4
"""
    found = cameras(write_job(SCENE + text))
    assert [c.name for c in found] == ["orbit.0001", "orbit.0002", "orbit.0003", "orbit.0004"]
    expected = [[1, 0.5, 2], [3, 0.5, 0], [1, 0.5, -2], [-1, 0.5, 0]]  # from +Z towards +X
    np.testing.assert_allclose([c.position for c in found], expected, atol=1e-12)
    for camera in found:
        toward = np.array([1, 0, 0]) - camera.position
        np.testing.assert_allclose(-camera.world_from_camera[:3, 2], toward / np.linalg.norm(toward), atol=1e-12)


def corners_in_view(camera: model.Camera, points: np.ndarray) -> np.ndarray:
    local = points @ camera.camera_from_world[:3, :3].T + camera.camera_from_world[:3, 3]
    x = camera.cx + camera.fx * local[:, 0] / -local[:, 2]
    y = camera.cy - camera.fy * local[:, 1] / -local[:, 2]
    return (local[:, 2] < -camera.near) & (x >= 0) & (x <= camera.width) & (y >= 0) & (y <= camera.height)


@pytest.mark.parametrize("resolution", [[640, 360], [360, 640]])
@pytest.mark.parametrize("lines", ["", '[[cameras]]\ntype = "turntable"\nframes = 5\nelevation = 1.0\n'])
def test_cameras_without_a_place_see_all_splats(write_job: WriteJob, resolution: list[int], lines: str) -> None:
    loaded = job.load(write_job(f'splats = "splats.ply"\nresolution = {resolution}\n{lines}'))
    assert loaded.splats is not None
    for camera in loaded.cameras:
        assert corners_in_view(camera, loaded.splats.value.means).all()
        share = camera.fy * 2 / np.linalg.norm(camera.position) / min(resolution)
        assert share > 0.3  # and the scene is not a dot


def test_cameras_of_a_file(write_job: WriteJob) -> None:
    text = """\
proxy = { path = "proxy.glb", transform = { translation = [0, 1, 0], scale = 2 } }
resolution = [320, 240]
cameras_from = ["proxy", { path = "proxy.glb", names = ["right"] }]
"""
    found = cameras(write_job(text))
    assert [c.name for c in found] == ["left", "right", "right-2"]
    np.testing.assert_allclose([c.position for c in found], [[-4, 1, 10], [4, 1, 10], [2, 0, 5]], atol=1e-5)
    assert found[0].fy == pytest.approx(240 / (2 * math.tan(math.radians(20))), rel=1e-6)


def test_a_file_without_cameras_says_so(write_job: WriteJob, tmp_path: Path) -> None:
    from mirelight.io.gltf.write import write_glb

    write_glb(tmp_path / "empty.glb", lights=[PointLight(name="x", position=np.zeros(3))])
    with pytest.raises(InputError, match=r"job.toml:3:16: cameras_from: 'empty.glb' holds no camera"):
        cameras(write_job(SCENE + 'cameras_from = "empty.glb"\n'))


def test_still_cameras_cannot_be_sampled(write_job: WriteJob) -> None:
    with pytest.raises(InputError, match="nothing moves the camera 'left'"):
        cameras(write_job(SCENE + 'cameras_from = { path = "proxy", frames = 3 }\n'))


ANIMATED = {
    "asset": {"version": "2.0"},
    "scene": 0,
    "scenes": [{"nodes": [0]}],
    "nodes": [{"name": "fly", "camera": 0}],
    "cameras": [{"type": "perspective", "name": "fly", "perspective": {"yfov": 0.7, "znear": 0.1}}],
    "animations": [
        {
            "channels": [{"sampler": 0, "target": {"node": 0, "path": "translation"}}],
            "samplers": [{"input": 0, "output": 1}],
        }
    ],
    "buffers": [{"uri": "path.bin", "byteLength": 32}],
    "bufferViews": [{"buffer": 0, "byteLength": 8}, {"buffer": 0, "byteOffset": 8, "byteLength": 24}],
    "accessors": [
        {"bufferView": 0, "componentType": 5126, "count": 2, "type": "SCALAR", "min": [0], "max": [2]},
        {"bufferView": 1, "componentType": 5126, "count": 2, "type": "VEC3"},
    ],
}


def test_an_animated_camera_is_sampled(write_job: WriteJob, tmp_path: Path) -> None:
    (tmp_path / "fly.gltf").write_text(json.dumps(ANIMATED))
    (tmp_path / "path.bin").write_bytes(np.array([0, 2, 0, 0, 5, 4, 0, 5], dtype="<f4").tobytes())
    stepped = cameras(write_job(SCENE + 'cameras_from = { path = "fly.gltf", frames = 5 }\n'))
    assert [c.name for c in stepped] == [f"fly.{n:04d}" for n in range(1, 6)]
    np.testing.assert_allclose([c.position for c in stepped], [[x, 0, 5] for x in range(5)], atol=1e-6)
    assert len(cameras(write_job(SCENE + 'cameras_from = { path = "fly.gltf", fps = 1 }\n'))) == 3
    still = cameras(write_job(SCENE + 'cameras_from = "fly.gltf"\n'))
    assert [c.name for c in still] == ["fly"]


def test_what_a_gltf_file_names_counts_for_its_digest(write_job: WriteJob, tmp_path: Path) -> None:
    (tmp_path / "fly.gltf").write_text(json.dumps(ANIMATED))
    binary = tmp_path / "path.bin"
    path = write_job(SCENE + 'cameras_from = "fly.gltf"\n')
    digests = []
    for content in (b"\0" * 32, b"\0" * 31 + b"\1"):
        binary.write_bytes(content)
        digests.append(job.load(path).inputs["fly.gltf"])
    assert digests[0] != digests[1]


def test_resolution_scale(write_job: WriteJob) -> None:
    (whole, _), (half, _) = cameras(write_job(SCENE)), cameras(write_job(SCENE), "resolution_scale=0.5")
    assert (half.width, half.height) == (640, 360)
    assert (half.fx / whole.fx, half.cx / whole.cx) == (0.5, 0.5)
    (tiny, _) = cameras(write_job(SCENE), "resolution_scale=0.0001")
    assert (tiny.width, tiny.height) == (1, 1)


@pytest.mark.parametrize(("value", "said"), [("sky", "'sky'; give a number, or \"environment\""), ("-1", "at least 0")])
def test_a_background_factor_is_a_number_or_the_environment(value: str, said: str) -> None:
    written = Path(__file__).resolve().parents[4] / "scenes" / "plinth" / "job.toml"
    assert mirelight.load(written, ["relight.background=environment"]).relight.follows_sky
    assert mirelight.load(written, ["relight.background=0.5"]).relight.far_number == 0.5
    with pytest.raises(InputError, match=re.escape(said)):
        mirelight.load(written, [f"relight.background={value}"])
