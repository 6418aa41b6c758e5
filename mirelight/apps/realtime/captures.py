"""Splat files for the engine: a capture's own file where the engine reads its format, else a PLY file of its splats."""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from mirelight.base import conventions
from mirelight.compositor.engine import Loaded, corners_of, loaded_ply
from mirelight.compositor.source import uploaded
from mirelight.io import splats as files
from mirelight.io.atomic import atomic_path
from mirelight.io.splats import compressed_ply, ply, sog
from mirelight.io.splats.ply_header import read_ply_header
from mirelight.io.suffixes import CONVERTED
from mirelight.model import F64, Job, SplatCloud, SplatFile

Kind = Literal["ply", "compressed", "sog", "sog folder"]  # what the engine reads by itself
_NAMES: dict[Kind, str] = {
    "ply": "splats.ply",
    "compressed": "splats.compressed.ply",
    "sog": "splats.sog",
    "sog folder": "splats.meta.json",
}
_LINK = Callable[[Path, str], bool]  # makes a folder's file a link to another export's; False: it cannot


@dataclass(frozen=True, slots=True, eq=False)
class Handed:
    """One file that the engine is given."""

    file: SplatFile | None  # the capture's own; None: a PLY file of the splats is written, in world space
    kind: Kind = "ply"

    @property
    def world_from_file(self) -> F64:
        """(4, 4) matrix from the file's axes to the world's."""
        return np.eye(4) if self.file is None else self.file.world_from_file


def handed(job: Job) -> tuple[Handed, ...]:
    """What the engine is given of a job's splats: all of its files as they are, or one made of their splats.

    A file that the engine would read otherwise than mirelight does is not given to it: other byte orders, 2D Gaussians,
    Mip-Splatting's filter, harmonics above degree 3, splats that are not finite.

    Raises:
        InputError: a file cannot be used.
    """
    if job.splats is None:
        return ()
    kinds = [_kind(file) for file in job.splat_files]
    if not kinds or None in kinds or job.splats.value.dropped:
        return (Handed(None),)
    return tuple(Handed(file, kind) for file, kind in zip(job.splat_files, kinds, strict=True) if kind is not None)


def write(job: Job, folder: Path, linked: _LINK) -> list[dict[str, Any]]:
    """Put a job's splats into a folder; the entries of scene.json that name them.

    Args:
        job: with splats or without.
        folder: an existing one.
        linked: tried before a file is written: whether another export's file serves (folder, name).

    Raises:
        OutputError: the folder cannot be written.
    """
    given = handed(job)
    out = []
    for k, one in enumerate(given):
        name = _NAMES[one.kind] if len(given) == 1 else f"{k + 1}.{_NAMES[one.kind]}"
        for target, make in _parts(job, one, name):
            if not linked(folder, target):
                with atomic_path(folder / target) as temporary:
                    make(temporary)
        out.append({"file": name} | placed(one.world_from_file))
    return out


def placed(m: F64) -> dict[str, Any]:
    """A similarity (4, 4) as scene.json has it: position, rotation (a quaternion x, y, z, w), scale; nothing for the
    identity."""
    if np.array_equal(m, np.eye(4)):
        return {}
    scale = float(np.cbrt(np.linalg.det(m[:3, :3])))
    w, x, y, z = conventions.quaternion_from_rotation(m[:3, :3] / scale)
    return {"position": m[:3, 3].tolist(), "rotation": [float(v) for v in (x, y, z, w)], "scale": scale}


def _parts(job: Job, one: Handed, name: str) -> Iterator[tuple[str, Callable[[Path], object]]]:
    """The files of one capture: a name in the folder, and what writes it."""
    if one.file is None:
        assert job.splats is not None
        cloud = job.splats
        yield name, lambda path: ply.write(cloud.value, path)
        return
    path = one.file.path
    if one.kind != "sog folder":
        yield name, lambda target: shutil.copyfile(path, target)
        return
    head = _sog_head(path)
    texts = {image: f"{name.removesuffix('.meta.json')}.{image}" for image in _images(head)}
    yield name, lambda target: target.write_text(json.dumps(_renamed(head, texts)), encoding="utf-8")
    for image, own in texts.items():
        yield own, _copier(head, image)


def _copier(head: sog.SogHead, image: str) -> Callable[[Path], object]:
    return lambda target: target.write_bytes(head.files.load(image, 1 << 30, "files"))


_PARTS = ("means", "scales", "quats", "sh0", "shN")


def _images(head: sog.SogHead) -> list[str]:
    return [x for part in _PARTS if part in head.meta for x in head.meta.child(part).texts("files")]


def _renamed(head: sog.SogHead, names: dict[str, str]) -> dict[str, Any]:
    meta = dict(head.meta.values)
    for part in _PARTS:
        if part in meta:
            meta[part] = {**meta[part], "files": [names[x] for x in meta[part]["files"]]}
    return meta


def _kind(file: SplatFile) -> Kind | None:
    """None: the engine does not read it, or not as mirelight does."""
    if file.lod is not None or file.path.suffix.lower() in CONVERTED:
        return None
    found = files.summary(file.path)
    if found.format.startswith("SOG v"):
        if _is_sog_folder(file.path):
            return "sog folder"
        return "sog" if found.format == "SOG v2" else None  # it upgrades old ones in folders only
    if found.format not in ("INRIA PLY", "compressed PLY") or found.notes:
        return None
    tables = list(read_ply_header(file.path).elements.values())
    end = tables[-1].offset + tables[-1].count * tables[-1].dtype.itemsize
    little = all(np.dtype(t).str[0] in "<|" for table in tables for t, *_ in (table.dtype.fields or {}).values())
    if not little or end != file.path.stat().st_size:
        return None
    return "compressed" if found.format == "compressed PLY" else "ply"


def _is_sog_folder(path: Path) -> bool:
    return path.is_dir() or path.suffix.lower() == ".json"


def _sog_head(path: Path) -> sog.SogHead:
    if not _is_sog_folder(path):
        return sog.open_bundle(path)
    return sog.open_folder(path / "meta.json" if path.is_dir() else path)


# --- as the engine holds them -----------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class HeldSplats:
    """A job's splats in the engine: what its textures hold, and in which order."""

    textures: SplatCloud  # world space
    loaded: Loaded


def held(job: Job, cloud: SplatCloud) -> HeldSplats:
    """What becomes of the files that :func:`handed` gives the engine; several are held one after the other.

    Args:
        job: whose splats they are.
        cloud: those, in world space.
    """
    given = handed(job)
    if not given or given[0].file is None:
        return HeldSplats(uploaded(cloud), loaded_ply(cloud))
    parts = [_held(one, cloud if len(given) == 1 else None) for one in given]
    starts = np.cumsum([0, *(len(x.loaded.place) for x in parts)])
    places = np.concatenate([x.loaded.place + start for x, start in zip(parts, starts, strict=False)])
    corners = np.concatenate([x.loaded.corners for x in parts])
    textures = parts[0].textures if len(parts) == 1 else files.merge([x.textures for x in parts])
    return HeldSplats(textures, Loaded(places, corners))


def _held(one: Handed, world: SplatCloud | None) -> HeldSplats:
    """`world`: the file's splats in world space, where they are known."""
    assert one.file is not None
    m, path = one.file.world_from_file, one.file.path
    if one.kind == "ply":  # half floats, in the file's axes
        own = files.read(path)
        return HeldSplats(files.transform(uploaded(own), m), loaded_ply(own, m))
    cloud = files.transform(files.read(path), m) if world is None else world
    low, high = _chunk_bounds(path) if one.kind == "compressed" else _sog_bounds(path)
    return HeldSplats(cloud, Loaded(np.arange(len(cloud)), corners_of(low, high, m)))


def _chunk_bounds(path: Path) -> tuple[F64, F64]:
    """What the engine takes for the bounds of a compressed PLY file (`GSplatCompressedData.calcAabb`)."""
    low, high, scale = compressed_ply.chunk_bounds(path)
    reach = np.exp(scale.max(axis=1, keepdims=True))
    return (low - reach).min(axis=0), (high + reach).max(axis=0)


def _sog_bounds(path: Path) -> tuple[F64, F64]:
    """The same of a SOG (`GSplatSogData.calcAabb`): of its centres alone."""
    means = _sog_head(path).meta.child("means")
    logs: Sequence[F64] = [np.asarray(means.vector(name, 3), dtype=np.float64) for name in ("mins", "maxs")]
    low, high = (np.array([math.copysign(math.expm1(abs(x)), x) for x in values]) for values in logs)
    return low, high
