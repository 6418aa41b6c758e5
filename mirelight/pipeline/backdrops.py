"""What stands around a capture: what a job puts behind its splats, and what its light has far away."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from mirelight.io.environment import read_environment
from mirelight.model import F32, Camera, Job, Lighting, SkyModel
from mirelight.model.lights import SUN
from mirelight.model.unit_lights import Unit
from mirelight.pipeline import requirements
from mirelight.relighting import backdrop
from mirelight.relighting.surroundings import Surroundings, surroundings_of


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


def around_unit(unit: Unit, resolved: Callable[[Lighting], Lighting], *, with_ground: bool) -> Surroundings | None:
    """The surroundings of a unit light; None where it has none.

    Args:
        unit: any.
        resolved: gives a lighting with a sun and a map in place of its sky model.
        with_ground: a sky model's has its share of the ground that the model counts on.
    """
    sky = unit.sky
    if sky is None:
        return surroundings_of(Lighting(lights=unit.lights, environment=unit.environment))
    found, with_ground = resolved(Lighting(sky=sky)), with_ground and isinstance(sky, SkyModel)
    albedo = sky.albedo if isinstance(sky, SkyModel) else np.zeros(3)
    if unit.part == SUN:
        around = surroundings_of(Lighting(lights=found.lights))
        if around is None or not with_ground:
            return around
        return replace(around, maps=(backdrop.ground_under(around.suns, albedo),))
    environment = found.environment
    if environment is not None and with_ground:
        environment = replace(environment, radiance=backdrop.with_lit_ground(environment.pixels, np.zeros(3), albedo))
    return surroundings_of(Lighting(environment=environment))
