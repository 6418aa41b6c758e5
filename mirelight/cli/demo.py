"""`mirelight demo`: a capture that comes with the package, written out and relit."""

from __future__ import annotations

import argparse
from pathlib import Path

from mirelight.cli import options, say
from mirelight.cli.command import Command


def _arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("-o", "--out", metavar="DIR", default="demo", help="write it there (demo)")
    options.add_json(parser)
    options.add_quiet(parser)


def run_demo(args: argparse.Namespace) -> int:
    """The command: what `mirelight render` says, and what to do next."""
    from mirelight.apps import demo
    from mirelight.base import extras

    job = demo.write(Path(args.out))
    words = ["render", str(job), *(["--quiet"] if args.quiet else []), *(["--json"] if args.json else [])]
    if not extras.missing("denoise"):
        words.append("--denoise")
    render = args.parser.parse_args(words)
    code: int = render.call(render)
    if code == 0 and not args.quiet:
        say.remark(f"change {job} and render it again, or mix its lights: mirelight mix {job} -o page --serve")
    return code


COMMAND = Command(
    name="demo",
    group="start",
    help="relight a small capture that comes with the program",
    description="Write a small capture with its mesh and a job into a folder, and render it: three pictures, in a "
    "minute or two. A good start to change things.",
    examples=("demo", "demo -o try"),
    arguments=_arguments,
    call=run_demo,
    page="first capture",
)
