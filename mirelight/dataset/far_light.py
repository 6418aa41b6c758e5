"""What the lightings of a data set have far away: suns and maps as they were kept, and what stands behind frames."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path

import numpy as np

from mirelight.base.errors import InputError
from mirelight.io.environment import read_environment
from mirelight.model import F32, F64, ParallelLight, SunLight
from mirelight.pipeline.captured_sun import one_distant
from mirelight.pipeline.codecs import ARRAY
from mirelight.relighting import FarMaps, backdrop
from mirelight.relighting.surroundings import Map, Sun, Surroundings
from mirelight.store.artefacts import Artefacts
from mirelight.store.layer_index import Around, Index, KeptView, UnitLight, Weighted


class FarLight:
    """Suns and maps of a data set's unit lights.

    Args:
        folder: the data set's, for messages.
        index: what its job says.
        kept: what is kept once a scene.
        remedy: what to do where a kept thing is damaged.
    """

    def __init__(self, folder: Path, index: Index, kept: Artefacts, remedy: str) -> None:
        self._folder, self._index, self._kept, self._remedy = folder, index, kept, remedy
        self._far_maps = FarMaps()

    def array(self, key: str) -> F32:
        """A map (h, w, 3), suns (n, 7) or a level (1,), as it was kept. Raises InputError."""
        found = self._kept.get(key, ARRAY)
        if found is None and self._kept.has(key, ARRAY):
            raise InputError(self._folder, "a kept map, sun or level is damaged", self._remedy)
        if found is None:
            raise InputError(self._folder, "a map or sun was not kept", "render the job again: nothing else is made")
        return found

    def suns(self, around: Around) -> tuple[Sun, ...] | None:
        """The suns that light from far away was kept as; None where it is a map. Raises InputError."""
        values = self.array(around.key)
        if values.ndim == 3:
            return None
        wide, strength = values.astype(np.float64), around.intensity * np.asarray(around.color)
        return tuple(Sun(row[:3], row[3:6] * strength, float(row[6])) for row in wide)

    def lamp(self, unit: UnitLight) -> ParallelLight | None:
        """The one lamp that a unit light from far away is; None where it is none, or several."""
        if unit.kind != "sun":
            return None
        if unit.lights:
            return one_distant(unit.lights)
        suns = [sun for around in unit.around for sun in self.suns(around) or ()]
        lamps = [SunLight(name="sun", direction=x.direction, color=x.lux, angular_diameter=x.diameter) for x in suns]
        return one_distant(lamps)

    def of(self, lighting: Weighted, with_ground: bool = False) -> Surroundings | None:
        """The maps and suns of a lighting; None where it has none.

        Args:
            lighting: what it takes of the unit lights.
            with_ground: the ground that sky models count on lies below their horizon, as backgrounds show it; it
                sends no light into the scene.

        Raises:
            InputError: a map was not kept.
        """
        maps: list[Map] = []
        suns: list[Sun] = []
        for place, weight in zip(lighting.units, lighting.weights, strict=True):
            unit, factor = self._index.units[place], np.asarray(weight, dtype=np.float64)
            own = (Sun.of(light) for light in unit.lights if isinstance(light, ParallelLight))
            suns += _scaled(own, factor)
            for around in unit.around:
                found = self.suns(around)
                ground = np.asarray(around.ground) if with_ground and around.ground is not None else None
                if found is None:
                    sky = self.array(around.key)
                    if ground is not None:
                        sky = backdrop.with_lit_ground(sky, np.zeros(3), ground)
                    maps.append(Map(sky, around.rotation, factor * around.intensity * np.asarray(around.color)))
                    continue
                scaled = _scaled(found, factor)
                suns += scaled
                if ground is not None:
                    maps.append(backdrop.ground_under(tuple(scaled), ground))
        return Surroundings(tuple(maps), tuple(suns)) if maps or suns else None

    def far_map(self, weights: F32) -> F32:
        """What unit lights of these weights (L, 3) have far away, for splats there (`mirelight.relighting.far`).

        Raises:
            InputError: a map was not kept.
        """
        lit = [int(x) for x in np.flatnonzero(weights.any(axis=1))]
        alone = [Weighted("", (), (place,), ((1.0, 1.0, 1.0),)) for place in lit]
        return self._far_maps.of((x, weights[x], partial(self.of, own)) for x, own in zip(lit, alone, strict=True))

    def behind(self, view: KeptView, lighting: Weighted, alpha: F32) -> F32 | None:
        """(H, W, 3) linear light behind a frame of that alpha (H, W), as its job shows it; None: a plain colour."""
        if self._behind is None:
            return None
        behind = self._behind.of(view.camera, lighting, lambda: self.of(lighting, True))
        return behind if behind is None or view.composite is None else backdrop.without_leaks(behind, alpha)

    @cached_property
    def _behind(self) -> backdrop.Behind | None:
        how = self._index.display.backdrop
        return None if how is None else backdrop.Behind(how, read_environment)


def _scaled(suns: Iterable[Sun], factor: F64) -> list[Sun]:
    """Suns (n) of which each sends `factor` (3,) times its light."""
    return [replace(sun, lux=factor * sun.lux) for sun in suns]
