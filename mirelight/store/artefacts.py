"""What frames are made from, kept for the next run: traced unit lights, and arrays that are made once a scene.

Files are plain `.npz` and `.npy`, uncompressed: reading them must cost next to nothing beside tracing.
"""

from __future__ import annotations

import json
import os
import zipfile
from collections.abc import Collection, Mapping
from contextlib import suppress
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirelight.io.atomic import atomic_path
from mirelight.model import F32, Camera, LightingBuffer, LightLayer, ProxyMesh

_MOST_UNUSED = 2 * 2**30  # bytes of buffers that the job does not use now, kept in case it does again
_BROKEN = (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile)


class Artefacts:
    """Files named by their keys."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def array(self, key: str) -> F32 | None:
        """A kept array; None where there is none, or it is damaged."""
        try:
            return np.asarray(np.load(self._folder / f"{key}.npy", allow_pickle=False))
        except _BROKEN:
            return None

    def keep_array(self, key: str, values: NDArray[Any]) -> None:
        """Keep an array.

        Raises:
            OutputError: it cannot be written.
        """
        with atomic_path(self._folder / f"{key}.npy") as temporary, temporary.open("wb") as stream:
            np.save(stream, values, allow_pickle=False)

    def mesh(self, key: str) -> ProxyMesh | None:
        """A kept mesh, vertices and faces alone; None where there is none, or it is damaged."""
        try:
            with np.load(self._folder / f"{key}.npz", allow_pickle=False) as file:
                return ProxyMesh(vertices=file["vertices"], faces=file["faces"])
        except _BROKEN:
            return None

    def keep_mesh(self, key: str, mesh: ProxyMesh) -> None:
        """Keep the vertices and faces of a mesh.

        Raises:
            OutputError: they cannot be written.
        """
        with atomic_path(self._folder / f"{key}.npz") as temporary, temporary.open("wb") as stream:
            np.savez(stream, allow_pickle=False, vertices=mesh.vertices, faces=mesh.faces)

    def light(self, key: str, camera: Camera) -> LightingBuffer | None:
        """A kept buffer, of the view of `camera`; None where there is none, or it is damaged."""
        try:
            with np.load(self._folder / f"{key}.npz", allow_pickle=False) as file:
                return _buffer(file, camera)
        except _BROKEN:
            return None

    def keep_light(self, key: str, buffer: LightingBuffer) -> None:
        """Keep a buffer.

        Raises:
            OutputError: it cannot be written.
        """
        with atomic_path(self._folder / f"{key}.npz") as temporary, temporary.open("wb") as stream:
            np.savez(stream, allow_pickle=False, **_arrays(buffer))

    def tidy(self, used: Collection[str]) -> None:
        """Remove the oldest of the buffers whose keys are not in `used`, but for a reserve."""
        unused = []
        try:
            with os.scandir(self._folder) as entries:
                for entry in entries:
                    if entry.name.endswith(".npz") and not entry.name.startswith(".") and entry.name[:-4] not in used:
                        status = entry.stat()
                        unused.append((status.st_mtime_ns, status.st_size, entry.path))
        except OSError:
            return
        kept = 0
        for _, size, path in sorted(unused, reverse=True):
            kept += size
            if kept > _MOST_UNUSED:
                with suppress(OSError):
                    Path(path).unlink()


def _arrays(buffer: LightingBuffer) -> dict[str, NDArray[Any]]:
    """Every array of a buffer by its name; names of layers and the number of samples as JSON in one more."""
    out: dict[str, NDArray[Any]] = {}
    for field in fields(LightingBuffer):
        value = getattr(buffer, field.name)
        if isinstance(value, np.ndarray):
            out[field.name] = value
    groups = {"layers": buffer.layers, "noisy": buffer.noisy}
    for group, layers in groups.items():
        for i, layer in enumerate(layers):
            values = {f.name: getattr(layer, f.name) for f in fields(LightLayer)}
            out |= {f"{group}.{i}.{name}": x for name, x in values.items() if isinstance(x, np.ndarray)}
    about = {"spp": buffer.spp, **{group: [x.name for x in layers] for group, layers in groups.items()}}
    return out | {"about": np.frombuffer(json.dumps(about).encode(), np.uint8)}


def _buffer(file: Mapping[str, NDArray[Any]], camera: Camera) -> LightingBuffer:
    there = set(file)
    about = json.loads(bytes(file["about"]))

    def layer(group: str, index: int, name: str) -> LightLayer:
        names = [f.name for f in fields(LightLayer) if f"{group}.{index}.{f.name}" in there]
        return LightLayer(name=name, **{n: file[f"{group}.{index}.{n}"] for n in names})

    def layers(group: str) -> tuple[LightLayer, ...]:
        return tuple(layer(group, i, name) for i, name in enumerate(about[group]))

    arrays: dict[str, Any] = {f.name: file[f.name] for f in fields(LightingBuffer) if f.name in there}
    return LightingBuffer(camera=camera, spp=about["spp"], layers=layers("layers"), noisy=layers("noisy"), **arrays)
