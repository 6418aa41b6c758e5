"""How the real-time engine draws beyond its kernel: splats ordered by buckets, quads on a grid of sub-pixels.

Sources: PlayCanvas 2.23 (its sort worker, `GSplatData.calcMortonOrder` and `calcAabb`, shader chunk gsplatCorner);
checked against its frames (tests/realtime). Neither belongs to the technique: a better engine would do without.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from mirelight.compositor.device import Array, Device
from mirelight.compositor.record import Covariance
from mirelight.model import F64, Camera, SplatCloud

SOFTWARE_BITS, HARDWARE_BITS = 4, 8  # of a pixel: what SwiftShader and graphics cards keep of a corner's place
_BINS = 32  # ranges of equal depth, each with its own number of buckets
_TIE = 2.0**-10  # less than any edge function but 0, on grids of up to 2^8 steps a pixel
_WEIGHTS = ((0, 40), (2, 20), (5, 8), (10, 3), (_BINS, 1))  # (most bins away from the camera's, share of the buckets)


@dataclass(frozen=True, slots=True, eq=False)
class EngineDrawing:
    """Two things that the engine does by the way. N splats."""

    rank: NDArray[np.uint32] | None = None  # (N,) each splat's place from front to back; None: by its exact distance
    subpixel_bits: int | None = None  # corners of quads are snapped to pixels / 2^bits; None: they are not


# --- order -----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class Loaded:
    """How the engine holds splats once it has loaded their file. N splats."""

    place: NDArray[np.int64]  # (N,) of each of the file's splats in the engine's own order
    corners: F64  # (8, 3) of the bounds that it takes for theirs, world space


def loaded_ply(splats: SplatCloud, world_from_file: F64 | None = None, *, reordered: bool = True) -> Loaded:
    """An uncompressed PLY file, which the engine reorders along a Morton curve.

    Args:
        splats: in the file's order and axes.
        world_from_file: (4, 4); None: the file is in world space.
        reordered: False: the file was loaded with `reorder: false`.
    """
    means = splats.means.astype(np.float64)
    if not len(means):
        return Loaded(np.zeros(0, dtype=np.int64), np.zeros((8, 3)))
    reach = 2.0 * splats.scales.max(axis=1, keepdims=True)
    corners = corners_of((means - reach).min(axis=0), (means + reach).max(axis=0), world_from_file)
    return Loaded(_morton_place(means) if reordered else np.arange(len(means)), corners)


def corners_of(low: F64, high: F64, world_from_file: F64 | None = None) -> F64:
    """(8, 3) the corners of a box of the file's axes, world space."""
    corners = np.array(list(product(*zip(low, high, strict=True))), dtype=np.float64)
    m = np.eye(4) if world_from_file is None else world_from_file
    return np.asarray(corners @ m[:3, :3].T + m[:3, 3])


def engine_rank(
    splats: SplatCloud, camera: Camera, *, radial: bool = False, loaded: Loaded | None = None
) -> NDArray[np.uint32]:
    """(N,) the place of each splat, front to back, in the order that the engine sorts them into.

    It sorts by counting: depths fall into buckets, finer near the camera, and what shares one is blended in the order
    in which it holds them, the first in front.

    Args:
        splats: in the file's order; world space.
        camera: perspective.
        radial: by distance to the eye instead of depth.
        loaded: how the engine holds them; None: as of an uncompressed PLY file of this cloud.
    """
    count = len(splats)
    if not count:
        return np.zeros(0, dtype=np.uint32)
    held = loaded_ply(splats) if loaded is None else loaded
    means, corners = splats.means.astype(np.float64), held.corners
    if radial:
        far = float(np.linalg.norm(corners - camera.position, axis=1).max())
        keys = bucket_keys(far - np.linalg.norm(means - camera.position, axis=1), far, _BINS - 1)
    else:
        back = camera.world_from_camera[:3, 2]
        ends = (corners - camera.position) @ back
        low, span = float(ends.min()), float(np.ptp(ends))
        camera_bin = int(np.clip(np.floor(-low / span * _BINS), 0, _BINS - 1)) if span > 0 else 0
        keys = bucket_keys((means - camera.position) @ back - low, span, camera_bin)
    order = np.lexsort((held.place, -keys))
    rank = np.empty(count, dtype=np.uint32)
    rank[order] = np.arange(count, dtype=np.uint32)
    return rank


def bucket_keys(place: F64, span: float, camera_bin: int) -> NDArray[np.int64]:
    """The sort keys of the engine's worker, ascending towards the eye.

    Args:
        place: (N,) from the far end of the cloud's bounds towards the eye.
        span: how long the bounds are.
        camera_bin: the bin that the camera is in.
    """
    buckets = 2 ** int(np.clip(np.floor(np.log2(len(place) / 4) + 0.5), 10, 20)) + 1
    away = np.abs(np.arange(_BINS) - camera_bin)
    weights = np.array([next(weight for most, weight in _WEIGHTS if a <= most) for a in away])
    sizes = np.maximum(1, np.floor(weights / weights.sum() * buckets))
    starts = np.concatenate([[0], np.cumsum(sizes)[:-1]])
    at = place * (_BINS / span) if span > 0 else np.zeros(len(place))
    bins = np.clip(np.floor(at).astype(np.int64), 0, _BINS - 1)
    return np.asarray(np.floor(starts[bins] + sizes[bins] * (at - bins)).astype(np.int64))


def _morton_place(means: F64) -> NDArray[np.int64]:
    """(N,) each splat's place once the file is reordered along a Morton curve of 1024 cells an axis."""
    low, high = means.min(axis=0), means.max(axis=0)
    span = high - low
    cells = np.where(span > 0, 1024 / np.where(span > 0, span, 1), 0)
    cell = np.minimum(1023, np.floor((means - low) * cells)).astype(np.int64)
    code = np.zeros(len(means), dtype=np.int64)
    for bit in range(10):
        for axis in range(3):
            code |= ((cell[:, axis] >> bit) & 1) << (3 * bit + axis)
    place = np.empty(len(means), dtype=np.int64)
    place[np.argsort(code, kind="stable")] = np.arange(len(means))
    return place


# --- corners ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class Half:
    """One of the two triangles of every quad."""

    centre: tuple[Array, Array]  # where the splat's own centre comes to lie, px
    shape: Covariance  # of the splat as that triangle shows it
    edge: tuple[Array, Array]  # gradient of the function of the common edge, in steps of the grid: positive inside, 0
    # at the splat's centre, which lies on half steps, so that it is exact at the centres of pixels


def snapped_halves(
    device: Device, centre: tuple[Array, Array], shape: Covariance, opacity: Array, clip: Array, bits: int
) -> tuple[Half, Half]:
    """Both triangles of quads whose corners are snapped to pixels / 2^bits: what lies on them moves along.

    A quad has corners (±1, ±1) times the half axes of the ellipse where the kernel ends, shrunk to where alpha meets
    the clip; its triangles are (0, 1, 2) and (0, 2, 3).
    """
    dr, types = device.dr, device.types
    grid = 2.0**bits
    middle, tilt = (shape.xx + shape.yy) * 0.5, (shape.xx - shape.yy) * 0.5
    radius = dr.sqrt(dr.fma(tilt, tilt, shape.xy * shape.xy))
    large = middle + radius
    small = shape.determinant / large
    ax, ay = -shape.xy, large - shape.xx  # the longer axis, y up
    length2 = dr.fma(ax, ax, ay * ay)
    known = length2 > 0
    scale = dr.rsqrt(dr.select(known, length2, 1))
    ax, ay = dr.select(known, ax * scale, 1), dr.select(known, ay * scale, 0)
    shrink = dr.sqrt(dr.log(opacity / clip)) * 0.5
    shrink = dr.select(shrink < 1, shrink, types.Float(1))
    first, second = shrink * dr.sqrt(8 * large), shrink * dr.sqrt(8 * small)
    v1, v2 = (ax * first, -ay * first), (ay * second, ax * second)  # y down

    def corner(along: float, across: float) -> tuple[Array, Array]:
        x, y = (c + along * a + across * b for c, a, b in zip(centre, v1, v2, strict=True))
        return dr.round(x * grid) * (1 / grid), dr.round(y * grid) * (1 / grid)

    s0, s1, s2, s3 = corner(-1, -1), corner(1, -1), corner(1, 1), corner(-1, 1)
    where = ((s0[0] + s2[0]) * 0.5, (s0[1] + s2[1]) * 0.5)
    across = ((s0[1] - s2[1]) * grid, (s2[0] - s0[0]) * grid)  # gradient across the common edge

    def half(ends: tuple[tuple[Array, Array], ...], third: tuple[Array, Array]) -> Half:
        (a, b), (c, d) = ends[:2], ends[2:]
        one, two = ([(p - q) / (2 * shrink) for p, q in zip(*pair, strict=True)] for pair in ((b, a), (d, c)))
        area = dr.fma(one[0], two[1], -one[1] * two[0])
        side = across[0] * (third[0] - where[0]) + across[1] * (third[1] - where[1])
        sign = dr.select(side < 0, types.Float(-1), types.Float(1))
        spread = Covariance(
            xx=dr.fma(one[0], one[0], two[0] * two[0]) / 8,
            xy=dr.fma(one[0], one[1], two[0] * two[1]) / 8,
            yy=dr.fma(one[1], one[1], two[1] * two[1]) / 8,
            determinant=area * area / 64,
            share=shape.share,
        )
        return Half(where, spread, (across[0] * sign, across[1] * sign))

    return half((s0, s1, s1, s2), s1), half((s3, s2, s0, s3), s3)


def edge_function(device: Device, edge: tuple[Array, Array], dx: Array, dy: Array) -> Array:
    """The edge function at an offset from the centre, moved so that a point is inside where it is above 0.

    A centre of a pixel that lies on the edge belongs to the triangle at its right or, under a level edge, below.
    """
    dr = device.dr
    owns = (edge[0] > 0) | ((edge[0] == 0) & (edge[1] > 0))
    return dr.fma(edge[0], dx, dr.fma(edge[1], dy, dr.select(owns, device.types.Float(_TIE), 0)))
