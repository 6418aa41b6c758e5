"""Contact sheets of frames: cameras by lightings where there are several of both, else a grid in order."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mirelight.apps.show.shots import Shot
from mirelight.base.errors import InputError
from mirelight.io.sheet import MOST, Tile, spread, write_sheet


@dataclass(frozen=True, slots=True)
class Written:
    """The sheets that were drawn."""

    pages: tuple[Path, ...]
    shown: int  # frames
    there: int  # frames that could have been shown


@dataclass(frozen=True, slots=True)
class _Page:
    tiles: list[list[Tile | None]]
    rows: list[str]
    columns: list[str]


def write_sheets(shots: Sequence[Shot], path: Path, *, size: int = 192, every: bool = False) -> Written:
    """Draw frames on a sheet of at most 12 by 12.

    Args:
        shots: from `mirelight.apps.show.shots`.
        path: of the sheet; further pages get "-2", "-3", … behind its stem.
        size: longer side of a small picture, pixels.
        every: all frames, on as many pages as it takes; else of many cameras, lightings or pictures a choice that is
            evenly spread.

    Raises:
        InputError: no frames. OutputError: a file cannot be written.
    """
    if not shots:
        raise InputError("sheet", "no frames to show", "name a folder or picture files")
    cameras, lightings = (list(dict.fromkeys(getattr(x, kind) for x in shots)) for kind in ("camera", "lighting"))
    by_both = {(x.camera, x.lighting): x for x in shots}
    is_table = min(len(cameras), len(lightings)) > 1 and len(by_both) == len(shots)
    pages = _tables(cameras, lightings, by_both, every) if is_table else _grids(shots, every)
    paths: list[Path] = []
    for number, page in enumerate(pages, 1):
        own = page_file(path, number)
        write_sheet(own, page.tiles, rows=page.rows, columns=page.columns, size=size)
        paths.append(own)
    shown = sum(tile is not None for page in pages for row in page.tiles for tile in row)
    return Written(tuple(paths), shown, len(shots))


def page_file(path: Path, number: int) -> Path:
    """The file of a page, which are counted from 1."""
    return path if number == 1 else path.with_name(f"{path.stem}-{number}{path.suffix}")


def _tables(
    cameras: Sequence[str], lightings: Sequence[str], shots: dict[tuple[str, str], Shot], every: bool
) -> list[_Page]:
    def page(rows: Sequence[str], columns: Sequence[str]) -> _Page:
        found = [[shots.get((camera, lighting)) for lighting in columns] for camera in rows]
        tiles = [[None if x is None else Tile(x.pixels) for x in row] for row in found]
        return _Page(tiles, list(rows), list(columns))

    if not every:
        rows, columns = ([names[i] for i in spread(len(names))] for names in (cameras, lightings))
        return [page(rows, columns)]
    return [page(rows, columns) for rows in _parts(cameras, MOST) for columns in _parts(lightings, MOST)]


def _grids(shots: Sequence[Shot], every: bool) -> list[_Page]:
    most = MOST * MOST
    parts = _parts(shots, most) if every else [[shots[i] for i in spread(len(shots), most)]]
    wide = math.ceil(math.sqrt(min(len(shots), most)))
    return [_Page([[Tile(x.pixels, x.name) for x in row] for row in _parts(part, wide)], [], []) for part in parts]


def _parts(values: Sequence[Any], size: int) -> list[Sequence[Any]]:
    return [values[i : i + size] for i in range(0, len(values), size)]
