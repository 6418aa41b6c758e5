"""What a job's display settings put behind its splats, camera by camera."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from mirelight.io.environment import read_environment
from mirelight.model import F32, Backdrop, Camera, Job, Lighting, SkyModel
from mirelight.pipeline import requirements
from mirelight.relighting import backdrop
from mirelight.relighting.surroundings import Surroundings, surroundings_of


class Backdrops:
    """Makes them; surroundings that were blurred or shrunk for the last lighting are kept.

    Args:
        job: whose `display.backdrop` is followed.
        resolved: gives a lighting with a sun and a map in place of its sky model.
    """

    def __init__(self, job: Job, resolved: Callable[[Lighting], Lighting]) -> None:
        self._job, self._resolved = job, resolved
        self._last: tuple[Lighting, float, Surroundings | None] | None = None
        self._picture: F32 | None = None

    def of(self, camera: Camera, lighting: Lighting | None) -> F32 | None:
        """(H, W, 3) linear light behind a frame; None where there is none and a plain colour stands in.

        Args:
            camera: of the frame.
            lighting: of the frame; None: it shows the splats as captured, and what stood around them.

        Raises:
            InputError: the picture cannot be used.
        """
        how = self._job.display.backdrop
        if how is None or not requirements.wants_backdrop(self._job):
            return None
        if how.picture is not None:
            if self._picture is None:
                self._picture = read_environment(how.picture)
            return backdrop.fitted(self._picture, camera, how.exposure)
        lighting = requirements.shown_around(self._job, lighting)
        around = None if lighting is None else self._around(lighting, how, camera.fx)
        return None if around is None else backdrop.seen(camera, around, how)

    def _around(self, lighting: Lighting, how: Backdrop, fx: float) -> Surroundings | None:
        last = self._last
        if last is None or last[0] is not lighting or last[1] != fx:
            found = surroundings_of(self._with_ground(lighting))
            self._last = last = lighting, fx, None if found is None else backdrop.prepared(found, how, fx)
        return last[2]

    def _with_ground(self, lighting: Lighting) -> Lighting:
        """The lighting resolved; the ground that a sky model counts on lies below its horizon, which has no light."""
        found, model = self._resolved(lighting), lighting.sky
        around = found.environment
        if not isinstance(model, SkyModel) or around is None:
            return found
        suns = [x for x in found.lights if x not in lighting.lights]
        lux = sum((x.color * x.intensity * max(0.0, model.to_sun[1]) for x in suns), np.zeros(3))
        sky = backdrop.with_lit_ground(around.pixels, lux / around.intensity, model.albedo)
        return replace(found, environment=replace(around, radiance=sky))
