"""The compositor's oracle: plain NumPy in float64, one splat after another, written to be read.

Slow (about 40 µs a splat) and exact: the Dr.Jit compositor is tested against it, in both profiles.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial import Legendre
from numpy.typing import NDArray

from mirelight.compositor.kernel import E4, SplatKernel, slope_limits, splat_kernel
from mirelight.compositor.resolve import decoded
from mirelight.compositor.source import colors_of, factors_of, shape_of
from mirelight.model import F32, F64, Camera, CompositorSettings, SplatCloud, SplatLayer

DEFAULT = CompositorSettings()


@dataclass(frozen=True, slots=True, eq=False)
class Footprints:
    """Splats on the image, front to back. n splats."""

    index: NDArray[np.int64]  # (n,) into the cloud
    center: F64  # (n, 2) px
    variance: F64  # (n, 3) px²: xx, xy, yy with the low-pass, y down
    opacity: F64  # (n,) with the compensation of antialiased clouds
    depth: F64  # (n,) along the view axis, world units


def composite(splats: SplatCloud, camera: Camera, settings: CompositorSettings = DEFAULT) -> SplatLayer:
    """Front-to-back EWA splatting (Zwicker et al. 2001) by the conventions of `settings.profile`."""
    settings = replace(settings, color_space=splats.color_space)
    color, transmittance, depth, median = _blend(
        project(splats, camera, settings), splat_colors(splats, camera, settings), camera, settings
    )
    if settings.rounds:
        color = _blend_eight_bit(
            project(splats, camera, settings), splat_colors(splats, camera, settings), camera, settings
        )
    return SplatLayer(
        camera=camera,
        color=decoded(color.astype(np.float32), transmittance.astype(np.float32), settings),
        transmittance=transmittance.astype(np.float32),
        depth=depth.astype(np.float32),
        median_depth=median.astype(np.float32),
        profile=settings.profile,
        linear=settings.holds_light,
    )


def composite_channels(
    splats: SplatCloud, camera: Camera, channels: F32, settings: CompositorSettings = DEFAULT
) -> F64:
    """(H, W, C) blend of any per-splat values (N, C) with the weights that colours get."""
    return _blend(project(splats, camera, settings), channels, camera, settings)[0]


def view_points(splats: SplatCloud, camera: Camera) -> F64:
    """(N, 3) centres in camera space (x right, y up, z < 0 in front)."""
    offset = splats.means.astype(np.float64) - camera.position
    return np.asarray(offset @ camera.world_from_camera[:3, :3])


def splat_colors(splats: SplatCloud, camera: Camera, settings: CompositorSettings) -> F64:
    """(N, 3) colours as they are blended, seen from the camera."""
    return colors_of(_evaluated(splats, camera), settings).astype(np.float64)


def _evaluated(splats: SplatCloud, camera: Camera) -> F64:
    """(N, 3) ``0.5 + Σ sh Y``, display-encoded."""
    if camera.projection == "orthographic":
        directions = np.broadcast_to(-camera.world_from_camera[:3, 2], splats.means.shape)
    else:
        offset = splats.means.astype(np.float64) - camera.position
        directions = offset / np.maximum(np.linalg.norm(offset, axis=1, keepdims=True), 1e-30)
    values = harmonics(np.asarray(directions, dtype=np.float64), splats.sh_degree)
    return np.asarray(0.5 + np.einsum("nk,nkc->nc", values, splats.sh.astype(np.float64)))


def harmonics(directions: F64, degree: int) -> F64:
    """(..., (degree + 1)²) real spherical harmonics by their definition, apart from the polynomials of
    `mirelight.base.sh`.

    Y_lm = (-1)^m sqrt((2l + 1) (l - m)! / (2π (l + m)!)) dᵐP_l(z)/dzᵐ · Re or Im (x + iy)ᵐ, without the 2 at m = 0.
    """
    x, y, z = np.moveaxis(directions, -1, 0)
    out = []
    for band in range(degree + 1):
        legendre = Legendre.basis(band)
        for order in range(-band, band + 1):
            m = abs(order)
            around = (x + 1j * y) ** m
            size = (2 * band + 1) * math.factorial(band - m) / (math.factorial(band + m) * (2 if m else 4) * math.pi)
            slope = (legendre.deriv(m) if m else legendre)(z)
            out.append((-1) ** m * math.sqrt(size) * slope * (around.imag if order < 0 else around.real))
    return np.stack(out, axis=-1)


def project(splats: SplatCloud, camera: Camera, settings: CompositorSettings) -> Footprints:
    """Culled, projected and sorted splats."""
    kernel = splat_kernel(settings, camera)
    quats, scales, opacities = shape_of(splats, settings)
    with np.errstate(all="ignore"):  # what overflows or divides by zero is dropped below
        view = view_points(splats, camera)
        w = -view[:, 2]
        perspective = camera.projection == "perspective"
        along = w if perspective else np.ones_like(w)
        center = np.stack(
            [camera.cx + camera.fx * view[:, 0] / along, camera.cy - camera.fy * view[:, 1] / along], axis=1
        )

        # Rows of the Jacobian of the projection, in the world: cov = (J F)(J F)ᵀ + low-pass
        right, up, back = camera.world_from_camera[:3, :3].T
        limits = slope_limits(kernel, camera)
        sx = np.clip(view[:, 0] / w, limits.left, limits.right) if perspective else np.zeros_like(w)
        sy = np.clip(view[:, 1] / w, limits.bottom, limits.top) if perspective else np.zeros_like(w)
        jx = camera.fx / along[:, None] * (right + sx[:, None] * back)
        jy = -camera.fy / along[:, None] * (up + sy[:, None] * back)
        factors = factors_of(quats, scales)
        mx, my = np.einsum("ni,nij->nj", jx, factors), np.einsum("ni,nij->nj", jy, factors)

        xx, xy, yy = (np.sum(a * b, axis=1) for a, b in ((mx, mx), (mx, my), (my, my)))
        opacity = opacities.astype(np.float64)
        if splats.antialiased:
            before = np.maximum(xx * yy - xy * xy, 0)
            after = (xx + kernel.low_pass) * (yy + kernel.low_pass) - xy * xy
            opacity = opacity * np.sqrt(np.maximum(before / after, kernel.least_compensation))
        variance = np.stack([xx + kernel.low_pass, xy, yy + kernel.low_pass], axis=1)
        largest = _eigenvalues(variance)[0]
        variance = _limit(variance, kernel.max_variance)
        key = np.linalg.norm(view, axis=1) if settings.sort == "radial" else w

        keep = np.isfinite(_evaluated(splats, camera)).all(axis=1)
        keep &= np.isfinite(center).all(axis=1) & np.isfinite(variance).all(axis=1)
        keep &= (w > camera.near) & (w < camera.far) if kernel.clips_depth else w > 0
        keep &= (opacity >= kernel.alpha_clip) & (opacity > 0) & (largest >= kernel.min_variance)
    kept = np.flatnonzero(keep)
    order = kept[np.argsort(key[kept].astype(np.float32), kind="stable")]
    return Footprints(order, center[order], variance[order], opacity[order], w[order])


def _eigenvalues(variance: F64) -> tuple[F64, F64]:
    """Larger and smaller eigenvalue of each (xx, xy, yy)."""
    xx, xy, yy = variance.T
    mid, radius = (xx + yy) / 2, np.hypot((xx - yy) / 2, xy)
    return mid + radius, mid - radius


def _limit(variance: F64, most: float) -> F64:
    """Variances with their eigenvalues clamped to `most`."""
    large, small = _eigenvalues(variance)
    gap = large - small
    stretch = np.where(gap > 0, (np.minimum(large, most) - np.minimum(small, most)) / gap, 0)
    keep = np.minimum(small, most) - stretch * small
    limited = variance * stretch[:, None] + np.stack([keep, np.zeros_like(keep), keep], axis=1)
    return np.where((large > most)[:, None], limited, variance)


def _fragments(f: Footprints, i: int, kernel: SplatKernel, camera: Camera) -> tuple[slice, slice, F64] | None:
    """Rows, columns and alphas (0 where dropped) of splat i, or None where it misses the image."""
    xx, xy, yy = f.variance[i]
    x, y = f.center[i]
    reach = 2 * np.log(max(f.opacity[i] / kernel.alpha_clip, 1.0))
    if kernel.truncated:
        reach = min(reach, 8.0)
    rx, ry = np.sqrt(reach * xx), np.sqrt(reach * yy)
    x0, x1 = max(0, int(np.floor(x - rx))), min(camera.width, int(np.ceil(min(x + rx, 1e9))) + 1)
    y0, y1 = max(0, int(np.floor(y - ry))), min(camera.height, int(np.ceil(min(y + ry, 1e9))) + 1)
    if x0 >= x1 or y0 >= y1:
        return None
    dx, dy = np.arange(x0, x1) + 0.5 - x, np.arange(y0, y1)[:, None] + 0.5 - y
    distance = (yy * dx * dx - 2 * xy * dx * dy + xx * dy * dy) / (xx * yy - xy * xy)
    fall = np.exp(-0.5 * distance)
    if kernel.truncated:
        fall = (fall - E4) / (1 - E4)
    alpha = np.minimum(f.opacity[i] * fall, kernel.alpha_max)
    kept = (alpha >= kernel.alpha_clip) & (alpha > 0)
    if kernel.cutoff is not None:
        kept &= distance < kernel.cutoff**2
    return slice(y0, y1), slice(x0, x1), np.where(kept, alpha, 0)


def _blend(f: Footprints, values: F64 | F32, camera: Camera, settings: CompositorSettings) -> tuple[F64, F64, F64, F64]:
    """Premultiplied values (H, W, C), transmittance, mean and median depth (H, W)."""
    kernel = splat_kernel(settings, camera)
    size = (camera.height, camera.width)
    out = np.zeros((*size, values.shape[1]))
    transmittance, weights, depths, median = np.ones(size), np.zeros(size), np.zeros(size), np.zeros(size)
    alive = np.ones(size, dtype=bool)
    for i in range(len(f.index)):
        hit = _fragments(f, i, kernel, camera)
        if hit is None:
            continue
        rows, columns, alpha = hit
        here = transmittance[rows, columns]
        alpha = np.where(alive[rows, columns], alpha, 0)
        left = here * (1 - alpha)
        if kernel.stop is not None:
            ends = (alpha > 0) & (left < kernel.stop)
            alive[rows, columns] &= ~ends
            alpha, left = np.where(ends, 0, alpha), np.where(ends, here, left)
        weight = alpha * here
        out[rows, columns] += weight[..., None] * values[f.index[i]]
        weights[rows, columns] += weight
        depths[rows, columns] += weight * f.depth[i]
        median[rows, columns] = np.where((here > 0.5) & (left <= 0.5), f.depth[i], median[rows, columns])
        transmittance[rows, columns] = left
    mean = np.divide(depths, weights, out=np.zeros(size), where=weights > 0)
    return out, transmittance, mean, median


def _blend_eight_bit(f: Footprints, values: F64, camera: Camera, settings: CompositorSettings) -> F64:
    """Premultiplied colour as an RGBA8 target holds it: back to front, clamped and rounded after every splat."""
    kernel = splat_kernel(settings, camera)
    out = np.zeros((camera.height, camera.width, 3))
    for i in reversed(range(len(f.index))):
        hit = _fragments(f, i, kernel, camera)
        if hit is None:
            continue
        rows, columns, alpha = hit
        a = alpha[..., None]
        over = np.clip(a * values[f.index[i]], 0, 1) + out[rows, columns] * (1 - a)
        rounded = np.floor(np.clip(over, 0, 1) * 255 + 0.5) / 255
        out[rows, columns] = np.where(a > 0, rounded, out[rows, columns])
    return out
