"""A yard before a house: tiled roof, fence, a tree, a cat, walls round it; pictures have no sky.

It is not shipped, and nothing is tuned on it: `scripts/bench truth` makes it where it is needed.
"""

from __future__ import annotations

import numpy as np

from mirelight.model import Camera
from scenegen.geometry import Part, blob, boxes, noise, rectangle, sheet, soups, tube
from scenegen.recipe import Recipe
from scenegen.skies import clear, clouds, lamplit
from scenegen.textures import Surface, paint, painted_tiles, plain, plaster, srgb, stone, terracotta, wood
from scenegen.truth import Looks

CAMERAS = 62
FRONT = -2.2  # z of the house's front
HALF = 6.0  # of the yard's width


def surfaces() -> dict[str, Surface]:
    """Every material."""
    return {
        "tiles": Surface(texture=painted_tiles(128, 4, 9), size=2.4),
        "wall": Surface(texture=plaster(srgb(214, 196, 160), srgb(188, 150, 112), srgb(150, 130, 100), 401), size=3.0),
        "garden wall": Surface(texture=stone(srgb(176, 160, 140), srgb(120, 104, 92), 403), size=1.4),
        "roof": Surface(texture=terracotta(srgb(172, 84, 58), 405), size=1.5),
        "wood": Surface(texture=wood(srgb(120, 92, 64), srgb(70, 50, 36), 407), size=0.8),
        "door": Surface(texture=paint(srgb(52, 92, 110), srgb(130, 110, 84), 409), size=0.9),
        "leaf": Surface(texture=plain(srgb(84, 120, 56), 411, contrast=0.25), size=0.6),
        "cat": Surface(texture=plain(srgb(70, 62, 58), 413, contrast=0.2), size=0.4),
        "cloth": Surface(texture=plain(srgb(200, 70, 60), 415, contrast=0.1), size=0.5),
    }


def _floor() -> list[Part]:
    return [rectangle((-HALF, 0, HALF), (2 * HALF, 0, 0), (0, 0, -2 * HALF), "tiles")]


def _house() -> list[Part]:
    """A front with a door and two windows, their frames before the wall, and a roof of round tiles with eaves."""
    walls = boxes([[0, 1.4, FRONT - 1.5]], [[6.4, 2.8, 3.0]], "wall", bevel=0.02)
    openings = boxes(
        [[-1.9, 1.5, FRONT], [1.9, 1.5, FRONT], [0, 1.05, FRONT]],
        [[1.1, 1.2, 0.16], [1.1, 1.2, 0.16], [1.1, 2.1, 0.12]],
        "wood",
    )
    panes = boxes([[-1.9, 1.5, FRONT + 0.07], [1.9, 1.5, FRONT + 0.07]], 2 * [[0.9, 1.0, 0.06]], "door")
    door = boxes([[0, 1.02, FRONT + 0.05]], [[0.86, 1.96, 0.06]], "door")
    sills = boxes([[-1.9, 0.84, FRONT + 0.12], [1.9, 0.84, FRONT + 0.12]], 2 * [[1.3, 0.08, 0.34]], "garden wall")
    s, t = np.meshgrid(np.linspace(-3.6, 3.6, 260), np.linspace(0, 1, 24), indexing="ij")
    round_tiles = 0.07 * np.abs(np.cos(np.pi * s / 0.3)) + 0.03 * (1 - (6 * t) % 1.0)
    slope = [
        np.stack([s, 2.55 + 1.5 * t + round_tiles, FRONT + 0.6 - 2.1 * t], -1),
        np.stack([s, 4.05 - 1.5 * t + round_tiles, FRONT - 1.5 - 2.1 * t], -1),
    ]
    ridge = np.array([[0, 2.6, FRONT], [0, 4.0, FRONT - 1.5], [0, 2.6, FRONT - 3.0]])
    below = ridge * [1, 0, 1] + [0, 2.6, 0]
    gables = [sheet(np.stack([ridge, below]) + np.array([x, 0, 0]), "wall", flip=x > 0) for x in (-3.2, 3.2)]
    under = boxes([[0, 2.6, FRONT + 0.3]], [[7.2, 0.08, 0.6]], "wood")
    step = boxes([[0, 0.08, FRONT + 0.5]], [[1.8, 0.16, 0.8]], "garden wall")
    return [walls, openings, panes, door, sills, *(sheet(p, "roof") for p in slope), *gables, under, step]


def _bounds() -> list[Part]:
    """A wall on the left, a fence of pickets on the right, both as deep as the yard is."""
    wall = boxes([[-5.2, 0.7, 0.6]], [[0.3, 1.4, 7.6]], "garden wall", bevel=0.03)
    cope = boxes([[-5.2, 1.44, 0.6]], [[0.42, 0.1, 7.7]], "roof", bevel=0.02)
    z = np.arange(-2.6, 4.2, 0.26)
    pickets = boxes(
        np.stack([0 * z + 4.9, 0 * z + 0.62, z], 1), np.tile([0.05, 1.2, 0.12], (len(z), 1)), "wood", bevel=0.008
    )
    rails = boxes([[4.96, 0.35, 0.75], [4.96, 0.95, 0.75]], 2 * [[0.06, 0.1, 6.9]], "wood")
    return [wall, cope, pickets, rails]


def _things() -> list[Part]:
    """A tree of balls, a cat that sits, a table with a cloth, a pot."""
    trunk = tube([[2.9, 0, 0.9], [2.95, 0.8, 0.9], [2.85, 1.5, 0.95]], [0.16, 0.12, 0.1], "wood", 14)
    crown = [
        blob(c, 3 * (r,), "leaf", 0.05, k, 30)
        for k, (c, r) in enumerate(
            [((2.85, 2.1, 0.95), 0.62), ((2.35, 1.85, 1.1), 0.42), ((3.35, 1.9, 0.8), 0.45), ((2.9, 2.0, 0.35), 0.4)]
        )
    ]
    cat = [
        blob((-0.6, 0.24, 1.5), (0.2, 0.26, 0.24), "cat", 0.03, 11, 24),
        blob((-0.6, 0.58, 1.62), 3 * (0.15,), "cat", 0.03, 12, 24),
        tube([[-0.55, 0.1, 1.3], [-0.3, 0.08, 1.15], [-0.12, 0.12, 1.3]], 0.045, "cat", 10),
        *(tube([[x, 0.66, 1.62], [x, 0.8, 1.62]], [0.055, 0.01], "cat", 8) for x in (-0.68, -0.52)),
    ]
    table = boxes(
        [[-2.9, 0.72, 0.3], *([-2.9 + x, 0.35, 0.3 + z] for x in (-0.6, 0.6) for z in (-0.35, 0.35))],
        [[1.5, 0.06, 0.95], *4 * [[0.07, 0.7, 0.07]]],
        "wood",
    )
    s, t = np.meshgrid(np.linspace(-0.55, 0.55, 40), np.linspace(-0.75, 0.75, 60), indexing="ij")
    hang = 0.78 - np.maximum(np.abs(t) - 0.5, 0) * 1.2 + 0.01 * noise(np.stack([s, t, 0 * s], -1), 5)
    cloth = sheet(np.stack([s - 2.9, hang, 0.3 + np.clip(t, -0.51, 0.51)], -1), "cloth", flip=True)
    pot = blob((1.4, 0.3, -1.2), (0.3, 0.34, 0.3), "roof", 0.02, 21, 24)
    bush = blob((1.4, 0.85, -1.2), (0.4, 0.38, 0.4), "leaf", 0.1, 22, 28)
    return [trunk, *crown, *cat, table, cloth, pot, bush]


def looks() -> Looks:
    """Geometry and materials."""
    return Looks(soups=soups(_floor() + _house() + _bounds() + _things()), surfaces=surfaces())


def recipe() -> Recipe:
    """How the scene is made."""
    walk = []
    for k in range(CAMERAS):  # to and fro before the house, twice
        turn = np.radians(70) * np.sin(4 * np.pi * k / CAMERAS)
        away, high = (5.4, 6.6, 4.4)[k % 3], (1.6, 2.4, 1.2, 3.0)[k % 4]
        eye = np.array([away * np.sin(turn), high, away * np.cos(turn)])
        aim = ((0, 0.9, -1.4), (1.2, 0.9, -0.3), (-1.2, 0.8, -0.3))[k % 3]
        walk.append(Camera.look_at(eye, aim, 960, 640, yfov=52, name=f"{k}"))
    front = Camera.look_at((1.6, 1.9, 5.4), (-0.2, 1.0, -1.0), 960, 640, yfov=48, name="front")
    return Recipe(
        name="yard",
        title="A yard before a house, captured on a clear day; relit by a low sun, clouds and a lamp.",
        looks=looks,
        captured=clear("clear day", (38, 47), (1.0, 0.94, 0.85), 2.4, 0.8),
        lightings=(
            clear("low sun", (-62, 20), (1.0, 0.62, 0.32), 2.6, 0.5),
            clouds(),
            lamplit((-1.2, 2.0, 0.6), (1.0, 0.72, 0.45), 4.5, 0.12),
        ),
        cameras=(front,),
        orbit=tuple(walk),
        pixels_per_splat=3.0,
        spacing=(0.015, 0.08),
        proxy_faces=40_000,
        proxy_error=0.005,
    )
