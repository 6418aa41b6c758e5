"""The light of a job that is being edited, on its splats: a layer for each lamp, as finely as it is traced by now."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import count

import numpy as np
from numpy.typing import NDArray

from mirelight.apps.mixer import rgb9e5
from mirelight.apps.mixer.first_light import STAGES
from mirelight.apps.mixer.layers import MOST_LAYERS, Layering, layering
from mirelight.apps.studio import early
from mirelight.base.errors import InputError, MirelightError
from mirelight.base.progress import ShareProgress, quiet
from mirelight.lighting.splat_light import REACH
from mirelight.model import F32, F64, Lighting, ProxyMesh
from mirelight.model.unit_lights import GLOW, Term, Unit, terms
from mirelight.pipeline import requirements
from mirelight.pipeline.prepared import Prepared
from mirelight.pipeline.scene import Scene
from mirelight.relighting import captured_color

_GLOW_SAMPLES = STAGES[1]
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


_VERSIONS = count(1)  # of layers, whoever makes them


class Lights:
    """Traces unit lights on splats and keeps them.

    Args:
        scene: of a job with lit splats, its proxy at hand.
        source: of the light.
        order: (N,) of the splats in the page's file.
    """

    def __init__(self, scene: Scene, source: early.FineLight | early.EarlyLight, order: NDArray[np.intp]) -> None:
        self._order = order
        self._kept: dict[str, tuple[int, F32]] = {}  # by the unit's digest: its stage, and (N, 3) irradiance / pi
        self._made: dict[tuple[str, str], _Made] = {}  # by lighting and layer
        self._layering: tuple[object, Layering] | None = None
        self._used: set[str] = set()  # digests of unit lights that are shown
        self._source = source
        self._of = scene
        self.level: float | None = None  # of the captured light; None: not known yet, or not asked for

    def follow(self, scene: Scene) -> bool:
        """Take another job's lights; False where its proxy or its splats' places are others, so that nothing fits."""
        old, new = self._of, scene
        if (old.keys.proxy, old.keys.splat_places) != (new.keys.proxy, new.keys.splat_places):
            return False
        if replace(old.job.render, spp=1, noise=None) != replace(new.job.render, spp=1, noise=None):
            return False
        self._source.follow(scene)
        self._of = scene
        return True

    def wanted(self, lighting: Lighting) -> Iterator[tuple[int, tuple[Unit, ...]]]:
        """What is to be traced for a lighting and the captured light: unit lights, and the stage that they wait for."""
        lightings = [x for x in (self._source.known(lighting), requirements.compared(self._scene.job)) if x is not None]
        self._used = {x.unit.digest for one in lightings for x in terms(one)}
        for one in lightings:
            stages = {x.unit: self._stage(x.unit) + 1 for x in terms(one)}
            due = [unit for unit, stage in stages.items() if stage < len(self._source.stages)]
            for first in range(0, len(due), self._source.together):
                yield stages[due[first]], tuple(due[first : first + self._source.together])

    def trace(self, units: tuple[Unit, ...], stage: int) -> None:
        """Trace unit lights with the samples of a stage."""
        for unit, light in zip(units, self._source.lights(units, stage), strict=True):
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
            self.level = None if old is None else self._source.level(old)
            self._layering = key, layering(self._scene, self._source.splats, old, self.level)
        made = self._layering[1]
        found = list(terms(self._source.known(lighting)))
        constant = self._constant(made, key)
        if len(found) + len(constant) > MOST_LAYERS - 1:  # one is the misfit's
            raise InputError(
                lighting.name, f"{len(found)} layers of light", f"the page shows {MOST_LAYERS - 2}: give lights a group"
            )
        return [*(self._layer(lighting.name, x, made, key) for x in found), *constant]

    @property
    def near(self) -> float:
        """Share of the splats that lie on the proxy."""
        return self._source.splats.near

    @property
    def _scene(self) -> Prepared:
        """Of the splats that are traced."""
        return self._source.scene

    def misfit(self) -> tuple[float, bytes]:
        """How far splats lie off the proxy, as a layer that shows it: scale and values. Grey is on it, red is further
        off than light is taken from."""
        scene = self._scene
        assert scene.splats is not None and scene.proxy is not None
        away = np.linalg.norm(self._source.splats.places.points - scene.splats.means, axis=1)
        far = np.clip(away / (REACH * np.linalg.norm(np.ptp(scene.proxy.vertices, axis=0))), 0, 1)[:, None]
        color = captured_color(scene.splats)
        brightness = np.clip(color.mean(axis=1, keepdims=True), 0.05, 1)
        wanted = brightness * ((1 - far) * (0.7, 0.7, 0.7) + far * (1.6, 0.1, 0.05))
        factor = np.clip(wanted / np.maximum(color, 1e-3), 0, 64)
        return rgb9e5.packed_layer(self._source.spread(factor.astype(np.float32))[self._order])

    def mesh(self) -> bytes:
        """The proxy: (V,) count, (V, 3) float32 places and (F, 3) uint32 corners, little-endian."""
        proxy = self._of.mesh  # as fine as it is
        assert proxy is not None
        vertices, faces = np.asarray(proxy.vertices, "<f4"), np.asarray(proxy.faces, "<u4")
        return struct.pack("<I", len(vertices)) + vertices.tobytes() + faces.tobytes()

    def _layer(self, lighting: str, term: Term, made: Layering, old: object) -> Layer:
        stage, light = self._kept.get(term.unit.digest, (-1, None))
        place = lighting, term.layer
        if light is not None:
            self._pack(place, (term.unit.digest, stage, old), self._source.stages[stage], lambda: made.layer_of(light))
        shown = self._made.get(place) or _Made(None, 0, 0, 1.0, b"")
        return Layer(term.layer, term.weight, shown.version, shown.samples, shown.scale, shown.packed)

    def _constant(self, made: Layering, old: object) -> list[Layer]:
        """What every lighting has: what is there without light, and what glows."""
        floor, glows, samples = made.base.any(), self._scene.glows, self._source.stages[-1]
        if floor:
            self._pack(("", "base"), old, samples, lambda: made.base)
        if glows:
            self._pack(("", "glow"), old, samples, lambda: made.layer_of(self._glow()))
        there = [self._made["", name] for name, is_there in (("base", floor), ("glow", glows)) if is_there]
        return [Layer("", np.ones(3), x.version, x.samples, x.scale, x.packed) for x in there]

    def _pack(self, place: tuple[str, str], key: object, samples: int, values: Callable[[], F32]) -> None:
        known = self._made.get(place)
        if known is None or known.key != key:
            packed = rgb9e5.packed_layer(self._source.spread(values())[self._order])
            self._made[place] = _Made(key, next(_VERSIONS), samples, *packed)

    def _old(self) -> tuple[object, F32 | None]:
        """What tells the captured light by, and it as (N, 3) irradiance / pi; no key while a part of it is missing."""
        job = self._scene.job
        captured = requirements.compared(job)
        if captured is None:
            return (job.relight, ""), None
        found = list(terms(captured))
        stages = tuple(self._stage(x.unit) for x in found)
        if min(stages, default=0) < 0:
            return None, None
        key = job.relight, self._scene.keys.captured_level, tuple(x.unit.digest for x in found), stages
        if self._layering is not None and self._layering[0] == key:
            return key, None  # nobody asks for it again
        old = np.zeros((len(self._source.splats.places.points), 3))
        for term in found:
            old += self._kept[term.unit.digest][1] * term.weight
        if self._scene.glows:
            old += self._glow()
        return key, old.astype(np.float32)

    def _glow(self) -> F32:
        return np.asarray(
            self._source.splats.with_samples(min(_GLOW_SAMPLES, self._source.stages[-1])).light(
                GLOW, "surfaces that glow"
            )[0]
        )

    def _stage(self, unit: Unit) -> int:
        return self._kept[unit.digest][0] if unit.digest in self._kept else -1


class Supply:
    """Fine light of a job, or early light while what fine light takes is being made.

    Args:
        order: (N,) of the splats in the page's file.
        progress: hears what is traced; what it raises ends the trace.
    """

    def __init__(self, order: NDArray[np.intp], progress: ShareProgress) -> None:
        self._order, self._progress = order, progress
        self._few: early.Few | None = None
        self._early: Lights | None = None
        self._fine: Lights | None = None
        self._scene: Scene | None = None

    @property
    def best(self) -> Lights | None:
        """What there is by now."""
        return self._fine or self._early

    def of(self, scene: Scene, refine: Callable[[], None]) -> Lights | None:
        """What lights a scene, its mesh at hand; None: nothing before its captured light is found.

        Args:
            scene: of a job with lit splats.
            refine: called as long as what fine light takes has to be made by another process.
        """
        if scene is not self._scene:
            self._fine, self._early = (
                x if x is not None and x.follow(scene) else None for x in (self._fine, self._early)
            )
            self._scene = scene
        if self._fine is None and early.at_hand(scene):
            self._fine, self._early = Lights(scene, early.FineLight(scene, self._progress), self._order), None
        if self._fine is None:
            refine()
            if self._early is None and early.knows_captured(scene):
                self._early = self._of_few(scene, self._progress)
        return self.best

    def warm(self, scene: Scene) -> None:
        """Before there is a proxy: whatever early light takes that does not depend on it, kernels and all."""
        assert scene.splats is not None
        if early.is_small(scene.splats) or not early.knows_captured(scene):
            return
        with suppress(MirelightError, RuntimeError, MemoryError):  # what is wrong is said where light is wanted
            lights, lighting = self._of_few(scene, quiet, early.scraps(scene.splats)), scene.job.lightings[0]
            for stage, units in list(lights.wanted(lighting)):
                lights.trace(units, stage)
            lights.layers(lighting)

    def _of_few(self, scene: Scene, progress: ShareProgress, mesh: ProxyMesh | None = None) -> Lights:
        if self._few is None:
            assert scene.splats is not None
            self._few = early.Few(scene.splats)
        return Lights(scene, early.EarlyLight(scene, self._few, progress, mesh), self._order)
