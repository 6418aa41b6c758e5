"""Cases written by hand, one for each kind of trouble that was found or feared."""

from __future__ import annotations

import json
import os
import struct
import zlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from tests.fuzzing import damage
from tests.fuzzing.case import Case, of_files
from tests.fuzzing.sound import TINY, WHOLE, base, job, scene

_RENDER = ("render", "job.toml", *TINY)
_INSPECT = ("inspect", "job.toml")


def written() -> list[Case]:
    """All of them."""
    return [*_texts(), *_places(), *_large(), *_names(), *_light(), *_pictures()]


def _texts() -> list[Case]:
    short = WHOLE.partition("[relight]")[0].partition("[[lightings]]")[0].replace('captured = "day"\n', "")
    deep = {
        "lists": "x = " + "[" * 400 + "]" * 400,
        "tables": "x = " + "{a = " * 400 + "1" + "}" * 400,
        "header": "[" + ".".join("a" * 400) + "]",
        "keys": ".".join("a" * 400) + " = 1",
        "endless key": ".".join(["a"] * 300_000) + " = 1",
        "digits": "resolution = [" + "9" * 4200 + ", 1]",
        "more digits": "resolution = [" + "9" * 9000 + ", 1]",
        "hexadecimal": "render.seed = 0x" + "f" * 6000,
        "escape": '"\\u001b[2J" = "\\u009b31m"',
        "escape in a name": '[[lightings]]\nname = "\\u001b[2J"',
        "keys by thousands": "\n".join(f"k{i} = 1" for i in range(20_000)),
        "tables by thousands": "[[cameras]]\n" * 20_000,
        "lights by thousands": '[[lights]]\ntype = "point"\nposition = [0, 1, 0]\n' * 4_000,
        "noise": "render.noise = 1e-30",
        "NUL": 'output.directory = "a\\u0000b"',
        "out of NaN": "render.ao_distance = nan",
        "date": "render.spp = 2026-01-01",
    }
    out = [
        of_files(
            f"job: {name}",
            _INSPECT,
            scene(**{"job.toml": short.replace("[[cameras]]", text + "\n[[cameras]]", 1).encode()}),
        )
        for name, text in deep.items()
    ]
    raw = {
        "not UTF-8": b"x = '\xff'",
        "escapes": b"\x1b[2J",
        "empty": b"",
        "BOM": b"\xef\xbb\xbf",
        "binary": bytes(range(256)),
    }
    out += [of_files(f"job: {name}", _INSPECT, scene(**{"job.toml": data})) for name, data in raw.items()]
    sets = (
        "a" * 10_000,
        ".".join("a" * 400) + "=1",
        "x=" + "[" * 400,
        "render.spp=" + "9" * 9000,
        "\x1b[2J=1",
        "render.spp=\udcff",
    )
    return out + [
        of_files(f"--set {i}", ("render", "job.toml", "--set", text, *TINY), scene(**{"job.toml": job()}))
        for i, text in enumerate(sets)
    ]


def _with(setup: Callable[[Path], None], name: str, arguments: tuple[str, ...], **files: bytes) -> Case:
    return of_files(name, arguments, scene(**files), setup=setup)


def _places() -> list[Case]:
    def pipe(name: str) -> Callable[[Path], None]:
        def make(folder: Path) -> None:
            (folder / name).unlink(missing_ok=True)
            (folder / name).parent.mkdir(exist_ok=True)
            os.mkfifo(folder / name)

        return make

    out = [
        _with(pipe(f"pipe.{x}"), f"pipe inspected as {x}", ("inspect", f"pipe.{x}"))
        for x in (
            "toml",
            "ply",
            "glb",
            "gltf",
            "obj",
            "stl",
            "exr",
            "hdr",
            "png",
            "spz",
            "sog",
            "splat",
            "json",
            "webp",
        )
    ]
    for key, name in (("splats", "pipe.ply"), ("proxy", "pipe.glb"), ("sky", "pipe.hdr")):
        out.append(_with(pipe(name), f"pipe as {key}", _RENDER, **{"job.toml": job(**{key: name})}))
    out += [
        _with(pipe("out"), "pipe as output folder", _RENDER, **{"job.toml": job()}),
        _with(pipe("out/front.day.exr"), "pipe as frame", _RENDER, **{"job.toml": job()}),
        _with(pipe("out/front.day.png"), "pipe as picture", _RENDER, **{"job.toml": job()}),
        _with(
            pipe("skin.png"),
            "pipe as texture of OBJ",
            _RENDER,
            **{"proxy.obj": base()["proxy.obj"], "job.toml": job(proxy="proxy.obj")},
        ),
        _with(
            pipe("proxy.mtl"),
            "pipe as material",
            _RENDER,
            **{"proxy.obj": base()["proxy.obj"], "job.toml": job(proxy="proxy.obj")},
        ),
        _with(
            pipe("skin.png"),
            "pipe as texture of PLY",
            _RENDER,
            **{"mesh.ply": base()["mesh.ply"], "job.toml": job(proxy="mesh.ply")},
        ),
        _with(pipe("b.png"), "pipe compared", ("compare", "sky.png", "b.png")),
        _with(pipe("r.html"), "pipe as report", ("compare", "sky.png", "sky.png", "-o", "r.html", "-o", "r.json")),
        of_files("device as output", ("compare", "sky.png", "sky.png", "-o", "/dev/full"), scene()),
        of_files("device inspected", ("inspect", "/dev/zero"), {"dev": b"", "zero": b""}),
        of_files("device as sky", _RENDER, scene(**{"job.toml": job(sky="/dev/zero")})),
        of_files("a tree as splats", _RENDER, scene(**{"job.toml": job(splats="/usr")})),
        of_files("a tree inspected", ("inspect", "/usr"), {"usr": b""}),
        of_files("folder as job", ("render", ".", *TINY), scene()),
        of_files("nothing", ("inspect", "missing.ply"), {"missing.txt": b""}),
        of_files("schema", ("schema",), {"a": b""}),
        of_files("completion", ("completion", "bash"), {"a": b""}),
        of_files("demo into a file", ("demo", "-o", "a"), {"a": b""}),
        of_files("no shell", ("completion", "\x1b[2J"), {"a": b""}),
        of_files("cache", ("cache",), {"a": b""}),
        of_files("cache cleared", ("cache", "--clear"), {"a": b""}),
        of_files("sound", _RENDER, scene(**{"job.toml": job()}), bright=True),
    ]
    return out


def _large() -> list[Case]:
    def sparse(name: str, size: int = 2**42) -> Callable[[Path], None]:
        def make(folder: Path) -> None:
            with (folder / name).open("ab") as file:
                file.truncate(size)

        return make

    kinds = {
        x: base()[x]
        for x in (
            "splats.ply",
            "cloud.compressed.ply",
            "proxy.glb",
            "proxy.stl",
            "small.splat",
            "small.ksplat",
            "sky.exr",
            "sky.hdr",
            "sky.png",
            "sky.jpg",
            "small.sog",
            "cloud_v4.spz",
            "cloud_v3.spz",
        )
    }
    out = [
        _with(sparse(name), f"terabytes of {name}", ("inspect", name), **{name: data}) for name, data in kinds.items()
    ]
    out += [_with(sparse("job.toml"), "terabytes of a job", _INSPECT, **{"job.toml": job()})]
    out += [
        _with(
            sparse(name),
            f"terabytes rendered of {name}",
            _RENDER,
            **{name: base()[name], "job.toml": job(**{key: name})},
        )
        for key, name in (("splats", "splats.ply"), ("proxy", "proxy.obj"), ("sky", "sky.hdr"))
    ]
    zeros = {"componentType": 5126, "count": 1 << 26, "type": "VEC3"}
    indices = zeros | {"componentType": 5125, "type": "SCALAR"}
    few = zeros | {"count": 3}
    million = zeros | {"count": 1 << 20}

    def mesh(accessors: Sequence[object], primitive: Mapping[str, object], **node: object) -> bytes:
        top = {
            "asset": {"version": "2.0"},
            "accessors": accessors,
            "meshes": [{"primitives": [primitive]}],
            "nodes": [{"mesh": 0, **node}],
            "scenes": [{"nodes": [0]}],
        }
        return damage.glb(top)

    position = {"attributes": {"POSITION": 0}}
    instancing = {"extensions": {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": 1}}}}
    chain = {
        "asset": {"version": "2.0"},
        "nodes": [{"children": [i + 1]} for i in range(5000)] + [{}],
        "scenes": [{"nodes": [0]}],
    }
    lights = [{"type": "point", "name": "lamp"}] * 4_000
    lamps = {
        "asset": {"version": "2.0"},
        "extensions": {"KHR_lights_punctual": {"lights": lights}},
        "nodes": [{"extensions": {"KHR_lights_punctual": {"light": i}}} for i in range(4_000)],
    }
    meshes = {
        "zeros": mesh([zeros], position),
        "indices over nothing": mesh([few, indices], position | {"indices": 1}),
        "targets over nothing": mesh([few] + [million] * 100, position | {"targets": [{"POSITION": 0}] * 20_000}),
        "instances over nothing": mesh([few, million], position, **instancing),
        "instances without end": mesh([few, zeros | {"count": 1 << 27}], position, **instancing),
        "a chain of nodes": damage.glb(chain),
        "lights of one name": damage.glb(lamps),
    }
    out += [of_files(f"glTF: {name}", ("inspect", "a.glb"), {"a.glb": data}) for name, data in meshes.items()]
    deep = {"deep.gltf": b"[" * 100_000, "wide.gltf": b'{"asset":{"version":"2.0"},"x":[' + b"[]," * 300_000 + b"[]]}"}
    return out + [of_files(f"glTF: {name}", ("inspect", name), {name: data}) for name, data in deep.items()]


def _names() -> list[Case]:
    def link(folder: Path) -> None:
        (folder / "link").symlink_to(folder.parent / "outside" / "canary.png")
        (folder / "folder").mkdir()
        os.mkfifo(folder / "pipe")

    out = []
    for i, name in enumerate(("../outside/canary.png", "/etc/passwd", "link", "pipe", "folder", "\x1b[2J", "a" * 5000)):
        ply = base()["mesh.ply"].replace(b"skin.png", name.encode())
        mtl = base()["proxy.mtl"].replace(b"skin.png", name.encode())
        obj = base()["proxy.obj"].replace(b"proxy.mtl", name.encode())
        gltf = json.dumps(
            {
                "asset": {"version": "2.0"},
                "buffers": [{"uri": name, "byteLength": 1}],
                "bufferViews": [{"buffer": 0, "byteLength": 1}],
                "accessors": [{"bufferView": 0, "componentType": 5121, "count": 1, "type": "SCALAR"}],
                "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
                "nodes": [{"mesh": 0}],
                "scenes": [{"nodes": [0]}],
            }
        ).encode()
        meta = json.dumps(json.loads(base()["sog/meta.json"])).replace("means_l.webp", json.dumps(name)[1:-1]).encode()
        lod = base()["streamed/lod-meta.json"].replace(b"0_0/meta.json", json.dumps(name)[1:-1].encode())
        sog = {x: data for x, data in base().items() if x.startswith("sog/")}
        streamed = {x: data for x, data in base().items() if x.startswith("streamed/")}
        out += [
            _with(link, f"texture of PLY {i}", _RENDER, **{"mesh.ply": ply, "job.toml": job(proxy="mesh.ply")}),
            _with(
                link,
                f"texture of OBJ {i}",
                _RENDER,
                **{"proxy.obj": base()["proxy.obj"], "proxy.mtl": mtl, "job.toml": job(proxy="proxy.obj")},
            ),
            _with(link, f"library of OBJ {i}", _RENDER, **{"proxy.obj": obj, "job.toml": job(proxy="proxy.obj")}),
            _with(link, f"buffer of glTF {i}", _RENDER, **{"a.gltf": gltf, "job.toml": job(proxy="a.gltf")}),
            _with(link, f"image of SOG {i}", ("inspect", "sog"), **{**sog, "sog/meta.json": meta}),
            _with(
                link,
                f"part of streamed SOG {i}",
                ("inspect", "streamed"),
                **{**streamed, "streamed/lod-meta.json": lod},
            ),
        ]
    loop = {
        f"{i}/lod-meta.json": json.dumps({"filenames": [f"../{j}/lod-meta.json" for j in range(20)]}).encode()
        for i in range(20)
    }
    top = json.dumps(
        {
            "lodLevels": 1,
            "filenames": [f"{j}/lod-meta.json" for j in range(20)],
            "tree": {"lods": {"0": {"file": 0, "offset": 0, "count": 9}}},
        }
    )
    files = {**loop, "lod-meta.json": top.encode()}
    return [
        *out,
        of_files("indices that name each other", _RENDER, scene(**files, **{"job.toml": job(splats="lod-meta.json")})),
    ]


def _light() -> list[Case]:
    def spoilt(old: str, new: str) -> bytes:
        top = base()["proxy.glb"]
        length = struct.unpack_from("<I", top, 12)[0]
        text = top[20 : 20 + length].decode()
        assert old in text, old
        return damage.glb(json.loads(text.replace(old, new)), top[20 + length :])

    out = []
    for value in ("1e308", "1e38", "1e20", "1e13", "1e12", "1e9"):
        for old in ('"intensity":20.0', '"emissiveFactor":[1.0', '"baseColorFactor":[1.0'):
            data = spoilt(old, old.rpartition("[" if "[" in old else ":")[0] + ("[" if "[" in old else ":") + value)
            text = job(proxy="bad.glb").replace(b"lights = [", b'lights_from = "proxy"\nlights = [')
            out.append(
                of_files(
                    f"{old.split(chr(34))[1]} {value}",
                    _RENDER,
                    scene(**{"bad.glb": data, "job.toml": text}),
                    bright=True,
                )
            )
        text = job().replace(b"intensity = 30", f"intensity = {value}".encode())
        out.append(of_files(f"job's light {value}", _RENDER, scene(**{"job.toml": text}), bright=True))
        text = job().replace(b"intensity = 1.5", f"intensity = {value}".encode())
        out.append(of_files(f"job's sky {value}", _RENDER, scene(**{"job.toml": text}), bright=True))
    unseen = job().replace(b'"file"', b'"splats"').replace(b"target = [0, 0, 0]", b"target = [0, 90, 0]")
    unseen = unseen.replace(b"[[cameras]]", b'captured = "day"\n[[cameras]]')
    return [*out, of_files("a proxy that nobody sees", _RENDER, scene(**{"job.toml": unseen}))]


def _pictures() -> list[Case]:
    png = base()["sky.png"]
    chunks = {
        "iCCP": (b"p\0\0no zlib", b"p\0\7", b"p", b"p\0\0" + zlib.compress(b"\0" * 2**25)),
        "gAMA": (b"\0",),
        "cHRM": (b"\0",),
        "zTXt": (b"x\0\0no", b"x\0\0" + zlib.compress(b"\0" * 2**26)),
        "iTXt": (b"x\0\1\0\0\0no",),
        "eXIf": (b"MM\0\x2a\xff\xff\xff\xff",),
        "tRNS": (b"\0",),
        "fcTL": (b"\0" * 26,),
    }
    out = []
    for kind, bodies in chunks.items():
        for i, body in enumerate(bodies):
            chunk = (
                struct.pack(">I", len(body))
                + kind.encode()
                + body
                + struct.pack(">I", zlib.crc32(kind.encode() + body))
            )
            files = {"sky.png": png[:33] + chunk + png[33:]}
            title = f"PNG {kind} {i}"
            out.append(of_files(title, ("inspect", "sky.png"), files))
            out.append(of_files(f"{title} compared", ("compare", "sky.png", "sky.png"), files))
            out.append(of_files(f"{title} as sky", _RENDER, scene(**files, **{"job.toml": job()})))
    huge = (
        png[:16]
        + struct.pack(">II", 60000, 60000)
        + png[24:29]
        + struct.pack(">I", zlib.crc32(png[12:16] + struct.pack(">II", 60000, 60000) + png[24:29]))
        + png[33:]
    )
    out += [
        of_files(f"PNG of 60000 x 60000 {x}", (*arguments,), {"sky.png": huge})
        for x, arguments in (("inspected", ("inspect", "sky.png")), ("compared", ("compare", "sky.png", "sky.png")))
    ]
    for line in ("-Y 65536 +X 65536", "-Y 1 +X 65536", "-Y 65536 +X 1", "+Y 8 +X 16", "-Y 0 +X 0", "-Y 8 +X 999999999"):
        hdr = base()["sky.hdr"].replace(b"-Y 8 +X 16", line.encode())
        out.append(of_files(f"HDR {line}", ("inspect", "sky.hdr"), {"sky.hdr": hdr}))
    return out
