"""Light under a painted mask, from the surface around it.

Where a person sees that a factor is wrong, its captured light is wrong, or the surface that both lights were traced on.
Pixels around the paint that show the same surface tell both. A shadow of the capture ends in the paint where they lie
in light and in shade: then the picture says which of both a pixel had, for its albedo is one that is seen around, and
the new light is right as it was traced. Where they all had the same light, it is the surface that is wrong, and the new
light is theirs as well.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mirelight.base import colour
from mirelight.model import F32, LightingBuffer, LightLayer
from mirelight.relighting.pixels import divide, unit_or_zero
from mirelight.relighting.resample import bilinear

_WAYS = 24  # in which a pixel looks for the border of the paint
_BEYOND = 2  # pixels past it: paint seldom reaches to the last pixel of what is wrong
_SAME_WAY = 8  # power of the cosine between normals
_ASIDE = 0.1  # of the way to a pixel, that it may lie off the plane of this one
_STRANGER = np.float32(1e-4)  # what a pixel of another surface counts
_SHARES = np.linspace(0, 1, 9, dtype=np.float32)  # between the light and the shade around, that are tried
_OUTER = 0.15  # of the pixels around, that lie in the deepest shade, and in the brightest light
_ALIKE = 0.25  # how far the logarithms of albedos of one surface lie apart
_EDGE = 0.2, 0.5  # logarithm of light over shade around, from which a captured shadow is taken to end in the paint
_LEAST = np.float32(1e-4)
_BLUR = 1.5  # pixels, over which a mean of those around is smoothed

Bool = NDArray[np.bool_]
Int = NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class Inpainted:
    """What is found of a view: the captured light under the paint, and how new light is to be filled in there."""

    captured: LightingBuffer | None
    new: Callable[[LightingBuffer], LightingBuffer]


def inpainted(
    surface: LightingBuffer, painted: Bool, captured: LightingBuffer | None = None, picture: F32 | None = None
) -> Inpainted:
    """Light under paint from the surface around it.

    Args:
        surface: h x w pixels of the lit proxy; its light is not read.
        painted: (h, w) where a factor is wrong.
        captured: the captured light on those pixels; None: the mode compares with none, and the surface is what is
            wrong.
        picture: (H, W, 4) the splats as captured, linear and premultiplied; there where `captured` is.

    Returns:
        Captured light, and what fills in new light. Other pixels keep theirs bit for bit, and so does paint that has
        no lit surface around.

    Raises:
        ValueError: a mask, or captured light, of another size.
    """
    size = surface.coverage.shape
    if painted.shape != size or (captured is not None and captured.coverage.shape != size):
        raise ValueError(f"light of {size} pixels, its mask or captured light of others")
    around = _Around.of(surface, painted)
    if around is None:
        return Inpainted(captured, lambda buffer: buffer)
    share = np.ones((len(around.who), 1), np.float32)
    if captured is not None and picture is not None:
        light = divide(captured.beauty, _weight(captured)).reshape(-1, 3)
        found, share = _captured(around, light, bilinear(picture, size))
        layer = around.put(captured.beauty, found * _weight(captured).reshape(-1, 3)[around.who])
        dark = np.zeros_like(layer)
        captured = replace(captured, layers=(LightLayer(name="captured", direct=layer, indirect=dark),))

    def new(buffer: LightingBuffer) -> LightingBuffer:
        weight = _weight(buffer)

        def of(image: F32) -> F32:
            own = image.reshape(-1, 3)[around.who]
            theirs = around.mean(divide(image, weight).reshape(-1, 3))
            return around.put(image, own + share * (theirs * weight.reshape(-1, 3)[around.who] - own))

        layers = tuple(replace(x, direct=of(x.direct), indirect=of(x.indirect)) for x in buffer.layers)
        return replace(buffer, layers=layers)

    return Inpainted(captured, new)


@dataclass(frozen=True, slots=True, eq=False)
class _Around:
    """Painted pixels, and those around the paint that each is told by."""

    size: tuple[int, int]
    who: Int  # (N,) painted pixels that show the proxy, row by row
    theirs: Int  # (N, K) pixels outside
    counts: F32  # (N, K) how much each counts, the nearer the more, 1 in all
    alike: F32  # (N, K) the same, however near

    @staticmethod
    def of(surface: LightingBuffer, painted: Bool) -> _Around | None:
        """None where no paint lies on the proxy, or no free surface around it."""
        size = painted.shape[0], painted.shape[1]
        lies = surface.coverage > 0.5
        free = lies & ~painted
        who = np.flatnonzero(painted & (surface.coverage > 0))
        if not len(who) or not free.any():
            return None
        theirs, there = _borders(who, painted, free)
        normal, position = (x.reshape(-1, 3) for x in (unit_or_zero(surface.geometric_normal), surface.position))
        own, to = normal[who], position[theirs] - position[who, None]
        far = np.maximum(np.linalg.norm(to, axis=2), np.float32(1e-12))
        aside = np.abs((to * own[:, None]).sum(axis=2)) / (far * np.float32(_ASIDE))
        alike = np.maximum((normal[theirs] * own[:, None]).sum(axis=2), 0) ** _SAME_WAY * np.exp(-(aside**2))
        rows, columns = np.divmod(theirs, size[1])
        row, column = np.divmod(who, size[1])
        apart = np.hypot(rows - row[:, None], columns - column[:, None]).astype(np.float32)
        alike = np.asarray(there * (alike + _STRANGER), np.float32)
        sure = there.any(axis=1)
        if not sure.any():
            return None
        near = alike / np.maximum(apart, 1)
        counts, alike = (x[sure] / x[sure].sum(axis=1, keepdims=True) for x in (near, alike))
        return _Around(size, who[sure], theirs[sure], counts, alike)

    def mean(self, values: F32) -> F32:
        """(N, 3) of values (h w, 3) around, without streaks."""
        return self._smoothed(np.einsum("nk,nkc->nc", self.counts, values[self.theirs]))

    def put(self, image: F32, values: F32) -> F32:
        """An image (h, w, 3) with values (N, 3) under the paint."""
        out = image.copy()
        out.reshape(-1, 3)[self.who] = values
        return out

    def _smoothed(self, values: F32) -> F32:
        """Values (N, 3), each with those beside it under the paint."""
        from scipy import ndimage

        image = np.zeros((self.size[0] * self.size[1], 4), np.float32)
        image[self.who, :3], image[self.who, 3] = values, 1
        image = ndimage.gaussian_filter(image.reshape(*self.size, 4), (_BLUR, _BLUR, 0)).reshape(-1, 4)
        return np.asarray(image[self.who, :3] / image[self.who, 3:], np.float32)


def _borders(who: Int, painted: Bool, free: Bool) -> tuple[Int, F32]:
    """(N, K) the pixels a little past the border of the paint in all directions, and 1 where that shows the proxy."""
    from scipy import ndimage

    height, width = painted.shape
    leap = np.asarray(ndimage.distance_transform_edt(np.pad(painted, 1))[1:-1, 1:-1], np.float32)
    angles = np.arange(_WAYS) * (2 * np.pi / _WAYS)
    down, right = np.sin(angles).astype(np.float32), np.cos(angles).astype(np.float32)
    row, column = (np.repeat(x[:, None].astype(np.float32), _WAYS, 1) for x in np.divmod(who, width))
    going = np.ones(row.shape, np.bool_)

    def pixel(ahead: float = 0.0) -> tuple[Int, Bool]:
        y, x = np.rint(row + ahead * down).astype(np.intp), np.rint(column + ahead * right).astype(np.intp)
        inside = (y >= 0) & (y < height) & (x >= 0) & (x < width)
        return np.clip(y, 0, height - 1) * width + np.clip(x, 0, width - 1), inside

    for _ in range(height + width):
        at, inside = pixel()
        going &= inside & painted.reshape(-1)[at]
        if not going.any():
            break
        step = np.where(going, np.maximum(leap.reshape(-1)[at] - 1, 1), 0).astype(np.float32)
        row, column = row + step * down, column + step * right
    at, inside = pixel()
    there = inside & free.reshape(-1)[at]
    for ahead in range(1, _BEYOND + 1):
        farther, inside = pixel(ahead)
        better = there & inside & free.reshape(-1)[farther]
        at = np.where(better, farther, at)
    return at, there.astype(np.float32)


def _captured(around: _Around, light: F32, picture: F32) -> tuple[F32, F32]:
    """(N, 3) captured light under the paint, by albedos that are seen around, and (N, 1) how far the surface itself is
    in doubt, and not a captured shadow's edge.

    Args:
        around: the paint.
        light: (h w, 3) captured light as traced.
        picture: (h, w, 4) linear, premultiplied.
    """
    color = divide(picture[..., :3], picture[..., 3:]).reshape(-1, 3)
    theirs = np.maximum(light[around.theirs], _LEAST * float(light.max()) + np.float32(1e-20))
    shade, bright = _outermost(theirs, around.alike)
    edge = np.log(colour.luminance(bright) / colour.luminance(shade))
    doubt = np.clip((np.float32(_EDGE[1]) - edge) / np.float32(_EDGE[1] - _EDGE[0]), 0, 1)[:, None]
    own = np.log(np.maximum(color[around.who], _LEAST))
    seen = np.log(np.maximum(color[around.theirs], _LEAST)) - np.log(theirs)
    total, summed = np.zeros((len(own), 1), np.float32), np.zeros_like(own)
    for share in _SHARES:
        tried = shade + share * (bright - shade)
        off = ((own - np.log(tried))[:, None] - seen) ** 2
        votes = (around.counts * np.exp(off.sum(axis=2) * np.float32(-1 / (6 * _ALIKE**2)))).sum(axis=1)
        belief = (votes[:, None] + _STRANGER) ** 2
        total += belief
        summed += belief * tried
    mean = around.mean(light)
    found = summed / total
    return np.asarray(found + doubt * (mean - found), np.float32), np.asarray(doubt, np.float32)


def _outermost(theirs: F32, counts: F32) -> tuple[F32, F32]:
    """(N, 3) light (N, K, 3) in the deepest shade, and the brightest: means over the outer shares of what counts."""
    order = np.argsort(colour.luminance(theirs), axis=1)
    light, count = np.take_along_axis(theirs, order[..., None], 1), np.take_along_axis(counts, order, 1)
    below = np.cumsum(count, axis=1)

    def mean(part: F32) -> F32:
        part = np.maximum(part, 0)
        return np.asarray((part[..., None] * light).sum(axis=1) / part.sum(axis=1)[:, None], np.float32)

    outer = np.float32(_OUTER)
    low = np.minimum(count, outer - (below - count))
    high = np.minimum(count, below - (1 - outer))
    return mean(low), mean(high)


def _weight(buffer: LightingBuffer) -> F32:
    """(h, w, 3) what light is multiplied by in a picture."""
    return np.asarray(buffer.albedo * buffer.coverage[..., None], np.float32)
