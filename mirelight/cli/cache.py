"""`mirelight cache`: what is kept for all commands of a user."""

from __future__ import annotations

import argparse

from mirelight.cli import options, say
from mirelight.cli.command import Command


def _arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--clear", action="store_true", help="remove all of it")
    options.add_json(parser)


def run_cache(args: argparse.Namespace) -> int:
    """Shows what is kept for all commands, or clears it."""
    from mirelight.model.shown import count
    from mirelight.pipeline.cache import VARIABLE, UserCache

    cache = UserCache()
    if args.json:
        if args.clear:
            cache.clear()
        things, size = (0, 0) if cache.folder is None else cache.held()
        say.as_json({"folder": cache.folder, "things": things, "bytes": size, "most": cache.most})
        return 0
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


COMMAND = Command(
    name="cache",
    group="data",
    help="say what is kept for every command, or clear it",
    description="Say where proxies made from splats, estimates of captured light with their pictures, and guessed "
    "cameras are kept for every command, and how much that is. All of it can be made again.",
    examples=(
        "cache",
        "cache --clear",
    ),
    arguments=_arguments,
    call=run_cache,
    page="command line",
)
