"""Light between cells of a surface, on the device: rays that say where light comes from, and sums along them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from mirelight.lighting.kernel.cell_points import CellPoints
from mirelight.lighting.kernel.cells import DeviceCells
from mirelight.lighting.kernel.memory import integers
from mirelight.lighting.kernel.proxy import DeviceProxy, Point
from mirelight.lighting.kernel.samples import mix, number, pair
from mirelight.lighting.kernel.sky import Sky
from mirelight.lighting.kernel.types import Bool, Float, UInt32, Vector3f
from mirelight.model import F32
from mirelight.model.surface_cache import LOST, NOTHING, SKY

LANES = 1 << 21
STEPS = 1023  # of a channel of albedo


def _leaves(
    surface: DeviceProxy, points: CellPoints, pixel: UInt32, sample: UInt32, half: UInt32, seed: UInt32, active: Bool
) -> tuple[Point, Vector3f, UInt32]:
    """(place, direction, numbers for what follows) of a cell's reflected ray: the same whenever it is asked for."""
    stream = mix(mix(pixel, seed), half)
    _, face, uv, d, *_ = points.first_hit(surface, pixel, sample, stream)
    at = surface.at(face, uv, d, active)
    way = mi.warp.square_to_cosine_hemisphere(pair(sample, mix(stream, 3)))
    return at, mi.Frame3f(at.normal).to_world(way), mix(stream, 5)


def cast(
    surface: DeviceProxy, cells: DeviceCells, points: CellPoints, seed: int, first: int, count: int, samples: int
) -> tuple[NDArray[np.uint32], NDArray[np.uint32], F32]:
    """Reflected rays of `count` points from the `first` on, `samples` of each in two halves; point by point.

    Returns:
        (2, n) where each ray ends, a cell, SKY, NOTHING, or LOST on a place without a cell, and the albedo there,
        packed; (n,) the face; (n, 5) the place's barycentric coordinates, and the ray's direction.
    """
    lane = dr.arange(mi.UInt32, count * samples)
    each, half_of = dr.opaque(mi.UInt32, samples), dr.opaque(mi.UInt32, max(samples // 2, 1))
    pixel = lane // each
    sample = lane - pixel * each
    pixel += dr.opaque(mi.UInt32, first)
    half = sample // half_of
    sample -= half * half_of
    start, d, salt = _leaves(surface, points, pixel, sample, half, mi.UInt32(dr.opaque(mi.UInt32, seed)), mi.Bool(True))
    found = surface.nearest(mi.Ray3f(start.start, d), mi.Bool(True))
    hit = mi.Bool(found.is_valid())
    face, uv = mi.UInt32(found.prim_index), mi.Point2f(found.prim_uv)
    at = surface.at(face, uv, d, hit)
    cell, there = cells.find(surface, at, pair(sample, mix(salt, 7)), hit)
    target = dr.select(there, cell, dr.select(hit, mi.UInt32(LOST), mi.UInt32(SKY)))
    target = dr.select(hit & (dr.max(at.albedo) <= 0), mi.UInt32(NOTHING), target)
    albedo = _packed(at.albedo, sample, salt)
    dr.eval(target, albedo, face, uv, d)
    where = np.stack([x.numpy() for x in (uv.x, uv.y, d.x, d.y, d.z)], axis=1)
    return np.stack([target.numpy(), albedo.numpy()]), face.numpy(), where


def _packed(albedo: Vector3f, sample: UInt32, salt: UInt32) -> UInt32:
    """Ten bits a channel, rounded up as often as it takes for the mean to be right."""
    r, g, b = (
        dr.minimum(mi.UInt32(x * STEPS + number(sample, mix(salt, 20 + k))), STEPS)
        for k, x in enumerate((albedo.x, albedo.y, albedo.z))
    )
    return (r << 20) | (g << 10) | b


def _albedo(packed: UInt32) -> Vector3f:
    scale = 1 / STEPS
    return mi.Vector3f(*(mi.Float((packed >> k) & STEPS) * scale for k in (20, 10, 0)))


class _Half(NamedTuple):
    """Rays of half the samples from a point; see `lamps._Given`."""

    count: UInt32  # points
    samples: UInt32
    half: UInt32
    point: UInt32
    seed: UInt32


class _Gathered(NamedTuple):
    """A node's layer whose light is gathered."""

    count: UInt32  # points
    rows: UInt32  # nodes
    layers: UInt32
    point: UInt32
    layer: UInt32
    end: UInt32
    values: Float  # of all nodes


class DeviceLinks:
    """Ends of the rays of n points, `samples` of each.

    Args:
        target: (samples, n) a node, SKY or NOTHING.
        albedo: (samples, n) packed.
    """

    def __init__(self, target: NDArray[np.uint32], albedo: NDArray[np.uint32]) -> None:
        self.samples, self.count = target.shape
        self.target, self.albedo = integers(target), integers(albedo)

    @dr.syntax
    def first_bounce(self, surface: DeviceProxy, points: CellPoints, sky: Sky, seed: int) -> F32:
        """(2, n, 3) irradiance / pi that the rays that meet the sky bring of it, in each half: what sampling its map
        leaves to them."""
        n, of_half = dr.opaque(mi.UInt32, self.count), dr.opaque(mi.UInt32, self.samples // 2)
        number_of = mi.UInt32(dr.opaque(mi.UInt32, seed))
        half = dr.arange(mi.UInt32, 2 * self.count) // n
        of = _Half(n, of_half, half, dr.arange(mi.UInt32, 2 * self.count) - half * n, number_of)
        total: Vector3f = mi.Vector3f(0)
        sample = mi.UInt32(0)
        while sample < of.samples:
            target = dr.gather(mi.UInt32, self.target, (of.half * of.samples + sample) * of.count + of.point)
            if target == SKY:
                at, d, _ = _leaves(surface, points, of.point, sample, of.half, of.seed, mi.Bool(True))
                reflected = dr.maximum(dr.dot(d, at.normal), 0) * dr.inv_pi
                mapped = sky.pdf(d, mi.Bool(True))
                share = dr.select(mapped > 0, reflected / (reflected + mapped), 1)
                total += sky.radiance(d, mi.Bool(True)) * share
            sample += 1
        total = total * dr.opaque(mi.Float, 2 / self.samples)
        dr.eval(total)
        return np.stack([total.x.numpy(), total.y.numpy(), total.z.numpy()], axis=1).reshape(2, -1, 3)


def bounced(
    values: Float, own: Float, layers: int, nodes: int, parts: Sequence[tuple[DeviceLinks, int, int, int]]
) -> Float:
    """(nodes, layers, 4) each node's own light, and what its rays bring of the others' (nodes, layers, 4).

    Layers of a node lie side by side, so that a ray's end is looked up once for all of them.

    Args:
        values: of all nodes.
        own: of all nodes.
        layers, nodes: how many.
        parts: rays, the first node that they belong to, and which of them: the first and how many.
    """
    out = own + 0
    dr.eval(out)
    for links, place, first, samples in parts:
        if links.count:
            _gather(out, links, values, layers, nodes, place, first, samples)
    return out


@dr.syntax
def _gather(
    out: Float, links: DeviceLinks, values: Float, layers: int, nodes: int, place: int, first: int, samples: int
) -> None:
    n, rows = dr.opaque(mi.UInt32, links.count), dr.opaque(mi.UInt32, nodes)
    of_node = dr.opaque(mi.UInt32, layers)
    lane = dr.arange(mi.UInt32, layers * links.count)
    point = lane // of_node
    layer = lane - point * of_node
    of = _Gathered(n, rows, of_node, point, layer, dr.opaque(mi.UInt32, first + samples), values)
    sample = mi.UInt32(dr.opaque(mi.UInt32, first))
    total: Vector3f = mi.Vector3f(0)
    while sample < of.end:
        ray = sample * of.count + of.point
        target = dr.gather(mi.UInt32, links.target, ray)
        there = target < of.rows
        albedo = _albedo(dr.gather(mi.UInt32, links.albedo, ray))
        q = dr.gather(mi.Vector4f, of.values, target * of.layers + of.layer, there)
        total += dr.select(there, albedo * mi.Vector3f(q.x, q.y, q.z), 0)
        sample += 1
    total = total * dr.opaque(mi.Float, 1 / samples)
    node = (dr.opaque(mi.UInt32, place) + point) * of_node + layer
    for k, value in enumerate((total.x, total.y, total.z)):
        dr.scatter_reduce(dr.ReduceOp.Add, out, value, node * 4 + k, mode=dr.ReduceMode.NoConflicts)
    dr.eval(out)
