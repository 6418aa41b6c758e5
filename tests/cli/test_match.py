"""`mirelight match` as a real process."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from mirelight.io import job

from .conftest import Run


def test_a_lamp_is_found_and_the_written_job_loads(run: Run, folder: Path) -> None:
    assert run("render", "job.toml", "--camera", "front", "--lighting", "night", "-q").returncode == 0
    given = ("match", "job.toml", "--camera", "front", "--lighting", "night", "--target", "out/front.night.exr")
    done = run(*given, "--set", "mix.lamp=0.3", "-o", "matched.toml")
    assert done.returncode == 0, done.stderr
    assert "matched.toml: night" in done.stdout and "lamp: (20, 20, 20), was (6, 6, 6)" in done.stdout
    night = next(x for x in job.load(folder / "matched.toml").lightings if x.name == "night")
    (lamp,) = night.lights
    np.testing.assert_allclose(lamp.color * lamp.intensity, 20, rtol=0.01)
    assert not night.factors()


def test_what_is_wrong_is_said_in_a_line(run: Run, folder: Path) -> None:
    (folder / "text.png").write_text("no picture", encoding="utf-8")
    cases = {
        ("--target", "missing.png", "-o", "a.toml"): "missing.png",
        ("--target", "text.png", "-o", "a.toml"): "cannot be decoded",
        ("--target", "text.png", "-o", "a.json"): "written as .toml",
        ("--target", "text.png", "-o", "none/a.toml"): "the folder does not exist",
        ("--target", "text.png", "-o", "job.toml"): "the job itself",
        ("--target", "text.png", "-o", "a.toml", "--lighting", "dusk"): "no lighting named 'dusk'",
        ("--target", "text.png", "-o", "a.toml", "--set", "display.tone=agx"): "not turned back",
    }
    for arguments, said in cases.items():
        done = run("match", "job.toml", *arguments)
        assert done.returncode == 2 and said in done.stderr and len(done.stderr.splitlines()) == 1, done.stderr
    assert not (folder / "a.toml").exists()


def test_two_pictures_of_one_light_and_what_each_needs(run: Run, folder: Path) -> None:
    assert run("render", "job.toml", "--lighting", "night", "-q").returncode == 0
    pictures = ("--target", "out/front.night.exr", "--target", "out/orbit.0001.night.exr")
    cameras = ("--camera", "front", "--camera", "orbit.0001")
    given = ("match", "job.toml", "--lighting", "night", *pictures, *cameras)
    done = run(*given, "--set", "mix.lamp=0.3", "-o", "two.toml", "--json")
    assert done.returncode == 0, done.stderr
    (lamp,) = json.loads(done.stdout)["layers"]
    np.testing.assert_allclose((lamp["after"], lamp["before"]), ([20] * 3, [6] * 3), rtol=0.01)
    head = (folder / "two.toml").read_text(encoding="utf-8")
    assert "matched to front.night.exr, orbit.0001.night.exr" in head and "camera 'front', 'orbit.0001'" in head
    for wrong, said in {
        (): "--camera: 0 for 2 of --target",
        ("--camera", "front"): "--camera: 1 for 2 of --target",
        (*cameras, "--mask", "out/front.night.png"): "--mask: 1 for 2 of --target",
    }.items():
        done = run("match", "job.toml", "--lighting", "night", *pictures, *wrong, "-o", "a.toml")
        assert done.returncode == 2 and said in done.stderr and len(done.stderr.splitlines()) == 1, done.stderr
