"""A room with coloured walls and one window, captured with a patch of sun on its floor that ends at white.

Exposed as a camera exposes by itself: for the room, whose light comes from the patch, and not for the patch. It is not
shipped: `scripts/bench truth` makes it where it is needed.
"""

from __future__ import annotations

import numpy as np

from mirelight.model import Camera, Lighting
from scenegen.geometry import Part, blob, boxes, lathe, place, rectangle, sheet, soups
from scenegen.interior import lamps, orbit, outside, sunlight
from scenegen.recipe import Recipe
from scenegen.textures import Surface, painted_tiles, plain, plaster, srgb, wood
from scenegen.truth import Looks

EXPOSURE = 5.0  # of the captured light
WIDE, HIGH, DEEP, WALL = 2.4, 2.6, 1.9, 0.2  # metres: x from -WIDE to WIDE, z from -DEEP to DEEP
GAP = 0.1  # between what the room shows and the slabs behind: nearer, splats would lie on both
WINDOW = (-0.45, 0.5)  # along z, in the wall at +X
SILL, LINTEL = 1.0, 1.95
LAMPS = ((-0.4, 2.0, -0.3), (-1.9, 1.3, -1.4))


def surfaces() -> dict[str, Surface]:
    """Every material of the room."""
    return {
        "red wall": Surface(
            texture=plaster(srgb(214, 140, 118), srgb(204, 130, 108), srgb(180, 116, 98), 301), size=2.6
        ),
        "teal wall": Surface(
            texture=plaster(srgb(140, 186, 182), srgb(128, 172, 170), srgb(112, 150, 150), 305), size=2.4
        ),
        "cream wall": Surface(
            texture=plaster(srgb(226, 212, 184), srgb(210, 194, 166), srgb(186, 168, 142), 309), size=2.4
        ),
        "ceiling": Surface(texture=plain(srgb(230, 226, 220), 313, contrast=0.03), size=2.0),
        "boards": Surface(texture=wood(srgb(202, 160, 116), srgb(150, 108, 74), 317, size=1024), size=2.4),
        "rug": Surface(texture=plain(srgb(210, 120, 92), 321, contrast=0.1), size=0.5),
        "frame": Surface(texture=plain(srgb(228, 226, 218), 325, contrast=0.04), size=0.5),
        "oak": Surface(texture=wood(srgb(176, 132, 86), srgb(112, 78, 48), 329), size=1.2),
        "sofa": Surface(texture=plain(srgb(70, 84, 120), 333, contrast=0.14), size=0.5),
        "cushion": Surface(texture=plain(srgb(214, 158, 60), 337, contrast=0.12), size=0.4),
        "tiles": Surface(texture=painted_tiles(96, 4, 3), size=1.6),
        "glaze": Surface(texture=plain(srgb(52, 118, 92), 341, contrast=0.2), size=0.5, roughness=0.25),
    }


def _shell() -> list[Part]:
    """Surfaces that the room shows, in small pieces as proxies have them; slabs well behind them keep the light out."""
    out = GAP + WALL / 2
    long, deep = 2 * (WIDE + GAP + WALL), 2 * (DEEP + GAP + WALL)
    x, low, high = WIDE + WALL / 2, -GAP - WALL, HIGH + GAP + WALL
    tall = high - low
    a, b = WINDOW
    parts = [
        boxes((0, -out, 0), (long, WALL, deep), "boards", bevel=0.001),
        boxes((0, HIGH + out, 0), (long, WALL, deep), "ceiling", bevel=0.001),
        boxes((-WIDE - out, HIGH / 2, 0), (WALL, tall, deep), "red wall", bevel=0.001),
        boxes((0, HIGH / 2, -DEEP - out), (long, tall, WALL), "teal wall", bevel=0.001),
        boxes((0, HIGH / 2, DEEP + out), (long, tall, WALL), "cream wall", bevel=0.001),
        boxes((x, (low + SILL) / 2, 0), (WALL, SILL - low, deep), "cream wall", bevel=0.001),
        boxes((x, (LINTEL + high) / 2, 0), (WALL, high - LINTEL, deep), "cream wall", bevel=0.001),
    ]
    for one, other in ((-deep / 2, a), (b, deep / 2)):
        size = (WALL, LINTEL - SILL + 0.02, other - one)
        parts.append(boxes((x, (SILL + LINTEL) / 2, (one + other) / 2), size, "cream wall", bevel=0.001))
    middle, half, opening = (a + b) / 2, (SILL + LINTEL) / 2, LINTEL - SILL
    rails = [[x, SILL + 0.03, middle], [x, LINTEL - 0.03, middle], [x, half, a + 0.03], [x, half, b - 0.03]]
    sizes = [[0.06, 0.06, b - a], [0.06, 0.06, b - a], [0.06, opening, 0.06], [0.06, opening, 0.06]]
    parts.append(boxes([*rails, [x, half, middle]], [*sizes, [0.05, opening, 0.05]], "frame", bevel=0.005))
    parts.append(boxes((WIDE - 0.04, SILL + 0.015, middle), (0.2, 0.03, b - a + 0.2), "oak", bevel=0.006))
    return [*parts, *_faces()]


def _faces() -> list[Part]:
    w, d, h = 2 * WIDE, 2 * DEEP, HIGH
    return [
        rectangle((-WIDE, 0, DEEP), (w, 0, 0), (0, 0, -d), "boards", 0.12),
        rectangle((-WIDE, h, -DEEP), (w, 0, 0), (0, 0, d), "ceiling", 0.12),
        rectangle((-WIDE, 0, DEEP), (0, 0, -d), (0, h, 0), "red wall", 0.12),
        rectangle((-WIDE, 0, -DEEP), (w, 0, 0), (0, h, 0), "teal wall", 0.12),
        rectangle((WIDE, 0, DEEP), (-w, 0, 0), (0, h, 0), "cream wall", 0.12),
    ]


def _things() -> list[Part]:
    """A rug that the sun reaches, a sofa, a low table with a vase, a chest, a picture."""
    s, t = np.meshgrid(np.linspace(-0.75, 1.15, 40), np.linspace(-0.65, 0.75, 40), indexing="ij")
    rug = sheet(np.stack([s, 0.012 + 0 * s, t], axis=-1), "rug", flip=True)
    seat = [[-1.9, 0.24, 0.3], [-2.18, 0.5, 0.3], [-1.9, 0.33, -0.62], [-1.9, 0.33, 1.22]]
    sizes = [[0.8, 0.3, 1.7], [0.24, 0.6, 1.7], [0.8, 0.5, 0.14], [0.8, 0.5, 0.14]]
    sofa = boxes(seat, sizes, "sofa", bevel=0.05, seed=1)
    cushions = [
        blob((-1.95, 0.56, z), (0.12, 0.19, 0.2), "cushion", 0.06, k, rings=24) for k, z in ((0, -0.3), (1, 0.9))
    ]
    top = boxes((-0.85, 0.41, -0.1), (0.6, 0.04, 0.9), "oak", bevel=0.01, seed=3)
    at = [[-0.85 + x * 0.26, 0.2, -0.1 + z * 0.4] for x in (-1, 1) for z in (-1, 1)]
    legs = boxes(at, (0.05, 0.39, 0.05), "oak", bevel=0.006, seed=4)
    outline = [(0.0, 0.0), (0.07, 0.0), (0.11, 0.08), (0.12, 0.16), (0.06, 0.27), (0.05, 0.31), (0.07, 0.35)]
    vase = lathe([*outline, (0.05, 0.34), (0.035, 0.3)], "glaze", 40).moved(place(-0.85, 0.43, -0.2))
    chest = boxes((0.5, 0.4, -DEEP + 0.24), (1.3, 0.8, 0.44), "oak", bevel=0.01, seed=5)
    books = boxes(
        [[0.2, 0.83, -1.66], [0.22, 0.87, -1.66]], [[0.3, 0.05, 0.2], [0.26, 0.04, 0.17]], "sofa", bevel=0.004
    )
    picture = boxes((-0.9, 1.5, -DEEP + 0.02), (0.8, 0.6, 0.04), "oak", bevel=0.01)
    canvas = boxes((-0.9, 1.5, -DEEP + 0.03), (0.7, 0.5, 0.04), "tiles", bevel=0.002)
    return [rug, sofa, *cushions, top, legs, vase, chest, books, picture, canvas]


def looks() -> Looks:
    """Geometry and materials."""
    return Looks(soups=soups(_shell() + _things()), surfaces=surfaces())


def recipe() -> Recipe:
    """How the scene is made."""
    k = EXPOSURE
    day = Lighting(
        name="sunny",
        lights=(sunlight(-6, 33, (1.0, 0.93, 0.82), 14.0 * k, 0.6),),
        environment=outside("sky", 2.5 * k, (0.5 * k, 0.4 * k, 0.3 * k), -6, 33),
    )
    overcast = Lighting(name="overcast", environment=outside("clouds", 50.0, (0, 0, 0), 0, 90))
    low = Lighting(
        name="low sun",
        lights=(sunlight(14, 20, (1.0, 0.62, 0.32), 24.0, 0.9),),
        environment=outside("evening sky", 8.0, (8.0, 4.0, 1.6), 14, 20),
    )
    eye, target = (1.95, 1.55, 1.5), (-0.7, 0.75, -0.55)
    front = Camera.look_at(eye, target, 960, 540, yfov=58, name="front")
    across = (
        ((-1.8, 1.7, -1.4), (1.4, 0.8, 1.1)),
        ((-1.7, 1.6, 1.6), (1.2, 0.9, -1.1)),
        ((1.9, 1.7, -1.3), (-1, 0.8, 1)),
    )
    return Recipe(
        name="sunroom",
        title="A room captured with a patch of sun on its floor; relit by clouds, lamps and a low sun.",
        looks=looks,
        captured=day,
        lightings=(overcast, lamps(LAMPS, (2.4, 1.2)), low),
        cameras=(front,),
        orbit=(front, *orbit(eye, target, across)),
        pixels_per_splat=4.0,
        spacing=(0.02, 0.07),
        proxy_faces=48_000,
        proxy_error=0.004,
    )
