"""Fits the splats' colours to true pictures of the capture, as a real capture is fitted to its photographs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirelight.base.sh import C0
from mirelight.compositor import reference
from mirelight.model import Camera, SplatCloud

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
ROUNDS = 24


@dataclass(frozen=True, kw_only=True)
class View:
    """A picture to fit."""

    camera: Camera
    shown: F64  # (H, W, 3) display-encoded, on black


def _kernels() -> tuple[Any, Any]:
    """Blend of per-splat colours into a picture, and its transpose (weights are those of the physical profile)."""
    import numba

    @numba.njit(cache=False)  # type: ignore[untyped-decorator]
    def window(x: float, y: float, xx: float, yy: float, reach: float, w: int, h: int) -> tuple[int, int, int, int]:
        rx, ry = np.sqrt(reach * xx), np.sqrt(reach * yy)
        x0, x1 = max(0, int(np.ceil(x - rx - 0.5))), min(w, int(np.floor(x + rx - 0.5)) + 1)
        y0, y1 = max(0, int(np.ceil(y - ry - 0.5))), min(h, int(np.floor(y + ry - 0.5)) + 1)
        return x0, x1, y0, y1

    @numba.njit(cache=False, fastmath=True)  # type: ignore[untyped-decorator]
    def sweep(center: F64, variance: F64, opacity: F64, colour: F64, picture: F64, gather: bool) -> F64:
        """Front to back; adds colours to the picture, or (gather) residuals in the picture to the splats."""
        h, w, _ = picture.shape
        clear = np.ones((h, w))
        weight = np.zeros(len(center))
        for i in range(len(center)):
            x, y = center[i, 0], center[i, 1]
            xx, xy, yy = variance[i, 0], variance[i, 1], variance[i, 2]
            det = xx * yy - xy * xy
            reach = 2 * np.log(max(opacity[i] * 255.0, 1.0))
            x0, x1, y0, y1 = window(x, y, xx, yy, reach, w, h)
            for row in range(y0, y1):
                dy = row + 0.5 - y
                for col in range(x0, x1):
                    t = clear[row, col]
                    if t < 1e-4:
                        continue
                    dx = col + 0.5 - x
                    d = (yy * dx * dx - 2 * xy * dx * dy + xx * dy * dy) / det
                    if d > reach:
                        continue
                    alpha = min(0.99, opacity[i] * np.exp(-0.5 * d))
                    share = t * alpha
                    clear[row, col] = t * (1 - alpha)
                    weight[i] += share
                    for k in range(3):
                        if gather:
                            colour[i, k] += share * picture[row, col, k]
                        else:
                            picture[row, col, k] += share * colour[i, k]
        return weight

    return sweep, window


def fit_colours(cloud: SplatCloud, views: Sequence[View]) -> SplatCloud:
    """Colours (degree 0) that reproduce the views best in display space, by accelerated SIRT within 0..1."""
    sweep, _ = _kernels()
    prints = [reference.project(cloud, view.camera, reference.DEFAULT) for view in views]
    colour = np.clip(0.5 + C0 * cloud.sh[:, 0].astype(np.float64), 0, 1)
    before, pace = colour.copy(), 1.0
    for _ in range(ROUNDS):
        next_pace = (1 + np.sqrt(1 + 4 * pace * pace)) / 2
        guess = colour + (pace - 1) / next_pace * (colour - before)
        before, pace = colour, next_pace
        total, step = np.zeros(len(guess)), np.zeros_like(guess)
        for view, f in zip(views, prints, strict=True):
            picture = np.zeros_like(view.shown)
            sweep(f.center, f.variance, f.opacity, guess[f.index], picture, False)
            gathered = np.zeros((len(f.index), 3))
            weight = sweep(f.center, f.variance, f.opacity, gathered, view.shown - picture, True)
            step[f.index] += gathered
            total[f.index] += weight
        colour = np.clip(guess + step / np.maximum(total, 0.3)[:, None], 0, 1)
    return replace(cloud, sh=((colour - 0.5) / C0)[:, None, :].astype(np.float32))
