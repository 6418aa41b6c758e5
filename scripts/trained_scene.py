"""The shipped capture that is as people have theirs: splats trained on pictures of the plinth.

`scripts/make_scenes.py plinth` makes it. No mesh goes with it; its captured light is what `mirelight estimate` finds.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scenegen import plinth, training, writing
from scenegen.recipe import Recipe
from scenegen.truth import Truth

from mirelight import cli
from mirelight.io import splats
from mirelight.model import Camera

F32 = NDArray[np.float32]

PICTURES, APART = 54, 6  # trained on; looked at afterwards alone
SHOOTING = training.Shooting(size=(480, 320), spp=16, sky=True, iterations=1000, most=55_000, points=36_000)
SPLATS, ESTIMATE = "splats.spz", "captured.toml"
PHOTOGRAPHED, QUALITY = "pictures/{:02}.webp", 80  # WebP: 33 dB, as much as splats show of them at most
EYE, TARGET, YFOV = (0.9, 1.8, 1.7), (0.0, 0.55, 0.0), 46.0  # of the job's camera, which took none of the pictures
FRONT = Camera.look_at(EYE, TARGET, 640, 360, yfov=YFOV, name="front")
NAMES = {"low sun": "evening"}  # as files have them
LONGER = {"lamp": 1.0}  # stops by which a lighting is exposed longer: a picture to look at


def recipe() -> Recipe:
    """The plinth's, with the cameras of the capture and of the job."""
    whole = plinth.recipe()
    longer = (training.exposed(x, LONGER.get(x.name, 0.0)) for x in whole.lightings)
    lightings = tuple(replace(x, name=NAMES.get(x.name, x.name)) for x in longer)
    captured = replace(whole.captured, name="day")
    return replace(whole, captured=captured, lightings=lightings, cameras=(FRONT,), orbit=walk(PICTURES))


def walk(count: int, start: float = 0.0) -> tuple[Camera, ...]:
    """Twice round the plinth, nearer and farther, as a person does it; `start` in radians."""
    views = []
    for k in range(count):
        turn, away, high = start + 4 * np.pi * k / count, (1.5, 2.1)[k % 2], (1.5, 1.15, 1.75)[k % 3]
        eye = np.array([away * np.sin(turn), high, away * np.cos(turn)])
        target = np.add(plinth.FOCUS, (0, (0.0, -0.3)[k % 2], 0))
        views.append(Camera.look_at(eye, target, *SHOOTING.size, yfov=52, name=f"{k}"))
    return tuple(views)


def pictures(made_of: Recipe, cameras: Sequence[Camera], kept: Path, say: Callable[[str], None]) -> list[F32]:
    """(H, W, 3) each, display-encoded; those that an earlier run left in the file are taken."""
    made: list[F32] = list(np.load(kept)) if kept.is_file() else []
    truth = Truth(made_of.looks(), made_of.captured)
    for k in range(len(made), len(cameras)):
        made += training.shots(truth, made_of.captured, [cameras[k]], SHOOTING)
        np.save(kept, np.stack(made))
        say(f"picture {k + 1} of {len(cameras)}")
    return made


def make(folder: Path, kept: Path, say: Callable[[str], None]) -> None:
    """All files of the scene but its true pictures.

    Args:
        folder: the scene's.
        kept: folder of pictures and training, so that a run that was stopped goes on.
        say: a line of progress.
    """
    made_of = recipe()
    folder.mkdir(parents=True, exist_ok=True)
    kept.mkdir(parents=True, exist_ok=True)
    taken = pictures(made_of, made_of.orbit, kept / "pictures.npy", say)
    trained = kept / "trained.npy"
    if not trained.is_file():
        say(f"training for {SHOOTING.iterations} steps, a quarter of an hour on two cores")
        np.save(trained, training.trained(Truth(made_of.looks(), made_of.captured), taken, made_of.orbit, SHOOTING))
    cloud = training.cloud_of(np.load(trained))
    splats.write(cloud, folder / SPLATS)
    say(f"{len(cloud)} splats")
    writing.write_cameras(made_of.orbit, folder, PHOTOGRAPHED)
    (folder / PHOTOGRAPHED).parent.mkdir(exist_ok=True)
    for i, picture in enumerate(taken):
        image = Image.fromarray((picture * 255 + 0.5).astype(np.uint8))
        image.save(folder / PHOTOGRAPHED.format(i), quality=QUALITY)
    for lighting in made_of.lightings:
        writing.write_lighting(lighting, folder)
    (folder / writing.JOB).write_text(job_text(made_of, 'captured = "estimate"\n'), encoding="utf-8")
    estimate(folder)
    say("its light is found")


def job_text(made_of: Recipe, captured: str) -> str:
    """The job: one camera under every new lighting.

    Args:
        made_of: the scene.
        captured: TOML that says what light it was captured under; a table stands last in a file, a key first.
    """
    table = captured.lstrip().startswith(("#", "["))
    lines = [
        f"# {made_of.title}",
        f"# Made by scripts/make_scenes.py {made_of.name} as people capture: splats trained on {PICTURES} pictures,",
        "# and the cameras that took them. No mesh comes with it: the first command makes one from the splats, in",
        "# three minutes of CPU time, and keeps it for all others.",
        f'splats = "{SPLATS}"',
        f'proxy = {{ path = "splats", cameras = "{writing.CAMERAS}", albedo = "splats" }}',
        "resolution = [640, 360]",
    ]
    lines += [] if table else [captured.strip()]
    lines += ["", "[[cameras]]", f'name = "{FRONT.name}"', f"position = {writing.numbers(EYE)}"]
    lines += [f"target = {writing.numbers(TARGET)}", f"yfov = {YFOV:g}", ""]
    lines += ["[relight]", 'background = "environment" # what is seen past the mesh', ""]
    for lighting in made_of.lightings:
        lines += writing.lighting_lines(lighting, "[[lightings]]", "[[lightings.lights]]")
    lines += ["[render]", f"spp = {made_of.spp}"]
    lines += ["", "[output]", f'directory = "../../out/{made_of.name}"', "half = true"]
    lines += ["", captured.strip()] if table else []
    return "\n".join(lines) + "\n"


def estimate(folder: Path) -> None:
    """Find the captured light as a person does, and paste it into the job."""
    found = folder / ESTIMATE
    if cli.main(["estimate", str(folder / writing.JOB), "-o", str(found)]) != 0:
        raise RuntimeError("the estimate failed; its line is above")
    typed = f"mirelight estimate scenes/{folder.name}/{writing.JOB} -o {ESTIMATE}"
    said = f'# Found by `{typed}` when this file said captured = "estimate":\n'
    (folder / writing.JOB).write_text(job_text(recipe(), said + found.read_text(encoding="utf-8")), encoding="utf-8")
    for left in (found, found.with_suffix(".png")):
        left.unlink()
