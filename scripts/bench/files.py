"""What a frame's files cost: bytes and CPU seconds by compression, 16-bit colour, and what they hold.

    mirelight render scenes/courtyard/job.toml --lighting night --camera front \\
        --set render.spp=8 --set output.half=false -o out/files
    python scripts/bench files out/files/front.night.exr

A frame's whole, 32-bit EXR is read, then written and read again and again; the least CPU time of five counts, of all
threads together. Waiting for the disk is not CPU time. Noise compresses badly, so few samples are the worst case.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import get_args

from bench.common import Table, least, table
from mirelight.io.image import is_intact, read, read_fingerprint, write
from mirelight.model import Compression, OutputSettings

HOLDS = {
    "everything": OutputSettings(),
    "picture and lights": OutputSettings(aovs=False),
    "picture": OutputSettings(aovs=False, layers=False),
}


def options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("exr", type=Path, help="a frame with everything in it")


def run(chosen: argparse.Namespace) -> list[Table]:
    """The tables of one frame."""
    frame, repeats = read(chosen.exr), 1 if chosen.quick else 5
    ways = [(compression, half) for compression in get_args(Compression) for half in (False, True)]
    with tempfile.TemporaryDirectory() as folder:
        exr, png = Path(folder) / "a.exr", Path(folder) / "a.png"

        def cell(settings: OutputSettings) -> str:
            spent = least(lambda: write(frame, exr, output=settings), repeats)
            return f"{exr.stat().st_size / 1e6:.1f} MB, {spent:.3f} s, read {least(lambda: read(exr), repeats):.3f} s"

        rows = [
            [held, *(cell(replace(settings, compression=compression, half=half)) for compression, half in ways)]
            for held, settings in HOLDS.items()
        ]
        alone = least(lambda: write(frame, png), repeats)
        write(frame, exr)
        checks = [
            ("PNG", f"{png.stat().st_size / 1e6:.1f} MB, {alone:.3f} s"),
            ("fingerprint", f"{least(lambda: read_fingerprint(exr), repeats):.4f} s"),
            ("whole", f"{least(lambda: is_intact(exr), repeats):.3f} s"),
        ]
    names = [f"`{compression}`{', `half`' if half else ''}" for compression, half in ways]
    return [table("Files", ["", *names], rows), table("Other reads and writes", ["", "cost"], checks)]
