"""The pages of docs/benchmarks, written from the JSON files beside them: no figure is typed twice.

A file is a title, an introduction and sections. A section says by which command and with which version it was measured;
its blocks are paragraphs (text), bullets (lists of text), tables (`columns`, `rows`) and commands (`typed`).
"""

from __future__ import annotations

import json
import re
import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).resolve().parents[2] / "docs" / "benchmarks"
WIDTH = 120  # characters of a line
_MARK = "<!-- written by `python scripts/bench tables` from {name} -->"


def block(found: str | Sequence[str] | Mapping[str, Any]) -> str:
    """A paragraph, bullets, a table or what is typed, in Markdown."""
    if isinstance(found, str):
        return textwrap.fill(found, WIDTH, break_long_words=False, break_on_hyphens=False)
    if isinstance(found, Mapping) and "typed" in found:
        return "\n".join(["```sh", *found["typed"], "```"])
    if isinstance(found, Mapping):
        rows = [found["columns"], ["---"] * len(found["columns"]), *found["rows"]]
        return "\n".join("|" + "|".join(f" {cell} " if cell != "---" else cell for cell in row) + "|" for row in rows)
    return "\n".join(textwrap.fill(f"- {x}", WIDTH, subsequent_indent="  ", break_on_hyphens=False) for x in found)


def page(data: Mapping[str, Any], name: str) -> str:
    """The Markdown of a file's content, `name` the file's."""
    parts = [f"# {data['title']}", _MARK.format(name=name), *map(block, data["intro"])]
    for section in data["sections"]:
        command = f" by `{section['command']}`" if "command" in section else ""
        parts += [f"## {section['title']}", *map(block, section["blocks"])]
        parts.append(block(f"*Measured with version {section['measured']}{command}.*"))
    return "\n\n".join(parts) + "\n"


def text(data: Mapping[str, Any]) -> str:
    """A file's content as JSON, a row of a table on a line."""
    whole = json.dumps(data, indent=1, ensure_ascii=False)
    flat = re.compile(r"\[\s*((?:\"(?:[^\"\\]|\\.)*\",\s+)*\"(?:[^\"\\]|\\.)*\")\s*\](?=,?\s*(?:\]|\[|\"rows\"))")

    def joined(found: re.Match[str]) -> str:
        return "[" + ", ".join(json.dumps(x, ensure_ascii=False) for x in json.loads(found[0])) + "]"

    return flat.sub(joined, whole) + "\n"


def put(path: Path, tables: Sequence[Mapping[str, Any]], command: str, version: str) -> None:
    """Tables that were measured now, into a file: in place of the first one of the section with their title, whose text
    stays; else as new sections at the end."""
    data: dict[str, Any] = (
        json.loads(path.read_text(encoding="utf-8")) if path.exists() else {"title": path.stem, "intro": []}
    )
    sections: list[dict[str, Any]] = data.setdefault("sections", [])
    for table in tables:
        section: dict[str, Any] | None = next((x for x in sections if x["title"] == table["title"]), None)
        if section is None:
            section = {"title": table["title"], "blocks": []}
            sections.append(section)
        blocks = section["blocks"]
        place = next((i for i, x in enumerate(blocks) if isinstance(x, dict) and "rows" in x), None)
        if place is not None:
            del blocks[place]
        blocks.insert(len(blocks) if place is None else place, {"columns": table["columns"], "rows": table["rows"]})
        section |= {"command": command, "measured": version}
    path.write_text(text(data), encoding="utf-8")


def write() -> None:
    """All pages, from all files."""
    for path in sorted(FOLDER.glob("*.json")):
        data = json.loads(path.read_text(encoding="utf-8"))
        path.with_suffix(".md").write_text(page(data, path.name), encoding="utf-8")
        print(path.with_suffix(".md"))
