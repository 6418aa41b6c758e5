"""Splats to image-space records: projection, culling and colour in one fused kernel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mirelight import sh as spherical
from mirelight.compositor.device import Array, Device
from mirelight.compositor.kernel import E4, SlopeLimits, SplatKernel, slope_limits
from mirelight.compositor.source import COMPACT_COLOR_STEPS, shape_of, tone_of
from mirelight.model import F32, Camera, CompositorSettings, SplatCloud

RECORD = 16  # floats; 64 bytes, a cache line
VALUE_ROW = 8  # floats a splat that can be blended beside its colour; a whole packet
# A record's slots. With (dx, dy) the offset from the centre in px and u = S11 dx + S12 dy, v = S22 dy, a fragment's
# alpha is SCALE 2^e - OFFSET with e = REACH - u² - v². It is clipped where e <= 0, so a record of zeros always is.
X, Y, S11, S12, S22, REACH, RED, GREEN, BLUE, DEPTH, SCALE, OFFSET, HALF_HEIGHT, TURN = range(14)

LN2 = float(np.log(2.0))
HALF_LOG2E = 0.5 / LN2
SLACK = 1e-3  # px, added to footprints so that rounding drops no fragment that the blend would keep

PADDED = {1: 4, 4: 16, 9: 32, 16: 48}  # SH coefficients -> floats a row: whole packets


@dataclass(frozen=True, slots=True, eq=False)
class Cloud:
    """A splat cloud in the device's memory. N splats."""

    count: int
    degree: int
    antialiased: bool
    means: list[Array]  # 3 x (N,) world units
    factors: list[Array]  # 9 x (N,): rows of R diag(scales)
    opacities: Array  # (N,)
    sh: Array  # (N * padded,) rows of K x 3 coefficients


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """A camera as opaque scalars, so that a new one compiles nothing."""

    eye: list[Array]
    axes: list[list[Array]]  # right, up, back
    focal: tuple[Array, Array]
    center: tuple[Array, Array]
    size: tuple[Array, Array]  # px, as floats
    depths: tuple[Array, Array]  # near and far
    slopes: SlopeLimits  # of opaque scalars
    perspective: bool


@dataclass(frozen=True, slots=True, eq=False)
class Projected:
    """Records of all N splats (undefined where culled), their sort keys, and which can be seen."""

    records: Array  # (N * RECORD,)
    key: Array  # (N,) uint32, ordered as the distance
    visible: Array  # (N,) bool


def upload(device: Device, splats: SplatCloud, settings: CompositorSettings) -> Cloud:
    """Copy a cloud to the device, through the engine's work buffer where the profile has one."""
    quats, scales, opacities = shape_of(splats, settings)
    w, x, y, z = (device.floats(quats[:, i]) for i in range(4))
    s = [device.floats(scales[:, i]) for i in range(3)]
    factors = [
        (1 - 2 * (y * y + z * z)) * s[0], 2 * (x * y - w * z) * s[1], 2 * (x * z + w * y) * s[2],
        2 * (x * y + w * z) * s[0], (1 - 2 * (x * x + z * z)) * s[1], 2 * (y * z - w * x) * s[2],
        2 * (x * z - w * y) * s[0], 2 * (y * z + w * x) * s[1], (1 - 2 * (x * x + y * y)) * s[2],
    ]  # fmt: skip
    device.dr.eval(factors)
    count, coefficients = splats.sh.shape[:2]
    padded = PADDED[coefficients]
    rows = splats.sh.reshape(count, -1)
    if padded != 3 * coefficients:
        rows = np.pad(rows, ((0, 0), (0, padded - 3 * coefficients)))
    return Cloud(
        count=count,
        degree=splats.sh_degree,
        antialiased=splats.antialiased,
        means=[device.floats(splats.means[:, i]) for i in range(3)],
        factors=factors,
        opacities=device.floats(opacities),
        sh=device.floats(rows),
    )


def view_of(device: Device, camera: Camera, kernel: SplatKernel) -> View:
    """The camera's numbers on the device."""
    c = device.constant
    limits = slope_limits(kernel, camera)
    return View(
        eye=[c(v) for v in camera.position],
        axes=[[c(v) for v in camera.world_from_camera[:3, i]] for i in range(3)],
        focal=(c(camera.fx), c(camera.fy)),
        center=(c(camera.cx), c(camera.cy)),
        size=(c(camera.width), c(camera.height)),
        depths=(c(camera.near), c(camera.far)),
        slopes=SlopeLimits(*(c(v) for v in (limits.left, limits.right, limits.bottom, limits.top))),
        perspective=camera.projection == "perspective",
    )


def _dot(dr: Array, a: list[Array], b: list[Array]) -> Array:
    return dr.fma(a[0], b[0], dr.fma(a[1], b[1], a[2] * b[2]))


def _clamp(dr: Array, value: Array, low: Array, high: Array) -> Array:
    """Without the NaN rules of `dr.clip`, which cost five instructions a side."""
    value = dr.select(value < low, low, value)
    return dr.select(value > high, high, value)


def project(device: Device, cloud: Cloud, view: View, kernel: SplatKernel, settings: CompositorSettings) -> Projected:
    """Project every splat. The formulas are those of `reference.project`; see there."""
    dr, Float, UInt32 = device.dr, device.types.Float, device.types.UInt32

    offset = [m - e for m, e in zip(cloud.means, view.eye, strict=True)]
    right, up, back = view.axes
    x, y, depth = _dot(dr, right, offset), _dot(dr, up, offset), -_dot(dr, back, offset)
    inverse = 1 / depth if view.perspective else Float(1)
    slope_x, slope_y = x * inverse, y * inverse
    fx, fy = view.focal
    px = dr.fma(fx, slope_x, view.center[0])
    py = dr.fma(-fy, slope_y, view.center[1])

    # Jacobian rows in the world, clamped so that splats beside the frustum do not blow up
    if view.perspective:
        limits = view.slopes
        bx, by = (
            (_clamp(dr, slope_x, limits.left, limits.right), _clamp(dr, slope_y, limits.bottom, limits.top))
            if kernel.frustum_margin is not None
            else (slope_x, slope_y)
        )
        jx = [fx * inverse * dr.fma(bx, b, a) for a, b in zip(right, back, strict=True)]
        jy = [-fy * inverse * dr.fma(by, b, a) for a, b in zip(up, back, strict=True)]
    else:
        jx, jy = [fx * a for a in right], [-fy * a for a in up]
    columns = [cloud.factors[i::3] for i in range(3)]
    mx = [_dot(dr, jx, c) for c in columns]
    my = [_dot(dr, jy, c) for c in columns]

    # The determinant from the cross product: needles would cancel in xx yy - xy²
    cross = [
        dr.fma(mx[1], my[2], -mx[2] * my[1]),
        dr.fma(mx[2], my[0], -mx[0] * my[2]),
        dr.fma(mx[0], my[1], -mx[1] * my[0]),
    ]
    xx, xy, yy, before = _dot(dr, mx, mx), _dot(dr, mx, my), _dot(dr, my, my), _dot(dr, cross, cross)
    low = kernel.low_pass
    determinant = before + dr.fma(low, xx + yy, low * low)
    opacity = cloud.opacities
    if cloud.antialiased:
        share = before / determinant
        opacity = opacity * dr.sqrt(dr.select(share > kernel.least_compensation, share, kernel.least_compensation))
    xx, yy = xx + low, yy + low
    visible = (opacity >= device.constant(kernel.alpha_clip)) & (opacity > 0)
    if kernel.clips_depth:
        visible &= (depth > view.depths[0]) & (depth < view.depths[1])
    else:
        visible &= depth > 0
    if np.isfinite(kernel.max_variance):
        xx, xy, yy, determinant, largest = _limited(device, xx, xy, yy, determinant, kernel.max_variance)
        visible &= largest >= device.constant(kernel.min_variance)

    # Where alpha meets the clip: reach in powers of two
    clip = device.constant(kernel.alpha_clip)
    if kernel.truncated:
        scale = opacity * (1 / (1 - E4))
        lost = opacity * (E4 / (1 - E4))
        level = clip + lost
        reach = dr.log2(scale / level)
    else:
        lost, level = Float(0), clip
        reach = dr.log2(opacity / clip)
    root = HALF_LOG2E**0.5
    conditional = dr.rsqrt(yy)
    s11 = root * dr.sqrt(yy / determinant)
    s12 = -root * xy * conditional / dr.sqrt(determinant)
    s22 = root * conditional
    half_width = dr.sqrt(reach * xx) / root
    half_height = dr.sqrt(reach * yy) / root
    turn = xy / xx * half_width  # row offset of the rightmost point

    width, height = view.size
    visible &= (px + half_width > 0.5 - SLACK) & (px - half_width < width - 0.5 + SLACK)
    visible &= (py + half_height > 0.5 - SLACK) & (py - half_height < height - 0.5 + SLACK)
    visible &= dr.isfinite(s11 + s12 + s22) & (half_width >= 0) & (half_height >= 0)

    raw = _evaluated(device, cloud, view, offset, visible)
    visible &= dr.isfinite(raw[0] + raw[1] + raw[2])  # one NaN would spread over whole tiles
    red, green, blue = _stored(device, raw, settings)
    record = [px, py, s11, s12, s22, reach, red, green, blue, depth, level, lost, half_height, turn, 0, 0]
    records = dr.empty(Float, max(1, cloud.count) * RECORD)
    index = dr.arange(UInt32, cloud.count)
    dr.scatter(records, device.types.ArrayXf(record), index, visible)
    distance = dr.sqrt(_dot(dr, offset, offset)) if settings.sort == "radial" else depth
    key = dr.select(visible, dr.reinterpret_array(UInt32, distance), 0)
    dr.eval(records, key, visible)
    return Projected(records, key, visible)


def _limited(
    device: Device, xx: Array, xy: Array, yy: Array, determinant: Array, most: float
) -> tuple[Array, Array, Array, Array, Array]:
    """Covariance with its eigenvalues clamped to `most`, its determinant, and the larger eigenvalue before."""
    dr = device.dr
    limit = device.constant(most)
    middle, tilt = (xx + yy) * 0.5, (xx - yy) * 0.5
    radius = dr.sqrt(dr.fma(tilt, tilt, xy * xy))
    large = middle + radius
    small = determinant / large
    new_large = dr.select(large > limit, limit, large)
    new_small = dr.select(small > limit, limit, small)
    stretch = dr.select(radius > 0, (new_large - new_small) / (2 * radius), 0)
    keep = new_small - stretch * (middle - radius)
    over = large > limit
    return (
        dr.select(over, dr.fma(stretch, xx, keep), xx),
        dr.select(over, stretch * xy, xy),
        dr.select(over, dr.fma(stretch, yy, keep), yy),
        dr.select(over, new_large * new_small, determinant),
        large,
    )


def splat_colors(device: Device, cloud: Cloud, view: View, settings: CompositorSettings) -> F32:
    """(N, 3) colours as they are blended, seen from the camera; culled splats too."""
    offset = [m - e for m, e in zip(cloud.means, view.eye, strict=True)]
    rgb = _stored(device, _evaluated(device, cloud, view, offset, device.types.Bool(True)), settings)
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


def _evaluated(device: Device, cloud: Cloud, view: View, offset: list[Array], wanted: Array) -> list[Array]:
    """Red, green and blue ``0.5 + Σ sh Y``, display-encoded."""
    dr, types = device.dr, device.types
    row_of_sh = PADDED[(cloud.degree + 1) ** 2]
    index = dr.arange(types.UInt32, cloud.count)
    row = dr.gather(types.ArrayXf, cloud.sh, index, wanted, shape=(row_of_sh, cloud.count))
    if cloud.degree == 0:
        values = [types.Float(spherical.C0)]
    elif view.perspective:
        scale = dr.rsqrt(_dot(dr, offset, offset))
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


def _stored(device: Device, rgb: list[Array], settings: CompositorSettings) -> list[Array]:
    """What is blended, but for the tone curve; see `source.colors_of`."""
    dr, types = device.dr, device.types
    if settings.profile == "physical":
        return [dr.select(c > 0, c, 0) for c in rgb]
    if settings.work_buffer == "large":
        stored = [types.Float(types.Float16(c)) for c in rgb]
        stored = [dr.select(c > 0, c, 0) for c in stored]
    else:
        stored = []
        for c, steps in zip(rgb, COMPACT_COLOR_STEPS, strict=True):
            level = dr.floor(dr.fma(_clamp(dr, c, types.Float(0), types.Float(4)), steps / 4, 0.5))
            stored.append(level * (4 / steps))
    return [dr.power(c, 2.2) for c in stored] if settings.linear else stored


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
