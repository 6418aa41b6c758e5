"""The stage: captured between soft boxes, relit by spots, by coloured gels and by a sunset."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from mirelight.base.conventions import unit
from mirelight.model import Camera, Environment, Lighting, SpotLight
from scenegen.geometry import soups
from scenegen.recipe import Recipe
from scenegen.skies import Sky, Softbox, sky, studio, towards
from scenegen.stage_geometry import stage, surfaces
from scenegen.truth import Looks


def looks() -> Looks:
    """Geometry and materials."""
    return Looks(soups=soups(stage()), surfaces=surfaces())


def _spot(
    name: str, position: ArrayLike, target: ArrayLike, color: ArrayLike, intensity: float, cone: tuple[float, float]
) -> SpotLight:
    at = np.asarray(position, dtype=np.float64)
    return SpotLight(
        name=name,
        position=at,
        direction=unit(np.asarray(target) - at),
        color=np.asarray(color, dtype=np.float64),
        intensity=intensity,
        inner_cone_angle=float(np.radians(cone[0])),
        outer_cone_angle=float(np.radians(cone[1])),
    )


def _studio() -> Lighting:
    soft = [
        Softbox(centre=towards(140, 32), size=(62, 50), radiance=(2.5, 2.45, 2.35)),
        Softbox(centre=towards(42, 30), size=(55, 50), radiance=(1.45, 1.5, 1.6)),
        Softbox(centre=towards(90, 72), size=(80, 40), radiance=(1.2, 1.2, 1.2)),
    ]
    return Lighting(name="studio", environment=Environment(name="softboxes", radiance=studio((0.22, 0.22, 0.23), soft)))


def _spots() -> Lighting:
    dim = Environment(name="house", radiance=studio((0.020, 0.022, 0.030), [], 32))
    lights = (
        _spot("key", (-2.3, 3.7, 3.3), (0.0, 1.15, 0.0), (1.0, 0.83, 0.62), 62.0, (11, 22)),
        _spot("rim", (1.75, 3.3, -1.15), (0.0, 1.3, 0.1), (0.62, 0.78, 1.0), 26.0, (20, 40)),
        _spot("fill", (3.0, 1.6, 3.6), (0.1, 0.8, 0.2), (0.75, 0.85, 1.0), 5.5, (20, 45)),
    )
    return Lighting(name="spots", lights=lights, environment=dim)


def _gels() -> Lighting:
    dim = Environment(name="house", radiance=studio((0.012, 0.010, 0.018), [], 32))
    lights = (
        _spot("magenta", (-3.0, 3.2, 2.6), (0.0, 1.0, -0.2), (1.0, 0.10, 0.55), 44.0, (16, 36)),
        _spot("cyan", (3.0, 3.2, 2.4), (0.0, 1.0, -0.2), (0.06, 0.62, 1.0), 44.0, (16, 36)),
        _spot("amber", (0.2, 3.9, -0.9), (0.0, 0.9, 0.3), (1.0, 0.55, 0.12), 26.0, (14, 34)),
    )
    return Lighting(name="gels", lights=lights, environment=dim)


def _sunset() -> Lighting:
    sun = towards(122, 16)
    look = Sky(
        zenith=(0.16, 0.22, 0.46),
        horizon=(0.62, 0.42, 0.36),
        ground=(0.12, 0.08, 0.06),
        glow=(7.5, 3.3, 0.9),
        sun=sun,
        spread=13.0,
        away=0.4,
    )
    return Lighting(name="sunset", environment=Environment(name="sunset sky", radiance=sky(look)))


def recipe() -> Recipe:
    """How the scene is made."""
    front = Camera.look_at((0.55, 1.70, 4.75), (0.02, 0.93, 0.0), 960, 540, yfov=33, name="front")
    low = Camera.look_at((-2.05, 0.95, 3.55), (0.05, 1.0, 0.1), 960, 540, yfov=38, name="low")
    moves = ((-0.8, 0.2, 0.0), (0.8, -0.2, -0.1), (0.0, 0.7, -0.3), (-1.5, -0.5, -0.4), (1.6, -0.3, -0.6))
    orbit = [
        Camera.look_at(np.add((0.55, 1.70, 4.75), m), (0.02, 0.93, 0.0), 960, 540, yfov=36, name=f"{k}")
        for k, m in enumerate(moves)
    ]
    orbit += [
        Camera.look_at(np.add((-2.05, 0.95, 3.55), m), (0.05, 1.0, 0.1), 960, 540, yfov=40, name=f"low {k}")
        for k, m in enumerate(((0.3, 0.5, 0.1), (-0.3, -0.2, -0.3), (0.9, -0.3, 0.3)))
    ]
    return Recipe(
        name="stage",
        title="A still life on a stage, captured between soft boxes; relit by spots, by gels and by a sunset.",
        looks=looks,
        captured=_studio(),
        lightings=(_spots(), _gels(), _sunset()),
        cameras=(front, low),
        orbit=(front, low, *orbit),
        pixels_per_splat=2.2,
        spacing=(0.005, 0.04),
        proxy_faces=48_000,
        proxy_error=0.004,
    )
