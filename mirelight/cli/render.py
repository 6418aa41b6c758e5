"""`mirelight render`: load the job, make the frames that are missing, write each as soon as it is there."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from pathlib import Path

from mirelight import executor
from mirelight.cli import new, progress, stop
from mirelight.errors import InputError
from mirelight.forecast import Forecast, forecast
from mirelight.io import job
from mirelight.io.job.overrides import Override, parse
from mirelight.model import Job
from mirelight.plan import light_keys, plan, warnings
from mirelight.store import Store


def run_render(args: argparse.Namespace) -> int:
    """The command. Progress goes to stderr, one line at the end to stdout."""
    tally = progress.chosen(args.quiet)
    store: Store | None = None
    try:
        with tally:
            work = _load(args, tally)
            frames = plan(
                work,
                cameras=named(args.camera, [x.name for x in work.cameras]),
                lightings=named(args.lighting, [x.name for x in work.lightings]),
            )
            for line in warnings(frames):
                tally.note(f"mirelight: {line}")
            if args.dry_run:
                _say_forecast(forecast(frames))
                return 0
            store = Store(work)
            store.open()
            with stop.Watched(tally) as watched:
                executor.run(frames, store, watched)
            store.tidy(light_keys(work))
    except BaseException as e:
        code = stop.exit_code(e)
        if code is None:
            raise
        _say_what_is_left(tally, store)
        return code
    finally:
        if store is not None:
            store.close()
    if not args.quiet:
        existed = f", {tally.skipped} of them already there" if tally.skipped else ""
        print(f"{_frames(tally.there)} in {_shown(store.folder)}{existed}; {progress.duration(tally.elapsed)}")
    return 0


def _say_forecast(found: Forecast) -> None:
    views = f"{found.cameras} cameras, {found.lightings} lightings"
    traces = f"{found.traces} trace{'' if found.traces == 1 else 's'} of unit lights"
    print(f"{_frames(found.frames)} ({views}), {found.there} of them there")
    print(f"{traces}; about {progress.duration(found.seconds)} on this machine as it is now")
    print(f"about {found.bytes / 1e6:,.1f} MB of new files")


def _load(args: argparse.Namespace, told: progress.Tally) -> Job:
    if args.light is not None and not new.is_capture(args.job):
        raise InputError(args.job, "a job together with --light", "change its lights, or name a splat file")
    if args.light is not None:
        told.note("mirelight: looking at the capture")
        work = new.first_job(args.job, args.light, _overrides(args))
    else:
        new.refuse_capture(args.job)
        work = job.load(args.job, _overrides(args))
    if args.out is None:
        return work
    return replace(work, output=replace(work.output, directory=Path(args.out).absolute()))


def _overrides(args: argparse.Namespace) -> list[Override]:
    found = [parse(text) for text in args.set]
    if args.variant is not None:
        found.append(Override(f"--variant {args.variant}", ("render", "variant"), args.variant))
    if args.threads is not None:
        found.append(replace(parse(f"render.threads={args.threads}"), source=f"--threads {args.threads}"))
    return found


def named(wanted: Sequence[str] | None, names: Sequence[str]) -> list[str] | None:
    """The names that are meant: by name, by pattern, or all frames of a sequence (orbit: orbit.0001, …).

    What fits nothing is left as it is, for `plan` to refuse.
    """
    if wanted is None:
        return None
    found: list[str] = []
    for name in wanted:
        sequence = re.compile(re.escape(name) + r"\.\d{4,}")
        fits = [x for x in names if x == name or fnmatchcase(x, name) or sequence.fullmatch(x)]
        found += fits or [name]
    return found


def _say_what_is_left(tally: progress.Tally, store: Store | None) -> None:
    line = "interrupted before the first frame"
    if store is not None and tally.total:
        done = f"{tally.there} of {_frames(tally.total)} are in {_shown(store.folder)}"
        line = f"interrupted; {done}, and the same command goes on from there"
        if store.partial:
            paths = ", ".join(_shown(path) for path in store.partial)
            print(f"mirelight: the frame in progress, as far as it got: {paths}", file=sys.stderr)
    print(f"mirelight: {line}", file=sys.stderr)


def _frames(count: int) -> str:
    return f"{count} frame" if count == 1 else f"{count} frames"


def _shown(path: Path) -> str:
    """The path as the user would name it from here."""
    here = Path.cwd()
    return str(path.relative_to(here)) if path.is_relative_to(here) else str(path)
