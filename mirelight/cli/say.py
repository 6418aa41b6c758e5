"""What commands print: results on stdout, all else on stderr. Nothing in a name can act on the terminal."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable

from mirelight.base.errors import printable


def result(text: object) -> None:
    """Print lines on stdout at once."""
    print("\n".join(printable(line) for line in str(text).split("\n")), flush=True)


def as_json(value: object) -> None:
    """Print JSON that stays JSON on any terminal: what it cannot show is written as ``\\u`` escapes.

    Args:
        value: of mappings, sequences, NumPy arrays, dataclasses, paths and plain values; what is not finite is null.
    """
    import json

    from mirelight.io.records import packed

    encoding = (getattr(sys.stdout, "encoding", None) or "utf-8").lower().replace("-", "")
    text = json.dumps(packed(value), indent=2, ensure_ascii=encoding != "utf8")
    print("\n".join("".join(c if c.isprintable() else json.dumps(c)[1:-1] for c in x) for x in text.split("\n")))


def outcome(args: argparse.Namespace, value: object, lines: Iterable[str], notes: Iterable[str] = ()) -> None:
    """What a command has made: `value` with --json, nothing with --quiet, else lines on stdout and notes on stderr."""
    if args.json:
        as_json(value)
    elif not getattr(args, "quiet", False):
        for one in lines:
            result(one)
        for one in notes:
            remark(one)


def line(text: str) -> None:
    """Print a line on stderr at once."""
    print(printable(text), file=sys.stderr, flush=True)


def remark(text: str) -> None:
    """Print a line on stderr that says who speaks."""
    line(f"mirelight: {text}")


def live(text: str) -> None:
    """Show a line on a terminal in place of the one before."""
    print(f"\033[K{printable(text)}", end="\r", file=sys.stderr, flush=True)


def cleared() -> None:
    """Take the live line away."""
    print("\033[K", end="", file=sys.stderr, flush=True)
