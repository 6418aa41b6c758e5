"""Splats that a network made of one picture, told by how they lie: its pixels, before the origin of their file.

Networks such as SHARP set a splat or two on each pixel's ray, as far off as they believe. Their camera stands at the
origin; editors and converters keep the places, and lose what the file said of it.
"""

from __future__ import annotations

import numpy as np

from mirelight.base import conventions
from mirelight.model import Camera, SplatCloud
from mirelight.proxy.tuning import TUNING


def taker(splats: SplatCloud) -> Camera | None:
    """The camera of the one picture that splats were made of, in their space; None: they were not, or nothing tells.

    Args:
        splats: in the axes of their file, looked at along Z, or turned as a world with Y up.
    """
    x, y, z = splats.means.astype(np.float64).T
    ahead = 1.0 if np.median(z) > 0 else -1.0
    before = ahead * z > 0
    if len(z) < TUNING.taker_fewest or before.mean() < TUNING.taker_before:
        return None
    across, down = (v[before] / (ahead * z[before]) for v in (x, ahead * y))
    cut = [TUNING.taker_stray, 1 - TUNING.taker_stray]
    (left, right), (top, bottom) = np.quantile(across, cut), np.quantile(down, cut)
    wide, high = right - left, bottom - top
    if not (left < 0 < right and top < 0 < bottom and wide < TUNING.taker_widest and high < TUNING.taker_widest):
        return None
    cells = TUNING.taker_cells
    held, _, _ = np.histogram2d(across, down, bins=cells, range=[[left, right], [top, bottom]])
    if held.std() > TUNING.taker_even * held.mean():
        return None
    # to a unit of the tangent: a pixel has two splats, on what is seen and behind it
    pixels = min(np.sqrt(len(z) / 2 / (wide * high)), TUNING.taker_most / max(wide, high))
    turned = np.diag([1.0, -ahead, -ahead])  # a camera looks along -Z with +Y up
    return Camera(
        world_from_camera=conventions.compose(rotation=turned),
        width=max(round(wide * pixels), 1),
        height=max(round(high * pixels), 1),
        fx=pixels,
        fy=pixels,
        cx=-left * pixels,
        cy=-top * pixels,
        near=1e-3 * float(np.median(np.abs(z))),
        name="picture",
    )
