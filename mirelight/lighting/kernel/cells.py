"""Light on the surface, on the device: which cell a point lies in, what that cell holds, and how cells are found."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from mirelight.lighting.kernel.film import Film, PathSums
from mirelight.lighting.kernel.memory import floats, in_fours, integers, rgb
from mirelight.lighting.kernel.proxy import DeviceProxy, Point
from mirelight.lighting.kernel.rays import bounded_ray, vector
from mirelight.lighting.kernel.samples import mix, pair
from mirelight.lighting.kernel.sky_guiding import Spread
from mirelight.lighting.kernel.types import Bool, Float, Point2f, Point3f, Ray3f, UInt32, Vector3f
from mirelight.lighting.kernel.vertex import Vertex
from mirelight.model import F32, F64, I32, SurfaceCells

if TYPE_CHECKING:
    from numpy.typing import NDArray

LIFT = 0.05  # of a cell's edge: how far above the surface points of a cell look for each other


class Grid:
    """The voxels: which key a point of the surface has."""

    def __init__(self, origin: F64, size: float) -> None:
        self.origin, self.size = vector(origin), dr.opaque(mi.Float, size)

    def key(self, p: Vector3f, facing: Vector3f) -> tuple[UInt32, UInt32]:
        """(y << 16 | x, direction << 16 | z) of a point whose surface faces that way; p within 2^16 voxels."""
        x, y, z = (mi.UInt32(dr.clip(q, 0, 65535)) for q in (p - self.origin) / self.size)
        a = abs(facing)
        axis = dr.select((a.x >= a.y) & (a.x >= a.z), mi.UInt32(0), dr.select(a.y >= a.z, mi.UInt32(1), mi.UInt32(2)))
        along = dr.select(axis == 0, facing.x, dr.select(axis == 1, facing.y, facing.z))
        direction = 2 * axis + dr.select(along < 0, mi.UInt32(1), mi.UInt32(0))
        return (y << 16) | x, (direction << 16) | z

    def above(self, surface: DeviceProxy, at: Point, active: Bool) -> Point3f:
        """The place from which a point looks at its cell's anchor: a little above it, below whatever is there."""
        lift = LIFT * self.size
        found = surface.nearest(bounded_ray(at.start, at.geometric_normal, lift), active)
        return at.start + at.geometric_normal * dr.select(found.is_valid(), 0.5 * found.t, lift)


def between(start: Point3f, end: Vector3f) -> Ray3f:
    """The ray from one place to another, without its ends."""
    return bounded_ray(start, end - mi.Vector3f(start), mi.Float(1 - 2.0**-10))


class _Sought(NamedTuple):
    """A point whose cell is sought; see `lamps._Given`."""

    active: Bool
    eye: Point3f  # a little above it


class _Bucket(NamedTuple):
    """Where cells of one key lie."""

    a: UInt32
    b: UInt32
    end: UInt32


class _Around(NamedTuple):
    """What a place looks around with."""

    lane: UInt32
    count: UInt32  # rays
    reach: Float  # beyond which a hit is far


class _Read(NamedTuple):
    """A cell whose light is read."""

    held: Float  # of all cells
    cell: UInt32
    read: Bool
    scale: Vector3f


class DeviceCells:
    """Cells with light, to be read in place of tracing on: at a path's first hit what is not sampled there, later all.

    Args:
        cells: C of them.
        whole: (K, C, 3) irradiance / pi of each of a film's layers, direct and indirect.
        indirect: (K, C, 3) after one reflection and more.
        first_bounce: (2, C, 3) what a reflected ray meets at once: of the environment, of surfaces that glow.
        doubt: (K, C, 3) half the difference of two fills, of what is read.
        nearest: later hits nearer than this to the one before are not read.
        spread: how light samples of the sky are spread at first hits.
    """

    def __init__(
        self,
        cells: SurfaceCells,
        whole: F32,
        indirect: F32,
        first_bounce: F32,
        doubt: F32 | None,
        *,
        nearest: float,
        spread: Spread,
    ) -> None:
        self.spread = spread
        self.grid = Grid(cells.origin, cells.size)
        self.doubtful = doubt is not None
        self.nearest = dr.opaque(mi.Float, nearest)
        self.keys = integers(np.append(cells.keys.ravel(), np.zeros(2, np.uint32)))
        self.anchors = in_fours(cells.anchors)
        self.starts = integers(np.append(cells.starts, np.zeros(2, np.uint32)))
        self.mask = dr.opaque(mi.UInt32, len(cells.starts) - 2)
        self.count = dr.opaque(mi.UInt32, len(cells))
        self.layers = dr.opaque(mi.UInt32, len(whole))
        self.whole, self.indirect = in_fours(whole), in_fours(indirect)
        self.first_bounce = in_fours(first_bounce)
        self.doubt = in_fours(doubt if doubt is not None else np.zeros((1, 1, 3), np.float32))

    @dr.syntax
    def find(self, surface: DeviceProxy, at: Point, u: Point2f, active: Bool) -> tuple[UInt32, Bool]:
        """(cell, whether there is one): of a point near by in the tangent plane, else of the point itself.

        The shift by up to half a cell blends neighbouring cells; a wall between ends it.
        """
        s, t = mi.coordinate_system(at.geometric_normal)
        shifted = mi.Vector3f(at.p) + (s * (u.x - 0.5) + t * (u.y - 0.5)) * self.grid.size
        cell, found = mi.UInt32(0), mi.Bool(False)
        tries = mi.UInt32(0)
        place = mi.Vector3f(shifted)
        of = _Sought(active, self.grid.above(surface, at, active))
        while of.active & ~found & (tries < 2):
            a, b = self.grid.key(place, at.geometric_normal)
            bucket = mix(a, b) & self.mask
            entry = dr.gather(mi.UInt32, self.starts, bucket)
            there = _Bucket(a, b, dr.gather(mi.UInt32, self.starts, bucket + 1))
            while ~found & (entry < there.end):
                same = (dr.gather(mi.UInt32, self.keys, entry * 2) == there.a) & (
                    dr.gather(mi.UInt32, self.keys, entry * 2 + 1) == there.b
                )
                if same:
                    q = dr.gather(mi.Vector4f, self.anchors, entry)
                    found = ~surface.blocked(between(of.eye, mi.Vector3f(q.x, q.y, q.z)), mi.Bool(True))
                    cell = dr.select(found, entry, cell)
                entry += 1
            place = mi.Vector3f(at.p)
            tries += 1
        return cell, found & active

    def add_whole(self, film: Film, sums: PathSums, vertex: Vertex, cell: UInt32, read: Bool) -> PathSums:
        """All light of a later hit's cell, to every layer."""
        return self._add_layers(self.whole, film, sums, vertex, cell, read)

    def add_rest(self, film: Film, sums: PathSums, vertex: Vertex, cell: UInt32, read: Bool) -> PathSums:
        """The indirect light of a first hit's cell, to every layer, and what its reflected ray would have met."""
        sums = self._add_layers(self.indirect, film, sums, vertex, cell, read)
        scale, direct = vertex.throughput * vertex.albedo, mi.Bool(False)
        sky = scale * rgb(self.first_bounce, cell, read)
        sums = film.add_light(sums, vertex.place, film.sky_layer, direct, sky, read)
        glow = scale * rgb(self.first_bounce, self.count + cell, read)
        return film.add_light(sums, vertex.place, film.glow_layer, direct, glow, read)

    @dr.syntax
    def _add_layers(
        self, held: Float, film: Film, sums: PathSums, vertex: Vertex, cell: UInt32, read: Bool
    ) -> PathSums:
        """What a cell holds of every layer, as indirect light, and the doubt about it."""
        layer, of = mi.UInt32(0), _Read(held, cell, read, vertex.throughput * vertex.albedo)
        while of.read & (layer < self.layers):
            value = of.scale * rgb(of.held, layer * self.count + of.cell, of.read)
            sums = film.add_light(sums, vertex.place, layer, mi.Bool(True), value, of.read)
            if dr.hint(self.doubtful, mode="scalar"):
                doubt = of.scale * rgb(self.doubt, layer * self.count + of.cell, of.read)
                film.add_doubt(vertex.spot, layer, doubt, of.read)
            layer += 1
        return sums


@dr.syntax
def look(
    surface: DeviceProxy, faces: I32, corners: F32, normals: F32, grid: Grid, rays: int, far: float
) -> tuple[NDArray[np.uint32], F32, NDArray[np.uint32]]:
    """Places of the surface as one of its sides has them, and what is seen from there along some rays.

    Args:
        surface: the proxy.
        faces: (n,) of the places.
        corners: (n, 2) barycentric coordinates.
        normals: (n, 3) of the faces, by their winding or against it: the side.
        grid: the voxels.
        rays: of each place.
        far: world units.

    Returns:
        (n, 2) key; (n, 3) the place above it; (n, 3) how many rays meet the front of a face, go farther than `far` to
        one, and meet none.
    """
    lane, count = dr.arange(mi.UInt32, len(faces)), dr.opaque(mi.UInt32, rays)
    face, (u, v) = integers(faces), (floats(corners[:, k]) for k in range(2))
    side, reach = in_fours(normals), dr.opaque(mi.Float, far)
    at = surface.at(face, mi.Point2f(u, v), -rgb(side, lane, mi.Bool(True)), mi.Bool(True))
    key, above = grid.key(mi.Vector3f(at.p), at.geometric_normal), grid.above(surface, at, mi.Bool(True))
    fronts, distant, outside = mi.UInt32(0), mi.UInt32(0), mi.UInt32(0)
    number, of = mi.UInt32(0), _Around(lane, count, reach)
    while number < of.count:
        local = mi.warp.square_to_cosine_hemisphere(pair(number, mix(of.lane, 77)))
        d = mi.Frame3f(at.geometric_normal).to_world(local)
        found = surface.nearest(mi.Ray3f(at.start, d), mi.Bool(True))
        hit = mi.Bool(found.is_valid())
        fronts += dr.select(hit & surface.shows_front(mi.UInt32(found.prim_index), d, hit), mi.UInt32(1), mi.UInt32(0))
        distant += dr.select(hit & (found.t > of.reach), mi.UInt32(1), mi.UInt32(0))
        outside += dr.select(hit, mi.UInt32(0), mi.UInt32(1))
        number += 1
    dr.eval(key, above, fronts, distant, outside)
    columns = (*key, fronts, distant, outside)
    rows = np.stack([np.asarray(x.numpy()) for x in columns], axis=1).astype(np.uint32)
    places = np.stack([np.asarray(x.numpy()) for x in (above.x, above.y, above.z)], axis=1)
    return rows[:, :2], places.astype(np.float32), rows[:, 2:]


def hidden(surface: DeviceProxy, starts: F32, ends: F32) -> NDArray[np.bool_]:
    """(n,) whether something lies between places (n, 3) and others (n, 3)."""
    a, b = (mi.Point3f(*(floats(x[:, k]) for k in range(3))) for x in (starts, ends))
    return np.asarray(surface.blocked(between(a, mi.Vector3f(b)), mi.Bool(True)).numpy(), dtype=bool)


def free_distance(surface: DeviceProxy, points: F64, directions: F64) -> F64:
    """(n,) how far it is from points (n, 3) of the surface along unit directions (n, 3) to a face; infinity: none."""
    start = points + directions * (np.abs(points).max(axis=1, keepdims=True) * 2.0**-16)
    a, b = (mi.Point3f(*(floats(x[:, k]) for k in range(3))) for x in (start, directions))
    found = surface.nearest(bounded_ray(a, mi.Vector3f(b), mi.Float(dr.inf)), mi.Bool(True))
    return np.where(found.is_valid().numpy(), found.t.numpy(), np.inf).astype(np.float64)


def buckets(keys: NDArray[np.uint32], mask: int) -> NDArray[np.uint32]:
    """(n,) bucket of each key (n, 2) in a hash table of mask + 1 of them."""
    padded = np.append(keys, np.zeros((2, 2), np.uint32), axis=0)
    found = mix(integers(padded[:, 0]), integers(padded[:, 1])) & dr.opaque(mi.UInt32, mask)
    return np.asarray(found.numpy()[: len(keys)], np.uint32)
