"""Splat colours on the device: spherical harmonics, the engine's work buffer, the tone curve per splat."""

from __future__ import annotations

import numpy as np

from mirelight import colour
from mirelight import sh as spherical
from mirelight.compositor.cloud import PADDED, Cloud, View, clamp, dot, from_eye
from mirelight.compositor.device import Array, Device
from mirelight.compositor.record import BLUE, GREEN, RECORD, RED
from mirelight.compositor.source import COMPACT_COLOR_STEPS, MOST_COLOR, tone_of
from mirelight.model import F32, CompositorSettings


def splat_colors(device: Device, cloud: Cloud, view: View, settings: CompositorSettings) -> F32:
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


def evaluated(device: Device, cloud: Cloud, view: View, offset: list[Array]) -> list[Array]:
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
        values = _basis(dr, [o * scale for o in offset], cloud.degree)
    else:
        values = _basis(dr, [-a for a in view.axes[2]], cloud.degree)
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
    compact = settings.profile == "playcanvas" and settings.work_buffer == "compact"
    limited = [clamp(dr, c, types.Float(0), types.Float(4 if compact else MOST_COLOR)) for c in rgb]
    if settings.profile == "physical":
        return limited
    if compact:
        steps = [steps / 4 for steps in COMPACT_COLOR_STEPS]
        held = [dr.floor(dr.fma(c, n, 0.5)) * (1 / n) for c, n in zip(limited, steps, strict=True)]
    else:
        held = [types.Float(types.Float16(c)) for c in limited]
    return [dr.power(c, colour.ENGINE_GAMMA) for c in held] if settings.linear else held


def _basis(dr: Array, direction: list[Array], degree: int) -> list[Array]:
    """`sh.basis` on the device."""
    x, y, z = direction
    c1, c2, c3 = spherical.C1, spherical.C2, spherical.C3
    out = [x * 0 + spherical.C0, -c1 * y, c1 * z, -c1 * x]
    if degree >= 2:
        xx, yy, zz = x * x, y * y, z * z
        out += [c2[0] * x * y, c2[1] * y * z, c2[2] * (2 * zz - xx - yy), c2[3] * x * z, c2[4] * (xx - yy)]
    if degree >= 3:
        out += [
            c3[0] * y * (3 * xx - yy),
            c3[1] * x * y * z,
            c3[2] * y * (4 * zz - xx - yy),
            c3[3] * z * (2 * zz - 3 * xx - 3 * yy),
            c3[4] * x * (4 * zz - xx - yy),
            c3[5] * z * (xx - yy),
            c3[6] * x * (xx - 3 * yy),
        ]
    return out
