"""`mirelight inspect`: the facts of a file; of a job also whether it will render well."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from mirelight.base.errors import BackendError, InputError
from mirelight.cli import options
from mirelight.cli.command import Command

if TYPE_CHECKING:
    from mirelight.model import Job
    from mirelight.pipeline.job_diagnostics import Check


def _arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", metavar="FILE", help="the file")
    options.add_json(parser)
    parser.add_argument(
        "--heat",
        metavar="DIR",
        help="of a job: write a picture for each camera of where the proxy misfits (red: uncovered, blue: past the "
        "splats, yellow: off their surface)",
    )


def run_inspect(args: argparse.Namespace) -> int:
    """The command. Facts go to stdout."""
    from mirelight.apps.inspect.facts import as_json
    from mirelight.apps.inspect.inspect import inspect, of_job
    from mirelight.cli import say
    from mirelight.cli.bar import bar
    from mirelight.cli.report import fit_json, fit_lines, lines

    if Path(args.file).suffix.lower() != ".toml":
        if args.heat is not None:
            raise InputError(
                args.file, "--heat shows how the proxy of a job fits its splats", "give a job file (.toml)"
            )
        with bar(args.json):
            facts, found = inspect(args.file), None
    else:
        from mirelight.io import job

        with bar(args.json):
            work = job.load(args.file)
            _supply(work)
            facts = of_job(work, args.file)
            found = None if facts.proxy_to_make else _checked(work, args.heat)
        if args.heat is not None and (found is None or found.quality is None):
            raise InputError(args.file, "nothing to compare for --heat", _missing(work))
    if args.json:
        say.as_json(as_json(facts) | ({} if found is None else fit_json(found)))
        return 0
    say.result("\n".join([*lines(facts), *(() if found is None else fit_lines(found))]))
    if args.heat is not None:
        say.result(f"  heat maps    {args.heat} (red: uncovered, blue: past the splats, yellow: off their surface)")
    return 0


COMMAND = Command(
    name="inspect",
    group="look",
    help="say what is in a splat, mesh, glTF, image or job file",
    description="Counts, bounds, lights, cameras, and the memory that a file will take. Of a job also what would "
    "be wrong with its frames: a proxy that does not fit the splats, cameras that see nothing, lights that reach "
    "nothing.",
    examples=(
        "inspect capture.ply",
        "inspect job.toml --heat out/heat",
        "inspect proxy.glb --json",
    ),
    arguments=_arguments,
    call=run_inspect,
    page="command line",
)


def _supply(work: Job) -> None:
    """The proxy that is made from the splats, where an earlier render has kept it."""
    if work.made_proxy is None:
        return
    from mirelight.pipeline.cache import UserCache
    from mirelight.pipeline.codecs import MESH
    from mirelight.pipeline.keys import Keys
    from mirelight.store import Store

    key = Keys(work).made_proxy
    kept = Store(work).artefacts.get(key, MESH)
    if kept is None:
        kept = UserCache().get(key, MESH)
    if kept is not None:
        work.made_proxy.mesh.supply(kept)


def _checked(work: Job, heat: str | None) -> Check | None:
    """What a look at the job finds; None where this machine has nothing to look with and no picture is asked for."""
    from mirelight.pipeline.job_diagnostics import check

    try:
        found = check(work, every_camera=heat is not None)
    except BackendError:
        if heat is not None:
            raise
        return None
    if heat is not None and found.quality is not None:
        from mirelight.io.folders import NewFolders
        from mirelight.io.png import write_png
        from mirelight.pipeline.plan import camera_names

        folder = Path(heat)
        NewFolders(folder).make()
        for name, view in zip(camera_names(work.cameras), found.quality.by_view, strict=True):
            write_png(folder / f"{name}.png", view.heat, {})
    return found


def _missing(work: Job) -> str:
    if work.splats is None or work.proxy is None:
        return f"the job names no {'splats' if work.splats is None else 'proxy'}"
    if work.made_proxy is not None and not work.made_proxy.mesh.is_there:
        return "its proxy is made from the splats by the first render"
    return "its splats have no surface"
