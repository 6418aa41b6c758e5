"""The frames that a folder or a list of files holds, in order, each to be looked at when it is asked for.

A folder is known by what its runs were to make (`.mirelight/plans`), else by what its files say of themselves. Where
layers alone are kept, frames are mixed from them; in any other folder every picture counts.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirelight import dataset
from mirelight.base.errors import InputError
from mirelight.batch.order import named
from mirelight.dataset.view import DataSet
from mirelight.io.display import SUFFIXES, read_display
from mirelight.io.exr import read_header
from mirelight.io.frame_texts import CAMERA, PROVENANCE, read_text
from mirelight.io.image import read_fingerprint
from mirelight.io.png import encode_display, read_png_text
from mirelight.store.layer_index import FILE as LAYERS
from mirelight.store.planned import PlannedRuns

_ASIDE = re.compile(r"\.(partial|preview)$")  # stems of frames that are not done


@dataclass(frozen=True, slots=True)
class Shot:
    """One frame of a folder, as a picture."""

    name: str
    camera: str  # "" of pictures that do not say
    lighting: str  # the same
    pixels: Callable[[], NDArray[np.uint8]]  # (H, W, 3) display values
    file: Path | None = None  # that they are read from; None: mixed from layers


def find(paths: Sequence[Path]) -> list[Shot]:
    """The frames of files and folders, in their order.

    Args:
        paths: picture files, and output folders.

    Raises:
        InputError: nothing there, or a file that is no picture.
    """
    out: list[Shot] = []
    for path in paths:
        found = of_folder(path) if path.is_dir() else [_of_file(path)]
        several = len(paths) > 1 and path.is_dir()
        out += [replace(x, name=f"{path.name}/{x.name}") for x in found] if several else found
    return out


def of_folder(folder: Path) -> list[Shot]:
    """The frames of a folder: files as its runs planned them or as they say, else mixed from layers, else any pictures.

    Raises:
        InputError: none.
    """
    files = _files(folder)
    planned = PlannedRuns(folder / ".mirelight" / "plans").frames()
    there = [(x, files[x.name]) for x in planned if x.name in files]
    if there:
        return [Shot(x.name, x.camera, x.lighting, partial(read_display, path), path) for x, path in there]
    said = {name: _said(path) for name, path in files.items()}
    own = {name: x for name, x in said.items() if x is not None}
    if own:
        return [Shot(name, *x, partial(read_display, files[name]), files[name]) for name, x in own.items()]
    if (folder / LAYERS).is_file():
        return _mixed(dataset.open(folder))
    if not files:
        raise InputError(folder, "no frames there", "render the job first, or name picture files")
    return [Shot(name, "", "", partial(read_display, path), path) for name, path in files.items()]


def wanted(
    paths: Sequence[str], cameras: Sequence[str] | None = None, lightings: Sequence[str] | None = None
) -> list[Shot]:
    """The frames that a command line means.

    Args:
        paths: files, folders, and patterns of files ("out/orbit.*.png") that no shell has resolved.
        cameras: names, patterns, or the name of a turntable; None: all.
        lightings: names or patterns; None: all.

    Raises:
        InputError: nothing there, no such name, or a file that is no picture.
    """
    out = find([found for text in paths for found in _resolved(text)])
    for kind, names in (("camera", cameras), ("lighting", lightings)):
        there = list(dict.fromkeys(getattr(x, kind) for x in out))
        chosen = named(names, there)
        if chosen is None:
            continue
        for name in chosen:
            if name not in there:
                known = ", ".join(x for x in there[:20] if x) or "none that the files name"
                raise InputError(paths[0], f"no {kind} named {name!r}", f"there are: {known}")
        out = [x for x in out if getattr(x, kind) in chosen]
    return out


def _resolved(text: str) -> list[Path]:
    if Path(text).exists() or not any(x in text for x in "*?["):
        return [Path(text)]
    root = Path(text).anchor
    matching = [x for x in Path(root).glob(str(Path(text).relative_to(root))) if not x.name.startswith(".")]
    found = sorted(matching, key=lambda x: (str(x.parent), _natural(x.name)))
    if not found:
        raise InputError(text, "no file of that pattern", "check the path")
    return found


def _of_file(path: Path) -> Shot:
    if not path.is_file():
        raise InputError(path, "no such file", "check the path")
    if path.suffix.lower() not in SUFFIXES:
        found = f"a file of type {path.suffix or 'unknown'}"
        raise InputError(path, found, "give PNG, JPEG, WebP or EXR files, or a folder")
    camera, lighting = _said(path) or ("", "")
    return Shot(path.stem, camera, lighting, partial(read_display, path), path)


def _files(folder: Path) -> dict[str, Path]:
    """The pictures of a folder by stem, in the order of people: 2 before 10. Of several the cheapest to read."""
    order = {suffix: k for k, suffix in enumerate(SUFFIXES)}
    entries = [x for x in folder.iterdir() if x.suffix.lower() in order and not x.name.startswith(".")]
    out: dict[str, Path] = {}
    for path in sorted(entries, key=lambda x: (_natural(x.stem), order[x.suffix.lower()])):
        if path.is_file() and not _is_aside(path):
            out.setdefault(path.stem, path)
    return out


def _is_aside(path: Path) -> bool:
    """Whether a file shows a frame that is not done, and is not one of a lighting that is called so."""
    found = _ASIDE.search(path.stem)
    if found is None:
        return False
    said = _said(path)
    return said is None or not said[1].endswith(found[1]) or read_fingerprint(path) is None


def _natural(name: str) -> list[tuple[int, str]]:
    return [(int(x), "") if x.isdigit() else (0, x) for x in re.split(r"(\d+)", name.casefold())]


def _said(path: Path) -> tuple[str, str] | None:
    """Camera and lighting that a frame's file names; None where it is none of ours."""
    try:
        if path.suffix.lower() == ".exr":
            texts: Mapping[str, Any] = read_header(path)[0]
        elif path.suffix.lower() == ".png":
            texts = read_png_text(path)
        else:
            return None
        camera = read_text(path, texts, CAMERA)
        made_by = read_text(path, texts, PROVENANCE) or {}
    except InputError:
        return None
    return None if camera is None else (str(camera.get("name", "")), str(made_by.get("lighting", "")))


def _mixed(data: DataSet) -> list[Shot]:
    """Frames that are mixed when they are looked at, camera by camera."""
    index = data.index

    def pixels(camera: int, lighting: int) -> NDArray[np.uint8]:
        rgba = data.frame(camera, lighting)
        behind = data.background(camera, lighting, rgba[..., 3])
        return encode_display(rgba, index.display, index.profile, whole=index.linear, behind=behind)

    return [
        Shot(f"{camera.name}.{lighting}", camera.name, lighting, partial(pixels, i, j))
        for i, camera in enumerate(data.cameras)
        for j, lighting in enumerate(data.lightings)
    ]
