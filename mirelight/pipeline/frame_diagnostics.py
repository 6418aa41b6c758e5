"""What is wrong with a finished frame, found from its own buffers; nothing where all is well.

Thresholds are from data: right proxies leave up to 13 % of the splats' pixels off, those turned, moved or
scaled wrongly 24 % and more; frames of the shipped scenes have at most 6 % of white pixels and their splats lie within
0.4 % of the proxy. Splats lie on 52 % and 62 % of those scenes' proxies.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from mirelight.base import colour
from mirelight.io.views import curve_of
from mirelight.model import F32, DisplaySettings, Frame, rules_of
from mirelight.model.profiles import BRIGHTEST
from mirelight.pipeline.beyond import above_horizon

Kind = Literal["nothing", "uncovered", "gap", "white", "black", "light", "colours", "albedo", "objects"]

OPAQUE = 0.5  # alpha above which a pixel shows splats
_SKY = 2.0  # times as far as nearly all of the proxy in a picture is
MOST_UNCOVERED = 0.18  # share of the splats' pixels
MOST_GAP = 0.02  # median distance along the view axis, share of what the picture shows of the proxy
MOST_WHITE = 0.15  # share of the splats' pixels, and so much more than the capture has
MOST_BLACK = 0.6
MOST_HIDDEN = 0.99  # share of the picture by inserted objects
LEAST_MET = 0.1  # share of the proxy's area
MOST_HELD = 0.15  # share of the pixels on the proxy that are held at the brightest albedo
_WHITE, _BLACK = 254.5 / 255, 8 / 255  # display values
_ALL_BLACK = 0.98  # share of the pixels: captures of nights have lamps, or a sky
_LEAST_SEEN = 0.002  # share of the picture
_HARDLY = 1000  # how much darker than the capture light counts as none
_MOST_PIXELS = 20_000  # that are looked at: shares are right to a third of a percent, and advice costs next to nothing
_SAME = 1e-4  # relative: so near to the brightest albedo comes what is held there, and hardly anything else
_UNLIT = 1e-6  # share of the picture's light below which a light adds nothing

_OWN = "it was made from the splats, so they have no clear surface there: `mirelight inspect --heat DIR` shows where"

Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Finding:
    """Something wrong, and what to do."""

    kind: Kind
    text: str
    remedy: str

    def __str__(self) -> str:
        return f"{self.text}; {self.remedy}"


def of_frame(
    frame: Frame, display: DisplaySettings, *, off: Collection[str] = (), own: bool = False
) -> tuple[Finding, ...]:
    """What is wrong with a frame as its PNG shows it.

    Args:
        frame: from `mirelight.relight`.
        display: how its PNG is made.
        off: names of layers that are meant to add nothing.
        own: whether its proxy was made from the splats.
    """
    step = _step(frame.rgba.shape)
    alpha = frame.rgba[::step, ::step, 3]
    on: Mask = alpha > OPAQUE
    found: list[Finding] = []
    if on.mean() < _LEAST_SEEN:
        what = "splats" if frame.splats is not None else "proxy"
        text = f"the camera sees nothing: {on.mean():.1%} of the picture shows the {what}"
        return (Finding("nothing", text, "turn or move the camera, or leave cameras out: one is placed that sees all"),)
    objects = None if frame.lighting is None else frame.lighting.objects
    if objects is not None and (hidden := float((objects.coverage > OPAQUE).mean())) > MOST_HIDDEN:
        text = f"inserted objects hide {hidden:.0%} of the picture: the camera stands in one, or right before it"
        return (Finding("objects", text, "move the object or the camera, or give the object another scale"),)
    if frame.splats is not None and frame.lighting is not None:
        found += _fit(frame, own)
    if frame.lighting is not None:
        found += _brightness(frame, display, step, on)
        found += _idle(frame, off)
        found += _held(frame)
    return tuple(found)


def of_colors(met: float, lit: bool, *, own: bool = False) -> Finding | None:
    """What is wrong with colours that a proxy takes from the splats.

    Args:
        met: share of the proxy's area on which splats lie.
        lit: whether the captured light falls on any of them.
        own: whether the proxy was made from the splats: it lies where they are, and what it has beyond them (ground
            to the horizon, what closes it against light) is meant.
    """
    if not lit:
        text = 'no captured light falls on the splats, so their colours (albedo = "splats") cannot be told'
        return Finding("colours", text, "look at the captured lighting, or give the proxy an albedo")
    if met < LEAST_MET and not own:
        text = (
            f'splats lie on {met:.1%} of the proxy\'s surface, and colours of the rest (albedo = "splats") are guessed'
        )
        return Finding("colours", text, "check both transforms, or give the proxy an albedo")
    return None


def _step(shape: tuple[int, ...]) -> int:
    """Every so many rows and columns of a picture are looked at."""
    return math.ceil(math.sqrt(shape[0] * shape[1] / _MOST_PIXELS))


def _fit(frame: Frame, own: bool) -> list[Finding]:
    """Whether the proxy is where the splats are; `own`: it was made from them."""
    from mirelight.proxy.skies import large

    splats, lit = frame.splats, frame.lighting
    assert splats is not None and lit is not None
    height, width = lit.coverage.shape
    step = _step(lit.coverage.shape)
    rows = np.arange(0, height, step) * splats.camera.height // height
    columns = np.arange(0, width, step) * splats.camera.width // width
    on: Mask = (1 - splats.transmittance)[np.ix_(rows, columns)] > OPAQUE
    if lit.objects is not None:  # the proxy is not seen where they are before it
        on &= ~(lit.objects.coverage[::step, ::step] > 0)
    covered: Mask = lit.coverage[::step, ::step] > OPAQUE
    depth, lit_depth = splats.median_depth[np.ix_(rows, columns)], lit.depth[::step, ::step]
    if covered.any():  # a sky of splats has no proxy
        on &= covered | (depth < _SKY * np.quantile(lit_depth[covered], 0.95))
    if own:  # whose maker found no surface there, nor walls
        on &= ~large(on & ~covered & above_horizon(splats.camera)[np.ix_(rows, columns)])
    if not on.any():
        return []
    off = 1 - float((on & covered).sum() / on.sum())
    look = _OWN if own else '`mirelight inspect` says what would make it fit; proxy = "splats" has one made that does'
    if off > MOST_UNCOVERED:
        text = f"the proxy does not cover {off:.0%} of the splats' pixels (right ones leave up to 13 %)"
        return [Finding("uncovered", text, look)]
    both = on & covered & (depth > 0) & (lit_depth > 0)
    size = _extent(lit.position[::step, ::step][covered])
    if not both.any() or not size > 0:
        return []
    if not _apart(depth, lit_depth, lit.depth, step, both) > MOST_GAP * size:
        return []
    gap = float(np.median(np.abs(depth - lit_depth)[both]))
    nearer = float((lit_depth < depth)[both].mean())
    side = "before" if nearer > OPAQUE else "behind"
    text = f"the proxy lies {gap:.3g} units {side} the splats ({gap / size:.1%} of what is seen)"
    if nearer > 0.9:
        look += "; or the camera stands inside the mesh"
    return [Finding("gap", text, look)]


def _apart(splats: F32, proxy: F32, whole: F32, step: int, both: Mask) -> float:
    """Median distance in depth beyond what one pixel spans: in a small picture a floor is deep within a pixel, and
    splats, never narrower than that, end at its near side.

    Args:
        splats: (h, w) depth of every `step`-th pixel.
        proxy: (h, w) likewise.
        whole: (H, W) the proxy's depth in every pixel; 0 where it is not.
        step: rows and columns from one to the next.
        both: (h, w) where to look.
    """
    spans = np.zeros(whole.shape, np.float32)
    for axis in (0, 1):
        here, there = (np.delete(whole, end, axis) for end in (-1, 0))
        apart = np.where((here > 0) & (there > 0), np.abs(here - there), 0)
        for end in ((0, 1), (1, 0)):
            pad = [(0, 0), (0, 0)]
            pad[axis] = end
            spans = np.maximum(spans, np.pad(apart, pad))
    return float(np.median((np.abs(splats - proxy) - spans[::step, ::step])[both]))


def _held(frame: Frame) -> list[Finding]:
    """Whether mode albedo holds much of the picture at the brightest surface that there is."""
    lit = frame.lighting
    assert lit is not None
    if frame.splats is None or lit.coverage.shape != frame.rgba.shape[:2]:
        return []
    step = _step(lit.coverage.shape)
    on: Mask = (frame.rgba[::step, ::step, 3] > OPAQUE) & (lit.coverage[::step, ::step] > OPAQUE)
    # radiance under light that would leave a white surface as brightly: both premultiplied
    alpha, weight = frame.rgba[::step, ::step, 3:][on], (lit.albedo * lit.coverage[..., None])[::step, ::step][on]
    most = np.float32(BRIGHTEST) * alpha * lit.beauty[::step, ::step][on]
    own = frame.rgba[::step, ::step, :3][on] * weight
    held = ((most > 0) & (np.abs(own - most) <= _SAME * most)).any(axis=1)
    if not held.size or held.mean() <= MOST_HELD:
        return []
    text = f"{held.mean():.0%} of the splats' pixels were brighter than any surface is under the captured light"
    remedy = f"they are held at an albedo of {BRIGHTEST}: raise the captured light's intensities"
    return [Finding("albedo", text, remedy)]


def _extent(points: F32) -> float:
    """Diagonal of the box that holds points, without strays."""
    if len(points) < 2:
        return 0.0
    low, high = np.quantile(points[:: max(1, len(points) // 20_000)], [0.01, 0.99], axis=0)
    return float(np.linalg.norm(high - low))


def _brightness(frame: Frame, display: DisplaySettings, step: int, on: Mask) -> list[Finding]:
    """Whether the picture is white or black where the capture is not."""
    new = _shown(frame.rgba, frame, display, step)[on]
    white, black = _shares(new)
    if white <= MOST_WHITE and black <= MOST_BLACK:
        return []
    old = None if frame.unlit is None else _shown(frame.unlit, frame, replace(display, exposure=0.0), step)[on]
    white_before, black_before = (0.0, 0.0) if old is None else _shares(old)
    gain = 2.0**display.exposure
    if min(black, black_before) > _ALL_BLACK:
        text = f"the capture itself is black, in {black_before:.0%} of the splats' pixels"
        return [Finding("black", text, "light multiplies what splats show: check the colours in their file")]
    light = frame.rgba[::step, ::step, :3][on] * np.float32(gain)
    if white > max(MOST_WHITE, white_before + MOST_WHITE * 2 / 3):
        by = 1 / float(np.quantile(light.max(axis=1), 0.95))
        text = f"{white:.0%} of the splats' pixels are white"
        return [Finding("white", text, _scaled(by, display))]
    if black > max(MOST_BLACK, black_before + MOST_BLACK / 2):
        mean = float(colour.luminance(light).mean())
        base = 0.18 if frame.unlit is None else float(colour.luminance(frame.unlit[::step, ::step, :3][on]).mean())
        text = f"{black:.0%} of the splats' pixels are black"
        if base >= _HARDLY * mean or (frame.lighting is not None and not frame.lighting.beauty.any()):
            remedy = "no light reaches them: look at the lights' places, directions and ranges"
            return [Finding("black", text, remedy)]
        return [Finding("black", text, _scaled(base / mean, display))]
    return []


def _scaled(by: float, display: DisplaySettings) -> str:
    exposure = display.exposure + math.log2(by)
    return f"multiply the lights' intensities by about {by:.2g}, or set display.exposure = {exposure:.1f}"


def _shown(rgba: F32, frame: Frame, display: DisplaySettings, step: int) -> F32:
    few = rgba[::step, ::step]
    whole = frame.splats is not None and frame.splats.linear
    gain = 2.0**display.exposure
    transfer = rules_of(frame.profile).transfer
    black, view = np.zeros(3, np.float32) if whole else None, curve_of(display)
    return colour.shown(few[..., :3], few[..., 3], transfer, gain=gain, tone=display.tone, behind=black, view=view)


def _shares(display: F32) -> tuple[float, float]:
    """Of pixels (N, 3): with a channel at its end, and without any light to speak of."""
    top = display.max(axis=1)
    return float((top >= _WHITE).mean()), float((top < _BLACK).mean())


def _idle(frame: Frame, off: Collection[str]) -> list[Finding]:
    """Lights that add nothing to the picture."""
    lit = frame.lighting
    assert lit is not None
    if len(lit.layers) < 2:
        return []  # a black picture says it
    sums = [float(layer.direct.sum(dtype=np.float64) + layer.indirect.sum(dtype=np.float64)) for layer in lit.layers]
    names = [
        layer.name
        for layer, own in zip(lit.layers, sums, strict=True)
        if own <= _UNLIT * sum(sums) and layer.name not in off
    ]
    if not names or sum(sums) <= 0:
        return []
    what = f"{', '.join(map(repr, names[:4]))}{', …' if len(names) > 4 else ''}"
    text = f"of {what} no light arrives"
    return [Finding("light", text, "is it inside the mesh, turned away, out of range or of intensity 0?")]
