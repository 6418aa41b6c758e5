"""`mirelight export --layout usd`: a rendered job as a stage of OpenUSD, with its frames."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import TYPE_CHECKING

from mirelight.base.errors import InputError
from mirelight.cli import new, outputs, say
from mirelight.io.suffixes import USD
from mirelight.pipeline.plan import chosen

if TYPE_CHECKING:
    from mirelight.batch import Order
    from mirelight.model import Job, Lighting
    from mirelight.store.folder import Folder

_SAMPLES = 64  # a splat
# Of data sets alone, with what they are where nobody gives them.
_OF_DATA_SETS = {"normalize": False, "split": "camera", "held_out": 0.1, "seed": 0, "no_hdr": False, "license": ""}


def run_stage(args: argparse.Namespace) -> int:
    """The command. What was written goes to stdout, progress to stderr."""
    from mirelight.apps import bake as baking
    from mirelight.cli.bar import bar
    from mirelight.pipeline.scene import prepare
    from mirelight.store.folder import Folder

    for name, usual in _OF_DATA_SETS.items():
        if getattr(args, name) != usual:
            raise InputError(f"--{name.replace('_', '-')}", "for a data set", "leave it out of a stage")
    out = outputs.named(args.out, "a stage is", *USD)
    folder = Folder(args.folder)
    order, work = _job_of(folder)
    outputs.spare([out], outputs.files_of(work))
    lighting = _lighting(work, args.lighting)
    frames = _frames(folder, order, work, lighting, out)
    with bar(args.quiet) as report:
        scene = prepare(work, progress=report)
        baked = None
        if work.splats is not None:
            factor = baking.factors(scene, lighting, spp=_SAMPLES, progress=report)
            baked = baking.relit(work.splats.value, factor, work.relight_of(lighting))
        _ = scene.mesh  # made now, where the job makes it from the splats
        baking.write_stage(out, baked, work, lighting, frames)
    notes = []
    if len(frames) < len(work.cameras):
        notes.append(f"{len(work.cameras) - len(frames)} frames are not there, or not of the job as it is now")
    if work.objects:
        notes.append("[[objects]] are in the frames alone; the stage does not have them")
    said = f"{out}: the job {work.source.name} under {lighting.name!r}, {len(frames)} of its frames by name"
    made = {"files": [out], "lighting": lighting.name, "frames": len(frames), "notes": notes}
    say.outcome(args, made, [said], notes)
    return 0


def _job_of(folder: Folder) -> tuple[Order, Job]:
    from mirelight.batch import Order

    if not folder.runs:
        raise InputError(folder.path, "no job was rendered there", "give the folder that a job's frames are in")
    newest = folder.runs[-1]
    order = Order.of(newest.job, newest.settings)
    if newest.capture is None:
        return order, order.load()
    light = next((x.removeprefix("--light=") for x in newest.settings if x.startswith("--light=")), "")
    return order, new.first_job(newest.capture, light, order.overrides(), say.remark)


def _lighting(work: Job, names: list[str] | None) -> Lighting:
    if names is not None and len(names) > 1:
        raise InputError("--lighting", f"{len(names)} of them", "a stage has one; write one for each")
    if not work.lightings:
        raise InputError(work.source, "no light", "a stage is of one lighting", field="lights")
    return chosen(work, "lighting", work.lightings, names)[0]


def _frames(folder: Folder, order: Order, work: Job, lighting: Lighting, out: Path) -> dict[str, str]:
    """By camera the picture in the folder, EXR where it has one, as a path from where the stage will be."""
    found: dict[str, str] = {}
    start = out.absolute().parent
    for task in order.plan(work).tasks:
        of_it = task.lighting is not None and task.lighting.name == lighting.name
        if of_it and task.files and folder.index.has(task):
            suffix = ".exr" if ".exr" in task.files else ".png"
            place = os.path.relpath(folder.path.absolute() / f"{task.name}{suffix}", start)
            found[task.camera.name] = Path(place).as_posix()
    return found
