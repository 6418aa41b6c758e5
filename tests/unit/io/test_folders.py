"""Folders of a run that came to nothing go again, and no others."""

from __future__ import annotations

from pathlib import Path

import pytest

from mirelight.base.errors import OutputError
from mirelight.io.folders import NewFolders


def test_what_was_made_goes_and_what_was_there_stays(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    new = NewFolders(tmp_path / "there", tmp_path / "there" / "a" / "b", tmp_path / "there" / "a" / "c")
    new.make()
    assert tmp_path / "there" / "a" / "c" in new and tmp_path / "there" not in new
    assert (tmp_path / "there" / "a" / "b").is_dir()
    new.remove()
    assert [x.name for x in tmp_path.rglob("*")] == ["there"]


def test_what_holds_something_stays(tmp_path: Path) -> None:
    new = NewFolders(tmp_path / "a" / "b", tmp_path / "a" / "c")
    new.make()
    (tmp_path / "a" / "b" / "file").touch()
    new.remove()
    assert sorted(x.name for x in tmp_path.rglob("*")) == ["a", "b", "file"]


def test_what_was_made_before_one_could_not_be_goes_too(tmp_path: Path) -> None:
    """Around that one, too. The line names the folder that was asked for."""
    new = NewFolders(tmp_path / "a", tmp_path / "a" / "b" / ("c" * 300))
    with pytest.raises(OutputError, match=r"/a: cannot be written \(the name is too long\)"):
        new.make()
    new.remove()
    assert not list(tmp_path.iterdir())
