"""Traced sets of unit lights put together to a lighting: sums of layers times weights."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mirelight.model import F32, Camera, LightingBuffer, LightLayer
from mirelight.units import GLOW, LightSet, Mixture

EMISSION = "emission"  # the layer of what the proxy's own surfaces send out


def mix(
    mixture: Mixture, traced: Mapping[str, LightingBuffer], camera: Camera, sun_strength: Mapping[str, float]
) -> LightingBuffer:
    """A lighting from the buffers of its sets.

    Args:
        mixture: sets and weights.
        traced: by a set's digest its buffer; all of one camera, seed and number of samples, so that they saw the same
            geometry. `units.GLOW` is added where it is there. A set that is missing (of an interrupted trace) is dark.
        camera: of the result.
        sun_strength: by a set's digest the illuminance of its sun in this lighting; none for sets without a sun.

    Returns:
        The layers in the lighting's order. Sets count as independent in `variance`: within a set the layers' own
        correlation is kept (see `LightingBuffer.reweighted`).
    """
    there = [s for s in mixture.sets if s.digest in traced]
    first = traced[there[0].digest]
    if there[0].whole is not None:
        return replace(first, camera=camera)
    weighted = {s.digest: traced[s.digest].reweighted(_weights(s, mixture)) for s in there}
    layers = [_renamed(weighted, mixture, i) for i in range(len(mixture.terms))]
    parts = list(weighted.values())
    glow = traced.get(GLOW.digest)
    if glow is not None:
        layers += [replace(layer, name=_free(EMISSION, layers)) for layer in glow.layers]
        parts.append(glow)
    return replace(
        first,
        camera=camera,
        layers=tuple(x for x in layers if x is not None),
        variance=_sum([x.variance for x in parts]) if parts else None,
        sun_visibility=_sun_visibility(there, traced, sun_strength),
    )


def _weights(of: LightSet, mixture: Mixture) -> dict[str, list[float]]:
    """By the layers of a set what the lighting takes of them; of lights that it does not have, nothing."""
    wanted = {term.unit.digest: term.weight for term in mixture.terms}
    return {str(i): [float(w) for w in wanted.get(unit.digest, np.zeros(3))] for i, unit in enumerate(of.units)}


def _renamed(weighted: Mapping[str, LightingBuffer], mixture: Mixture, index: int) -> LightLayer | None:
    term = mixture.terms[index]
    for home in mixture.sets:
        name = home.layer_of(term.unit)
        if name is not None:
            buffer = weighted.get(home.digest)
            found = None if buffer is None else next(x for x in buffer.layers if x.name == name)
            return None if found is None else replace(found, name=term.layer)
    raise AssertionError("a term without a set")


def _free(name: str, layers: list[LightLayer | None]) -> str:
    taken = {x.name for x in layers if x is not None}
    out, number = name, 1
    while out in taken:
        number += 1
        out = f"{name}-{number}"
    return out


def _sum(variances: list[F32 | None]) -> F32 | None:
    known = [x for x in variances if x is not None]
    if len(known) < len(variances):
        return None
    return known[0] if len(known) == 1 else np.asarray(np.sum(known, axis=0), dtype=np.float32)


def _sun_visibility(
    sets: list[LightSet], traced: Mapping[str, LightingBuffer], strength: Mapping[str, float]
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
