"""Where every key and value of a TOML text stands.

`tomllib` gives values without positions, so this walks the text once more. It runs only on text that `tomllib` has
accepted and therefore checks no grammar (TOML 1.0.0): it only has to know where strings, brackets and comments end.
"""

from __future__ import annotations

import tomllib
from bisect import bisect_right
from dataclasses import dataclass, field
from typing import TypeAlias

Path: TypeAlias = tuple[str | int, ...]  # ("lights", 2, "range"): keys, and indices into arrays from 0

_BLANK = " \t\n"
_BARE_END = " \t\n.=]"
_SCALAR_END = ",]}#\n"


@dataclass(frozen=True, slots=True)
class Place:
    """A stretch of the text; line and column of its first character count from 1."""

    line: int
    column: int
    start: int  # offset of the first character
    end: int  # offset after the last one


@dataclass(slots=True)
class Positions:
    """Places by path. A table made by a header or by dotted keys has the place of the key that first names it."""

    keys: dict[Path, Place] = field(default_factory=dict)  # items of arrays have none
    values: dict[Path, Place] = field(default_factory=dict)

    def key(self, path: Path) -> Place | None:
        """Where the key at the end of `path` stands, else its value, else the nearest thing around it."""
        return self.keys.get(path) or self.value(path)

    def value(self, path: Path) -> Place | None:
        """Where the value of `path` stands, else the nearest thing around it; None: nothing of it is in the text."""
        for length in range(len(path), 0, -1):
            if path[:length] in self.values:
                return self.values[path[:length]]
        return None


def index(text: str) -> Positions:
    """The places of all keys and values of `text`, which `tomllib.loads` must accept."""
    scanner = _Scanner(text)
    scanner.document()
    return scanner.found


class _Scanner:
    def __init__(self, text: str) -> None:
        self.text = text
        self.at = 0
        self.found = Positions()
        self.lines = [0] + [i + 1 for i, c in enumerate(text) if c == "\n"]
        self.last_item: dict[Path, int] = {}  # array of tables -> index of its newest table

    def document(self) -> None:
        table: Path = ()
        while self.skip_to_content():
            if self.text[self.at] == "[":
                table = self.header()
            else:
                self.pair(table)

    def header(self) -> Path:
        start = self.at
        is_item = self.text.startswith("[[", self.at)
        self.at += 2 if is_item else 1
        path: Path = ()
        for name, place in self.dotted_key():
            path = (*self.newest(path), name)
            self.note(path, place, place)
        if is_item:
            self.last_item[path] = self.last_item.get(path, -1) + 1
            path = self.newest(path)
        self.at = self.text.index("]", self.at) + (2 if is_item else 1)
        self.found.values[path] = self.place(start, self.at)
        return path

    def newest(self, path: Path) -> Path:
        return (*path, self.last_item[path]) if path in self.last_item else path

    def pair(self, table: Path) -> None:
        """One ``key.key = value``, in a table's body or in an inline table."""
        path = table
        keys = self.dotted_key()
        for name, place in keys[:-1]:
            path = (*path, name)
            self.note(path, place, place)
        path = (*path, keys[-1][0])
        self.skip_to_content()
        self.at += 1  # the equals sign
        self.skip_to_content()
        self.found.keys[path] = keys[-1][1]
        self.value(path)

    def note(self, path: Path, key: Place, value: Place) -> None:
        self.found.keys.setdefault(path, key)
        self.found.values.setdefault(path, value)

    def dotted_key(self) -> list[tuple[str, Place]]:
        out = []
        while True:
            self.skip_to_content()
            start = self.at
            if self.text[start] in "\"'":
                self.string()
            else:
                while self.text[self.at] not in _BARE_END:
                    self.at += 1
            raw = self.text[start : self.at]
            out.append((next(iter(tomllib.loads(raw + " = 0"))), self.place(start, self.at)))
            self.skip_to_content()
            if self.text[self.at] != ".":
                return out
            self.at += 1

    def value(self, path: Path) -> None:
        start = self.at
        first = self.text[start]
        if first in "\"'":
            self.string()
        elif first == "[":
            self.array(path)
        elif first == "{":
            self.inline_table(path)
        else:
            self.at = self.scalar_end()
        self.found.values[path] = self.place(start, self.at)

    def array(self, path: Path) -> None:
        self.at += 1
        item = 0
        while self.more("]"):
            self.value((*path, item))
            item += 1

    def inline_table(self, path: Path) -> None:
        self.at += 1
        while self.more("}"):
            self.pair(path)

    def more(self, closing: str) -> bool:
        """Pass blanks and commas; False, and past it, at the closing bracket."""
        while self.skip_to_content() and self.text[self.at] == ",":
            self.at += 1
        if self.text[self.at] != closing:
            return True
        self.at += 1
        return False

    def scalar_end(self) -> int:
        end = self.at
        while end < len(self.text) and self.text[end] not in _SCALAR_END:
            end += 1
        while self.text[end - 1] in _BLANK:  # a date and a time may have one space between them
            end -= 1
        return end

    def string(self) -> None:
        quote = self.text[self.at]
        closing = quote * 3 if self.text.startswith(quote * 3, self.at) else quote
        self.at += len(closing)
        while not self.text.startswith(closing, self.at):
            self.at += 2 if quote == '"' and self.text[self.at] == "\\" else 1
        self.at += len(closing)
        if len(closing) == 3:  # a multi-line string may end in one or two quotes of its own
            while self.text.startswith(quote, self.at):
                self.at += 1

    def skip_to_content(self) -> bool:
        """Pass blanks, line ends and comments; False at the end of the text."""
        while self.at < len(self.text):
            if self.text[self.at] == "#":
                end = self.text.find("\n", self.at)
                self.at = len(self.text) if end < 0 else end
            elif self.text[self.at] in _BLANK:
                self.at += 1
            else:
                return True
        return False

    def place(self, start: int, end: int) -> Place:
        line = bisect_right(self.lines, start)
        return Place(line, start - self.lines[line - 1] + 1, start, end)
