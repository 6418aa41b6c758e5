"""The worlds of trainers: by what their own pages say of them, and told by where splats lie."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from mirelight.base.errors import InputError
from mirelight.io.cameras import CameraFile, open_file, transforms, worlds
from mirelight.model import F64, SplatWorld

from .views import View, colmap_text, views, write_json

RNG = np.random.default_rng(11)
# A floor, a wall and a box: longest along one axis, more of it below, no axis that of the capture.
LYING = np.concatenate(
    [
        RNG.uniform((-5, -2, 0), (3, 2, 0.1), (600, 3)),
        RNG.uniform((-5, 1.9, 0), (3, 2, 1.5), (200, 3)),
        RNG.uniform((1, -1, 0), (2, 0, 1), (100, 3)),
    ]
)
TILT = Rotation.from_euler("xyz", [0.4, -0.7, 0.2]).as_matrix()
SHOWN = 0.4 * LYING @ TILT.T + (0.3, 0.1, -0.2)


def moved(points: F64, m: F64) -> F64:
    return np.asarray(points @ m[:3, :3].T + m[:3, 3])


def model(folder: Path, points: F64 = SHOWN) -> tuple[CameraFile, list[View]]:
    """A COLMAP model of eleven cameras with more up in common than not."""
    seen = []
    for view in views(11):
        near = Rotation.from_matrix(view.r).as_rotvec()
        r = Rotation.from_rotvec(0.3 * near).as_matrix() @ Rotation.from_euler("x", 200, degrees=True).as_matrix()
        seen.append(View(name=view.name, r=r, t=view.t))
    colmap_text(folder, seen)
    rows = [f"{i} {x!r} {y!r} {z!r} 0 0 0 0.5 1 1" for i, (x, y, z) in enumerate(points.tolist(), start=1)]
    (folder / "points3D.txt").write_text("# comment\n" + "\n".join(rows) + "\n", "utf-8")
    return open_file(folder), seen


def test_nerfstudio_s_is_upright_about_the_cameras(tmp_path: Path) -> None:
    """docs.nerf.studio: up is +Z on average, places are centred, and the farthest of their coordinates is 1."""
    file, seen = model(tmp_path)
    poses = np.stack([x.world_from_camera for x in file.read(world="nerfstudio")])
    up = poses[:, :3, 1].mean(axis=0)
    np.testing.assert_allclose(up / np.linalg.norm(up), (0, 0, 1), atol=1e-12)
    np.testing.assert_allclose(poses[:, :3, 3].mean(axis=0), 0, atol=1e-12)
    assert np.abs(poses[:, :3, 3]).max() == pytest.approx(1)
    there = [x.world_from_camera[:3, 3] for x in seen]
    m = file.to_world(file.read(), "nerfstudio", None)
    between = np.cbrt(np.linalg.det(m[:3, :3])) * np.linalg.norm(there[0] - there[1])
    assert np.linalg.norm(poses[0, :3, 3] - poses[1, :3, 3]) == pytest.approx(between)


def test_nerfstudio_s_of_its_own_file_is_that_of_its_training(tmp_path: Path) -> None:
    """transforms.json in turned axes, as ns-process-data turns them: the world of the model that it was made of;
    and what a training wrote of it comes first."""
    colmap, seen = model(tmp_path / "sparse")
    turned = worlds.COLMAP_TO_NERFSTUDIO
    frames = [{"file_path": f"{x.name}.png", "transform_matrix": (turned @ x.opengl).tolist()} for x in seen]
    data = {"applied_transform": turned[:3].tolist(), "camera_angle_x": 0.9, "w": 64, "h": 48, "frames": frames}
    path = write_json(tmp_path / "transforms.json", data)
    ours = open_file(path).read(world="nerfstudio")
    for one, other in zip(ours, colmap.read(world="nerfstudio"), strict=True):
        np.testing.assert_allclose(one.world_from_camera, other.world_from_camera, atol=1e-12)
    write_json(tmp_path / "dataparser_transforms.json", {"transform": np.eye(4)[:3].tolist(), "scale": 0.5})
    halved = open_file(path).read(world="nerfstudio")[0].world_from_camera
    np.testing.assert_allclose(halved[:3, 3], 0.5 * seen[0].world_from_camera[:3, 3], atol=1e-12)


@pytest.mark.parametrize("signs", [(1, 1, 1), (-1, -1, 1), (1, -1, -1), (-1, 1, -1)])
def test_gsplat_s_lies_along_the_points(tmp_path: Path, signs: tuple[int, int, int]) -> None:
    """Medians of the points are 0, their axes are the world's, the longest first, and half of the cameras stand nearer
    than 1 to what they look at. Splats tell the signs."""
    file, _ = model(tmp_path)
    some = worlds.of_gsplat(file.read(), SHOWN, moved(SHOWN, np.eye(4)))
    lying = np.diag([*signs, 1.0]) @ some
    m = file.to_world(file.read(), "gsplat", lambda: moved(SHOWN, lying))
    np.testing.assert_allclose(m, lying, atol=1e-12)
    there = moved(SHOWN, m)
    spread = np.cov(there, rowvar=False)
    np.testing.assert_allclose(spread - np.diag(np.diag(spread)), 0, atol=1e-12)
    assert np.diag(spread).tolist() == sorted(np.diag(spread), reverse=True)
    # the median of points is taken before the axes are turned to: it is the origin there, not along each axis
    turn = m[:3, :3] / np.cbrt(np.linalg.det(m[:3, :3]))
    poses = np.stack([x.world_from_camera for x in file.read(world="gsplat", centres=lambda: there)])
    np.testing.assert_allclose(poses[0, :3, :3], turn @ file.read()[0].world_from_camera[:3, :3], atol=1e-12)
    looked = poses[:, :3, 3] - np.linalg.lstsq(*_rays(poses), rcond=None)[0]
    assert 0.5 < np.median(np.linalg.norm(looked, axis=1)) < 2


def _rays(poses: F64) -> tuple[F64, F64]:
    """What the point nearest to all views' middles solves."""
    across = np.eye(3) - np.einsum("ni,nj->nij", poses[:, :3, 2], poses[:, :3, 2])
    return across.reshape(-1, 3), np.einsum("nij,nj->ni", across, poses[:, :3, 3]).reshape(-1)


@pytest.mark.parametrize("world", ["capture", "nerfstudio", "gsplat"])
def test_where_points_lie_tells_the_world(tmp_path: Path, world: SplatWorld) -> None:
    file, _ = model(tmp_path)
    cameras = file.read()
    m = file.to_world(cameras, world, lambda: SHOWN)
    noise = 0.01 * np.cbrt(np.linalg.det(m[:3, :3]))
    splats = moved(np.repeat(SHOWN, 3, axis=0), m) + noise * RNG.standard_normal((3 * len(SHOWN), 3))
    assert file.world_of(cameras, splats) == world
    assert file.world_of(cameras, moved(splats, np.diag([3.0, 3.0, 3.0, 1.0]))) is None  # by other rules


def test_points_of_nerfstudio_s_file_tell_it_too(tmp_path: Path) -> None:
    _, seen = model(tmp_path / "sparse")
    turned = transforms.Z_UP
    frames = [{"file_path": f"{x.name}.png", "transform_matrix": (turned @ x.opengl).tolist()} for x in seen]
    data = {"applied_transform": turned[:3].tolist(), "camera_angle_x": 0.9, "w": 64, "h": 48, "frames": frames}
    file = open_file(write_json(tmp_path / "transforms.json", data))
    assert file.points() is None and file.world_of(file.read(), SHOWN) is None
    (tmp_path / "sparse_pc.ply").write_bytes(trimesh.PointCloud(moved(SHOWN, turned)).export(file_type="ply"))
    found = file.points()
    assert found is not None
    np.testing.assert_allclose(found, SHOWN, atol=1e-6)
    trained = moved(SHOWN, file.to_world(file.read(), "nerfstudio", None))
    assert file.world_of(file.read(), trained) == "nerfstudio"
    assert file.world_of(file.read(), SHOWN) == "capture"


def test_gsplat_s_needs_points(tmp_path: Path) -> None:
    file, _ = model(tmp_path)
    (tmp_path / "points3D.txt").unlink()
    with pytest.raises(InputError, match="no points3D beside it, by which gsplat moved its world"):
        file.read(world="gsplat", centres=lambda: SHOWN)
    (tmp_path / "points3D.txt").write_text("1 0 0\n", "utf-8")
    with pytest.raises(InputError, match="line 1: 3 words"):
        file.points()
