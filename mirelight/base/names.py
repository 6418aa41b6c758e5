"""Names that differ."""

from __future__ import annotations

from collections.abc import Iterable


class FreeNames:
    """Gives names that differ: lamp, lamp-2, lamp-3. A hundred thousand lamps take no longer each than the first.

    Args:
        taken: names that are not given.
        separator: between a name and its number.
    """

    def __init__(self, taken: Iterable[str] = (), separator: str = "-") -> None:
        self._taken, self._separator = set(taken), separator
        self._next: dict[str, int] = {}  # the number to try first

    def __contains__(self, name: str) -> bool:
        return name in self._taken

    def take(self, name: str) -> str:
        """`name`, or with a number where it is taken; taken from now on."""
        out = name
        if name in self._taken:
            number = self._next.get(name, 2)
            while (out := f"{name}{self._separator}{number}") in self._taken:
                number += 1
            self._next[name] = number + 1
        self._taken.add(out)
        return out
