"""Gaussian-splat files: one module per format, all giving :class:`mirelight.model.SplatCloud`.

Splats come in the axes of a PLY capture (usually Y down), whatever the format, except glTF and OpenUSD, which have
worlds of their own (Y up). Turn a capture upright with :func:`transform`, as a viewer's 180-degree rotation does.
``docs/reference/splat-formats.md`` says what each format keeps.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from mirelight.base.errors import InputError
from mirelight.io.safety import existing, open_binary
from mirelight.io.splats import (
    checkpoint,
    compressed_ply,
    dot_splat,
    external,
    ksplat,
    ply,
    sog,
    sog_write,
    spz,
    streamed,
)
from mirelight.io.splats.edit import merge, transform
from mirelight.io.splats.info import SplatFileInfo
from mirelight.io.splats.ply_header import read_ply_header
from mirelight.io.splats.training import resolved
from mirelight.io.suffixes import CHECKPOINTS, CONVERTED, GLTF, SPLATS, USD
from mirelight.model import SplatCloud

__all__ = ["SUFFIXES", "SplatFileInfo", "merge", "read", "summary", "transform", "write"]

SUFFIXES = (*SPLATS, ".json")  # of what can be read: a SOG may be a folder, with its meta.json

_READABLE = (
    "read are PLY, compressed PLY, SPZ, SOG, .splat, .ksplat, glTF with KHR_gaussian_splatting, OpenUSD, "
    "checkpoints of gsplat and nerfstudio, and lod-meta.json"
)


@dataclass(frozen=True, slots=True)
class _Format:
    """How one file is read."""

    summary: Callable[[], SplatFileInfo]
    read: Callable[[], SplatCloud]
    levels: bool = False  # has levels of detail


def read(path: str | Path, *, lod: int | None = None) -> SplatCloud:
    """Read splats from a file, or from a folder that holds a SOG or a training.

    Args:
        path: the file; its content decides the format, its suffix only where the content cannot. Of a training's
            folder, its last iteration.
        lod: level of detail of a streamed SOG or LCC, 0 the finest; None takes the finest.

    Returns:
        The splats; those with NaN, infinite or absurdly large values are left out and counted in `dropped`.

    Raises:
        InputError: missing, damaged, hostile, of an unknown format, or too large for the memory that is free.
    """
    return _recognise(resolved(existing(path)), lod).read()


def summary(path: str | Path, *, lod: int | None = None) -> SplatFileInfo:
    """What a splat file holds, from its head alone (LCC is converted for it).

    Args:
        path: as for :func:`read`.
        lod: as for :func:`read`.

    Raises:
        InputError: as for :func:`read`, as far as the head shows it.
    """
    return _recognise(resolved(existing(path)), lod).summary()


def write(cloud: SplatCloud, path: str | Path, *, comments: Sequence[str] = ()) -> None:
    """Write splats; the suffix names the format.

    They are .compressed.ply, .ply, .spz (version 3), .sog (version 2), .splat, .glb (KHR_gaussian_splatting)
    and .usd, .usda, .usdc, .usdz. Values go as they are: a cloud moved by :func:`transform` is written moved. SPZ is
    written in its own axes. A .glb or a stage is read as a world of its own, so give it a cloud with Y up.
    `comments` are lines of text in PLY headers; other formats have no place for them.

    Raises:
        OutputError: it cannot be written; nothing half-written is left.
        ValueError: another suffix, or values that the format cannot hold.
    """
    path = Path(path)
    name = path.name.lower()
    writers: dict[str, Callable[[SplatCloud, Path], None]] = {
        ".compressed.ply": partial(compressed_ply.write, comments=comments),
        ".ply": partial(ply.write, comments=comments),
        ".spz": spz.write,
        ".sog": sog_write.write,
        ".glb": _write_glb,
        ".splat": dot_splat.write,
        **dict.fromkeys(USD, _write_stage),
    }
    for suffix, writer in writers.items():
        if name.endswith(suffix):
            return writer(cloud, path)
    raise ValueError(f"{path.name}: splats are written as one of {', '.join(writers)}")


def _write_glb(cloud: SplatCloud, path: Path) -> None:
    from mirelight.io.splats import khr

    khr.write(cloud, path)


def _write_stage(cloud: SplatCloud, path: Path) -> None:
    from mirelight.io.usd.write import write_splats

    write_splats(cloud, path)


def _recognise(path: Path, lod: int | None) -> _Format:
    form = _by_content(path, lod)
    if lod and not form.levels:
        raise InputError(path, f"no level of detail {lod}", "this format has one level; leave lod out")
    return form


def _by_content(path: Path, lod: int | None) -> _Format:
    if path.is_dir():
        return _folder(path, lod)
    with open_binary(path) as file:
        head = file.read(64)
    suffix = path.suffix.lower()
    if not head and suffix not in GLTF:
        raise InputError(path, "empty file", "give a capture")
    if suffix in CONVERTED:
        return _Format(lambda: external.summary(path, lod), lambda: external.read(path, lod), levels=True)
    if suffix == ".ksplat":
        return _Format(lambda: ksplat.summary(path), lambda: ksplat.read(path))
    if suffix in USD:
        from mirelight.io.usd import splats as stage

        return _Format(lambda: stage.summary(path), lambda: stage.read(path))
    if head[:3] == b"ply":
        form = compressed_ply if compressed_ply.is_compressed(read_ply_header(path)) else ply
        return _Format(lambda: form.summary(path), lambda: form.read(path))
    if head[:2] == b"\x1f\x8b" or head[:4] == b"NGSP":
        return _Format(lambda: spz.summary(path), lambda: spz.read(path))
    if head[:2] == b"PK" and suffix in CHECKPOINTS:
        return _Format(lambda: checkpoint.summary(path), lambda: checkpoint.read(path))
    if head[:2] == b"PK":
        return _sog(sog.open_bundle(path), path)
    if head[:4] == b"glTF" or suffix in GLTF:
        from mirelight.io.splats import khr

        return _Format(lambda: khr.summary(path), lambda: khr.read(path))
    if head.lstrip(b"\xef\xbb\xbf \t\r\n")[:1] == b"{":
        return _json(path, lod)
    if suffix == ".splat":
        return _Format(lambda: dot_splat.summary(path), lambda: dot_splat.read(path))
    raise InputError(path, "not a splat file that is known", _READABLE)


def _folder(path: Path, lod: int | None) -> _Format:
    for name in ("lod-meta.json", "meta.json"):
        if (path / name).is_file():
            return _json(path / name, lod)
    raise InputError(path, "a folder, and no SOG (it has no meta.json or lod-meta.json)", "name a file")


def _json(path: Path, lod: int | None) -> _Format:
    if path.name.lower() == "lod-meta.json":
        return _Format(lambda: streamed.summary(path, lod), lambda: streamed.read(path, lod), levels=True)
    return _sog(sog.open_folder(path), path)


def _sog(head: sog.SogHead, path: Path) -> _Format:
    return _Format(lambda: sog.summary_of(head, path), lambda: sog.read_head(head, path))
