"""Things on a table in a kitchen, as a person captures them who walks round it: lit by a lamp over it and a window.

What stands along the walls is seen from afar alone, and only in passing. It is not shipped, and nothing is tuned on it:
`scripts/bench truth` makes it where it is needed.
"""

from __future__ import annotations

import numpy as np

from mirelight.model import Camera, Lighting, PointLight
from scenegen.geometry import Part, blob, boxes, lathe, leaves, place, sheet, soups, tube
from scenegen.interior import outside, sunlight
from scenegen.recipe import Recipe
from scenegen.textures import Surface, painted_tiles, palette, plain, plaster, srgb, stone, wood
from scenegen.truth import Looks

CAMERAS = 72
WIDE, HIGH, DEEP, WALL = 2.5, 2.5, 2.2, 0.2  # metres: x from -WIDE to WIDE, z from -DEEP to DEEP
WINDOW = (-0.9, 0.7)  # along x, in the wall at -Z
SILL, LINTEL = 1.05, 2.1
TOP = 0.76  # of the table
LAMP = np.array([0.15, 1.92, 0.1])


def surfaces() -> dict[str, Surface]:
    """Every material of the kitchen."""
    return {
        "wall": Surface(texture=plaster(srgb(222, 214, 198), srgb(206, 194, 172), srgb(184, 170, 148), 501), size=2.4),
        "ceiling": Surface(texture=plain(srgb(230, 228, 222), 503, contrast=0.03), size=2.0),
        "floor": Surface(texture=stone(srgb(168, 158, 146), srgb(112, 104, 98), 505), size=1.3),
        "table": Surface(texture=wood(srgb(188, 142, 94), srgb(120, 80, 50), 507, size=1024), size=1.6),
        "cabinet": Surface(texture=plain(srgb(92, 122, 116), 509, contrast=0.06), size=0.8),
        "worktop": Surface(texture=stone(srgb(214, 208, 200), srgb(150, 142, 136), 511), size=1.1),
        "tiles": Surface(texture=painted_tiles(96, 4, 15), size=0.9),
        "frame": Surface(texture=plain(srgb(226, 224, 216), 513, contrast=0.04), size=0.5),
        "enamel": Surface(texture=plain(srgb(186, 52, 44), 515, contrast=0.08), size=0.4),
        "china": Surface(texture=plain(srgb(224, 220, 210), 517, contrast=0.05), size=0.3),
        "blue": Surface(texture=plain(srgb(54, 84, 150), 519, contrast=0.12), size=0.3),
        "fruit": Surface(texture=palette([srgb(216, 148, 40), srgb(196, 74, 40), srgb(150, 160, 60)], 521), size=0.4),
        "bread": Surface(texture=plain(srgb(172, 116, 64), 523, contrast=0.3), size=0.25),
        "cloth": Surface(texture=plain(srgb(206, 190, 120), 525, contrast=0.2), size=0.2),
        "leaf": Surface(texture=palette([srgb(58, 104, 50), srgb(98, 142, 70)], 527), size=1.0),
        "clay": Surface(texture=plain(srgb(178, 104, 72), 529, contrast=0.12), size=0.4),
        "paper": Surface(texture=painted_tiles(128, 6, 31), size=0.5),
    }


def _shell() -> list[Part]:
    """Floor, ceiling and walls as slabs; a window with a bar in the far one."""
    out = WALL / 2
    long, deep = 2 * WIDE + 2 * WALL, 2 * DEEP + 2 * WALL
    z, tall, half = -DEEP - out, LINTEL - SILL, (SILL + LINTEL) / 2
    a, b = WINDOW
    sides = [(-WIDE - WALL, a), (b, WIDE + WALL)]
    bars = [[(a + b) / 2, SILL + 0.03, z], [(a + b) / 2, LINTEL - 0.03, z], [(a + b) / 2, half, z]]
    bars += [[a + 0.03, half, z], [b - 0.03, half, z]]
    sizes = [[b - a, 0.06, 0.07], [b - a, 0.06, 0.07], *3 * [[0.06, tall, 0.07]]]
    return [
        boxes((0, -out, 0), (long, WALL, deep), "floor", bevel=0.001),
        boxes((0, HIGH + out, 0), (long, WALL, deep), "ceiling", bevel=0.001),
        *(boxes((s * (WIDE + out), HIGH / 2, 0), (WALL, HIGH + 0.02, deep), "wall", bevel=0.001) for s in (-1, 1)),
        boxes((0, HIGH / 2, DEEP + out), (2 * WIDE + 0.02, HIGH + 0.02, WALL), "wall", bevel=0.001),
        boxes((0, SILL / 2, z), (long, SILL, WALL), "tiles", bevel=0.001),
        boxes((0, (LINTEL + HIGH) / 2, z), (long, HIGH - LINTEL + 0.02, WALL), "wall", bevel=0.001),
        *(boxes(((p + q) / 2, half, z), (q - p, tall + 0.02, WALL), "wall", bevel=0.001) for p, q in sides),
        boxes(bars, sizes, "frame", bevel=0.005),
    ]


def _along_walls() -> list[Part]:
    """Cabinets under the window and on the right, a shelf with pots on the left, a lamp that hangs over the table."""
    z = -DEEP + 0.3
    at = [[x, 0.43, z] for x in np.arange(-2.1, 2.2, 0.6)]
    doors = [[x, 0.45, z + 0.31] for x in np.arange(-2.1, 2.2, 0.6)]
    right = [[WIDE - 0.2, 1.75, zz] for zz in np.arange(-1.2, 1.3, 0.6)]
    pots = [lathe([(0, 0), (0.1, 0), (0.13, 0.2), (0.11, 0.2), (0, 0.03)], "enamel", 24).moved(place(-2.3, 1.42, q))
            for q in (-0.6, 0.1)]  # fmt: skip
    x, y, w = LAMP
    cord = tube([[x, HIGH, w], [x, y + 0.2, w]], 0.008, "clay", 8)
    shade = lathe([(0.02, 0.2), (0.06, 0.19), (0.2, 0.05), (0.205, 0.05), (0.07, 0.2), (0.02, 0.21)], "clay", 40)
    return [
        boxes(at, (0.6, 0.86, 0.6), "cabinet", bevel=0.004, seed=3),
        boxes(doors, (0.54, 0.74, 0.03), "cabinet", bevel=0.01, seed=4),
        boxes((0, 0.885, z), (2 * WIDE, 0.04, 0.64), "worktop", bevel=0.008),
        boxes(right, (0.36, 0.8, 0.58), "cabinet", bevel=0.01, seed=5),
        boxes((-2.3, 1.4, -0.25), (0.3, 0.03, 1.4), "table", bevel=0.004),
        *pots,
        cord,
        shade.moved(place(x, y, w)),
    ]


def _furniture() -> list[Part]:
    """The table and two chairs."""
    legs = [[x, TOP / 2 - 0.02, z] for x in (-0.62, 0.62) for z in (-0.38, 0.38)]
    parts = [
        boxes((0, TOP - 0.02, 0), (1.4, 0.04, 0.9), "table", bevel=0.008, seed=6),
        boxes(legs, (0.06, TOP - 0.04, 0.06), "table", bevel=0.006, seed=7),
    ]
    for side in (-1, 1):
        x = side * 0.25
        z = side * 0.75
        posts = [[x + dx, 0.22, z + dz] for dx in (-0.19, 0.19) for dz in (-0.18, 0.18)]
        parts.append(boxes(posts, (0.04, 0.44, 0.04), "table", bevel=0.004, seed=8))
        parts.append(boxes((x, 0.45, z), (0.44, 0.035, 0.42), "table", bevel=0.01, seed=9))
        back = [[x, 0.72, z + side * 0.19], [x, 0.9, z + side * 0.19]]
        parts.append(boxes(back, (0.42, 0.07, 0.025), "table", bevel=0.006, seed=10))
        uprights = [[x + dx, 0.7, z + side * 0.19] for dx in (-0.19, 0.19)]
        parts.append(boxes(uprights, (0.035, 0.5, 0.03), "table", bevel=0.004, seed=11))
    return parts


def _things() -> list[Part]:
    """What is captured: a kettle, mugs, a bowl of fruit, bread on a board, a plant, books, a cloth."""
    kettle = lathe(
        [(0, 0), (0.1, 0), (0.115, 0.05), (0.1, 0.13), (0.06, 0.17), (0.02, 0.18), (0.02, 0.205), (0, 0.21)],
        "enamel",
        40,
    ).moved(place(-0.3, TOP, -0.12))
    spout = tube([[-0.22, TOP + 0.07, -0.09], [-0.15, TOP + 0.12, -0.06], [-0.12, TOP + 0.17, -0.05]], 0.016, "enamel")
    arch = [
        [-0.39, TOP + 0.13, -0.15],
        [-0.35, TOP + 0.25, -0.14],
        [-0.25, TOP + 0.25, -0.1],
        [-0.21, TOP + 0.13, -0.09],
    ]
    handle = tube(arch, 0.01, "table", 10)
    cup = [(0, 0), (0.032, 0), (0.042, 0.09), (0.038, 0.09), (0.03, 0.01), (0, 0.01)]
    mugs = [lathe(cup, m, 32).moved(place(x, TOP, z)) for x, z, m in ((0.02, 0.22, "blue"), (-0.5, 0.18, "china"))]
    ear = [[0.06, TOP + 0.07, 0.22], [0.09, TOP + 0.06, 0.22], [0.09, TOP + 0.03, 0.22], [0.055, TOP + 0.02, 0.22]]
    bowl = lathe([(0, 0), (0.05, 0), (0.15, 0.08), (0.144, 0.08), (0.05, 0.012), (0, 0.012)], "china", 44)
    fruit = [
        blob((0.28 + x, TOP + y, -0.1 + z), 3 * (0.045,), "fruit", 0.05, k, 18)
        for k, (x, y, z) in enumerate(((-0.05, 0.06, 0.02), (0.05, 0.06, 0.03), (0, 0.06, -0.06), (0.01, 0.12, 0)))
    ]
    board = boxes((0.4, TOP + 0.012, 0.25), (0.34, 0.024, 0.22), "clay", bevel=0.006, seed=12)
    loaf = blob((0.38, TOP + 0.07, 0.25), (0.11, 0.06, 0.07), "bread", 0.06, 31, 26)
    rng = np.random.default_rng(61)
    pot = lathe([(0, 0), (0.06, 0), (0.085, 0.13), (0.09, 0.14), (0.075, 0.14), (0.07, 0.11), (0, 0.11)], "clay", 32)
    turn, rise = rng.uniform(0, 2 * np.pi, 60), rng.uniform(0.5, 2.0, 60)
    away = np.stack([np.sin(turn), rise, np.cos(turn)], axis=1)
    crown = leaves(rng.normal((0, 0.12, 0), 0.03, (60, 3)), away, rng.uniform(0.12, 0.26, 60), "leaf", rng, width=0.28)
    here = place(0.02, TOP, -0.3)
    books = boxes(
        [[-0.5, TOP + 0.018, -0.28], [-0.5, TOP + 0.05, -0.27]],
        [[0.2, 0.034, 0.26], [0.17, 0.03, 0.22]],
        "paper",
        bevel=0.003,
        seed=13,
    )
    s, t = np.meshgrid(np.linspace(-0.13, 0.13, 40), np.linspace(-0.1, 0.1, 32), indexing="ij")
    folds = TOP + 0.008 + 0.006 * np.sin(40 * s + 12 * t)
    cloth = sheet(np.stack([s - 0.25, folds, t + 0.3], -1), "cloth", flip=True)
    return [
        kettle,
        spout,
        handle,
        *mugs,
        tube(ear, 0.007, "blue", 8),
        bowl.moved(place(0.28, TOP, -0.1)),
        *fruit,
        board,
        loaf,
        pot.moved(here),
        crown.moved(here),
        books,
        cloth,
    ]


def looks() -> Looks:
    """Geometry and materials."""
    return Looks(soups=soups(_shell() + _along_walls() + _furniture() + _things()), surfaces=surfaces())


def recipe() -> Recipe:
    """How the scene is made."""
    warm = np.array([1.0, 0.74, 0.48])
    over = PointLight(name="lamp", position=LAMP, color=warm, intensity=2.6)
    beside = PointLight(name="lamp", position=np.array([-1.1, 1.25, 0.9]), color=warm, intensity=2.2)
    evening = Lighting(name="lamp", lights=(over,), environment=outside("dusk", 3.0, (0, 0, 0), 0, 90))
    sunny = Lighting(
        name="sunny",
        lights=(sunlight(-84, 28, (1.0, 0.9, 0.78), 9.0, 0.6),),
        environment=outside("sky", 5.0, (1.2, 1.0, 0.8), -84, 28),
    )
    walk = []
    for k in range(CAMERAS):  # three times round, at three heights
        turn = 6 * np.pi * k / CAMERAS + 0.2
        away, high = (1.25, 1.6, 1.05)[k // 24], (1.3, 1.62, 1.85)[k // 24]
        aim = ((0, 0.84, 0), (0.15, 0.82, 0.05), (-0.15, 0.86, -0.05))[k % 3]
        eye = np.array([away * np.sin(turn), high, away * np.cos(turn)])
        walk.append(Camera.look_at(eye, aim, 960, 640, yfov=55, name=f"{k}"))
    front = Camera.look_at((0.75, 1.45, 1.2), (0, 0.85, 0), 960, 640, yfov=48, name="front")
    return Recipe(
        name="kitchen",
        title="Things on a table, captured in the evening under a lamp; relit by day, by clouds and by another lamp.",
        looks=looks,
        captured=evening,
        lightings=(
            sunny,
            Lighting(name="clouds", environment=outside("clouds", 12.0, (0, 0, 0), 0, 90)),
            Lighting(name="other lamp", lights=(beside,), environment=outside("dusk", 0.3, (0, 0, 0), 0, 90)),
        ),
        cameras=(front,),
        orbit=tuple(walk),
        pixels_per_splat=3.0,
        spacing=(0.006, 0.06),
        proxy_faces=40_000,
        proxy_error=0.003,
    )
