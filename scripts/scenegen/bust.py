"""A toy on a small round stand between two soft boxes, as people put things on a turntable: all around it is black.

It is not shipped, and nothing is tuned on it: `scripts/bench truth` makes it where it is needed.
"""

from __future__ import annotations

import numpy as np

from mirelight.base.conventions import unit
from mirelight.model import AreaLight, Camera, Environment, Lighting
from scenegen.geometry import F64, Part, blob, boxes, lathe, place, soups, spline, tube
from scenegen.recipe import Recipe
from scenegen.skies import clear, clouds, lamplit, towards
from scenegen.textures import Surface, palette, plain, srgb, wood
from scenegen.truth import Looks

CAMERAS = 54
RINGS = ((14, 1.05), (33, 1.15), (55, 1.0))  # degrees above the horizon, metres away
STAND = 0.035  # metres high
FOCUS = np.array([0.0, 0.165, 0.0])


def surfaces() -> dict[str, Surface]:
    """Every material."""
    return {
        "stand": Surface(texture=plain(srgb(92, 92, 96), 701, contrast=0.03), size=0.3),
        "body": Surface(texture=plain(srgb(222, 178, 64), 703, contrast=0.03), size=0.3),
        "belly": Surface(texture=plain(srgb(230, 226, 216), 705, contrast=0.02), size=0.3),
        "wing": Surface(texture=wood(srgb(196, 120, 66), srgb(128, 66, 34), 707), size=0.16),
        "dark": Surface(texture=plain(srgb(44, 42, 48), 709, contrast=0.05), size=0.2),
        "beak": Surface(texture=plain(srgb(206, 92, 40), 711, contrast=0.04), size=0.2),
        "scarf": Surface(texture=palette([srgb(60, 96, 150), srgb(90, 130, 180)], 713), size=0.05),
        "handle": Surface(texture=plain(srgb(150, 152, 156), 715, contrast=0.03), size=0.1),
    }


def duck() -> list[Part]:
    """A duck with a hat and boots: matt, as smooth as toys are."""
    ball = 36
    body = blob((0, 0.155, 0), (0.085, 0.08, 0.105), "body", 0.01, 1, ball)
    belly = blob((0, 0.15, 0.035), (0.072, 0.07, 0.082), "belly", 0.01, 2, ball)
    tail = blob((0, 0.195, -0.1), (0.035, 0.022, 0.045), "body", 0.02, 3, 24)
    head = blob((0, 0.275, 0.035), (0.058, 0.057, 0.058), "body", 0.01, 4, ball)
    neck = tube([[0, 0.2, 0.02], [0, 0.25, 0.03]], 0.045, "body", 24)
    beak = blob((0, 0.264, 0.1), (0.03, 0.011, 0.034), "beak", 0.0, 5, 24)
    eyes = [blob((s * 0.028, 0.293, 0.083), 3 * (0.009,), "dark", 0.0, 6, 16) for s in (-1, 1)]
    wings = [blob((s * 0.086, 0.16, -0.01), (0.016, 0.044, 0.068), "wing", 0.02, 7, 28) for s in (-1, 1)]
    brim = [(0.0, 0.0), (0.075, 0.0), (0.077, 0.004), (0.046, 0.008), (0.042, 0.05), (0.036, 0.056), (0, 0.058)]
    hat = lathe(brim, "dark", 40).moved(place(0, 0.315, 0.03))
    turn = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    ring = np.stack([0.047 * np.sin(turn), 0.225 + 0.004 * np.cos(2 * turn), 0.026 + 0.047 * np.cos(turn)], 1)
    scarf = tube(ring, 0.014, "scarf", 14, closed=True)
    end = boxes((0.03, 0.185, 0.095), (0.026, 0.07, 0.012), "scarf", bevel=0.003)
    legs = [tube([[s * 0.04, STAND, 0.01], [s * 0.04, 0.1, 0.01]], 0.014, "beak", 16) for s in (-1, 1)]
    boots = [blob((s * 0.04, STAND + 0.018, 0.03), (0.026, 0.02, 0.045), "dark", 0.0, 8, 24) for s in (-1, 1)]
    return [body, belly, tail, head, neck, beak, *eyes, *wings, hat, scarf, end, *legs, *boots]


def beside() -> list[Part]:
    """A basket with a thin handle, and a block."""
    basket = lathe([(0, 0), (0.03, 0), (0.038, 0.05), (0.034, 0.05), (0.028, 0.006), (0, 0.006)], "wing", 36)
    at = place(0.13, STAND, 0.06)
    arch = spline([[-0.036, 0.045, 0], [-0.03, 0.09, 0], [0, 0.112, 0], [0.03, 0.09, 0], [0.036, 0.045, 0]], 40)
    block = boxes((-0.13, STAND + 0.022, 0.07), (0.044, 0.044, 0.044), "belly", bevel=0.003, frames=_turned(28))
    return [basket.moved(at), tube(arch, 0.0035, "handle", 10).moved(at), block]


def _turned(degrees: float) -> F64:
    return place(turn=degrees)[:3, :3]


def looks() -> Looks:
    """Geometry and materials."""
    stand = lathe([(0, 0), (0.2, 0), (0.205, 0.006), (0.205, 0.029), (0.2, STAND), (0, STAND)], "stand", 72)
    return Looks(soups=soups([*duck(), stand, *beside()]), surfaces=surfaces())


def _softbox(name: str, azimuth: float, elevation: float, size: tuple[float, float], radiance: float) -> AreaLight:
    """A rectangle that looks at the toy, 1.5 m from it and above all pictures."""
    back = towards(azimuth, elevation)  # it shines along its -Z
    across = unit(np.cross([0.0, 1.0, 0.0], back))
    pose = np.eye(4)
    pose[:3, :3] = np.stack([across, np.cross(back, across), back], axis=1)
    pose[:3, 3] = FOCUS + 1.5 * back
    return AreaLight(name=name, shape="rectangle", world_from_light=pose, size=size, intensity=radiance)


def recipe() -> Recipe:
    """How the scene is made."""
    boxes_of_light = (_softbox("key", 40, 52, (0.6, 0.6), 15.0), _softbox("side", 165, 50, (0.5, 0.7), 6.5))
    fill = Environment(name="fill", radiance=np.full((16, 32, 3), 0.12, np.float32))
    rings = []
    for k in range(CAMERAS):
        elevation, away = RINGS[k // 18]
        eye = FOCUS + away * towards(20 * k + 7 * (k // 18), elevation)
        rings.append(Camera.look_at(eye, FOCUS, 960, 640, yfov=29, name=f"{k}"))
    front = Camera.look_at(FOCUS + 1.2 * towards(70, 20), FOCUS, 960, 640, yfov=27, name="front")
    return Recipe(
        name="bust",
        title="A toy on a stand, captured between soft boxes; relit by a low sun, by clouds and by a lamp.",
        looks=looks,
        captured=Lighting(name="soft boxes", lights=boxes_of_light, environment=fill),
        lightings=(
            clear("low sun", (150, 16), (1.0, 0.62, 0.32), 2.6, 0.5),
            clouds(),
            lamplit((0.5, 0.55, 0.5), (1.0, 0.72, 0.45), 0.45, 0.1),
        ),
        cameras=(front,),
        orbit=tuple(rings),
        pixels_per_splat=3.0,
        spacing=(0.001, 0.01),
        proxy_faces=30_000,
        proxy_error=0.0005,
    )
