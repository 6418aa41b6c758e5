"""The contact sheet of a data set: cameras by lightings, evenly chosen where there are many."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

from mirelight.dataset.layouts.files import Files
from mirelight.dataset.layouts.pictures import U8, Picture
from mirelight.io.sheet import Tile, spread, write_sheet
from mirelight.model import digest

FILE = "sheet.jpg"


def write(files: Files, cameras: Sequence[str], lightings: Sequence[str], of: Callable[[int, str], Picture]) -> None:
    """Draws the data set's contact sheet, sheet.jpg.

    Args:
        files: of the data set.
        cameras: their names.
        lightings: their names.
        of: gives the frame of a camera, by its index, and a lighting.

    Raises:
        OutputError: it cannot be written.
    """
    rows, columns = spread(len(cameras)), [lightings[i] for i in spread(len(lightings))]
    pictures = [[of(row, column) for column in columns] for row in rows]
    key = digest("sheet 1", [[p.key for p in line] for line in pictures], [cameras[i] for i in rows], columns)
    tiles = [[Tile(partial(_shown, p)) for p in line] for line in pictures]
    names = [cameras[i] for i in rows]
    files.put(FILE, key, lambda path: write_sheet(path, tiles, rows=names, columns=columns))


def _shown(picture: Picture) -> U8:
    """(H, W, 3) over black."""
    shown = picture.pixels.rgb
    picture.pixels.forget()
    return shown
