"""README.md as package indexes show it: its links and pictures lead to the repository, wherever it is read.

Hatchling calls this when it builds (`tool.hatch.metadata.hooks.custom` in pyproject.toml).
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from hatchling.metadata.plugin.interface import MetadataHookInterface

_LINK = re.compile(r"(!?)\[([^\]]*)\]\((?!https?:|#)([^)\s]+)\)")


class AbsoluteReadme(MetadataHookInterface):
    """Gives the project its readme."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Called by hatchling with the table `project`, urls included."""
        text = (Path(self.root) / "README.md").read_text(encoding="utf-8")
        metadata["readme"] = {
            "content-type": "text/markdown",
            "text": absolute(text, metadata["urls"]["Homepage"], f"v{metadata['version']}"),
        }


def absolute(text: str, repository: str, tag: str) -> str:
    """Markdown with every relative link made one into the repository at a tag; pictures as files, pages as pages."""

    def link(found: re.Match[str]) -> str:
        picture, words, target = found.groups()
        return f"{picture}[{words}]({repository}/{'raw' if picture else 'blob'}/{tag}/{target})"

    return _LINK.sub(link, text)
