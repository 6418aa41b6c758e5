"""`mirelight status`: what of a folder's frames is there, and who is at the others."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import asdict
from typing import TYPE_CHECKING

from mirelight.cli import options, say
from mirelight.cli.command import Command

if TYPE_CHECKING:
    from mirelight.batch.status import Status

_MOST = 10  # lines of a kind
_MISSING = 3  # names of missing frames
_CODES = {"done": 0, "stopped": 1, "running": 3}


def _arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("folder", metavar="DIR", help="a job's output folder")
    options.add_json(parser)


def run_status(args: argparse.Namespace) -> int:
    """Prints how far an output folder is."""
    from mirelight.batch.status import status

    found = status(args.folder)
    say.outcome(args, {"state": found.progress, **asdict(found)}, lines(found))
    return _CODES[found.progress]


COMMAND = Command(
    name="status",
    group="render",
    help="say which frames of a folder are there, in flight, failed or missing",
    description="Frames that are there, in flight (who makes them, and since when), failed (why) or missing, and "
    "the time left. Exit codes: 0 all are there; 1 some are not, and nobody is at work; 3 somebody is.",
    examples=(
        "status out",
        "status out --json",
    ),
    arguments=_arguments,
    call=run_status,
    page="farm",
)


def lines(found: Status) -> Iterator[str]:
    """The state of an output folder in lines for people."""
    from mirelight.cli.progress import duration
    from mirelight.store.journal import said_of

    counts = {
        "in flight": sum(len(x.frames) for x in found.in_flight),
        "failed": len(found.failed),
        "missing": len(found.missing),
    }
    others = "".join(f", {count} {what}" for what, count in counts.items() if count)
    yield f"{found.folder}: {found.there} of {found.frames} frames there{others}"
    for one in found.in_flight[:_MOST]:
        frame = one.frames[0] if one.frames else one.camera
        more = f" and {len(one.frames) - 1} more of its camera" if len(one.frames) > 1 else ""
        sign = f", last sign of life {duration(one.silent)} ago" if one.silent > 60 else ""
        yield f"in flight  {frame}{more}: process {one.process} on {one.host} for {duration(one.seconds)}{sign}"
    yield from _more("in flight", len(found.in_flight), "cameras")
    for failure in found.failed[:_MOST]:
        yield f"failed     {failure.frame}: {failure.error}"
    yield from _more("failed", len(found.failed), "frames")
    if found.missing:
        rest = len(found.missing) - _MISSING
        yield f"missing    {', '.join(found.missing[:_MISSING])}{f' and {rest} more' if rest > 0 else ''}"
    if said := said_of(found.damaged_rows):
        yield f"note       {said}"
    if found.progress == "done":
        return
    if found.seconds_left is not None:
        who = f"{len(found.in_flight)} at work" if found.in_flight else "one process"
        yield f"time left  about {duration(found.seconds_left)} with {who}"
    if not found.in_flight:
        yield f"nobody is at work; to go on: {found.command}"


def _more(kind: str, count: int, what: str) -> Iterator[str]:
    if count > _MOST:
        yield f"{kind:<9}  {count - _MOST} more {what}; --json names all"
