"""`mirelight proxy`: a proxy mesh made from splats, and how well it fits them."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from mirelight.base.errors import InputError
from mirelight.cli import options, outputs, say
from mirelight.cli.command import Command
from mirelight.io.suffixes import GLTF

if TYPE_CHECKING:
    from mirelight.base.progress import ShareProgress
    from mirelight.model import Camera, ProxyMesh, SplatCloud
    from mirelight.proxy import ProxyQuality

FEWEST = 100  # triangles: fewer stand for nothing


def _arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "splats", metavar="CAPTURE|JOB", help="the capture: any splat file; or a job, for its own proxy"
    )
    parser.add_argument("-o", "--out", metavar="FILE", required=True, help="the mesh to write (.glb)")
    parser.add_argument(
        "--fit", metavar="MESH", help="move this mesh onto the splats (turned, scaled, then bent) instead of making one"
    )
    parser.add_argument(
        "--cameras",
        metavar="FILE",
        help="the capture's cameras: it is looked at from there, and what they did not see is closed against light",
    )
    parser.add_argument(
        "--no-ceiling",
        action="store_true",
        help="leave a room open above its pictures: for a yard with walls all round, captured without its sky",
    )
    parser.add_argument("--triangles", metavar="N", type=int, help="make no more than about N")
    options.add_json(parser)
    options.add_quiet(parser)


def run_proxy(args: argparse.Namespace) -> int:
    """The command. The quality goes to stdout, progress to stderr."""
    from mirelight.cli.bar import bar
    from mirelight.cli.report import quality_json
    from mirelight.io import splats
    from mirelight.io.gltf.write import write_glb
    from mirelight.io.png import write_png

    out = outputs.named(args.out, "a proxy is", ".glb")
    if args.triangles is not None and (args.triangles < FEWEST or args.fit is not None):
        remedy = "leave it out" if args.fit is not None else f"give {FEWEST} or more"
        raise InputError("--triangles", f"{args.triangles}{' with --fit' if args.fit is not None else ''}", remedy)
    if args.splats.lower().endswith(".toml"):
        return _of_job(args, out)
    outputs.spare([out], [Path(path) for path in (args.splats, args.fit, args.cameras) if path is not None])
    heat = out.with_suffix(".heat.png")
    with bar(args.quiet) as report:
        cloud = splats.read(args.splats)
        how, mesh, quality, before = _made(cloud, args, report)
        write_glb(out, mesh)
        write_png(heat, quality.heat, {})
    earlier = None if before is None else quality_json(before)
    found = {"triangles": quality.triangles, "how": how, "fit": quality_json(quality), "fit_before": earlier}
    shown = f"  heat map     {heat} (red: uncovered, blue: past the splats, yellow: off their surface)"
    said = [f"{out}: {how}", *table(quality, before, own=args.fit is None), shown]
    say.outcome(args, {"files": [out, heat], **found, "notes": quality.advice}, said)
    return 0


COMMAND = Command(
    name="proxy",
    group="start",
    help="make a proxy mesh from splats",
    description="Make the triangle mesh that light falls on from the splats of a capture alone, say how well it "
    "fits them, and write a heat map of it beside the mesh. Of a job it writes the proxy as it stands in the job's "
    "world, with the colours that light meets and the job's cameras: for Blender and other tools.",
    examples=(
        "proxy capture.ply -o proxy.glb",
        "proxy capture.ply -o proxy.glb --triangles 20000",
        "proxy capture.ply --fit scan.glb -o proxy.glb",
        "proxy job.toml -o room.glb",
    ),
    arguments=_arguments,
    call=run_proxy,
    page="proxy",
)


def _of_job(args: argparse.Namespace, out: Path) -> int:
    """The command for a job: whatever its proxy is, in the world's axes."""
    from mirelight.cli.bar import bar
    from mirelight.io import job
    from mirelight.io.gltf.write import holds_camera, write_glb
    from mirelight.pipeline.artefact_cache import NullCache
    from mirelight.pipeline.scene import Scene

    for name in ("fit", "cameras", "triangles"):
        if getattr(args, name) is not None:
            raise InputError(f"--{name}", "given with a job", "leave it out; the job's own proxy is written")
    work = job.load(args.splats)
    if work.proxy is None:
        raise InputError(work.source, "no proxy", 'name one: proxy = "splats" makes it', field="proxy")
    outputs.spare([out], outputs.files_of(work))
    with bar(args.quiet) as progress:
        mesh = Scene(work, NullCache(), None if args.quiet else say.remark, progress).proxy
    assert mesh is not None
    cameras = [x for x in work.cameras if holds_camera(x)]
    write_glb(out, mesh, cameras=cameras)
    colours = "" if mesh.vertex_colors is None else " with the capture's colours"
    said = f"{out}: {len(mesh.faces):,} triangles{colours}, {len(cameras)} cameras, in the job's world"
    say.outcome(args, {"files": [out], "triangles": len(mesh.faces), "cameras": len(cameras)}, [said])
    return 0


def _made(
    cloud: SplatCloud, args: argparse.Namespace, report: ShareProgress
) -> tuple[str, ProxyMesh, ProxyQuality, ProxyQuality | None]:
    """How it was made, the mesh, its quality, and what the quality was before a fit."""
    from mirelight.io.mesh import read_mesh
    from mirelight.model import shown
    from mirelight.pipeline.guesses import guessed_of_file
    from mirelight.proxy import ProxySettings, judge, make, register
    from mirelight.proxy.judge import seen_by

    cameras = _cameras(args.cameras, Path(args.splats), cloud) if args.cameras is not None else ()
    if args.fit is None:
        settings = ProxySettings(triangles=args.triangles, ceiling=not args.no_ceiling)
        guess = partial(guessed_of_file, Path(args.splats), lambda: cloud)
        made = make(cloud, settings, report, cameras=cameras, source=args.splats, guess=guess)
        how = f"by {_METHODS[made.method]}, in {made.seconds:.0f} s"
        if cameras:
            how += f"; {made.unseen:,} triangles more close what its {len(cameras):,} cameras did not see"
        elif made.guessed:
            how += f"; from {shown.count(made.guessed, 'guessed view')}, as no cameras are given: --cameras is surer"
        if made.mirrors:
            how += f"; {shown.count(made.mirrors, 'mirror')}, through which no light comes"
        if made.ceiling is not None:
            how += f"; a ceiling is guessed {made.ceiling:.3g} over the floor, above all pictures (--no-ceiling: none)"
        return how, made.mesh, made.quality, None
    mesh = read_mesh(args.fit)
    looked = seen_by(cameras) if cameras else None
    before = judge(cloud, mesh, looked, captured=cameras, source=args.splats)
    fitted = register(cloud, mesh, report, cameras=cameras, source=args.fit)
    return (
        f"{args.fit} fitted to the splats",
        fitted,
        judge(cloud, fitted, looked, captured=cameras, source=args.splats),
        before,
    )


def _cameras(path: str, capture: Path, cloud: SplatCloud) -> list[Camera]:
    """Of a file, in the splats' world."""
    if path.lower().endswith(GLTF):
        from mirelight.io.gltf.scene import read_cameras

        found = [x.to_camera(*_SIZE) for x in read_cameras(Path(path))]
    else:
        from mirelight.apps.first_job import own_cameras
        from mirelight.io.splats.training import resolved

        brought, _ = own_cameras.find(resolved(capture), cloud, Path(path))
        found = [x.to_camera(x.size(_SIZE)) for x in brought.cameras] if brought is not None else []
    if not found:
        raise InputError(path, "no cameras", "give the capture's cameras, or leave --cameras out")
    return found


_SIZE = (1280, 720)  # pixels of cameras whose file gives none
_METHODS = {"cells": "cells of the splats' planes", "depth": "depth maps"}


def table(quality: ProxyQuality, before: ProxyQuality | None = None, *, own: bool = False) -> Iterator[str]:
    """The figures, a line each, and the advice; `own`: the mesh was made from the splats."""
    from mirelight.cli.report import pictures_line
    from mirelight.proxy.advice import UNEXPLAINED

    size = quality.size

    def was(share: Callable[[ProxyQuality], float]) -> str:
        value = math.nan if before is None else share(before)
        return "" if math.isnan(value) else f", {value:.1%} before"  # what covered no splat had no gap

    yield f"  triangles    {quality.triangles:,}"
    yield (
        f"  uncovered    {quality.uncovered:.1%} of the splats' pixels{was(lambda x: x.uncovered)} "
        "(right proxies leave 3 to 13 %)"
    )
    if math.isnan(quality.gap_median):
        yield "  depth gap    not known, as it covers none of the splats' pixels"
    else:
        yield (
            f"  depth gap    {quality.gap_median:.3g} units median, {quality.gap_95:.3g} at 95 % "
            f"({quality.gap_median / size:.2%} and {quality.gap_95 / size:.2%} of the size"
            f"{was(lambda x: x.gap_median / x.size)})"
        )
    if not math.isnan(quality.wavy):
        yield (
            f"  planes       {quality.wavy:.1f}° off in the median, {quality.wavy_90:.1f}° at 90 %"
            f"{'' if before is None or math.isnan(before.wavy) else f', {before.wavy:.1f}° before'}"
        )
    if not math.isnan(quality.pictures.apart):
        yield f"  colours      {pictures_line(quality)}{was(lambda x: x.pictures.apart / x.size)}"
    yield f"  leaks        {quality.leaks:.1%} of the proxy's pixels show no splats{was(lambda x: x.leaks)}"
    other = (
        "the splats have no clear surface there"
        if own
        else "one made from the splats may serve better (leave out --fit)"
    )
    for line in quality.advice:
        yield f"  ! {f'see the heat map; {other}' if line == UNEXPLAINED else line}"
