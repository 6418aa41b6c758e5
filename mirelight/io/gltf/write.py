"""Write a mesh, lights and cameras as one GLB file; lights alone as glTF, too."""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirelight.base import conventions
from mirelight.base.errors import OutputError
from mirelight.base.version import __version__
from mirelight.io.atomic import write_file
from mirelight.io.gltf.beyond import written
from mirelight.io.gltf.material_entries import material_entry, wrap_numbers
from mirelight.model import (
    Camera,
    DirectionalLight,
    Light,
    Material,
    PointLight,
    PosedLight,
    ProxyMesh,
    SpotLight,
    Wraps,
)

_LIGHTS = "KHR_lights_punctual"
ARRAY_BUFFER, _INDEX_BUFFER = 34962, 34963


def write_glb(
    path: str | Path, mesh: ProxyMesh | None = None, lights: Sequence[Light] = (), cameras: Sequence[Camera] = ()
) -> None:
    """Write a GLB file that `read_scene` and any glTF viewer reads.

    Vertices, normals, texture coordinates, colours and faces come back bit for bit; faces are grouped by material.
    Materials keep all that is followed of them; textures are PNG of 8 bits. A mesh's `albedo`, if it has one, is not
    stored: the file keeps the surface's own colours. What KHR_lights_punctual has no words for stands in a light's
    extras (`gltf.beyond`).

    Args:
        path: the file to write.
        mesh: what to store, in world space.
        lights: each becomes a node; those of measured luminaires cannot be stored.
        cameras: centred cameras, each as a node.

    Raises:
        OutputError: a light or a camera that glTF cannot hold, or a file that cannot be written.
    """
    builder = GlbBuilder(Path(path))
    if mesh is not None:
        builder.add_mesh(mesh)
    for light in lights:
        builder.add_light(light)
    for camera in cameras:
        builder.add_camera(camera)
    write_file(path, builder.glb())


def holds_camera(camera: Camera) -> bool:
    """Whether glTF can hold it: it is centred, with square pixels."""
    centred = math.isclose(camera.cx * 2, camera.width) and math.isclose(camera.cy * 2, camera.height)
    return centred and math.isclose(camera.fx, camera.fy, rel_tol=1e-6)


def write_lights(path: str | Path, lights: Sequence[Light], notes: Sequence[str] = ()) -> None:
    """Write lights alone as .glb, or as .gltf, which is text.

    Args:
        path: the file to write.
        lights: as for `write_glb`.
        notes: lines for a person, in the file's `asset.extras`.

    Raises:
        OutputError: a light that glTF cannot hold, or a file that cannot be written.
    """
    builder = GlbBuilder(Path(path), notes=list(notes))
    for light in lights:
        builder.add_light(light)
    write_file(path, builder.text() if Path(path).suffix.lower() == ".gltf" else builder.glb())


def check_light(path: str | Path, light: Light) -> None:
    """Raises OutputError: glTF cannot hold it."""
    if isinstance(light, PointLight | SpotLight) and light.profile is not None:
        raise OutputError(f"{path}: glTF has no measured lights (IES), as {light.name!r} is one; nothing was written")


@dataclass
class GlbBuilder:
    """Collects the JSON and the binary chunk of one GLB file.

    `used`: the extensions that its parts name; `notes`: lines for a person.
    """

    path: Path
    binary: bytearray = field(default_factory=bytearray)
    parts: dict[str, list[dict[str, Any]]] = field(default_factory=dict)
    lights: list[dict[str, Any]] = field(default_factory=list)
    used: set[str] = field(default_factory=set)
    notes: list[str] = field(default_factory=list)

    def add(self, kind: str, entry: dict[str, Any]) -> int:
        """Append an entry to one of the top-level arrays; returns its index."""
        entries = self.parts.setdefault(kind, [])
        entries.append(entry)
        return len(entries) - 1

    def add_view(self, data: bytes, target: int | None = None) -> int:
        """Append bytes to the binary chunk, aligned to 4."""
        self.binary += b"\0" * (-len(self.binary) % 4)
        entry: dict[str, Any] = {"buffer": 0, "byteOffset": len(self.binary), "byteLength": len(data)}
        if target is not None:
            entry["target"] = target
        self.binary += data
        return self.add("bufferViews", entry)

    def add_accessor(self, values: NDArray[Any], target: int, bounds: bool = False) -> int:
        """Store (n,) or (n, k) uint32, float32, or uint8 that stands for 0 to 1."""
        values = np.ascontiguousarray(values)
        entry: dict[str, Any] = {
            "bufferView": self.add_view(values.tobytes(), target),
            "componentType": {"f": 5126, "u": 5125}[values.dtype.kind] if values.itemsize == 4 else 5121,
            "count": len(values),
            "type": "SCALAR" if values.ndim == 1 else f"VEC{values.shape[1]}",
        }
        if values.itemsize == 1:
            entry["normalized"] = True
        if bounds:
            entry["min"], entry["max"] = values.min(axis=0).tolist(), values.max(axis=0).tolist()
        return self.add("accessors", entry)

    def add_mesh(self, mesh: ProxyMesh) -> None:
        if not len(mesh.vertices) or not len(mesh.faces):
            raise OutputError(f"{self.path}: a mesh without triangles cannot be stored; nothing was written")
        attributes = {"POSITION": self.add_accessor(mesh.vertices, ARRAY_BUFFER, bounds=True)}
        for name, values in (("NORMAL", mesh.normals), ("TEXCOORD_0", mesh.uvs), ("COLOR_0", mesh.vertex_colors)):
            if values is not None:
                attributes[name] = self.add_accessor(values, ARRAY_BUFFER)
        primitives = []
        for index, material in enumerate(mesh.materials):
            faces = mesh.faces[mesh.owners == index]
            if len(faces):
                indices = self.add_accessor(faces.reshape(-1).astype(np.uint32), _INDEX_BUFFER)
                entry = {"attributes": attributes, "indices": indices, "material": self.add_material(material)}
                primitives.append(entry)
        self.add("nodes", {"name": "proxy", "mesh": self.add("meshes", {"name": "proxy", "primitives": primitives})})

    def add_material(self, material: Material) -> int:
        entry = material_entry(material, self.add_texture)
        self.used.update(entry.get("extensions", {}))
        return self.add("materials", entry)

    def add_texture(self, png: bytes, wraps: Wraps) -> dict[str, Any]:
        """Add a picture's file and return what a material says of it."""
        view = self.add_view(png)
        texture = {"source": self.add("images", {"bufferView": view, "mimeType": "image/png"})}
        sampler = wrap_numbers(wraps)
        if sampler:
            texture["sampler"] = self.add("samplers", sampler)
        return {"index": self.add("textures", texture)}

    def add_light(self, light: Light) -> None:
        check_light(self.path, light)
        plain, extras = written(light)
        entry: dict[str, Any] = {"name": plain.name, "color": plain.color.tolist(), "intensity": plain.intensity}
        pose = light.world_from_light.copy() if isinstance(light, PosedLight) else np.eye(4)
        if not isinstance(light, PosedLight) and not isinstance(plain, PointLight):
            pose[:3, :3] = _rotation_along(plain.direction)
        if isinstance(plain, DirectionalLight):
            entry["type"] = "directional"
        else:
            pose[:3, 3] = plain.position
            entry["type"] = "point" if isinstance(plain, PointLight) else "spot"
            if math.isfinite(plain.range):
                entry["range"] = plain.range
        if isinstance(plain, SpotLight):
            entry["spot"] = {"innerConeAngle": plain.inner_cone_angle, "outerConeAngle": plain.outer_cone_angle}
        if extras:
            entry["extras"] = extras
        self.used.add(_LIGHTS)
        self.lights.append(entry)
        extension = {_LIGHTS: {"light": len(self.lights) - 1}}
        self.add("nodes", {"name": light.name, "matrix": _column_major(pose), "extensions": extension})

    def add_camera(self, camera: Camera) -> None:
        if not holds_camera(camera):
            found = "off-centre or has pixels that are not square"
            raise OutputError(f"{self.path}: the camera {camera.name!r} is {found}; glTF cannot hold it")
        view: dict[str, Any] = {"znear": camera.near}
        if math.isfinite(camera.far):
            view["zfar"] = camera.far
        if camera.projection == "perspective":
            view |= {
                "yfov": 2 * math.atan(camera.height / (2 * camera.fy)),
                "aspectRatio": camera.width / camera.height,
            }
        else:
            view |= {"xmag": camera.width / (2 * camera.fx), "ymag": camera.height / (2 * camera.fy)}
            view.setdefault("zfar", camera.near * 1e6)  # orthographic cameras must have one
        index = self.add("cameras", {"name": camera.name, "type": camera.projection, camera.projection: view})
        node = {"name": camera.name, "camera": index, "matrix": _column_major(camera.world_from_camera)}
        self.add("nodes", node)

    def glb(self) -> bytes:
        """The whole file (glTF §4.4)."""
        top = self._top()
        body = bytes(self.binary) + b"\0" * (-len(self.binary) % 4)
        if body:
            top["buffers"] = [{"byteLength": len(body)}]
        text = json.dumps(top, separators=(",", ":"), allow_nan=False).encode()
        text += b" " * (-len(text) % 4)
        chunks = struct.pack("<2I", len(text), 0x4E4F534A) + text
        if body:
            chunks += struct.pack("<2I", len(body), 0x004E4942) + body
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks

    def text(self) -> bytes:
        """The whole file as JSON, where nothing of it is binary."""
        assert not self.binary
        return (json.dumps(self._top(), indent=2, allow_nan=False, ensure_ascii=False) + "\n").encode()

    def _top(self) -> dict[str, Any]:
        asset: dict[str, Any] = {"version": "2.0", "generator": f"mirelight {__version__}"}
        if self.notes:
            asset["extras"] = {"notes": self.notes}
        top: dict[str, Any] = {
            "asset": asset,
            "scene": 0,
            "scenes": [{"nodes": list(range(len(self.parts.get("nodes", []))))} if "nodes" in self.parts else {}],
            **self.parts,
        }
        if self.used:
            top["extensionsUsed"] = sorted(self.used)
        if self.lights:
            top["extensions"] = {_LIGHTS: {"lights": self.lights}}
        return top


def _rotation_along(direction: NDArray[np.float64]) -> NDArray[np.float64]:
    """A rotation (3, 3) whose -Z is `direction`, exactly."""
    rotation = conventions.look_at((0, 0, 0), direction)[:3, :3].copy()
    rotation[:, 2] = -direction
    return rotation


def _column_major(matrix: NDArray[np.float64]) -> list[float]:
    return [float(x) for x in matrix.T.reshape(-1)]
