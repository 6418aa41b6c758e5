"""Fisheyes and panoramas: seen through pinholes, where each format's own words say that a direction lies."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from mirelight.base.colour import srgb_decode
from mirelight.base.errors import InputError
from mirelight.io.cameras import FileCamera, Intrinsics, open_file
from mirelight.io.cameras.pictures import Picture, find
from mirelight.model import F64
from tests.unit.io.cameras.views import POINTS, View, views

WIDTH = 512  # px of a panorama
SIDES = ["front", "right", "back", "left", "up", "down"]


def colmap(folder: Path, lens: str, seen: list[View]) -> Path:
    """A COLMAP model of views with one lens, in text."""
    from scipy.spatial.transform import Rotation

    folder.mkdir(parents=True, exist_ok=True)
    (folder / "cameras.txt").write_text(f"1 {lens}\n")
    rows = []
    for i, view in enumerate(seen):
        x, y, z, w = Rotation.from_matrix(view.r).as_quat()
        rows.append(f"{i + 1} {w} {x} {y} {z} {view.t[0]} {view.t[1]} {view.t[2]} 1 {view.name}.png\n\n")
    (folder / "images.txt").write_text("".join(rows))
    return folder


def pinhole(camera: FileCamera) -> Intrinsics:
    assert isinstance(camera.lens, Intrinsics)
    return camera.lens


def shown_at(camera: FileCamera, points: F64) -> F64:
    """(N, 2) where in the file's picture a camera has points that its pinhole sees."""
    lens = pinhole(camera)
    local = (points - camera.world_from_camera[:3, 3]) @ camera.world_from_camera[:3, :3]
    u = lens.cx - lens.fx * local[:, 0] / local[:, 2]
    v = lens.cy + lens.fy * local[:, 1] / local[:, 2]
    assert camera.distortion is not None
    return np.stack(camera.distortion.at(lens, u, v), axis=1)


# --- fisheyes --------------------------------------------------------------------------------------------------------

FX, FY, CX, CY = 300.0, 310.0, 330.0, 250.0
K = (-0.04, 0.01, -0.002, 0.0005)
P = (0.001, -0.002)
S = (0.003, -0.001)


def bent_pixels(view: View, k: tuple[float, ...], fy: float, p: tuple[float, float], s: tuple[float, float]) -> F64:
    """(N, 2) as COLMAP's sensor/models.h has its fisheyes: by the angle to the axis, in OpenCV's axes."""
    x, y, z = (POINTS @ view.r.T + view.t).T
    theta, around = np.arctan2(np.hypot(x, y), z), np.arctan2(y, x)
    a, b = theta * np.cos(around), theta * np.sin(around)
    grown = theta * (1 + sum(c * theta ** (2 * i + 2) for i, c in enumerate(k)))
    dx = 2 * p[0] * a * b + p[1] * (theta**2 + 2 * a * a) + s[0] * theta**2
    dy = 2 * p[1] * a * b + p[0] * (theta**2 + 2 * b * b) + s[1] * theta**2
    return np.stack([FX * (grown * np.cos(around) + dx) + CX, fy * (grown * np.sin(around) + dy) + CY], axis=1)


NONE = (0.0, 0.0)


@pytest.mark.parametrize(
    ("lens", "k", "fy", "p", "s"),
    [
        (f"SIMPLE_FISHEYE 640 480 {FX} {CX} {CY}", (), FX, NONE, NONE),
        (f"FISHEYE 640 480 {FX} {FY} {CX} {CY}", (), FY, NONE, NONE),
        (f"SIMPLE_RADIAL_FISHEYE 640 480 {FX} {CX} {CY} {K[0]}", K[:1], FX, NONE, NONE),
        (f"RADIAL_FISHEYE 640 480 {FX} {CX} {CY} {K[0]} {K[1]}", K[:2], FX, NONE, NONE),
        (f"OPENCV_FISHEYE 640 480 {FX} {FY} {CX} {CY} {K[0]} {K[1]} {K[2]} {K[3]}", K, FY, NONE, NONE),
        (
            f"THIN_PRISM_FISHEYE 640 480 {FX} {FY} {CX} {CY} {K[0]} {K[1]} {P[0]} {P[1]} {K[2]} {K[3]} {S[0]} {S[1]}",
            K,
            FY,
            P,
            S,
        ),
    ],
)
def test_fisheyes_of_colmap(
    tmp_path: Path, lens: str, k: tuple[float, ...], fy: float, p: tuple[float, float], s: tuple[float, float]
) -> None:
    seen = views(3)
    found = open_file(colmap(tmp_path, lens, seen)).read()
    for camera, view in zip(found, seen, strict=True):
        np.testing.assert_allclose(shown_at(camera, POINTS), bent_pixels(view, k, fy, p, s), atol=1e-6)
        assert camera.shift() > 1


@pytest.mark.parametrize("said", [{"camera_model": "OPENCV_FISHEYE"}, {"is_fisheye": True}])
def test_fisheyes_of_transforms(tmp_path: Path, said: dict[str, Any]) -> None:
    """nerfstudio names the model, instant-ngp has a flag."""
    seen = views(3)
    lens = {"fl_x": FX, "fl_y": FY, "cx": CX, "cy": CY, "w": 640, "h": 480}
    lens |= {f"k{i + 1}": value for i, value in enumerate(K)}
    frames = [{"file_path": v.name, "transform_matrix": v.opengl.tolist()} for v in seen]
    path = tmp_path / "transforms.json"
    path.write_text(json.dumps({**lens, **said, "frames": frames}))
    for camera, view in zip(open_file(path).read(), seen, strict=True):
        np.testing.assert_allclose(shown_at(camera, POINTS), bent_pixels(view, K, FY, NONE, NONE), atol=1e-6)


def test_a_fisheye_shows_all_of_its_pinhole(tmp_path: Path) -> None:
    """Its pinhole has the same pixels and sees less, so nothing of it lies past the picture's rims: 180 degrees give
    115."""
    f = 640 / math.pi
    (camera,) = open_file(colmap(tmp_path, f"SIMPLE_FISHEYE 640 480 {f} 320 240", views(1))).read()
    Image.fromarray(np.full((480, 640, 3), 200, np.uint8)).save(tmp_path / "view_000.png")
    lens = pinhole(camera)
    picture = Picture(tmp_path / "view_000.png", None, lens, camera.distortion).read()
    assert picture[..., 3].min() == pytest.approx(1.0)
    assert 2 * math.degrees(math.atan(lens.width / 2 / lens.fx)) == pytest.approx(115.0, abs=0.1)


# --- panoramas -------------------------------------------------------------------------------------------------------


def panorama() -> F64:
    """(WIDTH / 2, WIDTH, 3) each direction's own colour in OpenCV's axes, display values, by COLMAP's formula."""
    v, u = np.mgrid[0 : WIDTH // 2, 0:WIDTH] + 0.5
    theta, phi = 2 * math.pi * (u / WIDTH - 0.5), math.pi * (0.5 - v / (WIDTH // 2))
    ray = np.stack([np.cos(phi) * np.sin(theta), -np.sin(phi), np.cos(phi) * np.cos(theta)], axis=-1)
    return np.asarray(0.5 + 0.4 * ray)


def rays_of(camera: FileCamera, shape: tuple[int, ...]) -> F64:
    """(H, W, 3) unit, in the world, of a picture's pixels."""
    lens = pinhole(camera)
    v, u = np.mgrid[0 : shape[0], 0 : shape[1]] + 0.5
    x, y = u / shape[1] * lens.width - lens.cx, lens.cy - v / shape[0] * lens.height
    local = np.stack([x / lens.fx, y / lens.fy, -np.ones_like(x)], axis=-1)
    local /= np.linalg.norm(local, axis=-1, keepdims=True)
    return np.asarray(local @ camera.world_from_camera[:3, :3].T)


@pytest.fixture
def taken(tmp_path: Path) -> list[View]:
    """Views, and a panorama in place of each one's picture."""
    seen = views(3)
    (tmp_path / "images").mkdir()
    for view in seen:
        Image.fromarray(np.round(255 * panorama()).astype(np.uint8)).save(tmp_path / "images" / f"{view.name}.png")
    return seen


@pytest.mark.parametrize("kind", ["COLMAP", "transforms.json"])
def test_a_panorama_is_six_pinholes(tmp_path: Path, taken: list[View], kind: str) -> None:
    """Each pixel of each side has the colour of its direction, and no direction is missing."""
    if kind == "COLMAP":
        colmap(tmp_path / "sparse/0", f"EQUIRECTANGULAR {WIDTH} {WIDTH // 2} {WIDTH} {WIDTH // 2}", taken)
    else:
        frames = [{"file_path": f"images/{v.name}.png", "transform_matrix": v.opengl.tolist()} for v in taken]
        size = {"w": WIDTH, "h": WIDTH // 2, "fl_x": WIDTH // 2, "fl_y": WIDTH // 2}
        text = json.dumps({"camera_model": "EQUIRECTANGULAR", **size, "frames": frames})
        (tmp_path / "transforms.json").write_text(text)
    file = open_file(tmp_path)
    found = file.read()
    assert [x.name for x in found] == [f"{v.name}_{side}" for side in SIDES for v in taken]
    looks = np.stack([-x.world_from_camera[:3, 2] for x in found])
    assert np.abs(looks[:: len(taken)].sum(axis=0)).max() < 1e-9  # of one panorama, to all sides
    for camera in found:
        view = next(v for v in taken if camera.name.startswith(v.name))
        np.testing.assert_allclose(camera.world_from_camera[:3, 3], view.world_from_camera[:3, 3], atol=1e-9)
        picture = find(file, camera)
        assert picture is not None
        shown = picture.read()
        wanted = srgb_decode(0.5 + 0.4 * rays_of(camera, shown.shape) @ view.r.T)
        np.testing.assert_allclose(shown[..., :3], wanted, atol=0.012)
        assert shown[..., 3].min() == 1
        assert camera.shift() == 0


def test_a_level_panorama_keeps_its_up(tmp_path: Path) -> None:
    """The sides that look up and down have ups across, which fall out of the mean of all."""
    level = View(name="a", r=np.eye(3), t=np.zeros(3))
    found = open_file(colmap(tmp_path, "EQUIRECTANGULAR 64 32 64 32", [level])).read()
    ups = np.stack([x.world_from_camera[:3, 1] for x in found])
    np.testing.assert_allclose(ups[:4], [[0, -1, 0]] * 4, atol=1e-12)
    np.testing.assert_allclose(ups[4] + ups[5], 0, atol=1e-12)


def test_a_panorama_of_another_size(tmp_path: Path, taken: list[View]) -> None:
    """Scaled since its camera was written: seen alike. Of another shape: refused."""
    file = open_file(
        colmap(tmp_path / "sparse/0", f"EQUIRECTANGULAR {2 * WIDTH} {WIDTH} {2 * WIDTH} {WIDTH}", taken[:1])
    )
    picture = find(file, file.read()[0])
    assert picture is not None
    shown = picture.read()
    wanted = srgb_decode(0.5 + 0.4 * rays_of(file.read()[0], shown.shape) @ taken[0].r.T)
    np.testing.assert_allclose(shown[..., :3], wanted, atol=0.012)
    Image.fromarray(np.zeros((100, 100, 3), np.uint8)).save(picture.path)
    with pytest.raises(InputError, match=f"100 x 100 pixels where its camera has {2 * WIDTH} x {WIDTH}"):
        picture.read()
