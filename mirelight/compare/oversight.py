"""What a test picture looks to have suffered on its way into its file: an axis turned round, a curve applied twice."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from mirelight.base import colour
from mirelight.compare import metrics
from mirelight.compare.display import Display
from mirelight.compare.types import Picture
from mirelight.model import F32, rules_of

_PLAIN = 1e-3  # mean squared error of display values, 30 dB: an oversight leaves more
_LEFT = 0.25  # share of the error that may be left once a cause is taken out
_BESIDE_GAIN = 0.5  # the same, of what a factor on light leaves: stronger light looks much like another curve
_SIDE = 64  # pixels of the thumbnails whose edges are matched: noise is averaged out, what stands where is not
_MATCHED = 0.4  # correlation from which edges are those of one view; of unlike ones it is about 0
_SWAPPED = -0.5  # correlation of red minus blue, up to which they are taken for each other

_TURNED = (
    ("upside down: write its rows from top to bottom (readPixels gives them from the bottom)", (-1, 1)),
    ("mirrored from left to right", (1, -1)),
    ("turned by 180 degrees", (-1, -1)),
)


def oversight(reference: Picture, test: Picture, shown: F32, seen: F32, display: Display) -> str:
    """What the test looks like beside the reference; empty where nothing simple explains most of the difference.

    Axes are told by where edges are, so that other light does not hide them; curves, alpha and light by how much of the
    mean squared error they leave.

    Args:
        reference: one side.
        test: the other, of the same size.
        shown: (H, W, 3) display values of the reference, its light times a gain that was fitted.
        seen: (H, W, 3) those of the test.
        display: how both are shown.
    """
    error = _error(shown, seen)
    if error < _PLAIN:
        return ""
    found = _turned(shown, seen)
    if not found and _correlation(shown[..., 0] - shown[..., 2], seen[..., 0] - seen[..., 2]) <= _SWAPPED:
        found = "as if red and blue were swapped"
    if not found:
        fitted = display.fit_gain(reference, test)
        by_gain = _error(display.show(reference, fitted), seen)
        recoded = ((_error(shown, display.show(other)), what) for what, other in _recoded(test, display))
        left, what = min(recoded, default=(error, ""))
        if left <= min(_LEFT * error, _BESIDE_GAIN * by_gain):
            found = what
        elif by_gain <= _LEFT * error and seen.any():
            found = f"as the reference would with {fitted:.3g} times its light (--fit-gain takes such a factor out)"
    return f"the test looks {found}" if found else ""


def why_other_size(reference: tuple[int, int], test: tuple[int, int]) -> str:
    """How a test of another size (rows, columns) than its reference may have come about, to be put behind both sizes;
    empty where nothing simple tells."""
    (h, w), (rows, columns) = reference, test
    if test == (w, h):
        return ", turned by 90 degrees or with width and height swapped"
    larger = max(columns / w, w / columns)
    if abs(rows * w - columns * h) < max(w, columns):  # one aspect, to a row
        which = "as many" if columns > w else "as few"
        exactly = "exactly " if rows * w == columns * h else ""
        return f", {exactly}{larger:.4g} times {which} each way: another resolution or device pixel ratio"
    if rows == h or columns == w:
        return f", as {'high' if rows == h else 'wide'} as that: a crop, or a window of another shape"
    return ""


def _turned(shown: F32, seen: F32) -> str:
    """How the test's edges must be turned to lie where the reference's do; empty where they do, or never do."""
    small, other = _small(metrics.luma(shown)), _small(metrics.luma(seen))
    edges = _edges(small)
    best, what = max((_correlation(edges, _edges(other[::rows, ::columns])), w) for w, (rows, columns) in _TURNED)
    return what if best >= _MATCHED and _correlation(edges, _edges(other)) < best / 2 else ""


def _recoded(test: Picture, display: Display) -> Iterator[tuple[str, Picture]]:
    """The test as if its values were meant otherwise."""
    transfer = rules_of(display.profile).transfer
    if test.linear:
        light = colour.decode(np.clip(test.rgb, 0, 1), transfer)
        yield "encoded for a display, where an EXR holds linear light", replace(test, rgb=light)
        return
    own = colour.straight(test.rgb, test.alpha)
    over = test.alpha[..., None]
    yield (
        "like linear light: encode it for a display, or save it as EXR",
        replace(test, rgb=colour.encode(own, transfer) * over),
    )
    yield "encoded for a display twice", replace(test, rgb=colour.decode(own, transfer) * over)
    if (test.alpha < 1).any():
        yield "multiplied by its alpha already (--premultiplied says so)", replace(test, rgb=own)
        yield "not multiplied by its alpha (without --premultiplied it would be)", replace(test, rgb=test.rgb * over)


def _error(a: F32, b: F32) -> float:
    return float(np.mean((a - b) ** 2, dtype=np.float64))


def _small(luma: F32) -> F32:
    """Means over blocks of the middle of a picture (H, W), about `_SIDE` pixels long."""
    step = -(-max(luma.shape) // _SIDE)
    rows, columns = (max(n // step, 1) for n in luma.shape)
    top, left = ((n - m * step) // 2 for n, m in zip(luma.shape, (rows, columns), strict=True))
    if top < 0 or left < 0:  # a strip thinner than a block
        return luma
    middle = luma[top : top + rows * step, left : left + columns * step]
    return np.asarray(middle.reshape(rows, step, columns, step).mean(axis=(1, 3)), np.float32)


def _edges(picture: F32) -> F32:
    """Steps downwards, then to the right (N,)."""
    return np.concatenate([np.diff(picture, axis=0).ravel(), np.diff(picture, axis=1).ravel()])


def _correlation(a: F32, b: F32) -> float:
    """Pearson's, of all values; 0 where a side does not vary."""
    x, y = (v.astype(np.float64).ravel() - (v.mean(dtype=np.float64) if v.size else 0) for v in (a, b))
    scale = float(np.sqrt((x * x).sum() * (y * y).sum()))
    return float((x * y).sum()) / scale if scale > 0 else 0.0
