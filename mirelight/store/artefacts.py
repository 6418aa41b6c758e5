"""What frames are made from, kept for the next run: traced unit lights, and arrays that are made once a scene.

Nothing is compressed: reading must cost next to nothing beside tracing.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Collection
from contextlib import suppress
from dataclasses import fields
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

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
from mirelight.store.arrays import Arrays, maker_of, read_arrays, write_arrays

T = TypeVar("T")

_MOST_UNUSED = 2 * 2**30  # bytes of what the job does not use now, kept in case it does again
_BROKEN = (OSError, ValueError, KeyError, TypeError, AttributeError, IndexError, OverflowError, RecursionError)
_KINDS = ("lights", "environment", "emission")  # of `CellLight`
_LIGHT = ".light"  # suffix of buffers, composites and light on the surface
_ARRAY = ".array"  # suffix of arrays and meshes


class Artefacts:
    """Files named by their keys.

    Args:
        folder: their place.
        maker: the job that they are made for, as a word; empty: nothing is made here, and what is read is not touched.
    """

    def __init__(self, folder: Path, maker: str = "") -> None:
        self._folder, self._maker = folder, maker
        self.tell: Callable[[str], None] = lambda line: None  # hears of files that are damaged

    def array(self, key: str) -> F32 | None:
        """A kept array; None where there is none, or it is damaged."""
        self._touch(key)
        return self._read(key, _ARRAY, lambda file: file.arrays["values"])

    def has_array(self, key: str) -> bool:
        """Whether there is such an array."""
        self._touch(key)
        return self._path(key, _ARRAY).is_file()

    def keep_array(self, key: str, values: NDArray[Any]) -> None:
        """Keep an array.

        Raises:
            OutputError: it cannot be written.
        """
        self._write(key, _ARRAY, {"values": values})

    def mesh(self, key: str) -> ProxyMesh | None:
        """A kept mesh, vertices and faces alone; None where there is none, or it is damaged."""
        self._touch(key)

        def made(file: Arrays) -> ProxyMesh:
            return ProxyMesh(vertices=file.arrays["vertices"], faces=file.arrays["faces"])

        return self._read(key, _ARRAY, made)

    def keep_mesh(self, key: str, mesh: ProxyMesh) -> None:
        """Keep the vertices and faces of a mesh.

        Raises:
            OutputError: they cannot be written.
        """
        self._write(key, _ARRAY, {"vertices": mesh.vertices, "faces": mesh.faces})

    def light(self, key: str, camera: Camera) -> LightingBuffer | None:
        """A kept buffer, of the view of `camera`; None where there is none, or it is damaged."""
        return self._read(key, _LIGHT, lambda file: _buffer(file, camera))

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
        self._write(key, _LIGHT, _arrays(buffer), about)

    def composite(self, key: str, camera: Camera, profile: Profile, linear: bool) -> SplatLayer | None:
        """A kept composite of a camera; None where there is none, or it is damaged."""

        def layer(file: Arrays) -> SplatLayer:
            return SplatLayer(camera=camera, profile=profile, linear=linear, **file.arrays)

        return self._read(key, _LIGHT, layer)

    def keep_composite(self, key: str, splats: SplatLayer) -> None:
        """Keep a composite.

        Raises:
            OutputError: it cannot be written.
        """
        self._write(key, _LIGHT, _own_arrays(splats))

    def is_whole(self, key: str) -> bool:
        """Whether such a composite or buffer is there, its bytes those that were written."""
        return self._read(key, _LIGHT, lambda file: True) or False

    def path(self, key: str) -> Path:
        """The file of a composite or buffer."""
        return self._path(key, _LIGHT)

    def cells(self, key: str) -> SurfaceCells | None:
        """Kept cells of a surface; None where there are none, or they are damaged."""
        return self._read(key, _LIGHT, lambda file: SurfaceCells(size=float(file.about["size"]), **file.arrays))

    def keep_cells(self, key: str, cells: SurfaceCells) -> None:
        """Keep cells.

        Raises:
            OutputError: they cannot be written.
        """
        self._write(key, _LIGHT, _own_arrays(cells), {"size": cells.size})

    def transport(self, key: str, count: int) -> SurfaceTransport | None:
        """Kept transport between `count` cells; None where there is none, or it is damaged."""
        made = self._read(key, _LIGHT, lambda x: SurfaceTransport(seed=int(x.about["seed"]), **x.arrays))
        return made if made is not None and made.cells == count else None

    def keep_transport(self, key: str, transport: SurfaceTransport) -> None:
        """Keep transport.

        Raises:
            OutputError: it cannot be written.
        """
        self._write(key, _LIGHT, _own_arrays(transport), {"seed": transport.seed})

    def cell_lights(self, key: str, count: int) -> tuple[CellLight, ...] | None:
        """Kept light on `count` cells; None where there is none, or it is damaged."""

        def lights(file: Arrays) -> tuple[CellLight, ...]:
            return tuple(_cell_light(file, i, count) for i in range(len(file.about["names"])))

        return self._read(key, _LIGHT, lights)

    def keep_cell_lights(self, key: str, lights: tuple[CellLight, ...], count: int) -> None:
        """Keep light on `count` cells.

        Raises:
            OutputError: it cannot be written.
        """
        arrays = {f"{i}.{name}": x for i, light in enumerate(lights) for name, x in _own_arrays(light).items()}
        arrays["cells"] = np.array([count], np.int64)
        about = {"names": [x.name for x in lights], "kinds": [x.kind for x in lights], "rays": [x.rays for x in lights]}
        self._write(key, _LIGHT, arrays, about)

    def there(self) -> frozenset[str]:
        """Keys of the composites and buffers that are kept."""
        try:
            with os.scandir(self._folder) as entries:
                return frozenset(x.name.removesuffix(_LIGHT) for x in entries if x.name.endswith(_LIGHT))
        except OSError:
            return frozenset()

    def files(self) -> list[Path]:
        """All of them, sorted."""
        try:
            with os.scandir(self._folder) as entries:
                return sorted(Path(x.path) for x in entries if x.name[0] != "." and x.name.endswith((_LIGHT, _ARRAY)))
        except OSError:
            return []

    def tidy(self, used: Collection[str], since: float) -> None:
        """Remove the oldest of what this job made and does not use, but for a reserve. What others made stays.

        Args:
            used: keys that stay.
            since: whatever was made, read or asked for after that time stays, too.
        """
        unused = []
        for path in self.files():
            with suppress(OSError):
                status = path.stat()
                if path.stem not in used and status.st_mtime < since:
                    unused.append((status.st_mtime_ns, status.st_size, path))
        if sum(size for _, size, _ in unused) <= _MOST_UNUSED:
            return
        kept = 0
        for _, size, path in sorted(unused, reverse=True):
            if maker_of(path) != self._maker:
                continue
            kept += size
            if kept > _MOST_UNUSED:
                with suppress(OSError):
                    path.unlink()

    def _path(self, key: str, suffix: str) -> Path:
        return self._folder / f"{key}{suffix}"

    def _touch(self, key: str) -> None:
        """Note that an array is in use."""
        if self._maker:
            with suppress(OSError):
                os.utime(self._path(key, _ARRAY))

    def _read(self, key: str, suffix: str, made: Callable[[Arrays], T]) -> T | None:
        path = self._path(key, suffix)
        try:
            return made(read_arrays(path))
        except FileNotFoundError:
            return None
        except _BROKEN:
            self.tell(f"{path} is damaged; what it held is made again")
            return None

    def _write(
        self, key: str, suffix: str, arrays: dict[str, NDArray[Any]], about: dict[str, Any] | None = None
    ) -> None:
        write_arrays(self._path(key, suffix), arrays, about or {}, self._maker)


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
