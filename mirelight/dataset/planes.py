"""What is ready of a view of a data set: light on its pixels, as planes that weights mix."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mirelight.model import F32, LightingBuffer, RelightSettings


@dataclass(frozen=True, slots=True, eq=False)
class Planes:
    """Light on n pixels."""

    units: F32  # (3, L, n) radiance of the unit lights
    constant: F32 | None  # (3, n) of surfaces that glow
    whole: NDArray[np.bool_]  # (L,) units that hold the glow already

    def mixed(self, weights: F32) -> F32:
        """(n, 3) radiance under lights of these weights (L, 3)."""
        out = np.empty((self.units.shape[2], 3), dtype=np.float32)
        used = np.flatnonzero(weights.any(axis=1))
        glow = self.constant is not None and not self.whole[used].any()
        few = 2 * len(used) < len(weights)
        for channel in range(3):
            planes, wanted = self.units[channel], weights[:, channel]
            if few:
                mixed = np.zeros(planes.shape[1], dtype=np.float32)
                for i in used:
                    mixed += wanted[i] * planes[i]
            else:
                mixed = wanted @ planes
            if glow:
                mixed += self.constant[channel]  # type: ignore[index]
            out[:, channel] = mixed
        return out


@dataclass(frozen=True, slots=True, eq=False)
class SeenObjects:
    """What a view sees of inserted objects."""

    where: NDArray[np.intp]  # (n,) pixels that show some
    coverage: F32  # (h, w)
    planes: Planes

    def rgba(self, weights: F32) -> F32:
        """(h, w, 4) under lights of these weights (L, 3), premultiplied."""
        out = np.zeros((*self.coverage.shape, 4), np.float32)
        out[..., 3] = self.coverage
        out.reshape(-1, 4)[self.where, :3] = self.planes.mixed(weights)
        return out


class MixedView(NamedTuple):
    """What a view sees under one lighting."""

    beauty: F32  # (h, w, 3) of the proxy, premultiplied by coverage
    objects: F32 | None  # (h, w, 4) inserted ones, premultiplied
    mirrored: F32 | None  # (h, w, 3) by the proxy's materials


@dataclass(frozen=True, slots=True, eq=False)
class ReadyView:
    """What is ready of a camera, with objects in one arrangement."""

    lights: NDArray[np.intp]  # (l,) indices of the unit lights that its planes hold
    planes: Planes
    objects: SeenObjects | None
    mirrored: Planes | None  # what the proxy's materials mirror of the lights
    bare: Planes | None  # light without objects
    size: tuple[int, int]  # h, w
    relit: Callable[[MixedView, F32, RelightSettings | None], F32]  # the second: (L, 3) weights of all unit lights
    shadowed: Callable[[F32, F32], F32]

    def frame(self, weights: F32, relight: RelightSettings | None = None) -> F32:
        """(H, W, 4) under the data set's lights of these weights (L, 3); `relight`: None: as the job says."""
        own = weights[self.lights]
        beauty, mirrored = (
            None if x is None else x.mixed(own).reshape(*self.size, 3) for x in (self.planes, self.mirrored)
        )
        assert beauty is not None
        objects = None if self.objects is None else self.objects.rgba(own)
        return self.relit(MixedView(beauty, objects, mirrored), weights, relight)

    def shadow(self, weights: F32) -> F32 | None:
        """(H, W, 3) light beside objects over the same without them; None: it was not asked for."""
        if self.bare is None:
            return None
        weights = weights[self.lights]
        new, bare = (x.mixed(weights).reshape(*self.size, 3) for x in (self.planes, self.bare))
        return self.shadowed(new, bare)

    @property
    def nbytes(self) -> int:
        """Bytes of its planes."""
        more = (None if self.objects is None else self.objects.planes, self.mirrored, self.bare)
        return self.planes.units.nbytes + sum(x.units.nbytes for x in more if x is not None)


def planar(buffer: LightingBuffer, layer: str, where: NDArray[np.intp]) -> F32 | None:
    """(3, n) radiance of a layer, or of all (""), on some pixels; None where there is no such layer."""
    if layer:
        chosen = next((x for x in buffer.layers if x.name == layer), None)
        if chosen is None:
            return None
        total = chosen.direct + chosen.indirect
    else:
        total = buffer.beauty
    return np.ascontiguousarray(total.reshape(-1, 3)[where].T, dtype=np.float32)


def surface_of(buffer: LightingBuffer) -> LightingBuffer:
    """What is seen, without light: of proxy and objects whichever covers more of a pixel."""
    out = replace(buffer, layers=(), noisy=(), variance=None, objects=None)
    objects = buffer.objects
    if objects is None:
        return out
    nearer = objects.coverage > buffer.coverage

    def chosen(name: str) -> F32:
        own, other = getattr(buffer, name), getattr(objects, name)
        return np.asarray(np.where(nearer if own.ndim == 2 else nearer[..., None], other, own), np.float32)

    names = "depth", "position", "normal", "geometric_normal", "albedo"
    planes: dict[str, Any] = {name: chosen(name) for name in names}
    return replace(out, coverage=buffer.coverage + objects.coverage, **planes)
