"""What a job's display settings put behind its splats, camera by camera."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from mirelight.io.environment import read_environment
from mirelight.model import F32, Camera, Job, Lighting, SkyModel
from mirelight.pipeline import requirements
from mirelight.relighting import backdrop
from mirelight.relighting.surroundings import surroundings_of


class Backdrops:
    """Makes what stands behind the frames of a job.

    Args:
        job: whose `display.backdrop` is followed.
        resolved: gives a lighting with a sun and a map in place of its sky model.
    """

    def __init__(self, job: Job, resolved: Callable[[Lighting], Lighting]) -> None:
        self._job, self._resolved = job, resolved
        how = job.display.backdrop
        self._behind = None if how is None else backdrop.Behind(how, read_environment)

    def of(self, camera: Camera, lighting: Lighting | None) -> F32 | None:
        """(H, W, 3) linear light behind a frame; None where there is none and a plain colour stands in.

        Args:
            camera: of the frame.
            lighting: of the frame; None: it shows the splats as captured, and what stood around them.

        Raises:
            InputError: the picture cannot be used.
        """
        if self._behind is None or not requirements.wants_backdrop(self._job):
            return None
        shown = requirements.shown_around(self._job, lighting)
        return self._behind.of(
            camera, shown, lambda: None if shown is None else surroundings_of(self._with_ground(shown))
        )

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
