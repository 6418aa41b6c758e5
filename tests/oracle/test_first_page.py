"""docs/tutorials/first-capture.md: the recorded session is what the commands say today."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest

from mirelight import cli

ROOT = Path(__file__).resolve().parents[2]


def test_the_recorded_session_of_new_and_inspect(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Word for word; `render` makes a mesh first, and is tested on small captures."""
    page = (ROOT / "docs" / "tutorials" / "first-capture.md").read_text(encoding="utf-8")
    session = page.partition("session.py -->")[2].partition("<!-- end")[0]
    recorded = dict(re.findall(r"^\$ mirelight (.*)\n((?:(?!\$|```).*\n)*)", session, flags=re.MULTILINE))
    assert [x.split()[0] for x in recorded] == ["new", "inspect", "render"]
    shutil.copy(ROOT / "scenes" / "stage" / "splats.compressed.ply", tmp_path / "stage.compressed.ply")
    monkeypatch.chdir(tmp_path)
    for command, said in list(recorded.items())[:2]:
        assert cli.main(command.split()) == 0
        now = capsys.readouterr()
        lines = "".join(x.replace(f"{tmp_path}/", "") for x in (now.err, now.out)).splitlines()
        # How much memory it would take depends on the machine.
        assert [x for x in lines if "memory" not in x] == [x for x in said.strip().splitlines() if "memory" not in x]
