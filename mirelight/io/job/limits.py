"""What bounds TOML before anything walks through it: depth, and the size of numbers. Nothing else reads TOML."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from itertools import islice
from typing import Any

from mirelight.io.job.positions import Path

DEEPEST = 64  # tables and lists inside each other; a job needs nine
_MOST_DOTS = 1000  # in one key, or the like in several; the parser's time and memory grow with their square
_BETWEEN_KEYS = re.compile(r"[^\w\-.\"' \t]+")
_LONGEST_INTEGER = 63  # bits, as TOML 1.0.0 asks of every reader
_MOST = 20  # numbers that are complained about


def load_toml(text: str) -> dict[str, Any]:
    """`tomllib.loads` for text that nobody has vouched for.

    Raises:
        tomllib.TOMLDecodeError: it is not TOML.
        ValueError: it is nested too deeply, or holds a number of thousands of digits.
    """
    dots = (part.count(".") for part in _BETWEEN_KEYS.split(text))
    if sum(count**2 for count in dots if count > DEEPEST) > _MOST_DOTS**2:
        raise ValueError("nested too deeply")
    try:
        data = tomllib.loads(text)
    except RecursionError:
        raise ValueError("nested too deeply") from None
    if any(len(path) > DEEPEST for path, _ in _walk(data)):
        raise ValueError("nested too deeply")
    return data


def large_numbers(data: dict[str, Any]) -> list[Path]:
    """Where the first integers stand that TOML does not have."""
    wrong = (p for p, v in _walk(data) if isinstance(v, int) and v.bit_length() > _LONGEST_INTEGER)
    return list(islice(wrong, _MOST))


def _walk(data: dict[str, Any]) -> Iterator[tuple[Path, Any]]:
    """Every table, list and value with its path; goes no deeper than one level below what is allowed."""
    pending: list[tuple[Path, Any]] = [((), data)]
    while pending:
        path, node = pending.pop()
        yield path, node
        if len(path) > DEEPEST:
            continue
        if isinstance(node, dict):
            pending += [((*path, key), value) for key, value in node.items()]
        elif isinstance(node, list):
            pending += [((*path, i), value) for i, value in enumerate(node)]
