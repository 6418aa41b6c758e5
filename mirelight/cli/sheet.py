"""`mirelight sheet`: many frames on one picture."""

from __future__ import annotations

import argparse
import re
from pathlib import Path

from mirelight.cli import options, outputs, say
from mirelight.cli.command import Command

_LEAST, _MOST = 16, 512  # pixels


def _arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("paths", metavar="DIR|FILE", nargs="+", help="output folder, or picture files or a pattern")
    parser.add_argument("-o", "--out", metavar="FILE", default="sheet.png", help=".png, .jpg or .webp (sheet.png)")
    options.add_frames(parser)
    parser.add_argument("--size", metavar="N", default="192", help="longer side of a small picture, pixels (192)")
    parser.add_argument("--all", action="store_true", help="all frames, on several sheets where one does not hold them")
    options.add_json(parser)


def run_sheet(args: argparse.Namespace) -> int:
    """The command. One line to stdout."""
    from mirelight.apps.show import sheets, shots
    from mirelight.base.errors import InputError
    from mirelight.io.sheet import sheet_format

    out = Path(args.out)
    sheet_format(out)
    if not re.fullmatch(r"[0-9]{1,4}", args.size) or not _LEAST <= int(args.size) <= _MOST:
        raise InputError("--size", args.size, f"give {_LEAST} to {_MOST} pixels")
    found = shots.wanted(args.paths, args.camera, args.lighting)
    pages = range(1, len(found) + 1 if args.all else 2)
    outputs.spare([sheets.page_file(out, number) for number in pages], [x.file for x in found if x.file is not None])
    made = sheets.write_sheets(found, out, size=int(args.size), every=args.all)
    some = f" of {made.there}" if made.shown < made.there else ""
    said = f"{made.shown}{some} frames on {', '.join(map(str, made.pages))}"
    notes = ["evenly chosen; --all draws all of them, on several sheets"] if some else []
    say.outcome(args, {"files": made.pages, "frames": made.shown, "there": made.there}, [said], notes)
    return 0


COMMAND = Command(
    name="sheet",
    group="look",
    help="draw a contact sheet of frames",
    description="Frames of an output folder, small, on one picture: rows are cameras, columns lightings. Picture "
    "files are drawn as a grid.",
    examples=(
        "sheet out",
        "sheet out -o lamps.jpg --lighting 'lamp*' --size 256",
    ),
    arguments=_arguments,
    call=run_sheet,
    page="showing",
)
