"""What a batch costs beside its light: many lightings of few traces, ten thousand frames, two workers.

    python scripts/bench batch [--only light plan again workers budget]

The scene is `scenes/stage` on an orbit: 24 cameras under 50 lightings of 8 lamps and an HDRI at 320 x 180 and 16
samples, as a sweep makes them. Every part runs in a process of its own; CPU seconds are those of all its threads.
Ratios of wall times (workers) want a machine that does nothing else.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from unittest import mock

import mirelight
from bench.common import Table, peak_mb, table
from mirelight import cli, relighting
from mirelight.batch import executor
from mirelight.model import Job
from mirelight.model.unit_lights import LightSet
from mirelight.pipeline import stages
from mirelight.pipeline.plan import FrameTask, plan
from mirelight.pipeline.scene import Scene, prepare
from mirelight.store import Store

SCENE = Path(__file__).resolve().parents[2] / "scenes" / "stage"
PARTS = ("light", "plan", "again", "workers")  # beside "budget", which has a table of its own
Figures = dict[str, float]


@dataclass(frozen=True, slots=True)
class Size:
    """How much of everything."""

    cameras: int
    lightings: int
    planned: tuple[int, int]  # cameras and lightings of the frames that are planned and found
    working: tuple[int, int]  # those that workers make


FULL, QUICK = Size(24, 50, (100, 100), (12, 25)), Size(2, 5, (10, 10), (4, 5))

GOALS = {  # name of a figure: (goal, whether more is better)
    "CPU of all / each unit light traced alone": (1.25, False),
    "CPU of all / unit lights traced together": (1.25, False),
    "CPU of an extra lighting / the first": (1 / 50, False),
    "planning: seconds before the first frame": (2.0, False),
    "planning: peak MB": (200.0, False),
    "all there: seconds": (1.5, False),
    "frames a second, two workers / one": (1.8, True),
}


def job_text(cameras: int, lightings: int, out: Path, more: str = "") -> str:
    """A job of 8 lamps and an HDRI over the stage."""
    lamps = "".join(
        f'[[lights]]\nname = "lamp{i}"\ntype = "point"\nposition = [{-3 + 0.8 * i:g}, {2.5 + 0.1 * i:g}, '
        f"{2 - 0.4 * i:g}]\nintensity = 10.0\n\n"
        for i in range(8)
    )
    fields = [(f"lights.lamp{i}.intensity", "[0.5, 20.0]") for i in range(8)] + [
        ("environment.intensity", "[0.1, 1.0]")
    ]
    axes = "".join(f'[[sweep.axes]]\nfield = "{f}"\nrange = {r}\ndraws = {lightings}\n\n' for f, r in fields)
    folder = SCENE.as_posix()
    return f"""
splats = "{folder}/splats.compressed.ply"
proxy = {{ path = "{folder}/proxy.glb", albedo = "splats" }}
captured = {{ environment = "{folder}/studio.hdr" }}
environment = "{folder}/sunset.hdr"
resolution = [320, 180]

{lamps}
[sweep]
how = "paired"
seed = 1

{axes}
[[cameras]]
type = "orbit"
name = "orbit"
target = [0, 0.8, 0]
radius = 4.5
elevation = 15
frames = {cameras}

[render]
spp = 16

[output]
directory = "{out.as_posix()}"
half = true
{more}
"""


# --- parts, each in its own process -----------------------------------------------------------------------------------


def light(size: Size, folder: Path) -> Figures:
    """Every unit light of every camera traced alone, and together; then the whole job in a process of its own."""
    path = written(folder, job_text(size.cameras, size.lightings, folder / "out"))
    found = child("made", path)
    job = mirelight.load(path)
    alone, together = traced(job, alone=True), traced(job, alone=False)
    frames = size.cameras * size.lightings
    return {
        "unit lights": len(units(job)),
        "CPU s, unit lights traced alone": alone,
        "CPU s, unit lights traced together": together,
        f"CPU s, {frames} frames": found["cpu"],
        "CPU of all / each unit light traced alone": found["cpu"] / alone,
        "CPU of all / unit lights traced together": found["cpu"] / together,
        "CPU s, first lighting of a camera": found["first"],
        "CPU s, an extra lighting": found["extra"],
        "CPU of an extra lighting / the first": found["extra"] / found["first"],
        "MB a frame": found["bytes"] / frames / 1e6,
    }


def made(path: Path) -> Figures:
    """Render a job; CPU seconds in all, of cameras' first lightings and of their others (medians)."""
    spent: dict[str, list[float]] = {}

    class Heard(executor.Progress):
        last = 0.0

        def finished(self, task: FrameTask, seconds: float | None) -> None:
            now = time.process_time()
            spent.setdefault(task.camera.name, []).append(now - self.last)
            self.last = now

    job = mirelight.load(path)
    store = Store(job)
    store.open()
    executor.run(plan(job), store, Heard())
    store.close()
    warm = list(spent.values())[1:]  # the first camera's also prepares the scene and compiles
    return {
        "cpu": time.process_time(),
        "first": statistics.median(x[0] for x in warm),
        "extra": statistics.median(x for camera in warm for x in camera[1:]),
        "bytes": sum(x.stat().st_size for x in job.output.directory.iterdir()),
    }


def units(job: Job) -> list[LightSet]:
    """Each unit light of the job, that of the captured light too, as a set of its own."""
    return [LightSet((unit,)) for s in sets_of(prepare(job)) for unit in s.units]


def sets_of(scene: Scene) -> list[LightSet]:
    """What is traced together of the job's light, the captured one too."""
    job = scene.job
    every = [*job.lightings, *([job.captured] if job.captured is not None else [])]
    return list({s.digest: s for x in every for s in scene.mixture(x).sets}.values())


def traced(job: Job, *, alone: bool) -> float:
    """CPU seconds of tracing each unit light of each camera once; nothing that is made once a scene counts."""
    scene = prepare(job)
    sets = units(job) if alone else sets_of(scene)
    seen = [relighting.lighting_camera(x, job.relight) for x in job.cameras]
    for one in sets:  # compiles, and uploads the scene
        scene.tracer.trace(scene.lighting_of(one), seen[0])
    began = time.process_time()
    for camera in seen:
        for one in sets:
            scene.tracer.trace(scene.lighting_of(one), camera)
    return time.process_time() - began


def planning(path: Path) -> Figures:
    """What `mirelight render` does before its first frame."""
    found: Figures = {}

    def stop(*_: object) -> None:
        found["seconds"] = time.process_time()
        found["wall"] = time.time() - float(os.environ["BENCH_BEGAN"])
        found["peak"] = peak_mb()
        raise Enough

    with mock.patch.object(executor, "attempt", stop), contextlib.suppress(Enough):
        cli.main(["render", str(path), "-q"])
    return found


class Enough(BaseException):
    """The first frame would be made now."""


def planned(size: Size, folder: Path) -> Figures:
    """Planning, in its own process."""
    path = written(folder, job_text(*size.planned, folder / "out"))
    found = child("planning", path)
    return {
        "planning: frames": size.planned[0] * size.planned[1],
        "planning: seconds before the first frame": found["seconds"],
        "planning: wall seconds before the first frame": found["wall"],
        "planning: peak MB": found["peak"],
    }


def again(size: Size, folder: Path) -> Figures:
    """A run that finds all its frames, EXR and PNG, in its own process."""
    text = job_text(*size.planned, folder / "out").replace("[320, 180]", "[8, 6]").replace("spp = 16", "spp = 1")
    path = written(folder, text)
    job = mirelight.load(path)
    scene, store = prepare(job), Store(job)
    store.open()
    frames = plan(job)
    executor.unfinished(frames, store, executor.Progress())
    frame = stages.frame(scene, job.cameras[0], None)  # what it shows is no matter
    with mock.patch.object(os, "fsync", lambda _: None):  # to have them soon
        for task in frames.tasks:
            store.put(task, frame)
    store.close()
    began = time.monotonic()
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(
        [sys.executable, "-m", "mirelight", "render", str(path)],
        check=True,
        capture_output=True,
        text=True,
        env=environment(),
    )
    wall, after = time.monotonic() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
    if f"{len(frames.tasks)} of them already there" not in done.stdout:
        raise SystemExit(f"not all were there: {done.stdout}{done.stderr}")
    return {
        "all there: frames": len(frames.tasks),
        "all there: seconds": after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime,
        "all there: wall seconds": wall,
    }


def workers(size: Size, folder: Path) -> Figures:
    """The same frames by one worker process and by two, of one thread each: frames a second once both are at work."""
    rates = {}
    for count in (1, 2):
        out = folder / f"out{count}"
        path = written(folder, job_text(*size.working, out))
        command = [sys.executable, "-m", "mirelight", "render", str(path), "-q"]
        subprocess.run([*command, "--workers", str(count), "--threads", "1"], check=True)
        times = sorted(x.stat().st_mtime for x in out.glob("*.png"))
        rates[count] = (len(times) - 1) / (times[-1] - times[0])
    return {
        "frames a second, one worker": rates[1],
        "frames a second, two workers": rates[2],
        "frames a second, two workers / one": rates[2] / rates[1],
        "load of the machine before": os.getloadavg()[0],
    }


BUDGETS = {  # what is kept, and how the job says so
    "frames: PNG and EXR": "",
    "layers, mixed when they are read": "output.store=layers",
    "layers, indirect light gathered on the surface": "output.store=layers render.indirect=surface",
}
_MACHINES = (4, 16, 64)  # cores


def budget(quick: bool) -> Table:
    """What the 10,000 frames of docs/tutorials/slurm.md take: its first two cameras are rendered under its hundred
    lightings, and what the second one took counts a hundred times; what comes before it counts once."""
    page = (SCENE.parents[1] / "docs" / "tutorials" / "slurm.md").read_text(encoding="utf-8")
    body = page.partition("```toml\n# film.toml\n")[2].partition("```")[0]
    rows = []
    for name, more in BUDGETS.items():
        with tempfile.TemporaryDirectory(prefix="bench-batch-") as made_in:
            folder = Path(made_in)
            text = body.replace('"scenes/', f'"{SCENE.parent.as_posix()}/').replace(
                "out/film", f"{folder.as_posix()}/out"
            )
            text = text.replace("count = 100", "count = 2")
            for setting in more.split():
                table_, _, rest = setting.partition(".")
                key, _, value = rest.partition("=")
                text = text.replace(f"[{table_}]\n", f'[{table_}]\n{key} = "{value}"\n')
            if quick:
                text = text.replace("[256, 256]", "[16, 16]").replace("spp = 32", "spp = 1")
            found = child("counted", written(folder, text))
        hours = (found["before"] + 100 * found["camera"]) / 3600
        machines = [f"{hours / cores:.2g} h" for cores in _MACHINES]
        rows.append((name, f"{hours:.2g}", f"{100 * found['bytes'] / 1e9:.2g} GB", *machines))
    columns = ("what is kept", "CPU hours", "on disk", *(f"{x} cores" for x in _MACHINES))
    return table("A budget for 10,000 frames", columns, rows)


def counted(path: Path) -> Figures:
    """Render a job of two cameras; CPU seconds of the second, of all before it, and the bytes that it left."""
    ended: dict[str, float] = {}
    job = mirelight.load(path)

    class Heard(executor.Progress):
        def finished(self, task: FrameTask, seconds: float | None) -> None:
            ended[task.camera.name] = time.process_time()

    store = Store(job)
    store.open()
    executor.run(plan(job), store, Heard())
    store.close()
    first, second = ended.values()
    size = sum(x.stat().st_size for x in job.output.directory.rglob("*") if x.is_file())
    return {"camera": second - first, "before": 2 * first - second, "bytes": size / 2}


# --- running them -----------------------------------------------------------------------------------------------------

RUN: dict[str, Callable[[Size, Path], Figures]] = {
    "light": light,
    "plan": planned,
    "again": again,
    "workers": workers,
}
CHILD: dict[str, Callable[[Path], Figures]] = {"made": made, "planning": planning, "counted": counted}


def written(folder: Path, text: str) -> Path:
    """The job file."""
    path = folder / "job.toml"
    path.write_text(text, encoding="utf-8")
    return path


def environment() -> dict[str, str]:
    """One in which compiled modules are kept, as an installed package has them."""
    return {name: x for name, x in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}


def child(name: str, path: Path) -> Figures:
    """A part's figures, from a process of its own."""
    done = subprocess.run(
        [sys.executable, str(Path(__file__).parent), "batch", "--child", name, str(path)],
        check=True,
        stdout=subprocess.PIPE,
        text=True,
        env={**environment(), "BENCH_BEGAN": str(time.time())},
    )
    found: Figures = json.loads(done.stdout.splitlines()[-1])
    return found


def goal(name: str, value: float) -> str:
    """The goal of a figure that has one, and whether it is met."""
    if name not in GOALS:
        return ""
    wanted, more = GOALS[name]
    met = value >= wanted if more else value <= wanted
    return f"{'at least' if more else 'at most'} {wanted:g}: {'met' if met else 'missed'}"


def options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--only", nargs="+", choices=(*PARTS, "budget"), default=PARTS)
    parser.add_argument("--child", nargs=2, help=argparse.SUPPRESS)


def run(chosen: argparse.Namespace) -> list[Table]:
    """The figures of the parts that were asked for."""
    if chosen.child:
        name, path = chosen.child
        print(json.dumps(CHILD[name](Path(path))))
        sys.exit()
    if list(chosen.only) == ["budget"]:
        return [budget(chosen.quick)]
    figures: Figures = {}
    for name in chosen.only:
        with tempfile.TemporaryDirectory(prefix="bench-batch-") as folder:
            figures |= RUN[name](QUICK if chosen.quick else FULL, Path(folder))
    rows = [(name, value, goal(name, value)) for name, value in figures.items()]
    return [table("Ten thousand frames, measured", ("figure", "value", "goal"), rows)]
