"""`mirelight realtime`: the job's frames as PlayCanvas itself renders them."""

from __future__ import annotations

import argparse
import sys
import time
from functools import partial
from pathlib import Path

from mirelight.base.errors import InputError
from mirelight.cli import options, say
from mirelight.cli.command import Command


def _arguments(parser: argparse.ArgumentParser) -> None:
    options.add_job(parser)
    parser.add_argument("-o", "--out", metavar="DIR", required=True, help="write a folder per frame there")
    options.add_frames(parser)
    parser.add_argument(
        "--beside", metavar="DIR", help="show the frames of this output folder of mirelight render over the live ones"
    )
    parser.add_argument("--export-only", action="store_true", help="write the live page and render nothing")
    options.add_json(parser)
    options.add_quiet(parser, "warnings and errors")


def run_realtime(args: argparse.Namespace) -> int:
    """The command. What was written goes to stdout, what the engine cannot follow to stderr."""
    from mirelight.apps import realtime
    from mirelight.apps.realtime import pages
    from mirelight.batch.order import named
    from mirelight.cli.progress import duration
    from mirelight.io import job
    from mirelight.pipeline.plan import plan

    work = job.load(args.job, options.overrides(args))
    tasks = plan(
        work,
        cameras=named(args.camera, [x.name for x in work.cameras]),
        lightings=named(args.lighting, [x.name for x in work.lightings]),
    ).tasks
    names = [task.name for task in tasks]
    physical = pages.rendered(Path(args.beside), names) if args.beside is not None else {}
    first: Path | None = None  # its files serve the other frames
    files, notes = list[Path](), list[str]()
    shows, began = sys.stderr.isatty() and not args.quiet, time.monotonic()
    for k, task in enumerate(tasks, start=1):
        if task.lighting is None:
            raise InputError(work.source, "no light", "name lights or an environment to relight by", field="lights")
        folder = Path(args.out) / task.name
        left = (time.monotonic() - began) / (k - 1) * (len(tasks) - k + 1) if k > 1 else None
        line = f"frame {k} of {len(tasks)}{'' if left is None else f', about {duration(left)} left'}: {task.name}"
        if shows:
            say.live(line)
        made: realtime.Exported | realtime.EngineFrames
        if args.export_only:
            made = realtime.export(work, task.camera, task.lighting, folder, like=first)
        else:
            report = partial(_show, line) if shows else None
            made = realtime.render(work, task.camera, task.lighting, folder, like=first, report=report)
        pages.write(folder, names, physical.get(task.name))
        first = first or folder
        if shows:
            say.cleared()
        for warning in made.warnings:
            notes.append(f"{task.name}: {warning}")
            say.remark(notes[-1])
        files.append(folder / ("index.html" if args.export_only else "frame.png"))
        if not args.quiet and not args.json:
            say.result(files[-1])
    if args.json:
        say.as_json({"files": files, "frames": len(files), "notes": notes})
    return 0


COMMAND = Command(
    name="realtime",
    group="compare",
    help="render the frames of a job file with PlayCanvas, in headless Chromium",
    description="Export every camera and lighting of a job as a static page that runs PlayCanvas' own "
    "gsplat-relighting.mjs, render it in headless Chromium, and keep the engine's buffers. Each frame has a folder "
    "of its own, named as `mirelight render` names its files. Frames are rendered anew every time.",
    examples=(
        "realtime job.toml -o out/live",
        "realtime job.toml -o out/live --beside out --export-only",
    ),
    arguments=_arguments,
    call=run_realtime,
    page="real time",
)


def _show(line: str, doing: str) -> None:
    say.live(f"{line}: {doing}")
