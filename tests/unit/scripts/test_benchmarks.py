"""docs/benchmarks: pages say what their JSON files say, and new figures take the place of old ones."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from bench import pages

FILES = sorted(pages.FOLDER.glob("*.json"))


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_the_page_is_what_its_file_gives(path: Path) -> None:
    data = json.loads(path.read_text(encoding="utf-8"))
    assert path.with_suffix(".md").read_text(encoding="utf-8") == pages.page(data, path.name)
    assert path.read_text(encoding="utf-8") == pages.text(data)
    assert all(section["measured"] for section in data["sections"])


def test_every_page_has_a_file() -> None:
    assert {x.stem for x in pages.FOLDER.glob("*.md")} == {x.stem for x in FILES}


def test_new_figures_replace_old_ones_and_keep_the_text(tmp_path: Path) -> None:
    old: dict[str, Any] = {"columns": ["a", "b"], "rows": [["x", "1"], ["y", "2"]]}
    section = {"title": "Cost", "measured": "0.1.0", "blocks": ["Why.", old, ["What follows."]]}
    path = tmp_path / "some.json"
    path.write_text(pages.text({"title": "Some", "intro": [], "sections": [section]}), encoding="utf-8")

    new = {"columns": ["a", "b"], "rows": [["x", "3"]]}
    pages.put(path, [{"title": "Cost", **new}, {"title": "More", **new}], "bench some", "0.2.0")
    cost, more = json.loads(path.read_text(encoding="utf-8"))["sections"]
    assert cost["blocks"] == ["Why.", new, ["What follows."]]
    assert (cost["measured"], cost["command"]) == ("0.2.0", "bench some")
    assert (more["title"], more["blocks"]) == ("More", [new])
    assert "| x | 3 |" in pages.page(json.loads(path.read_text(encoding="utf-8")), path.name)
