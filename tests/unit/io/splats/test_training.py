"""Folders that trainings leave: their last splats are the capture."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mirelight.base.errors import InputError
from mirelight.io import splats
from mirelight.io.splats.training import folder_of, resolved
from mirelight.model import SplatCloud


def cloud(count: int) -> SplatCloud:
    return SplatCloud(
        means=np.zeros((count, 3), np.float32),
        quats=np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1)),
        scales=np.ones((count, 3), np.float32),
        opacities=np.ones(count, np.float32),
        sh=np.zeros((count, 1, 3), np.float32),
    )


@pytest.mark.parametrize(
    "layout", ["point_cloud/iteration_{}/point_cloud.ply", "ply/point_cloud_{}.ply"], ids=["inria", "gsplat"]
)
def test_the_last_iteration_is_read(tmp_path: Path, layout: str) -> None:
    """By number, not by name: 7000 comes before 30000."""
    for count, iteration in ((1, 7000), (2, 30_000), (3, 999)):
        path = tmp_path / layout.format(iteration)
        path.parent.mkdir(parents=True, exist_ok=True)
        splats.write(cloud(count), path)
    assert resolved(tmp_path) == tmp_path / layout.format(30_000)
    assert len(splats.read(tmp_path)) == splats.summary(tmp_path).count == 2


def test_a_file_and_another_folder_are_what_they_are(tmp_path: Path) -> None:
    path = tmp_path / "point_cloud.ply"
    splats.write(cloud(1), path)
    assert resolved(path) == path and resolved(tmp_path) == tmp_path
    with pytest.raises(InputError, match="no SOG"):
        splats.read(tmp_path)


def test_the_folder_of_a_capture(tmp_path: Path) -> None:
    inside = tmp_path / "point_cloud/iteration_30000/point_cloud.ply"
    assert folder_of(inside) == tmp_path
    assert folder_of(tmp_path / "ply/point_cloud_29999.ply") is None
    assert folder_of(Path("point_cloud.ply")) is None
