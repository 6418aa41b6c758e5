"""What the scripts that make pictures of pages share: commands of mirelight, the frames of a job, and pixels.

Pixels are display values.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mirelight import cli
from mirelight.base.errors import MirelightError
from mirelight.io.atomic import atomic_path
from mirelight.io.sheet import Tile, write_sheet

if TYPE_CHECKING:
    from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
MOST_BYTES = 60_000  # of a picture: a page of a dozen still loads at once

Pixels = NDArray[np.uint8]  # (H, W, 3) display values
Tiles = list[tuple[str, Pixels]]


@dataclass(frozen=True, slots=True)
class Work:
    """One picture in the making."""

    job: Path
    folder: Path  # of its frames
    settings: Sequence[str] = ()  # laid over the job: KEY=VALUE

    @property
    def overrides(self) -> list[str]:
        return [x for setting in self.settings for x in ("--set", setting)]

    def render(self, *choice: str) -> None:
        """Its frames, or those that are chosen."""
        self.folder.mkdir(parents=True, exist_ok=True)
        run("render", self.job, "-o", self.folder, "-q", *choice, *self.overrides)

    def again(self, name: str, *settings: str) -> Path:
        """Its first frame, rendered with other settings into a folder of its own."""
        other = replace(self, folder=self.folder / name, settings=(*self.settings, *settings))
        other.render()
        return other.frames()[0][1]

    def frames(self) -> list[tuple[str, Path]]:
        """Name of the lighting and file of every frame that is there, in the job's order."""
        from mirelight.io.job import load
        from mirelight.io.job.overrides import parse

        job = load(self.job, [parse(x) for x in self.settings])
        names = [(y.name, f"{x.name}.{y.name}.png") for x in job.cameras for y in job.lightings]
        return [(lighting, self.folder / name) for lighting, name in names if (self.folder / name).is_file()]


def run(*arguments: str | Path) -> None:
    """A command of mirelight."""
    words = [str(x) for x in arguments]
    if code := cli.main(words):
        raise MirelightError(f"`mirelight {' '.join(words)}` ended with exit code {code}")


def picture(path: Path) -> Pixels:
    """(H, W, 3) display values of a file."""
    from PIL import Image

    with Image.open(path) as image:
        return np.asarray(image.convert("RGB"), dtype=np.uint8)


def resized(pixels: Pixels, shape: tuple[int, ...]) -> Image.Image:
    """A picture at (height, width, …)."""
    from PIL import Image

    return Image.fromarray(pixels).resize((shape[1], shape[0]), Image.Resampling.LANCZOS)


def part(pixels: Pixels, box: tuple[float, float, float, float]) -> Pixels:
    """A part of a picture, box: left, top, right, bottom as shares of its sides."""
    height, width = pixels.shape[:2]
    left, top, right, bottom = (round(x * y) for x, y in zip(box, (width, height, width, height), strict=True))
    return np.asarray(resized(pixels[top:bottom, left:right], (2 * (bottom - top), 2 * (right - left))))


def unlit(path: Path) -> Pixels:
    """The capture in a frame's EXR."""
    from mirelight.io.exr import read_exr
    from mirelight.io.png import encode_display
    from mirelight.model import DisplaySettings

    return encode_display(read_exr(path.with_suffix(".exr")).layer("unlit"), DisplaySettings())


def clay(normal: NDArray[np.float32]) -> Pixels:
    """A mesh of normals (H, W, 3), 0 where it is not, lit by a lamp beside the camera's shoulder."""
    slope = np.clip(normal @ np.array([-0.4, 0.5, 0.77], np.float32), 0, 1)
    shown = 255 * (0.12 + 0.8 * slope[..., None] * np.ones(3)) * (np.abs(normal).sum(-1) > 0)[..., None]
    return np.asarray(np.rint(shown), np.uint8)


def laid_out(tiles: Tiles, columns: int, width: int, path: Path) -> Pixels:
    """A sheet of so many columns, which stays at `path`; tiles are `width` pixels wide, their names under them."""
    rows = [tiles[i : i + columns] for i in range(0, len(tiles), columns)]
    write_sheet(path, [[Tile(partial(np.asarray, pixels), name) for name, pixels in row] for row in rows], size=width)
    return picture(path)


def written(pixels: Pixels, path: Path) -> Path:
    """As the best JPEG within `MOST_BYTES`."""
    from PIL import Image

    for quality in range(92, 20, -4):
        stream = io.BytesIO()
        Image.fromarray(pixels).save(stream, "JPEG", quality=quality, optimize=True, progressive=True)
        if stream.tell() <= MOST_BYTES:
            break
    with atomic_path(path) as fresh:
        fresh.write_bytes(stream.getvalue())
    return path
