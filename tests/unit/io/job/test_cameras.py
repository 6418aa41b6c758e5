"""Cameras of a job: from a capture's files, and many at once from one table."""

from __future__ import annotations

import hashlib
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mirelight.base import conventions
from mirelight.base.errors import InputError
from mirelight.io import job
from mirelight.io.gltf.write import write_glb
from mirelight.io.job.sampling import focus
from mirelight.io.job.shutters import open_between
from mirelight.model import Camera, ProxyMesh

from ..cameras.views import POINTS, View, colmap_text, pixels_of, views, write_json, write_ssproj
from .conftest import WriteJob

SCENE = 'splats = "splats.ply"\nproxy = "proxy.glb"\n'
UPRIGHT = (
    'splats = { path = "splats.ply", transform = { rotation_euler = [0, 0, 180], scale = 2 } }\nproxy = "proxy.glb"\n'
)


def cameras(path: Path, *overrides: str) -> tuple[Camera, ...]:
    return job.load(path, overrides).cameras


def placed() -> np.ndarray:
    """The test points after the transform of UPRIGHT."""
    return 2 * POINTS * [-1, -1, 1]


# --- files of a capture ----------------------------------------------------------------------------------------------


def test_cameras_of_a_capture_follow_its_splats(write_job: WriteJob, tmp_path: Path) -> None:
    """Pixels stay what they were in the capture, once splats and cameras are both placed."""
    colmap_text(tmp_path / "sparse" / "0", views())
    for transform, points in (
        (None, placed()),
        ('"splats"', placed()),
        ('"none"', POINTS),
        ("{ scale = 3 }", 3 * POINTS),
    ):
        more = f", transform = {transform}" if transform else ""
        found = cameras(write_job(UPRIGHT + f'cameras_from = {{ path = "sparse/0"{more} }}\n'))
        assert [c.name for c in found] == [v.name for v in views()]
        for camera, view in zip(found, views(), strict=True):
            assert (camera.width, camera.height) == (view.width, view.height)
            np.testing.assert_allclose(pixels_of(camera, points), view.pixels(), rtol=0, atol=1e-6)


def test_a_lens_by_its_f_stop_and_what_it_looks_at(write_job: WriteJob, tmp_path: Path) -> None:
    """As photographers reckon: 50 mm at f/2 on a full frame is an aperture 25 mm wide."""
    pose = "position = [0, 1, 4]\ntarget = [0, 1, 1]\n"
    lens = cameras(write_job(SCENE + f"[[cameras]]\n{pose}focal_length = 50\nf_stop = 2\n"))[0].exposure
    assert lens is not None and (lens.aperture_radius, lens.focus_distance) == pytest.approx((0.0125, 3))
    orbit = '[[cameras]]\ntype = "orbit"\nframes = 2\nradius = 5\naperture_radius = 0.3\n'
    for camera in cameras(write_job(SCENE + orbit)):
        assert camera.exposure is not None and camera.exposure.focus_distance == pytest.approx(5)
    colmap_text(tmp_path / "sparse", views())
    more = 'path = "sparse", aperture_radius = 0.02, focus_distance = 7'
    found = cameras(write_job(SCENE + f"cameras_from = {{ {more} }}\n"))
    assert all(x.exposure is not None and x.exposure.focus_distance == 7 for x in found)
    assert all(x.exposure is None for x in cameras(write_job(SCENE + 'cameras_from = "sparse"\n')))


def test_an_open_shutter_follows_the_circle_and_the_frames_beside(write_job: WriteJob, tmp_path: Path) -> None:
    orbit = '[[cameras]]\ntype = "orbit"\nframes = 8\nradius = 5\nelevation = 20\nshutter = 0.5\n'
    for camera in cameras(write_job(SCENE + orbit)):
        assert camera.exposure is not None and camera.exposure.poses is not None
        places = camera.exposure.poses[:, :3, 3] - (camera.position - 5 * camera.world_from_camera[:3, 2])
        np.testing.assert_allclose(np.linalg.norm(places, axis=1), 5, atol=1e-9)
        turned = np.degrees(np.unwrap(np.arctan2(places[:, 0], places[:, 2])))
        np.testing.assert_allclose(np.diff(turned), 45 * 0.5 / 4, atol=1e-9)
        np.testing.assert_allclose(camera.exposure.poses[2], camera.world_from_camera, atol=1e-12)
    line = [replace(Camera.look_at((k, 1, 4), (k, 1, 0), 8, 6), time=k / 12) for k in range(3)]
    for k, camera in enumerate(open_between(line, -0.25, 0.5)):
        assert camera.exposure is not None and camera.exposure.poses is not None
        np.testing.assert_allclose(camera.exposure.poses[:, 0, 3], k + np.linspace(-0.25, 0.5, 5), atol=1e-12)
        assert camera.exposure.shutter == pytest.approx((-0.25 / 12, 0.5 / 12))
    with pytest.raises(InputError, match="no frames that follow each other"):
        cameras(write_job(SCENE + 'cameras_from = { path = "proxy", shutter = 0.5 }\n'))


def test_only_what_is_read_counts_as_input(write_job: WriteJob, tmp_path: Path) -> None:
    """Neither the capture's pictures nor its points decide whether a frame is made again."""
    colmap_text(tmp_path / "cap" / "sparse" / "0", views())
    (tmp_path / "cap" / "images").mkdir()
    (tmp_path / "cap" / "images" / "view_000.png").write_bytes(b"picture")
    frames = [{"file_path": "cap/images/view_000.png", "transform_matrix": np.eye(4).tolist()}]
    write_json(tmp_path / "transforms.json", {"camera_angle_x": 0.7, "frames": frames})
    loaded = job.load(write_job(SCENE + 'cameras_from = ["cap", "transforms.json"]\n'))
    assert set(loaded.inputs) - {"splats.ply", "proxy.glb"} == {
        "cap/sparse/0/cameras.txt",
        "cap/sparse/0/images.txt",
        "transforms.json",
    }
    assert loaded.inputs["transforms.json"] == hashlib.sha256((tmp_path / "transforms.json").read_bytes()).hexdigest()
    again = tmp_path / "cap" / "images" / "view_000.png"
    again.write_bytes(b"another")
    assert job.load(loaded.source).inputs == loaded.inputs


def test_names_patterns_and_every(write_job: WriteJob, tmp_path: Path) -> None:
    colmap_text(tmp_path / "sparse", views(12))
    for text, wanted in (
        ('names = ["view_003", "view_001"]', ["view_003", "view_001"]),
        ('names = ["view_00?"], every = 4', ["view_000", "view_004", "view_008"]),
        ('names = ["*_01*", "view_010"]', ["view_010", "view_011"]),
        ("every = 5", ["view_000", "view_005", "view_010"]),
    ):
        found = cameras(write_job(SCENE + f'cameras_from = {{ path = "sparse", {text} }}\n'))
        assert [c.name for c in found] == wanted
    with pytest.raises(InputError, match=r"cameras_from.names\[1\]: no camera 'vew\*' in 'sparse'"):
        cameras(write_job(SCENE + 'cameras_from = { path = "sparse", names = ["view_001", "vew*"] }\n'))


def test_patterns_of_a_gltf_file(write_job: WriteJob) -> None:
    found = cameras(write_job(SCENE + 'cameras_from = { path = "proxy", names = ["*t"], transform = "none" }\n'))
    assert [c.name for c in found] == ["left", "right"]
    (left,) = cameras(write_job(SCENE + 'cameras_from = { path = "proxy", every = 2, resolution = [60, 40] }\n'))
    assert (left.name, left.width, left.height) == ("left", 60, 40)


def test_resolution_of_a_capture_s_cameras(write_job: WriteJob, tmp_path: Path) -> None:
    colmap_text(tmp_path / "sparse", views(1))
    view = views(1)[0]

    def one(text: str, *overrides: str) -> Camera:
        (found,) = cameras(write_job(SCENE + f'cameras_from = {{ path = "sparse"{text} }}\n'), *overrides)
        return found

    whole = one("")
    assert (whole.fx, whole.fy, whole.cx, whole.cy) == (view.fx, view.fy, view.cx, view.cy)
    half = one(", resolution_scale = 0.5")
    assert (half.width, half.height) == (320, 240)
    np.testing.assert_allclose(pixels_of(half), pixels_of(whole) / 2, atol=1e-9)
    quarter = one(", resolution_scale = 0.5", "resolution_scale=0.5")
    assert (quarter.width, quarter.height) == (160, 120)
    wide = one(", resolution = [960, 480]")
    np.testing.assert_allclose(pixels_of(wide), np.add(pixels_of(whole), (160, 0)), atol=1e-9)


def test_files_without_a_size_take_the_job_s(write_job: WriteJob, tmp_path: Path) -> None:
    frames = [{"file_path": "a", "transform_matrix": np.eye(4).tolist()}]
    write_json(tmp_path / "transforms_train.json", {"camera_angle_x": 0.7, "frames": frames})
    (found,) = cameras(write_job(SCENE + 'resolution = [200, 100]\ncameras_from = "transforms_train.json"\n'))
    assert (found.width, found.height) == (200, 100)
    assert found.fx == pytest.approx(100 / math.tan(0.35))


def bent(folder: Path, k: str = "0.02") -> None:
    folder.mkdir()
    (folder / "cameras.txt").write_text(
        f"1 SIMPLE_RADIAL 1920 1080 1500 960 540 {k}\n2 PINHOLE 1920 1080 1500 1500 960 540\n"
    )
    lines = [f"{i} 1 0 0 0 0 0 3 {1 if i < 4 else 2} img_{i}.png\n\n" for i in range(1, 6)]
    (folder / "images.txt").write_text("".join(lines))


def test_distortion_is_refused_unless_it_is_ignored(write_job: WriteJob, tmp_path: Path) -> None:
    bent(tmp_path / "sparse")
    path = write_job(SCENE + 'cameras_from = { path = "sparse" }\n')
    with pytest.raises(InputError) as caught:
        cameras(path)
    assert str(caught.value) == (
        f"{path}:3:25: cameras_from.path: 'sparse', camera 'img_1' and 2 more: a lens of model SIMPLE_RADIAL that "
        'moves pixels by up to 11.9; undistort the capture, or say distortion = "ignore" for the pinhole of the same '
        "focal length"
    )
    found = cameras(write_job(SCENE + 'cameras_from = { path = "sparse", distortion = "ignore" }\n'))
    assert [c.fx for c in found] == [1500] * 5
    assert len(cameras(write_job(SCENE + 'cameras_from = { path = "sparse", names = ["img_4", "img_5"] }\n'))) == 2


def test_a_lens_that_hardly_bends_is_straight(write_job: WriteJob, tmp_path: Path) -> None:
    bent(tmp_path / "sparse", "1e-6")
    assert len(cameras(write_job(SCENE + 'cameras_from = "sparse"\n'))) == 5


@pytest.mark.parametrize(
    ("option", "kind"),
    [
        ('axes = "opencv"', "COLMAP"),
        ('world = "nerfstudio"', "glTF"),
        ("fps = 3", "COLMAP"),
        ('distortion = "ignore"', "glTF"),
    ],
)
def test_options_that_a_format_does_not_have(write_job: WriteJob, tmp_path: Path, option: str, kind: str) -> None:
    colmap_text(tmp_path / "sparse", views(1))
    name = option.split(" ")[0]
    named = "proxy" if kind == "glTF" else "sparse"
    with pytest.raises(InputError, match=f"cameras_from.{name}: {name} for '{named}', which is {kind}; leave it out"):
        cameras(write_job(SCENE + f'cameras_from = {{ path = "{named}", {option} }}\n'))


def test_a_world_that_a_format_does_not_lead_to(write_job: WriteJob, tmp_path: Path) -> None:
    """Where cameras_from names it that is wrong; cameras of other formats lie in the splats' world as they are."""
    frames = [{"file_path": x.name, "transform_matrix": x.opengl.tolist()} for x in views(2)]
    data = {"camera_angle_x": 0.9, "w": 64, "h": 48, "frames": frames}
    write_json(tmp_path / "transforms.json", data)
    said = "cameras_from.world: gsplat for 'transforms.json', which is transforms.json; give capture or nerfstudio"
    with pytest.raises(InputError, match=said):
        cameras(write_job(SCENE + 'cameras_from = { path = "transforms.json", world = "gsplat" }\n'))
    moved = SCENE.replace('splats = "splats.ply"', 'splats = { path = "splats.ply", world = "gsplat" }')
    found = cameras(write_job(moved + 'cameras_from = "transforms.json"\n'))
    np.testing.assert_allclose(found[1].world_from_camera, views(2)[1].opengl, atol=1e-12)
    scaled = moved.replace("gsplat", "nerfstudio")
    one, other = cameras(write_job(scaled + 'cameras_from = "transforms.json"\n'))
    np.testing.assert_allclose(one.position, -other.position, atol=1e-9)  # the mean of all places is the origin there
    assert np.abs(one.position).max() == pytest.approx(1)


def test_several_captures_need_a_word(write_job: WriteJob, tmp_path: Path) -> None:
    colmap_text(tmp_path / "sparse", views(1))
    two = 'splats = ["splats.ply", { path = "splats.ply", transform = { scale = 2 } }]\n'
    with pytest.raises(InputError, match="the job's splats have different transforms"):
        cameras(write_job(two + 'cameras_from = "sparse"\n'))
    assert len(cameras(write_job(two + 'cameras_from = { path = "sparse", transform = "none" }\n'))) == 1


def test_a_wrong_word_for_a_transform(write_job: WriteJob, tmp_path: Path) -> None:
    colmap_text(tmp_path / "sparse", views(1))
    with pytest.raises(InputError, match=r"job.toml:3:47: cameras_from.transform: 'splat'; did you mean \"splats\"\?"):
        cameras(write_job(SCENE + 'cameras_from = { path = "sparse", transform = "splat" }\n'))
    with pytest.raises(InputError, match=r"cameras_from.transform.scale: -1; give a number of at least 1e-06"):
        cameras(write_job(SCENE + 'cameras_from = { path = "sparse", transform = { scale = -1 } }\n'))


def test_a_supersplat_film(write_job: WriteJob, tmp_path: Path) -> None:
    pose = {"name": "a", "position": [0, 1, 5], "target": [0, 0, 0], "fov": 60}
    document = {"poseSets": [{"poses": [{**pose, "frame": 0}, {**pose, "frame": 10, "position": [5, 1, 0]}]}]}
    write_ssproj(tmp_path / "a.ssproj", {**document, "timeline": {"frames": 20, "frameRate": 10}})
    found = cameras(write_job(UPRIGHT + 'cameras_from = { path = "a.ssproj", frames = 20, every = 10 }\n'))
    assert [c.name for c in found] == ["camera.0001", "camera.0011"]
    np.testing.assert_allclose(found[1].position, [10, 2, 0], atol=1e-9)  # the world is the turned PLY, twice as large
    np.testing.assert_allclose(-found[1].world_from_camera[:3, 2], conventions.unit([-5, -1, 0]), atol=1e-9)


def test_a_bad_file_is_one_line(write_job: WriteJob, tmp_path: Path) -> None:
    (tmp_path / "bad.json").write_text("{")
    with pytest.raises(InputError, match=r"bad\.json: line 1, column 2: bad JSON"):
        cameras(write_job(SCENE + 'cameras_from = "bad.json"\n'))


# --- many cameras ----------------------------------------------------------------------------------------------------


def many(write_job: WriteJob, text: str) -> tuple[Camera, ...]:
    return cameras(write_job(SCENE + f"resolution = [64, 48]\n[[cameras]]\n{text}\n"))


def angles(camera: Camera, target: tuple[float, float, float]) -> tuple[float, float, float]:
    """Distance, elevation and azimuth in degrees of a camera seen from what it looks at."""
    away = camera.position - target
    distance = float(np.linalg.norm(away))
    np.testing.assert_allclose(camera.world_from_camera[:3, 2], away / distance, atol=1e-9)
    x, y, z = away / distance
    return distance, math.degrees(math.asin(y)), math.degrees(math.atan2(x, z))


def test_an_orbit_keeps_distance_and_angle(write_job: WriteJob) -> None:
    text = 'type = "orbit"\nname = "o"\ntarget = [1, 2, 3]\nradius = 5\nelevation = 30\nstart = 10\nframes = 8'
    found = many(write_job, text)
    assert [c.name for c in found] == [f"o.{i:04d}" for i in range(1, 9)]
    for i, camera in enumerate(found):
        distance, elevation, azimuth = angles(camera, (1, 2, 3))
        assert distance == pytest.approx(5)
        assert elevation == pytest.approx(30)
        assert azimuth % 360 == pytest.approx(10 + 45 * i)


def test_a_sphere_is_evenly_covered(write_job: WriteJob) -> None:
    """No point has a neighbour much nearer than the lattice's spacing, and every direction has a point near it."""
    count = 500
    found = many(write_job, f'type = "sphere"\ntarget = [0, 0, 0]\nradius = 2\ncount = {count}')
    d = np.stack([c.position for c in found]) / 2
    np.testing.assert_allclose(np.linalg.norm(d, axis=1), 1, atol=1e-12)
    np.testing.assert_allclose(d.mean(axis=0), 0, atol=2e-3)
    np.testing.assert_allclose(d.T @ d / count, np.eye(3) / 3, atol=3e-3)
    cosines = d @ d.T - 3 * np.eye(count)
    nearest = np.arccos(cosines.max(axis=1))
    spacing = math.sqrt(4 * math.pi / count)
    assert nearest.min() > 0.7 * spacing and nearest.max() < 1.2 * spacing
    somewhere = np.random.default_rng(0).normal(size=(5000, 3))
    somewhere /= np.linalg.norm(somewhere, axis=1, keepdims=True)
    assert np.arccos((somewhere @ d.T).max(axis=1)).max() < spacing


def test_a_dome_keeps_its_band(write_job: WriteJob) -> None:
    found = many(write_job, 'type = "dome"\ntarget = [0, 1, 0]\nradius = 3\ncount = 200\nelevation = [10, 60]')
    up = np.array([angles(c, (0, 1, 0))[1] for c in found])
    assert up.min() > 10 and up.max() < 60
    middle = math.degrees(math.asin((math.sin(math.radians(10)) + math.sin(math.radians(60))) / 2))
    assert np.sum(up < middle) == 100  # equal areas hold equally many
    turned = many(
        write_job, 'type = "dome"\ntarget = [0, 1, 0]\nradius = 3\ncount = 200\nelevation = [10, 60]\nseed = 4'
    )
    by = [angles(b, (0, 1, 0))[2] - angles(a, (0, 1, 0))[2] for a, b in zip(found, turned, strict=True)]
    np.testing.assert_allclose(np.mod(np.array(by) - by[0] + 180, 360), 180, atol=1e-6)
    assert abs(by[0]) > 1e-3


def test_random_cameras_stay_in_their_box_and_are_their_own(write_job: WriteJob) -> None:
    text = 'type = "random"\nbounds = [[-1, 0, 2], [1, 0.5, 3]]\ntarget = [0, 0, -1]\nseed = 7\ncount = '
    few, more = many(write_job, text + "20"), many(write_job, text + "300")
    for a, b in zip(few, more, strict=False):
        np.testing.assert_array_equal(a.world_from_camera, b.world_from_camera)
    places = np.stack([c.position for c in more])
    assert (places >= [-1, 0, 2]).all() and (places <= [1, 0.5, 3]).all()
    np.testing.assert_allclose(places.mean(axis=0), [0, 0.25, 2.5], atol=0.12)
    for camera in few:
        angles(camera, (0, 0, -1))
    other = many(write_job, text.replace("seed = 7", "seed = 8") + "20")
    assert not np.array_equal(other[0].position, few[0].position)


def test_random_draws_are_these(write_job: WriteJob) -> None:
    """Held, so that a data set's cameras never change unseen."""
    found = many(write_job, 'type = "random"\nbounds = [[0, 0, 0], [1, 1, 1]]\ntarget = [0, 9, 0]\ncount = 2')
    drawn = [0.8215055955152496, 0.2859845235723102, 0.0528644112842499]
    again = [0.536578066773772, 0.8985413624803077, 0.02754240084785431]
    np.testing.assert_array_equal([c.position for c in found], [drawn, again])


def solid(folder: Path) -> None:
    """A proxy of a ground and a closed box over it."""
    import trimesh

    box = trimesh.creation.box((1.8, 1.8, 1.8))
    ground = np.array([[-9, -1, -9], [9, -1, -9], [9, -1, 9], [-9, -1, 9]])
    faces = np.concatenate([[[0, 2, 1], [0, 3, 2]], box.faces + 4])
    vertices = np.concatenate([ground, box.vertices]).astype(np.float32)
    (folder / "proxy.glb").unlink()
    write_glb(folder / "proxy.glb", ProxyMesh(vertices=vertices, faces=faces.astype(np.int32)))


def test_random_cameras_are_drawn_again_until_they_are_of_use(write_job: WriteJob, tmp_path: Path) -> None:
    """Nearly half of the box of eyes is solid, and most of what is looked at lies in the sky."""
    text = SCENE + '[[cameras]]\ntype = "random"\nbounds = [[-3, -0.9, -1], [1, 0.9, 1]]\nseed = 4\ncount = '
    targets = "\ntarget_bounds = [[-9, -9, 0], [9, 30, 0]]\n"
    before = cameras(write_job(f"{text}16{targets}"))
    solid(tmp_path)
    few, more = (cameras(write_job(f"{text}{count}{targets}")) for count in (16, 20))
    inside = [np.abs(camera.position).max() < 0.9 for camera in before]
    assert sum(inside) >= 2
    assert not any(np.abs(camera.position).max() < 0.9 for camera in more)
    kept = [np.array_equal(a.world_from_camera, b.world_from_camera) for a, b in zip(before, few, strict=True)]
    assert any(kept) and not any(k and i for k, i in zip(kept, inside, strict=True))
    assert all(np.array_equal(a.world_from_camera, b.world_from_camera) for a, b in zip(few, more, strict=False))
    assert [x.name for x in more] == [f"camera.{i + 1:04d}" for i in range(20)]


def test_random_targets(write_job: WriteJob) -> None:
    text = 'type = "random"\ncount = 50\nbounds = [[0, 1, 0], [0, 1, 0]]\ntarget_bounds = [[2, -1, -1], [2, -1, 1]]'
    for camera in many(write_job, text):
        ahead = -camera.world_from_camera[:3, 2]
        at = camera.position + ahead * 2 / ahead[0]
        assert at[1] == pytest.approx(-1) and -1 <= at[2] <= 1  # on the floor, which all of them see


def ring(write_job: WriteJob, tmp_path: Path) -> None:
    """A capture from one side: 60 degrees of a ring of radius 4 at 20 degrees, looking at (1, 0, 0)."""
    seen = []
    for i in range(13):
        a, e = math.radians(-30 + 5 * i), math.radians(20)
        away = 4 * np.array([math.cos(e) * math.sin(a), math.sin(e), math.cos(e) * math.cos(a)])
        pose = conventions.look_at(np.add(away, (1, 0, 0)), (1, 0, 0)) @ np.diag([1.0, -1, -1, 1])
        r = pose[:3, :3].T
        seen.append(View(name=f"v{i:02d}", r=r, t=-r @ pose[:3, 3], fx=400.0, fy=400.0, cx=320.0, cy=240.0))
    colmap_text(tmp_path / "ring", seen)


def test_around_a_capture(write_job: WriteJob, tmp_path: Path) -> None:
    """Where it was seen from, as far away, looking at what it looked at, through the same lens."""
    ring(write_job, tmp_path)
    found = many(write_job, 'type = "around"\ncapture = "ring"\ncount = 100')
    for camera in found:
        distance, elevation, azimuth = angles(camera, (1, 0, 0))
        assert distance == pytest.approx(4, abs=1e-6)
        assert 20 <= elevation < 21 and -30.001 <= azimuth <= 30.001
        assert camera.fy == pytest.approx(400 / 480 * 48)
    assert len({round(angles(c, (1, 0, 0))[2], 3) for c in found}) == 100
    rendered = cameras(
        write_job(SCENE + 'cameras_from = "ring"\n[[cameras]]\ntype = "around"\nname = "new"\ncount = 3\n')
    )
    assert [c.name for c in rendered][:4] == ["new.0001", "new.0002", "new.0003", "v00"] and len(rendered) == 16
    np.testing.assert_allclose(rendered[0].position, found[0].position, atol=1e-9)
    lens = many(write_job, 'type = "around"\ncapture = { path = "ring", every = 2 }\ncount = 2\nyfov = 90')
    assert lens[0].fy == pytest.approx(24)


def test_around_needs_a_capture_that_looks_somewhere(write_job: WriteJob, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"cameras\[0\]: no cameras of the capture to stand around; add capture"):
        many(write_job, 'type = "around"')
    frames = [
        {"file_path": f"{i}", "transform_matrix": [[1, 0, 0, i], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}
        for i in range(3)
    ]
    write_json(tmp_path / "transforms.json", {"camera_angle_x": 0.7, "frames": frames})
    text = 'type = "around"\ncount = 4\ncapture = "transforms.json"'
    with pytest.raises(InputError, match="the capture's cameras do not look at one place; add target"):
        many(write_job, text)
    assert len(many(write_job, text + "\ntarget = [0, 0, -5]")) == 4


def test_focus_is_the_nearest_point_to_the_axes() -> None:
    rng = np.random.default_rng(0)
    seen = [Camera.look_at(rng.normal(size=3) * 4, rng.normal(size=3) * 0.1, 8, 8) for _ in range(30)]
    point = focus(seen)
    assert point is not None

    def squares(at: np.ndarray) -> float:
        total = 0.0
        for camera in seen:
            total += float(np.sum(np.cross(at - camera.position, camera.world_from_camera[:3, 2]) ** 2))
        return total

    for step in np.vstack([np.eye(3), -np.eye(3)]) * 1e-3:
        assert squares(point) < squares(point + step)


def test_focal_length_in_millimetres(write_job: WriteJob) -> None:
    """35 mm on a sensor 36 mm wide: 35/36 of the width in pixels; 1920 pixels see 54.43 degrees across."""
    text = "resolution = [1920, 1080]\n[[cameras]]\nposition = [0, 0, 3]\ntarget = [0, 0, 0]\nfocal_length = 35\n"
    (camera,) = cameras(write_job(SCENE + text))
    assert camera.fx == camera.fy == pytest.approx(1920 * 35 / 36)
    assert 2 * math.degrees(math.atan(960 / camera.fx)) == pytest.approx(54.43, abs=5e-3)
    (camera,) = cameras(write_job(SCENE + text + "sensor_width = 23.5\n"))
    assert camera.fx == pytest.approx(1920 * 35 / 23.5)
    found = many(write_job, 'type = "turntable"\nframes = 2\nfocal_length = 50')
    assert found[0].fx == pytest.approx(64 * 50 / 36)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ('type = "dome"\nelevation = [50, 10]', "cameras[0].elevation: [50, 10]; give the lower angle first"),
        ('type = "dome"\nelevation = [0, 91]', "cameras[0].elevation[1]: 91; give a number of at most 90"),
        ('type = "orbit"\nelevation = 100', "cameras[0].elevation: 100; give a number of at most 90"),
        ('type = "sphere"\ncount = 0', "cameras[0].count: 0; give a number of at least 1"),
        ('type = "sphere"\nframes = 3', "cameras[0].frames: unknown key"),
        ('type = "random"\nbounds = [[1, 0, 0], [0, 1, 1]]', "cameras[0].bounds: a first corner above the second"),
        ('type = "random"\ntarget = [0,0,0]\ntarget_bounds = [[0,0,0],[1,1,1]]', "both target and target_bounds are"),
        ('type = "around"\ncapture = "none.json"', "cameras[0].capture: there is no file 'none.json'"),
        ('type = "sphere"\nyfov = 30\nfocal_length = 35', "both yfov and focal_length are given; keep one of them"),
        ("position = [0,0,1]\ntarget = [0,0,0]\nsensor_width = 36", "cameras[0].sensor_width: no focal_length; give"),
        ("position = [0,0,1]\ntarget = [0,0,0]\nfx = 36\nfocal_length = 3", "both focal_length and fx are given; keep"),
    ],
)
def test_mistakes(write_job: WriteJob, text: str, expected: str) -> None:
    with pytest.raises(InputError) as caught:
        many(write_job, text)
    assert expected in str(caught.value)
