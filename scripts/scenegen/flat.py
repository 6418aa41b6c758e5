"""Three rooms of a flat, walked through with a camera: a living room, a corridor without a window, a bedroom.

White walls with little on them, doorways, light by windows of two sides, and the corridor's lamp is on: what agents and
hosts capture. It is not shipped, and nothing is tuned on it: `scripts/bench truth` makes it where it is needed.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mirelight.model import Camera, Lighting, PointLight
from scenegen.geometry import Part, blob, boxes, lathe, leaves, place, sheet, soups, tube
from scenegen.interior import lamps, outside, sunlight
from scenegen.recipe import Recipe
from scenegen.textures import Surface, painted_tiles, palette, plain, plaster, srgb, stone, wood
from scenegen.training import exposed
from scenegen.truth import Looks

HIGH, WALL = 2.5, 0.12  # metres
WEST, EAST, NORTH, SOUTH = -4.6, 4.6, -2.2, 2.2  # of the flat; doors and windows look along x or z
LIVING, BED = 0.2, 1.5  # x of the walls between living room and corridor, corridor and bedroom
BACK = 1.2  # z of the bedroom's wall
DOOR = 2.05
LAMPS = ((-2.2, 1.9, 0.1), (0.85, 2.2, 0.3), (2.2, 0.8, 0.75))  # pendant, corridor, on the night table
OPEN = ((-3.9, -2.5), (-1.7, -0.3))  # windows of the living room, along x

Hole = tuple[float, float, float, float]  # from, to, bottom, top


def surfaces() -> dict[str, Surface]:
    """Every material."""
    return {
        "wall": Surface(texture=plaster(srgb(226, 224, 218), srgb(220, 218, 212), srgb(208, 205, 198), 801), size=3.0),
        "sage": Surface(texture=plaster(srgb(150, 164, 140), srgb(142, 156, 132), srgb(130, 142, 122), 803), size=3.0),
        "ceiling": Surface(texture=plain(srgb(234, 233, 230), 805, contrast=0.02), size=2.5),
        "floor": Surface(texture=wood(srgb(186, 150, 108), srgb(140, 102, 68), 807, size=1024), size=2.2),
        "tiles": Surface(texture=stone(srgb(196, 190, 182), srgb(150, 144, 138), 809), size=1.2),
        "trim": Surface(texture=plain(srgb(236, 235, 230), 811, contrast=0.03), size=0.6),
        "oak": Surface(texture=wood(srgb(172, 126, 78), srgb(112, 74, 44), 813), size=0.9),
        "dark": Surface(texture=plain(srgb(38, 38, 42), 815, contrast=0.15), size=0.5),
        "gray cloth": Surface(texture=plain(srgb(120, 122, 128), 817, contrast=0.12), size=0.5),
        "ochre": Surface(texture=plain(srgb(196, 146, 62), 819, contrast=0.15), size=0.3),
        "linen": Surface(texture=plain(srgb(216, 212, 202), 821, contrast=0.06), size=0.7),
        "blanket": Surface(texture=plain(srgb(70, 96, 128), 823, contrast=0.18), size=0.5),
        "rug": Surface(texture=painted_tiles(128, 5, 825), size=1.6),
        "print": Surface(texture=painted_tiles(96, 3, 827), size=0.8),
        "books": Surface(texture=palette([srgb(160, 60, 50), srgb(60, 90, 120), srgb(190, 170, 120)], 829), size=0.3),
        "leaf": Surface(texture=palette([srgb(58, 104, 50), srgb(98, 142, 70)], 831), size=1.0),
        "clay": Surface(texture=plain(srgb(178, 104, 72), 833, contrast=0.12), size=0.4),
    }


def _wall(axis: int, at: float, ends: tuple[float, float], material: str, holes: Sequence[Hole] = ()) -> list[Part]:
    """A wall of height HIGH across `axis` (0: x, 2: z), its middle at `at`, with holes cut out."""
    pieces: list[tuple[float, float, float, float]] = []
    start = ends[0]
    for a, b, low, top in sorted(holes):
        pieces += [(start, a, 0.0, HIGH), (a, b, 0.0, low), (a, b, top, HIGH)]
        start = b
    pieces.append((start, ends[1], 0.0, HIGH))
    kept = np.array([p for p in pieces if p[1] - p[0] > 1e-6 and p[3] - p[2] > 1e-6])
    along, up = kept[:, :2], kept[:, 2:]
    centres, sizes = np.empty((len(kept), 3)), np.empty((len(kept), 3))
    other = 2 - axis
    centres[:, axis], sizes[:, axis] = at, WALL
    centres[:, other], sizes[:, other] = along.mean(axis=1), np.diff(along)[:, 0] + 0.002
    centres[:, 1], sizes[:, 1] = up.mean(axis=1), np.diff(up)[:, 0] + 0.002
    return [boxes(centres, sizes, material, bevel=0.001)]


def _frame(axis: int, at: float, hole: Hole, bar: bool) -> Part:
    """What stands around a hole; a bar across its middle if it is a window."""
    a, b, low, top = hole
    parts = [(a + 0.03, (low + top) / 2, 0.06, top - low), (b - 0.03, (low + top) / 2, 0.06, top - low)]
    parts += [((a + b) / 2, top - 0.03, b - a, 0.06)]
    if bar:
        parts += [((a + b) / 2, low + 0.03, b - a, 0.06), ((a + b) / 2, (low + top) / 2, 0.05, top - low)]
    rows = np.array(parts)
    centres, sizes = np.empty((len(rows), 3)), np.empty((len(rows), 3))
    other = 2 - axis
    centres[:, axis], sizes[:, axis] = at, WALL + 0.05
    centres[:, other], centres[:, 1], sizes[:, other], sizes[:, 1] = rows.T
    return boxes(centres, sizes, "trim", bevel=0.005)


def _shell() -> list[Part]:
    """Floors, ceiling, walls with doorways and windows, skirting boards."""
    windows = [(a, b, 0.55, 2.2) for a, b in OPEN]
    way = (-0.45, 0.45, 0.0, DOOR)
    sleep = (-0.9, 0.0, 0.0, DOOR)
    side = (-1.5, 0.1, 0.85, 2.1)
    x, z, wide, deep = (WEST + EAST) / 2, (NORTH + SOUTH) / 2, EAST - WEST + 0.3, SOUTH - NORTH + 0.3
    h = WALL / 2
    parts = [
        boxes((x, -0.05, z), (wide, 0.1, deep), "floor", bevel=0.001),
        boxes(((LIVING + BED) / 2, 0.001, z), (BED - LIVING, 0.004, SOUTH - NORTH), "tiles", bevel=0.0005),
        boxes((x, HIGH + 0.05, z), (wide, 0.1, deep), "ceiling", bevel=0.001),
        *_wall(2, NORTH - h, (WEST - WALL, EAST + WALL), "wall", windows),
        *_wall(2, SOUTH + h, (WEST - WALL, EAST + WALL), "wall"),
        *_wall(0, WEST - h, (NORTH, SOUTH), "sage"),
        *_wall(0, EAST + h, (NORTH, SOUTH), "wall", [side]),
        *_wall(0, LIVING, (NORTH, SOUTH), "wall", [way]),
        *_wall(0, BED, (NORTH, SOUTH), "wall", [sleep]),
        *_wall(2, BACK, (BED, EAST), "sage"),
        *(_frame(2, NORTH - h, hole, True) for hole in windows),
        _frame(0, EAST + h, side, True),
        _frame(0, LIVING, way, False),
        _frame(0, BED, sleep, False),
    ]
    for y, a, b in ((0.04, WEST, LIVING - h), (0.04, BED + h, EAST)):
        parts.append(boxes(((a + b) / 2, y, NORTH + 0.01), (b - a, 0.08, 0.02), "trim", bevel=0.003))
    parts.append(boxes((WEST + 0.01, 0.04, z), (0.02, 0.08, SOUTH - NORTH), "trim", bevel=0.003))
    for hinge, turn in ((np.array([LIVING + h, DOOR / 2, 0.45]), 1.35), (np.array([BED + h, DOOR / 2, -0.9]), 1.2)):
        away = np.array([np.sin(turn), 0.0, np.cos(turn) * np.sign(hinge[2])])
        across = np.cross(away, (0.0, 1.0, 0.0))
        frame = np.stack([away, (0.0, 1.0, 0.0), across], axis=1)
        parts.append(boxes(hinge + 0.43 * away, (0.84, DOOR - 0.04, 0.04), "trim", bevel=0.004, frames=frame))
    return parts


def _curtain(x: float, wide: float, z: float) -> list[Part]:
    """A folded curtain beside a window, a sheet seen from both sides."""
    s, t = np.meshgrid(np.linspace(-0.5, 0.5, 60), np.linspace(0.08, 2.35, 12), indexing="ij")
    return [
        sheet(np.stack([x + wide * s, t, z + side + 0.035 * np.sin(30 * s)], -1), "linen", flip=side > 0)
        for side in (0.0, 0.004)
    ]


def _living() -> list[Part]:
    """Sofa, low table on a rug, a board with a screen, shelves with books, a table with two chairs, a plant."""
    sofa = [[-2.3, 0.22, 1.75], [-2.3, 0.55, 2.08], [-3.35, 0.38, 1.75], [-1.25, 0.38, 1.75]]
    sizes = [[2.2, 0.3, 0.85], [2.2, 0.5, 0.22], [0.2, 0.5, 0.85], [0.2, 0.5, 0.85]]
    legs = [[-0.62 + dx, 0.36, -1.1 + dz] for dx in (-0.4, 0.4) for dz in (-0.3, 0.3)]
    parts = [
        boxes(sofa, sizes, "gray cloth", bevel=0.06, seed=1),
        blob((-3.0, 0.52, 1.75), (0.22, 0.2, 0.1), "ochre", 0.05, 3, 22),
        blob((-1.65, 0.52, 1.78), (0.22, 0.2, 0.1), "blanket", 0.05, 4, 22),
        boxes((-2.3, 0.006, 0.55), (2.4, 0.012, 1.5), "rug", bevel=0.003),
        boxes((-2.3, 0.38, 0.55), (1.0, 0.05, 0.55), "oak", bevel=0.01, seed=2),
        boxes([[-2.7, 0.18, 0.55], [-1.9, 0.18, 0.55]], [[0.05, 0.36, 0.5]] * 2, "oak", bevel=0.006, seed=3),
        boxes([[-2.4, 0.42, 0.5], [-2.42, 0.445, 0.49]], [[0.24, 0.03, 0.17], [0.2, 0.02, 0.15]], "books", seed=4),
        boxes((WEST + 0.22, 0.25, 0.4), (0.4, 0.42, 1.6), "oak", bevel=0.008, seed=5),
        boxes((WEST + 0.16, 0.85, 0.4), (0.05, 0.64, 1.1), "dark", bevel=0.006),
        boxes((-0.62, 0.74, -1.1), (1.0, 0.04, 0.75), "oak", bevel=0.008, seed=6),
        boxes(legs, (0.05, 0.72, 0.05), "oak", bevel=0.005, seed=7),
        boxes((-1.3, 1.55, SOUTH - 0.02), (0.8, 0.6, 0.03), "print", bevel=0.004),
        tube([[LAMPS[0][0], HIGH, LAMPS[0][2]], [LAMPS[0][0], 2.12, LAMPS[0][2]]], 0.008, "dark", 8),
    ]
    shade = lathe([(0.02, 0.22), (0.06, 0.2), (0.22, 0.06), (0.225, 0.06), (0.07, 0.215), (0.02, 0.23)], "ochre", 40)
    parts.append(shade.moved(place(LAMPS[0][0], 1.9, LAMPS[0][2])))
    for z in (-0.62, -1.6):
        side = 1 if z > -1.1 else -1
        posts = [[-0.62 + dx, 0.22, z + dz] for dx in (-0.18, 0.18) for dz in (-0.17, 0.17)]
        parts.append(boxes(posts, (0.035, 0.44, 0.035), "dark", bevel=0.004))
        back = [[-0.62, 0.455, z], [-0.62, 0.72, z + side * 0.18]]
        parts.append(boxes(back, [[0.42, 0.03, 0.4], [0.4, 0.26, 0.025]], "ochre", bevel=0.008))
    shelf = [[x, 0.95, -2.05] for x in (-2.45, -1.75)] + [[-2.1, y, -2.05] for y in (0.1, 0.55, 1.0, 1.45, 1.88)]
    parts.append(boxes(shelf, [[0.03, 1.9, 0.28]] * 2 + [[0.7, 0.03, 0.28]] * 5, "oak", bevel=0.004, seed=8))
    rng = np.random.default_rng(8)
    for y in (0.55, 1.0, 1.45):
        wide = rng.uniform(0.03, 0.06, 11)
        tall = rng.uniform(0.2, 0.34, 11)
        at = np.stack([-2.42 + np.cumsum(wide) - wide / 2, y + 0.017 + tall / 2, np.full(11, -2.04)], 1)
        parts.append(boxes(at, np.stack([wide - 0.003, tall, np.full(11, 0.2)], 1), "books", bevel=0.003, seed=9))
    pot = lathe([(0.0, 0.0), (0.15, 0.0), (0.2, 0.34), (0.18, 0.34), (0.17, 0.3), (0, 0.3)], "clay", 32)
    turn, rise = rng.uniform(0, 2 * np.pi, 80), rng.uniform(0.6, 2.2, 80)
    away = np.stack([np.sin(turn), rise, np.cos(turn)], axis=1)
    crown = leaves(rng.normal((0, 0.32, 0), 0.05, (80, 3)), away, rng.uniform(0.3, 0.8, 80), "leaf", rng, width=0.14)
    here = place(-4.15, 0, -1.75)
    return [*parts, pot.moved(here), crown.moved(here), *_curtain(-4.15, 0.4, NORTH + 0.1)]


def _corridor() -> list[Part]:
    """A chest, coats on hooks, shoes, a print at the end."""
    coats = [blob((LIVING + 0.16, 1.25, z), (0.09, 0.42, 0.18), m, 0.06, k, 24)
             for k, (z, m) in enumerate(((1.1, "blanket"), (1.5, "dark"), (1.85, "ochre")))]  # fmt: skip
    return [
        *coats,
        boxes((LIVING + 0.08, 1.68, 1.5), (0.03, 0.1, 1.1), "oak", bevel=0.004),
        boxes((BED - 0.26, 0.42, 1.55), (0.36, 0.84, 0.9), "oak", bevel=0.008, seed=21),
        boxes([[LIVING + 0.2, 0.05, z] for z in (1.0, 1.25, 1.75)], [[0.26, 0.1, 0.1]] * 3, "dark", bevel=0.03),
        boxes((0.85, 1.5, NORTH + 0.02), (0.6, 0.8, 0.03), "print", bevel=0.004),
    ]


def _bedroom() -> list[Part]:
    """Bed with pillows and a blanket, wardrobe, night table with a lamp, a print."""
    x, z = 3.55, 0.1
    pillows = [
        blob((x + dx, 0.62, 0.78), (0.32, 0.1, 0.2), "linen", 0.04, 40 + k, 24) for k, dx in enumerate((-0.4, 0.4))
    ]
    s, t = np.meshgrid(np.linspace(-0.86, 0.86, 60), np.linspace(-1.0, 0.1, 40), indexing="ij")
    high = 0.56 + 0.012 * np.sin(7 * s + 3 * t) - 0.25 * np.clip(np.abs(s) - 0.8, 0, 1) / 0.06
    cover = sheet(np.stack([x + s, high, z + t], -1), "blanket", flip=True)
    shade = lathe([(0.1, 0.0), (0.07, 0.17), (0.068, 0.17), (0.098, 0.0)], "linen", 32).moved(place(2.2, 0.72, 0.95))
    return [
        boxes((x, 0.18, z), (1.7, 0.3, 2.1), "oak", bevel=0.01, seed=31),
        boxes((x, 0.43, z), (1.64, 0.22, 2.04), "linen", bevel=0.05, seed=32),
        boxes((x, 0.6, BACK - 0.1), (1.7, 0.9, 0.06), "oak", bevel=0.01, seed=33),
        *pillows,
        cover,
        boxes((2.2, 0.24, 0.95), (0.4, 0.48, 0.36), "oak", bevel=0.006, seed=34),
        tube([[2.2, 0.48, 0.95], [2.2, 0.75, 0.95]], 0.02, "clay", 12),
        shade,
        boxes((2.6, 1.05, NORTH + 0.32), (1.8, 2.1, 0.6), "trim", bevel=0.008),
        boxes([[2.15, 1.05, NORTH + 0.63], [3.05, 1.05, NORTH + 0.63]], [[0.86, 2.0, 0.02]] * 2, "linen", bevel=0.004),
        boxes((3.5, 1.6, BACK - 0.07), (0.9, 0.5, 0.03), "print", bevel=0.004),
    ]


def looks() -> Looks:
    """Geometry and materials."""
    return Looks(soups=soups(_shell() + _living() + _corridor() + _bedroom()), surfaces=surfaces())


def _walk() -> tuple[Camera, ...]:
    """Round the living room, along the corridor, twice round the bedroom; looks across and through the doorways."""
    views: list[tuple[np.ndarray, np.ndarray]] = []
    for k in range(44):
        turn = 2 * np.pi * k / 22
        eye = np.array([-2.2 + 1.5 * np.cos(turn), (1.35, 1.6, 1.5)[k % 3], 0.0 + 1.05 * np.sin(turn)])
        yaw = turn + np.pi + np.radians((-38, 30, -12, 55, 5)[k % 5])
        views.append((eye, np.array([np.cos(yaw), np.tan(np.radians((-24, 10, -8, -30, 16)[k % 5])), np.sin(yaw)])))
    for k in range(16):
        z = -1.5 + 0.2 * k
        yaw = np.radians((90, -80, 100, -95, 170, 10)[k % 6])
        eye = np.array([0.85 + 0.15 * np.sin(2.0 * k), 1.5 + 0.05 * (k % 3), z if k % 6 < 4 else -0.3])
        views.append((eye, np.array([np.cos(yaw), (-0.25, 0.12, -0.5, 0.0)[k % 4], np.sin(yaw)])))
    for k in range(30):
        turn = 2 * np.pi * k / 15
        eye = np.array([2.75 + 0.7 * np.cos(turn), (1.4, 1.6, 1.5)[k % 3], -0.65 + 0.5 * np.sin(turn)])
        yaw = turn + np.pi + np.radians((-38, 30, -12, 55, 5)[k % 5])
        views.append((eye, np.array([np.cos(yaw), np.tan(np.radians((-24, 10, -8, -30, 14)[k % 5])), np.sin(yaw)])))
    return tuple(Camera.look_at(eye, eye + way, 960, 640, yfov=62, name=f"{k}") for k, (eye, way) in enumerate(views))


def recipe() -> Recipe:
    """How the scene is made."""
    day = Lighting(
        name="sunny",
        lights=(
            sunlight(-66, 36, (1.0, 0.93, 0.82), 16.0, 0.6),
            PointLight(name="corridor", position=np.array(LAMPS[1]), color=np.array([1.0, 0.78, 0.52]), intensity=1.2),
        ),
        environment=outside("sky", 4.0, (1.2, 1.0, 0.8), -66, 36),
    )
    low = Lighting(
        name="low sun",
        lights=(sunlight(-20, 14, (1.0, 0.62, 0.32), 12.0, 0.9),),
        environment=outside("evening sky", 2.4, (1.6, 0.8, 0.3), -20, 14),
    )
    front = Camera.look_at((-0.4, 1.55, 1.3), (-3.0, 0.9, -0.6), 960, 640, yfov=60, name="front")
    return Recipe(
        name="flat",
        title="A flat captured by day; relit by clouds, by its lamps and by a low sun.",
        looks=looks,
        captured=exposed(day, 0.75),
        lightings=(
            Lighting(name="overcast", environment=outside("clouds", 9.0, (0, 0, 0), 0, 90)),
            lamps(LAMPS, (2.2, 0.8, 0.7)),
            low,
        ),
        cameras=(front,),
        orbit=_walk(),
        pixels_per_splat=3.0,
        spacing=(0.01, 0.08),
        proxy_faces=48_000,
        proxy_error=0.004,
    )
