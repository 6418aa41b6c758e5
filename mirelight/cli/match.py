"""`mirelight match`: lights found from a picture, as a new job file."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from mirelight.base.errors import InputError, OutputError
from mirelight.cli import options, outputs, say
from mirelight.cli.command import Command

if TYPE_CHECKING:
    from mirelight.apps.match import LayerMatch, Match


def _arguments(parser: argparse.ArgumentParser) -> None:
    options.add_job(parser)
    parser.add_argument(
        "--target",
        metavar="PICTURE",
        required=True,
        action="append",
        help="the picture: EXR (linear), or PNG or JPEG as displayed (repeatable, with a --camera each)",
    )
    parser.add_argument("-o", "--out", metavar="FILE", required=True, help="the job file to write (.toml)")
    parser.add_argument(
        "--camera", metavar="NAME", action="append", help="the picture's camera (the job's first); one for each picture"
    )
    parser.add_argument("--lighting", metavar="NAME", help="the lighting to fit (the job's first)")
    parser.add_argument(
        "--lights", metavar="NAME", nargs="+", action="extend", help="find only these; other lights stay as they are"
    )
    parser.add_argument(
        "--mask",
        metavar="PICTURE",
        action="append",
        help="where the picture counts: white yes, black no; one for each picture, or none",
    )
    parser.add_argument("--keep-colours", action="store_true", help="find intensities only; colours stay as they are")
    parser.add_argument("--rotate", action="store_true", help="find the environment's rotation, too")
    options.add_tracing(parser)
    options.add_json(parser)
    options.add_quiet(parser)


def run_match(args: argparse.Namespace) -> int:
    """The command. What was found goes to stdout, progress to stderr."""
    from mirelight.apps.match import match, read_target
    from mirelight.cli.bar import bar
    from mirelight.io.atomic import write_file
    from mirelight.io.job import parse
    from mirelight.io.job.build import build
    from mirelight.io.job.write import with_lighting
    from mirelight.pipeline.plan import plan
    from mirelight.pipeline.scene import prepare

    out = outputs.named(args.out, "a job is", ".toml")
    if out.exists() and out.resolve() == Path(args.job).resolve():
        raise OutputError(f"{out}: the job itself; give another name")
    _require_one_each(args)
    source, table = parse(args.job, options.overrides(args))
    work = build(source, table)
    chosen = [plan(work, [x] if x else None, args.lighting and [args.lighting]).tasks[0] for x in args.camera or [None]]
    lighting = chosen[0].lighting
    if lighting is None:
        raise InputError(work.source, "no light", "a match needs lights to fit", field="lights")
    with_lighting(source, work, lighting, out, ())  # what cannot be written is said before anything is traced
    masks = args.mask or [None] * len(args.target)
    targets = [read_target(x, mask, work.display.tone) for x, mask in zip(args.target, masks, strict=True)]
    shots = [(x.camera, target) for x, target in zip(chosen, targets, strict=True)]
    with bar(args.quiet) as report:
        found = match(
            prepare(work, report=_say(args.quiet), progress=report),
            shots,
            lighting,
            free=args.lights,
            keep_colours=args.keep_colours,
            rotate=args.rotate,
            report=report,
        )
    pictures = ", ".join(x.path.name for x in targets)
    made = f"{Path(args.job).name} with {found.lighting.name!r} matched to {pictures} by mirelight match"
    known = [f"{x.name}: give or take {_percent(x)}" for x in found.layers if x.seen and not x.fixed]
    remarks = (made, f"(camera {', '.join(repr(x.camera.name) for x in chosen)}, {_gain(found)})", *known)
    text = with_lighting(source, work, found.lighting, out, remarks)
    write_file(out, text)
    layers = [{k: v for k, v in asdict(x).items() if k != "keeps_colour"} for x in found.layers]
    gain = {"psnr_before": found.psnr_before, "psnr_after": found.psnr_after, "rotation": found.rotation}
    said = [f"{out}: {found.lighting.name}, {_gain(found)}", *(f"  {_line(layer)}" for layer in found.layers)]
    said += [] if found.rotation is None else [f"  environment turned to {found.rotation:g} degrees"]
    say.outcome(args, {"files": [out], "lighting": found.lighting.name, **gain, "layers": layers}, said)
    return 0


COMMAND = Command(
    name="match",
    group="render",
    help="find lights from a picture",
    description="Find intensities and colours of a job's lights with which its frame comes closest to a reference "
    "picture or paint-over, and write the job with them. Lights stay where they are.",
    examples=(
        "match job.toml --target paint-over.png -o matched.toml",
        "match job.toml --target photo.exr --camera front --lights lamp key -o matched.toml",
    ),
    arguments=_arguments,
    call=run_match,
    page="match",
)


def _require_one_each(args: argparse.Namespace) -> None:
    """A camera, and a mask where there are any, for each picture."""
    pictures, cameras, masks = len(args.target), args.camera or (), args.mask or ()
    if len(cameras) != pictures and (cameras or pictures > 1):
        raise InputError(
            "--camera", f"{len(cameras)} for {pictures} of --target", "name one for each picture, in order"
        )
    if masks and len(masks) != pictures:
        raise InputError("--mask", f"{len(masks)} for {pictures} of --target", "give one for each picture, in order")


def _gain(found: Match) -> str:
    return f"{found.psnr_before:.1f} dB before, {found.psnr_after:.1f} dB after"


def _line(layer: LayerMatch) -> str:
    def said(values: object) -> str:
        return "(" + ", ".join(f"{x:.4g}" for x in values) + ")"  # type: ignore[attr-defined]

    if layer.fixed:
        return f"{layer.name}: {said(layer.before)}, left as it was"
    if not layer.seen:
        return f"{layer.name}: the picture does not show its light; left at {said(layer.before)}"
    return f"{layer.name}: {said(layer.after)}, was {said(layer.before)}; give or take {_percent(layer)}"


def _percent(layer: LayerMatch) -> str:
    """How far red, green and blue, or all of it, may be off; a question mark where that is more than they are."""
    off = layer.relative_uncertainty
    said = ["?" if x > 1 else f"{100 * x:.2g}" for x in ([off.max()] if layer.keeps_colour else off)]
    return f"{said[0]} %" if layer.keeps_colour else f"({', '.join(said)}) %"


def _say(quiet: bool) -> Callable[[str], None] | None:
    return None if quiet else say.remark
