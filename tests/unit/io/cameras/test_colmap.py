"""COLMAP's models against pycolmap: what it writes is read alike, what is written here it reads alike."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pycolmap
import pytest

from mirelight.base.errors import InputError
from mirelight.io.cameras import colmap, colmap_write, open_file
from mirelight.io.cameras.colmap import MODELS
from mirelight.model import Camera

from .views import POINTS, colmap_text, pixels_of, views


def oracle(folder: Path) -> dict[str, np.ndarray]:
    """Where pycolmap shows the points, by the images' names."""
    model = pycolmap.Reconstruction(str(folder))
    out = {}
    for image in model.images.values():
        local = image.cam_from_world() * POINTS
        out[image.name] = np.array([image.camera.img_from_cam(point) for point in local])
    return out


@pytest.mark.parametrize("suffix", [".txt", ".bin"])
def test_models_as_pycolmap_writes_them(tmp_path: Path, suffix: str) -> None:
    text = colmap_text(tmp_path / "text", views())
    folder = tmp_path / "again"
    folder.mkdir()
    model = pycolmap.Reconstruction(str(text))
    (model.write_text if suffix == ".txt" else model.write_binary)(str(folder))
    assert (folder / f"rigs{suffix}").is_file()  # a model of today's COLMAP
    file = open_file(folder)
    assert [f.suffix for f in file.files] == [suffix, suffix]
    truth = oracle(folder)
    found = file.read()
    assert sorted(truth) == [f"{c.name}.png" for c in found]
    for camera in found:
        shown = pixels_of(camera.to_camera(camera.size((1, 1))))
        np.testing.assert_allclose(shown, truth[f"{camera.name}.png"], rtol=0, atol=1e-6)


@pytest.mark.parametrize("suffix", [".txt", ".bin"])
def test_pycolmap_reads_what_is_written_here(tmp_path: Path, suffix: str) -> None:
    colmap_text(tmp_path / "from", views())
    cameras = [c.to_camera(c.size((1, 1))) for c in open_file(tmp_path / "from").read()]
    folder = tmp_path / "to"
    folder.mkdir()
    positions = np.random.default_rng(1).normal(size=(7, 3))
    colors = np.arange(21, dtype=np.uint8).reshape(7, 3)
    colmap_write.write(folder, cameras, [f"{c.name}.png" for c in cameras], colmap_write.Points(positions, colors))
    for file in folder.glob("*.txt" if suffix == ".bin" else "*.bin"):
        file.unlink()
    truth = oracle(folder)
    for camera in cameras:
        np.testing.assert_allclose(pixels_of(camera), truth[f"{camera.name}.png"], rtol=0, atol=1e-6)
    points = pycolmap.Reconstruction(str(folder)).points3D
    read = colmap.read_points(folder / f"points3D{suffix}")
    by_id = [points[i] for i in sorted(points)]
    np.testing.assert_allclose(read.positions, [x.xyz for x in by_id], rtol=1e-12)
    np.testing.assert_allclose(read.errors, [x.error for x in by_id])
    assert read.pictures.tolist() == [x.track.length() for x in by_id]
    order = sorted(points)
    np.testing.assert_array_equal([points[i].xyz for i in order], positions)
    np.testing.assert_array_equal([points[i].color for i in order], colors)
    for camera, again in zip(cameras, open_file(folder).read(), strict=True):
        np.testing.assert_allclose(again.world_from_camera, camera.world_from_camera, atol=1e-14)


def test_both_files_say_the_same(tmp_path: Path) -> None:
    colmap_text(tmp_path, views())
    cameras = [c.to_camera((640, 480)) for c in open_file(tmp_path).read()]
    colmap_write.write(tmp_path, cameras, [f"{c.name}.png" for c in cameras])
    binary = open_file(tmp_path).read()
    assert open_file(tmp_path).files[0].suffix == ".bin"
    for file in tmp_path.glob("*.bin"):
        file.unlink()
    for a, b in zip(binary, open_file(tmp_path).read(), strict=True):
        np.testing.assert_array_equal(a.world_from_camera, b.world_from_camera)
        assert a.lens == b.lens


def test_equal_lenses_share_a_camera(tmp_path: Path) -> None:
    cameras = [Camera.look_at((x, 1, 4), (0, 0, 0), 64, 48, name=f"a{x}") for x in range(4)]
    colmap_write.write(tmp_path, cameras, [f"{c.name}.png" for c in cameras])
    assert len(pycolmap.Reconstruction(str(tmp_path)).cameras) == 1


def test_an_orthographic_camera_has_no_place(tmp_path: Path) -> None:
    flat = Camera(
        world_from_camera=np.eye(4), width=8, height=8, fx=1, fy=1, cx=4, cy=4, projection="orthographic", name="top"
    )
    with pytest.raises(InputError, match="'top' is orthographic"):
        colmap_write.write(tmp_path, [flat], ["top.png"])


def test_the_table_of_models_is_colmap_s() -> None:
    known = {m.name: m.value for m in pycolmap.CameraModelId.__members__.values() if m.value >= 0}
    assert {model.name: number for number, model in enumerate(MODELS)} == known
    for number, model in enumerate(MODELS):
        camera = pycolmap.Camera.create_from_model_id(0, pycolmap.CameraModelId(number), 100.0, 64, 48)
        assert len(camera.params) == model.count


@pytest.mark.parametrize("name", ["SIMPLE_RADIAL", "RADIAL", "OPENCV", "FULL_OPENCV"])
def test_largest_shift_is_what_colmap_s_lens_does(tmp_path: Path, name: str) -> None:
    camera = pycolmap.Camera.create_from_model_id(1, pycolmap.CameraModelId.__members__[name], 500.0, 640, 480)
    focals = 1 if name in ("SIMPLE_RADIAL", "RADIAL") else 2
    rest = np.random.default_rng(2).uniform(-0.03, 0.03, len(camera.params) - focals - 2)
    camera.params = [*([500.0] * focals), 310.0, 245.0, *rest]
    values = " ".join(repr(float(x)) for x in camera.params)
    (tmp_path / "cameras.txt").write_text(f"1 {name} 640 480 {values}\n")
    (tmp_path / "images.txt").write_text("1 1 0 0 0 0 0 3 1 a.png\n\n")
    (found,) = open_file(tmp_path).read()
    assert found.distortion is not None and found.distortion.model == name
    u, v = np.meshgrid(np.linspace(0, 640, 33), np.linspace(0, 480, 33))
    pinhole = np.stack([u.ravel(), v.ravel()], axis=1)
    rays = np.column_stack([(pinhole - [310, 245]) / 500, np.ones(len(pinhole))])
    bent = np.array([camera.img_from_cam(ray) for ray in rays])
    assert found.shift() == pytest.approx(float(np.linalg.norm(bent - pinhole, axis=1).max()), abs=1e-9)
