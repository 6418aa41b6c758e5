"""Traced sets of unit lights put together to a lighting: sums of layers times weights."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mirelight.base.names import FreeNames
from mirelight.model import F32, F64, Camera, LightingBuffer, LightLayer
from mirelight.model.results import EMISSION
from mirelight.model.unit_lights import GLOW, LightSet, Mixture

BEAUTY = "beauty"  # the one layer where nobody asks for more
_PARTS = ("direct", "indirect", "half", "quarter", "other_quarter")  # what is linear in the light


@dataclass(frozen=True, slots=True)
class Wanted:
    """What of a mixture somebody will look at."""

    layers: bool  # one for each light; else their sum
    variance: bool


def mix(
    mixture: Mixture,
    traced: Mapping[str, LightingBuffer],
    camera: Camera,
    sun_strength: Mapping[str, float],
    wanted: Wanted,
) -> LightingBuffer:
    """A lighting from the buffers of its sets.

    Args:
        mixture: sets and weights.
        traced: by a set's digest its buffer; all of one camera, seed and number of samples, so that they saw the same
            geometry. `units.GLOW` is added where it is there. A set that is missing (of an interrupted trace) is dark.
        camera: of the result.
        sun_strength: by a set's digest the illuminance of its sun in this lighting; none for sets without a sun.
        wanted: the rest is left out.

    Returns:
        The layers in the lighting's order. Sets count as independent in `variance`: within a set the layers' own
        correlation is kept (see `LightingBuffer.variance_of`).
    """
    there = [s for s in mixture.sets if s.digest in traced]
    first = traced[there[0].digest]
    if there[0].whole is not None:
        objects = None if first.objects is None else replace(first.objects, camera=camera)
        return replace(first, camera=camera, objects=objects)
    shares = [found for i in range(len(mixture.terms)) if (found := _share(i, mixture, traced)) is not None]
    glow = traced.get(GLOW.digest)
    if glow is not None:
        name = FreeNames(x.name for x in shares).take(EMISSION)
        shares += [_Share(name, layer, np.ones(3)) for layer in glow.layers]
    beside = {name: buffer.objects for name, buffer in traced.items() if buffer.objects is not None}
    return replace(
        first,
        camera=camera,
        objects=mix(mixture, beside, camera, {}, wanted) if beside else None,
        layers=tuple(x.layer(wanted) for x in shares) if wanted.layers else _summed(shares, first),
        variance=_variance(mixture, there, traced) if wanted.variance else None,
        sun_visibility=_sun_visibility(there, traced, sun_strength),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Share:
    """A traced layer, and how much of it the lighting takes."""

    name: str
    traced: LightLayer
    weight: F64  # (3,)

    def layer(self, wanted: Wanted) -> LightLayer:
        """The layer as it is in the lighting."""
        out = self.traced if wanted.variance else replace(self.traced, variance=None)
        return replace(out.times(self.weight), name=self.name)


def _share(index: int, mixture: Mixture, traced: Mapping[str, LightingBuffer]) -> _Share | None:
    term = mixture.terms[index]
    for home in mixture.sets:
        name = home.layer_of(term.unit)
        if name is not None and home.digest in traced:
            layer = next(x for x in traced[home.digest].layers if x.name == name)
            return _Share(term.layer, layer, term.weight)
    return None


def _summed(shares: Sequence[_Share], like: LightingBuffer) -> tuple[LightLayer, ...]:
    """One layer of all shares, added up in place."""
    shape = (*like.coverage.shape, 3)
    sums: dict[str, F32] = {name: np.zeros(shape, np.float32) for name in ("direct", "indirect")}
    scratch = np.empty(shape, np.float32)
    for share in shares:
        if not share.weight.any():
            continue
        uniform = share.weight.min() == share.weight.max()
        factor = np.float32(share.weight[0]) if uniform else share.weight.astype(np.float32)
        for part in _PARTS:
            values = getattr(share.traced, part)
            if values is not None:
                total = sums.setdefault(part, np.zeros(shape, np.float32))
                np.multiply(values, factor, out=scratch)
                np.add(total, scratch, out=total)
    return (LightLayer(name=BEAUTY, **sums),)


def _variance(mixture: Mixture, sets: Sequence[LightSet], traced: Mapping[str, LightingBuffer]) -> F32 | None:
    weights = {term.unit.digest: term.weight for term in mixture.terms}
    found = []
    for one in sets:
        own = {str(i): weights.get(unit.digest, np.zeros(3)) for i, unit in enumerate(one.units)}
        found.append(traced[one.digest].variance_of(own))
    glow = traced.get(GLOW.digest)
    found += [] if glow is None else [glow.variance]
    known = [x for x in found if x is not None]
    if len(known) < len(found) or not known:
        return None
    return known[0] if len(known) == 1 else np.asarray(np.sum(known, axis=0), dtype=np.float32)


def _sun_visibility(
    sets: Sequence[LightSet], traced: Mapping[str, LightingBuffer], strength: Mapping[str, float]
) -> F32 | None:
    """Each sun's visibility by its share of all suns' illuminance; None where there is no sun or nobody asked."""
    seen = {s.digest: traced[s.digest].sun_visibility for s in sets if s.digest in strength}
    found = {name: image for name, image in seen.items() if image is not None}
    if not found:
        return None
    total = sum(strength[name] for name in found)
    if len(found) == 1 or total <= 0:
        return next(iter(found.values()))
    shares = [image * np.float32(strength[name] / total) for name, image in found.items()]
    return np.asarray(np.sum(shares, axis=0), dtype=np.float32)
