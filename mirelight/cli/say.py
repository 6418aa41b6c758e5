"""What commands print: results on stdout, all else on stderr. Nothing in a name can act on the terminal."""

from __future__ import annotations

import sys

from mirelight.base.errors import printable


def result(text: object) -> None:
    """Print lines on stdout at once."""
    print("\n".join(printable(line) for line in str(text).split("\n")), flush=True)


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
