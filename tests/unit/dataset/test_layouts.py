"""Layouts of data sets: own readers and other programs find each point where mirelight's camera shows it."""

from __future__ import annotations

import json
import math
import re
import tarfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap
import pytest
import trimesh
from PIL import Image

from mirelight.base.errors import InputError
from mirelight.base.layouts import Layout
from mirelight.dataset.layouts import WRITERS, Files, Geometry, Picture, Pixels, Shared, points_of, world_of
from mirelight.dataset.layouts.colmap import write_colmap
from mirelight.dataset.layouts.hub import write_hub
from mirelight.dataset.layouts.nerf import write_nerf
from mirelight.dataset.layouts.pictures import file_names
from mirelight.dataset.layouts.tum import write_tum
from mirelight.io import owner
from mirelight.io.cameras import open_file
from mirelight.io.cameras.transforms import Z_UP
from mirelight.io.exr import read_exr
from mirelight.io.png import encode_display, encode_straight
from mirelight.model import Camera, DisplaySettings, SplatCloud

from ..io.cameras.views import pixels_of

NAMES = ["orbit.0001", "orbit.0002", "orbit_0001", "living room", "ü"]
POINTS = np.random.default_rng(0).uniform(-1, 1, (20, 3))


def cameras(**more: Any) -> list[Camera]:
    out = []
    for i, name in enumerate(NAMES):
        away = np.array([math.sin(i), 0.4, math.cos(i)]) * 4
        out.append(replace(Camera.look_at(away, (0, 0, 0), 32, 24, name=name), **more))
    return out


def pictures(seen: list[Camera], depth: float | None = None, lighting: str = "") -> list[Picture]:
    """Frames of noise; the last two are held out. The proxy covers the whole view at one depth, where it is given."""
    rng = np.random.default_rng(1)
    views = file_names([c.name for c in seen], "camera")
    out = []
    for i, c in enumerate(seen):
        linear = rng.uniform(0, 1, (c.height, c.width, 4)).astype(np.float32)
        linear[..., :3] *= linear[..., 3:]
        geometry = None if depth is None else flat(c, depth)
        pixels = Pixels(lambda linear=linear: linear, None if geometry is None else lambda g=geometry: g)  # type: ignore[misc]
        part: Any = "seen" if i < 3 else "novel_view"
        key = f"{lighting} {c.name} {depth}"
        out.append(
            Picture(
                camera=c,
                view=views[c.name],
                lighting=lighting,
                number=i,
                part=part,
                key=key,
                view_key=key,
                pixels=pixels,
            )
        )
    return out


def flat(camera: Camera, depth: float) -> Geometry:
    plane = np.ones((camera.height, camera.width), dtype=np.float32)
    up = np.broadcast_to(np.array([0, 1, 0], np.float32), (*plane.shape, 3))
    return Geometry(depth=plane * np.float32(depth), coverage=plane, normal=up, albedo=up)


def cloud(count: int) -> SplatCloud:
    rng = np.random.default_rng(2)
    return SplatCloud(
        means=rng.normal(size=(count, 3)).astype(np.float32),
        quats=np.tile(np.array([1, 0, 0, 0], dtype=np.float32), (count, 1)),
        scales=np.full((count, 3), 0.1, dtype=np.float32),
        opacities=np.ones(count, dtype=np.float32),
        sh=rng.normal(size=(count, 1, 3)).astype(np.float32),
    )


def test_straight_alpha_gives_the_png_over_any_background() -> None:
    rng = np.random.default_rng(3)
    alpha = rng.uniform(0.05, 1, (30, 40, 1)).astype(np.float32)
    alpha[:3] = 0
    rgba = np.concatenate([rng.uniform(0, 1, (30, 40, 3)).astype(np.float32) * alpha, alpha], axis=-1)
    for display in (DisplaySettings(), DisplaySettings(exposure=-1.5, tone="agx")):
        straight = encode_straight(rgba, display) / 255
        for background in ((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), (0.2, 0.6, 0.4)):
            over = straight[..., :3] * straight[..., 3:] + np.array(background) * (1 - straight[..., 3:])
            shown = encode_display(rgba, replace(display, background=background)) / 255
            assert np.abs(over - shown).max() <= 2 / 255
    assert (encode_straight(rgba, DisplaySettings())[:3] == 0).all()


def test_nerf(tmp_path: Path) -> None:
    seen = cameras()
    frames = pictures(seen, depth=3.25, lighting="noon")
    shared = Shared(points=points_of(cloud(50)))
    with Files(tmp_path) as files:
        write_nerf(files, iter(frames), shared)
    data = json.loads((tmp_path / "noon" / "transforms.json").read_text())
    assert data["fl_x"] == seen[0].fx and "fl_x" not in data["frames"][0]
    found = open_file(tmp_path / "noon" / "transforms.json").read()  # undoes the turn to Z up
    linear = json.loads((tmp_path / "noon" / "transforms_hdr.json").read_text())["frames"]
    for camera, again, frame, picture, hdr in zip(seen, found, data["frames"], frames, linear, strict=True):
        np.testing.assert_allclose(pixels_of(again.to_camera((32, 24)), POINTS), pixels_of(camera, POINTS), atol=1e-6)
        assert re.fullmatch(r"images/[A-Za-z0-9_-]+\.png", frame["file_path"])
        image = Image.open(tmp_path / "noon" / frame["file_path"])
        assert image.mode == "RGBA"
        np.testing.assert_array_equal(np.asarray(image), encode_straight(picture.pixels.linear, DisplaySettings()))
        np.testing.assert_array_equal(read_exr(tmp_path / "noon" / hdr["file_path"]).layer(), picture.pixels.linear)
        depth = np.asarray(Image.open(tmp_path / "noon" / frame["depth_file_path"]))
        assert depth.dtype == np.uint16 and (depth == 3250).all()
        mask = np.asarray(Image.open(tmp_path / "noon" / frame["mask_path"]))
        np.testing.assert_array_equal(mask, np.where(picture.pixels.linear[..., 3] > 0.5, 255, 0))
    assert len({frame["file_path"] for frame in data["frames"]}) == len(NAMES)
    assert (len(data["train_filenames"]), data["val_filenames"]) == (3, data["test_filenames"])
    assert data["frames"][0]["transform_matrix"][2][3] == pytest.approx(seen[0].position[1])  # Z is up
    points = trimesh.load(tmp_path / "noon" / data["ply_file_path"])
    np.testing.assert_allclose(points.vertices, cloud(50).means @ Z_UP[:3, :3].T, atol=1e-6)


def test_blender_nerf_files(tmp_path: Path) -> None:
    """Everything that such a reader knows is in them: one angle, poses with Z up, names without suffix."""
    seen = cameras()
    with Files(tmp_path) as files:
        write_nerf(files, pictures(seen), Shared())
    names = []
    for split, part in (("train", seen[:3]), ("test", seen[3:])):
        data = json.loads((tmp_path / f"transforms_{split}.json").read_text())
        assert 0.5 * 32 / math.tan(0.5 * data["camera_angle_x"]) == pytest.approx(part[0].fx)
        found = open_file(tmp_path / f"transforms_{split}.json").read()
        for camera, again, frame in zip(part, found, data["frames"], strict=True):
            moved = POINTS @ Z_UP[:3, :3].T
            np.testing.assert_allclose(
                pixels_of(again.to_camera((32, 24)), moved), pixels_of(camera, POINTS), atol=1e-6
            )
            assert (tmp_path / (frame["file_path"] + ".png")).is_file()
            names.append(frame["file_path"])
    assert len(set(names)) == len(NAMES)
    assert (tmp_path / "transforms_val.json").read_text() == (tmp_path / "transforms_test.json").read_text()


@pytest.mark.parametrize("layout", ["nerf", "olat", "tensoir"])
@pytest.mark.parametrize(
    ("change", "found"),
    [
        ({"cx": 15.0}, "principal point off the middle"),
        ({"fy": 40.0}, "different focal lengths"),
        ({"projection": "orthographic"}, "is orthographic"),
    ],
)
def test_lenses_that_one_angle_cannot_say(layout: Layout, change: dict[str, Any], found: str) -> None:
    with pytest.raises(InputError, match=rf"camera 'orbit\.0001' (has )?.*{found.removeprefix('is ')}"):
        WRITERS[layout].check(cameras(**change), Shared())


def test_layouts_of_square_pictures() -> None:
    with pytest.raises(InputError, match=r"camera 'orbit\.0001' is 32 x 24 pixels.*; render them with resolution"):
        WRITERS["tensoir"].check(cameras(), Shared())


def test_lenses_that_differ_stand_in_the_frames(tmp_path: Path) -> None:
    seen = cameras(cx=14.5, fy=31.0)
    seen[2] = replace(seen[2], fx=50.0)
    plain = cameras()
    plain[2] = replace(plain[2], fx=50.0, fy=50.0)
    with pytest.raises(InputError, match=r"'orbit_0001' has another field of view than 'orbit\.0001'"):
        WRITERS["nerf"].check(plain, Shared())
    with Files(tmp_path) as files:
        write_nerf(files, pictures(seen), Shared(), blender=False)
    data = json.loads((tmp_path / "transforms.json").read_text())
    assert "fl_x" not in data and [f["fl_x"] for f in data["frames"]] == [c.fx for c in seen]
    for camera, again in zip(seen, open_file(tmp_path).read(), strict=True):
        np.testing.assert_allclose(pixels_of(again.to_camera((32, 24)), POINTS), pixels_of(camera, POINTS), atol=1e-6)


def test_colmap(tmp_path: Path) -> None:
    seen = cameras(cx=14.5, fy=31.0)
    shared = Shared(points=points_of(cloud(250), most=100))
    with Files(tmp_path) as files:
        write_colmap(files, iter(pictures(seen)), shared)
    model = pycolmap.Reconstruction(str(tmp_path / "sparse" / "0"))
    by_name = {image.name: image for image in model.images.values()}
    assert sorted(by_name) == sorted(p.name for p in (tmp_path / "images").iterdir())
    assert sorted(by_name) == ["camera.png", "living_room.png", "orbit_0001-2.png", "orbit_0001.png", "orbit_0002.png"]
    turned = POINTS @ Z_UP[:3, :3].T
    for camera, name in zip(seen, ["orbit_0001", "orbit_0002", "orbit_0001-2", "living_room", "camera"], strict=True):
        image = by_name[f"{name}.png"]
        shown = np.array([image.camera.img_from_cam(point) for point in image.cam_from_world() * turned])
        np.testing.assert_allclose(shown, pixels_of(camera, POINTS), rtol=0, atol=1e-6)
    assert len(model.points3D) == 84  # every third of 250
    lists = {split: (tmp_path / "sparse" / "0" / f"{split}.txt").read_text().split() for split in ("train", "test")}
    assert lists == {
        "train": ["orbit_0001.png", "orbit_0002.png", "orbit_0001-2.png"],
        "test": ["living_room.png", "camera.png"],
    }


def test_tum(tmp_path: Path) -> None:
    """Depth that 16 bits do not hold is none; a picture without geometry has no line in depth.txt."""
    seen = cameras(cx=14.5, fy=31.0)
    WRITERS["tum"].check(seen, Shared(near_far=(1, 20)))
    frames = [*pictures(seen, depth=13.1, lighting="near"), *pictures(seen, depth=13.2, lighting="far")]
    with Files(tmp_path) as files:
        write_tum(files, [*frames, *pictures(seen)], Shared())
    for lighting, expected in (("near", 65500), ("far", 0)):
        rows = [x.split() for x in (tmp_path / lighting / "depth.txt").read_text().splitlines() if x[0] != "#"]
        np.testing.assert_allclose([float(time) for time, _ in rows], np.arange(len(NAMES)) / 30, atol=1e-6)
        for _, name in rows:
            depth = np.asarray(Image.open(tmp_path / lighting / name))
            assert depth.dtype == np.uint16 and (depth == expected).all()
    assert not (tmp_path / "depth").exists() and "png" not in (tmp_path / "depth.txt").read_text()
    assert len(np.loadtxt(tmp_path / "groundtruth.txt")) == len(NAMES)
    assert np.loadtxt(tmp_path / "calibration.txt") == pytest.approx([seen[0].fx, 31, 14, seen[0].cy - 0.5])


@pytest.mark.parametrize(
    ("change", "found"),
    [
        ({"projection": "orthographic"}, "is orthographic"),
        ({"cx": 15.0}, "has another lens than 'orbit.0001'"),
        ({"width": 33}, "is 33 x 24 pixels, and 'orbit.0001' 32 x 24"),
    ],
)
def test_what_a_sequence_of_tum_cannot_hold(change: dict[str, Any], found: str) -> None:
    seen = cameras()
    with pytest.raises(InputError, match=re.escape(f"camera 'orbit.0002' {found}")):
        WRITERS["tum"].check([seen[0], replace(seen[1], **change), *seen[2:]], Shared())
    with pytest.raises(InputError, match=r"nothing nearer than 13\.1"):
        WRITERS["tum"].check(seen, Shared(near_far=(14, 20)))


def test_a_normalised_world(tmp_path: Path) -> None:
    """A set moved and scaled: its own pixels show the scaled points, depths shrink, and the capture is found again."""
    seen = cameras()
    world = world_of(center=(0.5, 1.0, -2.0), scale=0.25)
    np.testing.assert_allclose(world @ [0.5, 1.0, -2.0, 1], [0, 0, 0, 1], atol=1e-15)
    np.testing.assert_allclose(world @ [0.5, 5.0, -2.0, 1], [0, 0, 1, 1], atol=1e-15)  # 4 up are 1 along Z
    shared = Shared(world=world, points=points_of(cloud(20)))
    with Files(tmp_path) as files:
        write_nerf(files, pictures(seen, depth=3.0), shared)
        write_colmap(files, pictures(seen, depth=3.0), shared)
    moved = POINTS @ world[:3, :3].T + world[:3, 3]
    for camera, again in zip(seen, open_file(tmp_path / "transforms.json").read(), strict=True):
        np.testing.assert_allclose(pixels_of(again.to_camera((32, 24)), POINTS), pixels_of(camera, POINTS), atol=1e-6)
    blender = open_file(tmp_path / "transforms_train.json").read()
    for camera, again in zip(seen[:3], blender, strict=True):
        np.testing.assert_allclose(pixels_of(again.to_camera((32, 24)), moved), pixels_of(camera, POINTS), atol=1e-6)
    by_name = {c.name: c for c in open_file(tmp_path / "sparse").read()}
    shown = pixels_of(by_name["orbit_0002"].to_camera((32, 24)), moved)
    np.testing.assert_allclose(shown, pixels_of(seen[1], POINTS), atol=1e-6)
    data = json.loads((tmp_path / "transforms.json").read_text())
    assert (np.asarray(Image.open(tmp_path / data["frames"][0]["depth_file_path"])) == 750).all()
    expected = cloud(20).means @ world[:3, :3].T + world[:3, 3]
    np.testing.assert_allclose(trimesh.load(tmp_path / "points.ply").vertices, expected, atol=1e-6)


@pytest.mark.parametrize("scale", [1.0, 0.25, 3.0])
@pytest.mark.parametrize("lighting", ["", "noon"])
def test_points_and_depths_as_nerfstudio_scales_them(tmp_path: Path, scale: float, lighting: str) -> None:
    """It centres the poses and makes the farthest 1; points and depths take the same steps, and `applied_scale`, too.
    Then each point still lies in its pixel, at its depth; and its world leads back to the capture."""
    seen, depth = cameras(), 3.0
    world = world_of(center=(0.5, 1.0, -2.0), scale=scale)
    shared = Shared(world=world, points=points_of(cloud(20)))
    with Files(tmp_path) as files:
        write_nerf(files, pictures(seen, depth=depth, lighting=lighting), shared)
    folder = tmp_path / lighting
    data = json.loads((folder / "transforms.json").read_text())
    assert data["orientation_override"] == "none"
    poses = np.array([frame["transform_matrix"] for frame in data["frames"]])
    center = np.eye(4)
    center[:3, 3] = -poses[:, :3, 3].mean(axis=0)
    poses = center @ poses
    fit = 1 / np.abs(poses[:, :3, 3]).max()
    poses[:, :3, 3] *= fit
    points = trimesh.load(folder / data["ply_file_path"]).vertices
    of_all = fit * data.get("applied_scale", 1.0)
    points = of_all * (points + center[:3, 3])
    trained = of_all * (center @ np.vstack([data["applied_transform"], [0, 0, 0, 1]]))[:3]
    means = cloud(20).means.astype(np.float64)
    np.testing.assert_allclose(means @ trained[:, :3].T + trained[:, 3], points, atol=1e-5)
    for camera, pose, frame in zip(seen, poses, data["frames"], strict=True):
        own = (points - pose[:3, 3]) @ pose[:3, :3]
        shown = [data["cx"] - data["fl_x"] * own[:, 0] / own[:, 2], data["cy"] + data["fl_y"] * own[:, 1] / own[:, 2]]
        np.testing.assert_allclose(np.stack(shown, axis=-1), pixels_of(camera, means), atol=1e-3)
        read = np.asarray(Image.open(folder / frame["depth_file_path"])) * 0.001 * of_all
        ahead = camera.position - depth * camera.world_from_camera[:3, 2]  # in the middle of the picture
        ahead = trained[:, :3] @ ahead + trained[:, 3]
        np.testing.assert_allclose(read[12, 16], pose[:3, 2] @ (pose[:3, 3] - ahead), rtol=1e-3)


def test_orthographic_cameras_have_no_place(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"camera 'orbit\.0001' is orthographic"):
        WRITERS["colmap"].check([replace(cameras()[0], projection="orthographic")], Shared())


def test_files_are_made_once_and_again_where_their_content_changed(tmp_path: Path) -> None:
    seen = cameras()
    with Files(tmp_path) as files:
        write_nerf(files, pictures(seen, depth=3.0, lighting="noon"), Shared())
        files.finish()
    dates = {p: p.stat().st_mtime_ns for p in tmp_path.rglob("*.*") if p.is_file() and ".mirelight" not in p.parts}
    assert len(dates) == files.made
    damaged, gone = tmp_path / "noon" / "images" / "camera.png", tmp_path / "noon" / "hdr" / "camera.exr"
    damaged.write_bytes(damaged.read_bytes()[:-5])
    gone.unlink()
    with Files(tmp_path) as again:
        write_nerf(again, pictures(seen, depth=3.0, lighting="noon"), Shared())
        again.finish()
    assert again.made == 2
    assert {p for p, date in dates.items() if p.stat().st_mtime_ns != date} == {damaged, gone}
    with Files(tmp_path) as other:  # a set of four cameras at another depth: what was there for the fifth goes
        write_nerf(other, pictures(seen[:4], depth=2.0, lighting="noon"), Shared())
        other.finish()
    assert not damaged.exists() and not gone.exists()
    assert (np.asarray(Image.open(tmp_path / "geometry" / "depth" / "orbit_0002.png")) == 2000).all()


def test_what_a_killed_export_left_is_cleared_away(tmp_path: Path) -> None:
    """Temporary files of processes that have ended, wherever the next export looks for its files."""
    with Files(tmp_path) as files:
        write_nerf(files, pictures(cameras(), lighting="noon"), Shared())
        files.finish()
    ended, own = f"{owner.machine()}-4194305", owner.token()
    folders = [tmp_path, tmp_path / ".mirelight", tmp_path / "noon" / "images", tmp_path / "noon" / "hdr"]
    for folder in folders:
        (folder / f".a~{ended}-0123456789ab.png").write_bytes(b"half")
        (folder / f".a~{own}-0123456789ab.png").write_bytes(b"at work")
    with Files(tmp_path) as files:
        write_nerf(files, pictures(cameras(), lighting="noon"), Shared())
        files.finish()
        assert files.made == 0
    left = sorted(x.parent for x in tmp_path.rglob(".a~*"))
    assert left == sorted(folders) and all(own in x.name for x in tmp_path.rglob(".a~*"))


def test_files_of_others_stay(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    with Files(tmp_path) as files:
        write_nerf(files, pictures(cameras(), lighting="noon"), Shared())
        files.finish()
    with Files(tmp_path) as files:
        write_nerf(files, pictures(cameras(), lighting="dusk"), Shared())
        files.finish()
    kept = sorted(p.name for p in tmp_path.iterdir())
    assert kept == [".mirelight", "dusk", "geometry", "notes.txt"]


def test_the_same_bytes_again(tmp_path: Path) -> None:
    shared = Shared(points=points_of(cloud(9)))
    for name in ("a", "b"):
        with Files(tmp_path / name) as files:
            write_nerf(files, pictures(cameras()), shared)
            write_colmap(files, pictures(cameras(), lighting="colmap"), shared)
    names = [p.relative_to(tmp_path / "a") for p in (tmp_path / "a").rglob("*") if p.is_file()]
    assert len(names) > 15
    for file in names:
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()


def test_long_names_in_shards(tmp_path: Path) -> None:
    """Beyond the 100 characters that a tar's own header holds."""
    seen = [replace(c, name=f"{c.name} {'x' * 90}") for c in cameras()[:2]]
    for lighting in ("noon", "n" * 120):
        frames = pictures(seen, lighting=lighting)
        with Files(tmp_path / lighting) as files:
            write_hub(files, iter(frames), Shared())
        with tarfile.open(tmp_path / lighting / "shards" / "train-000000.tar") as shard:
            names = shard.getnames()
        assert {name.partition(".")[0] for name in names} == {f"{lighting}__{frame.view}" for frame in frames}
