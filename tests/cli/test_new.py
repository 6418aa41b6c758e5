"""First jobs as a command: nothing that is there is replaced, now or when they are rendered."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest

from mirelight import cli
from mirelight.base.conventions import look_at
from mirelight.io import job, splats
from mirelight.io.cameras import colmap_write, inria, open_file, worlds
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
    written = tomllib.loads(folder)
    assert written["output"]["directory"] == "out-folder"  # frames are kept apart from the training
    assert written["splats"]["path"] == capture.as_posix() and "out/cameras.json" in folder
    assert tomllib.loads(file)["splats"] == written["splats"] and "out/cameras.json" in file


def test_a_training_of_gsplat(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The project that its settings name is found, and that its splats were moved; cameras given by hand say the same,
    and the job has them where they look at the splats."""
    monkeypatch.chdir(tmp_path)
    capture, project = Path("results/hall/ply/point_cloud_29999.ply"), Path("data/hall/sparse/0")
    capture.parent.mkdir(parents=True)
    project.mkdir(parents=True)
    cloud = on_surface(*square(4, 0.1, 1, 0), 0.1, thin=0.02)
    rng = np.random.default_rng(2)
    shown = cloud.means[rng.permutation(len(cloud))[:400]] + (0.0, 0.0, 0.0)
    shown[:50, 1] += rng.uniform(0.2, 0.6, 50)  # a few things on it
    places = rng.uniform((-3, 2, -3), (3, 4, 3), (9, 3))
    cameras = [
        Camera(world_from_camera=look_at(x, (0, 1, 0)), width=320, height=240, fx=300, fy=300, cx=160, cy=120)
        for x in places
    ]
    names = [f"{i}.png" for i in range(len(cameras))]
    colmap_write.write(project, cameras, names, colmap_write.Points(shown, np.zeros((len(shown), 3))))
    file = open_file(project)
    m = worlds.of_gsplat(file.read(), shown.astype(np.float64), shown.astype(np.float64))
    splats.write(splats.transform(cloud, m), capture)
    Path("results/hall/cfg.yml").write_text("!!python/object:Config\nckpt: null\ndata_dir: data/hall\n", "utf-8")
    for given, name in ((["results/hall"], "folder"), ([str(capture), "--cameras", "data/hall"], "given")):
        assert cli.main(["new", *given, "-o", f"{name}.toml"]) == 0
        text = tomllib.loads(Path(f"{name}.toml").read_text("utf-8"))
        assert text["splats"]["world"] == "gsplat"
        loaded = job.load(Path(f"{name}.toml"))
        assert loaded.made_proxy is not None and len(loaded.made_proxy.cameras) == len(cameras)
        assert loaded.splat_files[0].path.name == capture.name
        world = loaded.splat_files[0].world_from_file @ m
        for one, other in zip(loaded.made_proxy.cameras, cameras, strict=True):
            np.testing.assert_allclose(one.position, (world @ [*other.position, 1])[:3], atol=1e-4)
    assert cli.main(["new", str(capture), "--cameras", "data", "-o", "bad.toml"]) == 2
