"""`mirelight studio`: from a capture to relit frames on one page."""

from __future__ import annotations

import argparse
from pathlib import Path

from mirelight.base.errors import InputError
from mirelight.cli import options, outputs, say
from mirelight.cli.command import Command


def _arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "capture", metavar="CAPTURE|JOB", nargs="?", help="a splat file or a job file (default: what the page is given)"
    )
    parser.add_argument("-o", "--out", metavar="JOB", help="save there (default: NAME.studio.toml beside it)")
    parser.add_argument("--port", metavar="N", type=int, help="of the page (default: a free one)")
    options.add_quiet(parser, "the page's address and errors")


def run_studio(args: argparse.Namespace) -> int:
    """The command. The page's address goes to stdout, the rest to stderr; Ctrl-C ends it well."""
    import tempfile

    from mirelight.apps.studio.desk import Desk
    from mirelight.apps.studio.server import serving

    if args.port is not None and not 1 <= args.port <= 65535:
        raise InputError("--port", str(args.port), "give 1 to 65535")
    out = None if args.out is None else str(outputs.named(args.out, "a job is", ".toml"))
    with tempfile.TemporaryDirectory(prefix="mirelight-studio-") as folder:
        desk = Desk(args.capture, Path(folder), out, say.remark)
        with serving(desk, args.port or 0) as address:
            say.result(address)
            if not args.quiet:
                say.remark("open the address above in a browser; Ctrl-C ends the studio")
            try:
                desk.run()
            except KeyboardInterrupt:
                say.remark("the studio is closed")
    return 0


COMMAND = Command(
    name="studio",
    group="start",
    help="relight a capture by looking: lights, cameras and frames on one page",
    description="Serve a page on this machine that shows a capture, finds its proxy and captured light, and takes "
    "lights, suns, panoramas and cameras set by hand. It saves the job that `mirelight render` takes, and renders.",
    examples=("studio", "studio capture.ply", "studio job.toml -o evening.studio.toml"),
    arguments=_arguments,
    call=run_studio,
    page="studio",
)
