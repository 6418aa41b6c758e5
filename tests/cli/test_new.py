"""First jobs as a command: nothing that is there is replaced, now or when they are rendered."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import pytest

from mirelight import cli
from mirelight.base.conventions import look_at
from mirelight.io import splats
from mirelight.io.cameras import inria
from mirelight.model import Camera
from tests.proxy.clouds import on_surface, square


def test_each_job_of_a_folder_has_frames_in_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    splats.write(on_surface(*square(4, 0.1, 1, 0), 0.1, thin=0.02), "floor.ply")
    (tmp_path / "broken.toml").write_text("[output]\ndirectory = out\n", "utf-8")
    for name in ("first", "evening"):
        assert cli.main(["new", "floor.ply", "-o", f"{name}.toml"]) == 0
    first, evening = (
        tomllib.loads((tmp_path / f"{x}.toml").read_text("utf-8"))["output"]["directory"] for x in ("first", "evening")
    )
    assert (first, evening) == ("out", "out-evening")


def test_the_folder_of_a_training(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its last splats and its cameras are found, whether the folder or the file in it is given."""
    monkeypatch.chdir(tmp_path)
    capture = Path("out/point_cloud/iteration_30000/point_cloud.ply")
    capture.parent.mkdir(parents=True)
    splats.write(on_surface(*square(4, 0.1, 1, 0), 0.1, thin=0.02), capture)
    pose = look_at((1, 3, 2), (0, 0, 0))
    camera = Camera(world_from_camera=pose, width=320, height=240, fx=300, fy=300, cx=160, cy=120)
    entries = [inria.entry(camera, 0)]
    (tmp_path / "out/cameras.json").write_text(json.dumps(entries), "utf-8")
    for given, name in (("out", "folder"), (str(capture), "file")):
        assert cli.main(["new", given, "-o", f"{name}.toml"]) == 0
    folder, file = ((tmp_path / f"{x}.toml").read_text("utf-8") for x in ("folder", "file"))
    job = tomllib.loads(folder)
    assert job["output"]["directory"] == "out-folder"  # frames are kept apart from the training
    assert job["splats"]["path"] == capture.as_posix() and "out/cameras.json" in folder
    assert tomllib.loads(file)["splats"] == job["splats"] and "out/cameras.json" in file
