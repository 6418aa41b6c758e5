"""The layers of a job's mixer: what each unit light does to each splat, and what its lightings take of them.

A layer is what the relight mode makes of a unit light alone. In mode `ratio` that is T = L / (L_captured + d m), L the
light's irradiance over pi, and a base d m / (L_captured + d m) beside them: the sum of weights times layers is then the
factor. Modes `tint` (brightness a L) and `albedo` have no base.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from mirelight import relighting
from mirelight.base.errors import InputError
from mirelight.base.progress import ShareProgress
from mirelight.lighting.layers import MAX_LAYERS
from mirelight.model import F32, F64, Job, Lighting
from mirelight.model.unit_lights import ALIKE, GLOW, LightSets, Unit, terms
from mirelight.pipeline import requirements
from mirelight.pipeline.prepared import Prepared
from mirelight.pipeline.scene import Scene
from mirelight.pipeline.splat_light import EMISSION, SplatLight

BASE = "base"
MOST_LAYERS = 32  # the page's shader reads four from a texture, and beside them up to seven textures of the splats
_UNLIMITED = 1e30


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


def make(
    scene: Scene, *, spp: int, lightings: tuple[Lighting, ...], progress: ShareProgress | None = None
) -> MixLayers:
    """Trace what is not kept, and divide by the captured light.

    Args:
        scene: of a job that `needs.check_lit_splats` lets through.
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
    captured = requirements.compared(job)
    compares = captured is not None
    units = {t.unit.digest: t.unit for x in plain for t in terms(x)}
    index = {key: i for i, key in enumerate(units)}
    names = [_layer_name(key, plain) for key in units]
    floor = relighting.mode_of(job.relight).leaves_floor and compares
    extra = [EMISSION] * scene.glows + [BASE] * floor
    _refuse_too_many(job, len(names) + len(extra), captured)
    splats = SplatLight(scene, spp, progress)
    values = np.zeros((len(names) + len(extra), len(scene.splats), 3), np.float32)
    old = _light_units(splats, plain, captured, index, values)
    if scene.glows:
        glow = splats.light(GLOW, "surfaces that glow")[0]
        values[len(names)] = glow
        old += glow
    level = scene.captured_level or 0.0 if compares else None
    made = layering(scene, splats, old.astype(np.float32) if compares else None, level)
    for k in range(len(values) - floor):
        values[k] = made.layer_of(values[k])
    if floor:
        values[-1] = made.base
    return MixLayers(
        names=(*names, *extra),
        values=values,
        constant=tuple(range(len(names), len(names) + len(extra))),
        lightings=tuple(_mixed(x, index) for x in lightings),
        limit=limit_of(scene),
        near=splats.near,
        units=tuple(units.values()),
        layer_of=made.layer_of,
    )


@dataclass(frozen=True, slots=True, eq=False)
class Layering:
    """What makes layers."""

    layer_of: Callable[[F32], F32]  # (N, 3) irradiance / pi of a unit light -> (N, 3) its layer
    base: F32  # (N, 3) what is there without any light


def layering(scene: Prepared, splats: SplatLight, old: F32 | None, level: float | None) -> Layering:
    """How layers are made under a captured light.

    Args:
        scene: a prepared job.
        splats: of the scene.
        old: (N, 3) irradiance / pi of the captured light; None: the mode compares with none.
        level: of the captured light, as `Scene.captured_level`; None where `old` is.
    """
    assert scene.splats is not None
    factor = relighting.splat_relighter(
        relighting.captured_color(scene.splats),
        splats.albedo,
        replace(scene.job.relight, max_ratio=_UNLIMITED),
        captured=old,
        captured_level=level,
    )
    base = factor(np.zeros((len(scene.splats), 3), np.float32))

    def layer_of(light: F32) -> F32:
        return np.asarray(factor(light) - base, np.float32)

    return Layering(layer_of, base)


def limit_of(scene: Scene) -> float | None:
    """Of the sum of layers; None: there is none."""
    compares = requirements.compared(scene.job) is not None
    reads = relighting.mode_of(scene.job.relight).reads
    return scene.job.relight.max_ratio if compares and "max_ratio" in reads else None


def _refuse_too_many(job: Job, layers: int, captured: Lighting | None) -> None:
    """What the page cannot hold, and what cannot be traced apart."""
    if layers > MOST_LAYERS:
        remedy = f"give lights a group, or choose lightings: the page holds {MOST_LAYERS}"
        raise InputError(job.source, f"{layers} layers of light", remedy, field="lights")
    if captured is not None and len(list(terms(captured))) > MAX_LAYERS:
        found = f"more than {MAX_LAYERS} lights in the captured lighting"
        raise InputError(job.source, found, "give them a group", field="captured")


def _light_units(
    splats: SplatLight, plain: tuple[Lighting, ...], captured: Lighting | None, index: dict[str, int], values: F32
) -> F64:
    """Put every unit light's irradiance / pi on the splats into its row of `values` (L, N, 3), by the unit's digest.

    Returns:
        (N, 3) the captured light's, without what glows.
    """
    old = np.zeros(values.shape[1:], np.float64)
    lightings = (*plain, captured) if captured is not None else plain
    sets = LightSets(lightings, ALIKE)
    every = {s.digest: s for x in lightings for s in sets.mixture(x).sets}
    taken = {} if captured is None else {t.unit.digest: t.weight for t in terms(captured)}
    for number, one in enumerate(every.values()):
        light = splats.light(one, f"set {number + 1} of {len(every)}")
        for k, unit in enumerate(one.units):
            if unit.digest in index:
                values[index[unit.digest]] = light[k]
            if unit.digest in taken:
                old += light[k] * taken[unit.digest]
    return old


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
        place = light.place
        if place is not None:
            yield Handle(light.name, layers[name], seen[name], place)
        seen[name] += 1


def _layer_name(unit: str, lightings: tuple[Lighting, ...]) -> str:
    return next(t.layer for x in lightings for t in terms(x) if t.unit.digest == unit)
