"""Names of prims: letters, digits and underlines, each once below its parent."""

from __future__ import annotations

import re


class PrimNames:
    """Gives names that are free."""

    def __init__(self) -> None:
        self._taken: set[str] = set()

    def take(self, parent: str, name: str) -> str:
        """The nearest name to `name` that a prim below `parent` may have; taken from now on."""
        plain = re.sub(r"\W", "_", name, flags=re.ASCII) or "_"
        plain = f"_{plain}" if plain[0].isdigit() else plain
        out, number = plain, 2
        while f"{parent}/{out}" in self._taken:
            out, number = f"{plain}_{number}", number + 1
        self._taken.add(f"{parent}/{out}")
        return out
