"""Contact sheets: many pictures on one, small, with their names. Drawn by Pillow, with the font that it carries."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from mirelight.base.errors import OutputError, printable
from mirelight.io.atomic import atomic_path

if TYPE_CHECKING:
    from PIL import Image, ImageFont

MOST = 12  # rows, and columns, of one sheet
FORMATS = {".png": "PNG", ".jpg": "JPEG", ".jpeg": "JPEG", ".webp": "WEBP"}

_BACKGROUND, _EMPTY, _INK = (24, 24, 26), (40, 40, 43), (225, 225, 225)
_GAP = 6  # pixels between tiles
_LETTERS = 13  # pixels
_LINE = 20  # pixels, of a line of text with what is above and below it

Pixels: TypeAlias = NDArray[np.uint8]  # (H, W, 3) display values


@dataclass(frozen=True, slots=True)
class Tile:
    """One picture of a sheet."""

    picture: Callable[[], Pixels]  # called once, when its row is drawn
    name: str = ""  # written below it


def write_sheet(
    path: str | Path,
    tiles: Sequence[Sequence[Tile | None]],
    *,
    rows: Sequence[str] = (),
    columns: Sequence[str] = (),
    size: int = 192,
) -> None:
    """Draw a contact sheet. Pictures are made row by row, so that no more than one is held in full at a time.

    Args:
        path: a name ending in .png, .jpg or .webp in an existing folder; appears whole or not at all.
        tiles: row by row; None: no such picture. Pictures may differ in size; none is enlarged.
        rows: names of the rows, written to their left; none: nothing is written.
        columns: names of the columns, written above them.
        size: longer side of a small picture, pixels.

    Raises:
        OutputError: another suffix, or the file cannot be written.
    """
    from PIL import Image, ImageDraw, ImageFont

    path = Path(path)
    kind = sheet_format(path)
    font = ImageFont.load_default(_LETTERS)
    small = [[None if x is None else _small(x.picture(), size) for x in row] for row in tiles]
    count = max((len(row) for row in small), default=0)
    widths = [max([x.width for row in small for x in row[i : i + 1] if x] or [size]) for i in range(count)]
    left = 0
    if rows:
        left = _GAP + min(max((round(font.getlength(_plain(x))) for x in rows), default=0), 2 * size)
    heights = [max([x.height for x in row if x] or [size * 3 // 4]) for row in small]
    named = [any(x is not None and x.name for x in row) for row in tiles]
    steps = [h + (_LINE if n else 0) + _GAP for h, n in zip(heights, named, strict=True)]
    above = _LINE if columns else 0
    whole = left + sum(w + _GAP for w in widths) + _GAP, above + sum(steps) + _GAP
    sheet = Image.new("RGB", whole, _BACKGROUND)
    draw = ImageDraw.Draw(sheet)

    def write(x: int, y: int, text: str, width: int) -> None:
        draw.text((x, y), _fitting(text, width, font), font=font, fill=_INK)

    places = [left + _GAP + sum(w + _GAP for w in widths[:i]) for i in range(count)]
    for x, width, name in zip(places, widths, columns, strict=False):
        write(x, _GAP // 2, name, width)
    y = above + _GAP
    for k, (row, tile_row) in enumerate(zip(small, tiles, strict=True)):
        if rows:
            write(_GAP, y + heights[k] // 2 - _LETTERS // 2, rows[k], left - _GAP)
        for x, width, picture, tile in zip(places, widths, row, tile_row, strict=False):
            if picture is None or tile is None:
                draw.rectangle((x, y, x + width - 1, y + heights[k] - 1), fill=_EMPTY)
                continue
            sheet.paste(picture, (x, y))
            write(x, y + heights[k] + 2, tile.name, width)
        y += steps[k]
    with atomic_path(path) as temporary, temporary.open("wb") as stream:
        sheet.save(stream, format=kind, **({} if kind == "PNG" else {"quality": 92}))


def sheet_format(path: Path) -> str:
    """Pillow's name of the format that a file's suffix asks for.

    Raises:
        OutputError: another suffix.
    """
    kind = FORMATS.get(path.suffix.lower())
    if kind is None:
        raise OutputError(f"{path}: a sheet is written as .png, .jpg or .webp, not {path.suffix or 'without a suffix'}")
    return kind


def spread(count: int, most: int = MOST) -> list[int]:
    """Indices of at most `most` of `count` things, evenly spread, the first and the last among them."""
    if count <= most:
        return list(range(count))
    return [round(i * (count - 1) / (most - 1)) for i in range(most)]


def _small(pixels: Pixels, size: int) -> Image.Image:
    from PIL import Image

    picture = Image.fromarray(np.ascontiguousarray(pixels))
    scale = size / max(picture.size)
    if scale >= 1:
        return picture
    width, height = (max(1, round(x * scale)) for x in picture.size)
    return picture.resize((width, height), Image.Resampling.LANCZOS)


def _plain(text: str) -> str:
    return printable(text.replace("\n", " "))


def _fitting(text: str, width: int, font: ImageFont.ImageFont | ImageFont.FreeTypeFont) -> str:
    """As much of a text as fits, with "…" where something is left out."""
    text = _plain(text)
    if font.getlength(text) <= width:
        return text
    while text and font.getlength(text + "…") > width:
        text = text[:-1]
    return text + "…"
