"""A bicycle at a bench under a tree, as people walk round a thing in a park: grass, bushes, trees all round, some sky.

Leaves and blades are most of what is seen, and thin tubes. It is not shipped, and nothing is tuned on it:
`scripts/bench truth` makes it where it is needed.
"""

from __future__ import annotations

import numpy as np

from mirelight.model import Camera
from scenegen.geometry import Part, blob, boxes, leaves, noise, place, sheet, soups, spline, tube
from scenegen.recipe import Recipe
from scenegen.skies import clear, clouds, lamplit
from scenegen.textures import Surface, paint, palette, plain, plaster, srgb, stone, wood
from scenegen.truth import Looks

CAMERAS = 90
FAR = 60.0  # metres to the ground's end
NEAR_TREE = (-1.9, -1.7)  # x, z; its crown hangs over the bench
TREES = ((4.6, -5.2, 1.1), (-6.4, -4.8, 1.3), (7.2, 2.6, 1.0), (-7.0, 3.9, 1.2), (0.8, -9.0, 1.4), (1.5, 9.5, 1.3))
BUSHES = ((1.9, -2.1, 0.6), (2.9, -1.2, 0.45), (-3.4, 0.9, 0.5), (0.2, -3.3, 0.7))  # x, z, radius


def surfaces() -> dict[str, Surface]:
    """Every material."""
    return {
        "earth": Surface(texture=plaster(srgb(98, 112, 58), srgb(128, 116, 78), srgb(84, 76, 52), 701), size=7.0),
        "path": Surface(texture=stone(srgb(178, 164, 142), srgb(126, 114, 98), 703), size=2.0),
        "blade": Surface(texture=palette([srgb(92, 122, 52), srgb(124, 146, 70), srgb(150, 152, 92)], 705), size=1.0),
        "leaf": Surface(texture=palette([srgb(62, 98, 44), srgb(90, 128, 60), srgb(128, 150, 82)], 707), size=1.0),
        "bush": Surface(texture=plain(srgb(54, 74, 38), 709, contrast=0.2), size=1.0),
        "bark": Surface(texture=wood(srgb(112, 92, 74), srgb(66, 52, 42), 711), size=1.0),
        "slat": Surface(texture=wood(srgb(172, 118, 72), srgb(112, 72, 44), 713), size=1.2),
        "iron": Surface(texture=plain(srgb(52, 60, 56), 715, contrast=0.1), size=1.0),
        "frame": Surface(texture=paint(srgb(40, 96, 150), srgb(50, 84, 120), 717), size=1.0),
        "tyre": Surface(texture=plain(srgb(38, 38, 40), 719, contrast=0.1), size=1.0),
        "steel": Surface(texture=plain(srgb(190, 192, 194), 721, contrast=0.05), size=1.0),
    }


def _ground() -> list[Part]:
    """Uneven ground, blades of grass where cameras are near, a gravel path."""
    axis = np.sign(np.linspace(-1, 1, 181)) * np.abs(np.linspace(-1, 1, 181)) ** 2 * FAR
    s, t = np.meshgrid(axis, axis, indexing="ij")
    earth = sheet(np.stack([s, _height(s, t), t], -1), "earth", flip=True)
    u, w = np.meshgrid(np.linspace(-9, 9, 90), np.linspace(-0.6, 0.6, 7), indexing="ij")
    across = 1.5 + w + 0.25 * np.sin(0.4 * u)
    path = sheet(np.stack([u, _height(u, across) + 0.02, across], -1), "path", flip=True)
    rng = np.random.default_rng(71)
    at = rng.uniform(-5.5, 5.5, (26_000, 2))
    off = np.abs(at[:, 1] - 1.5 - 0.25 * np.sin(0.4 * at[:, 0])) > 0.62
    tufts = noise(np.stack([at[:, 0], at[:, 1], 0 * at[:, 0]], -1) * 0.9, 73) > -0.25
    at = at[off & tufts]
    feet = np.stack([at[:, 0], _height(at[:, 0], at[:, 1]) - 0.01, at[:, 1]], -1)
    up = np.array([0, 1.0, 0]) + 0.35 * rng.normal(size=feet.shape)
    grass = leaves(feet, up, rng.uniform(0.06, 0.17, len(feet)), "blade", rng, width=0.16)
    return [earth, path, grass]


def _height(x: np.ndarray, z: np.ndarray) -> np.ndarray:
    away = np.maximum(np.hypot(x, z) - 3, 0)
    return np.asarray(0.05 * noise(np.stack([x, z, 0 * x], -1) * 0.5, 75) + 0.6 * (1 - np.exp(-away / 14)))


def _bench() -> list[Part]:
    """Slats of a seat and a back on iron legs."""
    seat = [[0, 0.45, z] for z in (-0.02, 0.1, 0.22, 0.34)]
    back = [[0, 0.62 + 0.12 * k, -0.1 - 0.03 * k] for k in range(3)]
    slats = boxes(seat + back, [[1.7, 0.035, 0.095]] * 4 + [[1.7, 0.095, 0.035]] * 3, "slat", bevel=0.006)
    legs = []
    for x in (-0.7, 0.7):
        legs.append(tube(spline([[x, 0, 0.36], [x, 0.3, 0.3], [x, 0.42, 0.36]], 12), 0.022, "iron", 8))
        legs.append(tube(spline([[x, 0, -0.1], [x, 0.42, -0.06], [x, 0.95, -0.2]], 14), 0.022, "iron", 8))
        legs.append(tube([[x, 0.42, 0.36], [x, 0.42, -0.06]], 0.02, "iron", 8))
        legs.append(tube(spline([[x, 0.42, 0.36], [x, 0.66, 0.32], [x, 0.68, -0.1]], 14), 0.018, "iron", 8))
    return [slats, *legs]


def _bicycle() -> list[Part]:
    """In its own plane along x, wheels on the ground, then leant on the bench."""
    r = 0.34
    angle = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    parts = []
    for hub in (-0.5, 0.5):
        ring = np.stack([hub + r * np.cos(angle), r + r * np.sin(angle), 0 * angle], -1)
        parts.append(tube(ring, 0.02, "tyre", 10, closed=True))
        inner = ring + (np.array([hub, r, 0]) - ring) * 0.08
        parts.append(tube(inner, 0.009, "steel", 6, closed=True))
        for k in range(16):
            tip = inner[int(k * 40 / 16)]
            parts.append(tube([[hub, r, 0.03 * (-1) ** k], tip], 0.003, "steel", 4, solid=False))
        parts.append(tube([[hub, r, -0.05], [hub, r, 0.05]], 0.022, "steel", 10))
    crank, saddle, head = np.array([-0.08, 0.3, 0]), np.array([-0.24, 0.86, 0]), np.array([0.36, 0.84, 0])
    low = head - [-0.03, 0.14, 0]
    tubes = [(crank, saddle), (crank, low), (saddle - [-0.02, 0.06, 0], head - [0.0, 0.03, 0]), (low, head)]
    parts += [tube(np.array(ends), 0.019, "frame", 10) for ends in tubes]
    for side in (-0.035, 0.035):
        rear, front = np.array([-0.5, r, side]), np.array([0.5, r, side])
        parts.append(tube(np.array([rear, np.add(crank, (0, 0, side))]), 0.011, "frame", 8))
        parts.append(tube(np.array([rear, saddle - [-0.02, 0.08, -side / 2]]), 0.01, "frame", 8))
        parts.append(tube(np.array([front, np.add(low, (0, 0, side))]), 0.013, "frame", 8))
    parts.append(tube(np.array([head, np.add(head, (-0.02, 0.14, 0))]), 0.013, "steel", 8))
    bar = spline([[0.28, 0.98, -0.28], [0.36, 1.0, -0.12], [0.36, 0.99, 0.12], [0.28, 0.98, 0.28]], 20)
    parts.append(tube(bar, 0.013, "steel", 8))
    parts.append(blob(np.add(saddle, (-0.03, 0.06, 0)), (0.14, 0.03, 0.075), "tyre", 0.0, 5, 16))
    ring = np.stack([crank[0] + 0.09 * np.cos(angle), crank[1] + 0.09 * np.sin(angle), 0.05 + 0 * angle], -1)
    parts.append(tube(ring, 0.012, "steel", 6, closed=True))
    lean, turn = np.radians(-9), place(0.25, 0.0, 0.66, 4)
    tilt = np.eye(4)
    tilt[1:3, 1:3] = [[np.cos(lean), -np.sin(lean)], [np.sin(lean), np.cos(lean)]]
    return [part.moved(turn @ tilt) for part in parts]


def _tree(x: float, z: float, scale: float, seed: int) -> list[Part]:
    """A trunk, branches that fork once, leaves round their ends; no core, so light comes through."""
    rng = np.random.default_rng(seed)
    foot = np.array([x, float(_height(np.array(x), np.array(z))) - 0.1, z])
    top = foot + np.array([0.25, 3.4, 0.1]) * scale
    trunk = spline([foot, (foot + top) / 2 + [0.08, 0, -0.05], top], 16)
    parts = [tube(trunk, np.linspace(0.17, 0.07, 16) * scale, "bark", 12)]
    for _ in range(11):
        base = trunk[rng.integers(8, 16)]
        turn = rng.uniform(0, 2 * np.pi)
        tip = base + scale * np.array([1.5 * np.sin(turn), rng.uniform(0.2, 1.2), 1.5 * np.cos(turn)])
        branch = spline([base, (base + tip) / 2 + [0, 0.15 * scale, 0], tip], 10)
        parts.append(tube(branch, np.linspace(0.05, 0.018, 10) * scale, "bark", 8))
        for end in (tip, branch[6]):
            d = rng.normal(size=(150, 3))
            d /= np.linalg.norm(d, axis=1, keepdims=True)
            at = end + d * (scale * 0.62 * rng.uniform(0.3, 1.0, (150, 1)))
            away = d + 0.8 * rng.normal(size=d.shape) - [0, 0.4, 0]
            parts.append(leaves(at, away, scale * rng.uniform(0.1, 0.2, 150), "leaf", rng, width=0.6))
    return parts


def _plants() -> list[Part]:
    parts = _tree(*NEAR_TREE, 0.95, 81)
    for k, (x, z, scale) in enumerate(TREES):
        parts += _tree(x, z, scale, 90 + k)
    rng = np.random.default_rng(83)
    for k, (x, z, radius) in enumerate(BUSHES):
        centre = np.array([x, float(_height(np.array(x), np.array(z))) + 0.7 * radius, z])
        d = rng.normal(size=(int(2200 * radius), 3))
        d /= np.linalg.norm(d, axis=1, keepdims=True)
        at = centre + d * radius * rng.uniform(0.75, 1.1, (len(d), 1))
        parts.append(blob(centre, (0.72 * radius,) * 3, "bush", 0.15, 300 + k, 20))
        parts.append(
            leaves(at, d + 0.7 * rng.normal(size=d.shape), rng.uniform(0.07, 0.13, len(d)), "leaf", rng, width=0.55)
        )
    for k in range(46):  # a wood all round
        turn, away = 2 * np.pi * k / 46 + rng.uniform(-0.05, 0.05), rng.uniform(17, 24)
        size = rng.uniform(2.2, 3.6)
        centre = np.array([away * np.sin(turn), 0.4 + 0.7 * size, away * np.cos(turn)])
        d = rng.normal(size=(420, 3))
        d /= np.linalg.norm(d, axis=1, keepdims=True)
        at = centre + d * size * [0.95, 1.05, 0.95]
        parts.append(blob(centre, (0.9 * size, size, 0.9 * size), "bush", 0.25, 400 + k, 16))
        parts.append(
            leaves(at, d + 0.6 * rng.normal(size=d.shape), rng.uniform(0.4, 0.8, len(d)), "leaf", rng, width=0.6)
        )
    return parts


def looks() -> Looks:
    """Geometry and materials."""
    stand = place(0, float(_height(np.array(0.0), np.array(0.0))), 0)
    things = [part.moved(stand) for part in _bench() + _bicycle()]
    return Looks(soups=soups(_ground() + _plants() + things), surfaces=surfaces())


def recipe() -> Recipe:
    """How the scene is made."""
    walk = []
    for k in range(CAMERAS):  # three times round the bench
        turn, lap = 6 * np.pi * k / CAMERAS + 0.1, 3 * k // CAMERAS
        away, high = ((3.4, 1.5), (2.7, 0.9), (3.0, 2.1))[lap]
        eye = np.array([away * np.sin(turn), high + 0.06 * np.sin(5 * turn), 0.2 + away * np.cos(turn)])
        walk.append(Camera.look_at(eye, (0.05, 0.55, 0.2), 960, 640, yfov=50, name=f"{k}"))
    front = Camera.look_at((1.7, 1.4, 3.0), (0.05, 0.6, 0.2), 960, 640, yfov=46, name="front")
    return Recipe(
        name="park",
        title="A bicycle at a bench in a park, captured on a clear day; relit by a low sun, clouds and a lamp.",
        looks=looks,
        captured=clear("clear day", (48, 50), (1.0, 0.94, 0.85), 3.3, 1.25),
        lightings=(
            clear("low sun", (-28, 22), (1.0, 0.62, 0.32), 4.2, 0.8),
            clouds(),
            lamplit((1.3, 2.4, 1.0), (1.0, 0.74, 0.46), 14.0, 0.14),
        ),
        cameras=(front,),
        orbit=tuple(walk),
        pixels_per_splat=3.0,
        spacing=(0.015, 0.2),
        proxy_faces=60_000,
        proxy_error=0.01,
    )
