"""Lightings as weights over unit lights.

Light adds up, so a lamp is traced once, white and of intensity 1, and every lighting that holds it takes that layer
times the lamp's own colour and intensity. Unit lights that first appear in one lighting are traced together as one set,
for they share paths; later lightings add sets of what is new in them. A job that grows at its end changes no earlier
set.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from mirelight.model import (
    F64,
    Environment,
    EstimatedSky,
    Light,
    Lighting,
    ParallelLight,
    SkyModel,
    digest,
)
from mirelight.model.lights import SKY, SUN

_WHITE = np.ones(3)


@dataclass(frozen=True, eq=False)
class Unit:
    """Light with a layer of its own, at unit strength: a lamp or sun, a group of them, an environment, a half of a sky
    model. Lights of a group keep their strengths, which are part of what they are."""

    lights: tuple[Light, ...] = ()
    environment: Environment | None = None
    sky: SkyModel | EstimatedSky | None = None
    part: str = ""  # SUN or SKY: of the sky model

    @cached_property
    def digest(self) -> str:
        """SHA-256; equal ones give the same light."""
        return digest(self.lights, self.environment, self.sky, self.part)

    @property
    def has_sun(self) -> bool:
        """True where sun visibility counts it."""
        return self.part == SUN or any(isinstance(x, ParallelLight) for x in self.lights)


@dataclass(frozen=True, eq=False)
class Term:
    """What a lighting takes of a unit light."""

    layer: str  # the layer's name in the lighting
    unit: Unit
    weight: F64  # (3,) linear: colour times intensity


@dataclass(frozen=True, eq=False)
class LightSet:
    """Unit lights that are traced together, or a lighting that must be traced as it is; with neither, geometry."""

    units: tuple[Unit, ...] = ()
    whole: Lighting | None = None
    glow: bool = False  # the light that the proxy's own surfaces send out, and nothing else

    @cached_property
    def digest(self) -> str:
        """SHA-256 over all of the light in it."""
        return digest([u.digest for u in self.units], self.whole, self.glow)

    @property
    def layers(self) -> int:
        """How many layers its traced buffer has."""
        return len(self.units) if self.whole is None else len(self.whole.layer_names)

    def parts(self) -> Iterator[LightSet]:
        """What of its light on a surface is kept by itself: each unit light, or all of what is traced as it is."""
        if self.whole is not None or self.glow:
            yield self
        else:
            yield from (LightSet((unit,)) for unit in self.units)

    def layer_of(self, unit: Unit) -> str | None:
        """The name of a unit's layer in the traced buffer; None where it is not in this set."""
        return next((str(i) for i, own in enumerate(self.units) if own.digest == unit.digest), None)

    def as_lighting(self, resolved: Callable[[Lighting], Lighting]) -> Lighting:
        """What to trace: the lights of each unit in a layer named by its index. `resolved` turns a sky model into a sun
        and a map."""
        if self.whole is not None:
            return resolved(self.whole)
        lights: list[Light] = []
        around: Environment | None = None
        for i, unit in enumerate(self.units):
            own, environment = unit.lights, unit.environment
            if unit.sky is not None:
                sky = resolved(Lighting(sky=unit.sky))
                own, environment = (sky.lights, None) if unit.part == SUN else ((), sky.environment)
            if environment is not None:
                around = replace(environment, name=str(i))
            shared = str(i) if len(own) > 1 else None
            lights += [replace(x, name=f"{i}.{k}" if shared else str(i), group=shared) for k, x in enumerate(own)]
        return Lighting(name=self.digest[:12], lights=tuple(lights), environment=around)


GLOW = LightSet(glow=True)


@dataclass(frozen=True, eq=False)
class Mixture:
    """How a lighting is made of traced sets."""

    lighting: Lighting
    sets: tuple[LightSet, ...]  # at least one; the first one gives geometry, too
    terms: tuple[Term, ...] = ()  # none where its set is the whole lighting

    @cached_property
    def digest(self) -> str:
        """SHA-256 over sets and weights, not over names."""
        return digest([s.digest for s in self.sets], [(t.unit.digest, t.weight) for t in self.terms])

    def home(self, unit: Unit) -> LightSet:
        """The set that one of its unit lights is traced in."""
        return next(s for s in self.sets if s.layer_of(unit) is not None)


@dataclass(frozen=True, slots=True)
class Rules:
    """Which lightings may be mixed, and how finely they are split."""

    linear: bool  # light may be traced at unit strength: nothing in the pass depends on how strong it is
    most_lights: int  # more of them are sampled by their strength, and so are not linear
    most_layers: int
    suns_apart: bool  # sun visibility is wanted: it is the mean over suns by strength, so each needs a set of its own


ALIKE = Rules(linear=True, most_lights=1 << 30, most_layers=1 << 30, suns_apart=False)  # on splats, any number


class LightSets:
    """The sets of a job, found once from its lightings in their order."""

    def __init__(self, lightings: Iterable[Lighting], rules: Rules, pooled: Iterable[Lighting] = ()) -> None:
        """`pooled`: lightings whose unit lights are put together, as many as may share paths, before any other."""
        self._rules = rules
        self._home: dict[str, LightSet] = {}  # set of each unit, by the unit's digest
        self._known: dict[int, Mixture] = {}
        self._lightings = tuple(lightings)  # keeps them alive: they are known by identity
        self._pooled = tuple(pooled)
        wanted = {id(x): tuple(terms(x)) for x in (*self._lightings, *self._pooled)}
        pooled_terms = (wanted[id(x)] for x in self._pooled)
        for units in _packs([self._new(x) for x in pooled_terms if self._is_linear(x)], rules):
            self._trace_together(units)
        for lighting in self._lightings:
            self._known[id(lighting)] = self._mixture(lighting, wanted[id(lighting)])

    def mixture(self, lighting: Lighting) -> Mixture:
        """How a lighting is made: one of the job's, or any other, whose new unit lights then form sets of their own."""
        found = self._known.get(id(lighting))
        return found if found is not None else self._with(lighting)._known[id(lighting)]

    def _with(self, lighting: Lighting) -> LightSets:
        return LightSets((*self._lightings, lighting), self._rules, self._pooled)

    def _is_linear(self, wanted: tuple[Term, ...]) -> bool:
        count, rules = sum(len(t.unit.lights) for t in wanted), self._rules
        return rules.linear and count <= rules.most_lights and len(wanted) <= rules.most_layers

    def _new(self, wanted: Iterable[Term]) -> tuple[Unit, ...]:
        return tuple({t.unit.digest: t.unit for t in wanted if t.unit.digest not in self._home}.values())

    def _trace_together(self, units: tuple[Unit, ...]) -> None:
        for part in _split(units, self._rules.suns_apart):
            made = LightSet(part)
            self._home.update({unit.digest: made for unit in part})

    def _mixture(self, lighting: Lighting, wanted: tuple[Term, ...]) -> Mixture:
        if not self._is_linear(wanted):
            return Mixture(lighting, (LightSet(whole=replace(lighting, relight=None, objects=None, time=None)),))
        self._trace_together(self._new(wanted))
        sets = {self._home[t.unit.digest].digest: self._home[t.unit.digest] for t in wanted}
        return Mixture(lighting, tuple(sets.values()) or (LightSet(),), wanted)


def _split(units: tuple[Unit, ...], suns_apart: bool) -> Iterator[tuple[Unit, ...]]:
    suns = [u for u in units if u.has_sun]
    apart = suns[1:] if suns_apart else []
    together = tuple(u for u in units if u not in apart)
    if together:
        yield together
    yield from ((sun,) for sun in apart)


def _packs(wanted: Iterable[tuple[Unit, ...]], rules: Rules) -> Iterator[tuple[Unit, ...]]:
    """Units to trace together, in order: those of one lighting stay together, and a pack is filled before the next."""
    pack: dict[str, Unit] = {}
    done: set[str] = set()
    for units in wanted:
        new = {unit.digest: unit for unit in units if unit.digest not in done}
        if pack and not _fits((pack | new).values(), rules):
            yield tuple(pack.values())
            pack = {}
        pack |= new
        done.update(new)
    if pack:
        yield tuple(pack.values())


def _fits(units: Iterable[Unit], rules: Rules) -> bool:
    """Whether units can share paths: not more lamps than are sampled alike, one environment, one sun where each is
    traced apart."""
    every = tuple(units)
    lamps = sum(len(u.lights) + (u.part == SUN) for u in every)
    around = sum(u.environment is not None or u.part == SKY for u in every)
    suns = sum(u.has_sun for u in every)
    room = lamps <= rules.most_lights and len(every) <= rules.most_layers
    return room and around <= 1 and not (rules.suns_apart and suns > 1)


def terms(lighting: Lighting) -> Iterator[Term]:
    """A term for each layer that the lighting has, in the layers' order; its `mix` is in the weights."""
    factors = lighting.factors()
    for term in _unmixed(lighting):
        yield replace(term, weight=term.weight * factors[term.layer]) if term.layer in factors else term


def may_be_dark(lighting: Lighting) -> list[str]:
    """Names of the layers that need not add anything: those of weight 0, and the sun of an estimate, which may have
    found none."""
    own = {SUN} if isinstance(lighting.sky, EstimatedSky) else set()
    return [x.layer for x in terms(lighting) if x.layer in own or not np.any(x.weight)]


def _unmixed(lighting: Lighting) -> Iterator[Term]:
    for name, lights in _by_layer(lighting.lights).items():
        if len(lights) == 1 and lights[0].group is None:
            (lamp,) = lights
            unit = replace(lamp, name="", color=_WHITE, intensity=1.0)
            yield Term(name, Unit(lights=(unit,)), lamp.color * lamp.intensity)
        else:
            yield Term(name, Unit(lights=tuple(replace(x, name="", group=None) for x in lights)), _WHITE)
    around, sky = lighting.environment, lighting.sky
    if around is not None:
        unit_sky = Unit(environment=replace(around, name="", intensity=1.0))
        yield Term(around.name, unit_sky, _WHITE * around.intensity)
    if sky is not None:
        plain = replace(sky, intensity=1.0)
        for part in (SUN, SKY):
            yield Term(part, Unit(sky=plain, part=part), _WHITE * sky.intensity)


def _by_layer(lights: Iterable[Light]) -> Mapping[str, list[Light]]:
    found: dict[str, list[Light]] = {}
    for light in lights:
        found.setdefault(light.group or light.name, []).append(light)
    return found
