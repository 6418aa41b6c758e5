"""`mirelight render`: load the job, make the frames that are missing, write each as soon as it is there."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from pathlib import Path

from mirelight import pipeline
from mirelight.cli import progress, stop
from mirelight.cli.frames import FrameFiles
from mirelight.io import job
from mirelight.io.job.overrides import Override, parse
from mirelight.model import Job


def run_render(args: argparse.Namespace) -> int:
    """The command. Progress goes to stderr, one line at the end to stdout."""
    told = progress.chosen(args.quiet)
    files: FrameFiles | None = None
    try:
        with told:
            work = _load(args)
            tasks = pipeline.plan(
                work,
                cameras=named(args.camera, [x.name for x in work.scene.cameras]),
                lightings=named(args.lighting, [x.name for x in work.scene.lightings]),
            )
            for line in pipeline.warnings(work, tasks):
                told.note(f"mirelight: {line}")
            files = FrameFiles(work.output, work.display)
            files.prepare()
            with stop.Watched(told) as watched:
                pipeline.render(
                    work,
                    tasks,
                    is_done=files.exist,
                    sink=files.write,
                    partial=files.write_partial,
                    progress=watched,
                )
    except BaseException as e:
        code = stop.exit_code(e)
        if code is None:
            raise
        _say_what_is_left(told, files)
        return code
    if not args.quiet:
        existed = f", {told.skipped} of them already there" if told.skipped else ""
        print(f"{_frames(told.there)} in {_shown(files.folder)}{existed}; {progress.duration(told.elapsed)}")
    return 0


def _load(args: argparse.Namespace) -> Job:
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

    What fits nothing is left as it is, for `pipeline.plan` to refuse.
    """
    if wanted is None:
        return None
    found: list[str] = []
    for name in wanted:
        sequence = re.compile(re.escape(name) + r"\.\d{4,}")
        fits = [x for x in names if x == name or fnmatchcase(x, name) or sequence.fullmatch(x)]
        found += fits or [name]
    return found


def _say_what_is_left(told: progress.Tally, files: FrameFiles | None) -> None:
    line = "interrupted before the first frame"
    if files is not None and told.total:
        done = f"{told.there} of {_frames(told.total)} are in {_shown(files.folder)}"
        line = f"interrupted; {done}, and the same command goes on from there"
        if files.partial:
            paths = ", ".join(_shown(path) for path in files.partial)
            print(f"mirelight: the frame in progress, as far as it got: {paths}", file=sys.stderr)
    print(f"mirelight: {line}", file=sys.stderr)


def _frames(count: int) -> str:
    return f"{count} frame" if count == 1 else f"{count} frames"


def _shown(path: Path) -> str:
    """The path as the user would name it from here."""
    here = Path.cwd()
    return str(path.relative_to(here)) if path.is_relative_to(here) else str(path)
