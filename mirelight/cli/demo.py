"""`mirelight demo`: a capture that comes with the package, written out and relit."""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path

from mirelight.cli import options, say
from mirelight.cli.command import Command


def _arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("-o", "--out", metavar="DIR", default="demo", help="write it there (demo)")
    options.add_tracing(parser)
    options.add_json(parser)
    options.add_quiet(parser)


def run_demo(args: argparse.Namespace) -> int:
    """The command: what `mirelight render` says, and what to do next."""
    from mirelight.apps import demo
    from mirelight.base import extras
    from mirelight.batch import Order

    job = demo.write(Path(args.out))
    denoise = (not extras.missing("denoise") or None) if args.denoise is None else args.denoise
    order = Order(job=str(job), spp=args.spp, denoise=denoise, variant=args.variant, threads=args.threads)
    flags = [f"--{name}" for name in ("quiet", "json") if getattr(args, name)]
    render = args.parser.parse_args(["render", *order.arguments(), *flags])
    code: int = render.call(render)
    if code == 0 and not args.quiet:
        mix = f"mirelight mix {shlex.quote(str(job))} -o page --serve"
        say.remark(f"change {job} and render it again, or mix its lights: {mix}")
    return code


COMMAND = Command(
    name="demo",
    group="start",
    help="relight a small capture that comes with the program",
    description="Write a small capture with its mesh and a job into a folder, and render it: three pictures, in a "
    "minute or two. A good start to change things.",
    examples=("demo", "demo -o try --spp 16"),
    arguments=_arguments,
    call=run_demo,
    page="first capture",
)
