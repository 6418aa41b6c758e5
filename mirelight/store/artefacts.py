"""What frames are made from, kept for the next run: traced unit lights, and arrays that are made once a scene.

Nothing is compressed: reading must cost next to nothing beside tracing.
"""

from __future__ import annotations

import os
import zipfile
from collections.abc import Collection
from contextlib import suppress
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirelight.io.atomic import atomic_path
from mirelight.io.safety import open_file
from mirelight.model import (
    F32,
    Camera,
    CellLight,
    LightingBuffer,
    LightLayer,
    Profile,
    ProxyMesh,
    SplatLayer,
    SurfaceCells,
    SurfaceTransport,
)
from mirelight.store.arrays import Arrays, is_sound, read_arrays, write_arrays

_MOST_UNUSED = 2 * 2**30  # bytes of buffers that the job does not use now, kept in case it does again
_BROKEN = (OSError, ValueError, KeyError, TypeError, AttributeError, EOFError, RecursionError, zipfile.BadZipFile)
_KINDS = ("lights", "environment", "emission")  # of `CellLight`
_LIGHT = ".light"  # suffix of buffers, composites and light on the surface


class Artefacts:
    """Files named by their keys."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def array(self, key: str) -> F32 | None:
        """A kept array; None where there is none, or it is damaged."""
        try:
            with open_file(self._folder / f"{key}.npy") as file:
                values = np.asarray(np.load(file, allow_pickle=False))
            return values if is_sound(values) else None
        except _BROKEN:
            return None

    def has_array(self, key: str) -> bool:
        """Whether there is such an array."""
        return (self._folder / f"{key}.npy").is_file()

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
            whole = open_file(self._folder / f"{key}.npz")
            with whole, np.load(whole, allow_pickle=False) as file:
                mesh = ProxyMesh(vertices=file["vertices"], faces=file["faces"])
            return mesh if is_sound(mesh.vertices) else None
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
            return _buffer(read_arrays(self.path(key)), camera)
        except _BROKEN:
            return None

    def keep_light(self, key: str, buffer: LightingBuffer) -> None:
        """Keep a buffer.

        Raises:
            OutputError: it cannot be written.
        """
        about = {
            "spp": buffer.spp,
            "rays": buffer.cell_rays,
            "layers": [x.name for x in buffer.layers],
            "noisy": [x.name for x in buffer.noisy],
        }
        write_arrays(self.path(key), _arrays(buffer), about)

    def composite(self, key: str, camera: Camera, profile: Profile, linear: bool) -> SplatLayer | None:
        """A kept composite of a camera; None where there is none, or it is damaged."""
        try:
            file = read_arrays(self.path(key))
            return SplatLayer(camera=camera, profile=profile, linear=linear, **file.arrays)
        except _BROKEN:
            return None

    def keep_composite(self, key: str, splats: SplatLayer) -> None:
        """Keep a composite.

        Raises:
            OutputError: it cannot be written.
        """
        write_arrays(self.path(key), _own_arrays(splats), {})

    def path(self, key: str) -> Path:
        """The file of a composite or buffer."""
        return self._folder / f"{key}{_LIGHT}"

    def cells(self, key: str) -> SurfaceCells | None:
        """Kept cells of a surface; None where there are none, or they are damaged."""
        try:
            file = read_arrays(self._folder / f"{key}{_LIGHT}")
            return SurfaceCells(size=float(file.about["size"]), **file.arrays)
        except _BROKEN:
            return None

    def keep_cells(self, key: str, cells: SurfaceCells) -> None:
        """Keep cells.

        Raises:
            OutputError: they cannot be written.
        """
        write_arrays(self._folder / f"{key}{_LIGHT}", _own_arrays(cells), {"size": cells.size})

    def transport(self, key: str, count: int) -> SurfaceTransport | None:
        """Kept transport between `count` cells; None where there is none, or it is damaged."""
        try:
            file = read_arrays(self._folder / f"{key}{_LIGHT}")
            made = SurfaceTransport(seed=int(file.about["seed"]), **file.arrays)
        except _BROKEN:
            return None
        return made if made.cells == count else None

    def keep_transport(self, key: str, transport: SurfaceTransport) -> None:
        """Keep transport.

        Raises:
            OutputError: it cannot be written.
        """
        write_arrays(self._folder / f"{key}{_LIGHT}", _own_arrays(transport), {"seed": transport.seed})

    def cell_lights(self, key: str, count: int) -> tuple[CellLight, ...] | None:
        """Kept light on `count` cells; None where there is none, or it is damaged."""
        try:
            file = read_arrays(self._folder / f"{key}{_LIGHT}")
            return tuple(_cell_light(file, i, count) for i in range(len(file.about["names"])))
        except _BROKEN:
            return None

    def keep_cell_lights(self, key: str, lights: tuple[CellLight, ...], count: int) -> None:
        """Keep light on `count` cells.

        Raises:
            OutputError: it cannot be written.
        """
        arrays = {f"{i}.{name}": x for i, light in enumerate(lights) for name, x in _own_arrays(light).items()}
        arrays["cells"] = np.array([count], np.int64)
        about = {"names": [x.name for x in lights], "kinds": [x.kind for x in lights], "rays": [x.rays for x in lights]}
        write_arrays(self._folder / f"{key}{_LIGHT}", arrays, about)

    def there(self) -> frozenset[str]:
        """Keys of the composites and buffers that are kept."""
        try:
            with os.scandir(self._folder) as entries:
                return frozenset(x.name.removesuffix(_LIGHT) for x in entries if x.name.endswith(_LIGHT))
        except OSError:
            return frozenset()

    def tidy(self, used: Collection[str]) -> None:
        """Remove the oldest of the buffers whose keys are not in `used`, but for a reserve."""
        unused = []
        try:
            with os.scandir(self._folder) as entries:
                for entry in entries:
                    key, _, kind = entry.name.partition(".")
                    if key and f".{kind}" == _LIGHT and key not in used:
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
    """Every array of a buffer by its name: "depth", "layers.0.direct"."""
    out = _own_arrays(buffer)
    for group, layers in (("layers", buffer.layers), ("noisy", buffer.noisy)):
        for i, layer in enumerate(layers):
            values = {f.name: getattr(layer, f.name) for f in fields(layer)}
            out |= {f"{group}.{i}.{name}": x for name, x in values.items() if isinstance(x, np.ndarray)}
    return out


def _own_arrays(
    of: LightingBuffer | SplatLayer | SurfaceCells | SurfaceTransport | CellLight,
) -> dict[str, NDArray[Any]]:
    return {f.name: x for f in fields(of) if isinstance(x := getattr(of, f.name), np.ndarray)}


def _buffer(file: Arrays, camera: Camera) -> LightingBuffer:
    there = file.arrays

    def layer(group: str, index: int, name: str) -> LightLayer:
        names = [f.name for f in fields(LightLayer) if f"{group}.{index}.{f.name}" in there]
        return LightLayer(name=name, **{n: there[f"{group}.{index}.{n}"] for n in names})

    def layers(group: str) -> tuple[LightLayer, ...]:
        return tuple(layer(group, i, name) for i, name in enumerate(file.about[group]))

    arrays: dict[str, Any] = {f.name: there[f.name] for f in fields(LightingBuffer) if f.name in there}
    spp, rays = int(file.about["spp"]), int(file.about["rays"])
    return LightingBuffer(
        camera=camera, spp=spp, cell_rays=rays, layers=layers("layers"), noisy=layers("noisy"), **arrays
    )


def _cell_light(file: Arrays, index: int, count: int) -> CellLight:
    kind = file.about["kinds"][index]
    if kind not in _KINDS:
        raise ValueError(f"light of kind {kind}")
    names = [f.name for f in fields(CellLight) if f"{index}.{f.name}" in file.arrays]
    arrays: dict[str, Any] = {"met": None} | {name: file.arrays[f"{index}.{name}"] for name in names}
    made = CellLight(name=file.about["names"][index], kind=kind, rays=int(file.about["rays"][index]), **arrays)
    if made.direct.shape[1] != count or made.indirect.shape != made.direct.shape:
        raise ValueError("light on other cells")
    return made
