"""Pictures of a capture's cameras in a job: found, told apart by content, switched off, looked for elsewhere."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from PIL import Image

from mirelight.base.errors import InputError
from mirelight.io import job

from .conftest import Complaints, WriteJob

HEAD = 'splats = "splats.ply"\nproxy = { path = "proxy.glb", cameras = "transforms.json"'
UPRIGHT = [[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]]
FRAMES = [
    {"file_path": f"images/{k}.png", "transform_matrix": UPRIGHT, "fl_x": 50, "w": 60, "h": 40} for k in range(70)
]


def laid_out(folder: Path, gray: int = 128) -> None:
    """70 cameras, pictures of the first three."""
    (folder / "transforms.json").write_text(json.dumps({"frames": FRAMES}), encoding="utf-8")
    (folder / "images").mkdir(exist_ok=True)
    for k in range(3):
        Image.new("RGB", (60, 40), (gray, gray, gray)).save(folder / f"images/{k}.png")


def test_pictures_lie_beside_their_cameras(write_job: WriteJob, tmp_path: Path) -> None:
    laid_out(tmp_path)
    path = write_job(f"{HEAD} }}\n")
    found = job.load(path)
    pictures = found.capture_pictures
    assert len(pictures) == len(found.capture_cameras) == 70
    assert [k for k, one in enumerate(pictures) if one is not None] == [0, 2]  # of every second one, 64 at most
    assert pictures[0] is not None and pictures[0].value.shape == (40, 60, 4)
    assert "images" in found.inputs
    laid_out(tmp_path, 100)
    other = job.load(path).capture_pictures[0]
    assert other is not None and other.digest != pictures[0].digest


def test_switched_off_or_elsewhere(write_job: WriteJob, complaints: Complaints, tmp_path: Path) -> None:
    laid_out(tmp_path)
    assert job.load(write_job(f"{HEAD}, pictures = false }}\n")).capture_pictures == ()
    (tmp_path / "images").rename(tmp_path / "raw")
    assert job.load(write_job(f"{HEAD} }}\n")).capture_pictures == ()
    found = job.load(write_job(f'{HEAD}, pictures = "raw" }}\n'))
    assert sum(x is not None for x in found.capture_pictures) == 2
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="'empty', without a picture of these cameras"):
        job.load(write_job(f'{HEAD}, pictures = "empty" }}\n'))
    (line,) = complaints('splats = "splats.ply"\nproxy = { path = "proxy.glb", pictures = false }\n')
    assert "pictures of no cameras" in line
