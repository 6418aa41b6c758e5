"""`mirelight render`, `watch` and `submit`, which take an order for frames; what runs them is loaded late."""

from __future__ import annotations

import argparse

from mirelight.cli import options
from mirelight.cli.command import Command


def _render_arguments(parser: argparse.ArgumentParser) -> None:
    options.add_job(parser, "job file (TOML), or a splat file together with --light")
    parser.add_argument("--light", metavar="LIGHT", help="of a splat file: sun, point, or a file (.hdr, .exr, .glb)")
    _folder(parser)
    options.add_frames(parser)
    options.add_tracing(parser)
    parser.add_argument("--workers", metavar="N", help="render with N processes of this machine")
    parser.add_argument("--scheduler", metavar="ADDRESS", help="render with the workers of a Dask scheduler")
    parser.add_argument("--shard", metavar="I/N", help="only the I-th of N parts of the cameras")
    parser.add_argument("--preview", action="store_true", help="show every frame as NAME.preview.png until it is there")
    parser.add_argument("--dry-run", action="store_true", help="say what it would take, and make nothing")
    options.add_json(parser)
    options.add_quiet(parser)


def _watch_arguments(parser: argparse.ArgumentParser) -> None:
    options.add_job(parser)
    _folder(parser)
    options.add_frames(parser)
    options.add_tracing(parser)


def _submit_arguments(parser: argparse.ArgumentParser) -> None:
    options.add_job(parser)
    kind = parser.add_mutually_exclusive_group(required=True)
    kind.add_argument("--slurm", action="store_true", help="a script for sbatch")
    kind.add_argument("--openjd", action="store_true", help="an Open Job Description template")
    parser.add_argument("-o", "--out", metavar="FILE", help="write the script there, not to stdout")
    parser.add_argument("--shards", metavar="N", default="8", help="into how many tasks (8)")
    parser.add_argument("--frames", metavar="DIR", help="write the frames there, relative to the current folder")
    options.add_frames(parser)
    options.add_tracing(parser)


def _folder(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("-o", "--out", metavar="DIR", help="write there, relative to the current folder")


def _render(args: argparse.Namespace) -> int:
    from mirelight.cli.render import run_render

    return run_render(args)


def _watch(args: argparse.Namespace) -> int:
    from mirelight.cli.watch import run_watch

    return run_watch(args)


def _submit(args: argparse.Namespace) -> int:
    from mirelight.cli.submit import run_submit

    return run_submit(args)


RENDER = Command(
    name="render",
    group="render",
    help="render the frames of a job file",
    description="Render every camera of a job under every lighting. Frames that exist with unchanged inputs are "
    "skipped, so an interrupted run goes on when it is started again.",
    examples=(
        "render job.toml",
        "render job.toml --camera front --lighting night -o out/quick --spp 16",
        "render capture.ply --light sun",
        "render job.toml --dry-run",
    ),
    arguments=_render_arguments,
    call=_render,
    page="command line",
)
WATCH = Command(
    name="watch",
    group="render",
    help="render a job again whenever it is saved",
    description="Show what a saved change of the job or of its files touches by quick pictures, then render it; "
    "until Ctrl-C.",
    examples=("watch job.toml", "watch job.toml --camera front --set resolution_scale=0.5"),
    arguments=_watch_arguments,
    call=_watch,
    page="showing",
)
SUBMIT = Command(
    name="submit",
    group="render",
    help="print a script that renders a job on a batch system",
    description="Print a Slurm array script or an Open Job Description template whose tasks render parts of a job.",
    examples=("submit job.toml --slurm --shards 100 -o job.sh", "submit job.toml --openjd -o job.json"),
    arguments=_submit_arguments,
    call=_submit,
    page="farm",
)
