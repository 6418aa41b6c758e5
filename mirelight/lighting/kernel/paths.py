"""The path tracer: one symbolic loop, fused with the film into one kernel.

Two-sided diffuse surfaces. At every hit the table's lights are sampled, at the first one all of them; the environment
is sampled once by its map and once by the reflected ray, joined by multiple importance sampling with the balance
heuristic (Veach 1997). What a vertex adds goes to its own light's layer at once.

`trace_pass` is the loop; each step of a bounce is a method of `_Steps`.
"""

from __future__ import annotations

from typing import NamedTuple, TypeAlias, cast

import drjit as dr
import mitsuba as mi

from mirelight.lighting.kernel.cell_points import CellPoints
from mirelight.lighting.kernel.cells import DeviceCells
from mirelight.lighting.kernel.film import Film, PathSums
from mirelight.lighting.kernel.lamps import add_lamps
from mirelight.lighting.kernel.lights import SHADOW_END, LightSet
from mirelight.lighting.kernel.probes import PointRays
from mirelight.lighting.kernel.proxy import DeviceProxy, Point
from mirelight.lighting.kernel.rays import CameraRays, SomePixels, bounded_ray
from mirelight.lighting.kernel.samples import Tiles, mix, number, pair, stratified
from mirelight.lighting.kernel.sky import Sky, sky_irradiance
from mirelight.lighting.kernel.types import Bool, Float, Point2f, UInt32, Vector3f
from mirelight.lighting.kernel.vertex import Arrival, Vertex

ROULETTE_FROM = 4  # bounces that are never cut short; earlier roulette costs noise, later gains nothing


class Pass(NamedTuple):
    """Which samples of which pixels one launch takes: lanes go pixel by pixel, 2^log2_samples of each.

    Neighbouring lanes share a pixel, so their rays are traced together; a pixel of one each costs 1.4 times as much.
    """

    lanes: int
    count: UInt32  # pixels of this launch
    pixels: UInt32  # (count,) the film's pixel of each
    first_samples: UInt32  # (count,) how many samples each has already
    log2_samples: UInt32
    log2_batch: UInt32  # samples that the variance takes as one
    tiles: Tiles
    first_rays: UInt32  # to the environment's map, and to each light with an extent, where a first hit is read
    seed: UInt32
    max_depth: UInt32
    ao_distance: Float  # how far ambient occlusion looks
    emission: bool  # surfaces that glow do
    irradiance: bool = False  # the first hit counts as white and dark: its irradiance / pi instead of its radiance


class World(NamedTuple):
    """What paths meet, and what is known of its light."""

    surface: DeviceProxy
    lights: LightSet
    sky: Sky
    cells: DeviceCells | None = None  # light is read from them


View: TypeAlias = CameraRays | PointRays | CellPoints | SomePixels


@dr.syntax
def trace_pass(world: World, view: View, film: Film, job: Pass) -> None:
    """Trace one pass and add it to the film."""
    steps = _Steps(world, film, job)
    pixel, place, sample, stream = _samples(view, film, job)
    covered, face, uv, d = view.first_hit(world.surface, pixel, sample, stream)
    active = mi.Bool(covered)
    seen = world.surface.at(face, uv, d, active)
    film.add_surface(pixel, seen, view.depth(seen.p), active)

    depth = mi.UInt32(0)
    sums = mi.Vector3f(0), mi.Vector3f(0)
    roulette = stratified(sample, mix(stream, 0x51ED270B))  # how far the path may live: one number for all its bounces
    throughput = mi.Vector3f(1)
    sunlit, unoccluded = mi.Float(0), mi.Float(0)  # what the first hit sees of the suns and of the hemisphere
    distance, pdf = mi.Float(0), mi.Float(0)  # of the ray that came here
    while active:
        came = Arrival(face, uv, d, distance, pdf)
        salt = mix(stream, depth + 1)
        at = world.surface.at(face, uv, d, active)
        albedo = steps.albedo(at, depth)
        weight = throughput * albedo * dr.inv_pi
        vertex = Vertex(sample, pixel, place, salt, at, depth, depth > 0, throughput, albedo, weight)

        sums, active = steps.add_glow_met(sums, vertex, came, active)
        sums, active = steps.add_later_cell(sums, vertex, came, active)
        cell, read = steps.first_cell(vertex, active)
        sums, sunlit = steps.add_lamps(sums, sunlit, vertex, active)
        sums = steps.add_sky_sampled(sums, vertex, cell, read, active)
        sums = steps.add_glow_sampled(sums, vertex, active)
        sums = steps.add_first_cell(sums, vertex, cell, read)

        depth += 1
        throughput *= albedo
        go_on = active & ~read & steps.may_meet_light(depth) & (dr.max(throughput) > 0)
        survival = dr.select(depth > ROULETTE_FROM, dr.minimum(dr.max(throughput), 0.95), 1)
        go_on &= roulette < survival
        roulette = roulette / survival
        throughput = throughput / survival
        if dr.hint(film.aovs, mode="scalar"):
            go_on |= active & (depth == 1)
        came, hit = steps.reflect(vertex, go_on)
        if dr.hint(film.aovs, mode="scalar"):
            near = hit & (came.distance < job.ao_distance)
            unoccluded = dr.select(active & (depth == 1), dr.select(near, 0, 1), unoccluded)
        sums = steps.add_sky_met(sums, place, depth, throughput, came, go_on & ~hit & ~read)
        face, uv, d, distance, pdf = came
        active = hit & ~read & ((depth < job.max_depth) | job.emission)

    film.add_sums(sums, place, covered)
    if dr.hint(film.aovs, mode="scalar"):
        film.add_openness(pixel, sunlit, unoccluded, covered)


@dr.syntax
def _samples(view: View, film: Film, job: Pass) -> tuple[UInt32, UInt32, UInt32, UInt32]:
    """(the film's pixel, place in its launch, number in its sequence, random stream) of each lane's sample."""
    lane = dr.arange(mi.UInt32, job.lanes)
    of_launch = lane >> job.log2_samples
    within = lane & ((mi.UInt32(1) << job.log2_samples) - 1)
    place = (within >> job.log2_batch) * job.count + of_launch  # of this sample's batch in the film's launch
    pixel = dr.gather(mi.UInt32, job.pixels, of_launch)
    of_pixel = dr.gather(mi.UInt32, job.first_samples, of_launch) + within
    sample, stream = view.sequence(pixel, of_pixel, job.tiles, job.seed)
    if dr.hint(film.in_parts, mode="scalar"):  # every fourth batch owes the others nothing
        stream = dr.select(((of_pixel >> job.log2_batch) & 3) == 3, mix(stream, 0x5BD1E995), stream)
    return pixel, place, sample, stream


class _Steps:
    """The steps of a bounce. Those that add light take and give the path's sums; what a launch lacks compiles to
    nothing."""

    def __init__(self, world: World, film: Film, job: Pass) -> None:
        self.surface, self.lights, self.sky = world.surface, world.lights, world.sky
        self.cells = cast(DeviceCells, world.cells)  # asked only where there are some
        self.film, self.job = film, job
        self._reads = world.cells is not None

    def albedo(self, at: Point, depth: UInt32) -> Vector3f:
        """Of a hit; a first one whose irradiance is asked for counts as white."""
        return dr.select(depth == 0, 1, at.albedo) if self.job.irradiance else at.albedo

    def may_meet_light(self, depth: UInt32) -> Bool:
        """Whether a ray that leaves the last hit of so many can bring something."""
        return (depth < self.job.max_depth) | self.sky.present | self.job.emission

    def reflect(self, vertex: Vertex, go_on: Bool) -> tuple[Arrival, Bool]:
        """(the ray that a vertex reflects, drawn by the cosine, and where it goes; whether it hits the surface)."""
        at = vertex.at
        u = pair(vertex.sample, mix(vertex.salt, 3))
        d = mi.Frame3f(at.normal).to_world(mi.warp.square_to_cosine_hemisphere(u))
        found = self.surface.nearest(mi.Ray3f(at.start, d), go_on)
        pdf = dr.maximum(dr.dot(d, at.normal), 0) * dr.inv_pi
        came = Arrival(mi.UInt32(found.prim_index), mi.Point2f(found.prim_uv), d, mi.Float(found.t), pdf)
        return came, go_on & found.is_valid()

    # --- light that a ray meets ---

    def add_glow_met(self, sums: PathSums, vertex: Vertex, came: Arrival, active: Bool) -> tuple[PathSums, Bool]:
        """What glows at a vertex, weighted against its being sampled; and whether the path has another bounce."""
        film, job = self.film, self.job
        if not job.emission:
            return sums, active
        cosine = abs(dr.dot(vertex.at.geometric_normal, came.d))
        sampled = self.surface.glow_pdf(came.face, came.distance, cosine, active)
        share = dr.select(vertex.indirect & (sampled > 0), came.pdf / (came.pdf + sampled), 1)
        layer = film.glow_layer
        if job.irradiance:
            share = dr.select(vertex.indirect, share, 0)
            layer = dr.select(vertex.depth == 1, film.met_glow_layer, film.glow_layer)
        value = dr.select(active, vertex.throughput * vertex.at.emission * share, 0)
        sums = film.add_light(sums, vertex.place, layer, vertex.depth > 1, value, active)
        return sums, active & (vertex.depth < job.max_depth)

    @dr.syntax
    def add_sky_met(
        self, sums: PathSums, place: UInt32, depth: UInt32, throughput: Vector3f, came: Arrival, escaped: Bool
    ) -> PathSums:
        """The environment where a ray that reflected `depth` times leaves, weighted against its being sampled."""
        film, sky = self.film, self.sky
        escaped &= sky.present
        value = mi.Vector3f(0)
        if escaped:
            sampled = sky.pdf(came.d, escaped)
            share = dr.select(sampled > 0, came.pdf / (came.pdf + sampled), 1)
            value = throughput * sky.radiance(came.d, escaped) * share
        layer = film.sky_layer
        if dr.hint(self.job.irradiance, mode="scalar"):
            layer = dr.select(depth == 1, film.met_sky_layer, film.sky_layer)
        return film.add_light(sums, place, layer, depth > 1, value, escaped)

    # --- light that is sampled towards its source ---

    def add_lamps(self, sums: PathSums, sunlit: Float, vertex: Vertex, active: Bool) -> tuple[PathSums, Float]:
        """The lights of the table; and the share of the suns' light that the first hit sees."""
        first_rays = self.job.first_rays if self._reads else None
        return add_lamps(self.surface, self.lights, self.film, vertex, sums, sunlit, first_rays, active)

    @dr.syntax
    def add_sky_sampled(self, sums: PathSums, vertex: Vertex, cell: UInt32, read: Bool, active: Bool) -> PathSums:
        """The environment by samples of its map, where a first hit is read spread as its cell has found it."""
        lit = active & self.sky.sampled
        value, ray, rays = mi.Vector3f(0), mi.UInt32(0), self._rays(vertex)
        while lit & (ray < rays):
            index = vertex.sample * rays + ray
            choice, inside = stratified(index, mix(vertex.salt, 1)), pair(index, mix(vertex.salt, 2))
            times = mi.Float(1)
            if dr.hint(self._reads, mode="scalar"):
                choice, times = self.cells.spread.choice(cell, choice, read)
            value += times * sky_irradiance(self.surface, self.sky, vertex.at, choice, inside, lit)
            ray += 1
        value *= vertex.weight / mi.Float(rays)
        return self.film.add_light(sums, vertex.place, self.film.sky_layer, vertex.indirect, value, lit)

    @dr.syntax
    def add_glow_sampled(self, sums: PathSums, vertex: Vertex, active: Bool) -> PathSums:
        """What glows elsewhere by samples of its faces."""
        if dr.hint(self.job.emission, mode="scalar"):
            value, ray, rays = mi.Vector3f(0), mi.UInt32(0), self._rays(vertex)
            while active & (ray < rays):
                index = vertex.sample * rays + ray
                choice, inside = number(index, mix(vertex.salt, 5)), pair(index, mix(vertex.salt, 6))
                glow, lit = _glow_irradiance(self.surface, vertex.at, choice, inside, active)
                value += dr.select(lit, glow, 0)
                ray += 1
            value *= vertex.weight / mi.Float(rays)
            sums = self.film.add_light(sums, vertex.place, self.film.glow_layer, vertex.indirect, value, active)
        return sums

    def _rays(self, vertex: Vertex) -> UInt32:
        """Samples of each source that needs many."""
        return dr.select(vertex.indirect, mi.UInt32(1), self.job.first_rays) if self._reads else mi.UInt32(1)

    # --- light that is read ---

    @dr.syntax
    def add_later_cell(self, sums: PathSums, vertex: Vertex, came: Arrival, active: Bool) -> tuple[PathSums, Bool]:
        """All light of a later hit from its cell, unless that is too near; and whether the path goes on here."""
        if dr.hint(self._reads, mode="scalar"):
            read, far = mi.Bool(False), active & vertex.indirect & (came.distance > self.cells.nearest)
            if far:
                cell, read = self.cells.find(self.surface, vertex.at, self._jitter(vertex), far)
                sums = self.cells.add_whole(self.film, sums, vertex, cell, read)
            active &= ~read
        return sums, active

    @dr.syntax
    def first_cell(self, vertex: Vertex, active: Bool) -> tuple[UInt32, Bool]:
        """(the cell of a first hit, whether there is one that is read)."""
        cell, read = mi.UInt32(0), mi.Bool(False)
        if dr.hint(self._reads, mode="scalar"):
            first = active & ~vertex.indirect
            if first:
                cell, read = self.cells.find(self.surface, vertex.at, self._jitter(vertex), first)
        return cell, read

    def add_first_cell(self, sums: PathSums, vertex: Vertex, cell: UInt32, read: Bool) -> PathSums:
        """What a first hit's cell holds of all light that is not sampled there."""
        return self.cells.add_rest(self.film, sums, vertex, cell, read) if self._reads else sums

    def _jitter(self, vertex: Vertex) -> Point2f:
        return pair(vertex.sample, mix(vertex.salt, 7))


def _glow_irradiance(
    surface: DeviceProxy, at: Point, choice: Float, inside: Point2f, active: Bool
) -> tuple[Vector3f, Bool]:
    """(light of one point of what glows elsewhere, drawn by power and weighted likewise; whether there is any)."""
    d, length, drawn, glow = surface.sample_glow(at.p, choice, inside, active)
    cosine = dr.dot(d, at.normal)
    lit = active & (cosine > 0) & (drawn > 0)
    lit &= ~surface.blocked(bounded_ray(at.start, d, length * SHADOW_END), lit)
    return glow * (cosine / (drawn + cosine * dr.inv_pi)), lit
