"""Damaged, hostile and foreign files end in one line that names the file, and take no memory or time to speak of."""

from __future__ import annotations

import json
import random
import struct
import tracemalloc
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mirelight.base.errors import InputError
from mirelight.io.cameras import open_file

from .views import colmap_text, views, write_json, write_ssproj

EYE = np.eye(4).tolist()
FRAME = {"file_path": "a.png", "transform_matrix": EYE}
LENS = {"fl_x": 100.0, "w": 64, "h": 48}
ENTRY = {
    "id": 0,
    "img_name": "a",
    "width": 64,
    "height": 48,
    "position": [0, 0, 3],
    "rotation": np.eye(3).tolist(),
    "fx": 50.0,
    "fy": 50.0,
}
POLYCAM = {
    **{f"t_{i}{j}": float(i == j) for i in range(3) for j in range(4)},
    "width": 64,
    "height": 48,
    "fx": 50,
    "fy": 50,
    "cx": 32,
    "cy": 24,
}
RECORD3D = {"w": 64, "h": 48, "K": [50, 0, 0, 0, 50, 0, 32, 24, 1], "poses": [[0, 0, 0, 1, 0, 0, 0]]}
PATH = {
    "render_width": 64,
    "render_height": 48,
    "camera_path": [{"camera_to_world": [float(x) for row in EYE for x in row], "fov": 50}],
}
POSE = {"name": "a", "frame": 0, "position": [0, 0, 3], "target": [0, 0, 0], "fov": 60}


def refused(path: Path, **options: Any) -> str:
    """What reading says; one line that begins with the file."""
    with pytest.raises(InputError) as caught:
        open_file(path).read(**options)
    text = str(caught.value)
    assert "\n" not in text and text.startswith(str(path.parent)) and len(text) < 500
    return text


def changed(value: Any, *path: Any, to: Any) -> Any:
    out = json.loads(json.dumps(value))
    node = out
    for key in path[:-1]:
        node = node[key]
    if to is None:
        del node[path[-1]]
    else:
        node[path[-1]] = to
    return out


TRANSFORMS = {**LENS, "frames": [FRAME]}
BAD = float("nan")

WRONG = [
    (TRANSFORMS, ("frames",), [], "frames: no camera in it"),
    (TRANSFORMS, ("frames",), "x", "frames: not an array"),
    (TRANSFORMS, ("frames", 0), 7, "frames[0]: not an object"),
    (TRANSFORMS, ("frames", 0, "file_path"), 7, "frames[0].file_path: 7, expected a string"),
    (TRANSFORMS, ("frames", 0, "transform_matrix"), None, "frames[0].transform_matrix: missing"),
    (TRANSFORMS, ("frames", 0, "transform_matrix", 1), [1, 2], "frames[0].transform_matrix[1]: 2 numbers, expected 4"),
    (TRANSFORMS, ("frames", 0, "transform_matrix", 1, 1), BAD, "expected a finite number"),
    (TRANSFORMS, ("frames", 0, "transform_matrix", 1, 1), 10**400, "expected a finite number"),
    (TRANSFORMS, ("frames", 0, "transform_matrix", 1, 1), "1", "expected a number"),
    (TRANSFORMS, ("frames", 0, "transform_matrix", 1, 1), 0.5, "shear or unequal scale"),
    (TRANSFORMS, ("frames", 0, "transform_matrix", 1, 1), -1, "mirrored"),
    (TRANSFORMS, ("frames", 0, "transform_matrix", 3, 0), 1, "transform_matrix[3]: not 0 0 0 1"),
    (TRANSFORMS, ("frames", 0, "transform_matrix", 0, 3), 1e300, "beyond all scenes"),
    (TRANSFORMS, ("fl_x",), None, "no lens"),
    (TRANSFORMS, ("fl_x",), -3, "a focal length of -3 by -3 pixels"),
    (TRANSFORMS, ("fl_x",), True, "fl_x: True, expected a number"),
    (TRANSFORMS, ("w",), None, "w: missing; a focal length in pixels needs w and h"),
    (TRANSFORMS, ("w",), 10**9, "w: 1000000000, expected 1 to 65536"),
    (TRANSFORMS, ("camera_model",), "FISHEYE624", "camera_model: 'FISHEYE624', which no pinhole stands for"),
    (TRANSFORMS, ("camera_model",), "VR180_L", "undistort the capture"),
    (TRANSFORMS, ("camera_model",), "EQUIRECTANGULAR", "w: 64 by 48 pixels; a panorama of all directions is twice"),
    (TRANSFORMS, ("applied_transform",), [[0, 0, 0, 0]] * 3, "applied_transform: a rotation without size"),
    (TRANSFORMS, ("applied_scale",), 0, "applied_scale: 0; it must be positive"),
    ([ENTRY], (0, "rotation"), [[1, 0, 0]], "[0].rotation: not a matrix"),
    ([ENTRY], (0, "rotation", 2, 2), -1, "[0].rotation: a mirrored matrix"),
    ([ENTRY], (0, "position"), [1, 2], "[0].position: 2 numbers, expected 3"),
    ([ENTRY], (0, "width"), 0, "[0].width: 0, expected 1 to 65536"),
    ([ENTRY], (0, "fx"), BAD, "expected a finite number"),
    ([ENTRY], (0,), "x", "[0]: not an object"),
    (POLYCAM, ("t_11",), BAD, "t_11: nan, expected a finite number"),
    (POLYCAM, ("t_01",), None, "t_01: missing"),
    (POLYCAM, ("fx",), 0, "a focal length of 0"),
    (RECORD3D, ("K",), [1, 2], "K: 2 numbers, expected 9"),
    (RECORD3D, ("poses", 0), [0, 0, 0, 0, 1, 2, 3], "poses[0]: a quaternion of length zero"),
    (RECORD3D, ("poses", 0), 5, "poses[0]: 5, expected an array"),
    (RECORD3D, ("poses",), {}, "poses: not an array"),
    (PATH, ("camera_type",), "fisheye", "camera_type: 'fisheye', which no pinhole stands for"),
    (PATH, ("camera_path", 0, "fov"), 180, "camera_path[0].fov: a field of view of 180 degrees"),
    (PATH, ("camera_path", 0, "camera_to_world"), [1, 2], "2 numbers, expected 16"),
    (PATH, ("render_width",), None, "render_width: missing"),
]


@pytest.mark.parametrize(("data", "place", "value", "expected"), WRONG)
def test_wrong_values_in_json(tmp_path: Path, data: Any, place: tuple[Any, ...], value: Any, expected: str) -> None:
    good = write_json(tmp_path / "good.json", data)
    assert len(open_file(good).read()) == 1
    assert expected in refused(write_json(tmp_path / "bad.json", changed(data, *place, to=value)))


@pytest.mark.parametrize(
    ("place", "value", "expected"),
    [
        (("poseSets",), [], "the project has no camera keys"),
        (("poseSets", 0, "poses", 0, "position"), [0, 0], "poses[0].position: 2 numbers, expected 3"),
        (("poseSets", 0, "poses", 0, "target"), [0, 0, 3], "looks at its own position"),
        (("poseSets", 0, "poses", 0, "fov"), 0, "a field of view of 0 degrees"),
        (("poseSets", 0, "poses", 0, "fov"), "60", "fov: '60', expected a number"),
        (("timeline", "frames"), 1e300, "timeline.frames: 1e+300 frames"),
        (("timeline", "frameRate"), 0, "the project is damaged"),
        (("poseSets", 0, "poses", 1, "frame"), 0, "two camera keys at the same frame"),
    ],
)
def test_wrong_projects(tmp_path: Path, place: tuple[Any, ...], value: Any, expected: str) -> None:
    good = {"poseSets": [{"poses": [POSE, {**POSE, "frame": 10}]}], "timeline": {"frames": 20, "frameRate": 10}}
    assert len(open_file(write_ssproj(tmp_path / "good.ssproj", good)).read(fps=10)) == 20
    bad = write_ssproj(tmp_path / "bad.ssproj", changed(good, *place, to=value))
    assert expected in refused(bad, frames=4)


def test_a_project_that_unpacks_to_gigabytes(tmp_path: Path) -> None:
    path = tmp_path / "bomb.ssproj"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        archive.writestr("document.json", b" " * (1 << 26))
    tracemalloc.start()
    assert "unpacks to more than" in refused(path)
    assert tracemalloc.get_traced_memory()[1] < 1 << 26
    tracemalloc.stop()
    path.write_bytes(path.read_bytes()[:-30])
    assert "not a readable ZIP file" in refused(path)
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("other.json", "{}")
    assert "no member 'document.json'" in refused(path)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "not a file of cameras"),
        ("hello\n", "not a file of cameras"),
        ("{", "bad JSON"),
        ("[" * 100_000, "sensible depth"),
        ("{}", "no cameras in it that are known"),
        ("[]", "no camera in it"),
        ("[1" + "0" * 5000 + "]", "sensible depth and numbers"),
        ("[" + "{}," * 100_000 + "{}]", "100,001 cameras; at most 100,000 are read"),
    ],
)
def test_what_is_no_camera_file(tmp_path: Path, text: str, expected: str) -> None:
    path = tmp_path / "file.json"
    path.write_text(text)
    assert expected in refused(path)


def test_folders(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="a folder without cameras"):
        open_file(tmp_path)
    with pytest.raises(InputError, match="no such file"):
        open_file(tmp_path / "nothing")
    (tmp_path / "images.txt").write_text("")
    with pytest.raises(InputError, match="half a COLMAP model"):
        open_file(tmp_path / "images.txt")


CSV = "x,y,z,qw,qx,qy,qz,fx,width,height\n0,0,3,1,0,0,0,50,64,48\n"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (CSV.replace("x,y,z", "a,b,c"), "line 1: no column x"),
        (CSV.replace(",50,", ",nan,"), "line 2: 'nan' as fx"),
        (CSV.replace(",50,", ",1e400,"), "'1e400' as fx"),
        (CSV.replace(",64,", ",6.5,"), "line 2: 6.5 as width"),
        ("x,y,z,target_x,target_y,target_z\n1e200,2,3,1,2,3\n", "line 2: '1e200' as x; give a number of at most 1e+09"),
        ("x,y,z,target_x,target_y,target_z\n1,2,3,-1e30,2,3\n", "line 2: '-1e30' as target_x"),
        (CSV.replace(",64,", ",,"), "line 2: no width"),
        (CSV.replace("1,0,0,0", "1,,0,0"), "line 2: no qx"),
        (CSV.replace("3,1,0,0,0", "3,0,0,0,0"), "a quaternion of length zero"),
        (CSV.replace("3,1,0,0,0", "3,1"), "line 2: 7 values, and the header has 10 names"),
        ("x,y,z\n", "no camera in it"),
        ("x,y,z,target_x,target_y,target_z\n1,2,3,1,2,3\n", "a direction of length zero"),
        ('x,y,z\n"1,2,3\n', "not a table"),
        ("x,y,z\n" + "1,2,3\n" * 100_001, "100,001 cameras"),
    ],
)
def test_wrong_tables(tmp_path: Path, text: str, expected: str) -> None:
    (tmp_path / "good.csv").write_text(CSV)
    assert len(open_file(tmp_path / "good.csv").read()) == 1
    path = tmp_path / "bad.csv"
    path.write_text(text)
    assert expected in refused(path)


# --- COLMAP ----------------------------------------------------------------------------------------------------------

CAMERAS = "1 PINHOLE 64 48 50 50 32 24\n"
IMAGES = "1 1 0 0 0 0 0 3 1 a.png\n\n"


@pytest.mark.parametrize(
    ("cameras", "images", "expected"),
    [
        (CAMERAS.replace("PINHOLE", "OPENCV_FISHEYE") + "", IMAGES, "line 1: 4 parameters of a OPENCV_FISHEYE"),
        ("1 FOV 64 48 1 1 1 1 1\n", IMAGES, "the camera model FOV, which no pinhole"),
        ("1 EQUIRECTANGULAR 64 48 64 48\n", IMAGES, "a panorama of 64 by 48 pixels; one of all directions is twice"),
        ("1 NEW 64 48 1\n", IMAGES, "line 1: the camera model 'NEW', which is not known"),
        ("1 PINHOLE\n", IMAGES, "line 1: 2 words"),
        (CAMERAS.replace("50 50", "50 nan"), IMAGES, "a parameter that is not finite"),
        (CAMERAS.replace("50 50", "50 x"), IMAGES, "'x', expected a number"),
        (CAMERAS.replace("64", "-64"), IMAGES, "'-64', expected a whole number"),
        (CAMERAS.replace("64", "9" * 5000), IMAGES, "expected a whole number"),
        (CAMERAS.replace("64", "99999999"), IMAGES, "a picture of 99999999 x 48 pixels"),
        (CAMERAS, IMAGES.replace("3 1 a", "3 2 a"), "camera 2, which the model does not have"),
        (CAMERAS, IMAGES.replace("1 1 0", "1 0 0"), "a quaternion of length zero"),
        (CAMERAS, IMAGES.replace("1 1 0", "1 inf 0"), "a pose that is not finite"),
        (CAMERAS, "1 1 0 0 0\n", "line 1: 5 words"),
        (CAMERAS, "# nothing\n", "no camera in it"),
        (CAMERAS, IMAGES * 100_001, "100,001 cameras"),
        (CAMERAS, "\xff", "not UTF-8 text"),
    ],
)
def test_wrong_text_models(tmp_path: Path, cameras: str, images: str, expected: str) -> None:
    (tmp_path / "cameras.txt").write_text(cameras)
    (tmp_path / "images.txt").write_text(images, encoding="latin-1")
    with pytest.raises(InputError) as caught:
        open_file(tmp_path).read()
    assert expected in str(caught.value) and str(tmp_path) in str(caught.value) and len(str(caught.value)) < 500


def binary_model(folder: Path) -> tuple[bytes, bytes]:
    cameras = struct.pack("<QiiQQ4d", 1, 1, 1, 64, 48, 50, 50, 32, 24)
    image = struct.pack("<i7di", 1, 1, 0, 0, 0, 0, 0, 3, 1) + b"a.png\0" + struct.pack("<Q", 2) + bytes(48)
    images = struct.pack("<Q", 1) + image
    (folder / "cameras.bin").write_bytes(cameras)
    (folder / "images.bin").write_bytes(images)
    assert len(open_file(folder).read()) == 1
    return cameras, images


def test_binary_models_cut_anywhere(tmp_path: Path) -> None:
    for name, data in zip(("cameras.bin", "images.bin"), binary_model(tmp_path), strict=True):
        for length in range(len(data)):
            (tmp_path / name).write_bytes(data[:length])
            with pytest.raises(InputError, match="truncated or damaged"):
                open_file(tmp_path).read()
        (tmp_path / name).write_bytes(data)


def test_binary_models_with_huge_counts(tmp_path: Path) -> None:
    cameras, images = binary_model(tmp_path)
    huge = struct.pack("<Q", 2**63)
    name = images.index(b"a.png")
    for file, data, expected in (
        ("cameras.bin", huge + cameras[8:], "ends after"),
        ("cameras.bin", cameras[:12] + struct.pack("<i", 99) + cameras[16:], "camera model number 99"),
        ("cameras.bin", cameras[:12] + struct.pack("<i", 7) + cameras[16:] + bytes(8), "camera model FOV"),
        ("images.bin", huge + images[8:], "ends after"),
        ("images.bin", images[: name + 6] + huge + bytes(48), "ends after"),
        ("images.bin", images[:name] + b"a" * 5000, "a name without end"),
        ("images.bin", struct.pack("<Q", 0), "no camera in it"),
    ):
        binary_model(tmp_path)
        (tmp_path / file).write_bytes(data)
        with pytest.raises(InputError, match=expected):
            open_file(tmp_path).read()


def test_damaged_bytes_raise_nothing_else(tmp_path: Path) -> None:
    """Every format with bytes changed at random: cameras with finite poses, or an InputError."""
    rng = random.Random(11)
    colmap_text(tmp_path / "text", views(2))
    (tmp_path / "binary").mkdir()
    binary_model(tmp_path / "binary")
    files = [
        write_json(tmp_path / "transforms.json", TRANSFORMS),
        write_json(tmp_path / "cameras.json", [ENTRY]),
        write_json(tmp_path / "poly.json", POLYCAM),
        write_json(tmp_path / "metadata", RECORD3D),
        write_json(tmp_path / "camera_path.json", PATH),
        write_ssproj(tmp_path / "a.ssproj", {"poseSets": [{"poses": [POSE]}]}),
        tmp_path / "text" / "cameras.txt",
        tmp_path / "text" / "images.txt",
        tmp_path / "binary" / "cameras.bin",
        tmp_path / "binary" / "images.bin",
        tmp_path / "a.csv",
    ]
    files[-1].write_text(CSV)
    read = 0
    for file in files:
        whole = file.read_bytes()
        for _ in range(60):
            data = bytearray(whole)
            for _ in range(rng.randint(1, 3)):
                data[rng.randrange(len(data))] = rng.choice([0, 32, 44, 45, 48, 57, 91, 101, 255, rng.randrange(256)])
            file.write_bytes(data[: rng.randint(1, len(data))] if rng.random() < 0.2 else data)
            try:
                found = open_file(file).read()
            except InputError:
                continue
            read += 1
            for camera in found:
                assert np.isfinite(camera.to_camera(camera.size((64, 48))).world_from_camera).all()
        file.write_bytes(whole)
    assert read > 50
