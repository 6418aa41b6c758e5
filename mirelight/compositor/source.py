"""What the rasteriser reads of a cloud: as stored (physical), or as the engine's work buffers hold it (playcanvas)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mirelight.base import colour
from mirelight.base.sh import C0
from mirelight.model import F32, F64, CompositorSettings, SplatCloud, rules_of

_LOG_SCALE_MIN, _LOG_SCALE_RANGE = -12.0, 21.0  # COMPACT: natural logarithm of the scale, 8 bits
MOST_COLOR = 65504.0  # half precision's largest number; brighter splats, which sums could not hold, are limited to it
_SH_STEPS = (2047.0, 1023.0, 2047.0)  # textures: levels of a coefficient's red, green and blue
COMPACT_COLOR_STEPS = (2047.0, 2047.0, 1023.0)  # COMPACT: levels of red, green and blue over 0..4


def through_half(values: NDArray[np.floating]) -> F32:
    """Values of any shape rounded to half precision."""
    return np.asarray(values, dtype=np.float16).astype(np.float32)


def uploaded(splats: SplatCloud) -> SplatCloud:
    """The cloud as the engine's textures hold an uncompressed file, before any work buffer.

    Half floats of rotation, scale, colour and opacity; harmonics of degree 1 and above in 11, 10 and 11 bits of the
    splat's largest coefficient. Compressed files are unpacked from their own bits.
    """
    if not len(splats):
        return splats
    quats = (splats.quats / np.linalg.norm(splats.quats, axis=1, keepdims=True)).astype(np.float32)
    sh = splats.sh.copy()
    sh[:, 0] = (through_half(np.float32(0.5) + np.float32(C0) * sh[:, 0]) - np.float32(0.5)) / np.float32(C0)
    if sh.shape[1] > 1:
        rest = sh[:, 1:]
        largest = np.maximum(np.abs(rest).reshape(len(rest), -1)[:, 1:].max(axis=1), rest[:, 0, 0])[:, None, None]
        steps = np.array(_SH_STEPS, dtype=np.float32)
        share = np.divide(rest, largest, out=np.zeros_like(rest), where=largest > 0)
        level = np.clip(np.floor((share * 0.5 + 0.5) * steps + 0.5), 0, steps)
        sh[:, 1:] = np.where(largest > 0, (level / steps * 2 - 1) * largest, 0)
    return replace(
        splats,
        quats=_large_quats(quats),
        scales=through_half(splats.scales),
        opacities=through_half(np.clip(splats.opacities, 0, 1)),
        sh=sh.astype(np.float32),
    )


def _compact_scales(scales: F32) -> F32:
    """8 bits of log scale over e^-12..e^9; below 1e-10 exactly 0."""
    level = (np.log(scales) - _LOG_SCALE_MIN) * (255 / _LOG_SCALE_RANGE)
    level = np.floor(np.clip(level + 0.5, 1, 255))
    out = np.exp(level * (_LOG_SCALE_RANGE / 255) + _LOG_SCALE_MIN)
    return np.where(scales < 1e-10, 0, out).astype(np.float32)


def _compact_quats(quats: F32) -> F32:
    """11, 11 and 10 bits of the half-angle projection p = xyz / sqrt(1 + w), w >= 0."""
    q = np.where(quats[:, :1] < 0, -quats, quats).astype(np.float64)
    p = q[:, 1:] / np.sqrt(1 + q[:, :1])
    steps = np.array([2047.0, 2047.0, 1023.0])
    p = np.floor(np.clip((p * 0.5 + 0.5) * steps + 0.5, 0, steps)) / steps * 2 - 1
    d = np.sum(p * p, axis=1, keepdims=True)
    return np.concatenate([1 - d, np.sqrt(np.maximum(0, 2 - d)) * p], axis=1).astype(np.float32)


def _large_quats(quats: F32) -> F32:
    """x, y, z as half floats with w >= 0 restored from them."""
    q = through_half(np.where(quats[:, :1] < 0, -quats, quats)[:, 1:])
    w = np.sqrt(np.maximum(0, 1 - np.sum(q * q, axis=1, keepdims=True)))
    return np.concatenate([w, q], axis=1)


def shape_of(splats: SplatCloud, settings: CompositorSettings) -> tuple[F32, F32, F32]:
    """Quaternions (N, 4) wxyz unit, scales (N, 3) and opacities (N,) as the profile's rasteriser reads them.

    What is no number or too large comes out as such; those splats are dropped when they are projected.
    """
    with np.errstate(all="ignore"):
        quats = (splats.quats / np.linalg.norm(splats.quats, axis=1, keepdims=True)).astype(np.float32)
        opacities = np.clip(splats.opacities, 0, 1)
        if not rules_of(settings.profile).splats.packed:
            return quats, splats.scales, opacities
        if settings.work_buffer == "large":
            return _large_quats(quats), through_half(splats.scales), through_half(opacities)
        levels = np.floor(opacities * 255 + 0.5) / 255
        return _compact_quats(quats), _compact_scales(splats.scales), levels.astype(np.float32)


def factors_of(quats: F32, scales: F32) -> F64:
    """(N, 3, 3) matrices R diag(scales): the covariance is their product with their transpose."""
    w, x, y, z = np.moveaxis(quats.astype(np.float64), 1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=1) for row in rows], axis=1) * scales[:, None, :]


def colors_of(rgb: F64, settings: CompositorSettings) -> F32:
    """What is blended, (N, 3) float32, from evaluated splat colours ``0.5 + Σ sh Y``, display-encoded.

    Both: at least 0 and at most MOST_COLOR. Playcanvas: through the work buffer, then the tone curve per splat in the
    gamma pipeline, or the 2.2 power in the linear one.
    """
    limited = np.clip(rgb, 0, MOST_COLOR)
    if not rules_of(settings.profile).splats.packed:
        return limited.astype(np.float32)
    if settings.work_buffer == "large":
        stored = through_half(limited)
    else:
        steps = np.array(COMPACT_COLOR_STEPS) / 4
        stored = (np.floor(np.clip(rgb, 0, 4) * steps + 0.5) / steps).astype(np.float32)
    return colour.power_decode(stored) if settings.blends_linear else tone_of(stored, settings)


def tone_of(stored: F32, settings: CompositorSettings) -> F32:
    """Colours after the engine's per-splat tone curve, if there is one; (N, 3) display-encoded."""
    if not settings.tones_splats:
        return stored
    light = colour.tone_map(colour.power_decode(stored) * np.float32(settings.exposure), settings.tone)
    return np.asarray(np.power(light + np.float32(colour.ENGINE_ENCODE_OFFSET), np.float32(1 / colour.ENGINE_GAMMA)))
