"""`mirelight estimate`: the light that splats were captured under."""

from __future__ import annotations

import argparse
import math
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from mirelight.base.errors import InputError
from mirelight.cli import options, outputs, say
from mirelight.cli.command import Command
from mirelight.io.suffixes import GLTF

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from mirelight.model import Camera, EstimatedSky, Job, Light, Lighting
    from mirelight.pipeline.scene import Scene

WIDEST = 480  # pixels of each of the three pictures
SPP = 64  # noise would be taken for misfits
_MOST_STOPS = 20.0
_SHEETS = (  # what the pictures show, of the light and of materials
    "captured | irradiance | captured / irradiance (no shadows should be left)",
    "the surface's colours | gloss (smooth is bright, metal yellow) | what it mirrors",
)


def _arguments(parser: argparse.ArgumentParser) -> None:
    options.add_job(parser, "job file (TOML) that names splats and a proxy")
    parser.add_argument("-o", "--out", metavar="FILE", required=True, help="what to write (.toml, .glb, .gltf)")
    parser.add_argument(
        "--exposure", metavar="STOPS", type=_stops, default=0.0, help="make the light stronger by so many stops (0)"
    )
    parser.add_argument("--camera", metavar="NAME", help="the picture's camera (the job's first)")
    parser.add_argument(
        "--materials",
        metavar="FILE",
        help="write the proxy with the gloss of its parts, too (.glb), told by how the capture's pictures change",
    )
    options.add_machine(parser)
    options.add_json(parser)
    options.add_quiet(parser)


def run_estimate(args: argparse.Namespace) -> int:
    """The command. What was found goes to stdout."""
    from mirelight.cli.bar import bar
    from mirelight.estimate.describe import described, unknown
    from mirelight.io.environment import write_environment
    from mirelight.io.gltf.write import check_light
    from mirelight.io.png import write_png
    from mirelight.model import EstimatedSky
    from mirelight.pipeline.artefact_cache import NullCache
    from mirelight.pipeline.scene import Scene

    work, out, glossy = _asked(args)
    camera = _camera(work, args.camera)
    asked = work.captured.sky if work.captured is not None else None
    lights = asked.lights if isinstance(asked, EstimatedSky) else ()
    if out.suffix.lower() in GLTF:
        for light in lights:
            check_light(out, light)
    sky = _sky(work, args.exposure, lights)
    with bar(args.quiet) as progress:
        # unchecked: nothing is rendered of it
        scene = Scene(work, NullCache(), None if args.quiet else say.remark, progress)
        found = scene.estimate(sky)
        scene.keep_estimate(sky, found)
    exr = out.with_suffix(".exr")
    lines, doubts = list(described(found)), list(unknown(found))
    around = found.lighting.environment
    assert around is not None
    notes = ["Captured light, estimated from splats and proxy.", *lines, *(f"not known: {line}" for line in doubts)]
    write_environment(exr, around.pixels)
    use, files = _written(out, exr, work, found.lighting, notes)
    if camera is not None:
        files.append(out.with_suffix(".png"))
        write_png(files[-1], _picture(scene, found.lighting, _small(camera)), {})
    if glossy is not None:
        lines += _materials(work, scene, found.lighting, glossy, camera, files, None if args.quiet else say.remark)
    _tell(args, files, use, found.lighting, lines, doubts)
    return 0


def _tell(
    args: argparse.Namespace, files: list[Path], use: str, light: Lighting, lines: list[str], doubts: list[str]
) -> None:
    """What was written, found and doubted."""
    from mirelight.apps.inspect.facts import as_json, lighting_facts

    captured = as_json(lighting_facts(light))
    made = {"files": files, "captured": captured, "use": use, "notes": lines, "unknown": doubts}
    pictures = zip([x for x in files if x.suffix == ".png"], _SHEETS, strict=False)
    shown = (f"  picture      {path}: {shows}" for path, shows in pictures)
    said = (*(f"  {line}" for line in lines), *(f"  ? not known  {line}" for line in doubts))
    say.outcome(args, made, [use, *said, *shown])


def _asked(args: argparse.Namespace) -> tuple[Job, Path, Path | None]:
    """The job, and the files to write: light and, where asked for, materials."""
    from mirelight.io import job

    out = outputs.named(args.out, "light is", ".toml", *GLTF)
    glossy = None if args.materials is None else outputs.named(args.materials, "materials are", ".glb")
    work = job.load(args.job, options.overrides(args))
    if work.splats is None or work.proxy is None:
        missing = "splats" if work.splats is None else "proxy"
        remedy = "both are needed: splats show the light, the proxy's shadows tell where it came from"
        raise InputError(work.source, f"no {missing}", remedy, field=missing)
    if glossy is not None and not work.capture_cameras:
        remedy = "materials are told by its pictures; name its cameras beside the proxy"
        raise InputError(work.source, "no cameras of the capture", remedy, field="proxy.cameras")
    written = [out, *(out.with_suffix(suffix) for suffix in (".exr", ".png"))]
    written += [] if glossy is None else [glossy, glossy.with_suffix(".png")]
    outputs.spare(written, outputs.files_of(work))
    return work, out, glossy


COMMAND = Command(
    name="estimate",
    group="start",
    help="find the light that splats were captured under",
    description="Find the sun, sky and lamps under which the splats of a job were captured, from the splats and "
    "the proxy alone. Writes them as a table [captured] to paste into the job and edit, or as a glTF file to edit "
    "in Blender; the map of the sky beside it (.exr); and a picture to judge it by (.png): captured, irradiance, "
    "captured / irradiance.",
    examples=(
        "estimate job.toml -o captured.toml",
        "estimate job.toml -o captured.glb --camera front",
    ),
    arguments=_arguments,
    call=run_estimate,
    page="captured light",
)


def _materials(
    work: Job,
    scene: Scene,
    light: Lighting,
    out: Path,
    camera: Camera | None,
    files: list[Path],
    report: Callable[[str], None] | None,
) -> list[str]:
    """Write the proxy with its materials, and a picture of them; a line on each part that has a gloss."""
    from mirelight.estimate import finish
    from mirelight.estimate.pictures import finish_sheet
    from mirelight.io.gltf.write import write_glb
    from mirelight.io.png import write_png
    from mirelight.lighting import colored_by

    splats, mesh, views = scene.splats, scene.mesh, scene.views
    assert splats is not None and mesh is not None
    if not views:
        found, remedy = "splats that are discs", "materials are told by pictures, which are not looked at for those"
        raise InputError(work.source, found, remedy, field="splats")
    colored = replace(colored_by(splats, mesh, light, work.render, views), albedo=None)
    regions, names = finish.regions_of(colored, work.render.seed)
    told = finish.finishes(colored, regions, names, light, views, work.render, report)
    glossy = finish.finished(colored, regions, told)
    write_glb(out, glossy)
    files.append(out)
    if camera is not None:
        files.append(out.with_suffix(".png"))
        write_png(files[-1], finish_sheet(glossy, light, _small(camera), work.render), {})
    none = "all matt: no part's colours change with the view as a gloss makes them change"
    return [f"materials    {line}" for line in [x.line for x in told if x.is_told] or [none]]


def _sky(work: Job, exposure: float, lights: tuple[Light, ...]) -> EstimatedSky:
    """What a job asks for whose captured light is this estimate."""
    from mirelight.model import EstimatedSky

    assert work.splats is not None and work.proxy is not None
    splats, proxy = work.splats.digest, work.proxy.digest
    return EstimatedSky(splats=splats, proxy=proxy, seed=work.render.seed, exposure=exposure, lights=lights)


def _written(out: Path, exr: Path, work: Job, lighting: Lighting, notes: list[str]) -> tuple[str, list[Path]]:
    """Write the lights as a table or as glTF; says how the job takes them, and which files there are with the map."""
    from mirelight.io.atomic import write_file
    from mirelight.io.gltf.write import write_lights
    from mirelight.io.job.captured_text import captured_text

    def named(path: Path) -> str:
        return os.path.relpath(path.resolve(), work.source.resolve().parent).replace(os.sep, "/")

    if out.suffix.lower() not in GLTF:
        write_file(out, captured_text(lighting, named(exr), notes))
        return f"{out}: paste it into {work.source.name} (the map is {exr.name})", [out, exr]
    shining = [replace(light, group=None) for light in lighting.lights if light.intensity > 0]
    around = f"environment = {{ path = {_quoted(named(exr))} }}"
    if not shining:
        none = f"no sun and no lamp was found, so {out.name} is not written"
        return f"{exr}: {none}; in {work.source.name}: captured = {{ {around} }}", [exr]
    write_lights(out, shining, notes)
    lamps = f'lights_from = {{ path = {_quoted(named(out))}, unit = "khr" }}'
    return f"{out}: in {work.source.name}: captured = {{ {lamps}, {around} }}", [out, exr]


def _quoted(text: str) -> str:
    import json

    return json.dumps(text, ensure_ascii=False)


def _camera(work: Job, name: str | None) -> Camera | None:
    """The camera of that name, or the first; None where the job has none."""
    if name is None:
        return work.cameras[0] if work.cameras else None
    from mirelight.pipeline.plan import chosen

    return chosen(work, "camera", work.cameras, [name])[0]


def _picture(scene: Scene, lighting: Lighting, camera: Camera) -> NDArray[np.uint8]:
    """The sheet of one camera, its proxy in the splats' colours; found where the user's cache has it, or made."""
    from mirelight.estimate.pictures import sheet
    from mirelight.model import digest
    from mirelight.pipeline.cache import UserCache
    from mirelight.pipeline.codecs import array_of
    from mirelight.pipeline.scene import prepare
    from mirelight.relighting import unlit_rgba

    work = scene.job
    shown = prepare(
        replace(
            work,
            captured=lighting,
            albedo_from_splats=True,
            render=replace(work.render, profile="physical", spp=SPP, noise=None, denoise=False),
            relight=replace(work.relight, profile="physical", mode="ratio"),
        ),
        like=scene,
    )
    kept, key = UserCache(), digest("sheet of an estimate", shown.keys.frame(camera, lighting))
    codec = array_of((camera.height, 3 * camera.width, 3))
    made = kept.get(key, codec)
    if made is None:
        layer = shown.compositor.composite(camera)
        made = sheet(unlit_rgba(layer), shown.tracer.trace(lighting, camera))
        kept.put(key, made, codec)
    return made


def _small(camera: Camera) -> Camera:
    """As large as a picture to judge by is."""
    return camera.scaled(min(WIDEST / camera.width, 1.0))


def _stops(text: str) -> float:
    value = float(text)
    if not math.isfinite(value) or abs(value) > _MOST_STOPS:
        raise argparse.ArgumentTypeError(f"{text}: give stops between -20 and 20")
    return value
