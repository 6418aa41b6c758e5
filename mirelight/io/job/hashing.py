"""SHA-256 of the files that a job reads, each read once for it in a process."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable, Iterator, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from mirelight import model
from mirelight.base.errors import InputError
from mirelight.io.safety import open_binary, require_memory
from mirelight.io.suffixes import CHECKPOINTS, GLTF, USD
from mirelight.model import SplatFile

_MOST_JSON = 256 * 2**20  # bytes of JSON that the readers read
_INDICES = ("lod-meta.json", "meta.json")  # what names the files of a folder of splats
_MOST_NAMES = 1_000_000


def digest(path: Path) -> str:
    """SHA-256 (hex) of a file as `sha256sum` gives it.

    A file that names others (glTF its buffers and images, OBJ its material libraries and their textures, PLY its
    texture, a stage its layers and textures, a SOG's meta.json or lod-meta.json), and a checkpoint of several GPUs or
    with settings beside it, has the digest of the list
    ``name NUL sha256 LF`` over all of them, in the order of the names. A folder has that of its lod-meta.json or
    meta.json, a training's that of its last iteration. Files that nothing names are not read.

    Raises:
        InputError: a file cannot be read, or is larger than memory; a folder without splats.
    """
    from mirelight.io.splats.training import resolved

    path = resolved(path)
    head = _index_of(path) if path.is_dir() else path
    files = sorted({head, *companions(head)})
    if files == [path]:
        return file_digest(path)
    return digest_of_all(files, head.parent)


def digest_of_splats(files: Sequence[tuple[str, SplatFile]]) -> str:
    """SHA-256 (hex) over all that decides the cloud of some splat files, each with its own :func:`digest`."""
    return model.digest("splats", [(sha, x.world_from_file, x.lod, x.color_space) for sha, x in files])


def digest_of_all(files: Iterable[Path], root: Path) -> str:
    """The digest of the list over files below `root`, see :func:`digest`. Raises InputError."""
    whole = hashlib.sha256()
    for file in files:
        name = Path(os.path.relpath(file, root)).as_posix()
        whole.update(os.fsencode(name) + f"\0{file_digest(file)}\n".encode("ascii"))
    return whole.hexdigest()


def companions(path: Path) -> set[Path]:
    """The existing files, of a training or beside or below `path`, that reading it would open too; empty where it is
    damaged."""
    suffix = path.suffix.lower()
    try:
        if suffix in GLTF:
            return set(_named(path, _gltf_names(path)))
        if suffix in USD:
            from mirelight.io.usd.files import files_of

            return {path.parent / name for name in files_of(path)}
        if suffix in (".obj", ".ply"):
            from mirelight.io import mesh

            base = path.parent.resolve()
            return {path.parent / file.relative_to(base) for file in mesh.companions(path)}
        if suffix in CHECKPOINTS:
            from mirelight.io.splats import checkpoint

            return set(checkpoint.files(path))
        if path.name.lower() in _INDICES or suffix == ".json":
            return set(_of_splats(path))
    except (InputError, OSError):  # the reader will say what is wrong with it
        pass
    return set()


def _index_of(folder: Path) -> Path:
    for name in _INDICES:
        if (folder / name).is_file():
            return folder / name
    raise InputError(folder, "a folder, and no SOG (it has no meta.json or lod-meta.json)", "name a file")


def _of_splats(path: Path) -> Iterator[Path]:
    """The images of a SOG; of a streamed one its SOGs too. Nothing below those: a SOG names images alone."""
    for file in _named(path, strings(_json(path))):
        yield file
        if path.name.lower() == _INDICES[0] and file.suffix.lower() == ".json" and file != path:
            yield from _named(file, strings(_json(file)))


def _named(path: Path, names: Iterator[str]) -> Iterator[Path]:
    """The existing files in the folder of `path` or below that the names lead to."""
    base = path.parent.resolve()
    for name in sorted(set(names)):
        if not name or len(name) > 1000 or "\0" in name:
            continue
        try:
            file = (base / name).resolve()
            inside = file.is_relative_to(base) and file.is_file()
        except (OSError, RuntimeError):
            continue
        if inside:
            yield path.parent / file.relative_to(base)


def _gltf_names(path: Path) -> Iterator[str]:
    top = _json(path)
    for kind in ("buffers", "images"):
        entries = top.get(kind) if isinstance(top, dict) else None
        for entry in entries if isinstance(entries, list) else []:
            uri = entry.get("uri") if isinstance(entry, dict) else None
            if isinstance(uri, str) and uri[:5].lower() != "data:":
                yield unquote(uri.partition("#")[0])


def _json(path: Path) -> Any:
    """The JSON of a text file or of a GLB's first chunk; None where it is none."""
    with open_binary(path) as file:
        length = os.fstat(file.fileno()).st_size
        head = file.read(20)
        if head[:4] == b"glTF":
            length, head = int.from_bytes(head[12:16], "little"), b""
        if length > _MOST_JSON:
            return None
        text = head + file.read(length - len(head))
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return None


def strings(top: object) -> Iterator[str]:
    """Every text in a document of tables and lists, up to a bound."""
    pending = [top]
    for _ in range(_MOST_NAMES):
        if not pending:
            return
        node = pending.pop()
        if isinstance(node, str):
            yield node
        elif isinstance(node, dict):
            pending += node.values()
        elif isinstance(node, list):
            pending += node


def file_digest(path: Path) -> str:
    """SHA-256 (hex) of one file alone. Raises InputError."""
    try:
        found = path.stat()
    except OSError as e:
        raise InputError(path, f"cannot be read ({e.strerror})", "check the file and its permissions") from None
    return _digest_of(path.absolute(), found.st_size, found.st_mtime_ns, found.st_ino)


@lru_cache(maxsize=10_000)
def _digest_of(path: Path, size: int, modified: int, inode: int) -> str:
    """Of a file in this state; one that is written anew has another."""
    require_memory(path, size, "its bytes")  # no reader could hold it; a sparse file may claim terabytes
    with open_binary(path) as file:
        try:
            return hashlib.file_digest(file, "sha256").hexdigest()
        except OSError as e:
            raise InputError(path, f"cannot be read ({e.strerror})", "check the file and its permissions") from None
