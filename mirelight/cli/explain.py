"""`mirelight explain`: where the difference between the real-time frame and the physical one comes from."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from mirelight.base.errors import BackendError, InputError
from mirelight.cli import options, say
from mirelight.cli.command import Command

if TYPE_CHECKING:
    from mirelight.model import Camera, Job, Lighting


def _arguments(parser: argparse.ArgumentParser) -> None:
    options.add_job(parser)
    parser.add_argument(
        "-o", "--out", metavar="DIR", required=True, help="write explain.html, explain.json and the pictures there"
    )
    parser.add_argument("--camera", metavar="NAME", help="the camera (the job's first)")
    parser.add_argument("--lighting", metavar="NAME", help="the lighting (the job's first)")
    options.add_tracing(parser)
    parser.add_argument(
        "--no-engine", action="store_true", help="start from mirelight's prediction instead of the engine's own frame"
    )
    options.add_json(parser)
    parser.add_argument("-q", "--quiet", action="store_true", help="print no table")


def run_explain(args: argparse.Namespace) -> int:
    """The command. The table goes to stdout, progress and what could not be done to stderr."""
    from mirelight.apps.explain.ladder import explain, require
    from mirelight.apps.explain.recipe import EngineRun, run_engine
    from mirelight.apps.explain.report import write_ladder
    from mirelight.apps.explain.types import as_json, summary
    from mirelight.compare import metrics
    from mirelight.io import job

    def report(line: str) -> None:
        if not args.quiet:
            say.remark(line)

    metrics.require(flip_alone=True)
    work = job.load(args.job, options.overrides(args))
    name, camera, lighting = _frame(work, args.camera, args.lighting)
    require(work, camera)
    folder = Path(args.out)
    run: EngineRun | None = None
    if not args.no_engine:
        report("rendering with the real engine")
        try:
            run = run_engine(work, camera, lighting, folder / "engine")
        except BackendError as error:
            say.remark(str(error))
            say.remark("the ladder starts from mirelight's prediction of the engine instead")
    ladder = replace(explain(work, camera, lighting, run, report), name=name)
    write_ladder(folder, ladder)
    said = [summary(ladder), f"{folder / 'explain.html'} shows each step"]
    say.outcome(args, {"folder": folder, **as_json(ladder)}, said)
    return 0


COMMAND = Command(
    name="explain",
    group="compare",
    help="say where the difference from real time comes from",
    description="Turn the real-time engine's frame of a job into the physical one, one cause at a time, and write "
    "each step as a picture and numbers that add up. One frame: the job's first camera and lighting, or others by "
    "name.",
    examples=(
        "explain job.toml -o out/why",
        "explain job.toml -o out/why --camera front --lighting night",
    ),
    arguments=_arguments,
    call=run_explain,
    page="explaining",
)


def _frame(work: Job, camera: str | None, lighting: str | None) -> tuple[str, Camera, Lighting]:
    """The name, camera and lighting of the frame that is meant."""
    from mirelight.pipeline.plan import plan

    task = plan(work, None if camera is None else [camera], None if lighting is None else [lighting]).tasks[0]
    if task.lighting is None:
        raise InputError(work.source, "no light", "a ladder needs splats, a proxy and light", field="lights")
    return task.name, task.camera, task.lighting
