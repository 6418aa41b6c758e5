"""Splat colours on the device: spherical harmonics, the engine's work buffer, the tone curve per splat."""

from __future__ import annotations

import numpy as np

from mirelight.base import colour
from mirelight.base import sh as spherical
from mirelight.compositor.cloud import PADDED, Cloud, Eye, clamp, dot, from_eye
from mirelight.compositor.device import Array, Device
from mirelight.compositor.record import BLUE, GREEN, RECORD, RED
from mirelight.compositor.source import COMPACT_COLOR_STEPS, MOST_COLOR, tone_of
from mirelight.model import F32, CompositorSettings, rules_of


def splat_colors(device: Device, cloud: Cloud, view: Eye, settings: CompositorSettings) -> F32:
    """(N, 3) colours as they are blended, seen from the camera; culled splats too."""
    rgb = evaluated(device, cloud, view, from_eye(cloud, view))
    rgb = stored(device, rgb, settings)
    device.dr.eval(rgb)
    return tone_of(np.stack([c.numpy() for c in rgb], axis=1), settings)


def tone_records(device: Device, records: Array, settings: CompositorSettings) -> None:
    """Apply the engine's tone curve to the colours of records, in place. The curves have one home, in NumPy."""
    dr, types = device.dr, device.types
    count = len(records) // RECORD
    slots = [dr.arange(types.UInt32, count) * RECORD + slot for slot in (RED, GREEN, BLUE)]
    rgb = [dr.gather(types.Float, records, slot) for slot in slots]
    dr.eval(rgb)
    toned = tone_of(np.stack([c.numpy() for c in rgb], axis=1), settings)
    for i, slot in enumerate(slots):
        dr.scatter(records, device.floats(toned[:, i]), slot)
    dr.eval(records)


def evaluated(device: Device, cloud: Cloud, view: Eye, offset: list[Array]) -> list[Array]:
    """Red, green and blue ``0.5 + Σ sh Y``, display-encoded.

    Of all splats: reading every row in order costs less than picking those in view, unless they are few and together.
    """
    dr, types = device.dr, device.types
    row_of_sh = PADDED[(cloud.degree + 1) ** 2]
    index = dr.arange(types.UInt32, cloud.count)
    row = dr.gather(types.ArrayXf, cloud.sh, index, shape=(row_of_sh, cloud.count))
    if cloud.degree == 0:
        values = [types.Float(spherical.C0)]
    elif view.perspective:
        scale = dr.rsqrt(dot(dr, offset, offset))
        values = spherical.terms([o * scale for o in offset], cloud.degree)
    else:
        values = spherical.terms([-a for a in view.axes[2]], cloud.degree)
    out = []
    for channel in range(3):
        total = types.Float(0.5)
        for k, value in enumerate(values):
            total = dr.fma(row[3 * k + channel], value, total)
        out.append(total)
    return out


def stored(device: Device, rgb: list[Array], settings: CompositorSettings) -> list[Array]:
    """What is blended, but for the tone curve; see `source.colors_of`."""
    dr, types = device.dr, device.types
    packed = rules_of(settings.profile).splats.packed
    compact = packed and settings.work_buffer == "compact"
    limited = [clamp(dr, c, types.Float(0), types.Float(4 if compact else MOST_COLOR)) for c in rgb]
    if not packed:
        return limited
    if compact:
        steps = [steps / 4 for steps in COMPACT_COLOR_STEPS]
        held = [dr.floor(dr.fma(c, n, 0.5)) * (1 / n) for c, n in zip(limited, steps, strict=True)]
    else:
        held = [types.Float(types.Float16(c)) for c in limited]
    return [dr.power(c, colour.ENGINE_GAMMA) for c in held] if settings.blends_linear else held
