"""Cameras of trainings, brought to the world of their splats: by pictures, or by what the training says."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from mirelight.apps.first_job import own_cameras
from mirelight.apps.first_job.pictured import alike
from mirelight.base.conventions import look_at
from mirelight.base.errors import InputError
from mirelight.io import splats
from mirelight.io.cameras import open_file, transforms
from mirelight.io.cameras.pictures import find_all
from mirelight.model import F64, Camera, SplatCloud
from mirelight.proxy.views import rays

DATA = Path(__file__).parents[2] / "data" / "splats"


def brightness(x: F64, y: F64) -> F64:
    """What is painted on the board z = 0, display-encoded."""
    return np.asarray(0.5 + 0.4 * np.sin(3.1 * x) * np.cos(2.3 * y + 0.4))


def board() -> SplatCloud:
    x, y = (v.ravel() for v in np.meshgrid(np.linspace(-2, 2, 120), np.linspace(-2, 2, 120)))
    count = len(x)
    return SplatCloud(
        means=np.stack([x, y, np.zeros(count)], axis=1).astype(np.float32),
        quats=np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1)),
        scales=np.full((count, 3), 0.02, np.float32),
        opacities=np.full(count, 0.9, np.float32),
        sh=((brightness(x, y) - 0.5) / 0.28209479177387814).astype(np.float32)[:, None, None].repeat(3, axis=2),
    )


def project(folder: Path) -> Path:
    """transforms.json in a world with Z up, and the pictures that its cameras took of the board."""
    (folder / "images").mkdir(parents=True)
    frames = []
    for i, x in enumerate((-1.5, -0.5, 0.5, 1.5)):
        eye = (x, 0.6 - 0.3 * i, 2.5 + 0.2 * i)
        pose = look_at(eye, (0.2 * x, 0, 0))
        camera = Camera(world_from_camera=pose, width=160, height=120, fx=150, fy=150, cx=80, cy=60)
        origins, ways = rays(camera)
        at = origins - ways * (origins[..., 2] / ways[..., 2])[..., None]
        picture = np.round(255 * brightness(at[..., 0], at[..., 1])).astype(np.uint8)
        Image.fromarray(picture).convert("RGB").save(folder / f"images/{i}.png")
        frames.append({"file_path": f"images/{i}.png", "transform_matrix": (transforms.Z_UP @ pose).tolist()})
    lens = {"fl_x": 150, "fl_y": 150, "cx": 80, "cy": 60, "w": 160, "h": 120}
    data = {**lens, "applied_transform": transforms.Z_UP[:3].tolist(), "frames": frames}
    path = folder / "transforms.json"
    path.write_text(json.dumps(data), "utf-8")
    return path


def test_pictures_tell_the_world(tmp_path: Path) -> None:
    file = open_file(project(tmp_path / "data"))
    cameras = file.read()
    pictures, cloud = find_all(file, cameras), board()
    m = file.to_world(cameras, "nerfstudio", None)
    moved = splats.transform(cloud, m)
    right, wrong = alike(cameras, pictures, cloud), alike(cameras, pictures, moved)
    assert right is not None and wrong is not None and right > 0.95 and wrong < 0.3
    for splats_there, world in ((cloud, "capture"), (moved, "nerfstudio")):
        found, _ = own_cameras.find(tmp_path / "splat.ply", splats_there, file.path)
        assert found is not None and found.world == world
        told = alike(found.cameras, pictures, splats_there)
        assert told is not None and told > 0.95
    assert alike(cameras, (None,) * 4, cloud) is None


def test_splats_that_an_editor_turned_have_other_cameras(tmp_path: Path) -> None:
    """Points and pictures both say so; the cameras would look past them."""
    path = project(tmp_path / "data")
    cloud = board()
    points = cloud.means[::40] @ transforms.Z_UP[:3, :3].T
    (path.parent / "sparse_pc.ply").write_bytes(trimesh.PointCloud(points).export(file_type="ply"))
    found, _ = own_cameras.find(tmp_path / "splat.ply", cloud, path)
    assert found is not None and found.world == "capture"
    turned = splats.transform(cloud, np.diag([2.0, 2.0, 2.0, 1.0]) @ transforms.Z_UP)
    with pytest.raises(InputError, match="neither its points nor its pictures lie where these splats are; give those"):
        own_cameras.find(tmp_path / "splat.ply", turned, path)
    found, misfit = own_cameras.find(path.parent / "splat.ply", turned)
    assert found is None and misfit is not None and "neither its points" in str(misfit)


def test_a_training_of_nerfstudio_says_its_world(tmp_path: Path) -> None:
    """Without points and pictures, too; where it moved the world by other rules, the file that has them is needed."""
    path = project(tmp_path / "data/hall")
    shutil.rmtree(path.parent / "images")
    training = tmp_path / "outputs/hall/splatfacto/now"
    shutil.copytree(DATA / "nerfstudio_models", training / "nerfstudio_models")
    (training / "config.yml").write_text("data: !!python/object/apply:pathlib.PosixPath\n- data\n- hall\n", "utf-8")
    capture = training / "nerfstudio_models/step-000029999.ckpt"
    cloud = splats.read(capture)
    found, misfit = own_cameras.find(capture, cloud)
    assert found is not None and misfit is None and found.world == "nerfstudio" and found.path == path
    file = open_file(path)
    by_default = file.to_world(file.read(), "nerfstudio", None)
    said = training / "dataparser_transforms.json"
    scale = float(np.cbrt(np.linalg.det(by_default[:3, :3])))
    rows = np.diag([1 / scale, 1 / scale, 1 / scale, 1]) @ by_default
    said.write_text(json.dumps({"transform": rows[:3].tolist(), "scale": scale}), "utf-8")
    found, _ = own_cameras.find(capture, cloud)
    assert found is not None and found.world == "nerfstudio"
    said.write_text(json.dumps({"transform": rows[:3].tolist(), "scale": 2 * scale}), "utf-8")
    found, misfit = own_cameras.find(capture, cloud)
    assert found is None and misfit is not None and "beside it" in str(misfit)
    with pytest.raises(InputError, match="by other rules than its defaults: copy"):
        own_cameras.find(capture, cloud, path)
    rendered = {"camera_to_world": np.eye(4).reshape(-1).tolist(), "fov": 50}
    drawn = {"camera_type": "perspective", "render_width": 64, "render_height": 48, "camera_path": [rendered]}
    (tmp_path / "camera_path.json").write_text(json.dumps(drawn), "utf-8")
    found, _ = own_cameras.find(capture, cloud, tmp_path / "camera_path.json")
    assert found is not None and found.world == "nerfstudio"
    np.testing.assert_array_equal(found.cameras[0].world_from_camera, np.eye(4))
    shutil.copy(said, path.parent)
    found, _ = own_cameras.find(capture, cloud)
    assert found is not None
    np.testing.assert_allclose(
        found.cameras[0].world_from_camera[:3, 3], 2 * (by_default @ file.read()[0].world_from_camera)[:3, 3], rtol=1e-6
    )
