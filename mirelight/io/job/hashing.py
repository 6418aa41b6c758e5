"""SHA-256 of the files that a job reads."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import unquote

from mirelight.errors import InputError

_MOST_JSON = 64 * 2**20  # a text file above this names no other files


def digest(path: Path) -> str:
    """SHA-256 (hex) of a file as `sha256sum` gives it.

    A file that is only the head of others (.gltf, a SOG's meta.json or lod-meta.json) and a folder have the digest of
    the list ``name NUL sha256 LF`` over all their files, in the order of the names.

    Raises:
        InputError: a file cannot be read.
    """
    files = sorted({path, *_companions(path)} if path.is_file() else _inside(path))
    if files == [path]:
        return _file_digest(path)
    root = path if path.is_dir() else path.parent
    whole = hashlib.sha256()
    for file in files:
        name = file.relative_to(root).as_posix() if file.is_relative_to(root) else file.name
        whole.update(f"{name}\0{_file_digest(file)}\n".encode())
    return whole.hexdigest()


def _file_digest(path: Path) -> str:
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as e:
        raise InputError(path, f"cannot be read ({e.strerror})", "check the file and its permissions") from None


def _inside(folder: Path) -> Iterator[Path]:
    return (p for p in folder.rglob("*") if p.is_file())


def _companions(path: Path) -> Iterator[Path]:
    """The existing files beside or below `path` that it names."""
    if path.suffix.lower() not in (".gltf", ".json") or path.stat().st_size > _MOST_JSON:
        return
    try:
        strings = set(_strings(json.loads(path.read_bytes())))
    except (ValueError, RecursionError, OSError):
        return  # the reader will say what is wrong with it
    base = path.parent.resolve()
    for name in strings:
        if not name or len(name) > 1000 or "\0" in name:
            continue
        try:
            file = (base / unquote(name)).resolve()
            inside = file.is_relative_to(base) and file.is_file()
        except OSError:
            continue
        if inside:
            yield path.parent / file.relative_to(base)
            if file.suffix.lower() == ".json" and file != path.resolve():  # a level of a streamed SOG
                yield from _companions(file)


def _strings(node: object) -> Iterator[str]:
    if isinstance(node, str):
        yield node
    elif isinstance(node, dict):
        for value in node.values():
            yield from _strings(value)
    elif isinstance(node, list):
        for value in node:
            yield from _strings(value)
