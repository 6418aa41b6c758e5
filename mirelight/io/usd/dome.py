"""Dome lights as one environment map."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mirelight.base import conventions
from mirelight.base.errors import InputError
from mirelight.io.usd.rows import LightRow
from mirelight.model import F32, F64

_LATLONG = ("latlong", "automatic")


def dome_map(domes: Sequence[tuple[F32 | None, LightRow]], path: Path) -> F32:
    """The sum of all domes.

    Args:
        domes: the picture of each, None where it is even, and what the stage says of it.
        path: the stage.

    Returns:
        (h, w, 3) radiance in the axes of :class:`mirelight.model.Environment` at rotation 0; 1 x 1 where it is even.

    Raises:
        InputError: a format of pictures that is not read.
    """
    even = np.zeros(3)
    maps = list[F32]()
    for picture, row in domes:
        if picture is None:
            even += row.radiance
        else:
            maps.append(_turned(picture, row, path) * np.array(row.radiance, np.float32))
    if not maps:
        return even.astype(np.float32).reshape(1, 1, 3)
    height, width = max((x.shape[:2] for x in maps), key=lambda x: x[0] * x[1])
    whole = sum((x if x.shape[:2] == (height, width) else _sized(x, height, width) for x in maps), start=np.float32(0))
    return np.asarray(whole + even.astype(np.float32), np.float32)


def _turned(picture: F32, row: LightRow, path: Path) -> F32:
    """A picture as a map in our axes. One that only turns by whole columns keeps its pixels."""
    turn = conventions.rigid_part(np.array(row.world))[:3, :3]
    height, width = picture.shape[:2]
    if row.texture_format in _LATLONG:
        shift = (0.25 - math.atan2(turn[0, 2], turn[2, 2]) / (2 * math.pi)) * width
        if abs(turn[1, 1] - 1) < 1e-12 and abs(shift - round(shift)) < 1e-6:
            return np.roll(picture, round(shift), axis=1)
    elif row.texture_format not in ("mirroredBall", "angular"):
        remedy = "save the picture as latlong"
        raise InputError(path, f"a dome of format {row.texture_format[:40]!r}", remedy, field=row.prim)
    ways = conventions.map_pixels(height) @ turn  # in the dome's own axes
    x, y, z = np.moveaxis(ways, -1, 0)
    if row.texture_format in _LATLONG:
        u = 0.5 - np.arctan2(x, z) / (2 * math.pi)
        v = np.arccos(np.clip(y, -1, 1)) / math.pi
        return _sampled(picture, u, v, around=True)
    if row.texture_format == "angular":  # the middle shows +Z, the rim -Z
        reach = np.arccos(np.clip(z, -1, 1)) / math.pi
        across = np.maximum(np.hypot(x, y), 1e-12)
        x, y = reach * x / across, reach * y / across
    else:  # the normal of the ball is half way between the direction and +Z
        length = np.maximum(np.sqrt(x * x + y * y + (z + 1) ** 2), 1e-12)
        x, y = x / length, y / length
    return _sampled(picture, (x + 1) / 2, (1 - y) / 2, around=False)


def _sampled(picture: F32, u: F64, v: F64, *, around: bool) -> F32:
    """Bilinear, u and v from 0 to 1 from the left and the top; `around`: the left edge meets the right one."""
    height, width = picture.shape[:2]
    x, y = u * width - 0.5, np.clip(v * height - 0.5, 0, height - 1)
    if not around:
        x = np.clip(x, 0, width - 1)
    i, j = np.floor(x).astype(int), np.minimum(np.floor(y).astype(int), height - 1)
    fx, fy = (x - i)[..., None].astype(np.float32), (y - j)[..., None].astype(np.float32)
    right, below = (i + 1) % width if around else np.minimum(i + 1, width - 1), np.minimum(j + 1, height - 1)
    i = i % width
    upper = picture[j, i] * (1 - fx) + picture[j, right] * fx
    lower = picture[below, i] * (1 - fx) + picture[below, right] * fx
    return np.asarray(upper * (1 - fy) + lower * fy, np.float32)


def _sized(picture: F32, height: int, width: int) -> F32:
    u, v = (np.arange(width) + 0.5) / width, (np.arange(height) + 0.5) / height
    return _sampled(picture, *np.broadcast_arrays(u[None, :], v[:, None]), around=True)
