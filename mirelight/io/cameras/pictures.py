"""The pictures that a capture's cameras took, where they lie beside the cameras' file: as pinholes see them, small."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mirelight.base.errors import InputError
from mirelight.io.cameras import inria
from mirelight.io.cameras.placed import Distortion, FileCamera, Intrinsics, Panorama, Size
from mirelight.io.decoding import opened
from mirelight.io.ldr import decode_with_alpha
from mirelight.io.safety import contained, open_binary
from mirelight.model import F32, F64

if TYPE_CHECKING:
    from mirelight.io.cameras import CameraFile

MOST_VIEWS = 64  # of a capture's cameras that are looked from, evenly taken
MOST_PIXELS = 320 * 216  # of each view
_SUFFIXES = ("", ".jpg", ".JPG", ".jpeg", ".JPEG", ".png", ".PNG", ".webp")  # a file of cameras may leave it out
_ASPECT = 0.02  # by which a picture's may differ from its camera's: sides of scaled pictures are rounded
_SCALED = 1.25  # source pixels along a pixel, from which more than its middle is looked at
_MOST_PIXELS_READ = 1 << 26


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """A file that a camera took; :meth:`read` gives it as the pinhole sees it."""

    path: Path
    mask: Path | None  # black where the picture does not count
    lens: Intrinsics  # the pinhole's, on the whole picture's pixels or those of one scaled
    distortion: Distortion | Panorama | None

    @property
    def files(self) -> tuple[Path, ...]:
        """What is read."""
        return (self.path,) if self.mask is None else (self.path, self.mask)

    @property
    def size(self) -> Size:
        """Width and height in pixels that the file has, or had before it was scaled."""
        return self.lens.size if self.distortion is None else self.distortion.size(self.lens)

    def read(self) -> F32:
        """The picture on the grid of :func:`view_size`, its distortion undone.

        Returns:
            (H, W, 4): linear Rec.709, and how much of each pixel counts, 0..1: less where the picture is transparent or
            masked, and past its rims.

        Raises:
            InputError: it cannot be decoded, or has another shape than its camera's pictures.
        """
        with open_binary(self.path) as stream:
            rgb, alpha = decode_with_alpha(stream, self.path)
        shape = rgb.shape[1], rgb.shape[0]
        _require_shape(self.path, shape, self.size)
        counts = np.ones(rgb.shape[:2], np.float32) if alpha is None else alpha
        if self.mask is not None:
            counts = counts * _mask(self.mask, shape)
        weighed = np.concatenate([rgb * counts[..., None], counts[..., None]], axis=2)
        return _seen(weighed, self.size, self.lens, self.distortion)


def view_size(width: int, height: int) -> Size:
    """The size of the view of a camera of that size: smaller where it has more than `MOST_PIXELS`."""
    scale = min((MOST_PIXELS / (width * height)) ** 0.5, 1.0)
    return max(round(width * scale), 1), max(round(height * scale), 1)


def find_all(file: CameraFile, cameras: Sequence[FileCamera], folder: Path | None = None) -> tuple[Picture | None, ...]:
    """The pictures of the cameras of a file that are looked from; None for the others. See :func:`find`."""
    step = -(-len(cameras) // MOST_VIEWS)
    return tuple(None if i % step else find(file, one, folder) for i, one in enumerate(cameras))


def find(file: CameraFile, camera: FileCamera, folder: Path | None = None) -> Picture | None:
    """The picture of a camera; None where none lies there.

    Args:
        file: that the camera comes from; pictures lie where its format has them.
        camera: of that file.
        folder: where the pictures lie instead, by the names that the file has for them.

    Raises:
        InputError: what lies there is no picture, of a camera whose file does not say how large its pictures are.
    """
    if not camera.picture:
        return None
    roots = (folder,) if folder is not None else _roots(file)
    names = [camera.picture] if folder is None else [camera.picture, camera.picture.replace("\\", "/").split("/")[-1]]
    path = next((x for root in roots for name in names if (x := _file(root, name, file.path)) is not None), None)
    if path is None:
        return None
    mask = _file(file.path.parent, camera.mask, file.path) if camera.mask else None
    lens = camera.lens.fitted(camera.lens.size or _size(path))
    return Picture(path, mask, lens, camera.distortion)


def _roots(file: CameraFile) -> tuple[Path, ...]:
    """Folders that the names of a file's pictures start from."""
    match file.kind:
        case "COLMAP":
            model = file.files[1].parent.absolute()
            return tuple(above / "images" for above in (model, *list(model.parents)[:2]))
        case "Polycam":
            export = file.files[0].parent.parent
            return tuple(export / name for name in ("corrected_images", "images"))
        case "cameras.json":
            return file.path.parent / "images", file.path.parent, *inria.trained_on(file.path)
        case _:
            return (file.path.parent,)


def _file(root: Path, name: str, named_in: Path) -> Path | None:
    """A file of that name, with or without a suffix, in the folder or below."""
    for suffix in _SUFFIXES:
        try:
            path = contained(root, name + suffix, named_in, "")
            if path.is_file():
                return path
        except (InputError, OSError):
            return None
    return None


def _size(path: Path) -> Size:
    with open_binary(path) as stream, opened(stream, path, _MOST_PIXELS_READ, 0) as image:
        return image.size


def _require_shape(path: Path, found: Size, known: Size) -> None:
    if abs(found[0] * known[1] / (found[1] * known[0]) - 1) > _ASPECT:
        sides = f"{found[0]} x {found[1]} pixels where its camera has {known[0]} x {known[1]}"
        raise InputError(path, sides, "give the pictures that these cameras took, cut and turned alike")


def _mask(path: Path, shape: Size) -> F32:
    """(H, W) 0 or 1, on the grid of a picture."""
    with open_binary(path) as stream:
        gray = decode_with_alpha(stream, path)[0].mean(axis=2)
    rows, columns = (
        np.minimum((np.arange(there) + 0.5) * here / there, here - 1).astype(int)
        for there, here in zip(shape[::-1], gray.shape, strict=True)
    )
    return np.asarray(gray[np.ix_(rows, columns)] > 0.1, np.float32)


def _seen(picture: F32, whole: Size, lens: Intrinsics, distortion: Distortion | Panorama | None) -> F32:
    """A picture (H, W, 4) of one that is so large, colours times what counts, as the lens' pinhole sees it on its small
    grid."""
    width, height = view_size(lens.width, lens.height)
    step = max(picture.shape[1] * lens.width // (whole[0] * width), 1)
    small = _reduced(picture, step)
    scale = np.array([picture.shape[1] / whole[0], picture.shape[0] / whole[1]]) / step
    per_pixel = scale[0] * lens.width / width
    aside = (0.0,) if per_pixel < _SCALED and distortion is None else (-0.25, 0.25)
    out = np.zeros((height, width, 4), np.float32)
    for dv in aside:
        for du in aside:
            u, v = np.meshgrid(
                (np.arange(width) + 0.5 + du) * lens.width / width,
                (np.arange(height) + 0.5 + dv) * lens.height / height,
            )
            if distortion is not None:
                u, v = distortion.at(lens, u, v)
            out += _between(small, u * scale[0] - 0.5, v * scale[1] - 0.5)
    out /= np.float32(len(aside) ** 2)
    out[..., :3] /= np.maximum(out[..., 3:], np.float32(1e-6))
    return out


def _reduced(picture: F32, step: int) -> F32:
    """Means of squares of pixels; a rest at the right and below is left out."""
    if step == 1:
        return picture
    height, width = picture.shape[0] // step, picture.shape[1] // step
    blocks = picture[: height * step, : width * step].reshape(height, step, width, step, 4)
    return np.asarray(blocks.mean(axis=(1, 3)), np.float32)


def _between(picture: F32, x: F64, y: F64) -> F32:
    """(H, W, 4) linear between pixels' middles at x, y (H, W) in pixels from the first one; nothing past the rims."""
    high = np.array([picture.shape[1] - 1, picture.shape[0] - 1])
    inside = (x >= -0.5) & (y >= -0.5) & (x <= high[0] + 0.5) & (y <= high[1] + 0.5)
    x, y = (np.clip(np.where(inside, value, 0), 0, top) for value, top in zip((x, y), high, strict=True))
    left, top = x.astype(int), y.astype(int)
    right, below = np.minimum(left + 1, high[0]), np.minimum(top + 1, high[1])
    s, t = ((x - left)[..., None], (y - top)[..., None])
    rows = [picture[row, left] * (1 - s) + picture[row, right] * s for row in (top, below)]
    return np.asarray((rows[0] * (1 - t) + rows[1] * t) * inside[..., None], np.float32)
