"""First jobs as a command: nothing that is there is replaced, now or when they are rendered."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from mirelight import cli
from mirelight.io import splats
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
