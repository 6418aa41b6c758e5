"""Each format's cameras show points where its own documentation says that they are, within a millionth of a pixel."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mirelight.base import conventions
from mirelight.base.errors import InputError
from mirelight.io.cameras import FileCamera, open_file, spline
from mirelight.io.cameras.inria import entry
from mirelight.io.cameras.transforms import lens_entry, matrix_entry
from mirelight.model import F64

from .views import FLIP, POINTS, View, colmap_text, pixels_of, views, write_json, write_ssproj

NERFSTUDIO = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0]])  # an applied_transform of today's nerfstudio


def affine(rows: F64) -> F64:
    return np.vstack([rows, [0, 0, 0, 1]])


def check(found: tuple[FileCamera, ...], seen: list[View], points: F64 = POINTS) -> None:
    assert len(found) == len(seen)
    for camera, view in zip(found, seen, strict=True):
        assert camera.size((1, 1)) == (view.width, view.height)
        shown = pixels_of(camera.to_camera(camera.size((1, 1))), points)
        np.testing.assert_allclose(shown, view.pixels(), rtol=0, atol=1e-6)


def frames(seen: list[View], matrix: Callable[[View], F64], **more: Any) -> list[dict[str, Any]]:
    return [{"file_path": f"./images/{v.name}.jpg", "transform_matrix": matrix(v).tolist(), **more} for v in seen]


def lens(view: View) -> dict[str, Any]:
    return {"fl_x": view.fx, "fl_y": view.fy, "cx": view.cx, "cy": view.cy, "w": view.width, "h": view.height}


def test_colmap_text(tmp_path: Path) -> None:
    colmap_text(tmp_path / "sparse" / "0", views())
    for path in (tmp_path, tmp_path / "sparse/0", tmp_path / "sparse/0/images.txt"):
        file = open_file(path)
        assert file.kind == "COLMAP"
        assert [f.name for f in file.files] == ["cameras.txt", "images.txt"]
        found = file.read()
        check(found, views())
        assert [c.name for c in found] == [v.name for v in views()]


def test_inria(tmp_path: Path) -> None:
    seen = views(cx=320.0, cy=240.0)
    data = [
        {
            "id": i,
            "img_name": v.name,
            "width": v.width,
            "height": v.height,
            "position": v.world_from_camera[:3, 3].tolist(),
            "rotation": v.world_from_camera[:3, :3].tolist(),
            "fx": v.fx,
            "fy": v.fy,
        }
        for i, v in enumerate(seen)
    ]
    file = open_file(write_json(tmp_path / "cameras.json", data))
    assert file.kind == "cameras.json"
    check(file.read(), seen)
    again = [entry(c.to_camera(c.size((1, 1))), i) for i, c in enumerate(file.read())]
    check(open_file(write_json(tmp_path / "again.json", again)).read(), seen)


def test_transforms_with_the_lens_at_the_top(tmp_path: Path) -> None:
    seen = views()
    data = {**lens(seen[0]), "camera_model": "OPENCV", "frames": frames(seen, lambda v: v.opengl)}
    file = open_file(write_json(tmp_path / "transforms.json", data))
    assert file.kind == "transforms.json"
    found = file.read()
    check(found, seen)
    assert [c.name for c in found] == [v.name for v in seen]


def test_transforms_with_a_lens_in_each_frame(tmp_path: Path) -> None:
    seen = views(2) + views(2, fx=400.0, fy=410.0, width=500)
    data = {"frames": [{**f, **lens(v)} for f, v in zip(frames(seen, lambda v: v.opengl), seen, strict=True)]}
    check(open_file(write_json(tmp_path / "transforms.json", data)).read(), seen)
    data |= lens(views(1, fx=9.0, cx=1.0)[0])  # a frame's own lens comes before the one at the top
    check(open_file(write_json(tmp_path / "transforms.json", data)).read(), seen)


def test_transforms_undo_what_was_applied(tmp_path: Path) -> None:
    """A capture's pose comes back from applied_transform and applied_scale."""
    seen = views()
    turn = affine(NERFSTUDIO)
    turn[:3, 3] = 0.5, -0.25, 2.0

    def written(view: View) -> F64:
        pose = turn @ view.opengl
        pose[:3, 3] *= 0.3
        return pose

    data = {
        **lens(seen[0]),
        "applied_transform": turn[:3].tolist(),
        "applied_scale": 0.3,
        "frames": frames(seen, written),
    }
    path = write_json(tmp_path / "transforms.json", data)
    check(open_file(path).read(), seen)

    # nerfstudio's training: p' = s (T p) from the capture's coordinates, orientations turned by T
    trained = affine(np.hstack([Rotation.from_euler("xyz", [0.3, 0.2, 1.0]).as_matrix(), [[0.1], [0.2], [0.3]]]))
    write_json(tmp_path / "dataparser_transforms.json", {"transform": trained[:3].tolist(), "scale": 0.125})
    moved = (POINTS @ trained[:3, :3].T + trained[:3, 3]) * 0.125
    check(open_file(path).read(world="nerfstudio"), seen, moved)


def test_null_in_transforms_is_none(tmp_path: Path) -> None:
    seen = views()
    data = {
        **lens(seen[0]),
        **dict.fromkeys(
            ("applied_transform", "applied_scale", "k1", "distortion_params", "is_fisheye", "camera_model")
        ),
        "frames": [{**frame, "fl_x": None} for frame in frames(seen, lambda v: v.opengl)],
    }
    check(open_file(write_json(tmp_path / "transforms.json", data)).read(), seen)


def test_transforms_in_opencv_axes_by_name(tmp_path: Path) -> None:
    """As OpenIllumination has it: OpenCV's axes, and an object instead of a list."""
    seen = views()
    named = {v.name: {"transform_matrix": v.world_from_camera.tolist(), **lens(v)} for v in seen}
    file = open_file(write_json(tmp_path / "transforms_train.json", {"frames": named}))
    found = file.read(axes="opencv")
    check(found, seen)
    assert [c.name for c in found] == [v.name for v in seen]


def test_opencv_poses_are_not_taken_for_opengl_s(tmp_path: Path) -> None:
    """An object set with Z up, written with OpenCV's axes: refused until the job says which they are."""
    frames = []
    for i in range(8):
        a = 2 * math.pi * i / 8
        position = np.array([3 * math.cos(a), 3 * math.sin(a), 1.5])
        frames.append({"transform_matrix": (conventions.look_at(position, (0, 0, 0), (0, 0, 1)) @ FLIP).tolist()})
    path = write_json(tmp_path / "transforms_train.json", {"camera_angle_x": 0.7, "frames": frames})
    with pytest.raises(InputError, match=r'stand on their heads and look away from their middle; say axes = "opencv"'):
        open_file(path).read()
    for camera in open_file(path).read(axes="opencv"):
        ahead = -camera.world_from_camera[:3, 2]
        np.testing.assert_allclose(ahead, -camera.world_from_camera[:3, 3] / math.hypot(3, 1.5), atol=1e-9)
    assert len(open_file(path).read(axes="opengl")) == 8


def test_blender_nerf(tmp_path: Path) -> None:
    """No size in the file: the horizontal field is kept on the job's picture."""
    angle = 0.6911112
    f = 0.5 * 800 / math.tan(angle / 2)
    seen = views(3, width=800, height=800, fx=f, fy=f, cx=400.0, cy=400.0)
    data = {
        "camera_angle_x": angle,
        "frames": [
            {"file_path": f"./train/{v.name}", "rotation": 0.01, "transform_matrix": v.opengl.tolist()} for v in seen
        ],
    }
    found = open_file(write_json(tmp_path / "transforms_train.json", data)).read()
    for camera, view in zip(found, seen, strict=True):
        np.testing.assert_allclose(pixels_of(camera.to_camera((800, 800))), view.pixels(), rtol=0, atol=1e-6)
        wide = camera.to_camera((1600, 400))
        assert wide.fx == wide.fy == pytest.approx(2 * f)
    assert [c.name for c in found] == [v.name for v in seen]


def test_camera_path(tmp_path: Path) -> None:
    seen = views(3, fx=600.0, fy=600.0, cx=320.0, cy=240.0)
    fov = 2 * math.degrees(math.atan(240 / 600))
    trained = affine(np.hstack([Rotation.from_euler("xyz", [0.3, 0.2, 1.0]).as_matrix(), [[0.1], [0.2], [0.3]]]))

    def written(view: View) -> F64:
        pose = trained @ view.opengl
        pose[:3, 3] *= 0.125
        return pose

    data = {
        "camera_type": "perspective",
        "render_width": 640,
        "render_height": 480,
        "fps": 24,
        "camera_path": [
            {"camera_to_world": written(v).reshape(-1).tolist(), "fov": fov, "aspect": 4 / 3} for v in seen
        ],
    }
    path = write_json(tmp_path / "camera_path.json", data)
    moved = (POINTS @ trained[:3, :3].T + trained[:3, 3]) * 0.125
    check(open_file(path).read(), seen, moved)
    write_json(tmp_path / "dataparser_transforms.json", {"transform": trained[:3].tolist(), "scale": 0.125})
    check(open_file(path).read(), seen)
    check(open_file(path).read(world="nerfstudio"), seen, moved)


def test_polycam(tmp_path: Path) -> None:
    seen = views()
    folder = tmp_path / "keyframes" / "corrected_cameras"
    folder.mkdir(parents=True)
    for v in seen:
        rows = {f"t_{i}{j}": float(v.opengl[i, j]) for i in range(3) for j in range(4)}
        sizes = {"width": v.width, "height": v.height, "fx": v.fx, "fy": v.fy, "cx": v.cx, "cy": v.cy}
        write_json(folder / f"{v.name}.json", {**rows, **sizes, "blur_score": 3.5})
    file = open_file(tmp_path)
    assert file.kind == "Polycam"
    check(file.read(), seen)
    check(open_file(folder / "view_001.json").read(), seen[1:2])


def test_record3d(tmp_path: Path) -> None:
    seen = views()
    poses = [[*Rotation.from_matrix(v.opengl[:3, :3]).as_quat().tolist(), *v.opengl[:3, 3].tolist()] for v in seen]
    v = seen[0]
    data = {"w": v.width, "h": v.height, "fps": 60, "K": [v.fx, 0, 0, 0, v.fy, 0, v.cx, v.cy, 1], "poses": poses}
    write_json(tmp_path / "metadata", data)
    file = open_file(tmp_path)
    assert file.kind == "Record3D"
    check(file.read(), seen)


def test_csv(tmp_path: Path) -> None:
    seen = views()
    head = "name,x,y,z,qw,qx,qy,qz,fx,fy,cx,cy,width,height,note"
    for axes in ("opengl", "opencv"):
        lines = [head]
        for v in seen:
            pose = v.opengl if axes == "opengl" else v.world_from_camera
            x, y, z, w = Rotation.from_matrix(pose[:3, :3]).as_quat().tolist()
            numbers = [*pose[:3, 3].tolist(), w, x, y, z, v.fx, v.fy, v.cx, v.cy, v.width, v.height]
            lines.append(",".join([v.name, *map(repr, numbers), '"a, b"']))
        path = tmp_path / f"{axes}.csv"
        path.write_text("\n".join(lines) + "\n\n", encoding="utf-8")
        file = open_file(path)
        assert file.kind == "CSV"
        check(file.read(axes=axes), seen)


def test_csv_with_targets(tmp_path: Path) -> None:
    path = tmp_path / "eyes.csv"
    path.write_text("x, y, z, target_x, target_y, target_z, yfov\n0,0,5,0,0,0,90\n3,0,0,0,0,0,\n", encoding="utf-8")
    a, b = (c.to_camera((200, 100)) for c in open_file(path).read())
    assert (a.name, b.name) == ("0001", "0002")
    np.testing.assert_allclose(pixels_of(a, np.array([[0.0, 5.0, 0.0], [1, 0, 0]])), [[100, 0], [110, 50]], atol=1e-9)
    np.testing.assert_allclose(b.world_from_camera[:3, 2], [1, 0, 0], atol=1e-12)
    assert b.fy == pytest.approx(50 / math.tan(math.radians(22.5)))


# --- SuperSplat ------------------------------------------------------------------------------------------------------

KEYS = [  # frame, position, target, fov
    (0, (0.0, 1.0, 5.0), (0.0, 0.5, 0.0), 60.0),
    (30, (4.0, 2.0, 3.0), (0.5, 0.0, 0.0), 50.0),
    (90, (-3.0, 1.5, 2.0), (0.0, 0.0, 0.5), 70.0),
]


def project(**timeline: Any) -> dict[str, Any]:
    poses = [
        {"name": f"camera_{i}", "frame": frame, "position": list(p), "target": list(t), "fov": fov}
        for i, (frame, p, t, fov) in enumerate(KEYS)
    ]
    line = {"frames": 120, "frameRate": 30, "frame": 0, "smoothness": 1, "loop": True} | timeline
    return {"version": 0, "camera": {"fov": 65}, "poseSets": [{"name": "set0", "poses": poses[::-1]}], "timeline": line}


def supersplat_pixels(position: Any, target: Any, fov: float, width: int, height: int) -> F64:
    """Where SuperSplat shows points of a PLY: turned 180 degrees about Z, seen upright, fov over the longer side."""
    world = POINTS * [-1, -1, 1]
    ahead = np.subtract(target, position) / np.linalg.norm(np.subtract(target, position))
    right = np.cross(ahead, [0, 1, 0]) / np.linalg.norm(np.cross(ahead, [0, 1, 0]))
    up = np.cross(right, ahead)
    x, y, z = np.stack([right, up, ahead]) @ (world - position).T
    f = max(width, height) / 2 / math.tan(math.radians(fov) / 2)
    return np.stack([width / 2 + f * x / z, height / 2 - f * y / z], axis=1)


@pytest.mark.parametrize("size", [(1280, 720), (600, 900)])
def test_supersplat_keys(tmp_path: Path, size: tuple[int, int]) -> None:
    file = open_file(write_ssproj(tmp_path / "scene.ssproj", project()))
    assert file.kind == "SuperSplat"
    found = file.read()
    assert [c.name for c in found] == ["camera_0", "camera_1", "camera_2"]  # by time, not as they stand
    for camera, (_, position, target, fov) in zip(found, KEYS, strict=True):
        expected = supersplat_pixels(position, target, fov, *size)
        np.testing.assert_allclose(pixels_of(camera.to_camera(size)), expected, rtol=0, atol=1e-6)


@pytest.mark.parametrize("loop", [True, False])
def test_supersplat_films_through_its_keys(tmp_path: Path, loop: bool) -> None:
    file = open_file(write_ssproj(tmp_path / "scene.ssproj", project(loop=loop)))
    found = file.read(frames=120)
    assert len(found) == 120 and found[30].name == "camera.0031"
    for frame, position, target, fov in KEYS:
        shown = pixels_of(found[frame].to_camera((800, 600)))
        np.testing.assert_allclose(shown, supersplat_pixels(position, target, fov, 800, 600), rtol=0, atol=1e-6)
    still = np.array_equal(found[100].world_from_camera, found[119].world_from_camera)
    assert still is not loop  # after the last key: on towards the first, or held
    assert len(file.read(fps=15)) == 60


def test_the_spline_is_hermite_with_central_slopes() -> None:
    """Against the cubic that has the keys' values and slopes, solved for each segment."""
    rng = np.random.default_rng(5)
    times, points = np.array([0.0, 3.0, 4.0, 9.0]), rng.normal(size=(4, 2))
    for smoothness in (1.0, 0.5, 0.0):
        central = (points[2:] - points[:-2]) / (times[2:] - times[:-2])[:, None]
        ends = (points[1] - points[0]) / 3.0, (points[3] - points[2]) / 5.0
        slopes = smoothness * np.stack([ends[0], *central, ends[1]])
        for i in range(3):
            a, b = times[i], times[i + 1]
            system = [[1, a, a**2, a**3], [1, b, b**2, b**3], [0, 1, 2 * a, 3 * a**2], [0, 1, 2 * b, 3 * b**2]]
            cubic = np.linalg.solve(system, np.stack([points[i], points[i + 1], slopes[i], slopes[i + 1]]))
            at = np.linspace(a, b, 7)
            expected = np.stack([at**0, at, at**2, at**3], axis=1) @ cubic
            np.testing.assert_allclose(spline.evaluate(times, points, smoothness, at), expected, atol=1e-10)


# --- lenses and sizes ------------------------------------------------------------------------------------------------


def test_another_resolution_keeps_the_vertical_field(tmp_path: Path) -> None:
    colmap_text(tmp_path, views(1))
    (camera,) = open_file(tmp_path).read()
    same, double = camera.to_camera((640, 480)), camera.to_camera((1280, 960))
    np.testing.assert_allclose(pixels_of(double), 2 * pixels_of(same), atol=1e-9)
    wide = camera.to_camera((960, 480))  # 160 more on each side
    np.testing.assert_allclose(pixels_of(wide), np.add(pixels_of(same), (160, 0)), atol=1e-9)


def test_largest_shift_of_a_distortion() -> None:
    """k1 = 0.02 at 1920 x 1080 with f = 1500: the corner at r = 0.734 moves by 0.02 r³ f = 11.88 px."""
    from mirelight.io.cameras import Distortion, Intrinsics

    lens = Intrinsics(width=1920, height=1080, fx=1500, fy=1500, cx=960, cy=540)
    r = math.hypot(960, 540) / 1500
    shift = Distortion(model="SIMPLE_RADIAL", radial=(0.02,)).largest_shift(lens)
    assert shift == pytest.approx(0.02 * r**3 * 1500)
    assert round(shift, 2) == 11.88
    assert Distortion(model="OPENCV", tangential=(0.0, 0.001)).largest_shift(lens) > 0.5


def test_what_is_written_is_read_again(tmp_path: Path) -> None:
    """transforms.json from mirelight's cameras, its world turned Z up, and back by applied_transform."""
    from mirelight.io.cameras.transforms import Z_UP

    seen = views()
    colmap_text(tmp_path, seen)
    cameras = [c.to_camera((v.width, v.height)) for c, v in zip(open_file(tmp_path).read(), seen, strict=True)]
    data = {
        "applied_transform": Z_UP[:3].tolist(),
        "frames": [
            {"file_path": f"{c.name}.png", "transform_matrix": matrix_entry(c), **lens_entry(c)} for c in cameras
        ],
    }
    check(open_file(write_json(tmp_path / "transforms.json", data)).read(), seen)
    opencv = [
        {**f, "transform_matrix": matrix_entry(c, axes="opencv")} for f, c in zip(data["frames"], cameras, strict=True)
    ]
    np.testing.assert_allclose(np.array(opencv[0]["transform_matrix"]) @ FLIP, matrix_entry(cameras[0]), atol=1e-12)


def test_names_come_from_the_pictures(tmp_path: Path) -> None:
    seen = views(4)
    raw = ["a/x/IMG 1.JPG", "a/y/IMG 1.JPG", "a/y/v1.2", "a/y/v1.2"]
    data = {**lens(seen[0]), "frames": frames(seen, lambda v: v.opengl)}
    for frame, name in zip(data["frames"], raw, strict=True):
        frame["file_path"] = name
    found = open_file(write_json(tmp_path / "transforms.json", data)).read()
    assert [c.name for c in found] == ["x_IMG 1", "y_IMG 1", "y_v1.2", "y_v1.2-2"]
