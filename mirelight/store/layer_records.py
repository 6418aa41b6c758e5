"""The index of a job's layers, from the job alone: nothing is read or made for it. And what it names besides layers:
the maps and suns of environments and skies, so that a data set holds them, too."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from mirelight import relighting
from mirelight.model import F32, Camera, Environment, Light, Lighting, SkyModel, SunLight
from mirelight.model.lights import SKY, SUN, EstimatedSky
from mirelight.model.unit_lights import GLOW, LightSet, Unit
from mirelight.pipeline import keys, requirements
from mirelight.pipeline import plan as planning
from mirelight.pipeline.artefact_cache import ArtefactCache
from mirelight.pipeline.codecs import ARRAY
from mirelight.pipeline.plan import Plan
from mirelight.pipeline.requirements import Arrangement as Objects
from mirelight.relighting.surroundings import shrunk
from mirelight.store.layer_index import Around, Arrangement, Index, KeptObject, KeptSight, KeptView, UnitLight, Weighted


def describe(plan: Plan) -> Index:
    """What all of the job's cameras and lightings are kept as, whatever the plan has chosen."""
    job = plan.job
    if len(plan.groups) < len(job.cameras) or len(plan.groups[0].tasks) < len(job.lightings):
        plan = planning.plan(job)
    made = plan.keys
    known = _Units(made)
    lightings = tuple(known.weighted(x) for x in job.lightings)
    compared = requirements.compared(job)
    captured = None if compared is None else known.weighted(compared, bare=True)
    shiny = [x for x in job.lightings if relighting.adds_lobes(job.relight_of(x))]
    lobes = {s.digest for x in requirements.with_compared(job, shiny) for s in made.mixture(x).sets} if shiny else set()
    views: list[KeptView] = []
    for group in plan.groups:
        camera = group.camera
        seen = relighting.lighting_camera(camera, job.relight)
        views.append(
            KeptView(
                camera=camera,
                light_size=(seen.height, seen.width),
                composite=None if job.splats is None else made.composite(camera),
                groups=tuple(made.light_with_objects(one, seen, objects) for objects, one in known.sets.values()),
                captured_glow=made.light(GLOW, seen),
                sights=tuple(_sight(made, camera, objects) for objects in known.arrangements),
                mirrored=tuple(
                    made.light_of_lobes(one, seen) if one.digest in lobes else None for _, one in known.sets.values()
                )
                if lobes
                else (),
                mirrored_glow=made.light_of_lobes(GLOW, seen) if lobes else None,
                bare=tuple(made.light(one, seen) for _, one in known.sets.values())
                if requirements.wants_shadow(job)
                else (),
            )
        )
    return Index(
        job=job.source.name,
        views=tuple(views),
        units=tuple(known.units),
        lightings=lightings,
        captured=captured,
        captured_level=made.captured_level if captured is not None else None,
        relight=job.relight,
        display=job.display,
        denoised=job.render.denoise,
        profile=job.compositor.profile,
        linear=job.compositor.holds_light,
        arrangements=tuple(_arrangement(made, x, known.first.get(id(x), 0)) for x in known.arrangements),
        painted=bool(job.masks),
    )


def _arrangement(made: keys.Keys, objects: Objects, first: int) -> Arrangement:
    """What is known of objects in their places, which a set of an index shows."""
    named = tuple(KeptObject(x.name, x.category or x.name) for x in objects)
    return Arrangement(named, made.object_boxes(objects) if objects else None, first)


def _sight(made: keys.Keys, camera: Camera, objects: Objects) -> KeptSight:
    """What a camera sees of objects in their places."""
    seen = relighting.lighting_camera(camera, made.job.relight)
    glow = made.light_with_objects(GLOW, seen, objects)
    if not objects:
        return KeptSight(glow)
    front = None if made.job.splats is None else made.in_front(camera, objects)
    return KeptSight(glow, front, made.object_matte(camera, objects))


class _Units:
    """The unit lights of a job, in the order in which lightings name them."""

    def __init__(self, made: keys.Keys) -> None:
        self._made = made
        self.sets: dict[str, tuple[Objects, LightSet]] = {}  # and the objects that it is traced with
        self.arrangements = requirements.arrangements(made.job)
        self.first: dict[int, int] = {}  # index of a set that is traced with an arrangement, by its id
        self._numbers = {id(x): i for i, x in enumerate(self.arrangements)}
        self._order: dict[str, int] = {}  # of the sets
        self.units: list[UnitLight] = []
        self._places: dict[str, int] = {}  # of units, by digest
        self._names: dict[str, int] = {}

    def weighted(self, lighting: Lighting, *, bare: bool = False) -> Weighted:
        """`bare`: traced without objects, though there may be some."""
        objects = () if bare else self._made.job.objects_of(lighting)
        arrangement = 0 if bare else self._numbers[id(objects)]
        mixture, apart = self._made.mixture(lighting), f"{arrangement} " if objects else ""
        for one in mixture.sets:
            self.sets.setdefault(f"{apart}{one.digest}", (objects, one))
            self._order.setdefault(f"{apart}{one.digest}", len(self._order))
        groups = {one.digest: self._order[f"{apart}{one.digest}"] for one in mixture.sets}
        first = mixture.sets[0]
        if not bare:
            self.first.setdefault(id(objects), groups[first.digest])
        if first.whole is not None:
            place = self._place(f"{apart}{first.digest}", lighting.name, "whole", groups[first.digest], "", first.whole)
            own, white = (groups[first.digest],), ((1.0, 1.0, 1.0),)
            return Weighted(lighting.name, own, (place,), white, lighting.relight, arrangement)
        places: list[int] = []
        for term in mixture.terms:
            home = mixture.home(term.unit)
            layer = home.layer_of(term.unit) or ""
            places.append(
                self._place(
                    f"{apart}{term.unit.digest}", term.layer, _kind(term.unit), groups[home.digest], layer, term.unit
                )
            )
        weights = tuple((float(t.weight[0]), float(t.weight[1]), float(t.weight[2])) for t in mixture.terms)
        return Weighted(lighting.name, tuple(groups.values()), tuple(places), weights, lighting.relight, arrangement)

    def _place(self, digest: str, name: str, kind: str, group: int, layer: str, of: Unit | Lighting) -> int:
        if digest not in self._places:
            self._places[digest] = len(self.units)
            count = self._names[name] = self._names.get(name, 0) + 1
            own = name if count == 1 else f"{name}-{count}"
            around = tuple(key for key, _ in _around(of, self._made))
            self.units.append(UnitLight(own, kind, _shining(of), group, layer, around))
        return self._places[digest]


def _kind(unit: Unit) -> str:
    if unit.environment is not None:
        return "environment"
    if unit.sky is not None:
        return "sun" if unit.part == "sun" else "sky"
    return unit.lights[0].KIND.layer if len(unit.lights) == 1 else "group"


# --- light from far away ---------------------------------------------------------------------------------------------

_Source = Environment | tuple[SkyModel | EstimatedSky, str]  # a picture, or the sun or the sky of a model


def keep_around(plan: Plan, kept: ArtefactCache, resolved: Callable[[Lighting], Lighting]) -> None:
    """Keep the maps and suns that the index names and that are not there yet.

    Args:
        plan: of the job.
        kept: where to.
        resolved: gives a lighting with a sun and a map in place of its sky model, see `mirelight.pipeline.scene.Scene`.
    """
    for lighting in requirements.with_compared(plan.job, plan.job.lightings):
        mixture = plan.keys.mixture(lighting)
        whole = mixture.sets[0].whole
        for of in [whole] if whole is not None else [term.unit for term in mixture.terms]:
            for around, source in _around(of, plan.keys):
                if not kept.has(around.key, ARRAY):
                    kept.put(around.key, _values(source, resolved), ARRAY)


def _shining(of: Unit | Lighting) -> tuple[Light, ...]:
    """Its lights, with what is said of them in `mix`."""
    if isinstance(of, Unit) or not of.mix:
        return of.lights
    factors = of.factors()
    return tuple(replace(x, color=x.color * factors.get(x.group or x.name, 1.0)) for x in of.lights)


def _around(of: Unit | Lighting, made: keys.Keys) -> list[tuple[Around, _Source]]:
    """What is kept of a unit's light from far away, and what it is made from; with what is said of it in `mix`."""
    factors = {} if isinstance(of, Unit) else of.factors()

    def color(layer: str) -> tuple[float, float, float]:
        red, green, blue = (float(x) for x in factors.get(layer, np.ones(3)))
        return red, green, blue

    out: list[tuple[Around, _Source]] = []
    if of.environment is not None:
        around = of.environment
        own = Around(made.map_of(around), around.rotation, around.intensity, color(around.name))
        out.append((own, around))
    if of.sky is not None:
        parts = (of.part,) if isinstance(of, Unit) else (SUN, SKY)
        ground = None
        if isinstance(of.sky, SkyModel):
            red, green, blue = (float(x) for x in of.sky.albedo)
            ground = red, green, blue
        kept = ((Around(made.sky_of(of.sky, x), color=color(x), ground=ground), (of.sky, x)) for x in parts)
        out += kept
    return out


def _values(source: _Source, resolved: Callable[[Lighting], Lighting]) -> F32:
    if isinstance(source, Environment):
        return shrunk(source.pixels)
    model, part = source
    lighting = resolved(Lighting(sky=model))
    if part == SKY:
        around = lighting.environment
        assert around is not None
        return shrunk(around.pixels * np.float32(around.intensity))
    suns = [x for x in lighting.lights if isinstance(x, SunLight)]
    rows = [[*x.direction, *(x.color * x.intensity), x.angular_diameter] for x in suns]
    return np.array(rows, dtype=np.float32).reshape(-1, 7)
