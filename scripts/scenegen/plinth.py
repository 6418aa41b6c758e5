"""A thing out of doors: a bust-like vase on a plinth with fruit, before hedges, walked round under a clear sky.

It is not shipped: `scripts/bench truth` makes it where it is needed.
"""

from __future__ import annotations

import numpy as np

from mirelight.model import Camera
from scenegen.geometry import Part, blob, boxes, lathe, leaves, noise, sheet, soups, tube
from scenegen.recipe import Recipe
from scenegen.skies import clear, clouds, lamplit
from scenegen.textures import Surface, painted_tiles, palette, plain, plaster, srgb, stone
from scenegen.truth import Looks

HEDGES = ((-2.3, -1.6), (-1.3, -2.4), (1.9, -2.0), (2.6, 0.9), (-2.6, 1.2))  # x, z
CAMERAS = 44
FOCUS = np.array([0.0, 0.75, 0.0])


def surfaces() -> dict[str, Surface]:
    """Every material."""
    return {
        "paving": Surface(texture=painted_tiles(128, 4, 7), size=2.0),
        "ground": Surface(texture=plaster(srgb(150, 138, 112), srgb(124, 112, 88), srgb(100, 92, 70), 301), size=2.5),
        "stone": Surface(texture=stone(srgb(206, 200, 188), srgb(140, 132, 122), 303), size=0.8),
        "clay": Surface(texture=plain(srgb(176, 92, 58), 305, contrast=0.2), size=0.5),
        "fruit": Surface(texture=plain(srgb(190, 58, 40), 307, contrast=0.15), size=0.3),
        "wood": Surface(texture=plain(srgb(104, 78, 54), 309, contrast=0.2), size=0.6),
        "hedge": Surface(texture=palette([srgb(58, 92, 44), srgb(88, 124, 62), srgb(120, 148, 84)], 311), size=1.0),
    }


def _ground() -> list[Part]:
    s, t = np.meshgrid(np.linspace(-4.5, 4.5, 60), np.linspace(-4.5, 4.5, 60), indexing="ij")
    rise = 0.05 * noise(np.stack([s, t, 0 * s], -1), 3) - 0.06
    lawn = sheet(np.stack([s, rise, t], axis=-1), "ground", flip=True)
    return [lawn, boxes((0, -0.05, 0), (3.2, 0.12, 3.2), "paving", bevel=0.01)]


def _thing() -> list[Part]:
    outline = [(0.0, 0.0), (0.13, 0.0), (0.15, 0.03), (0.07, 0.08), (0.18, 0.26), (0.22, 0.42), (0.16, 0.56)]
    vase = lathe([(r, 0.71 + h) for r, h in [*outline, (0.1, 0.63), (0.15, 0.7), (0.12, 0.7), (0.08, 0.6)]], "clay", 48)
    ears = [
        tube([[0.1 * w, 1.33, 0], [0.3 * w, 1.36, 0], [0.32 * w, 1.18, 0], [0.2 * w, 1.08, 0]], 0.022, "clay", 10)
        for w in (-1.0, 1.0)
    ]
    plinth = boxes(
        [[0, 0.06, 0], [0, 0.36, 0], [0, 0.66, 0]], [[0.72, 0.12, 0.72], [0.5, 0.5, 0.5], [0.66, 0.1, 0.66]], "stone"
    )
    fruit = [
        blob((x, 0.06, z), 3 * (0.07,), "fruit", 0.06, k, 16) for k, (x, z) in enumerate(((0.55, 0.4), (0.68, 0.25)))
    ]
    bench = boxes(
        [[-0.9, 0.4, -0.9], [-1.2, 0.2, -0.75], [-0.6, 0.2, -1.05]],
        [[1.1, 0.05, 0.35], [0.06, 0.38, 0.3], [0.06, 0.38, 0.3]],
        "wood",
    )
    return [vase, *ears, plinth, *fruit, bench]


def _hedges() -> list[Part]:
    rng = np.random.default_rng(31)
    parts = []
    for k, (x, z) in enumerate(HEDGES):
        centre, radii = np.array([x, 0.55, z]), np.array([0.55, 0.75, 0.55])
        parts.append(blob(centre, 0.9 * radii, "hedge", 0.12, 40 + k, rings=24))
        out = rng.normal(size=(260, 3))
        out /= np.linalg.norm(out, axis=1, keepdims=True)
        parts.append(leaves(centre + 0.85 * radii * out, out + 0.6 * rng.normal(size=out.shape), 0.13, "hedge", rng))
    return parts


def looks() -> Looks:
    """Geometry and materials."""
    return Looks(soups=soups(_ground() + _thing() + _hedges()), surfaces=surfaces())


def recipe() -> Recipe:
    """How the scene is made."""
    night = lamplit((0.9, 1.6, 0.7), (1.0, 0.7, 0.42), 1.6, 0.12)
    orbit = []
    for k in range(CAMERAS):  # twice round, nearer and farther, as a person does it
        turn, away, high = 4 * np.pi * k / CAMERAS, (1.5, 2.1)[k % 2], (1.5, 1.15, 1.75)[k % 3]
        eye = np.array([away * np.sin(turn), high, away * np.cos(turn)])
        orbit.append(Camera.look_at(eye, np.add(FOCUS, (0, (0.0, -0.3)[k % 2], 0)), 960, 640, yfov=52, name=f"{k}"))
    front = Camera.look_at((0.9, 1.35, 1.75), FOCUS, 960, 640, yfov=45, name="front")
    return Recipe(
        name="plinth",
        title="A vase on a plinth, captured on a clear day; relit by a low sun, clouds and a lamp.",
        looks=looks,
        captured=clear("clear day", (35, 42), (1.0, 0.94, 0.85), 2.4, 0.9),
        lightings=(clear("low sun", (160, 16), (1.0, 0.6, 0.3), 2.6, 0.5), clouds(), night),
        cameras=(front,),
        orbit=tuple(orbit),
        pixels_per_splat=3.0,
        spacing=(0.01, 0.05),
        proxy_faces=30_000,
        proxy_error=0.004,
    )
