"""`mirelight render` with `profile = "playcanvas"`: the engine's light, what it cannot follow said once, no noise."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mirelight.io.exr import read_exr

from .conftest import Run

ENGINE = ("render", "job.toml", "--set", "profile=playcanvas")
NEAR_LAMP = "[[lights]]\ntype = 'area'\nposition = [3, 0.5, 3]\ndirection = [0, -1, 0]\nsize = 0.2\nintensity = 900\n"


def test_light_model_layers_and_noise(run: Run, folder: Path) -> None:
    assert run(*ENGINE, "--camera", "front").returncode == 0
    night = read_exr(folder / "out" / "front.night.exr")
    names = set(night.channels)
    assert {"light_lamp_direct.R", "lighting.A", "position.X", "noise.R", "variance.R"} <= names
    for channel in ("noise.R", "variance.G", "light_lamp_indirect.B"):
        assert night.channels[channel].max() == 0
    assert set(np.unique(night.channels["lighting.A"])) == {0, 1}
    covered = night.channels["lighting.A"] == 1
    # a lamp of 20 cd at (1, 3, 1): albedo 0.5 / pi, cosine, and the engine's 1 / (d² + 1)
    way = np.stack([night.channels[f"position.{axis}"] for axis in "XYZ"], axis=-1)[covered] - np.array([1, 3, 1])
    d2 = (way**2).sum(axis=1)
    expected = 0.5 / np.pi * 20 * (-way[:, 1] / np.sqrt(d2)) / (d2 + 1)
    np.testing.assert_allclose(night.channels["lighting.R"][covered], expected, rtol=2e-3)
    day = read_exr(folder / "out" / "front.day.exr")
    np.testing.assert_allclose(day.channels["lighting.R"][covered], 0.5, rtol=1e-5)


def test_what_the_engine_cannot_follow_is_said_once(run: Run, folder: Path) -> None:
    (folder / "near.toml").write_text(
        "proxy = 'proxy.glb'\nprofile = 'playcanvas'\nresolution = [32, 24]\n" + NEAR_LAMP
    )
    cameras = "[[cameras]]\ntype = 'turntable'\ntarget = [0, 0, 0]\nradius = 6\nelevation = 3\nframes = 3\n"
    with (folder / "near.toml").open("a") as job:
        job.write(cameras)
    told = run("render", "near.toml")
    assert told.returncode == 0
    assert told.stderr.count("area lights become punctual ones") == 1
    assert told.stderr.count("of the inverse square law") == 1
    quiet = run("render", "near.toml", "--out", "again", "--quiet")
    assert (quiet.returncode, quiet.stderr) == (0, "")


def test_the_profiles_frames_are_not_taken_for_each_other(run: Run, folder: Path) -> None:
    chosen = ("--camera", "front", "--lighting", "night")
    assert run(*ENGINE, *chosen).stdout.startswith("1 frame in out; ")
    assert run(*ENGINE, *chosen).stdout.startswith("1 frame in out, 1 of them already there; ")
    assert run("render", "job.toml", *chosen).stdout.startswith("1 frame in out; ")


def test_a_light_that_physical_light_does_not_know_is_said_too(run: Run, folder: Path) -> None:
    light = "[[lights]]\ntype = 'playcanvas'\nkind = 'omni'\nposition = [0, 2, 0]\n"
    (folder / "omni.toml").write_text("proxy = 'proxy.glb'\nresolution = [32, 24]\nrender = { spp = 1 }\n" + light)
    told = run("render", "omni.toml")
    assert told.returncode == 0
    assert told.stderr.count("linear falloff becomes the inverse square law") == 1
    assert "linear falloff" not in run("render", "omni.toml", "--set", "profile=playcanvas").stderr
