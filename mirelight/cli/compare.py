"""`mirelight compare`: pairs of pictures scored, with thresholds for CI and a report in one file."""

from __future__ import annotations

import argparse
import math
import re
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from mirelight.base.errors import InputError
from mirelight.base.progress import CountProgress
from mirelight.cli import options, outputs, say
from mirelight.cli.codes import DONE, FOUND
from mirelight.cli.command import Command

if TYPE_CHECKING:
    from mirelight.compare import CompareSettings

_KINDS = (".html", ".json", ".csv")
_MOST_STOPS = 64  # as in the job file


def _arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("paths", metavar="PATH", nargs="+", help="REFERENCE… TEST…: EXR, PNG, JPEG, WebP, or folders")
    parser.add_argument(
        "-o",
        "--out",
        metavar="FILE",
        action="append",
        default=[],
        help="write a report that opens from disk (.html), or every figure (.json, .csv); may be given again",
    )
    options.add_json(parser)
    parser.add_argument(
        "--require",
        metavar="FIGURE>=NUMBER",
        action="append",
        default=[],
        help="a bound for every pair: psnr>=30, silhouette.flip<=0.1 (may be given again)",
    )
    parser.add_argument("--fit-gain", action="store_true", help="fit one factor on the reference's light per pair")
    parser.add_argument("--exposure", metavar="STOPS", default="0", help="of linear pictures (0)")
    parser.add_argument(
        "--tone", choices=("none", "aces", "neutral", "agx"), default="none", help="tone curve of linear pictures"
    )
    parser.add_argument(
        "--transfer",
        choices=("auto", "srgb", "power"),
        default="auto",
        help="display curve; power: the real-time engine's 2.2; auto: as the files say",
    )
    parser.add_argument("--background", metavar="R,G,B", default="0,0,0", help="behind transparent pixels (0,0,0)")
    parser.add_argument("--premultiplied", action="store_true", help="8-bit files hold colour times alpha")
    parser.add_argument("--mask", metavar="PATH", help="only what is white there counts; a file, or a folder of files")
    parser.add_argument("--band", metavar="PIXELS", default="4", help="silhouette band on either side (4)")
    parser.add_argument("-q", "--quiet", action="store_true", help="print no table")


def run_compare(args: argparse.Namespace) -> int:
    """The command. The table or the JSON goes to stdout; 0 where every requirement holds, else 1."""
    import numpy as np

    from mirelight.compare import compare, find_pairs, parse_requirement, summary
    from mirelight.compare.tables import json_text

    if len(args.paths) % 2:
        raise InputError("compare", f"{len(args.paths)} paths", "give as many tests as references")
    paths = [Path(p) for p in args.paths]
    half = len(paths) // 2
    settings = _settings(args)
    requirements = [parse_requirement(text) for text in args.require]
    outs = _outs(args.out)
    pairing = find_pairs(paths[:half], paths[half:], Path(args.mask) if args.mask else None)
    outputs.spare(outs.values(), [path for pair in pairing.pairs for path in pair.files])
    _own(outs)
    with np.errstate(over="ignore", invalid="ignore"):  # of light near float32's end: the figures say inf
        outcome = compare(
            pairing,
            settings,
            requirements=requirements,
            html=outs.get(".html"),
            json=outs.get(".json"),
            csv=outs.get(".csv"),
            progress=_counter() if sys.stderr.isatty() and not args.quiet else None,
        )
    if args.json:
        say.result(json_text(outcome.results, settings, outcome.failures, outcome.unpaired))
    elif not args.quiet:
        say.result(summary(outcome))
    elif outcome.failures:
        say.result("\n".join(outcome.failures))
    return FOUND if outcome.failures else DONE


def _settings(args: argparse.Namespace) -> CompareSettings:
    from mirelight.compare import CompareSettings

    return CompareSettings(
        exposure=_number("--exposure", args.exposure),
        tone=args.tone,
        transfer=args.transfer,
        background=_colour(args.background),
        premultiplied=args.premultiplied,
        fit_gain=args.fit_gain,
        band=_band(args.band),
    )


def _outs(names: Sequence[str]) -> dict[str, Path]:
    """What to write, by suffix."""
    found = {Path(x).suffix.lower(): outputs.named(x, "a comparison is", *_KINDS) for x in names}
    if len(found) < len(names):
        raise InputError("--out", "two files of one kind", f"give one each of {', '.join(_KINDS)}")
    return found


def _own(outs: Mapping[str, Path]) -> None:
    """Raises OutputError where a file of these names is there and no comparison wrote it."""
    from mirelight.compare.report import SIGN
    from mirelight.compare.tables import CSV_SIGN, JSON_SIGN

    for kind, out in outs.items():
        outputs.own(out, {".html": SIGN, ".json": JSON_SIGN, ".csv": CSV_SIGN}[kind])


COMMAND = Command(
    name="compare",
    group="compare",
    help="score pictures against references, with a report",
    description="Compare pairs of files, or folders whose frames are matched by name, those of `mirelight render` "
    "and `mirelight realtime` among them. An even number of paths: the first half are references, the second half "
    "their tests. Exit code 1: a requirement does not hold, or a reference has no test that could hold it.",
    examples=(
        "compare reference.exr test.png",
        "compare out/room out/live -o report.html",
        'compare reference test --require "psnr>=30" --json',
    ),
    arguments=_arguments,
    call=run_compare,
    page="comparing",
)


def _counter() -> CountProgress:
    def show(done: int, total: int) -> None:
        if done < total:
            say.live(f"pair {done + 1} of {total}")
        else:
            say.cleared()

    return show


def _number(name: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(name, f"{text!r} is not a number", "write one such as 1.5")
    if abs(value) > _MOST_STOPS:
        raise InputError(name, repr(text), f"write a number from -{_MOST_STOPS} to {_MOST_STOPS}")
    return value


def _colour(text: str) -> tuple[float, float, float]:
    values = tuple(_number("--background", part) for part in text.split(","))
    if len(values) != 3:
        raise InputError("--background", repr(text), "write three display values such as 0.5,0.5,0.5")
    return values


def _band(text: str) -> int:
    if not re.fullmatch(r"[0-9]{1,4}", text) or not 1 <= int(text) <= 1000:
        raise InputError("--band", repr(text), "write a whole number of pixels from 1 to 1000")
    return int(text)
