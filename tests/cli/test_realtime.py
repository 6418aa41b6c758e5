"""`mirelight realtime` and `mirelight compare` as real processes, one after the other as a person runs them."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest

from mirelight.cli import main

from .conftest import Run


def test_export_writes_a_page_for_each_frame(run: Run, folder: Path) -> None:
    done = run("realtime", "job.toml", "-o", "live", "--export-only", "--lighting", "night")
    assert done.returncode == 0, done.stderr
    pages = [Path("live") / f"{camera}.night" / "index.html" for camera in ("front", "orbit.0001", "orbit.0002")]
    assert done.stdout.splitlines() == [str(page) for page in pages]
    for page in pages:
        scene = json.loads((folder / page.parent / "scene.json").read_text(encoding="utf-8"))
        assert [light["type"] for light in scene["lights"]] == ["omni"]
        assert (folder / page).is_file()
        known = json.loads((folder / page.parent / "page.json").read_text(encoding="utf-8"))
        assert known == {"frames": [x.parent.name for x in pages], "physical": None}
    for name in ("splats.ply", "proxy.glb", "engine/playcanvas.mjs"):  # on the disk once
        assert len({(folder / page.parent / name).stat().st_ino for page in pages}) == 1
    again = run("realtime", "job.toml", "-o", "live", "--export-only", "--lighting", "night", "--json")
    assert json.loads(again.stdout)["files"] == [str(page) for page in pages], again.stderr
    assert done.stderr.count("the engine tints in display space") == len(pages)


def test_the_engines_frame_is_compared_with_ours(run: Run, folder: Path) -> None:
    chosen = ("--camera", "front", "--lighting", "night")
    assert run("realtime", "job.toml", "-o", "live", *chosen, "-q").returncode == 0
    assert run("render", "job.toml", "--out", "ours", *chosen, "-q").returncode == 0
    pair = ("ours/front.night.exr", "live/front.night/frame.png")
    held = run("compare", "ours", "live", "--require", "psnr>=5", "-o", "all.json")
    assert held.returncode == 0, held.stderr
    found = json.loads((folder / "all.json").read_text(encoding="utf-8"))
    assert [(p["reference"], p["test"]) for p in found["pairs"]] == [pair]
    assert found["unpaired"] == []
    unmet = run("compare", *pair, "--require", "psnr>=90")
    assert unmet.returncode == 1
    assert "psnr" in unmet.stdout


def test_frames_are_laid_beside_the_live_ones(run: Run, folder: Path) -> None:
    chosen = ("--camera", "front", "--lighting", "night", "--export-only")
    missing = run("realtime", "job.toml", "-o", "live", *chosen, "--beside", "ours")
    assert (missing.returncode, missing.stderr.count("\n")) == (2, 1) and "no such folder" in missing.stderr
    (folder / "ours").mkdir()
    empty = run("realtime", "job.toml", "-o", "live", *chosen, "--beside", "ours")
    assert (empty.returncode, empty.stderr.count("\n")) == (2, 1) and "front.night.png" in empty.stderr
    assert not (folder / "live").exists()
    (folder / "ours" / "front.night.png").write_bytes(b"a picture")
    assert run("realtime", "job.toml", "-o", "live", *chosen, "--beside", "ours").returncode == 0
    assert (folder / "live" / "front.night" / "physical.png").read_bytes() == b"a picture"


def test_a_terminal_shows_which_frame_is_made_and_how_far_it_is(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def made(*parts: object, report: Callable[[str], None], **more: object) -> SimpleNamespace:
        report("loading the scene")
        return SimpleNamespace(warnings=())

    monkeypatch.setattr("mirelight.apps.realtime.render", made)
    monkeypatch.setattr("mirelight.apps.realtime.pages.write", lambda *parts: None)
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    assert main(["realtime", str(folder / "job.toml"), "-o", str(folder / "live"), "--lighting", "night"]) == 0
    shown = capsys.readouterr().err
    assert "frame 1 of 3: front.night: loading the scene" in shown
    assert "frame 2 of 3, about 0.0 s left: orbit.0001.night" in shown


def test_a_job_without_light_has_nothing_for_the_engine(run: Run, folder: Path) -> None:
    (folder / "dark.toml").write_text('splats = "splats.ply"\nproxy = "proxy.glb"\nlights = []\n', encoding="utf-8")
    done = run("realtime", "dark.toml", "-o", "live")
    assert done.returncode == 2
    assert "no light" in done.stderr
    assert not (folder / "live").exists()
