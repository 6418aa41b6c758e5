"""The kept layers of a data set, read: what is ready of a camera, from which frames are mixed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache, lru_cache, partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mirelight import relighting
from mirelight.base.errors import InputError
from mirelight.dataset.far_light import FarLight
from mirelight.dataset.planes import MixedView, Planes, ReadyView, SeenObjects, planar
from mirelight.model import F32, Camera, LightingBuffer, LightLayer, RelightSettings, SplatLayer
from mirelight.pipeline.captured_sun import strongest, sun_of
from mirelight.pipeline.codecs import ARRAY, composite_of, light_of
from mirelight.store import layer_index as indexing
from mirelight.store.artefacts import Artefacts
from mirelight.store.layer_index import Index, KeptView, Weighted

REMEDY = "mirelight verify --rebuild forgets it, and mirelight render makes it again"
_MOST_RELIGHTS = 4  # ways of relighting that are kept ready for a camera


class Layers:
    """Reads layers of an output folder.

    Args:
        folder: for messages.
        index: what its job says.
        kept: light and composites.
        scene: what all cameras share.
        far: light from far away.
    """

    def __init__(self, folder: Path, index: Index, kept: Artefacts, scene: Artefacts, far: FarLight) -> None:
        self._folder, self._index, self._kept, self._scene, self._far = folder, index, kept, scene, far

    def lights_in(self, arrangement: int) -> NDArray[np.intp]:
        """(l,) indices of the unit lights, in order, that are known with objects in an arrangement, or with none."""
        own = [x.units for x in self._index.lightings if x.arrangement == arrangement]
        captured = () if self._index.captured is None else self._index.captured.units
        return np.unique(np.array([*(i for units in own for i in units), *captured], dtype=np.intp))

    def weights(self, of: Weighted) -> F32:
        """(L, 3) what a lighting takes of the unit lights."""
        out = np.zeros((len(self._index.units), 3), dtype=np.float32)
        np.add.at(out, list(of.units), np.asarray(of.weights, dtype=np.float32).reshape(-1, 3))
        return out

    def ready(self, view: KeptView, arrangement: int) -> ReadyView:
        """What is ready of a camera, with objects in one arrangement."""
        index, lights = self._index, self.lights_in(arrangement)
        seen, sight = self.light_camera(view), view.sights[arrangement]
        needed = {index.arrangements[arrangement].first, *(index.units[i].group for i in lights)}
        needed |= set(() if index.captured is None else index.captured.groups)
        buffers = {i: self.buffer(view.groups[i], seen) for i in sorted(needed)}
        glow, bare = (
            self.buffer(key, seen) if self._kept.path(key).is_file() else None
            for key in (sight.glow, view.captured_glow)
        )
        every = np.arange(seen.height * seen.width)
        planes = self._planes(lights, buffers, glow, every)
        splats, size = self.splats(view, view.composite), (seen.height, seen.width)
        first = buffers[index.arrangements[arrangement].first]
        objects = self._objects(lights, buffers, glow, first)
        old_weights = None if index.captured is None else self.weights(index.captured)[lights]
        mirrored, lobes = self._mirrored(view, lights, needed, old_weights)
        captured: LightingBuffer | None = None
        if index.captured is not None and old_weights is not None:
            constant = None if bare is None else planar(bare, "", every)
            beauty = replace(planes, constant=constant).mixed(old_weights).reshape(*size, 3)
            layer = LightLayer(name="captured", direct=beauty, indirect=np.zeros_like(beauty))
            captured = replace(buffers[index.captured.groups[0]], layers=(layer,), noisy=())
        level = None  # there is none where the machine that rendered could not tell it
        if index.captured_level is not None and self._scene.has(index.captured_level, ARRAY):
            level = self._far.array(index.captured_level)
        surface = replace(relighting.Lit.of(first), beauty=np.zeros((1, 1, 3), np.float32))

        @cache
        def compared(repair: bool, far: bool) -> relighting.Lit | None:
            if captured is None:
                return None
            around = self._far.far_map(self.weights(index.captured)) if far and index.captured is not None else None
            if splats is None or not repair:
                return relighting.Lit.of(captured, around)
            shown = relighting.repaired(captured, self._captured_sun(buffers), relighting.unlit_rgba(splats))
            return relighting.Lit.of(shown, around)

        front = self.splats(view, sight.front)

        @lru_cache(_MOST_RELIGHTS)
        def relighter(settings: RelightSettings) -> relighting.Relighter:
            known = None if level is None else float(level[0])
            old = compared(relighting.repairs(settings), settings.follows_sky)
            shine = lobes if relighting.adds_lobes(settings) else None
            return relighting.relighter(
                splats, surface, settings, captured=old, captured_level=known, front=front, lobes=shine
            )

        def relit(mixed: MixedView, weights: F32, own: RelightSettings | None) -> F32:
            settings = own or index.relight
            far = self._far.far_map(weights) if settings.follows_sky else None
            return relighter(settings)(mixed.beauty, mixed.objects, mixed.mirrored, far)

        alone, cover = self._bare(view, lights, needed, bare)
        shadowed = partial(_shadow, surface, cover, (view.camera.height, view.camera.width))
        return ReadyView(lights, planes, objects, mirrored, alone, size, relit, shadowed)

    def _objects(
        self,
        lights: NDArray[np.intp],
        buffers: Mapping[int, LightingBuffer],
        glow: LightingBuffer | None,
        first: LightingBuffer,
    ) -> SeenObjects | None:
        """What of inserted objects is seen, `first` a buffer that shows them; None where there are none."""
        if first.objects is None:
            return None
        where = np.flatnonzero(first.objects.coverage)
        theirs = {i: x.objects for i, x in buffers.items()}
        own = self._planes(lights, theirs, None if glow is None else glow.objects, where)
        return SeenObjects(where, first.objects.coverage, own)

    def _mirrored(
        self, view: KeptView, lights: NDArray[np.intp], groups: set[int], captured: F32 | None
    ) -> tuple[Planes | None, tuple[relighting.Lit, relighting.Lit | None] | None]:
        """What the proxy's materials mirror of the lights, and of the captured light of those weights (l, 3)."""
        keys = {i: key for i in sorted(groups) if view.mirrored and (key := view.mirrored[i]) is not None}
        if not keys:
            return None, None
        seen = self.light_camera(view)
        buffers = {i: self.buffer(key, seen) for i, key in keys.items()}
        glows = view.mirrored_glow is not None and self._kept.path(view.mirrored_glow).is_file()
        glow = self.buffer(view.mirrored_glow, seen) if glows and view.mirrored_glow is not None else None
        planes = self._planes(lights, buffers, glow, np.arange(seen.height * seen.width))
        surface = relighting.Lit.of(next(iter(buffers.values())))
        if captured is None:
            return planes, (surface, None)
        old = planes.mixed(captured).reshape(seen.height, seen.width, 3)
        return planes, (surface, replace(surface, beauty=old))

    def _bare(
        self, view: KeptView, lights: NDArray[np.intp], groups: set[int], glow: LightingBuffer | None
    ) -> tuple[Planes | None, F32]:
        """Light of the sets without objects, and what the proxy then covers (h, w)."""
        rows, columns = view.light_size
        if not view.bare:
            return None, np.zeros((rows, columns), np.float32)
        seen = self.light_camera(view)
        buffers = {i: self.buffer(key, seen) for i in sorted(groups) if (key := view.bare[i]) is not None}
        planes = self._planes(lights, buffers, glow, np.arange(rows * columns))
        return planes, next(iter(buffers.values())).coverage

    def _planes(
        self,
        lights: NDArray[np.intp],
        buffers: Mapping[int, LightingBuffer | None],
        glow: LightingBuffer | None,
        where: NDArray[np.intp],
    ) -> Planes:
        """Unit lights, by their indices, on some pixels; those of no buffer are dark."""
        units = [self._index.units[i] for i in lights]
        planes = np.zeros((3, len(units), len(where)), dtype=np.float32)
        for i, unit in enumerate(units):
            buffer = buffers.get(unit.group)
            if buffer is None:
                continue
            found = planar(buffer, unit.layer, where)
            if found is None:
                raise InputError(self._folder / indexing.FILE, f"no layer {unit.layer!r} is kept", REMEDY)
            for layer_planes, values in zip(planes, found, strict=True):
                layer_planes[i] = values
        whole = np.array([unit.kind == "whole" for unit in units], dtype=np.bool_)
        return Planes(planes, None if glow is None else planar(glow, "", where), whole)

    def _captured_sun(self, buffers: Mapping[int, LightingBuffer]) -> relighting.Sun | None:
        """The strongest distant lamp of the captured light, in a view with these sets."""
        captured = self._index.captured
        assert captured is not None
        found: list[relighting.Sun] = []
        for place, weight in zip(captured.units, captured.weights, strict=True):
            unit = self._index.units[place]
            lamp = self._far.lamp(unit)
            own = [x for x in buffers[unit.group].layers if x.name == unit.layer]
            if lamp is not None and own:
                found.append(sun_of(lamp, own[0].direct, np.asarray(weight, np.float32)))
        return strongest(found)

    def light_camera(self, view: KeptView) -> Camera:
        """The camera that light was traced for."""
        rows, columns = view.light_size
        camera = view.camera
        return camera if (columns, rows) == (camera.width, camera.height) else camera.resized(columns, rows)

    def buffer(self, key: str, seen: Camera) -> LightingBuffer:
        """What was kept by a key, of a camera. Raises InputError: it is damaged."""
        found = self._kept.get(key, light_of(seen))
        if found is None:
            raise InputError(self._folder, f"the light of {seen.name!r} is damaged", REMEDY)
        return found

    def splats(self, view: KeptView, key: str | None) -> SplatLayer | None:
        """The splats as a camera sees them, or those in front of objects, by their key; None: there are none."""
        if key is None:
            return None
        found = self._kept.get(key, composite_of(view.camera, self._index.profile, self._index.linear))
        if found is None:
            name = view.camera.name
            raise InputError(self._folder, f"the composite of {name!r} is damaged", REMEDY)
        return found


def _shadow(surface: relighting.Lit, cover: F32, size: tuple[int, int], new: F32, bare: F32) -> F32:
    """(H, W, 3) light beside objects over that without them, where the proxy covers `cover` (h, w)."""
    without = relighting.Lit(beauty=bare, coverage=cover, albedo=surface.albedo)
    return relighting.shadow_of(replace(surface, beauty=new), without, size)
