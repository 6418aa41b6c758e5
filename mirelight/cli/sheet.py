"""`mirelight sheet`: many frames on one picture."""

from __future__ import annotations

import argparse
import re
from pathlib import Path
from typing import Any

from mirelight.cli import outputs, say

_LEAST, _MOST = 16, 512  # pixels


def add_sheet(commands: Any) -> None:
    """Its arguments."""
    sheet = commands.add_parser(
        "sheet",
        help="draw a contact sheet of frames",
        description="Frames of an output folder, small, on one picture: rows are cameras, columns lightings. Picture "
        "files are drawn as a grid.",
    )
    sheet.add_argument("paths", metavar="DIR|FILE", nargs="+", help="output folder, or picture files or a pattern")
    sheet.add_argument("-o", "--file", metavar="FILE", default="sheet.png", help=".png, .jpg or .webp (sheet.png)")
    sheet.add_argument("--camera", metavar="NAME", nargs="+", action="extend", help="only these (* and ? work)")
    sheet.add_argument("--lighting", metavar="NAME", nargs="+", action="extend", help="only these lightings")
    sheet.add_argument("--size", metavar="N", default="192", help="longer side of a small picture, pixels (192)")
    sheet.add_argument("--all", action="store_true", help="all frames, on several sheets where one does not hold them")


def run_sheet(args: argparse.Namespace) -> int:
    """The command. One line to stdout."""
    from mirelight.apps.show import sheets, shots
    from mirelight.base.errors import InputError
    from mirelight.io.sheet import sheet_format

    out = Path(args.file)
    sheet_format(out)
    if not re.fullmatch(r"[0-9]{1,4}", args.size) or not _LEAST <= int(args.size) <= _MOST:
        raise InputError("--size", args.size, f"give {_LEAST} to {_MOST} pixels")
    found = shots.wanted(args.paths, args.camera, args.lighting)
    pages = range(1, len(found) + 1 if args.all else 2)
    outputs.spare([sheets.page_file(out, number) for number in pages], [x.file for x in found if x.file is not None])
    made = sheets.write_sheets(found, out, size=int(args.size), every=args.all)
    some = f" of {made.there}" if made.shown < made.there else ""
    say.result(f"{made.shown}{some} frames on {', '.join(map(str, made.pages))}")
    if some:
        say.remark("evenly chosen; --all draws all of them, on several sheets")
    return 0
