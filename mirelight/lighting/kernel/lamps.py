"""The lights of the table at a vertex: which are looked at, and what they bring.

The list of a point is cut into runs of neighbours, one for each shadow ray, and of each run one light is drawn by what
it would bring if nothing stood between (resampled importance sampling with a weighted reservoir; Talbot et al. 2005).
"""

from __future__ import annotations

from typing import NamedTuple

import drjit as dr
import mitsuba as mi

from mirelight.lighting.grid import FIRST_WEIGHED, LATER_WEIGHED
from mirelight.lighting.kernel import lights as punctual
from mirelight.lighting.kernel.film import Film, PathSums
from mirelight.lighting.kernel.lights import LightSet
from mirelight.lighting.kernel.proxy import DeviceProxy
from mirelight.lighting.kernel.rays import bounded_ray
from mirelight.lighting.kernel.samples import mix, number
from mirelight.lighting.kernel.scatter import Gloss
from mirelight.lighting.kernel.see_through import tinted
from mirelight.lighting.kernel.types import Bool, Float, UInt32, Vector3f
from mirelight.lighting.kernel.vertex import Arrival, Vertex


class _Candidates(NamedTuple):
    """The lights that reach a point: the brightest are all weighed, of the others some that are drawn."""

    start: UInt32  # of the point's list in the set's
    listed: UInt32  # lights in it
    near: UInt32  # of those, how many are surely weighed: the first, which are the brightest
    count: UInt32  # how many are weighed in all
    stretch: Float  # lights that one drawn from the others stands for


class _Chosen(NamedTuple):
    """The light that was drawn from a run."""

    light: UInt32
    weight: Float  # its brightness here, unshadowed; 0: none was drawn
    total: Float  # that of its run
    wi: Vector3f  # the way to it
    length: Float  # of the shadow ray
    irradiance: Vector3f


class _Given(NamedTuple):
    """What the lights that reach a vertex are found from: a loop's variables, but for Dr.Jit, which does not look into
    named tuples. An array that it sees and that no turn changes makes it record the loop, and all in it, twice."""

    surface: DeviceProxy
    lights: LightSet
    film: Film
    vertex: Vertex
    candidates: _Candidates
    picks: UInt32  # how many runs
    first_rays: UInt32 | None
    active: Bool


class _Met(NamedTuple):
    """A path whose ray may meet lights."""

    throughput: Vector3f
    active: Bool


class _Again(NamedTuple):
    """A light that is sampled more than once."""

    light: UInt32
    rays: UInt32
    seed: UInt32
    active: Bool


class _Run(NamedTuple):
    """Lights of a list from which one is drawn."""

    lights: LightSet
    candidates: _Candidates
    vertex: Vertex
    rays: UInt32  # samples of the light that its numbers leave room for
    last: UInt32  # the run's end


@dr.syntax
def add_lamps(
    surface: DeviceProxy,
    lights: LightSet,
    film: Film,
    vertex: Vertex,
    sums: PathSums,
    sunlit: Float,
    first_rays: UInt32,
    active: Bool,
) -> tuple[PathSums, Float]:
    """Next event estimation: the lights that reach a vertex, in as many runs as picks.

    Args:
        first_rays: to a light with an extent that has a run of its own, at a first hit; None: one.

    Returns:
        the path's sums; the share of the suns' light that its first hit sees.
    """
    candidates = _candidates(lights, vertex, active)
    picks = dr.minimum(candidates.count, lights.picks(vertex.depth))
    given = _Given(surface, lights, film, vertex, candidates, picks, first_rays, active)
    pick, entry = mi.UInt32(0), mi.UInt32(0)
    while given.active & (pick < given.picks):
        entry, sums, sunlit = _add_run(given, pick, entry, sums, sunlit)
        pick += 1
    return sums, sunlit


def _add_run(
    given: _Given, pick: UInt32, entry: UInt32, sums: PathSums, sunlit: Float
) -> tuple[UInt32, PathSums, Float]:
    """The light that stands for one run of the list: (the end of the run, as `add_lamps`)."""
    surface, lights, film, vertex, candidates, picks, first_rays, active = given
    last = mi.UInt32(mi.Float((pick + 1) * candidates.count) / mi.Float(picks))
    own_light, rays = mi.UInt32(0), mi.UInt32(1)
    if first_rays is not None:
        own_light = dr.gather(mi.UInt32, lights.items, candidates.start + entry, active)
        own_run = (entry + 1 == last) & (candidates.listed <= _weighed(vertex)) & lights.extended(own_light)
        rays = dr.select(own_run & ~vertex.indirect, first_rays, 1)
    chosen, entry = _draw(lights, candidates, vertex, entry, last, rays)
    lit = active & (chosen.weight > 0)
    ray = bounded_ray(vertex.at.start, chosen.wi, chosen.length)
    reached, tint = surface.reached(ray, lit, coherent=~vertex.indirect)
    lit &= reached
    light = chosen.light
    brought = tinted(_reflected(lights, vertex, light, chosen.wi, chosen.irradiance), tint)
    arrived = dr.select(lit, vertex.weight * brought * (chosen.total / chosen.weight), 0)
    seen = dr.select(lit, chosen.total / chosen.weight, 0)
    if first_rays is not None:
        arrived, seen = _sample_again(surface, lights, vertex, own_light, rays, arrived, seen, active)
        light = dr.select(rays > 1, own_light, light)
        arrived, seen = arrived / mi.Float(rays), seen / mi.Float(rays)
    lit = seen > 0
    layer = dr.gather(mi.UInt32, lights.layer_of_light, light, lit)
    sums = film.add_light(sums, vertex.place, layer, vertex.indirect, arrived, lit)
    if film.aovs:
        sun = dr.gather(mi.Float, lights.sun_shares, light, lit)
        sunlit += dr.select(lit & ~vertex.indirect, sun * seen, 0)
    return entry, sums, sunlit


def _reflected(lights: LightSet, vertex: Vertex, light: UInt32, wi: Vector3f, irradiance: Vector3f) -> Vector3f:
    """Irradiance times what of the BRDF the vertex' weight has not; on an object weighted against its being met."""
    if vertex.gloss is None:
        return irradiance
    return _weighed_off(lights, vertex, vertex.gloss, light, wi, irradiance)


@dr.syntax
def _weighed_off(
    lights: LightSet, vertex: Vertex, gloss: Gloss, light: UInt32, wi: Vector3f, irradiance: Vector3f
) -> Vector3f:
    """As `_reflected`."""
    value, pdf = gloss.towards(wi)
    if gloss.on:
        _, _, drawn = punctual.met(lights.table, light, vertex.at.p, wi)
        irradiance = irradiance * dr.select(drawn > 0, drawn / (drawn + pdf), 1)
    return irradiance * value


@dr.syntax
def add_lamps_met(
    lights: LightSet,
    film: Film,
    vertex: Vertex,
    came: Arrival,
    throughput: Vector3f,
    sums: PathSums,
    active: Bool,
) -> PathSums:
    """The lights with an extent that a ray meets which an object has reflected, nearer than the surface that it hits.

    Args:
        came: the ray; its distance is infinite where it hits nothing.
        throughput: with the reflection.
    """
    light, of = mi.UInt32(0), _Met(throughput, active)
    while of.active & (light < lights.count):
        distance, radiance, drawn = punctual.met(lights.table, light, vertex.at.p, came.d)
        here = of.active & (drawn > 0) & (distance * punctual.SHADOW_END <= came.distance)
        share = came.pdf / (came.pdf + drawn)
        layer = dr.gather(mi.UInt32, lights.layer_of_light, light, here)
        value = dr.select(here, of.throughput * radiance * share, 0)
        sums = film.add_light(sums, vertex.place, layer, vertex.indirect, value, here)
        light += 1
    return sums


def _weighed(vertex: Vertex) -> UInt32:
    """How many lights of a list are weighed at most."""
    return dr.select(vertex.indirect, mi.UInt32(LATER_WEIGHED), mi.UInt32(FIRST_WEIGHED))


def _candidates(lights: LightSet, vertex: Vertex, active: Bool) -> _Candidates:
    start, listed = lights.list_at(vertex.at.p, active)
    weighed = _weighed(vertex)
    near = dr.select(listed > weighed, weighed // 2, listed)
    stretch = mi.Float(listed - near) / mi.Float(weighed - weighed // 2)
    return _Candidates(start, listed, near, dr.minimum(listed, weighed), stretch)


@dr.syntax
def _draw(
    lights: LightSet, candidates: _Candidates, vertex: Vertex, entry: UInt32, last: UInt32, rays: UInt32
) -> tuple[_Chosen, UInt32]:
    """(one light of the run from `entry` to `last`, drawn by a weighted reservoir of one; the end of the run).

    `rays`: how many samples of the light its numbers must leave room for.
    """
    run = _Run(lights, candidates, vertex, rays, last)
    best = mi.UInt32(0), mi.Float(0), mi.Float(0), mi.Vector3f(0), mi.Float(0), mi.Vector3f(0)
    while entry < run.last:
        best = _of_both(run, entry, _Chosen(*best))
        entry += 1
    return _Chosen(*best), entry


@dr.syntax
def _of_both(run: _Run, entry: UInt32, best: _Chosen) -> tuple[UInt32, Float, Float, Vector3f, Float, Vector3f]:
    """As `_Chosen`: the light at `entry` or the best so far, by chance as each is bright; and the sum of both."""
    lights, candidates, vertex, rays, _ = run
    own = mix(vertex.salt, entry + 16)
    beyond = entry >= candidates.near
    index = mi.UInt32(entry)
    if beyond:
        drawn = number(vertex.sample, mix(own, 1))
        index = mi.UInt32((mi.Float(entry - candidates.near) + drawn) * candidates.stretch)
        index = candidates.near + dr.minimum(index, candidates.listed - candidates.near - 1)
    this = dr.gather(mi.UInt32, lights.items, candidates.start + index)
    seed = mix(vertex.salt, dr.gather(mi.UInt32, lights.seeds, this))
    numbers = vertex.sample * rays
    wi, length, irradiance = punctual.sample(lights.table, this, vertex.at.p, vertex.at.normal, numbers, seed)
    w = (irradiance.x + irradiance.y + irradiance.z) / 3
    share = dr.select(beyond, w * candidates.stretch, w)
    total = best.total + share
    take = number(vertex.sample, own) * total < share
    light, weight = dr.select(take, this, best.light), dr.select(take, w, best.weight)
    wi, length = dr.select(take, wi, best.wi), dr.select(take, length, best.length)
    return light, weight, total, wi, length, dr.select(take, irradiance, best.irradiance)


@dr.syntax
def _sample_again(
    surface: DeviceProxy,
    lights: LightSet,
    vertex: Vertex,
    light: UInt32,
    rays: UInt32,
    arrived: Vector3f,
    seen: Float,
    active: Bool,
) -> tuple[Vector3f, Float]:
    """(what a light brings, how many samples see it) with its samples after the first added."""
    of = _Again(light, rays, mix(vertex.salt, dr.gather(mi.UInt32, lights.seeds, light)), active)
    k = mi.UInt32(1)
    while k < of.rays:
        ray = vertex.sample * of.rays + k
        wi, length, irradiance = punctual.sample(lights.table, of.light, vertex.at.p, vertex.at.normal, ray, of.seed)
        lit = of.active & (dr.max(irradiance) > 0)
        reached, tint = surface.reached(bounded_ray(vertex.at.start, wi, length), lit, coherent=True)
        lit &= reached
        arrived += dr.select(lit, vertex.weight * tinted(_reflected(lights, vertex, of.light, wi, irradiance), tint), 0)
        seen += dr.select(lit, 1, 0)
        k += 1
    return arrived, seen
