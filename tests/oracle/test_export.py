"""Exported data sets: every layout read by the conventions of its loaders, from a rendered scene."""

from __future__ import annotations

import io
import json
import logging
import math
import re
import shutil
import tarfile
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap
import pytest
import trimesh
from PIL import Image

from mirelight import cli, dataset
from mirelight.dataset.layouts import LAYOUTS, Pixels
from mirelight.dataset.view import DataSet
from mirelight.io.environment import read_environment, write_environment
from mirelight.io.exr import read_exr
from mirelight.io.png import encode_straight
from mirelight.relighting.surroundings import solid_angles

from .test_dataset_view import make_scene

WITHOUT_OBJECTS = [x for x in LAYOUTS if x != "coco"]  # which test_objects_data.py reads
JOB = """
splats = "splats.ply"
proxy = { path = "proxy.glb", albedo = "file" }
resolution = [24, 24]
captured = "day.1"

[[lightings]]
name = "day.1"
lights = [{ type = "sun", direction = [-0.2, -1, -0.3], intensity = 3.0, color = [1, 0.9, 0.8] }]
environment = { radiance = [0.3, 0.4, 0.6] }

[[lightings]]
name = "room"
environment = { path = "room.hdr", rotation = 90, intensity = 2.0 }

[[lightings]]
name = "sky"
environment = { sky = { elevation = 40, azimuth = 30 }, intensity = 0.0001 }

[[lightings]]
name = "lamp"
lights = [{ name = "warm.one", type = "point", position = [-1, 1, 0.2], intensity = 2.0, color = [1, 0.6, 0.3] }]

[[lightings]]
name = "lamps"
lights = [
  { name = "warm.one", type = "point", position = [-1, 1, 0.2], intensity = 1.0 },
  { name = "spot", type = "spot", position = [1, 2, 0], direction = [0, -1, 0], intensity = 3.0 },
]

[[cameras]]
type = "orbit"
name = "orbit"
frames = 3
radius = 4
elevation = 40
target = [0, 0, 0]

[render]
spp = 4

[display]
exposure = -0.5
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("export")
    make_scene(place)
    room = np.full((8, 16, 3), 0.25, np.float32)
    room[2, 5] = [8, 4, 2]
    write_environment(place / "room.hdr", room)
    (place / "job.toml").write_text(JOB)
    assert cli.main(["render", str(place / "job.toml"), "-q", "--set", "output.store=layers"]) == 0
    return place / "out"


def export(folder: Path, out: Path, layout: str, *more: str) -> Path:
    assert cli.main(["export", str(folder), "--layout", layout, "-o", str(out), *more]) == 0
    return out


def load(path: Path) -> Any:
    return json.loads(path.read_text())


# --- where points are shown ------------------------------------------------------------------------------------------


def nerf_pixels(pose: Any, angle: float, size: tuple[int, int], points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Places in pixels, and depths along the axis, of points by NeRF's convention: world from camera, looks along -Z,
    +Y up, one angle of view, the middle in the middle."""
    own = (points - np.array(pose)[:3, 3]) @ np.array(pose)[:3, :3]
    focal = 0.5 * size[0] / math.tan(0.5 * angle)
    x = size[0] / 2 + focal * own[:, 0] / -own[:, 2]
    y = size[1] / 2 - focal * own[:, 1] / -own[:, 2]
    return np.stack([x, y], axis=-1), -own[:, 2]


def seen_points(data: DataSet, camera: int, rig: Any) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (N, 2) that the proxy fills, and the points (N, 3) there, in the world of the set."""
    geometry = data.geometry(camera)
    rows, columns = np.nonzero(geometry.coverage == 1)
    assert len(rows) > 30
    world = np.array(rig["world_from_job"])
    points = geometry.position[rows, columns].astype(np.float64) @ world[:3, :3].T + world[:3, 3]
    return np.stack([columns, rows], axis=-1), points


def assert_shown(pixels: np.ndarray, shown: np.ndarray) -> None:
    """A pixel's position is the mean over its area, which is near its centre."""
    assert np.abs(shown - pixels - 0.5).max() < 0.5
    assert np.abs((shown - pixels - 0.5).mean(axis=0)).max() < 0.1


@pytest.mark.parametrize("more", [(), ("--normalize",)])
def test_points_are_where_the_files_say(folder: Path, tmp_path: Path, more: tuple[str, ...]) -> None:
    data = dataset.open(folder)
    views = ["orbit_0001", "orbit_0002", "orbit_0003"]
    sets: dict[str, Path] = {
        name: export(folder, tmp_path / name, name, *more, "--held-out", "0") for name in WITHOUT_OBJECTS
    }
    rig = load(sets["nerf"] / "lights.json")
    size = (24, 24)
    model = pycolmap.Reconstruction(str(sets["colmap"] / "room" / "sparse" / "0"))
    by_name = {image.name: image for image in model.images.values()}
    nerf = load(sets["nerf"] / "room" / "transforms_train.json")
    olat = load(sets["olat"] / "transforms_train.json")
    for i, view in enumerate(views):
        pixels, points = seen_points(data, i, rig)
        for layout, found, path in (
            ("nerf", nerf, f"./images/{view}"),
            ("olat", olat, f"./images/lamp__{view}"),
        ):
            (frame,) = [x for x in found["frames"] if x["file_path"] == path]
            shown, depth = nerf_pixels(frame["transform_matrix"], found["camera_angle_x"], size, points)
            assert_shown(pixels, shown)
            there = np.asarray(Image.open(sets[layout] / "geometry" / "depth" / f"{view}.png"))[
                pixels[:, 1], pixels[:, 0]
            ]
            assert np.abs(there / 1000 - depth).max() < 0.002
        sample = samples(sets["hub"] / "shards" / "train-000000.tar")[f"room__{view}"]
        about = json.loads(sample["json"])
        angle = 2 * math.atan(about["w"] / 2 / about["fl_x"])
        shown, depth = nerf_pixels(about["transform_matrix"], angle, size, points)
        assert_shown(pixels, shown)
        there = np.load(io.BytesIO(sample["depth.npy"]))[pixels[:, 1], pixels[:, 0]]
        np.testing.assert_allclose(there, depth, rtol=1e-3)
        image = by_name[f"{view}.png"]
        camera = image.camera
        assert_shown(pixels, np.array([camera.img_from_cam(p) for p in image.cam_from_world() * points]))
        meta = load(sets["tensoir"] / f"train_{i:03d}" / "metadata.json")
        pose = np.array([float(x) for x in meta["cam_transform_mat"].split(",")]).reshape(4, 4)
        shown, depth = nerf_pixels(pose, meta["cam_angle_x"], (meta["imw"], meta["imh"]), points)
        assert_shown(pixels, shown)
        there = np.load(sets["tensoir"] / f"train_{i:03d}" / "depth.npy")[pixels[:, 1], pixels[:, 0]]
        np.testing.assert_allclose(there, depth, rtol=1e-3)
        normal = np.asarray(Image.open(sets["tensoir"] / f"train_{i:03d}" / "normal.png"))[pixels[:, 1], pixels[:, 0]]
        assert (normal == [128, 128, 255, 255]).all()  # a floor, Z up
    cloud = model.points3D.values()
    assert len(cloud) > 100 and np.allclose([p.xyz[2] for p in cloud], points[0, 2], atol=1e-6)  # on the floor


def samples(shard: Path) -> dict[str, dict[str, bytes]]:
    """Files of a shard as WebDataset groups them: the key ends at the first dot."""
    out: dict[str, dict[str, bytes]] = {}
    with tarfile.open(shard) as tar:
        for entry in tar:
            key, _, suffix = entry.name.partition(".")
            content = tar.extractfile(entry)
            assert content is not None and suffix not in out.get(key, {})
            out.setdefault(key, {})[suffix] = content.read()
    return out


# --- pixels ----------------------------------------------------------------------------------------------------------


def test_pictures_are_the_frames(folder: Path, tmp_path: Path) -> None:
    data = dataset.open(folder)
    tensoir, nerf, olat = (export(folder, tmp_path / name, name) for name in ("tensoir", "nerf", "olat"))
    frame = data.frame("orbit.0002", "lamp")
    expected = encode_straight(frame, data.index.display)
    one = next(tensoir.glob("*_001"))
    for path in (
        nerf / "lamp" / "images" / "orbit_0002.png",
        olat / "images" / "lamp__orbit_0002.png",
        one / "rgba_lamp.png",
    ):
        np.testing.assert_array_equal(np.asarray(Image.open(path)), expected)
    np.testing.assert_array_equal(read_exr(nerf / "lamp" / "hdr" / "orbit_0002.exr").layer(), frame)
    linear = read_exr(olat / "images" / "lamp__orbit_0002.exr").layer()  # straight, as NRHints blends it
    np.testing.assert_allclose(linear[..., :3] * linear[..., 3:], frame[..., :3], atol=1e-6)
    np.testing.assert_array_equal(linear[..., 3], frame[..., 3])
    for name in ("train", "val", "test"):
        frames = load(olat / "hdr" / f"transforms_{name}.json")["frames"]
        assert all((olat / "hdr" / (x["file_path"] + ext)).is_file() for x in frames for ext in (".png", ".exr"))
    assert not [
        p for p in tmp_path.rglob("*") if p.is_file() and ".mirelight" not in p.parts and p.name.count(".") != 1
    ]


def test_shards(folder: Path, tmp_path: Path) -> None:
    """WebDataset's own reader gives each frame once, with its pixels; and the same export gives the same bytes."""
    import webdataset

    data = dataset.open(folder)
    one, other = (export(folder, tmp_path / name, "hub", "--held-out", "0") for name in ("one", "other"))
    shard = "shards/train-000000.tar"
    assert (one / shard).read_bytes() == (other / shard).read_bytes()
    found = {x["__key__"]: x for x in webdataset.WebDataset(str(one / shard), shardshuffle=False).decode("pilrgba")}
    assert len(found) == 15
    for lighting, name in (("day.1", "day_1"), ("lamp", "lamp")):
        sample = found[f"{name}__orbit_0003"]
        frame = data.frame("orbit.0003", lighting)
        np.testing.assert_array_equal(np.asarray(sample["png"]), encode_straight(frame, data.index.display))
        np.testing.assert_array_equal(np.asarray(sample["mask.png"])[..., 0] > 0, frame[..., 3] > 0.5)
        linear = sample["hdr.npy"].astype(np.float32)
        np.testing.assert_allclose(linear[..., :3] * linear[..., 3:], frame[..., :3], rtol=2e-3, atol=1e-5)
        covered = data.geometry(2).coverage == 1
        np.testing.assert_allclose(sample["normal.npy"][covered], [[0, 0, 1]] * int(covered.sum()), atol=1e-3)
        assert sample["json"]["part"] == "seen"
    assert np.allclose(found["lamp__orbit_0003"]["json"]["point_light_position"], [-1, -0.2, 1])


def test_geometry_of_light_at_fewer_pixels(folder: Path, tmp_path: Path) -> None:
    """A quarter of the pixels: each gives its depth to four."""
    more = ["--set", "relight.texture_scale=0.5", "--set", "render.spp=1", "--set", "output.exr=false"]
    text = JOB.replace("frames = 3", "frames = 1").split('[[lightings]]\nname = "room"', 1)
    coarse = folder.parent / "coarse.toml"
    coarse.write_text(text[0] + text[1][text[1].index("[[cameras]]") :])
    assert cli.main(["render", str(coarse), "-q", "-o", str(tmp_path / "out"), *more]) == 0
    out = export(tmp_path / "out", tmp_path / "set", "colmap")
    depth = np.asarray(Image.open(out / "geometry" / "depth" / "orbit_0001.png"))
    small = dataset.open(tmp_path / "out").geometry(0).depth
    assert small.shape == (12, 12)
    np.testing.assert_array_equal(depth, np.rint(1000 * small).astype(np.uint16).repeat(2, axis=0).repeat(2, axis=1))


def test_a_contact_sheet_is_with_every_set(folder: Path, tmp_path: Path) -> None:
    out = export(folder, tmp_path, "hub", "--lighting", "room", "lamp", "--no-hdr")
    sheet = np.asarray(Image.open(out / "sheet.jpg").convert("RGB")).astype(np.float32)
    assert "](sheet.jpg)" in (out / "README.md").read_text()
    shown = [int(x) for x in np.flatnonzero((sheet > 150).any(axis=(0, 2)))]
    assert sheet.shape[0] > 3 * 24 and max(shown) - min(shown) > 2 * 24  # three cameras below each other, two lightings
    data = dataset.open(folder)
    tile = Pixels(lambda: data.frame(0, "room"), display=data.index.display).rgb.astype(np.float32)
    places = np.lib.stride_tricks.sliding_window_view(sheet, tile.shape)[:, :, 0]
    assert np.abs(places - tile).mean(axis=(-3, -2, -1)).min() < 6  # the first of them, but for JPEG


def test_no_linear_pictures_where_none_are_wanted(folder: Path, tmp_path: Path) -> None:
    out = export(folder, tmp_path, "nerf", "--no-hdr", "--lighting", "lamp", "lamps")
    assert not list(out.glob("*/hdr")) and not (out / "lamp" / "transforms_hdr.json").exists()


def tum_list(path: Path) -> list[list[str]]:
    """Rows of a list, as the benchmark's own tools split them."""
    lines = path.read_text().replace(",", " ").replace("\t", " ").split("\n")
    return [line.split(" ") for line in lines if line and not line.startswith("#")]


@pytest.mark.parametrize("more", [(), ("--normalize",)])
def test_a_sequence_of_the_tum_benchmark(folder: Path, tmp_path: Path, more: tuple[str, ...]) -> None:
    """Poses, pictures and depth are those of the source, and points of the proxy lie where they say together."""
    data, out = dataset.open(folder), export(folder, tmp_path, "tum", *more, "--lighting", "room", "lamp")
    rig = load(out / "lights.json")
    world = np.array(rig["world_from_job"])
    room = out / "room"
    poses, pictures, depths = (tum_list(room / f"{name}.txt") for name in ("groundtruth", "rgb", "depth"))
    (lens,) = tum_list(room / "calibration.txt")
    fx, fy, cx, cy = map(float, lens)
    assert len(poses) == len(pictures) == len(depths) == 3
    for i, (pose, picture, depth) in enumerate(zip(poses, pictures, depths, strict=True)):
        assert pose[0] == picture[0] == depth[0] and float(pose[0]) == pytest.approx(i / 30, abs=1e-6)
        camera, geometry = data.cameras[i], data.geometry(i)
        x, y, z, w = map(float, pose[4:])
        assert math.hypot(x, y, z, w) == pytest.approx(1, abs=1e-8)
        turn = trimesh.transformations.quaternion_matrix([w, x, y, z])[:3, :3]
        place = np.array([float(v) for v in pose[1:4]])
        axes = world[:3, :3] / rig["scale"] @ camera.world_from_camera[:3, :3]
        np.testing.assert_allclose(turn, axes * [1, -1, -1], atol=1e-7)  # x right, y down, z forward
        np.testing.assert_allclose(place, (world @ camera.world_from_camera)[:3, 3], atol=1e-8)
        shown = Image.open(room / picture[1])
        assert shown.mode == "RGB"
        expected = Pixels(partial(data.frame, i, "room"), display=data.index.display).rgb
        np.testing.assert_array_equal(np.asarray(shown), expected)
        there = np.asarray(Image.open(room / depth[1]))
        assert there.dtype == np.uint16 and (there[geometry.depth == 0] == 0).all() and (there == 0).any()
        np.testing.assert_allclose(there / 5000, geometry.depth * rig["scale"], atol=1.01e-4)
        pixels, points = seen_points(data, i, rig)
        own = (points - place) @ turn
        on = np.stack([cx + fx * own[:, 0] / own[:, 2], cy + fy * own[:, 1] / own[:, 2]], axis=-1)
        assert_shown(pixels, on + 0.5)  # its pixel centres are at whole numbers
        np.testing.assert_allclose(there[pixels[:, 1], pixels[:, 0]] / 5000, own[:, 2], atol=2e-3)


# --- light -----------------------------------------------------------------------------------------------------------


def irradiance(picture: np.ndarray, toward: np.ndarray) -> np.ndarray:
    """On a surface that faces that way, from a map as TensoIR and NeRFactor place it in a world with Z up: u = 0.5 is
    +X, u = 0.25 +Y, the first row +Z."""
    rows = len(picture)
    theta = np.pi * (np.arange(rows) + 0.5) / rows
    phi = 2 * np.pi * (0.5 - (np.arange(2 * rows) + 0.5) / (2 * rows))
    t, p = np.meshgrid(theta, phi, indexing="ij")
    way = np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], axis=-1)
    return np.asarray((picture * (np.maximum(way @ toward, 0) * solid_angles(rows))[..., None]).sum(axis=(0, 1)))


def test_maps_hold_suns_skies_and_pictures(folder: Path, tmp_path: Path) -> None:
    """What a map gives a surface is what the lights of lights.json give it."""
    out = export(folder, tmp_path, "nerf", "--no-hdr")
    maps = {p.stem: read_environment(p) for p in (out / "environments").iterdir()}
    assert set(maps) == {"day_1", "room", "sky"}
    rig = load(out / "lights.json")
    assert {x["file_name"]: x["environment"] for x in rig["lightings"]}["room"] == "environments/room.exr"
    sun = next(x["parts"][0] for x in rig["lights"] if x["kind"] == "sun" and x["parts"][0]["type"] == "sun")
    toward = -np.array(sun["direction"])
    np.testing.assert_allclose(toward, np.array([0.2, -0.3, 1]) / np.linalg.norm([0.2, 0.3, 1]), atol=1e-9)
    even = np.pi * np.array([0.3, 0.4, 0.6])
    np.testing.assert_allclose(irradiance(maps["day_1"], toward), even + 3 * np.array([1, 0.9, 0.8]), rtol=1e-3)
    # the lamp of the picture at row 2, column 5, turned by 90° to column 1: u = 1.5 / 16
    bright = maps["room"][2, 1]
    np.testing.assert_allclose(bright, [16, 8, 4], rtol=1e-6)
    elevation = math.degrees(math.pi / 2 - math.pi * (np.argmax(maps["sky"].sum(axis=(1, 2))) + 0.5) / 512)
    assert abs(elevation - 40) < 1
    suns = [part for x in rig["lights"] for part in x["parts"] if part["type"] == "sun"]
    assert [math.degrees(math.asin(-x["direction"][2])) for x in suns] == pytest.approx([70.17, 40], abs=0.1)
    tensoir = export(folder, tmp_path / "tensoir", "tensoir")
    again = read_environment(tensoir / "environments" / "room.hdr")
    np.testing.assert_allclose(again, maps["room"], rtol=0.01)
    assert np.allclose(load(tensoir / "environments" / "lamp.json")["point_location"], [-1, -0.2, 1])
    np.testing.assert_array_equal(dataset.open(folder).environment("room"), maps["room"])
    assert dataset.open(folder).environment("lamp") is None


def test_lamps_of_a_normalized_world_light_it_the_same(folder: Path, tmp_path: Path) -> None:
    """Lux at a point of the surface: candela / distance², in either world."""
    out = export(folder, tmp_path, "olat", "--normalize", "--held-out", "0")
    rig = load(out / "lights.json")
    world = np.array(rig["world_from_job"])
    assert not np.isclose(rig["scale"], 1) and np.isclose(np.cbrt(np.linalg.det(world[:3, :3])), rig["scale"])
    frame = load(out / "transforms_train.json")["frames"][0]
    point = world[:3, :3] @ [0.5, 0, 0.2] + world[:3, 3]
    lux = np.array(frame["pl_intensity"]) / np.sum((np.array(frame["pl_pos"]) - point) ** 2)
    plain = 2 * np.array([1, 0.6, 0.3]) / np.sum((np.array([-1, 1, 0.2]) - [0.5, 0, 0.2]) ** 2)
    assert np.allclose(lux, plain)
    lamp = next(x for x in rig["lights"] if x["name"] == "warm.one")["parts"][0]
    assert np.isclose(lamp["intensity"], rig["scale"] ** 2)
    assert np.allclose(lamp["position"], world[:3, :3] @ [-1, 1, 0.2] + world[:3, 3])


MIXED = """
[mix.lamps]
"warm.one" = [0.5, 0.25, 1]
spot = 0

[mix.room]
environment = [0.5, 1, 2]

[mix.sky]
sun = 0.5
sky = [1, 0, 0]
"""


def test_a_lighting_that_is_traced_whole_is_mixed_too(folder: Path, tmp_path: Path) -> None:
    """With a noise target no lighting is made of unit lights; what files say of its lights is the same."""
    sets = []
    for name, settings in (("apart", ()), ("whole", ("--set", "render.noise=0.5"))):
        place = tmp_path / name
        shutil.copytree(folder.parent, place, ignore=shutil.ignore_patterns("out"))
        (place / "job.toml").write_text(JOB.replace("frames = 3", "frames = 1") + MIXED)
        arguments = "-q", "--set", "output.store=layers", "--set", "render.spp=1", *settings
        assert cli.main(["render", str(place / "job.toml"), *arguments]) == 0
        sets.append((dataset.open(place / "out"), export(place / "out", place / "set", "olat", "--held-out", "0")))
    (apart, plain), (whole, held) = sets
    assert {x.kind for x in whole.lights} == {"whole"} != {x.kind for x in apart.lights}
    frames = [load(out / "transforms_train.json")["frames"] for out in (plain, held)]
    assert [x["file_path"] for x in frames[0]] == [x["file_path"] for x in frames[1]]
    for old, new in zip(*frames, strict=True):
        np.testing.assert_allclose(new["pl_intensity"], old["pl_intensity"], rtol=1e-6)
    for name in ("day.1", "room", "sky"):
        old_map, new_map = apart.environment(name), whole.environment(name)
        assert old_map is not None and new_map is not None
        np.testing.assert_allclose(new_map, old_map, rtol=1e-5)
    rig = load(held / "lights.json")["lights"]
    lamp = next(x for x in rig if x["name"] == "lamps")["parts"]
    assert lamp[0]["color"] == [0.5, 0.25, 1] and lamp[1]["color"] == [0, 0, 0]
    (room,) = next(x for x in rig if x["name"] == "room")["parts"]
    assert (room["color"], room["intensity"]) == ([0.5, 1, 2], 2)


def test_another_way_of_relighting_is_another_picture(folder: Path, tmp_path: Path) -> None:
    """A lighting's own: what was exported before it changed is made again, and nothing else."""
    out, said = tmp_path / "out", ".mirelight/dataset.json"
    shutil.copytree(folder, out)
    names = ("--lighting", "lamp", "room")
    for blend, place in ((0.25, "twice"), (0.75, "twice"), (0.75, "once")):
        index = load(out / said)
        changed = next(x for x in index["lightings"] if x["name"] == "lamp")
        changed["relight"] = {**index["relight"], "blend": blend}
        (out / said).write_text(json.dumps(index))
        export(out, tmp_path / place, "nerf", "--no-hdr", *names)
        if blend == 0.25:
            before = {str(x): x.stat().st_mtime_ns for x in (tmp_path / "twice").rglob("*.png")}
    twice, once = (
        {str(x.relative_to(tmp_path / y)): x for x in (tmp_path / y).rglob("*.png")} for y in ("twice", "once")
    )
    assert twice.keys() == once.keys()
    for name, path in twice.items():
        assert path.read_bytes() == once[name].read_bytes(), name
    same = {name for name, path in twice.items() if path.stat().st_mtime_ns == before[str(path)]}
    assert any("room" in name for name in same) and not any("lamp" in name for name in same)


# --- parts, pages, ways to go wrong ----------------------------------------------------------------------------------


@pytest.mark.parametrize("by", ["camera", "lighting", "both"])
def test_parts_are_in_every_layout(folder: Path, tmp_path: Path, by: str) -> None:
    """One list for all; seen frames are the training frames of each layout."""
    more = ("--split", by, "--held-out", "0.5", "--seed", "4", "--no-hdr")
    nerf, colmap, tensoir, olat, hub = (
        export(folder, tmp_path / name, name, *more) for name in ("nerf", "colmap", "tensoir", "olat", "hub")
    )
    splits = load(nerf / "splits.json")
    parts = splits["parts"]
    assert splits == load(tensoir / "splits.json") == load(colmap / "splits.json")
    assert {key: bool(frames) for key, frames in parts.items()} == {
        "seen": True,
        "novel_view": by != "lighting",
        "novel_light": by != "camera",
        "novel_both": by == "both",
    }
    assert sum(len(x) for x in parts.values()) == 15
    seen = set(parts["seen"])
    for lighting in ("day_1", "room", "sky", "lamp", "lamps"):
        frames = load(nerf / lighting / "transforms_train.json")["frames"]
        own = {x for x in seen if x.startswith(f"{lighting}/")}
        assert {f"{lighting}/{x['file_path'].removeprefix('./images/')}" for x in frames} == own
        listed = (colmap / lighting / "sparse" / "0" / "train.txt").read_text().split()
        assert {f"{lighting}/{x.removesuffix('.png')}" for x in listed} == own
    held = {x.split("/")[1] for key in ("novel_view", "novel_both") for x in parts[key]}
    assert {load(p / "metadata.json")["view"] for p in tensoir.glob("test_*")} == held
    for part, frames in parts.items():
        shard = hub / "shards" / f"{'train' if part == 'seen' else part}-000000.tar"
        assert shard.exists() == bool(frames)
        assert not frames or set(samples(shard)) == {x.replace("/", "__") for x in frames}
    trained = {x["file_path"] for x in load(olat / "transforms_train.json")["frames"]}
    assert trained == {f"./images/{x.replace('/', '__')}" for x in seen if x.startswith("lamp/")}


def test_croissant(folder: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """mlcroissant finds no error, and reads a row for each frame, whose picture is there."""
    import mlcroissant

    out = export(folder, tmp_path, "nerf", "--license", "https://creativecommons.org/licenses/by/4.0/")
    with caplog.at_level(logging.WARNING):
        found = mlcroissant.Dataset(str(out / "croissant.json"))
    assert not found.metadata.ctx.issues.errors
    assert found.metadata.ctx.conforms_to.value == "http://mlcommons.org/croissant/1.1"
    assert "context" not in caplog.text  # it says so where the @context is not the standard's
    assert found.metadata.license == ["https://creativecommons.org/licenses/by/4.0/"]
    rows = list(found.records("frames"))
    assert len(rows) == 15 == len({x["frames/frame"] for x in rows})
    assert all((out / x[f"frames/{kind}"].decode()).is_file() for x in rows for kind in ("image", "linear"))
    assert {x["frames/width"] for x in rows} == {24}


@pytest.mark.parametrize("layout", WITHOUT_OBJECTS)
def test_the_page_s_code_loads_the_set(
    layout: str, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = export(folder, tmp_path / "set", layout, "--license", "cc-by-4.0", "--held-out", "0")
    counted = {"olat": 3}.get(layout, 15)
    assert capsys.readouterr().out.startswith(f"{counted} frames")
    page = (out / "README.md").read_text()
    assert "license: cc-by-4.0" in page and f"{counted} frames: 3 cameras" in page
    (code,) = re.findall(r"```python\n(.*?)```", page, flags=re.DOTALL)
    monkeypatch.chdir(out)
    monkeypatch.setenv("HF_HOME", str(tmp_path / "cache"))
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    exec(code, {})
    printed = capsys.readouterr().out.strip()
    expected = {"nerf": "3", "colmap": "3", "tensoir": "(4, 4) RGBA", "hub": "RGBA orbit_0001"}
    expected["tum"] = "(3, 8) (24, 24)"
    if layout == "olat":
        assert np.allclose(json.loads(printed), [-1, -0.2, 1])  # [-1, 1, 0.2] with Y up
    else:
        assert printed == expected[layout]


def test_an_export_goes_on_where_it_stopped(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = export(folder, tmp_path / "whole", "nerf", "--no-hdr")
    mixed: list[int] = []
    frame, most = DataSet.frame, [7]

    def counted(self: DataSet, camera: Any, lighting: Any) -> Any:
        if len(mixed) == most[0]:
            raise KeyboardInterrupt
        mixed.append(camera)
        return frame(self, camera, lighting)

    monkeypatch.setattr(DataSet, "frame", counted)
    assert cli.main(["export", str(folder), "--layout", "nerf", "-o", str(tmp_path / "part"), "--no-hdr"]) == 130
    most[0] = 100
    export(folder, tmp_path / "part", "nerf", "--no-hdr")
    assert len(mixed) == 15 + 15  # none twice, and once for the contact sheet
    files = {p.relative_to(whole) for p in whole.rglob("*") if p.is_file()}
    assert files == {p.relative_to(tmp_path / "part") for p in (tmp_path / "part").rglob("*") if p.is_file()}
    assert all((whole / p).read_bytes() == (tmp_path / "part" / p).read_bytes() for p in files)


def test_what_cannot_be_exported(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for more, said in {
        ("--layout", "nerf", "--lighting", "noon"): "no lighting 'noon'; there are: day.1, room",
        ("--layout", "olat", "--lighting", "lamps"): "no lighting of one point or spot light",
    }.items():
        assert cli.main(["export", str(folder), "-o", str(tmp_path / "x"), *more]) == 2
        assert said in capsys.readouterr().err
    (folder.parent / "wide.toml").write_text(JOB.replace("[24, 24]", "[24, 16]").replace("frames = 3", "frames = 1"))
    wide = ["render", str(folder.parent / "wide.toml"), "-q", "-o", str(tmp_path / "wide"), "--set", "render.spp=1"]
    assert cli.main([*wide, "--set", "output.store=layers"]) == 0
    assert cli.main(["export", str(tmp_path / "wide"), "--layout", "tensoir", "-o", str(tmp_path / "x")]) == 2
    assert "camera 'orbit.0001' is 24 x 16 pixels" in capsys.readouterr().err
    far_job = JOB.replace("radius = 4", "radius = 40").replace("frames = 3", "frames = 1")
    (folder.parent / "far.toml").write_text(far_job)
    far = ["render", str(folder.parent / "far.toml"), "-q", "-o", str(tmp_path / "far"), "--set", "render.spp=1"]
    assert cli.main([*far, "--set", "output.store=layers"]) == 0
    assert cli.main(["export", str(tmp_path / "far"), "--layout", "tum", "-o", str(tmp_path / "x")]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert "nothing nearer than 13.1" in line
    assert not (tmp_path / "x").exists()


# --- [dataset] in a job ----------------------------------------------------------------------------------------------

AT_END = """
[dataset]
layouts = ["olat", "colmap"]
split = "lighting"
held_out = 0.5
license = "cc0-1.0"
hdr = false
"""


def test_a_denoised_job_of_one_camera_is_exported_as_it_was_traced(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """As `mirelight new` writes it: nothing has to be rendered again, and nobody speaks of a split."""
    path = folder.parent / "one.toml"
    path.write_text(JOB.replace("frames = 3", "frames = 1") + '[dataset]\nlayouts = ["nerf"]\n')
    for name in ("true", "false"):
        command = ["render", str(path), "-o", str(tmp_path / name), "--set", f"render.denoise={name}"]
        assert cli.main([*command, "--set", "render.spp=1", "--set", "output.exr=false"]) == 0
        said = capsys.readouterr()
        assert ("not denoised: more render.spp" in said.err) == (name == "true")
        assert "held out" not in said.err and "--seed" not in said.err and "5 frames in" in said.out
        export(tmp_path / name, tmp_path / f"set {name}", "nerf")
        capsys.readouterr()
    one, other = (dataset.open(tmp_path / name) for name in ("true", "false"))
    assert len(one) == len(other) == 5
    assert np.array_equal(one.frame(0, "lamps"), other.frame(0, "lamps"))
    page = (tmp_path / "set true" / "README.md").read_text()
    assert "All frames are to train on: none is held out." in page and "by a hash" not in page


def test_a_job_writes_its_data_sets_once_all_frames_are_there(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = folder.parent / "sets.toml"
    path.write_text(JOB + AT_END)
    command = ["render", str(path), "-o", str(tmp_path), "--set", "render.spp=1", "--set", "output.exr=false"]
    assert cli.main([*command, "--camera", "orbit.0002"]) == 0
    said = capsys.readouterr().out.splitlines()
    assert said[-1] == "data sets are written when all cameras are there: 1 of 3 are"
    assert not (tmp_path / "dataset").exists()
    assert cli.main(command) == 0
    said = capsys.readouterr().out.splitlines()
    assert said[-2].startswith(f"3 frames in {tmp_path / 'dataset' / 'olat'}")
    assert said[-1].startswith(f"15 frames in {tmp_path / 'dataset' / 'colmap'}")
    assert "license: cc0-1.0" in (tmp_path / "dataset" / "colmap" / "README.md").read_text()
    splits = load(tmp_path / "dataset" / "colmap" / "splits.json")
    assert (splits["by"], splits["held_out"], splits["seed"]) == ("lighting", 0.5, 0)
    assert not list((tmp_path / "dataset" / "olat").rglob("*.exr"))
    before = {p: p.stat().st_mtime_ns for p in (tmp_path / "dataset").rglob("*.png")}
    assert cli.main(command) == 0
    assert "15 of them already there" in capsys.readouterr().out.splitlines()[-1]
    assert before == {p: p.stat().st_mtime_ns for p in before}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (AT_END.replace('"colmap"', '"hub"').replace("[dataset]", "[dataset]\nnormalize = 3"), "dataset.normalize: "),
        (AT_END.replace('"colmap"', '"blender"'), "dataset.layouts[1]: "),
        (AT_END.replace("cc0-1.0", "a: b"), "cannot be a licence's name"),
        (AT_END + '[output]\nstore = "frames"\n', "'frames', but data sets are mixed from layers"),
        (AT_END.replace('"colmap"', '"tensoir"'), "camera 'wide' has another field of view"),
        (AT_END.replace('"olat", "colmap"', '"tum"'), "camera 'wide' has another lens than 'orbit.0001'"),
        (AT_END.replace('"olat", ', "").replace('"colmap"', '"nerf"'), "camera 'wide' has another field of view"),
    ],
)
def test_data_sets_that_cannot_be_are_refused_before_anything_is_made(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, said: str
) -> None:
    wide = '\n[[cameras]]\nname = "wide"\nposition = [0, 2, 5]\ntarget = [0, 0, 0]\nyfov = 60\n'
    path = folder.parent / "wrong.toml"
    path.write_text(JOB + wide + text)
    assert cli.main(["render", str(path), "-o", str(tmp_path / "out")]) == 2
    found = capsys.readouterr().err
    assert said in found and not (tmp_path / "out").exists()


@pytest.mark.parametrize("more", [("--held-out", "2"), ("--license", "x\ny"), ("--layout", "blender")])
def test_wrong_arguments_are_one_line(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], more: tuple[str, ...]
) -> None:
    command = ["export", str(folder), "--layout", "nerf", "-o", str(tmp_path / "x"), *more]
    try:
        code = cli.main(command)
    except SystemExit as e:  # argparse
        code = int(e.code or 0)
    said = capsys.readouterr().err.strip().splitlines()
    assert code == 2 and more[0] in said[-1] and not (tmp_path / "x").exists()
