"""The light of a job that is being edited, on its splats: a layer for each lamp, as finely as it is traced by now."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mirelight.apps.mixer import rgb9e5
from mirelight.apps.mixer.first_light import STAGES, StagedLight
from mirelight.apps.mixer.layers import MOST_LAYERS, Layering, layering
from mirelight.base.errors import InputError
from mirelight.lighting.splat_light import REACH
from mirelight.model import F32, F64, Lighting
from mirelight.model.unit_lights import GLOW, Term, Unit, terms
from mirelight.pipeline import requirements
from mirelight.pipeline.scene import Scene
from mirelight.pipeline.splat_light import Progress
from mirelight.relighting import captured_color

_MOST_KEPT = 64  # unit lights; of 250,000 splats 3 MB each


@dataclass(frozen=True, slots=True, eq=False)
class Layer:
    """What a lamp does to the splats, for a page to show."""

    name: str  # "": what is there without any light
    weight: F64  # (3,) colour times intensity
    version: int  # of its values; counts up
    samples: int  # a splat; 0: none yet
    scale: float
    packed: bytes  # (N,) RGB9E5 over the scale, little-endian


@dataclass(frozen=True, slots=True, eq=False)
class _Made:
    key: object  # what it was made from
    version: int
    samples: int
    scale: float
    packed: bytes


class Lights:
    """Traces unit lights on splats and keeps them.

    Args:
        scene: of a job with lit splats, its proxy at hand.
        order: (N,) of the splats in the page's file.
        progress: hears what is traced; what it raises ends the trace.
    """

    def __init__(self, scene: Scene, order: NDArray[np.intp], progress: Progress) -> None:
        self._order = order
        self._kept: dict[str, tuple[int, F32]] = {}  # by the unit's digest: its stage, and (N, 3) irradiance / pi
        self._made: dict[tuple[str, str], _Made] = {}  # by lighting and layer
        self._layering: tuple[object, Layering] | None = None
        self._version = 0
        self._used: set[str] = set()  # digests of unit lights that are shown
        self._staged = StagedLight(scene, STAGES, progress)
        self.scene = scene

    def follow(self, scene: Scene) -> bool:
        """Take another job's lights; False where its proxy or its splats' places are others, so that nothing fits."""
        old, new = self.scene, scene
        if (old.keys.proxy, old.keys.splat_places) != (new.keys.proxy, new.keys.splat_places):
            return False
        if replace(old.job.render, spp=1, noise=None) != replace(new.job.render, spp=1, noise=None):
            return False
        self._staged.follow(scene)
        self.scene = scene
        return True

    def wanted(self, lighting: Lighting) -> Iterator[tuple[int, Unit]]:
        """What is to be traced for a lighting and the captured light: the stage that a unit light waits for."""
        captured = requirements.compared(self.scene.job)
        every = [x.unit for one in (lighting, captured) if one is not None for x in terms(one)]
        self._used = {x.digest for x in every}
        for unit in every:
            stage = self._stage(unit) + 1
            if stage < len(STAGES):
                yield stage, unit

    def trace(self, unit: Unit, stage: int) -> None:
        """Trace a unit light with the samples of a stage."""
        light = self._staged.light(unit, stage)
        self._kept.pop(unit.digest, None)
        self._kept[unit.digest] = stage, light
        spare = [x for x in self._kept if x not in self._used]
        for digest in spare[: max(len(self._kept) - _MOST_KEPT, 0)]:
            del self._kept[digest]

    def layers(self, lighting: Lighting) -> list[Layer] | None:
        """What there is of a lighting; None while the captured light is not known.

        Raises:
            InputError: more layers than a page can hold.
        """
        key, old = self._old()
        if key is None:
            return None
        if self._layering is None or self._layering[0] != key:
            self._layering = key, layering(self.scene, self._staged.splats, old)
        made = self._layering[1]
        found = list(terms(lighting))
        constant = self._constant(made, key)
        if len(found) + len(constant) > MOST_LAYERS - 1:  # one is the misfit's
            raise InputError(
                lighting.name, f"{len(found)} layers of light", f"the page shows {MOST_LAYERS - 2}: give lights a group"
            )
        return [*(self._layer(lighting.name, x, made, key) for x in found), *constant]

    @property
    def near(self) -> float:
        """Share of the splats that lie on the proxy."""
        return self._staged.splats.near

    def misfit(self) -> tuple[float, bytes]:
        """How far splats lie off the proxy, as a layer that shows it: scale and values. Grey is on it, red is further
        off than light is taken from."""
        scene = self.scene
        assert scene.splats is not None and scene.proxy is not None
        away = np.linalg.norm(self._staged.splats.places.points - scene.splats.means, axis=1)
        far = np.clip(away / (REACH * np.linalg.norm(np.ptp(scene.proxy.vertices, axis=0))), 0, 1)[:, None]
        color = captured_color(scene.splats)
        brightness = np.clip(color.mean(axis=1, keepdims=True), 0.05, 1)
        wanted = brightness * ((1 - far) * (0.7, 0.7, 0.7) + far * (1.6, 0.1, 0.05))
        factor = np.clip(wanted / np.maximum(color, 1e-3), 0, 64)
        return rgb9e5.packed_layer(factor.astype(np.float32)[self._order])

    def mesh(self) -> bytes:
        """The proxy: (V,) count, (V, 3) float32 places and (F, 3) uint32 corners, little-endian."""
        proxy = self.scene.proxy
        assert proxy is not None
        vertices, faces = np.asarray(proxy.vertices, "<f4"), np.asarray(proxy.faces, "<u4")
        return struct.pack("<I", len(vertices)) + vertices.tobytes() + faces.tobytes()

    def _layer(self, lighting: str, term: Term, made: Layering, old: object) -> Layer:
        stage, light = self._kept.get(term.unit.digest, (-1, None))
        place = lighting, term.layer
        if light is not None:
            self._pack(place, (term.unit.digest, stage, old), STAGES[stage], lambda: made.layer_of(light))
        shown = self._made.get(place) or _Made(None, 0, 0, 1.0, b"")
        return Layer(term.layer, term.weight, shown.version, shown.samples, shown.scale, shown.packed)

    def _constant(self, made: Layering, old: object) -> list[Layer]:
        """What every lighting has: what is there without light, and what glows."""
        floor, glows = made.base.any(), self.scene.glows
        if floor:
            self._pack(("", "base"), old, STAGES[-1], lambda: made.base)
        if glows:
            self._pack(("", "glow"), old, STAGES[1], lambda: made.layer_of(self._glow()))
        there = [self._made["", name] for name, is_there in (("base", floor), ("glow", glows)) if is_there]
        return [Layer("", np.ones(3), x.version, x.samples, x.scale, x.packed) for x in there]

    def _pack(self, place: tuple[str, str], key: object, samples: int, values: Callable[[], F32]) -> None:
        known = self._made.get(place)
        if known is None or known.key != key:
            self._version += 1
            self._made[place] = _Made(key, self._version, samples, *rgb9e5.packed_layer(values()[self._order]))

    def _old(self) -> tuple[object, F32 | None]:
        """What tells the captured light by, and it as (N, 3) irradiance / pi; no key while a part of it is missing."""
        job = self.scene.job
        captured = requirements.compared(job)
        if captured is None:
            return (job.relight, ""), None
        found = list(terms(captured))
        stages = tuple(self._stage(x.unit) for x in found)
        if min(stages, default=0) < 0:
            return None, None
        key = job.relight, self.scene.keys.captured_level, tuple(x.unit.digest for x in found), stages
        if self._layering is not None and self._layering[0] == key:
            return key, None  # nobody asks for it again
        old = np.zeros((len(self._order), 3))
        for term in found:
            old += self._kept[term.unit.digest][1] * term.weight
        if self.scene.glows:
            old += self._glow()
        return key, old.astype(np.float32)

    def _glow(self) -> F32:
        return np.asarray(self._staged.splats.with_samples(STAGES[1]).light(GLOW, "surfaces that glow")[0])

    def _stage(self, unit: Unit) -> int:
        return self._kept[unit.digest][0] if unit.digest in self._kept else -1
