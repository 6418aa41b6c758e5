"""Whether splats lie where pictures show them: told by the nearest ones in coarse pixels, without rendering."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from mirelight.base import colour
from mirelight.base.sh import C0
from mirelight.model import F32, F64, Camera, SplatCloud

if TYPE_CHECKING:
    from mirelight.io.cameras import FileCamera
    from mirelight.io.cameras.pictures import Picture

_LOOKED_AT = 6  # pictures
_ROWS, _COLUMNS = 24, 32  # of coarse pixels
_FEWEST = 50  # of them, in which there are splats


def alike(cameras: Sequence[FileCamera], pictures: Sequence[Picture | None], cloud: SplatCloud) -> float | None:
    """How far pictures show the brightness of splats, -1 to 1: the mean correlation of a few; None: none are there.

    Args:
        cameras: in the world of the splats, or in another, which this tells.
        pictures: of each, or None.
        cloud: as the file has it.

    Raises:
        InputError: a picture cannot be read.
    """
    taken = [(one, picture) for one, picture in zip(cameras, pictures, strict=True) if picture is not None]
    if not taken:
        return None
    solid = cloud.opaque
    means = cloud.means[solid].astype(np.float64)
    bright = colour.luminance(np.clip(cloud.sh[solid, 0] * C0 + 0.5, 0, 1))
    found = []
    for one, picture in taken[:: -(-len(taken) // _LOOKED_AT)]:
        shown = _nearest(one.to_camera(picture.lens.size), means, bright)
        seen = _coarse(colour.luminance(colour.srgb_encode(np.clip(picture.read()[..., :3], 0, 1))))
        there = np.isfinite(shown)
        spread = min(np.std(shown[there]), np.std(seen[there])) if there.sum() >= _FEWEST else 0.0
        found.append(float(np.corrcoef(shown[there], seen[there])[0, 1]) if spread > 0 else 0.0)
    return float(np.mean(found))


def _nearest(camera: Camera, means: F64, bright: F32) -> F64:
    """(R, C) the brightness of the nearest splat, at (N, 3) of (N,), in each coarse pixel; NaN where there is none."""
    own = (means - camera.position) @ camera.world_from_camera[:3, :3]
    away = -own[:, 2]
    ahead = np.flatnonzero(away > camera.near)
    ahead = ahead[np.argsort(-away[ahead], kind="stable")]  # nearer ones are written over those behind them
    x = (camera.cx + camera.fx * own[ahead, 0] / away[ahead]) / camera.width * _COLUMNS
    y = (camera.cy - camera.fy * own[ahead, 1] / away[ahead]) / camera.height * _ROWS
    inside = (x >= 0) & (x < _COLUMNS) & (y >= 0) & (y < _ROWS)
    out = np.full((_ROWS, _COLUMNS), np.nan)
    out[y[inside].astype(int), x[inside].astype(int)] = bright[ahead[inside]]
    return out


def _coarse(picture: F32) -> F64:
    """(R, C) means of a picture (H, W)."""
    rows, columns = (np.arange(n) * m // n for n, m in zip((_ROWS, _COLUMNS), picture.shape, strict=True))
    sums = np.add.reduceat(np.add.reduceat(picture.astype(np.float64), rows, axis=0), columns, axis=1)
    sizes = np.diff([*rows, picture.shape[0]])[:, None] * np.diff([*columns, picture.shape[1]])
    return np.asarray(sums / np.maximum(sizes, 1))
