"""A job's light on its splats: where each lies on the proxy, and what unit lights bring there; kept, or made now.

Frames that are relit splat by splat, baked splats and the mixer's layers take the same values.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from copy import copy
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from mirelight import relighting
from mirelight.base.progress import ShareProgress, counted, quiet
from mirelight.model import (
    F32,
    Lighting,
    SurfaceCells,
    SurfaceTransport,
)
from mirelight.model.unit_lights import GLOW, LightSet, Unit
from mirelight.pipeline import requirements
from mirelight.pipeline.artefact_cache import made_once
from mirelight.pipeline.beyond import is_room
from mirelight.pipeline.codecs import array_of
from mirelight.pipeline.far_splats import FarSplats
from mirelight.pipeline.prepared import Prepared

if TYPE_CHECKING:
    from mirelight.lighting import Tracer
    from mirelight.lighting.splat_light import Places

EMISSION = "emission"
FEWEST_PATHS = 1 << 18  # below, light is traced: cells are not even looked for
READS = 2  # where indirect light is read, one in so many samples is enough for the direct light that is left
SHARP_READS = 8  # samples of lights that are a point or a direction, as then only what is read differs between them


class SplatLight:
    """Light on N splats, found or made when it is asked for.

    Args:
        scene: a prepared job with splats and a proxy, whose light is path-traced.
        spp: samples a splat.
        progress: hears what is traced; what it raises ends the tracing.
    """

    def __init__(self, scene: Prepared, spp: int, progress: ShareProgress | None = None) -> None:
        self._scene, self._spp, self._say = scene, spp, progress or quiet
        self._has_sky = True

    def with_samples(self, spp: int) -> SplatLight:
        """The same splats with other samples."""
        out = copy(self)
        out._spp = spp
        vars(out).pop("_transport", None)  # of as many rays as there are samples
        return out

    def of_scene(self, scene: Prepared) -> SplatLight:
        """The same places and tracer under another job's lights; `keys.proxy` and `keys.splat_places` agree."""
        out = copy(self)
        out._scene = scene
        if scene.keys.splat_sky != self._scene.keys.splat_sky:
            vars(out).pop("_far", None)
        return out

    @property
    def near(self) -> float:
        """Share of the splats that lie on the proxy; the others take the light of the nearest that does.

        Raises:
            RenderError: none does.
        """
        return self.places.near

    def factor(self, lighting: Lighting) -> F32:
        """(N, 3) what the splats' linear colours are multiplied by under a lighting, at full strength.

        Raises:
            RenderError: no splat lies on the proxy.
        """
        scene, job = self._scene, self._scene.job
        assert scene.splats is not None
        settings = job.relight_of(lighting)
        lit = self if settings.follows_sky else self._without_sky
        old = None
        captured = requirements.compared_in(job, lighting)
        if captured is not None:
            old = lit.of(captured)
        new = lit.of(lighting)
        return relighting.splat_relighter(
            relighting.captured_color(scene.splats),
            None if relighting.mode_of(settings).uses_proxy_colours else self.albedo,
            settings,
            captured=old,
            captured_level=None if old is None else scene.captured_level or 0.0,
        )(new)

    def of(self, lighting: Lighting) -> F32:
        """(N, 3) irradiance / pi under a lighting, and what the places send out themselves over their albedo."""
        mixture = self._scene.keys.splat_sets.mixture(lighting)
        weights = {term.unit.digest: term.weight for term in mixture.terms}
        out = np.zeros((len(self.places.points), 3))
        for number, one in enumerate(mixture.sets):
            if not one.units:
                continue
            light = self.light(one, f"set {number + 1} of {len(mixture.sets)}")
            for unit, values in zip(one.units, light, strict=True):
                if unit.digest in weights:
                    out += values * weights[unit.digest]
        if self._scene.glows:
            out += self.light(GLOW, "surfaces that glow")[0]
        return out.astype(np.float32)

    def light(self, one: LightSet, what: str) -> F32:
        """(units, N, 3) irradiance / pi of a set's unit lights; of GLOW one. Where the job's sky follows its light,
        splats of the sky have its radiance (`mirelight.pipeline.far_splats`).

        Args:
            one: a set.
            what: it is called in the progress.
        """
        key = self._scene.keys.splat_light(one, self._spp)
        layers = [EMISSION] if one.glow else [str(i) for i in range(len(one.units))]
        shape = len(layers), len(self.places.points), 3
        made = self._made_once(key, shape, lambda: np.stack(list(self._traced(one, layers, what))))
        if not self._sky_follows:
            return made
        units = (None,) if one.glow else one.units
        return np.stack([self.with_sky(light, unit) for light, unit in zip(made, units, strict=True)])

    def unit_lights(self, units: tuple[Unit, ...]) -> Iterator[F32]:
        """(N, 3) irradiance / pi of each of a few unit lights, as they may be for a moment: they are not kept."""
        made = self._traced(LightSet(units), [str(i) for i in range(len(units))], "")
        return (self.with_sky(light, unit) for light, unit in zip(made, units, strict=True))

    def with_sky(self, light: F32, unit: Unit | None) -> F32:
        """(N, 3) light of a unit light on the proxy, or of what glows (None), with that of the sky's splats."""
        if not self._sky_follows:
            return light
        return self._far.on(light, None if unit is None else self._scene.far_map([(unit, np.ones(3))]))

    @property
    def _sky_follows(self) -> bool:
        return self._has_sky and requirements.wants_beyond(self._scene.job)

    @cached_property
    def _far(self) -> FarSplats:
        scene = self._scene
        assert scene.splats is not None
        room = self.tracer.sight() if is_room(self.tracer) else None
        return FarSplats(scene.splats, scene.splat_distances, scene.job.capture_cameras, room)

    @property
    def _without_sky(self) -> SplatLight:
        """The same splats, each by its place on the proxy alone."""
        out = copy(self)
        out._has_sky = False
        return out

    @cached_property
    def albedo(self) -> F32:
        """(N, 3) of the proxy where the splats lie."""
        return self.tracer.materials_at(self.places.points, self.places.normals)[0]

    def _made_once(self, key: str, shape: Sequence[int], make: Callable[[], F32]) -> F32:
        """A kept array, or one made now; one process makes it, and others wait."""
        return made_once(self._scene.kept, f"splats {key[:24]}", key, array_of(shape), make)

    @cached_property
    def tracer(self) -> Tracer:
        """The tracer that lights the splats."""
        from mirelight.lighting import splat_light

        assert self._scene.proxy is not None
        return splat_light.tracer_for(self._scene.proxy, self._scene.job.render)

    @cached_property
    def places(self) -> Places:
        """Where the splats lie on the proxy.

        Raises:
            RenderError: none does.
        """
        from mirelight.lighting import splat_light

        scene = self._scene
        assert scene.proxy is not None and scene.splats is not None
        splats, proxy, captured = scene.splats, scene.proxy, scene.job.captured
        count = len(splats)

        def make() -> F32:
            reference = None if captured is None else scene.resolved(captured)
            found = splat_light.places_of(splats, proxy, self.tracer, reference, progress=self._say)
            rows = [found.points, found.normals, np.full((1, 3), found.near)]
            return np.concatenate(rows)

        kept = self._made_once(scene.keys.splat_places, (2 * count + 1, 3), make)
        points, normals = (np.asarray(x, np.float64) for x in (kept[:count], kept[count:-1]))
        return splat_light.Places(points, normals, float(kept[-1, 0]))

    def _traced(self, one: LightSet, layers: list[str], what: str) -> Iterator[F32]:
        points, normals = self.places.points, self.places.normals
        lighting, tracer = self._scene.lighting_of(one), self.tracer
        say = counted(self._say, what)
        if not self._reads_surface:
            made = [tracer.point_layers(lighting, points, normals, self._spp, emission=one.glow, progress=say)]
        else:
            cache = tracer.fill(self._cells, lighting, transport=self._transport, emission=one.glow, progress=say)
            made = [
                tracer.point_layers(part, points, normals, spp, emission=one.glow, cache=cache, progress=say)
                for part, spp in by_sharpness(lighting, max(self._spp // READS, 1), glow=one.glow)
            ]
        of_name = {name: (part, k) for part in made for k, name in enumerate(part.names)}
        for name in layers:
            part, k = of_name[name]
            light = np.asarray((part.direct[k] + part.indirect[k]) * np.float32(1 / np.pi), np.float32)
            yield light + self._own_glow if one.glow else light

    @cached_property
    def _own_glow(self) -> F32:
        """(N, 3) what the places send out themselves over their albedo."""
        from mirelight.lighting.appearance import own_glow

        return own_glow(self.tracer, self.places.points, self.places.normals)

    @cached_property
    def _cells(self) -> SurfaceCells:
        return self.tracer.cells()

    @cached_property
    def _transport(self) -> SurfaceTransport:
        return self.tracer.transport(self._cells, self._spp, counted(self._say, "rays between surfaces"))

    @property
    def _reads_surface(self) -> bool:
        """Whether indirect light is gathered on the surface first: where that is less work than paths from splats."""
        paths = len(self.places.points) * self._spp
        if self._scene.job.render.max_depth == 1 or paths <= FEWEST_PATHS:
            return False
        return paths > len(self._cells) * self._spp


def by_sharpness(lighting: Lighting, spp: int, *, glow: bool) -> Iterator[tuple[Lighting, int]]:
    """A lighting in parts, whose layers are whole, and the samples that each takes where reflected light is read."""
    soft = {x.group or x.name for x in lighting.lights if not x.is_sharp}
    sharp = tuple(x for x in lighting.lights if (x.group or x.name) not in soft)
    rest = replace(lighting, lights=tuple(x for x in lighting.lights if (x.group or x.name) in soft))
    if sharp:
        yield Lighting(name=lighting.name, lights=sharp), min(spp, SHARP_READS)
    if rest.lights or rest.environment is not None or rest.sky is not None or glow:
        yield rest, spp
