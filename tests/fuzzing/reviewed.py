"""Cases of what reviews and loads found: rotted files that are kept, outputs that are inputs, ports that are mute."""

from __future__ import annotations

import io
import json
import os
import random
import re
import socket
import struct
import subprocess
import sys
import zlib
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from hashlib import sha256
from pathlib import Path

from tests.fuzzing import damage
from tests.fuzzing.case import Case, of_files
from tests.fuzzing.commands import kept, sound
from tests.fuzzing.sound import CAMERA_FILES, TINY, base, job, scene

_RENDER = ("render", "job.toml", *TINY)
_AGAIN = ("render", "job.toml", "-o", "kept", "-q")


def written() -> list[Case]:
    """One of each kind of trouble."""
    return [*_tables(), *_outputs(), *_numbers(), *_left_over(), *_large(), *_nulls(), _mute(), *_rows()]


def drawn(number: int, rng: random.Random) -> Case:
    """A folder that has rotted somewhere."""
    return rng.choice((_rotted_light, _rotted_light, _rotted_row, _rotted_file, _rotted_header, _camera_numbers))(
        number, rng
    )


# --- what is kept and has rotted -------------------------------------------------------------------------------------


def _rotted_light(number: int, rng: random.Random) -> Case:
    """One bit of light: frames that are made again have the same bits as before, or there are none."""
    files = {**sound(), **kept()}
    name = rng.choice(sorted(x for x in files if x.endswith(".light")))
    data = bytearray(files[name])
    data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    files[name] = bytes(data)
    if rng.random() < 0.3:
        case = of_files(f"{number} rotted light verified", ("verify", "kept"), files)
        return replace(case, after=_says_light)
    files = {x: y for x, y in files.items() if not x.endswith((".exr", ".png")) or not x.startswith("kept/")}
    case = of_files(f"{number} rotted light rendered", _AGAIN, files)
    return replace(case, after=_same_pictures)


def _says_light(folder: Path) -> str:
    said = (folder.parent / "said" / "stdout").read_text(encoding="utf-8", errors="replace")
    return "" if ".light" in said else "verify does not name what has rotted"


def _same_pictures(folder: Path) -> str:
    for name in ("kept/front.day.png", "kept/front.night.png"):
        path = folder / name
        if path.is_file() and sha256(path.read_bytes()).digest() != sha256(kept()[name]).digest():
            return f"{name} has other pixels"
    return ""


def _rotted_row(number: int, rng: random.Random) -> Case:
    """A row of the journal that is JSON and not a row."""
    files = {**sound(), **kept()}
    (name,) = (x for x in files if x.endswith(".jsonl"))
    rows = files[name].decode().splitlines()
    at = rng.randrange(len(rows))
    rows[at] = json.dumps(damage.json_of(json.loads(rows[at]), rng))
    files[name] = "\n".join(rows).encode() + b"\n"
    command = rng.choice((("status", "kept"), ("verify", "kept"), ("verify", "kept", "--rebuild"), _AGAIN))
    return replace(of_files(f"{number} rotted row: {command[0]}", command, files), after=_same_pictures)


def _rotted_file(number: int, rng: random.Random) -> Case:
    """The index of a data set, a plan, or an array that is kept."""
    files = {**sound(), **kept()}
    name = rng.choice(sorted(x for x in files if x.endswith((".json", ".array"))))
    data = files[name]
    files[name] = (
        json.dumps(damage.json_of(json.loads(data), rng)).encode()
        if name.endswith("json")
        else damage.bytes_of(data, rng)
    )
    command = rng.choice((("status", "kept"), ("verify", "kept"), _AGAIN, _EXPORT))
    return of_files(f"{number} rotted {name.rpartition('.')[2]}: {command[0]}", command, files)


def _rotted_header(number: int, rng: random.Random) -> Case:
    """Of an array, with a checksum that fits."""
    files = {**sound(), **kept()}
    name = rng.choice(sorted(x for x in files if x.endswith(".array")))
    heads = b'{"arrays": {"a": ["<f4", [3, ', b"[" * 60, b'{"arrays": {"a": ["|O", [9], 0]}}', b'"\xff\0"', b"1e999"
    magic, _, rest = files[name].split(b"\n", 2)
    head, values = rest.split(b"\n", 1)
    head = rng.choice(heads).ljust(len(head))[: len(head)] + b"\n"
    files[name] = magic + f"\n{zlib.crc32(head):08x}\n".encode() + head + values
    made = {x: y for x, y in files.items() if not x.endswith((".exr", ".png")) or not x.startswith("kept/")}
    command = rng.choice((("status", "kept"), ("verify", "kept"), _AGAIN))
    return of_files(f"{number} rotted header: {command[0]}", command, made if command is _AGAIN else files)


def _rows() -> list[Case]:
    rows = (
        '{"key": []}',
        '{"frame": {}}',
        "[]",
        "3",
        '{"key": 1, "frame": null}',
        '{"key": "' + "a" * (2 << 20) + '"}',
    )
    out = []
    for i, row in enumerate(rows):
        files = {**sound(), **kept()}
        (name,) = (x for x in files if x.endswith(".jsonl"))
        files[name] += row.encode() + b"\n"
        for command in (("status", "kept"), ("verify", "kept"), ("verify", "kept", "--rebuild"), _AGAIN):
            case = of_files(f"row {i} of a journal: {' '.join(command[:3:2])}", command, files)
            out.append(replace(case, after=_same_pictures))
    return out


# --- jobs, options, outputs ------------------------------------------------------------------------------------------


def _tables() -> list[Case]:
    texts = {
        "mix of thousands": "[mix]\n" + "".join(f"n{i} = 1\n" for i in range(20_000)),
        "moved by thousands": "[moved]\n" + "".join(f"n{i} = [1, 2, 3]\n" for i in range(20_000)),
        "a mix of many parts": "mix" + ".a" * 40_000 + " = 1\n",
        "many keys of many parts": "".join(f"k{i}{'.a' * 900} = 1\n" for i in range(3_000)),
        "an exposure without bounds": "display = { exposure = 1" + "0" * 400 + " }\n",
        "a small range": "",
    }
    out = []
    for name, text in texts.items():
        top = not text.startswith("[")
        own = job(more=text if top else "") + (b"" if top else text.encode())
        if name == "a small range":
            own = own.replace(b"intensity = 30", b"intensity = 30, range = 1e-300")
        out.append(of_files(f"job: {name}", _RENDER, scene(**{"job.toml": own})))
    return out


def _outputs() -> list[Case]:
    """An output that is an input, or that mirelight did not write."""
    files = {**sound(), "t.png": sound()["target.png"], "u.png": sound()["target.png"], "page/index.html": b"mine"}
    commands = {
        "compare": ("compare", "t.png", "u.png", "-o", "t.png"),
        "sheet": ("sheet", "t.png", "-o", "t.png"),
        "film": ("film", "t.png", "u.png", "-o", "t.png"),
        "mix": ("mix", "job.toml", "-o", "page", "--spp", "1"),
        "estimate": ("estimate", "job.toml", "-o", "job.toml"),
        "bake": ("bake", "job.toml", "-o", "floor.ply", "--spp", "1"),
        "proxy": ("proxy", "floor.ply", "-o", "floor.ply"),
        "submit": ("submit", "job.toml", "--slurm", "-o", "job.toml"),
        "new": ("new", "floor.ply", "-o", "job.toml"),
        "studio": ("studio", "floor.ply", "-o", "job.toml"),
        "match": ("match", "job.toml", "--lighting", "night", "--target", "target.png", "-o", "job.toml"),
    }
    return [
        replace(of_files(f"output is there: {name}", command, files), after=_untouched(files), codes=(2,))
        for name, command in commands.items()
    ]


def _untouched(files: dict[str, bytes]) -> Callable[[Path], str]:
    def look(folder: Path) -> str:
        return ", ".join(x for x, data in files.items() if (folder / x).read_bytes() != data)

    return look


def _left_over() -> list[Case]:
    """What a killed export leaves is gone after the next one."""
    case = of_files("left over by a killed export", _EXPORT, {**sound(), **kept()}, setup=_killed)
    return [replace(case, after=lambda folder: ", ".join(x.name for x in (folder / "set").rglob("*~*")))]


def _killed(folder: Path) -> None:
    (folder / "set").mkdir()
    code = "import os, sys; from mirelight.io.atomic import atomic_path\n"
    code += "with atomic_path('set/transforms.json'): os._exit(0)"
    root = str(Path(__file__).parents[2])
    subprocess.run([sys.executable, "-c", code], cwd=folder, check=True, env={**os.environ, "PYTHONPATH": root})


_EXPORT = ("export", "kept", "--layout", "nerf", "-o", "set")


@cache
def _port() -> int:
    """A port that takes connections and answers none, as long as this process lives."""
    _LISTENING.append(socket.create_server(("127.0.0.1", 0), backlog=64))
    return int(_LISTENING[0].getsockname()[1])


_LISTENING: list[socket.socket] = []


def _mute() -> Case:
    address = f"tcp://127.0.0.1:{_port()}"
    case = of_files("a scheduler that says nothing", (*_RENDER, "--scheduler", address), scene(**{"job.toml": job()}))
    return replace(case, codes=(2,), seconds=15.0)


# --- pictures, cameras, splats ---------------------------------------------------------------------------------------


def _black(width: int, height: int) -> bytes:
    from PIL import Image

    stream = io.BytesIO()
    Image.new("RGB", (width, height)).save(stream, "PNG")
    return stream.getvalue()


def _large() -> list[Case]:
    png = base()["sky.png"]
    chunk = struct.pack(">I", 0) + b"iCCP" + struct.pack(">I", zlib.crc32(b"iCCP"))
    late = png[:-12] + chunk + png[-12:]
    out = [
        of_files("a large sky inspected", ("inspect", "sky.png"), {"sky.png": _black(8192, 4096)}),
        of_files("a large sky rendered", _RENDER, scene(**{"sky.png": _black(4096, 2048), "job.toml": job()})),
        of_files("a late iCCP as sky", _RENDER, scene(**{"sky.png": late, "job.toml": job()})),
    ]
    commands = ("inspect", "a.png"), ("compare", "a.png", "a.png"), ("sheet", "a.png", "-o", "b.png")
    out += [of_files(f"a late iCCP: {command[0]}", command, {"a.png": late}) for command in commands]
    return out


def _nulls() -> list[Case]:
    """What is null is not there."""
    out = []
    meta = {x: y for x, y in base().items() if x.startswith("streamed/")}
    top = json.loads(meta["streamed/lod-meta.json"])
    for key in ("environment", "asset", "counts", "count"):
        files = {**meta, "streamed/lod-meta.json": json.dumps({**top, key: None}).encode()}
        case = of_files(f"lod-meta.json with {key} null", ("inspect", "streamed"), files)
        out.append(replace(case, codes=(0,)) if key == "environment" else case)
    return out


def _numbers() -> list[Case]:
    out = [_camera_case(f"cameras at {value}", "eyes.csv", value) for value in ("1e200", "1e30", "1e-300", "1e308")]
    name = os.fsdecode(b"fl\xff.ply")
    for title, command in (("new", ("new", name, "-o", "new.toml")), ("inspect", ("inspect", name))):
        out.append(of_files(f"a name that is not UTF-8: {title}", command, {name: sound()["floor.ply"]}))
    beside = {os.fsdecode(b"fl\xff.ply"): b"", "floor.ply": sound()["floor.ply"], os.fsdecode(b"a\xff.hdr"): b"x"}
    return [*out, of_files("a name beside that is not UTF-8", ("new", "floor.ply", "-o", "new.toml"), beside)]


def _camera_case(title: str, name: str, value: str) -> Case:
    data = re.sub(rb"(?<![\w.])6(?![\w.])", value.encode(), CAMERA_FILES[name])
    text = job(more=f'cameras_from = "{name}"\n')
    return of_files(title, ("inspect", "job.toml"), {**scene(), name: data, "job.toml": text})


def _camera_numbers(number: int, rng: random.Random) -> Case:
    name = rng.choice(sorted(x for x in CAMERA_FILES if "/" not in x))
    return _camera_case(f"{number} {name} of other numbers", name, repr(rng.choice(damage.NUMBERS)))
