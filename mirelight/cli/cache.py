"""`mirelight cache`: what is kept for all commands of a user."""

from __future__ import annotations

import argparse
from typing import Any

from mirelight.cli import say


def add_cache(commands: Any) -> None:
    """Declare the command's arguments; loads nothing heavy."""
    parser = commands.add_parser(
        "cache",
        help="say what is kept for every command, or clear it",
        description="Say where proxies made from splats and estimates of captured light are kept for every command, "
        "and how much that is. All of it can be made again.",
    )
    parser.add_argument("--clear", action="store_true", help="remove all of it")


def run_cache(args: argparse.Namespace) -> int:
    """The command."""
    from mirelight.model.shown import count
    from mirelight.pipeline.cache import VARIABLE, UserCache

    cache = UserCache()
    if cache.folder is None:
        say.result(f"nothing is kept: this user has no home folder, and {VARIABLE} names none")
        return 0
    things, size = cache.held()
    said = f"{count(things, 'thing')}, {size / 1e6:.1f} MB of at most {cache.most / 1e6:.0f} MB"
    if args.clear:
        cache.clear()
        left, _ = cache.held()
        said = f"{count(things - left, 'thing')} removed" + (f", {left} left: no permission" if left else "")
    say.result(f"{cache.folder}: {said}")
    return 0
