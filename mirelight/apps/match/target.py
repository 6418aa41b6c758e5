"""The picture to come close to, as linear light."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mirelight.apps.match.tone import CURVES, inverse
from mirelight.base import colour
from mirelight.base.errors import InputError
from mirelight.io.exr import read_exr, to_rec709
from mirelight.io.ldr import decode_srgb_image
from mirelight.io.safety import existing, open_binary
from mirelight.model import F32, F64, DisplaySettings, ToneCurve

_CLIPPED = 254.5 / 255  # display values from here on may stand for any brighter light
_THIN = 0.1  # alpha: where splats cover less, a picture over a background says nothing about them
_ROUNDING = 1e-9  # of a pixel: parts' edges that differ by less are one
_SHAPE = 0.02  # relative: how far the sides of target and frame may differ in shape


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Target:
    """A picture as it was read."""

    path: Path
    values: F32  # (h, w, 3) display values, or premultiplied linear light where `linear`
    linear: bool
    mask: F32  # (h, w) how much each pixel counts, 0 to 1

    def light(self, alpha: F32, display: DisplaySettings) -> tuple[F32, F32]:
        """The picture as light of a frame.

        Args:
            alpha: (H, W) of the frame's splats.
            display: how the picture was made of light: exposure, tone curve, background; not of an EXR.

        Returns:
            (H, W, 3) premultiplied linear light; (H, W, 3) how much it counts: nothing where it is clipped, outside of
            the mask, or where splats are thin over a background.

        Raises:
            InputError: another shape than the frame's, or nothing left that counts; display values of a view.
        """
        rows, columns = alpha.shape
        self.require_shape(rows, columns)
        counts = np.repeat(resized(self.mask, (rows, columns))[..., None], 3, axis=2)
        if display.view is not None and not self.linear:
            found = f"a displayed picture, and display.view is {display.view.view!r}, which is not turned back"
            raise InputError(self.path, found, "give an EXR")
        if self.linear:
            light = resized(self.values, (rows, columns))
        else:
            light, open_ = _undisplayed(self.values, alpha, display)
            counts = counts * open_
        if not counts.any():
            raise InputError(self.path, "no pixel that counts", "it is clipped, masked out or shows no splats")
        return np.asarray(light, np.float32), np.asarray(counts, np.float32)

    def require_shape(self, rows: int, columns: int) -> None:
        """Raises InputError where a frame of so many pixels has another shape."""
        h, w = self.values.shape[:2]
        if abs(w / h * rows / columns - 1) > _SHAPE:
            found = f"{w} x {h} pixels, a shape that the camera's {columns} x {rows} do not have"
            raise InputError(self.path, found, "crop it, or name the right camera")


def read_target(path: str | Path, mask: str | Path | None, tone: ToneCurve) -> Target:
    """Read a picture, and a mask: white counts, black does not.

    Args:
        path: .exr (linear, premultiplied light in the primaries that it names) or an 8- or 16-bit picture (display
            values).
        mask: a picture of the same shape; None: all of it counts.
        tone: the curve that the display values have gone through.

    Raises:
        InputError: a file cannot be used; a tone curve that is not turned back.
    """
    path = existing(path)
    linear = path.suffix.lower() == ".exr"
    if linear:
        image = read_exr(path)
        channels = image.channels
        if not {"R", "G", "B"} <= channels.keys():
            raise InputError(path, "an EXR without the channels R, G and B", "give a colour picture")
        values = np.stack([np.asarray(channels[x], np.float32) for x in "RGB"], axis=-1)
        values = to_rec709(path, image.metadata, values)
        if not np.isfinite(values).all():
            raise InputError(path, "pixels that are no numbers", "mend them, e.g. in the program that wrote it")
    else:
        if tone not in CURVES:
            found = f"a displayed picture, and display.tone is {tone!r}, which is not turned back"
            raise InputError(path, found, f"give an EXR, or use one of {', '.join(CURVES)}")
        with open_binary(path) as file:
            values = colour.srgb_encode(decode_srgb_image(file, path))
    counts: F32 = np.ones(values.shape[:2], np.float32)
    if mask is not None:
        counts = _mask(existing(mask))
        (h, w), (rows, columns) = counts.shape, values.shape[:2]
        if abs(w / h * rows / columns - 1) > _SHAPE:
            found = f"{w} x {h} pixels for a picture of {columns} x {rows} pixels"
            raise InputError(mask, found, "save it at the picture's size")
        counts = resized(counts, (rows, columns))
    return Target(path=path, values=values, linear=linear, mask=counts)


def resized(image: F32, size: tuple[int, int]) -> F32:
    """(H, W, …) means over the area of each new pixel of (h, w, …); the same picture at its own size."""
    if image.shape[:2] == size:
        return image
    out = image.astype(np.float64)
    for axis, count in enumerate(size):
        out = np.moveaxis(_averaged(np.moveaxis(out, axis, 0), count), 0, axis)
    return np.asarray(out, np.float32)


def _averaged(rows: F64, count: int) -> F64:
    """Means over `count` equal parts of the first axis; no less than 0 of what is not, and 0 where all is."""
    from scipy.sparse import csr_array

    at = np.arange(count + 1) * (len(rows) / count)
    cuts = np.unique(np.concatenate([at, np.arange(len(rows) + 1)]))
    length, middle = np.diff(cuts), (cuts[1:] + cuts[:-1]) / 2
    real = length > _ROUNDING
    part, row = np.searchsorted(at, middle[real]) - 1, middle[real].astype(np.intp)
    shares = csr_array((length[real] * (count / len(rows)), (part, row)), shape=(count, len(rows)))
    return np.asarray(shares @ rows.reshape(len(rows), -1)).reshape(count, *rows.shape[1:])


def _mask(path: Path) -> F32:
    with open_binary(path) as file:
        return np.asarray(colour.srgb_encode(decode_srgb_image(file, path)).mean(axis=2), np.float32)


def _undisplayed(values: F32, alpha: F32, display: DisplaySettings) -> tuple[F32, F32]:
    """Premultiplied light of display values over the background, and where they tell it: the writer's way back."""
    clipped = resized((values >= _CLIPPED).astype(np.float32), alpha.shape) > 0
    small = colour.srgb_encode(resized(colour.srgb_decode(values), alpha.shape))
    a = alpha[..., None]
    over = small - np.asarray(display.background, np.float32) * (1 - a)
    own = np.clip(over / np.maximum(a, np.float32(_THIN)), 0, 1)
    light, known = inverse(colour.srgb_decode(own), display.tone)
    light = light * np.float32(2.0**-display.exposure) * a
    return np.asarray(light, np.float32), np.asarray(~clipped & known & (a > _THIN), np.float32) * a
