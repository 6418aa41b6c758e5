"""Pictures beside a capture's cameras: found where their file says, and seen as pinholes see them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from mirelight.base.colour import srgb_decode
from mirelight.base.errors import InputError
from mirelight.io.cameras import Distortion, FileCamera, Intrinsics, inria, open_file
from mirelight.io.cameras.pictures import MOST_PIXELS, Picture, find, view_size
from mirelight.model import F64

LENS = Intrinsics(width=60, height=40, fx=50, fy=50, cx=30, cy=20)
EYE = {"transform_matrix": np.eye(4).tolist(), "fl_x": 50, "w": 60, "h": 40}


def save(path: Path, values: F64) -> Path:
    """An 8-bit picture of display values (H, W, C)."""
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.round(255 * values).astype(np.uint8)).save(path)
    return path


def gray(shape: tuple[int, int] = (40, 60), value: float = 0.5) -> F64:
    return np.full((*shape, 3), value)


def cameras(folder: Path, **more: str) -> tuple[Path, FileCamera]:
    """A transforms.json with one camera."""
    path = folder / "transforms.json"
    path.write_text(json.dumps({"frames": [EYE | more]}), encoding="utf-8")
    return path, open_file(path).read()[0]


@pytest.mark.parametrize("named", ["images/a.png", "./images/a"])
def test_a_picture_lies_where_the_file_says(tmp_path: Path, named: str) -> None:
    saved = save(tmp_path / "images/a.png", gray())
    file, camera = cameras(tmp_path, file_path=named)
    found = find(open_file(file), camera)
    assert found is not None and found.path == saved and found.lens == LENS
    picture = found.read()
    assert picture.shape == (40, 60, 4)
    np.testing.assert_allclose(
        picture, np.append(srgb_decode(np.full(3, 128 / 255)), 1) * np.ones((40, 60, 1)), rtol=1e-5
    )


@pytest.mark.parametrize("named", ["images/b.png", "../a.png", "/etc/passwd", "images", ""])
def test_no_picture(tmp_path: Path, named: str) -> None:
    """None there; one outside of the folder is not looked for."""
    save(tmp_path / "a.png", gray())
    (tmp_path / "in/images").mkdir(parents=True)
    file, camera = cameras(tmp_path / "in", file_path=named)
    assert find(open_file(file), camera) is None


def test_another_folder(tmp_path: Path) -> None:
    saved = save(tmp_path / "developed/a.png", gray())
    file, camera = cameras(tmp_path, file_path="images/a.jpg")
    assert find(open_file(file), camera, tmp_path / "developed") is None  # a.jpg
    file, camera = cameras(tmp_path, file_path="images/a.png")
    found = find(open_file(file), camera, tmp_path / "developed")
    assert found is not None and found.path == saved


def test_pictures_of_colmap_lie_in_images(tmp_path: Path) -> None:
    model = tmp_path / "sparse/0"
    model.mkdir(parents=True)
    (model / "cameras.txt").write_text("1 PINHOLE 60 40 50 50 30 20\n", encoding="utf-8")
    (model / "images.txt").write_text("1 1 0 0 0 0 0 0 1 left/a.png\n\n", encoding="utf-8")
    saved = save(tmp_path / "images/left/a.png", gray())
    file = open_file(tmp_path)
    found = find(file, file.read()[0])
    assert found is not None and found.path == saved


def test_what_does_not_count(tmp_path: Path) -> None:
    """A transparent half, a masked quarter."""
    picture = np.concatenate([gray(), np.ones((40, 60, 1))], axis=2)
    picture[:, :30, 3] = 0
    save(tmp_path / "a.png", picture)
    mask = np.ones((20, 30, 3))  # of another size
    mask[:10, 15:] = 0
    save(tmp_path / "mask.png", mask)
    file, camera = cameras(tmp_path, file_path="a.png", mask_path="mask.png")
    found = find(open_file(file), camera)
    assert found is not None and len(found.files) == 2
    counts = found.read()[..., 3]
    expected = np.zeros((40, 60))
    expected[20:, 30:] = 1
    np.testing.assert_array_equal(counts, expected)


def test_a_larger_picture_is_averaged_in_linear_light(tmp_path: Path) -> None:
    """Black and white lines, finer than pixels, are half of the light."""
    lines = np.zeros((800, 1200, 3))
    lines[::2] = 1
    lens = Intrinsics(width=1200, height=800, fx=1000, fy=1000, cx=600, cy=400)
    size = view_size(1200, 800)
    assert size[0] * size[1] <= 1.01 * MOST_PIXELS
    picture = Picture(save(tmp_path / "a.png", lines), None, lens, None).read()
    assert picture.shape == (size[1], size[0], 4)
    assert abs(picture[..., :3].mean() - 0.5) < 0.01
    half = Picture(tmp_path / "a.png", None, LENS, None).read()  # scaled down since its camera was written
    np.testing.assert_allclose(half[..., :3], 0.5, atol=1e-6)


def test_a_lens_distortion_is_undone(tmp_path: Path) -> None:
    """The picture of a ramp over the pinhole's plane, made by turning the lens' formula round by bisection."""
    bend = Distortion(model="RADIAL", radial=(-0.2,))
    v, u = np.mgrid[0:40, 0:60] + 0.5
    bent = np.hypot((u - 30) / 50, (v - 20) / 50)
    low, high = np.zeros_like(bent), np.full_like(bent, 1.0)
    for _ in range(40):
        middle = (low + high) / 2
        below = middle * (1 - 0.2 * middle**2) < bent
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    x = (u - 30) / 50 * low / np.maximum(bent, 1e-9)
    save(tmp_path / "a.png", np.repeat((0.5 + 0.5 * x)[..., None], 3, axis=2))
    seen = Picture(tmp_path / "a.png", None, LENS, bend).read()
    wanted = srgb_decode(0.5 + 0.5 * (np.arange(60) + 0.5 - 30) / 50)
    np.testing.assert_allclose(seen[2:-2, 2:-2, 0], np.tile(wanted[2:-2], (36, 1)), atol=0.01)
    straight = Picture(tmp_path / "a.png", None, LENS, None).read()
    assert np.abs(straight[2:-2, 2:-2, 0] - wanted[2:-2]).max() > 0.03


def test_a_picture_of_another_shape(tmp_path: Path) -> None:
    save(tmp_path / "a.png", gray((60, 40)))
    with pytest.raises(InputError, match="40 x 60 pixels where its camera has 60 x 40"):
        Picture(tmp_path / "a.png", None, LENS, None).read()


def test_a_lens_without_a_size_takes_the_pictures(tmp_path: Path) -> None:
    save(tmp_path / "a.png", gray((30, 30)))
    path = tmp_path / "transforms.json"
    frame = {"transform_matrix": np.eye(4).tolist(), "file_path": "a"}
    path.write_text(json.dumps({"camera_angle_x": 0.7, "frames": [frame]}), encoding="utf-8")
    file = open_file(path)
    found = find(file, file.read()[0])
    assert found is not None and found.lens.size == (30, 30)


def trained(folder: Path, source: str, images: str = "images") -> Path:
    """A cameras.json of a training and the arguments of it, as INRIA's train.py leaves them."""
    camera = {"img_name": "a", "width": 60, "height": 40, "fx": 50, "fy": 50, "position": [0, 0, 0]}
    folder.mkdir()
    (folder / "cfg_args").write_text(f"Namespace(eval=True, images={images!r}, sh_degree=3, source_path={source!r})")
    path = folder / "cameras.json"
    path.write_text(json.dumps([camera | {"rotation": np.eye(3).tolist()}]), encoding="utf-8")
    return path


@pytest.mark.parametrize("images", ["images", "images_4"])
def test_pictures_lie_where_training_read_them(tmp_path: Path, images: str) -> None:
    saved = save(tmp_path / f"data/{images}/a.png", gray())
    for name, source in (("told", str(tmp_path / "data")), ("near", "../data")):
        file = open_file(trained(tmp_path / name, source, images))
        found = find(file, file.read()[0])
        assert found is not None and found.path.resolve() == saved


@pytest.mark.parametrize("source", ["//host/share", "\\\\host\\share", "/gone", "a\0b"])
def test_pictures_that_training_read_elsewhere(tmp_path: Path, source: str) -> None:
    """On a machine that this one would have to sign in to, or that is another one: there are none."""
    file = open_file(trained(tmp_path / "out", source))
    assert find(file, file.read()[0]) is None


@pytest.mark.parametrize("name", ["//host/share", "\\\\host\\share", "\\/host/share"])
@pytest.mark.parametrize("images", [False, True])
def test_another_machine_is_not_looked_at(
    tmp_path: Path, name: str, images: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = trained(tmp_path / "out", "..", name) if images else trained(tmp_path / "out", name)
    looked = list[Path]()
    monkeypatch.setattr(Path, "is_dir", looked.append)
    assert inria.trained_on(path) == () and not looked


@pytest.mark.parametrize("text", ["", "Namespace(", "Namespace(source_path=open('x'))", "(" * 5000, "f()", "\xff"])
def test_arguments_that_are_none(tmp_path: Path, text: str) -> None:
    path = trained(tmp_path / "out", "..")
    (tmp_path / "out/cfg_args").write_text(text, "latin-1")
    file = open_file(path)
    assert find(file, file.read()[0]) is None
