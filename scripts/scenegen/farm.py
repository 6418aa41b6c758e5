"""A farmhouse with trees from the air, as a drone captures it: round it at two heights and across it, looking down.

The ground goes on past most pictures' borders; low ones show some sky. It is not shipped, and nothing is tuned on it:
`scripts/bench truth` makes it where it is needed.
"""

from __future__ import annotations

import numpy as np

from mirelight.model import Camera
from scenegen.geometry import Part, blob, boxes, leaves, noise, place, sheet, soups, tube
from scenegen.recipe import Recipe
from scenegen.skies import clear, clouds, lamplit
from scenegen.textures import Surface, paint, palette, plain, plaster, srgb, stone, terracotta, wood
from scenegen.truth import Looks

ROUND, ACROSS = 66, 14  # pictures
FAR = 70.0  # metres to the ground's end
TREES = (  # x, z, size
    (-9.5, 3.5, 1.0),
    (-8.0, -7.0, 1.25),
    (9.5, -6.0, 1.1),
    (11.5, 7.5, 0.85),
    (-14.0, 9.0, 1.2),
    (4.0, 9.9, 0.8),
)
HEDGE = ((-12.0, 11.5), (7.5, 11.5))  # x, z of its ends


def surfaces() -> dict[str, Surface]:
    """Every material."""
    return {
        "grass": Surface(texture=plaster(srgb(112, 128, 70), srgb(140, 132, 84), srgb(96, 88, 58), 601), size=16.0),
        "road": Surface(texture=stone(srgb(148, 142, 134), srgb(104, 98, 92), 603), size=5.0),
        "wall": Surface(texture=plaster(srgb(222, 206, 176), srgb(196, 172, 136), srgb(150, 132, 104), 605), size=6.0),
        "barn": Surface(texture=wood(srgb(142, 100, 72), srgb(78, 54, 40), 607, size=1024), size=3.0),
        "roof": Surface(texture=terracotta(srgb(176, 88, 62), 609), size=3.0),
        "slate": Surface(texture=stone(srgb(96, 100, 108), srgb(60, 62, 70), 611), size=2.5),
        "frame": Surface(texture=plain(srgb(70, 92, 104), 613, contrast=0.1), size=1.0),
        "terrace": Surface(texture=stone(srgb(204, 192, 170), srgb(146, 134, 118), 615), size=3.0),
        "bark": Surface(texture=wood(srgb(104, 82, 62), srgb(62, 48, 38), 617), size=1.0),
        "leaf": Surface(texture=palette([srgb(58, 92, 44), srgb(88, 124, 62), srgb(124, 146, 80)], 619), size=1.0),
        "car": Surface(texture=paint(srgb(168, 42, 38), srgb(150, 60, 50), 621), size=2.0),
        "dark": Surface(texture=plain(srgb(44, 46, 50), 623, contrast=0.1), size=1.0),
        "hay": Surface(texture=plain(srgb(204, 172, 98), 625, contrast=0.25), size=1.0),
    }


def _ground() -> list[Part]:
    """Grass that rises towards the back, a gravel road and yard on it."""
    s, t = np.meshgrid(np.linspace(-FAR, FAR, 140), np.linspace(-FAR, FAR, 140), indexing="ij")
    away = np.maximum(np.hypot(s, t) - 14, 0)
    hills = 0.5 * noise(np.stack([s, t, 0 * s], -1) / 9, 7) * np.minimum(away / 8, 1)
    rise = hills - 0.02 * np.minimum(t, 0) * (t < -14)
    grass = sheet(np.stack([s, rise - 0.05 * (away == 0), t], -1), "grass", flip=True)
    yard = boxes((1.5, -0.03, 6.2), (13.0, 0.12, 5.6), "road", bevel=0.02)
    drive = boxes((10.5, -0.05, 6.0), (6.0, 0.1, 3.2), "road", bevel=0.02)
    return [grass, yard, drive]


def _gable(at: tuple[float, float], size: tuple[float, float], eaves: float, ridge: float, roof: str) -> list[Part]:
    """Roof along x over a block: two slopes with thickness, two triangles of wall; overhangs of 0.5 m."""
    x, z = at
    long, deep = size[0] / 2 + 0.5, size[1] / 2 + 0.5
    drop = eaves - 0.5 * (ridge - eaves) / (size[1] / 2)
    parts: list[Part] = []
    for side in (-1.0, 1.0):
        for lift, flip in ((0.0, side > 0), (0.14, side < 0)):
            low = np.array([[x - long, drop + lift, z + side * deep], [x + long, drop + lift, z + side * deep]])
            high = np.array([[x - long, ridge + lift, z], [x + long, ridge + lift, z]])
            parts.append(sheet(np.stack([low, high]), roof, flip=not flip))
        end = x + side * size[0] / 2
        lower = [[end, eaves, z - size[1] / 2], [end, eaves, z], [end, eaves, z + size[1] / 2]]
        upper = [[end, eaves, z - size[1] / 2], [end, ridge, z], [end, eaves, z + size[1] / 2]]
        parts.append(sheet(np.array([lower, upper]), "wall" if roof == "roof" else "barn", flip=side < 0))
    return parts


def _house() -> list[Part]:
    """A long house, a wing towards the yard, a chimney, windows, a terrace with a table."""
    walls = boxes([[0, 1.5, -1.5], [-4.0, 1.3, 3.0]], [[11.0, 3.0, 6.0], [4.0, 2.6, 3.4]], "wall", bevel=0.02)
    rows = [[x, 1.6, 1.5] for x in (-0.6, 3.4)] + [[x, 1.6, -4.5] for x in (-4, -1.3, 1.3, 4)] + [[-4.0, 1.5, 4.7]]
    windows = boxes(rows, [[1.1, 1.3, 0.16]] * len(rows), "frame", bevel=0.01)
    door = boxes([[1.4, 1.05, 1.5]], [[1.0, 2.1, 0.16]], "barn", bevel=0.01)
    chimney = boxes([[3.2, 5.0, -1.0], [3.2, 6.05, -1.0]], [[0.8, 2.0, 0.8], [1.0, 0.14, 1.0]], "slate", bevel=0.02)
    terrace = boxes((2.6, 0.1, 3.0), (6.0, 0.3, 2.8), "terrace", bevel=0.02)
    table = boxes([[3.0, 0.95, 3.0], [3.0, 0.6, 3.0]], [[1.8, 0.07, 0.9], [0.2, 0.7, 0.2]], "barn", bevel=0.01)
    wing = [part.moved(place(-4.0, 0, 3.0, 90)) for part in _gable((0, 0), (3.4, 4.0), 2.6, 4.1, "roof")]
    return [walls, windows, door, chimney, terrace, table, *_gable((0, -1.5), (11.0, 6.0), 3.0, 5.4, "roof"), *wing]


def _barn() -> list[Part]:
    """An open-fronted barn across the yard, with bales in it."""
    x, z = 8.0, 0.5
    sides = boxes(
        [[x + 2.4, 1.3, z], [x, 1.3, z - 2.4], [x, 1.3, z + 2.4]],
        [[0.16, 2.6, 5.0], [5.0, 2.6, 0.16], [5.0, 2.6, 0.16]],
        "barn",
    )
    posts = boxes([[x - 2.4, 1.3, z - 0.8], [x - 2.4, 1.3, z + 0.8]], [[0.2, 2.6, 0.2]] * 2, "barn")
    bales = [blob((x + 1.0, 0.55, z + s), (0.7, 0.6, 0.7), "hay", 0.04, k, 20) for k, s in enumerate((-1.2, 0.6))]
    return [sides, posts, *bales, *_gable((x, z), (5.0, 5.0), 2.6, 3.8, "slate")]


def _plants() -> list[Part]:
    rng = np.random.default_rng(67)
    parts = []
    for k, (x, z, scale) in enumerate(TREES):
        parts.append(
            tube([[x, -0.2, z], [x + 0.1, 1.6 * scale, z], [x, 3.0 * scale, z]], [0.3, 0.22, 0.14], "bark", 12)
        )
        for ball in range(5):
            centre = np.array([x, 4.2 * scale, z]) + rng.normal(0, 0.8 * scale, 3) * [1, 0.6, 1]
            radius = scale * rng.uniform(1.0, 1.5)
            parts.append(blob(centre, 3 * (0.85 * radius,), "leaf", 0.15, 10 * k + ball, 22))
            out = rng.normal(size=(220, 3))
            out /= np.linalg.norm(out, axis=1, keepdims=True)
            away = out + 0.6 * rng.normal(size=out.shape)
            parts.append(leaves(centre + 0.85 * radius * out, away, 0.4 * scale, "leaf", rng))
    (a, z), (b, _) = HEDGE
    for k, x in enumerate(np.arange(a, b, 1.0)):
        parts.append(blob((x, 0.6, z), (0.75, 0.9, 0.6), "leaf", 0.12, 200 + k, 16))
    return parts


def _things() -> list[Part]:
    """A car, a stack of wood, a wall of stones, a neighbour's sheds far off."""
    body = boxes([[6.0, 0.62, 6.4], [5.8, 1.2, 6.4]], [[4.1, 0.7, 1.75], [2.2, 0.56, 1.6]], "car", bevel=0.12)
    wheels = [blob((6.0 + dx, 0.34, 6.4 + dz), (0.34, 0.34, 0.14), "dark", 0.0, 3, 16) for dx in (-1.3, 1.3)
              for dz in (-0.85, 0.85)]  # fmt: skip
    logs = boxes((-6.4, 0.6, -1.5), (0.9, 1.3, 3.2), "bark", bevel=0.08)
    wall = boxes([[-12.5, 0.5, 2.0]], [[0.5, 1.1, 16.0]], "terrace", bevel=0.06)
    sheds = boxes(
        [[-30, 1.6, -26], [26, 1.8, -30], [34, 1.6, 20]], [[8.0, 3.6, 6.0], [7.0, 4.0, 9.0], [6.0, 3.6, 8.0]], "wall"
    )
    lids = boxes([[-30, 3.5, -26], [26, 3.9, -30], [34, 3.5, 20]], [[9, 0.3, 7], [8, 0.3, 10], [7, 0.3, 9]], "slate")
    return [body, *wheels, logs, wall, sheds, lids]


def looks() -> Looks:
    """Geometry and materials."""
    return Looks(soups=soups(_ground() + _house() + _barn() + _plants() + _things()), surfaces=surfaces())


def recipe() -> Recipe:
    """How the scene is made."""
    flight = []
    for k in range(ROUND):  # twice round, low and high
        turn = 4 * np.pi * k / ROUND + 0.1
        away, high = ((17.0, 8.5), (21.0, 15.0))[2 * k // ROUND]
        aim = ((0, 1.0, 1.0), (3.0, 0.5, 2.0), (-3.0, 1.0, 0.0))[k % 3]
        flight.append(
            Camera.look_at((away * np.sin(turn), high, away * np.cos(turn)), aim, 960, 640, yfov=50, name=f"{k}")
        )
    for k in range(ACROSS):  # over it in two lines
        x, z = -12 + 4.0 * (k % 7), (-5.0, 5.0)[k // 7]
        flight.append(Camera.look_at((x, 19.0, z + 2.5), (x, 0, z), 960, 640, yfov=50, name=f"{ROUND + k}"))
    front = Camera.look_at((11.0, 9.0, 16.0), (0, 1.0, 0.5), 960, 640, yfov=46, name="front")
    return Recipe(
        name="farm",
        title="A farmhouse from the air, captured on a clear day; relit by a low sun, clouds and a lamp.",
        looks=looks,
        captured=clear("clear day", (52, 44), (1.0, 0.94, 0.85), 2.4, 0.9),
        lightings=(
            clear("low sun", (-35, 18), (1.0, 0.62, 0.32), 2.6, 0.5),
            clouds(),
            lamplit((5.0, 4.2, 4.6), (1.0, 0.74, 0.46), 22.0, 0.14),
        ),
        cameras=(front,),
        orbit=tuple(flight),
        pixels_per_splat=3.0,
        spacing=(0.06, 0.5),
        proxy_faces=40_000,
        proxy_error=0.02,
    )
