"""Things for the gallery's picture of objects in the capture: a chair, a chrome ball, a bottle, a lacquered pebble, and
a brass ball behind the shrubs.

    python scripts/still_life.py docs/gallery/still-life.glb
    python scripts/still_life.py FOLDER  # each a file, its foot in the origin: chair.glb and so on
"""

from __future__ import annotations

import json
import struct
import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirelight.io.atomic import atomic_path

F64 = NDArray[np.float64]
Shape = tuple[F64, F64, NDArray[np.int64]]  # vertices, normals (N, 3), triangles (F, 3)
Thing = tuple[str, Shape, dict[str, Any]]  # its name and its glTF material with it


def turned(profile: list[tuple[float, float]], at: tuple[float, float, float], around: int = 48) -> Shape:
    """A profile of (radius, height) turned about Y, smooth."""
    radius, height = np.asarray(profile, np.float64).T
    slope = np.gradient(np.stack([radius, height], 1), axis=0)
    phi = np.linspace(0, 2 * np.pi, around + 1)
    way = np.stack([np.cos(phi), 0 * phi, np.sin(phi)], 1)
    up = np.array([0.0, 1.0, 0.0])
    vertices = (radius[:, None, None] * way + height[:, None, None] * up + np.asarray(at)).reshape(-1, 3)
    normals = (slope[:, 1, None, None] * way - slope[:, 0, None, None] * up).reshape(-1, 3)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)
    rows, columns = np.mgrid[: len(profile) - 1, :around]
    a = (rows * (around + 1) + columns).ravel()
    b, c = a + around + 1, a + around + 2
    return vertices, normals, np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, a + 1], 1)])


def boxes(parts: list[tuple[tuple[float, float, float], tuple[float, float, float]]], m: F64) -> Shape:
    """Boxes of (centre, size), moved by m (4, 4)."""
    vertices, normals = [], []
    for centre, size in parts:
        for axis in range(3):
            for side in (-1.0, 1.0):
                u, v = np.eye(3)[(axis + 1) % 3], np.eye(3)[(axis + 2) % 3] * side
                n = np.eye(3)[axis] * side
                corners = [n - u - v, n + u - v, n + u + v, n - u + v]
                vertices += [np.asarray(centre) + 0.5 * np.asarray(size) * x for x in corners]
                normals += [n] * 4
    first = 4 * np.arange(len(vertices) // 4)[:, None]
    faces = np.concatenate([first + np.array(x) for x in ([0, 1, 2], [0, 2, 3])])
    return np.asarray(vertices) @ m[:3, :3].T + m[:3, 3], np.asarray(normals) @ m[:3, :3].T, faces


def chair(x: float, z: float, degrees: float) -> Shape:
    """A plain wooden chair."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    m = np.array([[c, 0, s, x], [0, 1, 0, 0], [-s, 0, c, z], [0, 0, 0, 1.0]])
    legs = [((i, 0.22, k), (0.045, 0.44, 0.045)) for i in (-0.19, 0.19) for k in (-0.19, 0.19)]
    back = [((i, 0.68, -0.19), (0.045, 0.48, 0.045)) for i in (-0.19, 0.19)]
    slats = [((0.0, y, -0.19), (0.36, 0.07, 0.025)) for y in (0.62, 0.74, 0.87)]
    return boxes([*legs, *back, *slats, ((0.0, 0.455, 0.0), (0.46, 0.03, 0.46))], m)


def things() -> list[Thing]:
    """Name, shape and glTF material of each."""
    half = np.linspace(-np.pi / 2, np.pi / 2, 25)
    ball = [(0.3 * np.cos(t), 0.3 + 0.3 * np.sin(t)) for t in half]
    pebble = [(0.3 * np.cos(t), 0.17 + 0.17 * np.sin(t)) for t in half]
    bottle = [
        (0.0, 0.005),
        (0.1, 0.0),
        (0.125, 0.02),
        (0.13, 0.1),
        (0.13, 0.34),
        (0.11, 0.42),
        (0.05, 0.5),
        (0.042, 0.56),
    ]
    bottle += [(0.042, 0.63), (0.05, 0.65)]
    paint = {"clearcoatFactor": 1.0, "clearcoatRoughnessFactor": 0.03}
    return [
        ("chair", chair(-2.35, 2.1, 55), surface((0.36, 0.2, 0.09), 0, 0.55)),
        ("chrome", turned(ball, (-1.5, 0, 3.0)), surface((0.95, 0.95, 0.95), 1, 0.0)),
        ("brass", turned(ball, (-2.2, 0, -1.75)), surface((0.9, 0.65, 0.25), 1, 0.2)),
        (
            "glass",
            turned(bottle, (-0.95, 0, 3.1)),
            surface((0.6, 0.9, 0.7), 0, 0.0) | extension("transmission", {"transmissionFactor": 1.0}),
        ),
        (
            "paint",
            turned(pebble, (-0.6, 0, 2.55)),
            surface((0.5, 0.02, 0.03), 0.2, 0.5) | extension("clearcoat", paint),
        ),
    ]


def surface(base: tuple[float, float, float], metallic: float, roughness: float) -> dict[str, Any]:
    """A glTF material."""
    factors = {"baseColorFactor": [*base, 1], "metallicFactor": metallic, "roughnessFactor": roughness}
    return {"pbrMetallicRoughness": factors, "doubleSided": True}


def extension(name: str, values: dict[str, float]) -> dict[str, Any]:
    """One of a material."""
    return {"extensions": {f"KHR_materials_{name}": values}}


def glb(chosen: list[Thing]) -> bytes:
    """The file of some of them."""
    top: dict[str, Any] = {"asset": {"version": "2.0"}, "scene": 0, "extensionsUsed": []}
    top |= {name: [] for name in ("nodes", "meshes", "materials", "accessors", "bufferViews")}
    data = b""
    for name, (vertices, normals, faces), material in chosen:
        at: list[int] = []
        for values, kind, number in (
            (vertices.astype("<f4"), "VEC3", 5126),
            (normals.astype("<f4"), "VEC3", 5126),
            (faces.ravel().astype("<u2"), "SCALAR", 5123),
        ):
            raw = values.tobytes()
            top["bufferViews"].append({"buffer": 0, "byteOffset": len(data), "byteLength": len(raw)})
            data += raw + b"\0" * (-len(raw) % 4)
            one = {
                "bufferView": len(top["bufferViews"]) - 1,
                "componentType": number,
                "count": len(values),
                "type": kind,
            }
            if not at:
                one |= {"min": values.min(0).tolist(), "max": values.max(0).tolist()}
            top["accessors"].append(one)
            at.append(len(top["accessors"]) - 1)
        top["extensionsUsed"] += list(material.get("extensions", {}))
        top["materials"].append({"name": name, **material})
        primitive = {"attributes": {"POSITION": at[0], "NORMAL": at[1]}, "indices": at[2]}
        primitive["material"] = len(top["materials"]) - 1
        top["meshes"].append({"primitives": [primitive]})
        top["nodes"].append({"name": name, "mesh": len(top["meshes"]) - 1})
    top["scenes"] = [{"nodes": list(range(len(top["nodes"])))}]
    top["buffers"] = [{"byteLength": len(data)}]
    text = json.dumps(top, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    head = struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(data))
    return head + struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(data), b"BIN\0") + data


def main() -> None:
    path = Path(sys.argv[1])
    files = {path: things()}
    if path.suffix != ".glb":
        path.mkdir(parents=True, exist_ok=True)
        files = {path / f"{name}.glb": [(name, centred(shape), look)] for name, shape, look in things()}
    for name, chosen in files.items():
        with atomic_path(name) as fresh:
            fresh.write_bytes(glb(chosen))


def centred(shape: Shape) -> Shape:
    """A shape, moved along X and Z alone."""
    low, high = shape[0].min(0), shape[0].max(0)
    return shape[0] - (low + high) / 2 * (1, 0, 1), *shape[1:]


if __name__ == "__main__":
    main()
