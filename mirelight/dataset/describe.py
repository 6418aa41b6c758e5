"""The index of a job's layers, from the job alone: nothing is read or made for it."""

from __future__ import annotations

from mirelight import keys, relighting
from mirelight import plan as planning
from mirelight.dataset.index import Index, KeptView, UnitLight, Weighted
from mirelight.model import AreaLight, DirectionalLight, Lighting, SunLight
from mirelight.plan import Plan
from mirelight.units import GLOW, LightSet, Unit

_TEXT = {AreaLight: "area", DirectionalLight: "sun", SunLight: "sun"}


def describe(plan: Plan) -> Index:
    """What all of the job's cameras and lightings are kept as, whatever the plan has chosen."""
    job = plan.job
    if len(plan.groups) < len(job.cameras) or len(plan.groups[0].tasks) < len(job.lightings):
        plan = planning.plan(job)
    made = plan.keys
    known = _Units(made)
    lightings = tuple(known.weighted(x) for x in job.lightings)
    compared = job.captured is not None and job.splats is not None and keys.compares(job)
    captured = known.weighted(job.captured) if compared and job.captured is not None else None
    views: list[KeptView] = []
    for group in plan.groups:
        camera = group.camera
        seen = relighting.lighting_camera(camera, job.relight)
        frame = group.tasks[0].name
        lighting = group.tasks[0].lighting
        views.append(
            KeptView(
                camera=camera,
                light_size=(seen.height, seen.width),
                frame=frame if lighting is None else frame[: frame.rfind(".")],
                composite=None if job.splats is None else made.composite(camera),
                groups=tuple(made.light(one, seen) for one in known.sets.values()),
                glow=made.light(GLOW, seen),
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
        linear=job.compositor.blends_linear,
    )


class _Units:
    """The unit lights of a job, in the order in which lightings name them."""

    def __init__(self, made: keys.Keys) -> None:
        self._made = made
        self.sets: dict[str, LightSet] = {}
        self.units: list[UnitLight] = []
        self._places: dict[str, int] = {}  # of units, by digest
        self._names: dict[str, int] = {}

    def weighted(self, lighting: Lighting) -> Weighted:
        mixture = self._made.mixture(lighting)
        order = list(self.sets)
        for one in mixture.sets:
            if one.digest not in self.sets:
                self.sets[one.digest] = one
                order.append(one.digest)
        groups = {one.digest: order.index(one.digest) for one in mixture.sets}
        first = mixture.sets[0]
        if first.whole is not None:
            place = self._place(first.digest, lighting.name, "whole", groups[first.digest], "", None)
            return Weighted(lighting.name, (groups[first.digest],), (place,), ((1.0, 1.0, 1.0),))
        places: list[int] = []
        for term in mixture.terms:
            home = next(s for s in mixture.sets if s.layer_of(term.unit) is not None)
            layer = home.layer_of(term.unit) or ""
            places.append(
                self._place(term.unit.digest, term.layer, _kind(term.unit), groups[home.digest], layer, term.unit)
            )
        weights = tuple((float(t.weight[0]), float(t.weight[1]), float(t.weight[2])) for t in mixture.terms)
        return Weighted(lighting.name, tuple(groups.values()), tuple(places), weights)

    def _place(self, digest: str, name: str, kind: str, group: int, layer: str, unit: Unit | None) -> int:
        if digest not in self._places:
            self._places[digest] = len(self.units)
            count = self._names[name] = self._names.get(name, 0) + 1
            own = name if count == 1 else f"{name}-{count}"
            lights = () if unit is None else unit.lights
            self.units.append(UnitLight(own, kind, lights, group, layer))
        return self._places[digest]


def _kind(unit: Unit) -> str:
    if unit.environment is not None:
        return "environment"
    if unit.sky is not None:
        return "sun" if unit.part == "sun" else "sky"
    return _TEXT.get(type(unit.lights[0]), "lamp") if len(unit.lights) == 1 else "group"
