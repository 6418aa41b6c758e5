"""`mirelight film`: frames one after the other, as a film."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from mirelight.cli import options, outputs, say
from mirelight.cli.command import Command


def _arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("paths", metavar="DIR|FILE", nargs="+", help="output folder, or picture files or a pattern")
    parser.add_argument("-o", "--out", metavar="FILE", required=True, help=".mp4, .webp or .gif")
    parser.add_argument("--fps", metavar="N", default="24", help="pictures a second (24)")
    options.add_frames(parser)
    parser.add_argument(
        "--order",
        choices=("cameras", "lightings"),
        default="cameras",
        help="what runs first: all cameras under a lighting, or all lightings of a camera (cameras)",
    )
    options.add_json(parser)


def run_film(args: argparse.Namespace) -> int:
    """The command. One line to stdout, and on a terminal a live one to stderr."""
    from mirelight.apps.show import film, shots
    from mirelight.apps.show.encoders import encoder_of

    out = Path(args.out)
    rate = film.rate_of(args.fps)
    write = encoder_of(out, rate)
    found = film.ordered(shots.wanted(args.paths, args.camera, args.lighting), args.order)
    outputs.spare([out], [x.file for x in found if x.file is not None])
    live = sys.stderr.isatty()

    def report(done: int, total: int) -> None:
        say.live(f"{done}/{total} frames")

    try:
        made = film.write_film(found, out, rate, write, report if live else None)
    finally:
        if live:
            say.cleared()
    width, height = made.size
    figures = {"files": [out], "frames": made.count, "size": made.size, "seconds": made.seconds}
    say.outcome(args, figures, [f"{made.count} frames of {width} x {height}, {made.seconds:.4g} s in {out}"])
    return 0


COMMAND = Command(
    name="film",
    group="look",
    help="make a film of frames",
    description="The frames of an output folder, or picture files, one after the other: H.264 (.mp4, by the extra "
    "'film' or ffmpeg), animated WebP or GIF.",
    examples=(
        "film out -o film.mp4",
        "film out -o day.webp --camera 'orbit*' --fps 12",
        "film out -o lights.gif --order lightings",
    ),
    arguments=_arguments,
    call=run_film,
    page="showing",
)
