"""The path tracer: one symbolic loop, fused with the film into one kernel.

Two-sided diffuse surfaces. At every hit the table's lights are sampled, at the first one all of them; the environment
is sampled once by its map and once by the reflected ray, joined by multiple importance sampling with the balance
heuristic (Veach 1997). What a vertex adds goes to its own light's layer at once.
"""

from __future__ import annotations

from typing import NamedTuple, cast

import drjit as dr
import mitsuba as mi

from mirelight.lighting.grid import FIRST_WEIGHED, LATER_WEIGHED
from mirelight.lighting.kernel import lights as punctual
from mirelight.lighting.kernel.cell_points import CellPoints
from mirelight.lighting.kernel.cells import DeviceCells
from mirelight.lighting.kernel.film import Film
from mirelight.lighting.kernel.lights import SHADOW_END, LightSet
from mirelight.lighting.kernel.probes import PointRays
from mirelight.lighting.kernel.proxy import DeviceProxy, Point
from mirelight.lighting.kernel.rays import CameraRays, SomePixels, bounded_ray
from mirelight.lighting.kernel.samples import Tiles, mix, number, pair, stratified
from mirelight.lighting.kernel.sky import Sky, sky_irradiance
from mirelight.lighting.kernel.types import Bool, Float, Point2f, UInt32, Vector3f

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


class Path(NamedTuple):
    """One path at one hit."""

    sample: UInt32
    place: UInt32  # in the film's launch
    salt: UInt32  # of this hit's random numbers


def _glow_irradiance(
    surface: DeviceProxy, at: Point, choice: Float, inside: Point2f, active: Bool
) -> tuple[Vector3f, Bool]:
    """(light of one point of what glows elsewhere, drawn by power and weighted likewise; whether there is any)."""
    d, length, drawn, glow = surface.sample_glow(at.p, choice, inside, active)
    cosine = dr.dot(d, at.normal)
    lit = active & (cosine > 0) & (drawn > 0)
    lit &= ~surface.blocked(bounded_ray(at.start, d, length * SHADOW_END), lit)
    return glow * (cosine / (drawn + cosine * dr.inv_pi)), lit


@dr.syntax
def _add_lamps(
    surface: DeviceProxy,
    lights: LightSet,
    film: Film,
    path: Path,
    at: Point,
    weight: Vector3f,
    depth: UInt32,
    sums: tuple[Vector3f, Vector3f],
    sunlit: Float,
    first_rays: UInt32,
    active: Bool,
    *,
    several: bool,
) -> tuple[tuple[Vector3f, Vector3f], Float]:
    """The lights of the table that reach a point, in as many runs as picks: (sums, share of the suns' light).

    Of a long list the brightest are weighed and some drawn from the rest. Where `several`, a light with an extent that
    has a run of its own is sampled by `first_rays` at a first hit.
    """
    indirect = depth > 0
    start, listed = lights.list_at(at.p, active)
    weighed = dr.select(indirect, mi.UInt32(LATER_WEIGHED), mi.UInt32(FIRST_WEIGHED))
    near = dr.select(listed > weighed, weighed // 2, listed)
    count = dr.minimum(listed, weighed)
    stretch = mi.Float(listed - near) / mi.Float(weighed - weighed // 2)  # lights that one drawn beyond stands for
    picks = dr.minimum(count, lights.picks(depth))
    pick, entry = mi.UInt32(0), mi.UInt32(0)
    while active & (pick < picks):
        last = mi.UInt32(mi.Float((pick + 1) * count) / mi.Float(picks))
        own_light, rays = mi.UInt32(0), mi.UInt32(1)
        if dr.hint(several, mode="scalar"):
            own_light = dr.gather(mi.UInt32, lights.items, start + entry, active)
            own_run = (entry + 1 == last) & (listed <= weighed) & lights.extended(own_light)
            rays = dr.select(own_run & ~indirect, first_rays, 1)
        chosen, chosen_weight, total = mi.UInt32(0), mi.Float(0), mi.Float(0)
        wi, length, irradiance = mi.Vector3f(0), mi.Float(0), mi.Vector3f(0)
        while entry < last:  # a weighted reservoir of one over the run
            own = mix(path.salt, entry + 16)
            beyond = entry >= near
            index = mi.UInt32(entry)
            if beyond:
                index = mi.UInt32((mi.Float(entry - near) + number(path.sample, mix(own, 1))) * stretch)
                index = near + dr.minimum(index, listed - near - 1)
            light = dr.gather(mi.UInt32, lights.items, start + index)
            seed = mix(path.salt, dr.gather(mi.UInt32, lights.seeds, light))
            w_wi, w_length, w_irradiance = punctual.sample(
                lights.table, light, at.p, at.normal, path.sample * rays, seed
            )
            w = (w_irradiance.x + w_irradiance.y + w_irradiance.z) / 3
            share = dr.select(beyond, w * stretch, w)
            total += share
            take = number(path.sample, own) * total < share
            chosen = dr.select(take, light, chosen)
            chosen_weight = dr.select(take, w, chosen_weight)
            wi = dr.select(take, w_wi, wi)
            length = dr.select(take, w_length, length)
            irradiance = dr.select(take, w_irradiance, irradiance)
            entry += 1
        lit = active & (chosen_weight > 0)
        lit &= ~surface.blocked(bounded_ray(at.start, wi, length), lit, coherent=~indirect)
        arrived = dr.select(lit, weight * irradiance * (total / chosen_weight), 0)
        seen = dr.select(lit, total / chosen_weight, 0)
        if dr.hint(several, mode="scalar"):
            seed, k = mix(path.salt, dr.gather(mi.UInt32, lights.seeds, own_light)), mi.UInt32(1)
            while k < rays:
                ray = path.sample * rays + k
                wi, length, irradiance = punctual.sample(lights.table, own_light, at.p, at.normal, ray, seed)
                lit = active & (dr.max(irradiance) > 0)
                lit &= ~surface.blocked(bounded_ray(at.start, wi, length), lit, coherent=True)
                arrived += dr.select(lit, weight * irradiance, 0)
                seen += dr.select(lit, 1, 0)
                k += 1
            chosen = dr.select(rays > 1, own_light, chosen)
            arrived, seen = arrived / mi.Float(rays), seen / mi.Float(rays)
        lit = seen > 0
        layer = dr.gather(mi.UInt32, lights.layer_of_light, chosen, lit)
        sums = film.add_light(sums, path.place, layer, indirect, arrived, lit)
        if dr.hint(film.aovs, mode="scalar"):
            sun = dr.gather(mi.Float, lights.sun_shares, chosen, lit)
            sunlit += dr.select(lit & ~indirect, sun * seen, 0)
        pick += 1
    return sums, sunlit


@dr.syntax
def trace_pass(
    surface: DeviceProxy,
    view: CameraRays | PointRays | CellPoints | SomePixels,
    lights: LightSet,
    sky: Sky,
    film: Film,
    job: Pass,
    cells: DeviceCells | None = None,
) -> None:
    """Trace one pass and add it to the film; light is read from `cells` where there are some."""
    reads, reads_first = cells is not None, cells is not None and cells.first
    kept = cast(DeviceCells, cells)
    lane = dr.arange(mi.UInt32, job.lanes)
    of_launch = lane >> job.log2_samples
    within = lane & ((mi.UInt32(1) << job.log2_samples) - 1)
    place = (within >> job.log2_batch) * job.count + of_launch  # of this sample's batch in the film's launch
    pixel = dr.gather(mi.UInt32, job.pixels, of_launch)
    of_pixel = dr.gather(mi.UInt32, job.first_samples, of_launch) + within
    sample, stream = view.sequence(pixel, of_pixel, job.tiles, job.seed)
    if dr.hint(film.in_parts, mode="scalar"):  # every fourth batch owes the others nothing
        stream = dr.select(((of_pixel >> job.log2_batch) & 3) == 3, mix(stream, 0x5BD1E995), stream)

    covered, face, uv, d = view.first_hit(surface, pixel, sample, stream)
    active = mi.Bool(covered)
    seen = surface.at(face, uv, d, active)
    film.add_surface(pixel, seen, view.depth(seen.p), active)

    depth = mi.UInt32(0)
    sums = mi.Vector3f(0), mi.Vector3f(0)  # direct and indirect light, where layers are not kept apart
    roulette = stratified(sample, mix(stream, 0x51ED270B))  # how far the path may live: one number for all its bounces
    throughput = mi.Vector3f(1)  # β, the albedo of every hit so far
    sunlit, unoccluded = mi.Float(0), mi.Float(0)  # what the first hit sees of the suns and of the hemisphere
    distance: Float = mi.Float(0)  # of the ray that came here: its length
    reflected: Float = mi.Float(0)  # and its density
    sky_on, sky_sampled, max_depth = sky.present, sky.sampled, job.max_depth

    while active:
        salt = mix(stream, depth + 1)
        path = Path(sample, place, salt)
        at = surface.at(face, uv, d, active)
        albedo = at.albedo
        if dr.hint(job.irradiance, mode="scalar"):
            albedo = dr.select(depth == 0, 1, at.albedo)
        weight = throughput * albedo * dr.inv_pi
        indirect = depth > 0

        # what glows here, seen directly or met by the reflected ray
        if dr.hint(job.emission, mode="scalar"):
            drawn = surface.glow_pdf(face, distance, abs(dr.dot(at.geometric_normal, d)), active)
            share = dr.select(indirect & (drawn > 0), reflected / (reflected + drawn), 1)
            glow_layer = film.glow_layer
            if dr.hint(job.irradiance, mode="scalar"):
                share = dr.select(indirect, share, 0)
                glow_layer = dr.select(depth == 1, film.met_glow_layer, film.glow_layer)
            value = dr.select(active, throughput * at.emission * share, 0)
            sums = film.add_light(sums, place, glow_layer, depth > 1, value, active)
            active &= depth < max_depth

        # a later hit's light, read whole
        read = mi.Bool(False)
        if dr.hint(reads, mode="scalar"):
            near_by = active & indirect & (distance > kept.nearest)
            if near_by:
                cell, read = kept.find(surface, at, pair(sample, mix(salt, 7)), near_by)
                sums = kept.add_whole(film, sums, place, pixel, cell, throughput * at.albedo, read)
            active &= ~read

        # what is known of a first hit's piece of the surface
        read, cell = mi.Bool(False), mi.UInt32(0)
        if dr.hint(reads_first, mode="scalar"):
            first = active & ~indirect
            if first:
                cell, read = kept.find(surface, at, pair(sample, mix(salt, 7)), first)

        # light that is sampled towards its source: lamps, the environment's map, what glows elsewhere
        sums, sunlit = _add_lamps(
            surface,
            lights,
            film,
            path,
            at,
            weight,
            depth,
            sums,
            sunlit,
            job.first_rays,
            active,
            several=reads_first,
        )
        lit = active & sky_sampled
        value, ray, rays = mi.Vector3f(0), mi.UInt32(0), mi.UInt32(1)
        if dr.hint(reads_first, mode="scalar"):
            rays = dr.select(indirect, mi.UInt32(1), job.first_rays)
        while lit & (ray < rays):
            number_of = sample * rays + ray
            choice, inside = stratified(number_of, mix(salt, 1)), pair(number_of, mix(salt, 2))
            times = mi.Float(1)
            if dr.hint(reads_first, mode="scalar"):
                choice, times = kept.spread.choice(cell, choice, read)
            value += times * sky_irradiance(surface, sky, at, choice, inside, lit)
            ray += 1
        value *= weight / mi.Float(rays)
        sums = film.add_light(sums, place, film.sky_layer, indirect, value, lit)
        if dr.hint(job.emission, mode="scalar"):
            value, ray = mi.Vector3f(0), mi.UInt32(0)
            while active & (ray < rays):
                number_of = sample * rays + ray
                choice, inside = number(number_of, mix(salt, 5)), pair(number_of, mix(salt, 6))
                glow, lit = _glow_irradiance(surface, at, choice, inside, active)
                value += dr.select(lit, glow, 0)
                ray += 1
            value *= weight / mi.Float(rays)
            sums = film.add_light(sums, place, film.glow_layer, indirect, value, active)

        # all else that falls on a first hit, read
        if dr.hint(reads_first, mode="scalar"):
            sums = kept.add_rest(film, sums, place, pixel, cell, throughput * albedo, read)

        # the reflected ray
        depth += 1
        throughput *= albedo
        go_on = active & ~read & ((depth < max_depth) | sky_on | job.emission) & (dr.max(throughput) > 0)
        survival = dr.select(depth > ROULETTE_FROM, dr.minimum(dr.max(throughput), 0.95), 1)
        go_on &= roulette < survival
        roulette = roulette / survival
        throughput = throughput / survival
        d = mi.Frame3f(at.normal).to_world(mi.warp.square_to_cosine_hemisphere(pair(sample, mix(salt, 3))))
        reflected = dr.maximum(dr.dot(d, at.normal), 0) * dr.inv_pi
        if dr.hint(film.aovs, mode="scalar"):
            go_on |= active & (depth == 1)
        found = surface.nearest(mi.Ray3f(at.start, d), go_on)
        hit = go_on & found.is_valid()
        if dr.hint(film.aovs, mode="scalar"):
            unoccluded = dr.select(
                active & (depth == 1), dr.select(hit & (found.t < job.ao_distance), 0, 1), unoccluded
            )

        # the environment, met by the reflected ray
        escaped = go_on & ~hit & sky_on & ~read
        value = mi.Vector3f(0)
        if escaped:
            mapped = sky.pdf(d, escaped)
            share = dr.select(mapped > 0, reflected / (reflected + mapped), 1)
            value = throughput * sky.radiance(d, escaped) * share
        sky_layer = film.sky_layer
        if dr.hint(job.irradiance, mode="scalar"):
            sky_layer = dr.select(depth == 1, film.met_sky_layer, film.sky_layer)
        sums = film.add_light(sums, place, sky_layer, depth > 1, value, escaped)

        face, uv, distance = mi.UInt32(found.prim_index), mi.Point2f(found.prim_uv), mi.Float(found.t)
        active = hit & ~read & ((depth < max_depth) | job.emission)

    film.add_sums(sums, place, covered)
    if dr.hint(film.aovs, mode="scalar"):
        film.add_openness(pixel, sunlit, unoccluded, covered)
