"""Light on the surface as a file: a .npz of NumPy arrays, read by NumPy alone."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np
from numpy.typing import NDArray

from mirelight.errors import InputError
from mirelight.io.atomic import atomic_path
from mirelight.io.safety import open_binary, require_memory
from mirelight.model import CellLight, SurfaceCache, SurfaceCells

VERSION = 1
_CELLS = ("origin", "keys", "starts", "anchors", "faces", "corners", "normals")
_LIGHT = ("direct", "indirect")
_KINDS = ("lights", "environment", "emission")


def write(path: Path, cache: SurfaceCache) -> None:
    """Write a cache; the file appears whole or not at all.

    Arrays: version, size, and the fields of `SurfaceCells` by name; names (K,) and kinds (K,) of the lights, and for
    light k direct_k, indirect_k and, where it has some, met_k.
    """
    cells = cache.cells
    arrays: dict[str, Any] = {name: getattr(cells, name) for name in _CELLS}
    arrays |= {"version": np.array(VERSION), "size": np.array(cells.size, np.float64)}
    arrays["names"] = np.array([x.name for x in cache.lights], dtype=np.str_)
    arrays["kinds"] = np.array([x.kind for x in cache.lights], dtype=np.str_)
    for k, light in enumerate(cache.lights):
        arrays |= {f"{name}_{k}": getattr(light, name) for name in _LIGHT}
        if light.met is not None:
            arrays[f"met_{k}"] = light.met
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        np.savez(file, **arrays)


def read(path: Path) -> SurfaceCache:
    """The cache in a file that `write` has made.

    Raises:
        InputError: it cannot be read, is no such file, is damaged, or is larger than free memory.
    """
    with open_binary(path) as file:
        try:
            with zipfile.ZipFile(file) as archive:
                require_memory(path, sum(x.file_size for x in archive.infolist()), "its arrays")
            file.seek(0)
            with np.load(file, allow_pickle=False) as arrays:
                return _cache({name: arrays[name] for name in arrays.files})
        except (OSError, ValueError, KeyError, TypeError, IndexError, EOFError, zipfile.BadZipFile) as error:
            found = f"no surface cache of version {VERSION} ({str(error)[:80]})"
            raise InputError(path, found, "let mirelight make it anew") from None


def _cache(arrays: dict[str, NDArray[Any]]) -> SurfaceCache:
    if int(arrays["version"]) != VERSION:
        raise ValueError(f"version {int(arrays['version'])}")
    cells = SurfaceCells(size=float(arrays["size"]), **{name: arrays[name] for name in _CELLS})
    lights = []
    for k, (name, kind) in enumerate(zip(arrays["names"], arrays["kinds"], strict=True)):
        if kind not in _KINDS:
            raise ValueError(f"light of kind {kind}")
        lights.append(
            CellLight(
                name=str(name),
                kind=cast(Literal["lights", "environment", "emission"], str(kind)),
                met=arrays.get(f"met_{k}"),
                **{field: arrays[f"{field}_{k}"] for field in _LIGHT},
            )
        )
    return SurfaceCache(cells=cells, lights=tuple(lights))
