"""A job's light on the surface: cells and unit lights, each found where it was kept, or made by one process."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

from mirelight.base.progress import CountProgress
from mirelight.model import CellLight, Job, Lighting, SurfaceCache, SurfaceCells, SurfaceTransport
from mirelight.model.shown import count
from mirelight.model.unit_lights import LightSet
from mirelight.pipeline import keys, requirements
from mirelight.pipeline.artefact_cache import WAIT, ArtefactCache, made_once
from mirelight.pipeline.codecs import CELLS, lights_on, transport_between

if TYPE_CHECKING:
    from mirelight.lighting import Tracer


_MOST_BYTES = 2**30  # of light that stays in memory
_MEASURED = 1 << 11  # cells by which it is told how long all of them take
FILL = 0x1B873593  # between the seeds of fills that are averaged


class SurfaceLight:
    """Found or made when it is first asked for.

    A unit light's values do not depend on what it is filled together with, so each is kept by itself: a lamp that is
    added to a lighting is the only one that is filled.

    Args:
        job: whose light is read from the surface.
        made: its keys.
        kept: where light is found and kept.
        tracer: of the job's proxy.
        lighting_of: what to trace for a set.
        tell: called with a line before something that takes long.
    """

    def __init__(
        self,
        job: Job,
        made: keys.Keys,
        kept: ArtefactCache,
        tracer: Tracer,
        lighting_of: Callable[[LightSet], Lighting],
        tell: Callable[[str], None],
    ) -> None:
        self._job, self._keys, self._kept = job, made, kept
        self._lighting_of, self._tracer, self._tell = lighting_of, tracer, tell
        self._lights: dict[str, tuple[CellLight, ...]] = {}

    @cached_property
    def cells(self) -> SurfaceCells:
        """The pieces of the proxy that light is kept on."""
        key = self._keys.surface_cells
        return made_once(self._kept, _claim(key), key, CELLS, self._tracer.cells)

    @cached_property
    def transport(self) -> SurfaceTransport:
        """How light goes between the cells, whatever the light.

        Raises:
            RenderError: it does not fit in memory.
        """
        key = self._keys.surface_transport

        def make() -> SurfaceTransport:
            self._tell(f"finding how light goes between {len(self.cells):,} pieces of the surface, for any light")
            return self._tracer.transport(self.cells)

        return made_once(self._kept, _claim(key), key, transport_between(len(self.cells)), make)

    def cache(self, light_set: LightSet, progress: CountProgress | None = None) -> SurfaceCache:
        """A set's light, its layers named as the set's are.

        Args:
            light_set: of the job.
            progress: called while it is gathered.

        Raises:
            RenderError: the light of so many cells does not fit in memory.
        """
        parts = {self._keys.surface_light(part): part for part in light_set.parts()}
        said = False
        while missing := [key for key in parts if not self._find(key)]:
            with ExitStack() as held:
                mine = [key for key in missing if held.enter_context(self._kept.claim(_claim(key)))]
                mine = [key for key in mine if not self._find(key)]  # made while the claim was taken
                if mine:
                    self._fill({key: parts[key] for key in mine}, progress)
            if not mine:
                if not said:
                    self._tell("another process gathers the light on the surface; waiting for it")
                said = True
                time.sleep(WAIT)
        lights = [self._lights[key] for key in parts]
        if light_set.units:
            named = [replace(light, name=str(i)) for i, part in enumerate(lights) for light in part]
        else:
            named = [light for part in lights for light in part]
        self._make_room(parts)
        return SurfaceCache(cells=self.cells, lights=tuple(named))

    def _find(self, key: str) -> bool:
        """Whether a part is in memory, where it is brought to if it is kept."""
        if key not in self._lights:
            found = self._kept.get(key, lights_on(len(self.cells)))
            if found is None:
                return False
            self._lights[key] = found
        return True

    def seconds(self, parts: Sequence[LightSet]) -> tuple[float, float]:
        """About how long it takes to find the rays between all cells, and to gather the light of parts along them.

        Measured on some of the cells, and twice, as the first time compiles. How many fills a noise target takes is not
        known before there is one.
        """
        some, whole = self.cells.some(_MEASURED), _together(parts)
        lighting = self._lighting_of(whole)
        for _ in range(2):
            began = time.perf_counter()
            transport = self._tracer.transport(some)
            found = time.perf_counter()
            self._tracer.fill(some, lighting, transport=transport, emission=_glows(whole))
            gathered = time.perf_counter()
        scale = len(self.cells) / max(len(some), 1)
        return scale * (found - began), scale * (gathered - found)

    def _fill(self, parts: dict[str, LightSet], progress: CountProgress | None) -> None:
        """Make parts together, as they share rays, and keep each by itself."""
        whole = _together(list(parts.values()))
        self._tell(
            f"gathering the light of {self._named(whole)} on {len(self.cells):,} pieces of the surface; "
            "it is kept for the next time"
        )
        lighting, emission = self._lighting_of(whole), _glows(whole)
        made = self._tracer.fill(self.cells, lighting, transport=self.transport, emission=emission, progress=progress)
        if self._job.render.noise is not None:
            made = self._fill_to_noise_target(made, lighting, emission, self._job.render.noise)
        by_name = {light.name: light for light in made.lights}
        for i, key in enumerate(parts):
            self._lights[key] = (by_name[str(i)],) if whole.units else made.lights
            self._kept.put(key, self._lights[key], lights_on(len(self.cells)))

    def _named(self, whole: LightSet) -> str:
        """Light for people: how many sources, and the first of the job's lightings that takes them."""
        if whole.glow:
            return "what glows"
        sources, own = count(len(whole.units) or 1, "source"), {x.digest for x in whole.parts()}
        every = {x.name: x for x in requirements.with_compared(self._job, self._job.lightings)}
        for number, (name, lighting) in enumerate(every.items(), 1):
            if any(x.digest in own for one in self._keys.mixture(lighting).sets for x in one.parts()):
                return f"lighting {name} ({number} of {len(every)}, {sources})"
        return sources

    def _fill_to_noise_target(
        self, first: SurfaceCache, lighting: Lighting, emission: bool, target: float
    ) -> SurfaceCache:
        """As many fills, averaged, as bring the job's pictures to their noise target at least cost."""
        from mirelight.lighting.budget import averaged

        tracer, cameras = self._tracer, requirements.lighting_cameras(self._job)
        if not cameras or not first.lights:
            return first
        rays, pixels = min(x.rays for x in first.lights), sum(x.width * x.height for x in cameras)
        noise = tracer.noise_of(lighting, cameras, first, emission=emission)
        times = noise.fills(target, rays * len(self.cells), pixels)
        self._tell(
            f"for a noise of {target:g}, light on the surface is gathered along {times * rays:,} rays of each piece; "
            f"{rays} leave a noise of {noise.of_fill**0.5:.2g}, a sample of each pixel {noise.of_sample**0.5:.2g}"
        )
        fills = [first]
        for k in range(1, times):
            own = replace(tracer.settings, seed=(tracer.settings.seed + FILL * k) & 0xFFFFFFFF)
            again = tracer.tuned(own, layers=True, aovs=False)
            fills.append(again.fill(self.cells, lighting, emission=emission))
        return averaged(fills)

    def _make_room(self, needed: dict[str, LightSet]) -> None:
        """Let go of what is not needed now, where there is much."""
        held = sum(2 * x.direct.nbytes for lights in self._lights.values() for x in lights)
        if held > _MOST_BYTES:
            self._lights = {key: x for key, x in self._lights.items() if key in needed}


def _together(parts: Sequence[LightSet]) -> LightSet:
    """Parts as one set."""
    units = tuple(unit for part in parts for unit in part.units)
    return LightSet(units) if units else parts[0]


def _glows(whole: LightSet) -> bool:
    """Whether what glows is a part of it."""
    return whole.whole is not None or whole.glow


def _claim(key: str) -> str:
    return f"surface {key[:24]}"
