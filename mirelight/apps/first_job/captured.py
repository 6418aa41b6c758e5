"""The light of a capture, where splats and the mesh beside them tell it well enough to start from."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mirelight.apps.first_job import beside, own_cameras
from mirelight.base.errors import RenderError
from mirelight.model import F64, RenderSettings, SplatCloud
from mirelight.proxy.guessed import Guess


@dataclass(frozen=True, slots=True)
class Known:
    """An estimate that nothing speaks against."""

    said: str  # what it found, a few words
    level: float  # its mean over the surface, irradiance / pi as luminance


def find(
    world: SplatCloud, proxy: beside.Proxy, cameras: own_cameras.Cameras | None, turn: F64, guess: Guess
) -> Known | None:
    """What is estimated; None where the two halves of the splats disagree, or it explains hardly anything.

    Args:
        world: the splats, in world space.
        proxy: the mesh that fits them.
        cameras: the capture's, that colours are looked at from; None: from guessed ones, where splats tell of any.
        turn: (3, 3) rotation from the splats' axes to the world.
        guess: gives the guessed ones.
    """
    from mirelight.estimate import estimate
    from mirelight.estimate.describe import doubted
    from mirelight.io.mesh import read_mesh
    from mirelight.lighting import captured_level
    from mirelight.proxy.capture_views import capture_views

    mesh = read_mesh(proxy.path, textures=False)
    if proxy.turned:
        mesh = replace(mesh, vertices=(mesh.vertices @ turn.T.astype(np.float32)), normals=None)
    settings = RenderSettings()
    try:
        views = capture_views(world, (), guess=guess) if cameras is None else cameras.views(world, turn)
        found = estimate(world, mesh, settings, views=views)
    except RenderError:
        return None
    if doubted(found):
        return None
    level = captured_level(world, mesh, found.lighting, settings, views)
    if not level > 0:
        return None
    if not found.sun.any():
        return Known("a sky without a sun", level)
    up = float(np.degrees(np.arcsin(np.clip(found.to_sun[1], -1, 1))))
    return Known(f"a sun {up:.0f}° above the horizon, and a sky", level)
