"""The camera in a PLY file of splats that were made of one picture, as SHARP writes it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mirelight.apps.first_job import own_cameras
from mirelight.base.errors import InputError
from mirelight.io import splats
from mirelight.io.cameras import open_file
from mirelight.model import SplatCloud

from .views import POINTS, View, pixels_of, views


def cloud() -> SplatCloud:
    n = 8
    return SplatCloud(
        means=np.random.default_rng(0).normal(size=(n, 3)).astype(np.float32),
        quats=np.tile(np.array([1, 0, 0, 0], np.float32), (n, 1)),
        scales=np.full((n, 3), 0.1, np.float32),
        opacities=np.full(n, 0.9, np.float32),
        sh=np.zeros((n, 1, 3), np.float32),
    )


def written(path: Path, view: View, **other: Any) -> Path:
    """Splats and the elements that SHARP adds; `other` elements replace the view's."""
    splats.write(cloud(), path)
    head, _, rows = path.read_bytes().partition(b"end_header\n")
    extrinsic = np.eye(4)
    extrinsic[:3, :3], extrinsic[:3, 3] = view.r, view.t
    elements = {
        "extrinsic": ("float", "<f4", extrinsic),
        "intrinsic": ("float", "<f4", [view.fx, 0, view.cx, 0, view.fy, view.cy, 0, 0, 1]),
        "image_size": ("uint", "<u4", [view.width, view.height]),
        "frame": ("int", "<i4", [1, len(cloud())]),
        "disparity": ("float", "<f4", [0.1, 0.9]),
        "color_space": ("uchar", "u1", [1]),
        "version": ("uchar", "u1", [1, 5, 0]),
    }
    for name, (word, kind, values) in elements.items():
        numbers = np.asarray(other.get(name, values)).astype(kind).ravel()
        head += f"element {name} {len(numbers)}\nproperty {word} {name}\n".encode()
        rows += numbers.tobytes()
    path.write_bytes(head + b"end_header\n" + rows)
    return path


def test_it_shows_points_where_the_picture_did_and_the_splats_are_read_as_ever(tmp_path: Path) -> None:
    (view,) = views(1)
    path = written(tmp_path / "photo.ply", view)
    file = open_file(path)
    assert file.kind == "SHARP" and file.files == (path,)
    (camera,) = file.read()
    assert camera.size((1, 1)) == (view.width, view.height)
    shown = pixels_of(camera.to_camera((view.width, view.height)), POINTS)
    np.testing.assert_allclose(shown, view.pixels(), atol=1e-3)  # the file's numbers are of single precision
    np.testing.assert_array_equal(splats.read(path).means, cloud().means)


def test_a_first_job_takes_it_before_what_lies_beside(tmp_path: Path) -> None:
    (view,) = views(1)
    path = written(tmp_path / "photo.ply", view)
    (tmp_path / "cameras.json").write_text("[]")
    found, misfit = own_cameras.find(path, splats.read(path))
    assert found is not None and misfit is None
    assert found.path == path and len(found.cameras) == 1


@pytest.mark.parametrize(
    ("other", "said"),
    [
        ({"image_size": [0, 48]}, "image_size: 0 x 48 pixels"),
        ({"intrinsic": [0, 0, 1, 0, 0, 1, 0, 0, 1]}, "intrinsic: a focal length of 0 by 0 pixels"),
        ({"extrinsic": np.diag([1, 1, -1, 1])}, "extrinsic: a mirrored matrix"),
        ({"extrinsic": np.full(16, np.nan)}, "extrinsic: a position beyond all scenes"),
        ({"intrinsic": [1, 2, 3, 4]}, "splats without a camera in their file"),
    ],
)
def test_what_is_no_camera_is_a_line(tmp_path: Path, other: dict[str, Any], said: str) -> None:
    path = written(tmp_path / "photo.ply", views(1)[0], **other)
    with pytest.raises(InputError, match=said) as caught:
        open_file(path).read()
    assert "\n" not in str(caught.value)


def test_other_splats_hold_none(tmp_path: Path) -> None:
    path = tmp_path / "capture.ply"
    splats.write(cloud(), path)
    assert own_cameras.find(path, splats.read(path)) == (None, None)
    with pytest.raises(InputError, match="splats without a camera in their file"):
        open_file(path).read()
