"""The cases: what lies in a folder, which command reads it. Nothing is random but the generator's seed."""

from __future__ import annotations

import io
import json
import random
import zipfile
from collections.abc import Iterator

from tests.fuzzing import commands, damage, reviewed, stages, written
from tests.fuzzing.case import Case, of_files
from tests.fuzzing.sound import CAMERA_FILES, TINY, WHOLE, base, job, scene

_STAGES = 25  # one in so many drawn cases is a stage: each starts processes


def cases(count: int, seed: int = 1) -> Iterator[Case]:
    """`count` cases: the written ones first, then drawn ones."""
    fixed = [*written.written(), *reviewed.written(), *stages.written()]
    yield from fixed[:count]
    kinds = (
        reviewed.drawn,
        _job,
        reviewed.drawn,
        _override,
        _splats,
        _sog,
        _streamed,
        _mesh,
        _gltf,
        _picture,
        _compare,
        _cameras,
    )
    for number in range(max(count - len(fixed), 0)):
        rng = random.Random(f"{seed} {number}")
        if number % _STAGES == _STAGES - 1:
            yield stages.drawn(number, rng)
            continue
        yield commands.drawn(number, rng) if number % 2 else kinds[number // 2 % len(kinds)](number, rng)


def _job(number: int, rng: random.Random) -> Case:
    text = damage.text_of(WHOLE.encode(), rng)
    while rng.random() < 0.3:
        text = damage.text_of(text, rng)
    files = scene(**{"job.toml": text})
    if rng.random() < 0.6:
        return of_files(f"{number} job inspected", ("inspect", "job.toml", *rng.choice(((), ("--json",)))), files)
    return of_files(f"{number} job rendered", ("render", "job.toml", *TINY, "--camera", "front"), files)


def _override(number: int, rng: random.Random) -> Case:
    keys = (
        "render.spp",
        "lightings[1].lights[0].intensity",
        "cameras[0].yfov",
        "output.half",
        "splats",
        "relight.max_ratio",
        "x.y",
    )
    value = rng.choice(
        (*map(repr, damage.NUMBERS), *map(json.dumps, damage.STRINGS), *damage.STRINGS, "nan", "[" * 300, "9" * 5000)
    )
    text = f"{rng.choice(keys)}={value}".replace("\0", "")
    if rng.random() < 0.2:
        text = text[: rng.randrange(len(text))]
    files = scene(**{"job.toml": WHOLE.encode()})
    small: tuple[str, ...] = (
        "--camera",
        "front",
        "--lighting",
        "night",
        "--set",
        text,
        "--set",
        "resolution=[16, 12]",
        "-o",
        "out",
        "-q",
    )
    if "spp" in text:
        small += ("--set", "render.spp=1")
    return of_files(f"{number} override", ("render", "job.toml", *small), files)


def _splats(number: int, rng: random.Random) -> Case:
    names = [x for x in base() if x.endswith((".ply", ".spz", ".splat", ".ksplat", "small.glb")) and x != "mesh.ply"]
    name = rng.choice(names)
    data = base()[name]
    if name.endswith(".ply") and rng.random() < 0.4:
        head, end, body = data.partition(b"end_header\n")
        data = damage.text_of(head, rng) + end + body
    elif name.endswith(".glb") and rng.random() < 0.7:
        data = damage.glb_of(data, rng)
    else:
        data = damage.bytes_of(data, rng)
    return _splats_case(f"{number} {name}", rng, name, {name: data})


def _splats_case(title: str, rng: random.Random, head: str, files: dict[str, bytes]) -> Case:
    if rng.random() < 0.7:
        return of_files(title, ("inspect", head), files)
    text = job(splats=head, more=rng.choice(("", "compositor.sort = 'radial'", "profile = 'playcanvas'")))
    return of_files(f"{title} rendered", ("render", "job.toml", *TINY), {**scene(), **files, "job.toml": text})


def _sog(number: int, rng: random.Random) -> Case:
    files = {x: data for x, data in base().items() if x.startswith("sog/")}
    if rng.random() < 0.6:
        files["sog/meta.json"] = json.dumps(damage.json_of(json.loads(files["sog/meta.json"]), rng)).encode()
    else:
        name = rng.choice(sorted(files))
        files[name] = damage.bytes_of(files[name], rng)
    if rng.random() < 0.5:
        return _splats_case(f"{number} SOG folder", rng, rng.choice(("sog", "sog/meta.json")), files)
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for name, data in files.items():
            archive.writestr(name.removeprefix("sog/"), data)
    whole = stream.getvalue() if rng.random() < 0.7 else damage.bytes_of(stream.getvalue(), rng)
    return _splats_case(f"{number} SOG", rng, "a.sog", {"a.sog": whole})


def _streamed(number: int, rng: random.Random) -> Case:
    files = {x: data for x, data in base().items() if x.startswith("streamed/")}
    name = (
        "streamed/lod-meta.json" if rng.random() < 0.7 else rng.choice(sorted(x for x in files if x.endswith(".json")))
    )
    files[name] = json.dumps(damage.json_of(json.loads(files[name]), rng)).encode()
    return _splats_case(f"{number} streamed SOG", rng, "streamed/lod-meta.json", files)


def _mesh(number: int, rng: random.Random) -> Case:
    name = rng.choice(("proxy.obj", "proxy.mtl", "mesh.ply", "proxy.stl"))
    data = base()[name]
    data = damage.bytes_of(data, rng) if name.endswith("stl") or rng.random() < 0.2 else damage.text_of(data, rng)
    head = "proxy.obj" if name == "proxy.mtl" else name
    files = scene(**{"proxy.obj": base()["proxy.obj"], name: data})
    if rng.random() < 0.4:
        return of_files(f"{number} {name}", ("inspect", head), files)
    return of_files(f"{number} {name} rendered", ("render", "job.toml", *TINY), {**files, "job.toml": job(proxy=head)})


def _gltf(number: int, rng: random.Random) -> Case:
    data = damage.glb_of(base()["proxy.glb"], rng) if rng.random() < 0.8 else damage.bytes_of(base()["proxy.glb"], rng)
    files = scene(**{"bad.glb": data})
    role = rng.choice(("inspect", "proxy", "lights", "cameras", "animation"))
    if role == "inspect":
        return of_files(f"{number} glTF", ("inspect", "bad.glb", *rng.choice(((), ("--json",)))), files)
    more = {
        "cameras": 'cameras_from = "bad.glb"\n',
        "animation": 'cameras_from = [{ path = "bad.glb", frames = 3 }]\n',
        "lights": 'captured = { lights_from = "bad.glb" }\n',
    }.get(role, "")
    text = job(proxy="bad.glb" if role == "proxy" else "proxy.glb", more=more)
    return of_files(
        f"{number} glTF {role}", ("render", "job.toml", *TINY, "--camera", "*"), {**files, "job.toml": text}
    )


def _cameras(number: int, rng: random.Random) -> Case:
    name = rng.choice(sorted(x for x in CAMERA_FILES if "points3D" not in x))
    data = CAMERA_FILES[name]
    if name.endswith(".json") and rng.random() < 0.5:
        data = json.dumps(damage.json_of(json.loads(data), rng)).encode()
    elif rng.random() < 0.8:
        data = damage.text_of(data, rng)
    else:
        data = damage.bytes_of(data, rng)
    head = "sparse" if name.startswith("sparse") else name
    text = job(more=f'cameras_from = "{head}"\n')
    if rng.random() < 0.3:  # what looked at a proxy made from the splats
        own = f'proxy = {{ path = "splats", cameras = "{head}" }}'.encode()
        text = job().replace(b'proxy = { path = "proxy.glb", albedo = "file" }', own)
        assert own in text
    files = {**scene(), **CAMERA_FILES, name: data, "job.toml": text}
    if rng.random() < 0.5:
        return of_files(f"{number} {name}", ("inspect", "job.toml"), files)
    return of_files(f"{number} {name} rendered", ("render", "job.toml", *TINY, "--camera", "*"), files)


def _picture(number: int, rng: random.Random) -> Case:
    name = f"sky.{rng.choice(('hdr', 'exr', 'png', 'jpg', 'webp'))}"
    files = scene(**{name: damage.bytes_of(base()[name], rng)})
    if rng.random() < 0.5:
        return of_files(f"{number} {name}", ("inspect", name), files)
    return of_files(f"{number} {name} rendered", ("render", "job.toml", *TINY), {**files, "job.toml": job(sky=name)})


def _compare(number: int, rng: random.Random) -> Case:
    suffix = rng.choice(("exr", "png", "jpg", "webp"))
    files = {f"a.{suffix}": base()[f"sky.{suffix}"], f"b.{suffix}": damage.bytes_of(base()[f"sky.{suffix}"], rng)}
    more = rng.choice(
        (
            (),
            ("--fit-gain",),
            ("--premultiplied",),
            ("--json", "out.json"),
            ("--exposure", "1e30"),
            ("--require", "psnr>=nan"),
        )
    )
    return of_files(f"{number} compare {suffix}", ("compare", f"a.{suffix}", f"b.{suffix}", *more), files)
