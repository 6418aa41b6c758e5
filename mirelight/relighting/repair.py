"""Captured light as the picture shows it: its shadows where the picture has them, and no brighter than white.

A ratio divides the splats' picture by captured light. That light is traced on a proxy: its shadows end beside those of
the picture, and at once where splats fade. And what the picture shows of light beyond white ends at white. Either is
left in the frame: bright and dark lines along edges that are gone, and grey patches where the sun lay.

Both are questions of one kind, and pixels around answer them: how much of the sun falls here, and what does a channel
hide that ends at white, if the albedo is one that the same surface shows where neither is in doubt?
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from mirelight.base import colour
from mirelight.model import F32, LightingBuffer, LightLayer
from mirelight.relighting.pixels import divide, unit_or_zero
from mirelight.relighting.resample import bilinear
from mirelight.relighting.witnesses import Witnesses

_SHARES = np.array([0, 0.25, 0.5, 0.75, 1], np.float32)  # of the sun, that are tried
_NEAR = 0.02  # of the picture's longer side: so far from a traced shadow's edge its place is in doubt
_STEP = 0.4  # of the sun's light from a pixel to the next, that is an edge
_GRAZING = 0.08  # cosine to the sun, from which its shadows are looked for
_TRACED = np.float32(2)  # how much the traced share is believed
_SMOOTH = np.float32(1)  # how much the shares around are
_ROUNDS = 2  # in the second, pixels in doubt are witnesses too
_DOUBTED = np.float32(0.2)  # what one in doubt counts
_STRANGER = np.float32(0.02)  # what is left of a share that no witness speaks for
_CLIPPED = 0.95  # display value from which a channel is taken to end at white
_LEAST = np.float32(1e-3)  # albedo
_DARK = 0.003  # of the mean light, that there is at least
_MOST = 640  # pixels along the longer side, at which larger pictures are asked

Mask: TypeAlias = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Sun:
    """The strongest distant lamp of the captured light, as a view sees it."""

    beauty: F32  # (h, w, 3) radiance of the lit proxy by its direct light alone, premultiplied by coverage
    direction: F32  # (3,) unit, the way its light travels
    irradiance: F32  # (3,) on a surface that faces it, over pi


def repaired(captured: LightingBuffer, sun: Sun | None, picture: F32) -> LightingBuffer:
    """Captured light with the sun's shadows, and the brightness, that the picture shows.

    Args:
        captured: h x w pixels of the lit proxy.
        sun: the same pixels by the sun alone; None: there is none, and shadows stay where they are.
        picture: (H, W, 4) the splats as captured, linear and premultiplied.

    Returns:
        The captured buffer, its light in one layer; where nothing is in doubt it is the captured light bit for bit.

    Raises:
        ValueError: the sun's picture has another size.
    """
    size = captured.coverage.shape
    if sun is not None and sun.beauty.shape[:2] != size:
        raise ValueError(f"captured light of {size} pixels, its sun of {sun.beauty.shape[:2]}")
    surface = captured.albedo * captured.coverage[..., None]
    traced = divide(captured.beauty, surface)
    view = _View.of(captured, traced, bilinear(picture, size))
    light = traced if sun is None else _shadowed(view, traced, divide(sun.beauty, surface), _falling(captured, sun))
    light = _unclipped(view, light)
    changed = (light != traced).any(axis=-1, keepdims=True)
    out = np.asarray(np.where(changed, light * surface, captured.beauty), np.float32)
    return replace(captured, layers=(LightLayer(name="captured", direct=out, indirect=np.zeros_like(out)),))


@dataclass(frozen=True, slots=True, eq=False)
class _View:
    """A view, h x w pixels, at the size at which it is asked: every `step` pixels one."""

    size: tuple[int, int]  # of the light
    step: int
    color: F32  # (h, w, 3) the picture, linear
    known: Mask  # (h, w) pixels that show the proxy, lit
    clipped: Mask  # (h, w, 3) channels that end at white
    floor: np.float32  # the least light that albedos are told by
    witnesses: Witnesses

    @staticmethod
    def of(captured: LightingBuffer, light: F32, picture: F32) -> _View:
        height, width = light.shape[:2]
        step = -(-max(height, width) // _MOST)

        def down(image: F32) -> F32:
            return _shrunk(image, step)

        alpha, coverage, small = down(picture[..., 3:]), down(captured.coverage[..., None]), down(light)
        color = divide(down(picture[..., :3]), alpha)
        known = (coverage[..., 0] > 0.5) & (alpha[..., 0] > 0.5) & (small.max(axis=-1) > 0)
        mean = float(small[known].mean()) if known.any() else 1.0
        depth = divide(down(captured.depth[..., None] * captured.coverage[..., None]), coverage)[..., 0]
        return _View(
            size=(height, width),
            step=step,
            color=color,
            known=known,
            clipped=np.asarray(colour.srgb_encode(color)) >= _CLIPPED,
            floor=np.float32(_DARK * mean + 1e-6),
            witnesses=Witnesses(unit_or_zero(down(captured.normal)), depth),
        )

    def down(self, image: F32) -> F32:
        """A picture (H, W, n) of the light's size at this one."""
        return _shrunk(image, self.step)

    def up(self, image: F32) -> F32:
        """A picture (h, w) or (h, w, n) at the light's size."""
        if self.step == 1:
            return image
        rows, columns = (self.step * n for n in image.shape[:2])
        return bilinear(image, (rows, columns))[: self.size[0], : self.size[1]]

    def log_albedo(self, light: F32) -> F32:
        """(h, w, 3) logarithm of what the surface reflects, under such light (h, w, 3)."""
        return np.asarray(np.log(np.maximum(self.color / np.maximum(light, self.floor), _LEAST)), np.float32)


def _falling(captured: LightingBuffer, sun: Sun) -> F32:
    """(h, w, 3) the sun's irradiance / pi on the surface, where nothing is in its way."""
    facing = np.maximum(-(unit_or_zero(captured.normal) @ np.asarray(sun.direction, np.float32)), np.float32(0))
    return np.asarray(facing[..., None] * sun.irradiance, np.float32)


def _shadowed(view: _View, light: F32, sunlight: F32, falling: F32) -> F32:
    """(H, W, 3) captured light with the sun's shadows where the picture has them.

    Args:
        view: the picture.
        light: (H, W, 3) all of the captured light, as traced.
        sunlight: (H, W, 3) the sun's part of it.
        falling: (H, W, 3) that part where nothing is in the way.
    """
    rest = np.maximum(light - np.minimum(sunlight, light), view.floor)
    less, most, strongest = view.down(rest), view.down(falling), max(float(falling.max()), 1e-20)
    faces = view.known & (most.max(axis=-1) > _GRAZING * strongest)
    traced = np.clip(divide(view.down(sunlight).mean(-1, keepdims=True), most.mean(-1, keepdims=True))[..., 0], 0, 1)
    traced = np.asarray(traced * faces, np.float32)
    doubt = faces & _near_edges(traced, faces, max(1, round(_NEAR * max(faces.shape))))
    who = np.flatnonzero(doubt)
    if not len(who):
        return light
    share = traced.copy()
    tried = np.stack([view.log_albedo(less + x * most).reshape(-1, 3)[who].T for x in _SHARES])
    believed = np.exp(-_TRACED * (_SHARES[:, None] - traced.flat[who]) ** 2)
    clipped = np.ascontiguousarray(view.clipped.reshape(-1, 3)[who].T)
    sound = np.where(view.clipped.any(axis=-1), _DOUBTED, np.float32(1)) * view.known
    for turn in range(_ROUNDS):
        albedo = view.log_albedo(less + share[..., None] * most)
        trust = np.where(doubt, _DOUBTED if turn else np.float32(0), np.float32(1)) * sound
        votes, _ = view.witnesses.ask(who, tried, clipped, albedo, trust)
        belief = (votes + _STRANGER) * believed
        if turn:
            belief *= np.exp(-_SMOOTH * (_SHARES[:, None] - _blurred(share).flat[who]) ** 2)
        belief *= belief
        share.flat[who] = (belief * _SHARES[:, None]).sum(axis=0) / belief.sum(axis=0)
    within = view.up(doubt.astype(np.float32))[..., None]
    shown = rest + view.up(share)[..., None] * falling
    return np.asarray(np.where(within > 0, within * shown + (1 - within) * light, light), np.float32)


def _unclipped(view: _View, light: F32) -> F32:
    """(H, W, 3) that light, as much lower as the picture is that ends at white: by albedos that are seen around."""
    who = np.flatnonzero(view.known & view.clipped.any(axis=-1))
    if not len(who):
        return light
    albedo = view.log_albedo(view.down(light))
    clipped = np.ascontiguousarray(view.clipped.reshape(-1, 3)[who].T)
    trust = np.asarray(view.known & ~view.clipped.any(axis=-1), np.float32)
    own = albedo.reshape(-1, 3)[who].T
    votes, mean = view.witnesses.ask(who, own[None], clipped, albedo, trust)
    sure = clipped * (votes[0] / (votes[0] + _STRANGER))
    hidden = np.zeros_like(albedo)
    hidden.reshape(-1, 3)[who] = (np.maximum(mean - own, 0) * sure).T
    return np.asarray(light * np.exp(-view.up(hidden)), np.float32)


# --- pictures --------------------------------------------------------------------------------------------------------


def _shrunk(image: F32, step: int) -> F32:
    """(ceil(H / step), ceil(W / step), n) means over blocks of (H, W, n); edges are repeated."""
    if step == 1:
        return image
    height, width = image.shape[:2]
    whole = np.pad(image, ((0, -height % step), (0, -width % step), (0, 0)), mode="edge")
    rows, columns = whole.shape[0] // step, whole.shape[1] // step
    return np.asarray(whole.reshape(rows, step, columns, step, -1).mean(axis=(1, 3)), np.float32)


def _near_edges(share: F32, faces: Mask, reach: int) -> Mask:
    """(h, w) pixels within so many of an edge of the sun's shares."""
    from scipy import ndimage

    step = ndimage.maximum_filter(np.where(faces, share, 0), 3) - ndimage.minimum_filter(np.where(faces, share, 1), 3)
    edge = step > _STEP
    return np.asarray(ndimage.distance_transform_edt(~edge) <= reach) if edge.any() else np.zeros_like(faces)


def _blurred(image: F32) -> F32:
    from scipy import ndimage

    return np.asarray(ndimage.gaussian_filter(image, 1.0), np.float32)
