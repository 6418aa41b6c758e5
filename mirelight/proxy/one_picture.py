"""Splats that a network made of one picture, told by how they lie: on its pixels' rays, from the origin of their file.

Networks such as SHARP set a splat or two on each pixel's ray, as far off as they believe; those that make worlds do so
for a panorama. The eye is the origin; editors and converters keep the places, and lose what the file said of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mirelight.base import conventions
from mirelight.model import F64, Camera, SplatCloud
from mirelight.model.scene import SOLID
from mirelight.proxy.guess_tuning import GUESS
from mirelight.proxy.views import from_points

_LAYERS = 2  # splats of a pixel: on what is seen, and behind it


def takers(splats: SplatCloud) -> tuple[Camera, ...]:
    """The camera of the picture that splats were made of, six of a panorama, in their space; none where splats were
    made of more pictures, as nearly all are.

    Args:
        splats: in the axes of their file, looked at along Z; or turned, as a world with Y up.
    """
    means = splats.means.astype(np.float64)
    if len(means) < GUESS.taker_fewest:
        return ()
    ahead = 1.0 if np.median(means[:, 2]) > 0 else -1.0
    before = ahead * means[:, 2] > 0
    if before.mean() > GUESS.taker_before:
        one = _picture(means[before], ahead)
        return () if one is None else (one,)
    if not _all_round(means):
        return ()
    size = np.sqrt(len(means) / _LAYERS / 6)
    return tuple(from_points(np.zeros((1, 3)), int(min(size, GUESS.taker_most)), _near(means)))


def without_far(splats: SplatCloud, cameras: Sequence[Camera]) -> SplatCloud:
    """The splats, those that lie far behind what one picture shows made transparent: its sky, which a network believes
    to be anywhere, and what is so far off that it keeps no light from the rest. With more cameras, or none, all."""
    if len(cameras) != 1:
        return splats
    (camera,) = cameras
    depth = (splats.means.astype(np.float64) - camera.position) @ -camera.world_from_camera[:3, 2]
    shown = (splats.opacities >= SOLID) & (depth > 0)
    near = float(np.quantile(depth[shown], GUESS.taker_near)) if shown.any() else np.inf
    return replace(splats, opacities=np.where(depth > GUESS.taker_far * near, np.float32(0), splats.opacities))


def _picture(means: F64, ahead: float) -> Camera | None:
    """The camera whose pixels are as even as splats (N, 3) before the origin, along Z by the sign; None: no pixels."""
    depth = ahead * means[:, 2]
    across, down = means[:, 0] / depth, ahead * means[:, 1] / depth
    cut = [GUESS.taker_stray, 1 - GUESS.taker_stray]
    (left, right), (top, bottom) = np.quantile(across, cut), np.quantile(down, cut)
    wide, high = right - left, bottom - top
    if not (left < 0 < right and top < 0 < bottom and wide < GUESS.taker_widest and high < GUESS.taker_widest):
        return None
    if not _uneven(across, down, (left, right), (top, bottom)) < GUESS.taker_even:
        return None
    # to a tangent of 1
    pixels = min(np.sqrt(len(means) / _LAYERS / (wide * high)), GUESS.taker_most / max(wide, high))
    turned = np.diag([1.0, -ahead, -ahead])  # a camera looks along -Z with +Y up
    return Camera(
        world_from_camera=conventions.compose(rotation=turned),
        width=max(round(wide * pixels), 1),
        height=max(round(high * pixels), 1),
        fx=pixels,
        fy=pixels,
        cx=-left * pixels,
        cy=-top * pixels,
        near=_near(means),
        name="picture",
    )


def _all_round(means: F64) -> bool:
    """Whether splats (N, 3) lie as the pixels of a panorama about the origin: of a cube's six sides, or of rows and
    columns about Y."""
    largest = np.argmax(np.abs(means), axis=1)
    for axis in range(3):
        for sign in (1.0, -1.0):
            side = means[(largest == axis) & (sign * means[:, axis] > 0)]
            one, two = (side[:, (axis + k) % 3] / np.abs(side[:, axis]) for k in (1, 2))
            if not _uneven(one, two, (-1, 1), (-1, 1), len(means) / 6) < GUESS.taker_round:
                return _rows(means)
    return True


def _rows(means: F64) -> bool:
    """As :func:`_all_round`, of rows and columns."""
    away = np.maximum(np.linalg.norm(means, axis=1), 1e-300)
    height, turn = np.arcsin(np.clip(means[:, 1] / away, -1, 1)), np.arctan2(means[:, 0], means[:, 2])
    return _uneven(turn, height, (-np.pi, np.pi), (-np.pi / 2, np.pi / 2)) < GUESS.taker_round


def _uneven(
    x: F64, y: F64, wide: tuple[float, float], high: tuple[float, float], expected: float | None = None
) -> float:
    """How far from even points lie in a rectangle: of how many a cell has, the deviation by the mean; `expected`: of
    how many they should be in all."""
    cells = GUESS.taker_cells
    held, _, _ = np.histogram2d(x, y, bins=cells, range=[wide, high])
    mean = held.mean() if expected is None else expected / cells**2
    return float(np.sqrt(np.mean((held - mean) ** 2)) / mean)


def _near(means: F64) -> float:
    return 1e-3 * float(np.quantile(np.linalg.norm(means, axis=1), GUESS.taker_near))
