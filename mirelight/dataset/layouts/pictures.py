"""One frame as data sets hold it, and its files."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from mirelight import colour
from mirelight.errors import InputError
from mirelight.io.atomic import atomic_path, output_error
from mirelight.model import F32, Camera, DisplaySettings
from mirelight.model.arrays import freeze

Split: TypeAlias = Literal["train", "val", "test"]
U8: TypeAlias = NDArray[np.uint8]

SPLITS: tuple[Split, ...] = ("train", "val", "test")
_MILLIMETRES = 1000.0  # in a world unit, which is a metre
_FARTHEST = 65535  # mm in a 16-bit depth


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Picture:
    """One frame of a data set."""

    camera: Camera
    rgba: U8  # (H, W, 4) sRGB, straight alpha
    depth: F32 | None = None  # (H, W) world units along the view axis; 0 where there is nothing
    mask: NDArray[np.bool_] | None = None  # (H, W) where pixels shall count
    split: Split = "train"

    def __post_init__(self) -> None:
        size = self.camera.height, self.camera.width
        freeze(self, "rgba", (*size, 4), np.uint8)
        freeze(self, "depth", size)
        freeze(self, "mask", size, np.bool_)


def straight_rgba(rgba: F32, display: DisplaySettings | None = None) -> U8:
    """A premultiplied linear picture as sRGB with straight alpha.

    Laid over a background by a loader, rgb a + background (1 - a), it is the PNG that mirelight writes over that
    background, except where a colour is brighter than white before it is multiplied by alpha, which 8 bits cannot hold.

    Args:
        rgba: (H, W, 4) linear, premultiplied.
        display: exposure in stops and tone curve; its background has no part in it.

    Returns:
        (H, W, 4) uint8, rounded half to even; black where alpha is 0.
    """
    display = display or DisplaySettings()
    own = colour.straight(rgba[..., :3], rgba[..., 3]) * np.float32(2.0**display.exposure)
    shown = colour.encode(colour.tone_map(own, display.tone), "physical")
    whole = np.concatenate([shown, rgba[..., 3:]], axis=-1)
    clean = np.clip(np.nan_to_num(whole, nan=0.0, posinf=1.0, neginf=0.0), 0.0, 1.0)
    return np.asarray(np.rint(clean * np.float32(255)), dtype=np.uint8)


def named(pictures: Iterable[Picture], folder: Path) -> Iterator[tuple[str, Picture]]:
    """Each picture with a file name of letters, digits, "-" and "_", all different.

    Raises:
        InputError: an orthographic camera, or masks or depths for some pictures only.
    """
    taken: set[str] = set()
    first: Picture | None = None
    for picture in pictures:
        first = first or picture
        camera = picture.camera
        if camera.projection != "perspective":
            raise InputError(folder, f"camera {camera.name!r} is orthographic", "the layout holds pinholes alone")
        for key in ("depth", "mask"):
            if (getattr(picture, key) is None) != (getattr(first, key) is None):
                raise InputError(folder, f"a {key} for some pictures, none for {camera.name!r}", "give all or none")
        stem = re.sub(r"[^A-Za-z0-9-]+", "_", camera.name).strip("_") or "camera"
        name, number = stem, 1
        while name in taken:
            number += 1
            name = f"{stem}-{number}"
        taken.add(name)
        yield name, picture


def folder_for(*parts: Path) -> None:
    """Make folders. Raises OutputError."""
    for path in parts:
        try:
            path.mkdir(parents=True, exist_ok=True)
        except OSError as e:
            raise output_error(path, e) from None


def write_pixels(path: Path, pixels: NDArray[Any]) -> None:
    """A PNG of (H, W, 4) or (H, W) uint8, or of (H, W) uint16. Raises OutputError."""
    from PIL import Image

    with atomic_path(path) as temporary:
        Image.fromarray(pixels).save(temporary, format="PNG")


def millimetres(depth: F32) -> NDArray[np.uint16]:
    """Depth in millimetres; 0, which loaders take as unknown, where there is none and beyond 65.5 m."""
    mm = np.rint(np.nan_to_num(depth, nan=0.0, posinf=0.0, neginf=0.0).astype(np.float64) * _MILLIMETRES)
    return np.where((mm > 0) & (mm <= _FARTHEST), mm, 0).astype(np.uint16)
