"""`mirelight bake`: relit splats as a splat file."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from mirelight.base.errors import InputError
from mirelight.cli import options, outputs, say
from mirelight.cli.command import Command
from mirelight.io.suffixes import USD

if TYPE_CHECKING:
    from mirelight.io.job import JobTable, Source
    from mirelight.model import Job, SplatCloud

_SUFFIXES = (".compressed.ply", ".ply", ".sog", ".spz", ".splat", ".glb", *USD)  # what io.splats.write writes
_WORLD = (".glb", *USD)  # have a world of their own, which is the job's


def _arguments(parser: argparse.ArgumentParser) -> None:
    options.add_job(parser)
    parser.add_argument(
        "-o", "--out", metavar="FILE", required=True, help=f"the splats to write ({', '.join(_SUFFIXES)})"
    )
    parser.add_argument("--lighting", metavar="NAME", help="the lighting (the job's first)")
    parser.add_argument("--spp", dest="samples", metavar="N", type=int, default=64, help="samples a splat (64)")
    options.add_machine(parser)
    options.add_json(parser)
    options.add_quiet(parser)


def run_bake(args: argparse.Namespace) -> int:
    """The command. What was written goes to stdout, progress to stderr."""
    from mirelight.apps import bake as baking
    from mirelight.base.version import __version__
    from mirelight.cli.bar import bar
    from mirelight.io import splats
    from mirelight.io.job import parse
    from mirelight.io.job.build import build
    from mirelight.model.shown import count
    from mirelight.pipeline.plan import plan
    from mirelight.pipeline.scene import prepare

    out = outputs.named(args.out, "splats are", *_SUFFIXES)
    if not 1 <= args.samples <= 1 << 20:
        raise InputError("--spp", f"{args.samples} samples", "give 1 to 1048576")
    source, table = parse(args.job, options.overrides(args))
    work = build(source, table)
    outputs.spare([out], outputs.files_of(work))
    lighting = plan(work, None, args.lighting and [args.lighting]).tasks[0].lighting
    if lighting is None:
        raise InputError(work.source, "no light", "a bake needs lights", field="lights")
    with bar(args.quiet) as report:
        scene = prepare(work, progress=report)
        factor = baking.factors(scene, lighting, spp=args.samples, progress=report)
        baked = baking.relit(_as_named(source, table, work, out), factor, work.relight_of(lighting))
        of = f"{work.source.name}, lighting {lighting.name}, {args.samples} spp"
        comments = (f"relit by mirelight {__version__}: {of}",)
        if out.suffix.lower() in USD:
            _ = scene.mesh  # made now, where the job makes it from the splats
            baking.write_stage(out, baked, work, lighting)
        else:
            splats.write(baked, out, comments=comments)
    notes = []
    if len(table.splats or []) > 1:
        notes.append("several splat files are written as one, in world space")
    if work.compositor.holds_light and out.suffix.lower() not in _WORLD:
        space = work.compositor.color_space
        notes.append(f"{out.name} cannot say that its colours are {space}; viewers take them for display values")
    made = {"files": [out], "splats": len(baked), "lighting": lighting.name, "spp": args.samples, "notes": notes}
    say.outcome(args, made, [f"{out}: {count(len(baked), 'splat')} under {lighting.name!r}"], notes)
    return 0


COMMAND = Command(
    name="bake",
    group="render",
    help="write relit splats for any viewer",
    description="Write the splats of a job with the light of one of its lightings in their colours.",
    examples=(
        "bake job.toml -o relit.ply",
        "bake job.toml -o relit.sog --lighting night --spp 256",
    ),
    arguments=_arguments,
    call=run_bake,
    page="baking",
)


def _as_named(source: Source, table: JobTable, work: Job, out: Path) -> SplatCloud:
    """The splats in their file's own axes, as the capture's viewer had them; of several files, and as glTF or a
    stage, in world space."""
    from mirelight.io import splats

    assert work.splats is not None
    tables = table.splats or []
    if len(tables) == 1 and out.suffix.lower() not in _WORLD:
        cloud = splats.read(source.folder / tables[0].path, lod=tables[0].lod)
        return replace(cloud, color_space=work.compositor.color_space)  # the job may know better than the file
    return work.splats.value
