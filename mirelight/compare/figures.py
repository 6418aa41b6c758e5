"""Pictures and plots of the report, as data URIs and inline SVG."""

from __future__ import annotations

import base64
import io
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirelight.compare import metrics
from mirelight.compare.types import Maps
from mirelight.model import F32

# Control points of the colour scales, display values; equally spaced, and dark at "no difference".
FLIP_SCALE = ("#050308", "#2c1160", "#7a1f7c", "#c3386b", "#f3704a", "#fdbf6f", "#fdf6c9")
SIGNED_SCALE = ("#9fd3ff", "#2f86d6", "#11406f", "#141414", "#7a3a0c", "#e08125", "#ffdf9c")

_SIGNED_LIMITS = (0.02, 0.05, 0.1, 0.2, 0.5, 1.0)
_BINS = 64


def picture(display: F32) -> str:
    """Display values (H, W, 3) as a lossless picture in a data URI."""
    return _data_uri(np.rint(display * np.float32(255)).astype(np.uint8), lossless=True)


def flip_map(maps: Maps) -> str:
    """The FLIP map, 0 to 1, in colours of `FLIP_SCALE`; what is not counted is dimmed."""
    return _data_uri(heat_map(maps), lossless=False)


def heat_map(maps: Maps) -> NDArray[np.uint8]:
    """The FLIP map as (H, W, 3) pixels in colours of `FLIP_SCALE`; what is not counted is dimmed."""
    return _dimmed(_colours(maps.flip, FLIP_SCALE), maps)


def signed_limit(maps: Maps) -> float:
    """The end of the signed map's scale: a round number near the 99.5th percentile of the error."""
    typical = float(np.percentile(np.abs(maps.signed[maps.counted]), 99.5))
    return next((limit for limit in _SIGNED_LIMITS if limit >= typical), 1.0)


def signed_map(maps: Maps, limit: float) -> str:
    """Test minus reference in luma, -limit to limit, in colours of `SIGNED_SCALE`."""
    return _data_uri(_dimmed(_colours(0.5 + maps.signed / (2 * limit), SIGNED_SCALE), maps), lossless=False)


def luma_histogram(maps: Maps) -> str:
    """How often each brightness occurs: the reference as an area, the test as a line (square-root scale)."""
    edges = np.linspace(0, 1, _BINS + 1)
    sides = [np.histogram(metrics.luma(x)[maps.counted], edges)[0] for x in (maps.reference, maps.test)]
    tallest = max(1, *(int(side[1:-1].max()) for side in sides))  # black and white backgrounds may rise above
    heights = [np.sqrt(np.minimum(side / tallest, 1)) for side in sides]
    shapes = [_path(heights[0], "reference", closed=True), _path(heights[1], "test", closed=False)]
    return _plot(shapes, ("0", "0.5", "1"), "Display luma of reference (area) and test (line)")


def error_histogram(maps: Maps, limit: float) -> str:
    """How often each signed error occurs (logarithmic scale)."""
    counts = np.histogram(np.clip(maps.signed[maps.counted], -limit, limit), np.linspace(-limit, limit, _BINS))[0]
    heights = np.log1p(counts) / max(math.log1p(int(counts.max())), 1e-9)
    return _plot(
        [_path(heights, "test", closed=True)],
        (f"−{limit:g}", "0", f"+{limit:g}"),
        "Signed luma error of the test, logarithmic counts",
    )


# --- raster ----------------------------------------------------------------------------------------------------------


def _colours(values: F32, scale: tuple[str, ...]) -> NDArray[np.uint8]:
    points = np.array([[int(c[k : k + 2], 16) for k in (1, 3, 5)] for c in scale], dtype=np.float32)
    table = np.stack([np.interp(np.linspace(0, 1, 256), np.linspace(0, 1, len(points)), p) for p in points.T], axis=-1)
    index = np.clip(np.nan_to_num(values), 0, 1) * np.float32(255)
    return np.asarray(np.rint(table).astype(np.uint8)[np.rint(index).astype(np.uint8)])


def _dimmed(pixels: NDArray[np.uint8], maps: Maps) -> NDArray[np.uint8]:
    return np.where(maps.counted[..., None], pixels, pixels // 4 + 32).astype(np.uint8)


def _data_uri(pixels: NDArray[np.uint8], *, lossless: bool) -> str:
    from PIL import Image

    buffer = io.BytesIO()
    image = Image.fromarray(np.ascontiguousarray(pixels), "RGB")
    if max(image.size) > 16383:  # WebP's limit
        image.save(buffer, "PNG")
        return _encoded(buffer, "png")
    image.save(buffer, "WEBP", lossless=lossless, quality=60 if lossless else 85, method=2)
    return _encoded(buffer, "webp")


def _encoded(buffer: io.BytesIO, kind: str) -> str:
    return f"data:image/{kind};base64,{base64.b64encode(buffer.getvalue()).decode('ascii')}"


# --- plots -----------------------------------------------------------------------------------------------------------

_PLOT_W, _PLOT_H, _PLOT_BOTTOM = 320, 120, 18


def _path(heights: NDArray[Any], kind: str, *, closed: bool) -> str:
    step = _PLOT_W / len(heights)
    corners = [f"{k * step:.1f},{_PLOT_H * (1 - h * 0.96):.1f}" for k0, h in enumerate(heights) for k in (k0, k0 + 1)]
    if closed:
        corners = [f"0,{_PLOT_H}", *corners, f"{_PLOT_W},{_PLOT_H}"]
    return f'<path class="{kind}{" area" if closed else ""}" d="M{"L".join(corners)}{"Z" if closed else ""}"/>'


def _plot(shapes: list[str], ticks: tuple[str, ...], label: str) -> str:
    marks = []
    for k, tick in enumerate(ticks):
        x = _PLOT_W * k / (len(ticks) - 1)
        anchor = "start" if k == 0 else "end" if k == len(ticks) - 1 else "middle"
        marks.append(f'<text x="{x:.0f}" y="{_PLOT_H + 14}" text-anchor="{anchor}">{tick}</text>')
    axis = f'<path class="axis" d="M0,{_PLOT_H}H{_PLOT_W}"/>'
    size = f"0 0 {_PLOT_W} {_PLOT_H + _PLOT_BOTTOM}"
    return (
        f'<svg class="plot" viewBox="{size}" role="img" aria-label="{label}">{"".join([*shapes, axis, *marks])}</svg>'
    )
