"""`mirelight mix`: the job's light on its splats, to be mixed live in a browser."""

from __future__ import annotations

import argparse
import sys

from mirelight.cli import say


def add_mix(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command's arguments; loads nothing heavy."""
    parser = commands.add_parser(
        "mix",
        help="write a page that mixes the job's lights live",
        description="Trace each light, group and environment of a job's lightings once, on every splat, and write a "
        "static page that shows the capture in PlayCanvas with a slider and a colour for each of them. What the page "
        "exports, `mirelight render` takes.",
    )
    parser.add_argument("job", metavar="JOB", help="job file (TOML)")
    parser.add_argument("-o", "--out", metavar="DIR", required=True, help="write the page there")
    parser.add_argument("--spp", metavar="N", type=int, default=64, help="samples a splat (default: 64)")
    parser.add_argument("--lighting", metavar="NAME", nargs="+", action="extend", help="only these lightings")
    parser.add_argument(
        "--set", metavar="KEY=VALUE", action="append", default=[], help="lay a setting over the job file (repeatable)"
    )
    parser.add_argument("-q", "--quiet", action="store_true", help="say nothing but warnings and errors")


def run_mix(args: argparse.Namespace) -> int:
    """The command. The page's path goes to stdout, the rest to stderr."""
    from mirelight import mixing
    from mirelight.errors import InputError
    from mirelight.farm.order import named
    from mirelight.io import job
    from mirelight.io.job.overrides import parse
    from mirelight.mixing.layers import check
    from mirelight.scene import prepare
    from mirelight.store import Store

    work = job.load(args.job, [parse(text) for text in args.set])
    check(work)
    if not 1 <= args.spp <= 1_000_000:
        raise InputError("--spp", str(args.spp), "give 1 to 1000000")
    there = [x.name for x in work.lightings]
    wanted = named(args.lighting, there)
    for name in wanted or ():
        if name not in there:
            raise InputError(work.source, f"no lighting named {name!r}", f"there are: {', '.join(there[:20])}")
    live = sys.stderr.isatty() and not args.quiet

    def report(what: str, done: int, total: int) -> None:
        say.live(f"light on splats, {what}: {done / max(total, 1):.0%}")

    store = Store(work)
    store.open()
    try:
        made = mixing.export(
            prepare(work, store),
            args.out,
            spp=args.spp,
            lightings=None if wanted is None else tuple(wanted),
            progress=report if live else None,
        )
    finally:
        store.close()
        if live:
            say.cleared()
    for line in made.warnings:
        say.remark(line)
    if not args.quiet:
        say.result(made.folder / "index.html")
    return 0
