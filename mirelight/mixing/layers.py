"""The layers of a job's mixer: what each unit light does to each splat, and what its lightings take of them.

A layer is what the relight mode makes of a unit light alone. In mode `ratio` that is T = L / (L_captured + d m), L the
light's irradiance over pi, and a base d m / (L_captured + d m) beside them: the sum of weights times layers is then the
factor. Modes `tint` (brightness a L) and `albedo` have no base.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from mirelight import colour, keys, relighting
from mirelight.errors import InputError
from mirelight.lighting import splat_light
from mirelight.lighting.fill import rounds_of
from mirelight.lighting.layers import MAX_LAYERS
from mirelight.lighting.points import own_glow
from mirelight.model import F32, F64, Job, Lighting, SplatCloud, SurfaceCells, rules_of
from mirelight.model.lights import position_of
from mirelight.scene import Scene
from mirelight.sh import C0
from mirelight.units import GLOW, LightSet, LightSets, Rules, Unit, terms

BASE, EMISSION = "base", "emission"
MOST_LAYERS = 32  # the page's shader reads four from a texture, and beside them up to seven textures of the splats
FEWEST_PATHS = 1 << 18  # below, light is traced: cells are not even looked for
READS = 2  # where indirect light is read, one in so many samples is enough for the direct light that is left
_MANY = 1 << 30
_UNLIMITED = 1e30

Progress = Callable[[str, int, int], None]  # what is traced; paths done, paths in all


@dataclass(frozen=True, slots=True, eq=False)
class Fader:
    """What a lighting has of a layer."""

    layer: int
    name: str
    weight: F64  # (3,) colour times intensity
    factor: F64  # (3,) of the job's `mix`


@dataclass(frozen=True, slots=True, eq=False)
class Handle:
    """A light of a lighting that is somewhere."""

    name: str
    layer: int
    light: int  # of the layer's unit light
    position: F64  # (3,) world space


@dataclass(frozen=True, slots=True, eq=False)
class Mixed:
    """A lighting of the job."""

    name: str
    faders: tuple[Fader, ...]
    handles: tuple[Handle, ...]


@dataclass(frozen=True, slots=True, eq=False)
class MixLayers:
    """L layers on N splats."""

    names: tuple[str, ...]
    values: F32  # (L, N, 3) linear factors of the captured colour at weight 1
    constant: tuple[int, ...]  # layers that every lighting has at weight 1
    lightings: tuple[Mixed, ...]
    limit: float | None  # of the sum
    near: float  # share of splats that lie on the proxy
    units: tuple[Unit, ...]  # what each of the first layers is the light of
    layer_of: Callable[[F32], F32]  # (N, 3) irradiance / pi of a unit light -> (N, 3) its layer

    def weights(self, lighting: int) -> F64:
        """(L, 3) of a lighting as the job has it."""
        out = np.zeros((len(self.names), 3))
        out[list(self.constant)] = 1
        for fader in self.lightings[lighting].faders:
            out[fader.layer] += fader.weight * fader.factor
        return out

    def factor(self, weights: F64) -> F32:
        """(N, 3) by which the splats' linear colour is multiplied."""
        total = np.einsum("lnc,lc->nc", self.values.astype(np.float64), weights)
        return np.asarray(total if self.limit is None else np.minimum(total, self.limit), dtype=np.float32)


def check(job: Job) -> None:
    """Raises InputError, in one line, where a job has nothing to mix."""
    if job.splats is None:
        raise InputError(job.source, "no splats", "name a capture: the mixer shows its light on splats", field="splats")
    if job.proxy is None:
        raise InputError(job.source, "no proxy mesh for light to fall on", "name a proxy", field="proxy")
    if not job.lightings:
        raise InputError(job.source, "no light", "name lights or an environment to mix", field="lights")
    if not rules_of(job.render.profile).path_traced:
        raise InputError(
            job.source,
            "the profile playcanvas, whose light is not traced",
            "use profile physical, or mirelight realtime for the engine's own light",
            field="profile",
        )


def make(scene: Scene, *, spp: int, lightings: tuple[Lighting, ...], progress: Progress | None = None) -> MixLayers:
    """Trace what is not kept, and divide by the captured light.

    Args:
        scene: of a job that :func:`check` lets through.
        spp: samples a splat.
        lightings: those of the job to mix, in their order.
        progress: hears what is traced.

    Raises:
        InputError: more layers than the page can hold.
        RenderError: no splat lies on the proxy.
        BackendError: the variant cannot be used on this machine.
    """
    job = scene.job
    assert scene.splats is not None and scene.proxy is not None
    plain = tuple(replace(x, mix=()) for x in lightings)
    compares = keys.compares(job) and job.captured is not None
    units = {t.unit.digest: t.unit for x in plain for t in terms(x)}
    index = {key: i for i, key in enumerate(units)}
    names = [_layer_name(key, plain) for key in units]
    mode = relighting.mode_of(job.relight)
    floor = mode.leaves_floor and compares
    extra = [EMISSION] * scene.glows + [BASE] * floor
    if len(names) + len(extra) > MOST_LAYERS:
        raise InputError(
            job.source,
            f"{len(names) + len(extra)} layers of light",
            f"give lights a group, or choose lightings: the page holds {MOST_LAYERS}",
            field="lights",
        )
    rules = Rules(linear=True, most_lights=_MANY, most_layers=_MANY, suns_apart=False)
    captured = (job.captured,) if compares and job.captured is not None else ()
    if captured and len(list(terms(captured[0]))) > MAX_LAYERS:
        raise InputError(
            job.source,
            f"more than {MAX_LAYERS} lights in the captured lighting",
            "give them a group",
            field="captured",
        )
    sets = LightSets((*plain, *captured), rules)
    splats = OnSplats(scene, spp, progress)
    values = np.zeros((len(names) + len(extra), len(scene.splats), 3), np.float32)
    old = np.zeros((len(scene.splats), 3), np.float64)
    every = {s.digest: s for x in (*plain, *captured) for s in sets.mixture(x).sets}
    taken = {t.unit.digest: t.weight for x in captured for t in terms(x)}
    for number, one in enumerate(every.values()):
        light = splats.light(one, f"set {number + 1} of {len(every)}")
        for k, unit in enumerate(one.units):
            if unit.digest in index:
                values[index[unit.digest]] = light[k]
            if unit.digest in taken:
                old += light[k] * taken[unit.digest]
    if scene.glows:
        glow = splats.light(GLOW, "surfaces that glow")[0]
        values[len(names)] = glow
        old += glow
    factor = relighting.splat_relighter(
        captured_color(scene.splats),
        splats.albedo,
        replace(job.relight, max_ratio=_UNLIMITED),
        captured=old.astype(np.float32) if compares else None,
        captured_level=(scene.captured_level or 0.0) if compares else None,
    )
    base = factor(np.zeros_like(values[0]))

    def layer_of(light: F32) -> F32:
        return np.asarray(factor(light) - base, np.float32)

    for k in range(len(values) - floor):
        values[k] = layer_of(values[k])
    if floor:
        values[-1] = base
    return MixLayers(
        names=(*names, *extra),
        values=values,
        constant=tuple(range(len(names), len(names) + len(extra))),
        lightings=tuple(_mixed(x, index) for x in lightings),
        limit=job.relight.max_ratio if compares and "max_ratio" in mode.reads else None,
        near=splats.near,
        units=tuple(units.values()),
        layer_of=layer_of,
    )


def captured_color(splats: SplatCloud) -> F32:
    """(N, 3) the splats' colours averaged over directions, linear."""
    return np.asarray(colour.srgb_decode(np.maximum(0.5 + C0 * splats.sh[:, 0], 0)), np.float32)


def _mixed(lighting: Lighting, index: dict[str, int]) -> Mixed:
    factors = lighting.factors()
    one = np.ones(3)
    faders = [
        Fader(index[t.unit.digest], t.layer, t.weight, factors.get(t.layer, one))
        for t in terms(replace(lighting, mix=()))
    ]
    return Mixed(lighting.name, tuple(faders), tuple(_handles(lighting, faders)))


def _handles(lighting: Lighting, faders: list[Fader]) -> Iterator[Handle]:
    layers = {x.name: x.layer for x in faders}
    seen: Counter[str] = Counter()
    for light in lighting.lights:
        name = light.group or light.name
        place = position_of(light)
        if place is not None:
            yield Handle(light.name, layers[name], seen[name], place)
        seen[name] += 1


def _layer_name(unit: str, lightings: tuple[Lighting, ...]) -> str:
    return next(t.layer for x in lightings for t in terms(x) if t.unit.digest == unit)


class OnSplats:
    """Sets of unit lights on the splats: kept, or traced now.

    Args:
        scene: of a job that :func:`check` lets through.
        spp: samples a splat.
        progress: hears what is traced; what it raises ends the tracing.
    """

    def __init__(self, scene: Scene, spp: int, progress: Progress | None) -> None:
        self._scene, self._spp, self._progress = scene, spp, progress
        job = scene.job
        assert scene.proxy is not None and scene.splats is not None
        self.tracer = splat_light.tracer_for(scene.proxy, job.render)
        kept = scene.kept.array(scene.keys.splat_places)
        count = len(scene.splats)
        if kept is None or kept.shape != (2 * count + 1, 3):
            self._say("where splats lie", 0, 1)
            reference = scene.resolved(job.captured) if job.captured is not None else None
            places = splat_light.places_of(scene.splats, scene.proxy, self.tracer, reference)
            kept = np.concatenate([places.points, places.normals, np.full((1, 3), places.near)])
            scene.kept.keep_array(scene.keys.splat_places, kept)
        self.places = splat_light.Places(
            np.asarray(kept[:count], np.float64), np.asarray(kept[count:-1], np.float64), float(kept[-1, 0])
        )
        self.near = self.places.near
        self.albedo: F32 = np.ones((count, 3), np.float32)

    def with_samples(self, spp: int) -> OnSplats:
        """The same splats with other samples."""
        out = copy(self)
        out._spp = spp
        return out

    def light(self, one: LightSet, what: str) -> F32:
        """(units, N, 3) irradiance / pi; of GLOW one.

        Args:
            one: the set.
            what: it is called.
        """
        key = self._scene.keys.splat_light(one, self._spp)
        kept = self._scene.kept.array(key)
        layers = [EMISSION] if one.glow else [str(i) for i in range(len(one.units))]
        count = len(self.places.points)
        if kept is None or kept.shape != (len(layers) + 1, count, 3):
            kept = np.stack([*self._traced(one, layers, what), self._materials[0]])
            self._scene.kept.keep_array(key, kept)
        self.albedo = kept[-1]
        return kept[:-1]

    def unit_light(self, unit: Unit) -> F32:
        """(N, 3) irradiance / pi of one unit light, as it may be for a moment: it is not kept."""
        return next(self._traced(LightSet((unit,)), ["0"], ""))

    def _traced(self, one: LightSet, layers: list[str], what: str) -> Iterator[F32]:
        points, normals = self.places.points, self.places.normals
        lighting, tracer = self._scene.lighting_of(one), self.tracer
        say = partial(self._say, what)
        cache, spp = None, self._spp
        if self._reads_surface:
            cache = tracer.fill(self._cells, lighting, samples=spp, emission=one.glow, progress=say)
            spp = max(spp // READS, 1)
        made = tracer.point_layers(lighting, points, normals, spp, emission=one.glow, cache=cache, progress=say)
        for name in layers:
            k = made.names.index(name)
            light = (made.direct[k] + made.indirect[k]) * np.float32(1 / np.pi)
            yield light + self._materials[1] if one.glow else light

    @cached_property
    def _materials(self) -> tuple[F32, F32]:
        """(N, 3) albedo; (N, 3) what the places send out themselves over it."""
        points, normals = self.places.points, self.places.normals
        albedo, _ = self.tracer.materials_at(points, normals)
        return albedo, own_glow(self.tracer, points, normals)

    @cached_property
    def _cells(self) -> SurfaceCells:
        return self.tracer.cells_at(self.places.points, self.places.normals)

    @property
    def _reads_surface(self) -> bool:
        """Whether indirect light is gathered on the surface first: where that is less work than paths from splats."""
        paths = len(self.places.points) * self._spp
        if self._scene.job.render.max_depth == 1 or paths <= FEWEST_PATHS:
            return False
        return paths > len(self._cells) * sum(rounds_of(self._spp))

    def _say(self, what: str, done: int, total: int) -> None:
        if self._progress is not None:
            self._progress(what, done, total)
