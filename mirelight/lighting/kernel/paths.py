"""The path tracer: one symbolic loop, fused with the film into one kernel.

Two-sided diffuse surfaces. At every hit the table's lights are sampled, at the first one all of them; the environment
is sampled once by its map and once by the reflected ray, joined by multiple importance sampling with the balance
heuristic (Veach 1997). What a vertex adds goes to its own light's layer at once.
"""

from __future__ import annotations

from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from mirelight.lighting.grid import FIRST_WEIGHED, LATER_WEIGHED, LightGrid
from mirelight.lighting.kernel import lights as punctual
from mirelight.lighting.kernel.film import Film
from mirelight.lighting.kernel.lights import SHADOW_END
from mirelight.lighting.kernel.memory import floats, integers
from mirelight.lighting.kernel.probes import PointRays
from mirelight.lighting.kernel.proxy import DeviceProxy, Point
from mirelight.lighting.kernel.rays import CameraRays, bounded_ray, vector
from mirelight.lighting.kernel.samples import mix, number, pair, stratified
from mirelight.lighting.kernel.sky import Sky
from mirelight.lighting.kernel.types import Bool, Float, Point2f, Point3f, UInt32, Vector3f
from mirelight.model import F32

ROULETTE_FROM = 4  # bounces that are never cut short; earlier roulette costs noise, later gains nothing


class LightSet:
    """The light table and the lists of who reaches where (`mirelight.lighting.lights`, `grid`) in device memory."""

    def __init__(self, table: F32, grid: LightGrid, layer_of_light: NDArray[np.uint32], sun_shares: F32) -> None:
        self.table = floats(table)
        self.layer_of_light = integers(layer_of_light)
        self.sun_shares = floats(sun_shares)
        self.starts = integers(grid.starts)
        self.items = integers(np.append(grid.lights, np.zeros(2, np.uint32)))
        self.low, self.cells_per_unit = vector(grid.low), vector(grid.cells_per_unit)
        self.resolution = [dr.opaque(mi.UInt32, n) for n in grid.resolution]
        self._picks = [dr.opaque(mi.UInt32, n) for n in grid.picks]

    def picks(self, depth: UInt32) -> UInt32:
        """Most lights that are sampled at a hit: at the first, the second, and each later one."""
        first, second, later = self._picks
        return dr.select(depth == 0, first, dr.select(depth == 1, second, later))

    def list_at(self, p: Point3f, active: Bool) -> tuple[UInt32, UInt32]:
        """(start, count) of the list for a point: entries of `items`."""
        place = (mi.Vector3f(p) - self.low) * self.cells_per_unit
        x, y, z = (dr.minimum(mi.UInt32(dr.maximum(q, 0)), n - 1) for q, n in zip(place, self.resolution, strict=True))
        cell = (x * self.resolution[1] + y) * self.resolution[2] + z
        start = dr.gather(mi.UInt32, self.starts, cell, active)
        return start, dr.gather(mi.UInt32, self.starts, cell + 1, active) - start


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
    seed: UInt32
    max_depth: UInt32
    ao_distance: Float  # how far ambient occlusion looks
    emission: bool  # surfaces that glow do


def _sky_irradiance(
    surface: DeviceProxy, sky: Sky, at: Point, choice: Float, inside: Point2f, active: Bool
) -> Vector3f:
    """The environment's light on a point by one sample of its map, weighted against the reflected ray's density."""
    d, drawn = sky.sample(choice, inside, active)
    cosine = dr.dot(d, at.normal)
    lit = active & (cosine > 0) & (drawn > 0)
    lit &= ~surface.blocked(bounded_ray(at.start, d, mi.Float(dr.inf)), lit)
    return dr.select(lit, sky.radiance(d, lit) * (cosine / (drawn + cosine * dr.inv_pi)), 0)


@dr.syntax
def trace_pass(
    surface: DeviceProxy, view: CameraRays | PointRays, lights: LightSet, sky: Sky, film: Film, job: Pass
) -> None:
    """Trace one pass and add it to the film."""
    lane = dr.arange(mi.UInt32, job.lanes)
    of_launch = lane >> job.log2_samples
    within = lane & ((mi.UInt32(1) << job.log2_samples) - 1)
    place = (within >> job.log2_batch) * job.count + of_launch  # of this sample's batch in the film's launch
    pixel = dr.gather(mi.UInt32, job.pixels, of_launch)
    sample = dr.gather(mi.UInt32, job.first_samples, of_launch) + within
    stream = mix(pixel, job.seed)
    if dr.hint(film.in_parts, mode="scalar"):  # every fourth batch owes the others nothing
        stream = dr.select(((sample >> job.log2_batch) & 3) == 3, mix(stream, 0x5BD1E995), stream)

    primary = view.ray(pixel, pair(sample, stream))
    found = surface.nearest(primary, mi.Bool(True), coherent=True)
    covered = mi.Bool(found.is_valid())
    active = mi.Bool(covered)
    face, uv, d = mi.UInt32(found.prim_index), mi.Point2f(found.prim_uv), dr.normalize(primary.d)
    seen = surface.at(face, uv, d, active)
    film.add_surface(pixel, seen, view.depth(seen.p), active)

    depth = mi.UInt32(0)
    sums = mi.Vector3f(0), mi.Vector3f(0)  # direct and indirect light, where layers are not kept apart
    roulette = stratified(sample, mix(stream, 0x51ED270B))  # how far the path may live: one number for all its bounces
    throughput = mi.Vector3f(1)  # β, the albedo of every hit so far
    sunlit, unoccluded = mi.Float(0), mi.Float(0)  # what the first hit sees of the suns and of the hemisphere
    reflected: Float = mi.Float(0)
    distance: Float = mi.Float(0)  # of the ray that came here: length and density
    sky_on, sky_sampled, max_depth = sky.present, sky.sampled, job.max_depth

    while active:
        salt = mix(stream, depth + 1)
        at = surface.at(face, uv, d, active)
        weight = throughput * at.albedo * dr.inv_pi
        indirect = depth > 0

        # what glows here, seen directly or met by the reflected ray
        if dr.hint(job.emission, mode="scalar"):
            drawn = surface.glow_pdf(face, distance, abs(dr.dot(at.geometric_normal, d)), active)
            share = dr.select(indirect & (drawn > 0), reflected / (reflected + drawn), 1)
            value = dr.select(active, throughput * at.emission * share, 0)
            sums = film.add_light(sums, place, film.glow_layer, depth > 1, value, active)
            active &= depth < max_depth

        # the lights of the table that reach here, the brightest and some drawn from the rest, in as many runs as picks
        start, listed = lights.list_at(at.p, active)
        weighed = dr.select(indirect, mi.UInt32(LATER_WEIGHED), mi.UInt32(FIRST_WEIGHED))
        near = dr.select(listed > weighed, weighed // 2, listed)
        count = dr.minimum(listed, weighed)
        stretch = mi.Float(listed - near) / mi.Float(
            weighed - weighed // 2
        )  # lights that one drawn beyond `near` stands for
        picks = dr.minimum(count, lights.picks(depth))
        pick, entry = mi.UInt32(0), mi.UInt32(0)
        while active & (pick < picks):
            last = mi.UInt32(mi.Float((pick + 1) * count) / mi.Float(picks))
            chosen, chosen_weight, total = mi.UInt32(0), mi.Float(0), mi.Float(0)
            wi, length, irradiance = mi.Vector3f(0), mi.Float(0), mi.Vector3f(0)
            while entry < last:  # a weighted reservoir of one over the run
                own = mix(salt, entry + 16)
                beyond = entry >= near
                index = mi.UInt32(entry)
                if beyond:
                    index = mi.UInt32((mi.Float(entry - near) + number(sample, mix(own, 1))) * stretch)
                    index = near + dr.minimum(index, listed - near - 1)
                light = dr.gather(mi.UInt32, lights.items, start + index)
                w_wi, w_length, w_irradiance = punctual.sample(lights.table, light, at.p, at.normal, sample, own)
                w = (w_irradiance.x + w_irradiance.y + w_irradiance.z) / 3
                share = dr.select(beyond, w * stretch, w)
                total += share
                take = number(sample, own) * total < share
                chosen = dr.select(take, light, chosen)
                chosen_weight = dr.select(take, w, chosen_weight)
                wi = dr.select(take, w_wi, wi)
                length = dr.select(take, w_length, length)
                irradiance = dr.select(take, w_irradiance, irradiance)
                entry += 1
            lit = active & (chosen_weight > 0)
            lit &= ~surface.blocked(bounded_ray(at.start, wi, length), lit, coherent=~indirect)
            value = dr.select(lit, weight * irradiance * (total / chosen_weight), 0)
            layer = dr.gather(mi.UInt32, lights.layer_of_light, chosen, lit)
            sums = film.add_light(sums, place, layer, indirect, value, lit)
            if dr.hint(film.aovs, mode="scalar"):
                sun = dr.gather(mi.Float, lights.sun_shares, chosen, lit)
                sunlit += dr.select(lit & ~indirect, sun * (total / chosen_weight), 0)
            pick += 1

        # the environment, sampled by its map
        lit = active & sky_sampled
        value = mi.Vector3f(0)
        if lit:
            value = weight * _sky_irradiance(
                surface, sky, at, stratified(sample, mix(salt, 1)), pair(sample, mix(salt, 2)), lit
            )
        sums = film.add_light(sums, place, film.sky_layer, indirect, value, lit)

        # what glows elsewhere, sampled by its power
        if dr.hint(job.emission, mode="scalar"):
            choice, inside = number(sample, mix(salt, 5)), pair(sample, mix(salt, 6))
            glow_d, length, drawn, glow = surface.sample_glow(at.p, choice, inside, active)
            cosine = dr.dot(glow_d, at.normal)
            lit = active & (cosine > 0) & (drawn > 0)
            lit &= ~surface.blocked(bounded_ray(at.start, glow_d, length * SHADOW_END), lit)
            value = dr.select(lit, weight * glow * (cosine / (drawn + cosine * dr.inv_pi)), 0)
            sums = film.add_light(sums, place, film.glow_layer, indirect, value, lit)

        # the reflected ray
        depth += 1
        throughput *= at.albedo
        go_on = active & ((depth < max_depth) | sky_on | job.emission) & (dr.max(throughput) > 0)
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
        escaped = go_on & ~hit & sky_on
        value = mi.Vector3f(0)
        if escaped:
            mapped = sky.pdf(d, escaped)
            share = dr.select(mapped > 0, reflected / (reflected + mapped), 1)
            value = throughput * sky.radiance(d, escaped) * share
        sums = film.add_light(sums, place, film.sky_layer, depth > 1, value, escaped)

        face, uv, distance = mi.UInt32(found.prim_index), mi.Point2f(found.prim_uv), mi.Float(found.t)
        active = hit & ((depth < max_depth) | job.emission)

    film.add_sums(sums, place, covered)
    if dr.hint(film.aovs, mode="scalar"):
        film.add_openness(pixel, sunlit, unoccluded, covered)
