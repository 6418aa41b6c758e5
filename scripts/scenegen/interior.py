"""A room, captured with the sun through its windows; relit by an overcast sky, by lamps and by a low sun.

It is not shipped: `scripts/bench truth` makes it where it is needed.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mirelight.model import Camera, Environment, Lighting, PointLight, SunLight
from scenegen.geometry import Part, blob, boxes, lathe, leaves, noise, place, sheet, soups, tube
from scenegen.recipe import Recipe
from scenegen.skies import Sky, sky, towards
from scenegen.textures import Surface, painted_tiles, palette, plain, plaster, srgb, stone, wood
from scenegen.truth import Looks

Eye = tuple[float, float, float]

WIDE, HIGH, DEEP, WALL = 2.6, 2.7, 2.2, 0.24  # metres: x from -WIDE to WIDE, z from -DEEP to DEEP
WINDOWS = ((-1.85, -0.2), (0.2, 1.85))  # along z, in the wall at +X
SILL, LINTEL = 0.4, 2.4
LAMPS = ((-0.55, 2.05, -0.2), (-2.05, 1.55, -1.75))


def surfaces() -> dict[str, Surface]:
    """Every material of the room."""
    return {
        "wall": Surface(texture=plaster(srgb(226, 216, 196), srgb(206, 190, 166), srgb(176, 158, 138), 201), size=2.6),
        "ochre": Surface(texture=plaster(srgb(196, 128, 70), srgb(178, 112, 66), srgb(150, 96, 60), 205), size=2.4),
        "ceiling": Surface(texture=plain(srgb(232, 230, 224), 209, contrast=0.03), size=2.0),
        "boards": Surface(texture=wood(srgb(158, 112, 72), srgb(92, 60, 40), 211, size=1024), size=2.4),
        "oak": Surface(texture=wood(srgb(176, 132, 86), srgb(112, 78, 48), 213), size=1.2),
        "frame": Surface(texture=plain(srgb(228, 226, 218), 215, contrast=0.04), size=0.5),
        "sofa": Surface(texture=plain(srgb(58, 92, 112), 217, contrast=0.16), size=0.5),
        "cushion": Surface(texture=plain(srgb(204, 148, 52), 219, contrast=0.14), size=0.4),
        "rug": Surface(texture=painted_tiles(96, 4, 3), size=1.6),
        "red": Surface(texture=plain(srgb(158, 46, 40), 221, contrast=0.12), size=0.4),
        "green": Surface(texture=plain(srgb(70, 108, 66), 223, contrast=0.12), size=0.4),
        "blue": Surface(texture=plain(srgb(44, 62, 118), 225, contrast=0.12), size=0.4),
        "marble": Surface(texture=stone(srgb(220, 214, 204), srgb(140, 134, 132), 227), size=1.0),
        "glaze": Surface(texture=plain(srgb(40, 112, 120), 229, contrast=0.2), size=0.5, roughness=0.25),
        "brass": Surface(texture=plain(srgb(186, 142, 76), 231), size=0.4),
        "leaf": Surface(texture=palette([srgb(52, 92, 44), srgb(86, 128, 62), srgb(132, 160, 92)], 233), size=1.0),
    }


def _shell() -> list[Part]:
    """Floor, ceiling and walls as slabs, so that light has no seam to come through."""
    out = WALL / 2
    long, deep = 2 * WIDE + 2 * WALL, 2 * DEEP + 2 * WALL
    parts = [
        boxes((0, -out, 0), (long, WALL, deep), "boards", bevel=0.001),
        boxes((0, HIGH + out, 0), (long, WALL, deep), "ceiling", bevel=0.001),
        boxes((-WIDE - out, HIGH / 2, 0), (WALL, HIGH + 0.02, deep), "ochre", bevel=0.001),
        boxes((0, HIGH / 2, -DEEP - out), (2 * WIDE + 0.02, HIGH + 0.02, WALL), "wall", bevel=0.001),
        boxes((0, HIGH / 2, DEEP + out), (2 * WIDE + 0.02, HIGH + 0.02, WALL), "wall", bevel=0.001),
    ]
    x, tall = WIDE + out, LINTEL - SILL
    parts.append(boxes((x, SILL / 2, 0), (WALL, SILL, deep), "wall", bevel=0.001))
    parts.append(boxes((x, (LINTEL + HIGH) / 2, 0), (WALL, HIGH - LINTEL + 0.02, deep), "wall", bevel=0.001))
    edges = [-DEEP - WALL, *(z for pair in WINDOWS for z in pair), DEEP + WALL]
    for a, b in zip(edges[::2], edges[1::2], strict=True):
        parts.append(boxes((x, (SILL + LINTEL) / 2, (a + b) / 2), (WALL, tall + 0.02, b - a), "wall", bevel=0.001))
    for a, b in WINDOWS:
        middle, half = (a + b) / 2, (SILL + LINTEL) / 2
        rails = [[x, SILL + 0.03, middle], [x, LINTEL - 0.03, middle], [x, half, middle], [x, half, a + 0.03]]
        rails += [[x, half, b - 0.03], [x, half + 0.2, middle]]
        sizes = [[0.06, 0.06, b - a], [0.06, 0.06, b - a], [0.05, tall, 0.05], [0.06, tall, 0.06]]
        sizes += [[0.06, tall, 0.06], [0.045, 0.045, b - a]]
        parts.append(boxes(rails, sizes, "frame", bevel=0.005))
        parts.append(boxes((WIDE - 0.04, SILL + 0.015, middle), (0.2, 0.03, b - a + 0.2), "marble", bevel=0.006))
    skirting = [[0, 0.05, -DEEP + 0.01], [-WIDE + 0.01, 0.05, 0]]
    return [*parts, boxes(skirting, [[2 * WIDE, 0.1, 0.02], [0.02, 0.1, 2 * DEEP]], "frame", bevel=0.004)]


def _sofa() -> list[Part]:
    """Along the ochre wall."""
    seat = [[-2.1, 0.26, 0.55], [-2.4, 0.55, 0.55], [-2.1, 0.36, -0.52], [-2.1, 0.36, 1.62]]
    sizes = [[0.86, 0.32, 2.0], [0.24, 0.62, 2.0], [0.86, 0.52, 0.16], [0.86, 0.52, 0.16]]
    parts = [boxes(seat, sizes, "sofa", bevel=0.05, seed=1)]
    for k, (z, material) in enumerate(((-0.15, "cushion"), (1.25, "red"))):
        parts.append(blob((-2.18, 0.6, z), (0.13, 0.2, 0.21), material, 0.06, k, rings=24))
    return parts


def _table() -> list[Part]:
    """A low table with a vase, a bowl and books; a rug under it."""
    s, t = np.meshgrid(np.linspace(-1.0, 1.0, 40), np.linspace(-0.8, 0.8, 32), indexing="ij")
    wave = 0.012 + 0.004 * noise(np.stack([s * 4, t * 4, 0 * s], -1), 5, octaves=2)
    rug = sheet(np.stack([s - 0.45, wave, t + 0.45], axis=-1), "rug", flip=True)
    top = boxes((-0.5, 0.43, 0.45), (1.05, 0.05, 0.6), "oak", bevel=0.01, seed=3)
    at = [[-0.5 + x * 0.46, 0.2, 0.45 + z * 0.24] for x in (-1, 1) for z in (-1, 1)]
    legs = boxes(at, (0.05, 0.4, 0.05), "oak", bevel=0.006, seed=4)
    outline = [(0.0, 0.0), (0.07, 0.0), (0.11, 0.08), (0.12, 0.16), (0.06, 0.27), (0.05, 0.31), (0.07, 0.35)]
    vase = lathe([*outline, (0.05, 0.34), (0.035, 0.3)], "glaze", 40).moved(place(-0.72, 0.455, 0.4))
    bowl = lathe([(0.0, 0.0), (0.06, 0.0), (0.15, 0.07), (0.145, 0.07), (0.05, 0.02), (0, 0.02)], "marble", 40)
    parts = [rug, top, legs, vase, bowl.moved(place(-0.3, 0.455, 0.35))]
    fruit = [
        blob((-0.3 + 0.06 * x, 0.53, 0.35 + 0.05 * z), 3 * (0.045,), "red", 0.05, 7, 16) for x, z in ((-1, 0), (1, 0))
    ]
    books = boxes(
        [[-0.35, 0.472, 0.6], [-0.36, 0.5, 0.6]], [[0.24, 0.03, 0.17], [0.2, 0.026, 0.15]], "blue", bevel=0.003
    )
    return [*parts, *fruit, books]


def _shelf() -> list[Part]:
    """Shelves with books on the far wall, a picture beside them."""
    z = -DEEP + 0.16
    frame = [[0.2, 1.0, z], [1.6, 1.0, z]] + [[0.9, y, z] for y in (0.08, 0.55, 1.02, 1.49, 1.96)]
    sizes = [[0.04, 2.0, 0.3], [0.04, 2.0, 0.3]] + [[1.4, 0.035, 0.3]] * 5
    parts = [boxes(frame, sizes, "oak", bevel=0.004, seed=6)]
    rng = np.random.default_rng(12)
    for y in (0.55, 1.02, 1.49):
        x = 0.24
        by: dict[str, list[list[float]]] = {"red": [], "green": [], "blue": [], "cushion": [], "marble": []}
        while x < 1.5:
            wide, tall = rng.uniform(0.025, 0.06), rng.uniform(0.2, 0.34)
            by[str(rng.choice(list(by)))].append(
                [x + wide / 2, y + 0.018 + tall / 2, z + 0.02, wide - 0.003, tall, 0.19]
            )
            x += wide + (rng.uniform(0.08, 0.2) if rng.random() < 0.12 else 0)
        for material, rows in by.items():
            if rows:
                table = np.array(rows)
                parts.append(boxes(table[:, :3], table[:, 3:], material, bevel=0.003, seed=8))
    picture = boxes((-1.0, 1.55, -DEEP + 0.02), (0.9, 0.65, 0.04), "oak", bevel=0.01)
    canvas = boxes((-1.0, 1.55, -DEEP + 0.03), (0.78, 0.53, 0.04), "rug", bevel=0.002)
    return [*parts, picture, canvas]


def _plant() -> list[Part]:
    """A pot with long leaves by the window, and the lamps."""
    rng = np.random.default_rng(21)
    pot = lathe([(0.0, 0.0), (0.15, 0.0), (0.2, 0.34), (0.21, 0.36), (0.18, 0.36), (0.17, 0.3), (0, 0.3)], "ochre", 32)
    at = place(2.05, 0, -1.75)
    turn, rise = rng.uniform(0, 2 * np.pi, 90), rng.uniform(0.6, 2.2, 90)
    away = np.stack([np.sin(turn), rise, np.cos(turn)], axis=1)
    crown = leaves(rng.normal((0, 0.32, 0), 0.05, (90, 3)), away, rng.uniform(0.4, 0.95, 90), "leaf", rng, width=0.12)
    x, y, z = LAMPS[0]
    cord = tube([[x, HIGH, z], [x, y + 0.22, z]], 0.008, "brass", 8)
    shade = lathe([(0.02, 0.22), (0.06, 0.2), (0.22, 0.06), (0.225, 0.06), (0.07, 0.215), (0.02, 0.23)], "brass", 40)
    x, y, z = LAMPS[1]
    post = tube([[x, 0.0, z - 0.1], [x, y - 0.2, z - 0.1]], 0.014, "brass", 10)
    return [pot.moved(at), crown.moved(at), cord, shade.moved(place(*LAMPS[0])), post]


def looks() -> Looks:
    """Geometry and materials."""
    return Looks(soups=soups(_shell() + _sofa() + _table() + _shelf() + _plant()), surfaces=surfaces())


def outside(name: str, level: float, glow: tuple[float, float, float], azimuth: float, elevation: float) -> Environment:
    look = Sky(
        zenith=(0.52 * level, 0.72 * level, 1.0 * level),
        horizon=(0.95 * level, 0.98 * level, 1.0 * level),
        ground=(0.34 * level, 0.30 * level, 0.24 * level),
        glow=glow,
        sun=towards(azimuth, elevation),
    )
    return Environment(name=name, radiance=sky(look, 64))


def sunlight(azimuth: float, elevation: float, color: tuple[float, float, float], lux: float, wide: float) -> SunLight:
    return SunLight(
        name="sun",
        direction=-towards(azimuth, elevation),
        color=np.array(color),
        intensity=lux,
        angular_diameter=wide,
    )


def lamps(places: Sequence[Eye], strengths: tuple[float, ...]) -> Lighting:
    """Warm lamps of a room at dusk."""
    lights = tuple(
        PointLight(name=f"lamp {k}", position=np.array(at), color=np.array([1.0, 0.62, 0.32]), intensity=strength)
        for k, (at, strength) in enumerate(zip(places, strengths, strict=True))
    )
    return Lighting(name="lamps", lights=lights, environment=outside("dusk", 0.12, (0, 0, 0), 0, 30))


def orbit(eye: Eye, target: Eye, across: Sequence[tuple[Eye, Eye]]) -> tuple[Camera, ...]:
    """Cameras about one view of a room, and some that look across it, each from one place to another."""
    moves = ((-0.5, 0.2, 0.1), (0.1, -0.5, -0.5), (-1.1, 0.3, -0.1), (0.1, 0.4, -1.0), (-0.2, -0.7, 0.1))
    about = [Camera.look_at(np.add(eye, m), target, 960, 540, yfov=64, name=f"{k}") for k, m in enumerate(moves)]
    ways = [Camera.look_at(*way, 960, 540, yfov=70, name=f"across {k}") for k, way in enumerate(across)]
    return (*about, *ways)


def recipe() -> Recipe:
    """How the scene is made."""
    day = Lighting(
        name="sunny",
        lights=(sunlight(-24, 38, (1.0, 0.93, 0.82), 14.0, 0.6),),
        environment=outside("sky", 2.6, (1.2, 1.0, 0.8), -24, 38),
    )
    overcast = Lighting(name="overcast", environment=outside("clouds", 6.0, (0, 0, 0), 0, 90))
    low = Lighting(
        name="low sun",
        lights=(sunlight(31, 17, (1.0, 0.62, 0.32), 11.0, 0.9),),
        environment=outside("evening sky", 1.2, (1.6, 0.8, 0.3), 31, 17),
    )
    eye, target = (2.2, 1.55, 1.85), (-0.75, 0.85, -0.7)
    front = Camera.look_at(eye, target, 960, 540, yfov=58, name="front")
    across = (
        ((-2.0, 1.7, -1.5), (1.5, 0.8, 1.2)),
        ((-1.9, 1.6, 1.8), (1.2, 0.9, -1.2)),
        ((2.0, 1.7, -0.9), (-1, 0.9, 1)),
    )
    return Recipe(
        name="interior",
        title="A room captured with the sun through its windows; relit by clouds, lamps and a low sun.",
        looks=looks,
        captured=day,
        lightings=(overcast, lamps(LAMPS, (2.2, 1.1)), low),
        cameras=(front,),
        orbit=(front, *orbit(eye, target, across)),
        pixels_per_splat=3.2,
        spacing=(0.012, 0.06),
        proxy_faces=48_000,
        proxy_error=0.004,
    )
