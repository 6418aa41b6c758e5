"""`mirelight estimate` as a real process: what it refuses, in one line each."""

from __future__ import annotations

import shutil
from pathlib import Path

from mirelight.io import splats

from .conftest import JOB, Run
from .test_proxy import ball


def test_bad_input_is_one_line_and_writes_nothing(run: Run, tmp_path: Path) -> None:
    splats.write(ball(60), tmp_path / "ball.ply")
    job = 'splats = "ball.ply"\ncameras = [{ position = [0, 0, 5], target = [0, 0, 0] }]\n'
    (tmp_path / "bare.toml").write_text(job)
    for arguments, said in (
        (("bare.toml", "-o", "light.toml"), "proxy: no proxy"),
        (("bare.toml", "-o", "light.exr"), "written as .toml, .glb or .gltf"),
        (("bare.toml", "-o", "nowhere/light.toml"), "the folder does not exist"),
        (("none.toml", "-o", "light.toml"), "none.toml"),
    ):
        done = run("estimate", *arguments)
        assert done.returncode == 2
        assert said in done.stderr
        assert done.stderr.count("\n") == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == ["ball.ply", "bare.toml"]


def test_what_is_read_is_not_written_over(run: Run, assets: Path, tmp_path: Path) -> None:
    shutil.copytree(assets, tmp_path, dirs_exist_ok=True)
    (tmp_path / "job.toml").write_text(JOB)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    for arguments in (
        ("estimate", "job.toml", "-o", "job.toml"),
        ("estimate", "job.toml", "-o", "proxy.glb"),
        ("bake", "job.toml", "-o", "splats.ply"),
        ("proxy", "splats.ply", "--fit", "proxy.glb", "-o", "proxy.glb"),
    ):
        done = run(*arguments)
        assert done.returncode == 2
        assert "would be written over; give another name" in done.stderr
        assert done.stderr.count("\n") == 1
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
