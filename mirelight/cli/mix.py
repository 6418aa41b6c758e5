"""`mirelight mix`: the job's light on its splats, to be mixed live in a browser."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from mirelight.base.errors import InputError, MirelightError
from mirelight.cli import options, outputs, say
from mirelight.cli.command import Command

if TYPE_CHECKING:
    from mirelight.apps.mixer import Exported
    from mirelight.apps.mixer.saved import Saved
    from mirelight.model import Job
    from mirelight.pipeline.scene import Scene


def _arguments(parser: argparse.ArgumentParser) -> None:
    options.add_job(parser)
    parser.add_argument("-o", "--out", metavar="DIR", required=True, help="write the page there")
    parser.add_argument("--spp", dest="samples", metavar="N", type=int, default=64, help="samples a splat (64)")
    options.add_lightings(parser)
    options.add_machine(parser)
    parser.add_argument("--serve", action="store_true", help="serve the page on this machine, until Ctrl-C")
    parser.add_argument("--port", metavar="N", type=int, help="of the server (default: a free one)")
    options.add_json(parser)
    options.add_quiet(parser, "warnings and errors")


def run_mix(args: argparse.Namespace) -> int:
    """The command. The page's path goes to stdout, the rest to stderr."""
    from mirelight.apps.mixer.saved import Saved
    from mirelight.apps.mixer.server import claimed
    from mirelight.batch.order import named
    from mirelight.io import job
    from mirelight.io.folders import NewFolders
    from mirelight.pipeline.plan import chosen
    from mirelight.pipeline.requirements import check_lit_splats

    overrides = options.overrides(args)
    work = job.load(args.job, overrides)
    check_lit_splats(work)
    if not 1 <= args.samples <= 1_000_000:
        raise InputError("--spp", str(args.samples), "give 1 to 1000000")
    if args.port is not None and not (args.serve and 1 <= args.port <= 65535):
        found = str(args.port) if args.serve else "a port, but nothing is served"
        raise InputError("--port", found, "give 1 to 65535" if args.serve else "add --serve")
    wanted = named(args.lighting, [x.name for x in work.lightings])
    chosen(work, "lighting", work.lightings, wanted)
    saved = Saved(job.parse(args.job, overrides)[0]) if args.serve else None
    folder = Path(args.out)
    if folder.exists() and not folder.is_dir():
        raise InputError(folder, "a file", "name a folder to write into")
    outputs.own(folder / "index.html", "<title>mirelight: light mixer</title>")
    new = NewFolders(folder)
    try:
        new.make()
        with claimed(folder):
            _mix(args, work, wanted, saved)
    except MirelightError:
        new.remove()
        raise
    return 0


COMMAND = Command(
    name="mix",
    group="look",
    help="write a page that mixes the job's lights live",
    description="Trace each light, group and environment of a job's lightings once, on every splat, and write a "
    "static page that shows the capture in PlayCanvas with a slider and a colour for each of them. What the page "
    "exports, `mirelight render` takes. With --serve, lights can be moved on the page and are traced anew.",
    examples=(
        "mix job.toml -o out/page",
        "mix job.toml -o out/page --serve",
    ),
    arguments=_arguments,
    call=run_mix,
    page="mixer",
)


def _mix(args: argparse.Namespace, work: Job, wanted: Sequence[str] | None, saved: Saved | None) -> None:
    from mirelight.apps import mixer as mixing
    from mirelight.pipeline.scene import prepare
    from mirelight.store import Store

    live = sys.stderr.isatty() and not args.quiet

    def report(what: str, done: float) -> None:
        say.live(f"light on splats, {what}: {done:.0%}")

    def shared(what: str, done: float) -> None:
        if live:
            say.live(f"{what}: {done:.0%}")

    def note(line: str) -> None:
        if live:
            say.cleared()
        if not args.quiet:
            say.remark(line)

    store = Store(work)
    store.open()
    store.hear(say.remark)
    try:
        scene = prepare(work, store.artefacts, note, progress=shared)
        made = mixing.export(
            scene,
            args.out,
            spp=args.samples,
            lightings=None if wanted is None else tuple(wanted),
            progress=report if live else None,
        )
        if live:
            say.cleared()
        for line in made.warnings:
            say.remark(line)
        if saved is not None:
            _serve(scene, made, saved, args)
        elif args.json:
            _print_json(made)
        elif not args.quiet:
            say.result(made.folder / "index.html")
    except MirelightError:
        store.withdraw()
        raise
    finally:
        store.close()
        if live:
            say.cleared()


def _print_json(made: Exported, **more: str) -> None:
    say.as_json({"files": [made.folder / "index.html"], **more, "notes": made.warnings})


def _serve(scene: Scene, made: Exported, saved: Saved, args: argparse.Namespace) -> None:
    """Until Ctrl-C, which ends it well."""
    from mirelight.apps.mixer.server import serving
    from mirelight.apps.mixer.session import Session

    try:
        session = Session(scene, made.layers, tell=say.remark, order=made.order)
        with serving(session, made.folder, saved, args.port or 0) as address:
            if args.json:
                _print_json(made, address=address)
            else:
                say.result(address)
            session.run()
    except KeyboardInterrupt:
        say.remark("the page is no longer served")
