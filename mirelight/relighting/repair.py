"""Captured light as the picture shows it: its shadows where the picture has them, no brighter than the picture is.

A ratio divides the splats' picture by captured light. That light is traced on a proxy, so its shadows end beside those
of the picture, and at once where splats fade; and what the picture shows of light beyond white ends at white. Either is
left in the frame: bright and dark lines along edges that are gone, and grey patches where the sun lay.

Both are questions of one kind, and pixels around answer them: how much of the sun falls here, and what colour is hidden
above white, so that the albedo is one that the same surface shows where neither is in doubt?
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mirelight.base import colour
from mirelight.model import F32, LightingBuffer, LightLayer
from mirelight.relighting.pixels import divide, unit_or_zero

_SHARES = np.array([0, 0.25, 0.5, 0.75, 1], np.float32)  # of the sun, that are tried
_NEAR = 0.02  # of the picture's longer side: so far from a traced shadow's edge its place is in doubt
_AROUND = 0.12  # of the longer side: so far pixels are asked
_ASKED = 128  # pixels
_TURN = np.pi * (3 - np.sqrt(5))  # golden angle: they lie evenly on a spiral (Vogel 1979)
_ALIKE = np.float32(0.25)  # how far the logarithms of albedos of one surface lie apart
_DOUBTED = np.float32(0.2)  # what a pixel in doubt counts as a witness
_STRANGER = np.float32(0.02)  # what is left of a share that no witness speaks for
_TRACED = np.float32(1.5)  # how much the traced share is believed
_SMOOTH = np.float32(1.0)  # how much the shares around are
_GRAZING = 0.08  # cosine to the sun, from which its shadows are looked for
_CLIPPED = np.float32(0.97)  # display value from which a channel is taken to be clipped
_LEAST = np.float32(1e-3)  # albedo
_ROUNDS = 2  # in the second, pixels in doubt are witnesses too

Seen = NDArray[np.bool_]
Int = NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class Sun:
    """The strongest distant lamp of the captured light."""

    traced: LightingBuffer  # the proxy by its direct light alone
    direction: F32  # (3,) that its light travels, unit
    irradiance: F32  # (3,) on a surface that faces it, over pi


def repaired(captured: LightingBuffer, sun: Sun | None, picture: F32) -> LightingBuffer:
    """Captured light with the sun's shadows, and the brightness, that the picture shows.

    Args:
        captured: H x W pixels of the lit proxy.
        sun: the same pixels by the sun alone; None: no distant lamp, so that shadows stay where they are.
        picture: (H, W, 4) the splats as captured, linear and premultiplied.

    Returns:
        The captured buffer, its light in one layer; where nothing is in doubt it is the captured light bit for bit.

    Raises:
        ValueError: pictures of different sizes.
    """
    if captured.coverage.shape != picture.shape[:2] or (sun and sun.traced.coverage.shape != picture.shape[:2]):
        raise ValueError(f"captured light, sun and picture of sizes {captured.coverage.shape}, {picture.shape[:2]}")
    return _Repair(captured, sun, picture).made()


class _Repair:
    """One view's."""

    def __init__(self, captured: LightingBuffer, sun: Sun | None, picture: F32) -> None:
        self.captured, self.sun = captured, sun
        self.weight = captured.albedo * captured.coverage[..., None]
        self.light = divide(captured.beauty, self.weight)
        self.color = divide(picture[..., :3], picture[..., 3:])
        self.normal = unit_or_zero(captured.normal)
        self.side = max(picture.shape[:2])
        self.known = (captured.coverage > 0.5) & (picture[..., 3] > 0.5) & (self.light.max(axis=-1) > 0)
        self.clipped = np.asarray(colour.srgb_encode(self.color)) >= _CLIPPED
        self.floor = np.float32(1e-6 + 0.003 * float(self.light[self.known].mean() if self.known.any() else 1))

        self.offsets = _spiral(_AROUND * self.side)

    def made(self) -> LightingBuffer:
        light = self._unclipped(self._shadowed())
        changed = (light != self.light).any(axis=-1, keepdims=True)
        out = np.asarray(np.where(changed, light * self.weight, self.captured.beauty), np.float32)
        layer = LightLayer(name="captured", direct=out, indirect=np.zeros_like(out))
        return replace(self.captured, layers=(layer,))

    def _shadowed(self) -> F32:
        """(H, W, 3) captured light, the sun's shadows in it those of the picture."""
        if self.sun is None:
            return self.light
        cosine = np.maximum(-(self.normal @ np.asarray(self.sun.direction, np.float32)), 0)
        traced = np.minimum(divide(self.sun.traced.beauty, self.weight), self.light)
        whole = np.asarray(cosine[..., None] * self.sun.irradiance, np.float32)
        rest = np.maximum(self.light - traced, self.floor)
        faces = self.known & (cosine > _GRAZING)
        start = np.clip(divide(traced.mean(-1, keepdims=True), whole.mean(-1, keepdims=True))[..., 0], 0, 1) * faces
        doubt = faces & _near_edges(start, faces, round(_NEAR * self.side))
        share, asking = start.copy(), np.nonzero(doubt)
        if not len(asking[0]):
            return self.light
        tried = [self._log_albedo(rest[asking] + x * whole[asking], asking) for x in _SHARES]
        likely = np.exp(-_TRACED * (_SHARES - start[asking][:, None]) ** 2)
        for turn in range(_ROUNDS):
            albedo = np.log(np.maximum(self.color / (rest + share[..., None] * whole), _LEAST))
            trust = self.known * np.where(doubt, _DOUBTED if turn else np.float32(0), np.float32(1))
            votes, _ = self._votes(asking, np.stack(tried, axis=1), albedo, trust)
            belief = (votes + _STRANGER) * likely
            if turn:
                belief *= np.exp(-_SMOOTH * (_SHARES - _blurred(share)[asking][:, None]) ** 2)
            belief *= belief
            share[asking] = (belief * _SHARES).sum(axis=1) / belief.sum(axis=1)
        return np.asarray(np.where(doubt[..., None], rest + share[..., None] * whole, self.light), np.float32)

    def _unclipped(self, light: F32) -> F32:
        """(H, W, 3) that light, held down where the picture ends at white and albedos around tell what it hides."""
        asking = np.nonzero(self.known & self.clipped.any(axis=-1))
        if not len(asking[0]):
            return light
        albedo = np.log(np.maximum(self.color / np.maximum(light, self.floor), _LEAST))
        trust = np.asarray(self.known & ~self.clipped.any(axis=-1), np.float32)
        votes, told = self._votes(asking, albedo[asking][:, None], albedo, trust)
        sure = (votes / (votes + _STRANGER)) * self.clipped[asking]
        hidden = np.maximum(told[:, 0] - albedo[asking], 0) * sure
        out = light.copy()
        out[asking] *= np.exp(-hidden)
        return out

    def _log_albedo(self, light: F32, where: tuple[Int, Int]) -> F32:
        return np.asarray(np.log(np.maximum(self.color[where] / light, _LEAST)), np.float32)

    def _votes(self, asking: tuple[Int, Int], tried: F32, albedo: F32, trust: F32) -> tuple[F32, F32]:
        """What pixels around say.

        Args:
            asking: (N,) rows and columns.
            tried: (N, K, 3) logarithms of albedos that they may have.
            albedo: (H, W, 3) those of all pixels.
            trust: (H, W) in them.

        Returns:
            (N, K) share of the witnesses that have such an albedo; (N, K, 3) the mean logarithm of those.
        """
        rows, columns = asking
        height, width = trust.shape
        capped = self.clipped[asking][:, None]
        normal, depth = self.normal[asking], self.captured.depth[asking]
        count, agreed = np.zeros(len(rows), np.float32), np.zeros(tried.shape[:2], np.float32)
        summed = np.zeros(tried.shape, np.float32)
        for down, right, nearness in self.offsets:
            at = np.clip(rows + down, 0, height - 1), np.clip(columns + right, 0, width - 1)
            alike = np.maximum((self.normal[at] * normal).sum(axis=-1), 0) ** 8
            apart = np.log(np.maximum(self.captured.depth[at], 1e-6) / np.maximum(depth, 1e-6)) / np.float32(0.15)
            weight = trust[at] * nearness * alike * np.exp(-(apart**2))
            weight *= np.where(self.clipped[at].any(axis=-1), _DOUBTED, np.float32(1))
            off = tried - albedo[at][:, None]
            squared = np.where(capped, np.maximum(off, 0), off) ** 2
            share = weight[:, None] * np.exp(-squared.mean(axis=-1) / (2 * _ALIKE**2))
            count += weight
            agreed += share
            summed += share[..., None] * albedo[at][:, None]
        safe = np.maximum(count, np.float32(1e-6))[:, None]
        mean = divide(summed, agreed[..., None])
        return agreed / safe, np.asarray(np.where(agreed[..., None] > 0, mean, tried), np.float32)


def _spiral(reach: float) -> list[tuple[int, int, np.float32]]:
    """Offsets in pixels, each with what a pixel counts there; denser and worth more near by."""
    out = {}
    for k in range(1, _ASKED + 1):
        radius, angle = reach * (k / _ASKED) ** 1.0, k * _TURN
        step = round(radius * np.sin(angle)), round(radius * np.cos(angle))
        if step != (0, 0):
            out[step] = np.float32(1 / (1 + (np.hypot(*step) / (0.3 * reach)) ** 2))
    return [(down, right, worth) for (down, right), worth in out.items()]


def _near_edges(share: F32, faces: Seen, reach: int) -> Seen:
    """(H, W) pixels within so many of an edge of the shares."""
    from scipy import ndimage

    low = ndimage.minimum_filter(np.where(faces, share, 1), 3)
    edge = ndimage.maximum_filter(np.where(faces, share, 0), 3) - low > 0.4
    return np.asarray(ndimage.distance_transform_edt(~edge) <= max(reach, 1)) if edge.any() else np.zeros_like(faces)


def _blurred(image: F32) -> F32:
    from scipy import ndimage

    return np.asarray(ndimage.gaussian_filter(image, 1.0), np.float32)
