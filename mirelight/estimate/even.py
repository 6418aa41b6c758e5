"""Even light in place of an estimate that is doubted: under a wrong sun frames come out worse than under none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mirelight.estimate.describe import doubted
from mirelight.estimate.tuning import TUNING
from mirelight.estimate.types import Estimate
from mirelight.lighting import captured_level
from mirelight.model import Lighting, ProxyMesh, RenderSettings, SplatCloud, SplatLayer


def or_even(
    found: Estimate,
    splats: SplatCloud,
    mesh: ProxyMesh,
    settings: RenderSettings,
    views: Sequence[SplatLayer] = (),
) -> Estimate:
    """The estimate; where it is doubted, light from all around that is as strong on the captured surface.

    An estimate that was given lamps stays: who names them knows that they were there. So does one of a room, into which
    light from all around would come through the windows alone.

    Args:
        found: from splats and mesh.
        splats: world space.
        mesh: world space.
        settings: that it was estimated with.
        views: what the capture's cameras see.

    Raises:
        BackendError: the variant cannot be used on this machine.
    """
    if found.named or not doubted(found):
        return found
    ones = np.ones_like(found.radiance)
    up = np.array([0.0, 1.0, 0.0])
    even = replace(found, to_sun=up, sun=np.zeros(3), lamps=np.zeros((0, 6)), radiance=ones)
    level, unit = (captured_level(splats, mesh, x.lighting, settings, views) for x in (found, even))
    if unit < TUNING.doubt_open:
        return found
    return replace(even, radiance=ones * (level / unit)) if level > 0 else even


def is_even(light: Lighting) -> bool:
    """Whether a lighting is the same from all around, as :func:`or_even` makes it."""
    around = light.environment
    dark = all(x.intensity == 0 for x in light.lights)
    return dark and around is not None and bool(np.ptp(around.pixels.reshape(-1, 3), axis=0).max() == 0)
