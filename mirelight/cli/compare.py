"""`mirelight compare`: pairs of pictures scored, with thresholds for CI and a report in one file."""

from __future__ import annotations

import argparse
import math
import re
import sys
from collections.abc import Callable
from pathlib import Path

from mirelight.base.errors import InputError
from mirelight.cli import outputs, say

UNMET = 1  # exit code where a requirement does not hold
_MOST_STOPS = 64  # as in the job file


def add_compare(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command's arguments; loads nothing heavy."""
    parser = commands.add_parser(
        "compare",
        help="score pictures against references, with a report",
        description="Compare pairs of files, or folders whose frames are matched by name, those of `mirelight render` "
        "and `mirelight realtime` among them. An even number of paths: the first half are references, the second half "
        "their tests. Exit code 1: a requirement does not hold, or a reference has no test that could hold it.",
    )
    parser.add_argument("paths", metavar="PATH", nargs="+", help="REFERENCE… TEST…: EXR, PNG, JPEG, WebP, or folders")
    parser.add_argument("--html", metavar="FILE", help="write a report that opens from disk")
    parser.add_argument("--json", metavar="FILE", help="write every figure as JSON")
    parser.add_argument("--csv", metavar="FILE", help="write every figure as CSV")
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
    """The command. The table goes to stdout; 0 where every requirement holds, else 1."""
    import numpy as np

    from mirelight.compare import CompareSettings, compare, find_pairs, parse_requirement, summary
    from mirelight.compare.report import SIGN as HTML_SIGN
    from mirelight.compare.tables import CSV_SIGN, JSON_SIGN

    if len(args.paths) % 2:
        raise InputError("compare", f"{len(args.paths)} paths", "give as many tests as references")
    paths = [Path(p) for p in args.paths]
    half = len(paths) // 2
    settings = CompareSettings(
        exposure=_number("--exposure", args.exposure),
        tone=args.tone,
        transfer=args.transfer,
        background=_colour(args.background),
        premultiplied=args.premultiplied,
        fit_gain=args.fit_gain,
        band=_band(args.band),
    )
    requirements = [parse_requirement(text) for text in args.require]
    html, json, csv = (Path(x) if x else None for x in (args.html, args.json, args.csv))
    signs = {html: HTML_SIGN, json: JSON_SIGN, csv: CSV_SIGN}
    outs = {out: sign for out, sign in signs.items() if out is not None}
    outputs.in_a_folder(*outs)
    pairing = find_pairs(paths[:half], paths[half:], Path(args.mask) if args.mask else None)
    outputs.spare(outs, [path for pair in pairing.pairs for path in pair.files])
    for out, sign in outs.items():
        outputs.own(out, sign)
    with np.errstate(over="ignore", invalid="ignore"):  # of light near float32's end: the figures say inf
        outcome = compare(
            pairing,
            settings,
            requirements=requirements,
            html=html,
            json=json,
            csv=csv,
            progress=_counter() if sys.stderr.isatty() and not args.quiet else None,
        )
    if not args.quiet:
        say.result(summary(outcome))
    elif outcome.failures:
        say.result("\n".join(outcome.failures))
    return UNMET if outcome.failures else 0


def _counter() -> Callable[[int, int], None]:
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
