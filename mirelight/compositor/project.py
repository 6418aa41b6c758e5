"""Splats to image-space records: projection, culling and colour in one fused kernel.

The formulas are those of `reference.project`, in float32 and arranged so that needles do not cancel.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mirelight.compositor.cloud import Cloud, Eye, clamp, dot, from_eye
from mirelight.compositor.color import evaluated, stored
from mirelight.compositor.device import Array, Device
from mirelight.compositor.engine import EngineDrawing, Half, snapped_halves
from mirelight.compositor.kernel import E4, SplatKernel
from mirelight.compositor.record import HALF_LOG2E, OCTAVE, RECORD, SLACK, Covariance
from mirelight.model import CompositorSettings

EXACT = EngineDrawing()


@dataclass(frozen=True, slots=True, eq=False)
class Projected:
    """Records of all N splats (undefined where culled), their sort keys, and which can be seen.

    Where quads are drawn by halves, N is twice the number of splats.
    """

    records: Array  # (N * RECORD,)
    key: Array  # (N,) uint32, ordered as the distance
    visible: Array  # (N,) bool


@dataclass(frozen=True, slots=True, eq=False)
class _Look:
    """What both halves of a splat share."""

    reach: tuple[Array, Array, Array]  # see `_reach`
    color: list[Array]  # 3 x (N,)
    depth: Array


@dataclass(frozen=True, slots=True, eq=False)
class _Position:
    """Centres in the camera's frame."""

    depth: Array  # along the view axis
    inverse: Array  # 1 / depth; 1 for orthographic cameras
    slopes: tuple[Array, Array]  # x and y (up) over depth
    pixel: tuple[Array, Array]


def project(
    device: Device,
    cloud: Cloud,
    view: Eye,
    kernel: SplatKernel,
    settings: CompositorSettings,
    drawing: EngineDrawing = EXACT,
) -> Projected:
    """Every splat as an ellipse on the picture's plane."""
    dr, types = device.dr, device.types
    offset = from_eye(cloud, view)
    at = _position(device, view, offset)
    shape = _covariance(device, cloud, view, kernel, at)
    opacity = cloud.opacities
    if cloud.antialiased:
        least = kernel.least_compensation
        opacity = opacity * dr.sqrt(dr.select(shape.share > least, shape.share, least))
    visible = (opacity >= device.constant(kernel.alpha_clip)) & (opacity > 0) & (at.depth > view.depths[0])
    visible &= at.depth < view.depths[1]
    if np.isfinite(kernel.max_variance):
        shape, largest = _limited(device, shape, kernel.max_variance)
        visible &= largest >= device.constant(kernel.min_variance)

    reach = _reach(device, kernel, opacity)
    raw = evaluated(device, cloud, view, offset)
    visible &= dr.isfinite(raw[0] + raw[1] + raw[2])  # one NaN would spread over whole tiles
    look = _Look(reach, stored(device, raw, settings), at.depth)
    if drawing.subpixel_bits is None:
        zero = types.Float(0)
        halves: tuple[Half, ...] = (Half(at.pixel, shape, (zero, zero)),)
    else:
        clip = device.constant(kernel.alpha_clip)
        halves = snapped_halves(device, at.pixel, shape, opacity, clip, drawing.subpixel_bits)
    if drawing.rank is not None:
        key = types.UInt32(drawing.rank)
    else:
        distance = dr.sqrt(dot(dr, offset, offset)) if settings.sort == "radial" else at.depth
        key = dr.reinterpret_array(types.UInt32, distance)
    return _records(device, cloud.count, view, look, halves, key, visible)


def _records(
    device: Device, count: int, view: Eye, look: _Look, halves: tuple[Half, ...], key: Array, visible: Array
) -> Projected:
    """One record a splat, or one for each half of its quad."""
    dr, types = device.dr, device.types
    records = dr.empty(types.Float, count * RECORD * len(halves))
    keys, seen = dr.empty(types.UInt32, count * len(halves)), dr.empty(types.Bool, count * len(halves))
    root = (HALF_LOG2E * OCTAVE) ** 0.5
    reach, level, lost = look.reach
    for k, half in enumerate(halves):
        shape = half.shape
        conditional = dr.rsqrt(shape.yy)
        s11 = root * dr.sqrt(shape.yy / shape.determinant)
        s12 = -root * shape.xy * conditional / dr.sqrt(shape.determinant)
        s22 = root * conditional
        half_width, half_height = dr.sqrt(reach * shape.xx) / root, dr.sqrt(reach * shape.yy) / root
        turn = shape.xy / shape.xx * half_width
        shown = visible & dr.isfinite(s11 + s12 + s22) & (half_width >= 0) & (half_height >= 0)
        for middle, extent, size in zip(half.centre, (half_width, half_height), view.size, strict=True):
            shown &= (middle + extent > 0.5 - SLACK) & (middle - extent < size - (0.5 - SLACK))
        sizes = [half_height, turn, *half.edge]
        record = [*half.centre, s11, s12, s22, reach, *look.color, look.depth, level, lost, *sizes]
        place = dr.arange(types.UInt32, count) * len(halves) + k
        dr.scatter(records, types.ArrayXf(record), place)
        dr.scatter(keys, dr.select(shown, key, 0), place)
        dr.scatter(seen, shown, place)
    dr.eval(records, keys, seen)
    return Projected(records, keys, seen)


def _position(device: Device, view: Eye, offset: list[Array]) -> _Position:
    dr = device.dr
    right, up, back = view.axes
    x, y, depth = dot(dr, right, offset), dot(dr, up, offset), -dot(dr, back, offset)
    inverse = 1 / depth if view.perspective else device.types.Float(1)
    slopes = (x * inverse, y * inverse)
    pixel = (dr.fma(view.focal[0], slopes[0], view.center[0]), dr.fma(-view.focal[1], slopes[1], view.center[1]))
    return _Position(depth, inverse, slopes, pixel)


def _covariance(device: Device, cloud: Cloud, view: Eye, kernel: SplatKernel, at: _Position) -> Covariance:
    dr, low = device.dr, kernel.low_pass
    right, up, back = view.axes
    fx, fy = view.focal
    if view.perspective:  # rows of the projection's Jacobian in the world
        sx, sy = at.slopes
        if kernel.frustum_margin is not None:  # splats beside the frustum would blow up
            limits = view.slopes
            sx, sy = clamp(dr, sx, limits.left, limits.right), clamp(dr, sy, limits.bottom, limits.top)
        jx = [fx * at.inverse * dr.fma(sx, b, a) for a, b in zip(right, back, strict=True)]
        jy = [-fy * at.inverse * dr.fma(sy, b, a) for a, b in zip(up, back, strict=True)]
    else:
        jx, jy = [fx * a for a in right], [-fy * a for a in up]
    columns = [cloud.factors[i::3] for i in range(3)]
    mx, my = [dot(dr, jx, c) for c in columns], [dot(dr, jy, c) for c in columns]
    cross = [
        dr.fma(mx[1], my[2], -mx[2] * my[1]),
        dr.fma(mx[2], my[0], -mx[0] * my[2]),
        dr.fma(mx[0], my[1], -mx[1] * my[0]),
    ]
    xx, xy, yy, before = dot(dr, mx, mx), dot(dr, mx, my), dot(dr, my, my), dot(dr, cross, cross)
    determinant = before + dr.fma(low, xx + yy, low * low)  # xx yy - xy² would cancel for needles
    return Covariance(xx + low, xy, yy + low, determinant, before / determinant)


def _limited(device: Device, c: Covariance, most: float) -> tuple[Covariance, Array]:
    """Covariance with its eigenvalues clamped to `most`, and the larger eigenvalue before."""
    dr = device.dr
    limit = device.constant(most)
    middle, tilt = (c.xx + c.yy) * 0.5, (c.xx - c.yy) * 0.5
    radius = dr.sqrt(dr.fma(tilt, tilt, c.xy * c.xy))
    large = middle + radius
    small = c.determinant / large
    new_large = dr.select(large > limit, limit, large)
    new_small = dr.select(small > limit, limit, small)
    stretch = dr.select(radius > 0, (new_large - new_small) / (2 * radius), 0)
    keep = new_small - stretch * (middle - radius)
    over = large > limit
    limited = Covariance(
        xx=dr.select(over, dr.fma(stretch, c.xx, keep), c.xx),
        xy=dr.select(over, stretch * c.xy, c.xy),
        yy=dr.select(over, dr.fma(stretch, c.yy, keep), c.yy),
        determinant=dr.select(over, new_large * new_small, c.determinant),
        share=c.share,
    )
    return limited, large


def _reach(device: Device, kernel: SplatKernel, opacity: Array) -> tuple[Array, Array, Array]:
    """Where alpha meets the clip, in steps of OCTAVE below the centre's; and a record's SCALE and OFFSET."""
    dr, clip = device.dr, device.constant(kernel.alpha_clip)
    if not kernel.truncated:
        return OCTAVE * dr.log2(opacity / clip), clip, device.types.Float(0)
    lost = opacity * (E4 / (1 - E4))
    level = clip + lost
    return OCTAVE * dr.log2(opacity * (1 / (1 - E4)) / level), level, lost
