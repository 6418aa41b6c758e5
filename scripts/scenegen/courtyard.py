"""The courtyard: captured on a hazy afternoon, relit by a low evening sun and by lanterns at night."""

from __future__ import annotations

import numpy as np

from mirelight.model import Camera, Environment, Lighting, PointLight, SpotLight
from scenegen.courtyard_fittings import lanterns, stairs, wall_fountain, well
from scenegen.courtyard_geometry import LANTERNS, arcade, floor, roof, side_walls, surfaces
from scenegen.courtyard_plants import planting
from scenegen.geometry import soups
from scenegen.recipe import Recipe
from scenegen.skies import Sky, sky, sunlit, towards
from scenegen.truth import Looks


def looks() -> Looks:
    """Geometry and materials."""
    built = floor() + arcade() + side_walls() + roof() + stairs() + well() + wall_fountain() + lanterns()
    return Looks(soups=soups(built + planting()), surfaces=surfaces())


def _day() -> Lighting:
    look = Sky(
        zenith=(0.26, 0.40, 0.68),
        horizon=(0.66, 0.72, 0.78),
        ground=(0.22, 0.18, 0.14),
        glow=(0.60, 0.52, 0.42),
        sun=towards(52, 50),
    )
    return sunlit("day", look, (1.0, 0.92, 0.80), 2.2, 4.0)


def _evening() -> Lighting:
    look = Sky(
        zenith=(0.10, 0.13, 0.30),
        horizon=(0.42, 0.30, 0.32),
        ground=(0.10, 0.06, 0.04),
        glow=(0.95, 0.42, 0.14),
        sun=towards(63, 17),
        spread=34.0,
        away=0.45,
    )
    return sunlit("evening", look, (1.0, 0.60, 0.28), 3.3, 0.9)


def _night() -> Lighting:
    look = Sky(
        zenith=(0.026, 0.050, 0.125),
        horizon=(0.045, 0.080, 0.165),
        ground=(0.004, 0.004, 0.006),
        glow=(0.16, 0.23, 0.36),
        sun=towards(150, 40),
        spread=26.0,
    )
    warm = np.array([1.0, 0.56, 0.22])
    lamps = [
        PointLight(name=f"lantern {k + 1}", position=np.array(at) - [0, 0.06, 0], color=warm, intensity=strength)
        for k, (at, strength) in enumerate(zip(LANTERNS, (3.0, 3.0, 2.6, 2.6), strict=True))
    ]
    gallery = PointLight(
        name="gallery", position=np.array([0.55, 2.5, -3.5]), color=np.array([1.0, 0.62, 0.30]), intensity=1.6
    )
    garden = SpotLight(
        name="olive uplight",
        position=np.array([2.95, 0.12, 2.25]),
        direction=np.array([0.34, 0.93, -0.14]),
        color=np.array([0.95, 0.86, 0.52]),
        intensity=2.6,
        inner_cone_angle=float(np.radians(18)),
        outer_cone_angle=float(np.radians(40)),
    )
    over_well = SpotLight(
        name="well lamp",
        position=np.array([0.62, 1.85, 1.30]),
        direction=np.array([-0.12, -1.0, -0.05]),
        color=np.array([1.0, 0.66, 0.34]),
        intensity=2.2,
        inner_cone_angle=float(np.radians(30)),
        outer_cone_angle=float(np.radians(62)),
    )
    return Lighting(
        name="night",
        lights=(*lamps, gallery, garden, over_well),
        environment=Environment(name="moonlight", radiance=sky(look, 64)),
    )


def _around(centre: tuple[float, float, float], target: tuple[float, float, float], yfov: float) -> tuple[Camera, ...]:
    """Cameras of a small orbit about one view, as a person would capture it."""
    moves = ((0, 0, 0), (-0.9, 0.1, -0.2), (0.8, -0.2, 0.1), (0.1, 0.7, -0.5), (-0.3, -0.6, -0.4))
    return tuple(
        Camera.look_at(np.add(centre, m), target, 960, 540, yfov=yfov, name=f"{k}") for k, m in enumerate(moves)
    )


def recipe() -> Recipe:
    """How the scene is made."""
    front = Camera.look_at((2.55, 2.15, 5.9), (-0.42, 1.62, -1.6), 960, 540, yfov=43, name="front")
    fountain = Camera.look_at((-2.25, 1.75, 4.7), (1.9, 1.36, -1.0), 960, 540, yfov=43, name="fountain")
    orbit = _around((2.55, 2.15, 5.9), (-0.3, 1.62, -1.6), 46) + _around((-2.25, 1.75, 4.7), (1.9, 1.36, -1.0), 46)
    return Recipe(
        name="courtyard",
        title="A courtyard captured on a hazy afternoon; relit by the evening sun and by lanterns at night.",
        looks=looks,
        captured=_day(),
        lightings=(_evening(), _night()),
        cameras=(front, fountain),
        orbit=(front, fountain, *orbit),
        pixels_per_splat=2.25,
        spacing=(0.010, 0.055),
        proxy_faces=90_000,
        proxy_error=0.004,
    )
