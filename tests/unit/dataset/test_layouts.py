"""Layouts of data sets: own readers and other programs find each point where mirelight's camera shows it."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap
import pytest
import trimesh
from PIL import Image

from mirelight.dataset.layouts import Picture, points_of, straight_rgba, world_of, write_colmap, write_nerf
from mirelight.errors import InputError
from mirelight.io.cameras import open_file
from mirelight.io.cameras.transforms import Z_UP
from mirelight.io.png import encode_display
from mirelight.model import Camera, DisplaySettings, SplatCloud

from ..cameras.views import pixels_of

NAMES = ["orbit.0001", "orbit.0002", "orbit_0001", "living room", "ü"]
POINTS = np.random.default_rng(0).uniform(-1, 1, (20, 3))


def cameras(**more: Any) -> list[Camera]:
    out = []
    for i, name in enumerate(NAMES):
        away = np.array([math.sin(i), 0.4, math.cos(i)]) * 4
        out.append(replace(Camera.look_at(away, (0, 0, 0), 32, 24, name=name), **more))
    return out


def pictures(seen: list[Camera], **more: Any) -> list[Picture]:
    rng = np.random.default_rng(1)
    splits: tuple[Any, ...] = ("train", "train", "train", "test", "test")
    return [
        Picture(
            camera=c,
            rgba=rng.integers(0, 256, (c.height, c.width, 4), dtype=np.uint8),
            split=split,
            **{key: make(c) for key, make in more.items()},
        )
        for c, split in zip(seen, splits, strict=True)
    ]


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
        straight = straight_rgba(rgba, display) / 255
        for background in ((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), (0.2, 0.6, 0.4)):
            over = straight[..., :3] * straight[..., 3:] + np.array(background) * (1 - straight[..., 3:])
            shown = encode_display(rgba, replace(display, background=background)) / 255
            assert np.abs(over - shown).max() <= 2 / 255
    assert (straight_rgba(rgba)[:3] == 0).all()


def test_nerf(tmp_path: Path) -> None:
    seen = cameras()
    frames = pictures(
        seen,
        depth=lambda c: np.full((c.height, c.width), 3.25, dtype=np.float32),
        mask=lambda c: np.arange(c.width)[None, :].repeat(c.height, 0) % 2 == 0,
    )
    write_nerf(tmp_path / "noon", iter(frames), points=points_of(cloud(50)))
    data = json.loads((tmp_path / "noon" / "transforms.json").read_text())
    assert data["fl_x"] == seen[0].fx and "fl_x" not in data["frames"][0]
    found = open_file(tmp_path / "noon" / "transforms.json").read()  # undoes the turn to Z up
    for camera, again, frame, picture in zip(seen, found, data["frames"], frames, strict=True):
        np.testing.assert_allclose(pixels_of(again.to_camera((32, 24)), POINTS), pixels_of(camera, POINTS), atol=1e-6)
        assert re.fullmatch(r"images/[A-Za-z0-9_-]+\.png", frame["file_path"])
        image = Image.open(tmp_path / "noon" / frame["file_path"])
        assert image.mode == "RGBA"
        np.testing.assert_array_equal(np.asarray(image), picture.rgba)
        depth = np.asarray(Image.open(tmp_path / "noon" / frame["depth_file_path"]))
        assert depth.dtype == np.uint16 and (depth == 3250).all()
        mask = np.asarray(Image.open(tmp_path / "noon" / frame["mask_path"]))
        assert mask.ndim == 2 and (mask[:, ::2] == 255).all() and (mask[:, 1::2] == 0).all()
    assert len({frame["file_path"] for frame in data["frames"]}) == len(NAMES)
    assert (len(data["train_filenames"]), data["val_filenames"]) == (3, data["test_filenames"])
    assert data["frames"][0]["transform_matrix"][2][3] == pytest.approx(seen[0].position[1])  # Z is up
    points = trimesh.load(tmp_path / "noon" / data["ply_file_path"])
    np.testing.assert_allclose(points.vertices, cloud(50).means @ Z_UP[:3, :3].T, atol=1e-6)


def test_blender_nerf_files(tmp_path: Path) -> None:
    """Everything that such a reader knows is in them: one angle, poses with Z up, names without suffix."""
    seen = cameras()
    write_nerf(tmp_path, pictures(seen))
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
    assert len(set(names)) == len(NAMES) and not (tmp_path / "transforms_val.json").exists()


@pytest.mark.parametrize(
    ("change", "found"),
    [
        ({"cx": 15.0}, "principal point off the middle"),
        ({"fy": 40.0}, "different focal lengths"),
    ],
)
def test_lenses_that_blender_s_files_cannot_say(tmp_path: Path, change: dict[str, float], found: str) -> None:
    seen = cameras(**change)
    with pytest.raises(InputError, match=f"camera 'orbit.0001' has .*{found.split(' ', 1)[1]}.*blender=False"):
        write_nerf(tmp_path, pictures(seen))
    write_nerf(tmp_path, pictures(seen), blender=False)
    for camera, again in zip(seen, open_file(tmp_path).read(), strict=True):
        np.testing.assert_allclose(pixels_of(again.to_camera((32, 24)), POINTS), pixels_of(camera, POINTS), atol=1e-6)


def test_lenses_that_differ_stand_in_the_frames(tmp_path: Path) -> None:
    seen = cameras()
    seen[2] = replace(seen[2], fx=50.0, fy=50.0)
    with pytest.raises(InputError, match=r"'orbit_0001' has another field of view than 'orbit\.0001'"):
        write_nerf(tmp_path, pictures(seen))
    write_nerf(tmp_path, pictures(seen), blender=False)
    data = json.loads((tmp_path / "transforms.json").read_text())
    assert "fl_x" not in data and [f["fl_x"] for f in data["frames"]] == [c.fx for c in seen]


def test_colmap(tmp_path: Path) -> None:
    seen = cameras(cx=14.5, fy=31.0)
    write_colmap(tmp_path, iter(pictures(seen)), points=points_of(cloud(250), most=100))
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


def test_a_normalised_world(tmp_path: Path) -> None:
    """A set moved and scaled: its own pixels show the scaled points, depths shrink, and the capture is found again."""
    seen = cameras()
    world = world_of(center=(0.5, 1.0, -2.0), scale=0.25)
    np.testing.assert_allclose(world @ [0.5, 1.0, -2.0, 1], [0, 0, 0, 1], atol=1e-15)
    np.testing.assert_allclose(world @ [0.5, 5.0, -2.0, 1], [0, 0, 1, 1], atol=1e-15)  # 4 up are 1 along Z
    frames = pictures(seen, depth=lambda c: np.full((c.height, c.width), 3.0, dtype=np.float32))
    write_nerf(tmp_path, frames, world=world, points=points_of(cloud(20)))
    write_colmap(tmp_path, frames, world=world, points=points_of(cloud(20)))
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
    assert data["applied_scale"] == pytest.approx(0.25)
    assert (np.asarray(Image.open(tmp_path / data["frames"][0]["depth_file_path"])) == 750).all()
    expected = cloud(20).means @ world[:3, :3].T + world[:3, 3]
    np.testing.assert_allclose(trimesh.load(tmp_path / "points.ply").vertices, expected, atol=1e-6)


def test_what_has_no_place(tmp_path: Path) -> None:
    flat = replace(cameras()[0], projection="orthographic")
    one = Picture(camera=flat, rgba=np.zeros((24, 32, 4), dtype=np.uint8))
    for write in (write_nerf, write_colmap):
        with pytest.raises(InputError, match=r"camera 'orbit\.0001' is orthographic"):
            write(tmp_path, [one])
    mixed = pictures(cameras())
    mixed[1] = replace(mixed[1], depth=np.ones((24, 32), dtype=np.float32))
    with pytest.raises(InputError, match=r"a depth for some pictures, none for|give all or none"):
        write_nerf(tmp_path, mixed)
    with pytest.raises(ValueError, match=r"Picture\.rgba"):
        Picture(camera=cameras()[0], rgba=np.zeros((32, 24, 4), dtype=np.uint8))


def test_the_same_bytes_again(tmp_path: Path) -> None:
    for name in ("a", "b"):
        write_nerf(tmp_path / name, pictures(cameras()), points=points_of(cloud(9)))
        write_colmap(tmp_path / name / "colmap", pictures(cameras()), points=points_of(cloud(9)))
    files = [p.relative_to(tmp_path / "a") for p in (tmp_path / "a").rglob("*") if p.is_file()]
    assert len(files) > 15
    for file in files:
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()
