"""Display pixels as the planes that video is made of: 8-bit Y'CbCr by BT.709, limited range, 4:2:0."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mirelight.model import F32

KR, KB = 0.2126, 0.0722  # ITU-R BT.709-6 §3.2
_KG = 1 - KR - KB


class Planes(NamedTuple):
    """One picture of even size: (H, W), (H / 2, W / 2), (H / 2, W / 2) uint8."""

    y: NDArray[np.uint8]
    cb: NDArray[np.uint8]
    cr: NDArray[np.uint8]


def even(pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The picture (H, W, 3) with its last row and column twice where their number is odd: 4:2:0 has none of odd
    size."""
    height, width = pixels.shape[:2]
    if height % 2 or width % 2:
        return np.pad(pixels, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
    return pixels


def planes(pixels: NDArray[np.uint8]) -> Planes:
    """A picture (H, W, 3) of even size in Y'CbCr (BT.709-6 §3.2 to §3.5: 16 to 235, chroma 16 to 240).

    Chroma lies on the left column of each square of four, in the middle of its rows, as H.264 has it unless told
    otherwise: the mean of two rows, then 1 2 1 across columns.
    """
    rgb = pixels.astype(np.float32)
    red, blue = rgb[..., 0], rgb[..., 2]
    luma = np.float32(KR) * red + np.float32(_KG) * rgb[..., 1] + np.float32(KB) * blue
    cb = _halved((blue - luma) * np.float32(224 / 255 / (2 * (1 - KB))))
    cr = _halved((red - luma) * np.float32(224 / 255 / (2 * (1 - KR))))
    return Planes(_rounded(luma * np.float32(219 / 255) + 16), _rounded(cb + 128), _rounded(cr + 128))


def _halved(plane: F32) -> F32:
    rows = (plane[0::2] + plane[1::2]) / 2
    left = np.concatenate([rows[:, :1], rows[:, 1:-1:2]], axis=1)  # of each even column; the first has none
    return np.asarray((left + 2 * rows[:, 0::2] + rows[:, 1::2]) / 4, dtype=np.float32)


def _rounded(plane: F32) -> NDArray[np.uint8]:
    return np.rint(plane).astype(np.uint8)
