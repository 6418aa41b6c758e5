"""What can be wrong with a frame that is there, told from its file's own pixels."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from mirelight.io.exr import ExrImage
from mirelight.model import F32, DisplaySettings, Frame, Lighting, LightingBuffer, LightLayer
from mirelight.model.unit_lights import Term, terms
from mirelight.pipeline import frame_diagnostics

Kind = Literal["missing", "failed", "other", "damaged", "values", "picture", "sum", "layers", "closed"]

_ROUNDING = 0.01  # of 16-bit values, and of what the lossy compression leaves, relative
_ALPHA = 1e-3  # by which an alpha may lie outside 0 to 1
_NOISE = 2.0  # how many times the expected difference of two noisy pictures is too much
_UNKNOWN = 0.1  # relative difference that noise may make where a file does not say how noisy it is
_AT_ONCE = 4  # sums that are checked in one go over a camera's frames


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that is wrong, and how to mend it."""

    kind: Kind
    what: str  # the frame or file
    text: str
    remedy: str

    def __str__(self) -> str:
        return f"{self.what}: {self.text}; {self.remedy}"


def broken_values(image: ExrImage) -> str:
    """What of an EXR file's values cannot be, in words; empty where all can."""
    for name, values in image.channels.items():
        if values.dtype.kind == "f" and not np.isfinite(values).all():
            count = int(values.size - np.isfinite(values).sum())
            return f"{count:,} values of {name} are not finite"
    for name in ("A", "unlit.A", "lighting.A", "transmittance.Y"):
        alpha = image.channels.get(name)
        if alpha is not None and alpha.size:
            low, high = float(alpha.min()), float(alpha.max())
            if low < -_ALPHA or high > 1 + _ALPHA:
                return f"{name} reaches from {low:.4g} to {high:.4g}, not 0 to 1"
    return ""


def picture(frame: Frame, display: DisplaySettings, off: Collection[str]) -> Iterator[frame_diagnostics.Finding]:
    """What is wrong with what a frame shows; `off`: names of lights that are meant to add nothing."""
    yield from frame_diagnostics.of_frame(frame, display, off=off)


@dataclass(eq=False)
class _Sum:
    """A lighting whose lights have lightings of their own, and their light so far."""

    lighting: Lighting
    parts: Mapping[str, Sequence[tuple[Term, Term]]]  # by such a lighting its term, and the same light's in the whole
    heard: set[str] = field(default_factory=set)
    light: list[F32] = field(default_factory=list)  # one array, or none yet
    variance: list[F32 | None] = field(default_factory=list)  # the same; None where it is not known

    def add(self, name: str, buffer: LightingBuffer) -> None:
        """Take what the whole takes of that lighting's light."""
        for own, wanted in self.parts[name]:
            layer = _layer(buffer, own.layer)
            if layer is None:
                return
            factor = (wanted.weight / own.weight).astype(np.float32)
            self.light = [_added(self.light, (layer.direct + layer.indirect) * factor)]
            own_variance = None if layer.variance is None else layer.variance * factor**2
            known = [x for x in self.variance if x is not None]
            missing = own_variance is None or len(known) < len(self.variance)
            self.variance = [None if missing or own_variance is None else _added(known, own_variance)]
        self.heard.add(name)


class Sums:
    """Whether the frames of one camera add up: a lighting's light is that of its lights, each alone, within noise.

    Light is compared, not pictures, as those need not be linear in it.

    Args:
        lightings: those of the camera's frames.
    """

    def __init__(self, lightings: Sequence[Lighting]) -> None:
        every = {lighting.name: tuple(terms(lighting)) for lighting in lightings}
        alone: dict[tuple[int, str], tuple[str, Term]] = {}  # by objects and digest of a light the first of it alone
        for x in lightings:
            own = every[x.name]
            if len(own) == 1 and own[0].weight.all():
                alone.setdefault((id(x.objects), own[0].unit.digest), (x.name, own[0]))
        whole = [
            x
            for x in lightings
            if len(every[x.name]) > 1 and all((id(x.objects), term.unit.digest) in alone for term in every[x.name])
        ]
        self._sums: list[_Sum] = []
        for lighting in sorted(whole, key=lambda x: -len(every[x.name]))[:_AT_ONCE]:
            parts: dict[str, list[tuple[Term, Term]]] = {}
            for term in every[lighting.name]:
                name, own_term = alone[id(lighting.objects), term.unit.digest]
                parts.setdefault(name, []).append((own_term, term))
            self._sums.append(_Sum(lighting, parts))

    def first(self) -> frozenset[str]:
        """Names of the lightings of one light, which are to be added before the others are asked for."""
        return frozenset(name for one in self._sums for name in one.parts)

    def wants(self, lighting: str) -> bool:
        """Whether a lighting is one of those."""
        return any(lighting == one.lighting.name or lighting in one.parts for one in self._sums)

    def add(self, lighting: str, light: LightingBuffer) -> None:
        """What was traced for a lighting."""
        for one in self._sums:
            if lighting in one.parts:
                one.add(lighting, light)

    def difference(self, lighting: str, light: LightingBuffer) -> str:
        """How far a lighting's light is from that of its lights, in words; empty where it is theirs, or not known."""
        one = next((x for x in self._sums if x.lighting.name == lighting), None)
        if one is None or one.heard != set(one.parts):
            return ""
        layers = [_layer(light, term.layer) for pairs in one.parts.values() for _, term in pairs]
        own = [layer for layer in layers if layer is not None]
        if len(own) < len(layers) or not one.light or one.light[0].shape != own[0].direct.shape:
            return ""
        whole = np.sum([x.direct + x.indirect for x in own], axis=0, dtype=np.float64)
        total = float(np.abs(whole).sum())
        variances = [x for x in (*(layer.variance for layer in own), one.variance[0]) if x is not None]
        if len(variances) == len(own) + 1:
            off = float(np.abs(whole - one.light[0]).sum())
            allowed = _NOISE * float(np.sqrt(np.sum(variances, axis=0)).sum())
        else:  # over the whole picture noise cancels out
            off = float(np.abs((whole - one.light[0]).sum(axis=(0, 1))).sum())
            allowed = _UNKNOWN * total
        if off <= allowed + _ROUNDING * total:
            return ""
        names = ", ".join(one.parts)
        share = off / total if total else np.inf
        return f"its light is {share:.1%} off the sum of {names}, beyond what noise explains"


def _added(before: Sequence[F32], more: F32) -> F32:
    return np.asarray(before[0] + more, dtype=np.float32) if before else more


def _layer(buffer: LightingBuffer, name: str) -> LightLayer | None:
    """A light's own layer, as it was traced."""
    return next((x for x in (buffer.noisy or buffer.layers) if x.name == name), None)
