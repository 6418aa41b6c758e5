"""`mirelight verify`: every frame of a folder looked at."""

from __future__ import annotations

import argparse
import time
from collections import Counter
from dataclasses import asdict
from typing import TYPE_CHECKING

from mirelight.cli import options, say
from mirelight.cli.command import Command

if TYPE_CHECKING:
    from mirelight.batch.checks import Finding

_MOST = 100  # lines of a kind
_EVERY = 30.0  # seconds between two words on how far it is


def _arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("folder", metavar="DIR", help="a job's output folder")
    parser.add_argument(
        "--rebuild",
        action="store_true",
        help="remove damaged files, for the next render to make, and write a lost journal again",
    )
    options.add_json(parser)


def run_verify(args: argparse.Namespace) -> int:
    """The command. What is wrong goes to stdout, the last line, too."""
    from mirelight.batch.verify import verify
    from mirelight.model.shown import count

    if args.json:
        return _as_json(args)
    said = _Said()
    found = verify(args.folder, said.hear, rebuild=args.rebuild, step=said.step)
    said.rest()
    for note in found.notes:
        say.result(f"note: {note}")
    if found.in_flight:
        say.result(f"note: {count(found.in_flight, 'frame')} in flight and not looked at")
    if found.recorded:
        say.result(f"{count(found.recorded, 'frame')} written into the journal")
    elif found.unrecorded:
        say.result(f"note: {count(found.unrecorded, 'frame')} not in the journal, where --rebuild writes them")
    if found.forgotten:
        say.result(f"{count(found.forgotten, 'file')} forgotten, for mirelight render to make again")
    wrong = f"{found.findings} things are wrong" if found.findings != 1 else "1 thing is wrong"
    say.result(f"{args.folder}: {count(found.frames, 'frame')} looked at; {wrong if found.findings else 'all is well'}")
    return 1 if found.findings else 0


COMMAND = Command(
    name="verify",
    group="data",
    help="look at every frame of a folder, and say what is wrong",
    description="Reads every file: bytes against the journal and the file's own digest, values (finite, alpha, "
    "size), pictures (black, white, empty), missing ones, sums of lights. Each thing is a line with how to mend "
    "it. Exit codes: 0 all is well; 1 something is not.",
    examples=(
        "verify out",
        "verify out --rebuild",
    ),
    arguments=_arguments,
    call=run_verify,
    page="farm",
)


def _as_json(args: argparse.Namespace) -> int:
    from mirelight.batch.verify import verify

    heard: list[Finding] = []
    found = verify(args.folder, heard.append, rebuild=args.rebuild, step=_Said().step)
    say.as_json({**asdict(found), "findings": [asdict(x) for x in heard], "folder": args.folder})
    return 1 if heard else 0


class _Said:
    def __init__(self) -> None:
        self._counts: Counter[str] = Counter()
        self._last = time.monotonic()

    def hear(self, finding: Finding) -> None:
        """A line at once, unless there were many of the kind."""
        self._counts[finding.kind] += 1
        if self._counts[finding.kind] <= _MOST:
            say.result(finding)

    def step(self, done: int, total: int) -> None:
        """A line on stderr, now and then."""
        if time.monotonic() - self._last >= _EVERY:
            self._last = time.monotonic()
            say.remark(f"{done} of {total} frames looked at")

    def rest(self) -> None:
        """How many lines were left out."""
        for kind, number in self._counts.items():
            if number > _MOST:
                say.result(f"{number - _MOST} more of this kind: {kind}")
