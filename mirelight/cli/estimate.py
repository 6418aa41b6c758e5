"""`mirelight estimate`: the light that splats were captured under."""

from __future__ import annotations

import argparse
import json
import math
import os
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

WIDEST = 480  # pixels of each of the three pictures
SPP = 64  # noise would be taken for misfits
_MOST_STOPS = 20.0


def _arguments(parser: argparse.ArgumentParser) -> None:
    options.add_job(parser, "job file (TOML) that names splats and a proxy")
    parser.add_argument("-o", "--out", metavar="FILE", required=True, help="what to write (.toml, .glb, .gltf)")
    parser.add_argument(
        "--exposure", metavar="STOPS", type=_stops, default=0.0, help="make the light stronger by so many stops (0)"
    )
    parser.add_argument("--camera", metavar="NAME", help="the picture's camera (the job's first)")
    options.add_machine(parser)
    options.add_json(parser)
    options.add_quiet(parser)


def run_estimate(args: argparse.Namespace) -> int:
    """The command. What was found goes to stdout."""
    from mirelight.estimate import estimate
    from mirelight.estimate.describe import described, unknown
    from mirelight.io import job
    from mirelight.io.environment import write_environment
    from mirelight.io.gltf.write import check_light
    from mirelight.io.png import write_png
    from mirelight.model import EstimatedSky
    from mirelight.pipeline.artefact_cache import NullCache
    from mirelight.pipeline.scene import Scene

    out = outputs.named(args.out, "light is", ".toml", *GLTF)
    work = job.load(args.job, options.overrides(args))
    if work.splats is None or work.proxy is None:
        missing = "splats" if work.splats is None else "proxy"
        remedy = "both are needed: splats show the light, the proxy's shadows tell where it came from"
        raise InputError(work.source, f"no {missing}", remedy, field=missing)
    outputs.spare([out, *(out.with_suffix(suffix) for suffix in (".exr", ".png"))], outputs.files_of(work))
    camera = _camera(work, args.camera)
    asked = work.captured.sky if work.captured is not None else None
    lights = asked.lights if isinstance(asked, EstimatedSky) else ()
    if out.suffix.lower() in GLTF:
        for light in lights:
            check_light(out, light)
    scene = Scene(work, NullCache(), None if args.quiet else say.remark)  # unchecked: nothing is rendered of it
    splats, mesh = scene.splats, scene.mesh
    assert splats is not None and mesh is not None
    found = estimate(splats, mesh, work.render, args.exposure, lights, scene.views)
    scene.keep_estimate(_sky(work, args.exposure, lights), found)
    exr = out.with_suffix(".exr")
    lines, doubts = list(described(found)), list(unknown(found))
    sky = found.lighting.environment
    assert sky is not None
    notes = ["Captured light, estimated from splats and proxy.", *lines, *(f"not known: {line}" for line in doubts)]
    write_environment(exr, sky.pixels)
    use, files = _written(out, exr, work, found.lighting, notes)
    picture = None
    if camera is not None:
        picture = out.with_suffix(".png")
        write_png(picture, _picture(work, found.lighting, camera), {})
        files.append(picture)
    if args.json:
        from mirelight.apps.inspect.facts import as_json, lighting_facts
        from mirelight.cli.report import print_json

        captured = as_json(lighting_facts(found.lighting))
        print_json({"files": files, "captured": captured, "use": use, "notes": lines, "unknown": doubts})
    elif not args.quiet:
        say.result(use)
        for line in lines:
            say.result(f"  {line}")
        for line in doubts:
            say.result(f"  ? not known  {line}")
        if picture is not None:
            say.result(
                f"  picture      {picture}: captured | irradiance | captured / irradiance (no shadows should be left)"
            )
    return 0


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


def _sky(work: Job, exposure: float, lights: tuple[Light, ...]) -> EstimatedSky:
    """What a job asks for whose captured light is this estimate."""
    from mirelight.model import EstimatedSky

    assert work.splats is not None and work.proxy is not None
    splats, proxy = work.splats.digest, work.proxy.digest
    return EstimatedSky(splats=splats, proxy=proxy, seed=work.render.seed, exposure=exposure, lights=lights)


def _written(out: Path, exr: Path, work: Job, lighting: Lighting, notes: list[str]) -> tuple[str, list[Path]]:
    """Write the lights as a table or as glTF; says how the job takes them, and which files there are with the map."""
    from mirelight.io.atomic import atomic_path
    from mirelight.io.gltf.write import write_lights
    from mirelight.io.job.captured_text import captured_text

    def named(path: Path) -> str:
        return os.path.relpath(path.resolve(), work.source.resolve().parent).replace(os.sep, "/")

    if out.suffix.lower() not in GLTF:
        with atomic_path(out) as temporary:
            temporary.write_text(captured_text(lighting, named(exr), notes), encoding="utf-8")
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
    return json.dumps(text, ensure_ascii=False)


def _camera(work: Job, name: str | None) -> Camera | None:
    """The camera of that name, or the first; None where the job has none."""
    if name is None:
        return work.cameras[0] if work.cameras else None
    for camera in work.cameras:
        if camera.name == name:
            return camera
    there = ", ".join([x.name for x in work.cameras][:20]) or "none"
    raise InputError(work.source, f"no camera named {name!r}", f"there are: {there}")


def _picture(work: Job, lighting: Lighting, camera: Camera) -> NDArray[np.uint8]:
    """The sheet of one camera, its proxy in the splats' colours."""
    from mirelight.estimate.pictures import sheet
    from mirelight.pipeline.scene import prepare
    from mirelight.relighting import unlit_rgba

    scale = min(WIDEST / camera.width, 1.0)
    camera = camera.resized(max(round(camera.width * scale), 1), max(round(camera.height * scale), 1))
    scene = prepare(
        replace(
            work,
            captured=lighting,
            albedo_from_splats=True,
            render=replace(work.render, profile="physical", spp=SPP, noise=None, denoise=False),
            relight=replace(work.relight, profile="physical", mode="ratio"),
        )
    )
    layer = scene.compositor.composite(camera)
    return sheet(unlit_rgba(layer), scene.tracer.trace(lighting, camera))


def _stops(text: str) -> float:
    value = float(text)
    if not math.isfinite(value) or abs(value) > _MOST_STOPS:
        raise argparse.ArgumentTypeError(f"{text}: give stops between -20 and 20")
    return value
