"""`mirelight export`: the frames of an output folder in the layout of a data set."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from mirelight.cli import say

LAYOUTS = ("nerf", "colmap", "tensoir", "olat", "hub", "orb")


def add_export(commands: Any) -> None:
    """Its arguments."""
    export = commands.add_parser(
        "export",
        help="write the frames of an output folder as a data set",
        description='Mixes frames from the layers that `mirelight render` has kept (output.store "layers" or "both").',
    )
    export.add_argument("folder", metavar="DIR", help="the job's output folder")
    export.add_argument("--layout", required=True, choices=LAYOUTS, help="how files are laid out (docs/datasets.md)")
    export.add_argument("-o", "--out", metavar="OUT", required=True, help="folder of the data set")
    export.add_argument("--lighting", metavar="NAME", nargs="+", help="only these lightings")
    export.add_argument("--normalize", action="store_true", help="move and scale the world into a box of ±1")
    export.add_argument("--split", choices=("camera", "lighting", "both"), default="camera", help="what is held out")
    export.add_argument("--held-out", metavar="SHARE", type=float, default=0.1, help="of the names, 0 to 1")
    export.add_argument("--seed", type=int, default=0, help="of what is held out")
    export.add_argument("--no-hdr", action="store_true", help="no linear pictures beside those of 8 bits")
    export.add_argument("--license", default="", help="of the data set, for its page")


def run_export(args: argparse.Namespace) -> int:
    """The command. One line at the end to stdout."""
    from mirelight import dataset
    from mirelight.dataset.export import ExportSettings, export

    settings = ExportSettings(
        lightings=None if args.lighting is None else tuple(args.lighting),
        normalize=args.normalize,
        by=args.split,
        held_out=args.held_out,
        seed=args.seed,
        license=args.license,
        hdr=not args.no_hdr,
    )
    count = export(dataset.open(args.folder), Path(args.out), args.layout, settings)
    say.result(f"{count} frames in {args.out}")
    return 0
