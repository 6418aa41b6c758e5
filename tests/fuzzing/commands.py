"""Cases of the commands beside `render` and `inspect`, drawn by a table: what each reads, writes and takes."""

from __future__ import annotations

import io
import json
import os
import random
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from tests.fuzzing import damage
from tests.fuzzing.case import STREAMS, Case, of_files
from tests.fuzzing.sound import base

JOB = """\
splats = "floor.ply"
proxy = { path = "proxy.glb", albedo = "splats" }
resolution = [16, 12]
captured = "day"
render = { spp = 1, max_depth = 2 }
output = { store = "both" }

[[cameras]]
name = "front"
position = [0, 1, 6]
target = [0, 0, 0]

[[lightings]]
name = "day"
environment = { path = "sky.hdr" }

[[lightings]]
name = "night"
lights = [{ type = "point", name = "lamp", position = [1, 2, 1], intensity = 30 }]
"""
FILES = ("floor.ply", "proxy.glb", "sky.hdr", "job.toml", "target.png", "mask.png", "sky.exr")
NAMES = ("front", "night", "", "*", "[", "\x1b[2J", "\udcff", "a" * 5000, "../x", "café", "lamp", "nan")
NUMBERS = (
    *map(repr, damage.NUMBERS),
    "nan",
    "inf",
    "9" * 5000,
    "\u0663",
    "",
    "x",
    "1_0",
    "0x10",
    "1e999999999",
    "9" * 5000 + "/1",
)
PATHS = (
    *FILES,
    "missing.png",
    "folder",
    "pipe",
    "link",
    "dangling",
    "empty",
    "/dev/zero",
    ".",
    "",
    "\udcff\x1b[2J",
    "a" * 300,
)
SETTINGS = (
    "render.spp",
    "lightings[1].lights[0].intensity",
    "output.store",
    "cameras",
    "relight.mode",
    "captured",
    "x",
)
# A frame of a turntable, a wrong profile, no cameras, no captured light, no lights.
OTHER_JOBS = (
    ("[[cameras]]", '[[cameras]]\ntype = "turntable"\nradius = 6\nframes = 2\n[[cameras]]'),
    ("resolution", 'profile = "playcanvas"\nresolution'),
    ('[[cameras]]\nname = "front"\nposition = [0, 1, 6]\ntarget = [0, 0, 0]\n', ""),
    ('captured = "day"\n', ""),
    ('captured = "day"\n', 'captured = "estimate"\n'),
    ('splats = "floor.ply"\n', ""),
    ('proxy = { path = "proxy.glb", albedo = "splats" }\n', ""),
    ("position = [0, 1, 6]", "position = [0, 1, 1e30]"),
    ("target = [0, 0, 0]", "target = [0, 90, 0]"),
    ("intensity = 30", "intensity = 0"),
    ("intensity = 30", "intensity = 1e12"),
)


@dataclass(frozen=True, slots=True)
class Command:
    """What a command reads, writes and takes."""

    name: str
    reads: tuple[str, ...]  # its first arguments
    writes: str  # a sound output
    options: Mapping[str, tuple[str, ...]]  # hostile values
    always: tuple[str, ...] = ()  # further arguments
    out: str = "-o"  # the option for what it writes; "": it writes nothing


_JOB_OPTIONS = {"--lighting": NAMES, "--set": ()}
COMMANDS = (
    Command("new", ("floor.ply",), "new.toml", {"--light": (*PATHS, "sun", "point")}),
    Command("proxy", ("floor.ply",), "made.glb", {"--fit": PATHS, "--cameras": PATHS, "--triangles": NUMBERS}),
    Command("estimate", ("job.toml",), "light.toml", {"--exposure": NUMBERS, "--camera": NAMES, "--set": ()}),
    Command("mix", ("job.toml",), "page", {**_JOB_OPTIONS, "--spp": NUMBERS, "--port": NUMBERS}, ("--spp", "1")),
    Command(
        "match",
        ("job.toml",),
        "found.toml",
        {"--target": PATHS, "--mask": PATHS, "--camera": NAMES, "--lights": NAMES, **_JOB_OPTIONS},
        ("--lighting", "night", "--target", "target.png"),
    ),
    Command("bake", ("job.toml",), "baked.ply", {**_JOB_OPTIONS, "--spp": NUMBERS}, ("--spp", "1")),
    Command("explain", ("job.toml",), "ladder", {**_JOB_OPTIONS, "--camera": NAMES}, ("--no-engine",)),
    Command("realtime", ("job.toml",), "page", {**_JOB_OPTIONS, "--camera": NAMES}, ("--export-only",)),
    Command(
        "export",
        ("kept",),
        "set",
        {
            "--layout": ("nerf", "colmap", "olat", "tum", "x\x1b[2J"),
            "--lighting": NAMES,
            "--split": ("camera", "lighting", "both"),
            "--held-out": NUMBERS,
            "--seed": NUMBERS,
            "--license": NAMES,
        },
        ("--layout", "nerf"),
    ),
    Command(
        "submit",
        ("job.toml",),
        "job.sh",
        {**_JOB_OPTIONS, "--shards": NUMBERS, "--threads": NUMBERS, "--variant": NAMES, "--frames": PATHS},
        ("--slurm",),
    ),
    Command(
        "compare",
        ("kept", "kept"),
        "report.html",
        {
            "--mask": PATHS,
            "--band": NUMBERS,
            "--exposure": NUMBERS,
            "--background": (*NUMBERS, "1,2,3", "nan,0,0"),
            "--require": ("psnr>=30", "x>=1", "psnr", "psnr>=1e999", "\x1b>=\udcff", "psnr>=" + "9" * 5000),
            "--out": PATHS,
        },
    ),
    Command("sheet", ("kept",), "sheet.png", {"--size": NUMBERS, "--camera": NAMES, "--lighting": NAMES}),
    Command(
        "film",
        ("kept",),
        "film.webp",
        {"--fps": NUMBERS, "--camera": NAMES, "--lighting": NAMES, "--order": ("cameras", "lightings", "x")},
    ),
    Command("status", ("kept",), "", {"--json": ("x",)}, out=""),
    Command("verify", ("kept",), "", {"--rebuild": ("x",)}, out=""),
    Command(  # frames from what is kept: only their EXR files are other ones
        "render",
        ("job.toml",),
        "kept",
        {**_JOB_OPTIONS, "--shard": (*NUMBERS, "1/2", "2/1"), "--light": PATHS},
        ("--set", 'output.aovs=["depth"]'),
    ),
)


def drawn(number: int, rng: random.Random) -> Case:
    """One case of one command."""
    command = COMMANDS[number // 2 % len(COMMANDS)]
    spoil = rng.choice((_in_a_file, _no_file, _in_the_job, _wrong_file, _missing, _by_option, _by_output, _by_streams))
    return spoil(f"{number} {command.name}", command, rng)


def _in_a_file(title: str, command: Command, rng: random.Random) -> Case:
    files = _files(command)
    read = [x for x in files if "." in x and x not in ("mask.png", "job.toml")]
    name = rng.choice([x for x in read if x.startswith(command.reads[0])] or read)
    if command.name == "new" and rng.random() < 0.6:  # it looks at what lies beside
        name = rng.choice(read)
    data = files[name]
    if name.endswith(".json") and rng.random() < 0.7:
        data = json.dumps(damage.json_of(json.loads(data), rng)).encode()
    elif name.endswith(".glb") and rng.random() < 0.7:
        data = damage.glb_of(data, rng)
    elif name.endswith(".ply") and rng.random() < 0.4:
        head, end, body = data.partition(b"end_header\n")
        data = damage.text_of(head, rng) + end + body
    else:
        data = damage.bytes_of(data, rng)
    return _case(f"{title}: damaged {name}", command, {**files, name: data})


def _no_file(title: str, command: Command, rng: random.Random) -> Case:
    """Something else in a file's place."""
    files = _files(command)
    name = rng.choice([x for x in files if x.startswith("kept/")] or sorted(files))
    kind = rng.choice(("pipe", "folder", "sparse", "loop", "dangling", "device"))
    case = _case(f"{title}: a {kind} as {name}", command, files)

    def build(folder: Path) -> None:
        case.build(folder)
        path = folder / name
        if kind == "sparse":
            with path.open("ab") as file:
                file.truncate(2**42)
            return
        path.unlink()
        match kind:
            case "pipe":
                os.mkfifo(path)
            case "folder":
                path.mkdir()
            case "loop":
                path.symlink_to(path)
            case "dangling":
                path.symlink_to(folder / "nowhere" / "a")
            case _:
                path.symlink_to("/dev/zero")

    return replace(case, build=build)


def _in_the_job(title: str, command: Command, rng: random.Random) -> Case:
    old, new = rng.choice(OTHER_JOBS)
    text = JOB.replace(old, new) if rng.random() < 0.5 else damage.text_of(JOB.encode(), rng).decode("utf-8", "replace")
    return _case(f"{title}: another job", command, {**_files(command), "job.toml": text.encode()})


def _wrong_file(title: str, command: Command, rng: random.Random) -> Case:
    reads = tuple(rng.choice(PATHS) for _ in command.reads)
    return _case(f"{title} of {reads[0][:20]!a}", replace(command, reads=reads), _files(command))


def _missing(title: str, command: Command, rng: random.Random) -> Case:
    files = _files(command)
    there = sorted(x for x in files if x.startswith("kept/")) if "kept" in command.reads else sorted(files)
    gone = rng.choice((*there, "*"))
    left = {x: data for x, data in files.items() if gone != x and (gone != "*" or x not in there)}
    return _case(f"{title} without {gone}", command, left)


def _by_option(title: str, command: Command, rng: random.Random) -> Case:
    if rng.random() < 0.1:
        more = (rng.choice(("--what", "-z", "more")) + rng.choice(NAMES),)
    else:
        name = rng.choice(sorted(command.options))
        values = command.options[name] or tuple(f"{rng.choice(SETTINGS)}={x}" for x in (*NUMBERS, *NAMES, "[" * 300))
        more = (f"{name}={rng.choice(values)}",)
    return _case(f"{title} {more[0][:30]!a}", command, _files(command), more)


def _by_output(title: str, command: Command, rng: random.Random) -> Case:
    _, dot, suffix = command.writes.partition(".")
    out = rng.choice(
        (
            *(f"{x}{dot}{suffix}" for x in ("pipe", "folder", "link", "dangling", "file/a", "missing/a", "a" * 300)),
            *(f"{x}{dot}{suffix}" for x in ("/proc/a", "/dev/null/a", "\x1b[2J", "\udcff", "caf\u00e9\u202e", "")),
            *("/dev/full", "file", ".", *command.reads),
        )
    )
    return _case(f"{title} to {out[:20]!a}", replace(command, writes=out), _files(command))


def _by_streams(title: str, command: Command, rng: random.Random) -> Case:
    streams = rng.choice(STREAMS)
    bad = rng.random() < 0.4
    wrong = replace(command, reads=("caf\u00e9\udcff",) * len(command.reads)) if bad else command
    return replace(_case(f"{title} with stdout and stderr {streams}", wrong, _files(command)), streams=streams)


def _case(title: str, command: Command, files: dict[str, bytes], more: tuple[str, ...] = ()) -> Case:
    out = (command.out, command.writes) if command.out else ()
    arguments = (command.name, *command.reads, *command.always, *more, *out)
    return of_files(title, arguments, files, setup=_surroundings(Path(command.writes).suffix, arguments))


def _surroundings(suffix: str, arguments: tuple[str, ...]) -> Callable[[Path], None]:
    def make(folder: Path) -> None:
        for end in {"", suffix}:
            os.mkfifo(folder / f"pipe{end}")
            (folder / f"folder{end}").mkdir(exist_ok=True)
            if any(f"link{end}" in x for x in arguments):  # else a command that reads all of a folder would follow it
                (folder / f"link{end}").symlink_to(folder.parent / "outside" / "canary.png")
            (folder / f"dangling{end}").symlink_to(folder / "nowhere" / "a")
        (folder / "file").write_bytes(b"x")
        (folder / "empty").mkdir()

    return make


def _files(command: Command) -> dict[str, bytes]:
    files = dict(sound())
    return {**files, **kept()} if "kept" in (*command.reads, command.writes) else files


@cache
def sound() -> dict[str, bytes]:
    """Files that each command can work on: a floor of splats on the proxy, a picture of the camera's size."""
    from PIL import Image

    from mirelight.io import splats
    from mirelight.model import SplatCloud

    rng = np.random.default_rng(0)
    count = 900
    means = np.stack([rng.uniform(-3, 3, count), np.full(count, -1.0), rng.uniform(-3, 3, count)], axis=1)
    floor = SplatCloud(
        means=means.astype(np.float32),
        quats=np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1)),
        scales=np.tile(np.array([0.2, 0.005, 0.2], np.float32), (count, 1)),
        opacities=np.full(count, 0.9, np.float32),
        sh=rng.normal(0, 0.3, (count, 1, 3)).astype(np.float32),
    )
    out = {name: base()[name] for name in ("proxy.glb", "sky.hdr", "sky.exr")}
    for name, values in (("target", rng.integers(0, 256, (12, 16, 3))), ("mask", np.full((12, 16, 3), 255))):
        stream = io.BytesIO()
        Image.fromarray(values.astype(np.uint8)).save(stream, "PNG")
        out[f"{name}.png"] = stream.getvalue()
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "floor.ply"
        splats.write(floor, path)
        out["floor.ply"] = path.read_bytes()
    return {**out, "job.toml": JOB.encode()}


@cache
def kept() -> dict[str, bytes]:
    """What a render of the job leaves: frames, layers, journal."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for path, data in sound().items():
            (folder / path).write_bytes(data)
        command = [sys.executable, "-m", "mirelight", "render", "job.toml", "-o", "kept", "-q"]
        root = str(Path(__file__).parents[2])
        subprocess.run(command, cwd=folder, check=True, env={**os.environ, "PYTHONPATH": root})
        found = {str(x.relative_to(folder)): x.read_bytes() for x in (folder / "kept").rglob("*") if x.is_file()}
        return {re.sub(r"[^/]*\.jsonl", "a.jsonl", name): found[name] for name in sorted(found)}  # without a process id
