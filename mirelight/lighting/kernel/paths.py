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
from mirelight.lighting.kernel.lamps import add_lamps, add_lamps_met
from mirelight.lighting.kernel.lights import SHADOW_END, LightSet
from mirelight.lighting.kernel.probes import PointRays
from mirelight.lighting.kernel.proxy import DeviceProxy, Point
from mirelight.lighting.kernel.rays import CameraRays, SomePixels, bounded_ray
from mirelight.lighting.kernel.samples import Tiles, mix, number, pair, stratified
from mirelight.lighting.kernel.scatter import SCATTERED_ALPHA, Gloss, reflected, towards
from mirelight.lighting.kernel.see_through import tinted
from mirelight.lighting.kernel.sky import Sky, sky_irradiance
from mirelight.lighting.kernel.types import Bool, Float, Point2f, UInt32, Vector3f
from mirelight.lighting.kernel.vertex import Arrival, Vertex

ROULETTE_FROM = 4  # bounces that are never cut short; earlier roulette costs noise, later gains nothing


class Pass(NamedTuple):
    """Which samples of which pixels one launch takes: pass after pass lanes go pixel by pixel, 2^log2_samples of each.

    Neighbouring lanes share a pixel, so their rays are traced together; a pixel of one each costs 1.4 times as much.
    """

    lanes: int  # of all passes
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


class _Lane(NamedTuple):
    """Whose path a lane follows, for all of its bounces; see `lamps._Given`."""

    sample: UInt32
    spot: UInt32
    place: UInt32
    stream: UInt32


class _Sampled(NamedTuple):
    """How a source is sampled at a vertex; see `lamps._Given`."""

    lit: Bool
    rays: UInt32
    cell: UInt32 | None = None
    read: Bool | None = None


@dr.syntax
def trace_pass(world: World, view: View, film: Film, job: Pass) -> None:
    """Trace the passes of one launch and add them to the film."""
    steps = _Steps(world, film, job)
    pixel, spot, place, sample, stream = _samples(view, film, job)
    covered, face, uv, d, crossed, far = view.first_hit(world.surface, pixel, sample, stream)
    active = mi.Bool(covered)
    seen = world.surface.at(face, uv, d, active)
    spot, place = steps.part_of_film(spot, place, face)
    cover = None if crossed is None else crossed.cover
    film.add_surface(spot, steps.shown(seen), view.depth(seen.p, far), active, cover)

    depth = mi.UInt32(0)
    sums = film.no_sums()
    roulette = stratified(sample, mix(stream, 0x51ED270B))  # how far the path may live: one number for all its bounces
    throughput = mi.Vector3f(1) if crossed is None else crossed.tint
    sunlit, unoccluded = mi.Float(0), mi.Float(0)  # what the first hit sees of the suns and of the hemisphere
    distance, pdf = mi.Float(0), mi.Float(0)  # of the ray that came here
    scattered = steps.not_scattered()  # by something rougher than a mirror
    lane = _Lane(sample, spot, place, stream)
    while active:
        came = Arrival(face, uv, d, distance, pdf)
        salt = mix(lane.stream, depth + 1)
        at = world.surface.at(face, uv, d, active)
        albedo = steps.albedo(at, came, depth, scattered, active)
        gloss = steps.gloss(at, d, albedo, depth, scattered)
        weight = throughput * albedo * dr.inv_pi if gloss is None else throughput
        vertex = Vertex(*lane[:3], salt, at, depth, depth > 0, throughput, albedo, weight, gloss)

        sums, active = steps.add_glow_met(sums, vertex, came, active)
        sums, active = steps.add_later_cell(sums, vertex, came, active)
        cell, read = steps.first_cell(vertex, active)
        sums, sunlit = steps.add_lamps(sums, sunlit, vertex, active)
        sums = steps.add_sky_sampled(sums, vertex, cell, read, active)
        sums = steps.add_glow_sampled(sums, vertex, active)
        sums = steps.add_first_cell(sums, vertex, cell, read)

        depth += 1
        way, passed, way_pdf = steps.drawn(vertex)
        throughput *= passed
        go_on = active & ~read & steps.may_meet_light(vertex, depth) & (dr.max(throughput) > 0)
        survival = dr.select(depth > ROULETTE_FROM, dr.minimum(dr.max(throughput), 0.95), 1)
        go_on &= roulette < survival
        roulette = roulette / survival
        throughput = throughput / survival
        if dr.hint(film.aovs, mode="scalar"):
            go_on |= active & (depth == 1)
        came, hit, tint = steps.reflect(vertex, way, way_pdf, go_on)
        throughput = tinted(throughput, tint)
        if dr.hint(film.aovs, mode="scalar"):
            near = hit & (came.distance < job.ao_distance)
            unoccluded = dr.select(active & (depth == 1), dr.select(near, 0, 1), unoccluded)
        sums = steps.add_sky_met(sums, lane.place, depth, throughput, came, go_on & ~hit & ~read)
        sums = steps.add_lamps_met(sums, vertex, throughput, came, hit, go_on)
        scattered = steps.scatters(vertex, scattered)
        face, uv, d, distance, pdf = came
        active = hit & ~read & ((depth < job.max_depth) | job.emission)

    film.add_sums(sums, place, covered)
    if dr.hint(film.aovs, mode="scalar"):
        film.add_openness(spot, sunlit, unoccluded, covered)


@dr.syntax
def _samples(view: View, film: Film, job: Pass) -> tuple[UInt32, UInt32, UInt32, UInt32, UInt32]:
    """(the film's pixel, spot and place in its launch, number in its sequence, random stream) of each lane's sample."""
    lane = dr.arange(mi.UInt32, job.lanes)
    spot = lane >> job.log2_samples
    number = spot // job.count  # of the pass
    of_launch = spot - number * job.count
    within = (number << job.log2_samples) + (lane & ((mi.UInt32(1) << job.log2_samples) - 1))
    place = (within >> job.log2_batch) * job.count + of_launch  # of this sample's batch
    pixel = dr.gather(mi.UInt32, job.pixels, of_launch)
    of_pixel = dr.gather(mi.UInt32, job.first_samples, of_launch) + within
    sample, stream = view.sequence(pixel, of_pixel, job.tiles, job.seed)
    if dr.hint(film.in_parts, mode="scalar"):  # every fourth batch owes the others nothing
        stream = dr.select(((of_pixel >> job.log2_batch) & 3) == 3, mix(stream, 0x5BD1E995), stream)
    return pixel, spot, place, sample, stream


class _Steps:
    """The steps of a bounce. Those that add light take and give the path's sums; what a launch lacks compiles to
    nothing."""

    def __init__(self, world: World, film: Film, job: Pass) -> None:
        self.surface, self.lights, self.sky = world.surface, world.lights, world.sky
        self.cells = cast(DeviceCells, world.cells)  # asked only where there are some
        self.film, self.job = film, job
        self._reads = world.cells is not None

    def not_scattered(self) -> Bool:
        """Whether a path has been at anything rougher than a mirror when it begins: no; None where none meets gloss."""
        return mi.Bool(False) if self.surface.has_objects or self.surface.lobes else None

    def albedo(self, at: Point, came: Arrival, depth: UInt32, scattered: Bool, active: Bool) -> Vector3f:
        """Of a hit; a first one whose irradiance is asked for counts as white, and one behind mirrors alone, where the
        path has not `scattered`, has the proxy's finer colour."""
        if self.surface.detail is not None:
            sharp = active if scattered is None else active & ~scattered
            return self.surface.detail.of(came.face, came.uv, at.albedo, sharp & (depth > 0))
        return dr.select(depth == 0, 1, at.albedo) if self.job.irradiance else at.albedo

    def part_of_film(self, spot: UInt32, place: UInt32, face: UInt32) -> tuple[UInt32, UInt32]:
        """Spot and place of a path in its launch: paths that objects begin have a half of it of their own."""
        if not self.surface.has_objects:
            return spot, place
        inserted = self.surface.is_inserted(face)
        spots, places = self.film.second_half
        return spot + dr.select(inserted, spots, 0), place + dr.select(inserted, places, 0)

    def shown(self, seen: Point) -> Point:
        """A first hit as the film has it; of lobes alone the albedo is the metal's share of the surface."""
        if not self.surface.lobes or seen.finish is None:
            return seen
        return seen._replace(albedo=mi.Vector3f(seen.finish.metallic))

    def gloss(self, at: Point, d: Vector3f, albedo: Vector3f, depth: UInt32, scattered: Bool) -> Gloss | None:
        """How a hit reflects; None where Lambert's law is all that there is."""
        if at.finish is None:
            return None
        least = dr.select(scattered, mi.Float(SCATTERED_ALPHA), 0)
        if not self.surface.lobes:
            return Gloss.of(at, -d, albedo, least)
        first = at._replace(finish=at.finish._replace(on=depth == 0))
        made = Gloss.of(first, -d, albedo, least)
        return None if made is None else made.alone(at.finish.on)

    def drawn(self, vertex: Vertex) -> tuple[Vector3f, Vector3f, Float]:
        """(the way on from a vertex, drawn by its BRDF; what a path that takes it is multiplied by; its density)."""
        u = pair(vertex.sample, mix(vertex.salt, 3))
        if vertex.gloss is None:
            d = mi.Frame3f(vertex.at.normal).to_world(mi.warp.square_to_cosine_hemisphere(u))
            return d, vertex.albedo, dr.maximum(dr.dot(d, vertex.at.normal), 0) * dr.inv_pi
        d, weight, pdf = vertex.gloss.drawn(number(vertex.sample, mix(vertex.salt, 8)), u)
        leaves = ~vertex.gloss.on | (dr.dot(d, vertex.at.geometric_normal) > 0)
        return d, dr.select(leaves, weight, 0), pdf

    def scatters(self, vertex: Vertex, scattered: Bool) -> Bool:
        """Whether a path has been at anything rougher than a mirror."""
        if vertex.gloss is None:
            return scattered
        return scattered | ~vertex.gloss.on | (vertex.gloss.alpha >= SCATTERED_ALPHA)

    def may_meet_light(self, vertex: Vertex, depth: UInt32) -> Bool:
        """Whether the ray that leaves a vertex, the path's reflection of that number, can bring something."""
        bright = (depth < self.job.max_depth) | self.sky.present | self.job.emission
        return bright if vertex.gloss is None else bright | vertex.gloss.on  # which may show a lamp

    def reflect(self, vertex: Vertex, d: Vector3f, pdf: Float, go_on: Bool) -> tuple[Arrival, Bool, Vector3f | None]:
        """(the ray that a vertex reflects that way with such a density, and where it goes; whether it hits the surface;
        the tint of what it goes through)."""
        at = vertex.at
        found, passed = self.surface.seen(mi.Ray3f(at.start, d), go_on)
        came = Arrival(mi.UInt32(found.prim_index), mi.Point2f(found.prim_uv), d, mi.Float(found.t), pdf)
        return came, go_on & found.is_valid(), None if passed is None else passed.tint

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
        if self.surface.lobes:  # what glows itself is no reflection
            share = dr.select(vertex.indirect, share, 0)
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

    def add_lamps_met(
        self, sums: PathSums, vertex: Vertex, throughput: Vector3f, came: Arrival, hit: Bool, active: Bool
    ) -> PathSums:
        """The table's lights with an extent where a ray meets them that an object has reflected."""
        if vertex.gloss is None:
            return sums
        came = came._replace(distance=dr.select(hit, came.distance, dr.inf))
        lit = active & vertex.gloss.on
        return add_lamps_met(self.lights, self.film, vertex, came, throughput, sums, lit)

    # --- light that is sampled towards its source ---

    def add_lamps(self, sums: PathSums, sunlit: Float, vertex: Vertex, active: Bool) -> tuple[PathSums, Float]:
        """The lights of the table; and the share of the suns' light that the first hit sees."""
        first_rays = self.job.first_rays if self._reads else None
        return add_lamps(self.surface, self.lights, self.film, vertex, sums, sunlit, first_rays, active)

    @dr.syntax
    def add_sky_sampled(self, sums: PathSums, vertex: Vertex, cell: UInt32, read: Bool, active: Bool) -> PathSums:
        """The environment by samples of its map, where a first hit is read spread as its cell has found it."""
        of = _Sampled(active & self.sky.sampled, self._rays(vertex), cell, read)
        value, ray = mi.Vector3f(0), mi.UInt32(0)
        while of.lit & (ray < of.rays):
            index = vertex.sample * of.rays + ray
            choice, inside = stratified(index, mix(vertex.salt, 1)), pair(index, mix(vertex.salt, 2))
            times = mi.Float(1)
            if dr.hint(self._reads, mode="scalar"):
                choice, times = self.cells.spread.choice(of.cell, choice, of.read)
            value += times * sky_irradiance(self.surface, self.sky, vertex.at, vertex.gloss, choice, inside, of.lit)
            ray += 1
        value *= vertex.weight / mi.Float(of.rays)
        return self.film.add_light(sums, vertex.place, self.film.sky_layer, vertex.indirect, value, of.lit)

    @dr.syntax
    def add_glow_sampled(self, sums: PathSums, vertex: Vertex, active: Bool) -> PathSums:
        """What glows elsewhere by samples of its faces."""
        if dr.hint(self.job.emission, mode="scalar"):
            of = _Sampled(active, self._rays(vertex))
            value, ray = mi.Vector3f(0), mi.UInt32(0)
            while of.lit & (ray < of.rays):
                index = vertex.sample * of.rays + ray
                choice, inside = number(index, mix(vertex.salt, 5)), pair(index, mix(vertex.salt, 6))
                glow, lit = _glow_irradiance(self.surface, vertex, choice, inside, of.lit)
                value += dr.select(lit, glow, 0)
                ray += 1
            value *= vertex.weight / mi.Float(of.rays)
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
    surface: DeviceProxy, vertex: Vertex, choice: Float, inside: Point2f, active: Bool
) -> tuple[Vector3f, Bool]:
    """(light of one point of what glows elsewhere, drawn by power and weighted likewise; whether there is any)."""
    at = vertex.at
    d, length, drawn, glow = surface.sample_glow(at.p, choice, inside, active)
    cosine = dr.dot(d, at.normal)
    lit = active & (cosine > 0) & (drawn > 0)
    reached, tint = surface.reached(bounded_ray(at.start, d, length * SHADOW_END), lit)
    value, reflecting = towards(vertex.gloss, cosine, d)
    light = tinted(glow * (cosine / (drawn + reflecting)), tint)
    return reflected(light, value), lit & reached
