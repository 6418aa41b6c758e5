"""A Mediterranean courtyard: floor, arcade, walls, windows, roof. Metres; the open side is +Z."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from scenegen.geometry import F64, Part, blob, boxes, lathe, leaves, place, rectangle, sheet
from scenegen.textures import Surface, paint, painted_tiles, palette, plain, plaster, srgb, stone, terracotta, wood

LEFT, RIGHT, FRONT, ARCADE, GALLERY = (
    -4.1,
    4.1,
    6.2,
    -2.6,
    -4.3,
)  # walls: x, x, and z of floor's end, arcade, its back wall
STAIRS = -2.95  # x of the stairs' free side
SPRING, RADIUS = 2.0, 0.93  # arches
BAYS = (-1.80, 0.55, 2.90)  # x of the arches' centres
STOREY, EAVE = 3.25, 5.3  # heights of the string course and the roof's edge
FOUNTAIN = 0.85  # z of the wall fountain
WALL = 6.6  # height of the left wall
LANTERNS = (
    (-0.625, 2.32, ARCADE + 0.34),
    (1.725, 2.32, ARCADE + 0.34),
    (LEFT + 0.36, 4.15, -1.1),
    (RIGHT - 0.34, 2.78, FOUNTAIN),
)


def surfaces() -> dict[str, Surface]:
    """Every material of the courtyard."""
    clay, lime, sand = srgb(178, 100, 66), srgb(205, 190, 166), srgb(196, 180, 150)
    return {
        "floor": Surface(texture=terracotta(srgb(184, 112, 78), 11), size=4.0),
        "joint": Surface(texture=plain(srgb(140, 124, 106), 12), size=2.0),
        "plaster": Surface(texture=plaster(srgb(226, 196, 148), srgb(214, 172, 122), srgb(160, 122, 88), 21), size=3.2),
        "whitewash": Surface(
            texture=plaster(srgb(232, 222, 204), srgb(214, 196, 166), srgb(176, 150, 120), 24), size=3.2
        ),
        "stone": Surface(texture=stone(lime, srgb(150, 130, 104), 31), size=1.6),
        "tread": Surface(texture=stone(sand, srgb(140, 120, 96), 32), size=1.8),
        "roof": Surface(texture=terracotta(srgb(180, 98, 62), 41, spread=0.26), size=3.0),
        "pot": Surface(texture=terracotta(clay, 42, spread=0.12), size=2.0),
        "glazed": Surface(texture=plain(srgb(30, 92, 112), 43, contrast=0.2), size=1.0, roughness=0.18),
        "tiles": Surface(texture=painted_tiles(seed=5), size=0.8, roughness=0.25),
        "shutter": Surface(texture=paint(srgb(62, 124, 138), srgb(150, 136, 116), 51), size=1.2),
        "wood": Surface(texture=wood(srgb(134, 92, 58), srgb(76, 48, 30), 52), size=1.2),
        "iron": Surface(texture=plain(srgb(62, 58, 54), 53, contrast=0.15), size=1.0),
        "brass": Surface(texture=plain(srgb(208, 168, 98), 54), size=1.0),
        "water": Surface(texture=plain(srgb(44, 88, 90), 55, contrast=0.2), size=2.0, roughness=0.12),
        "soil": Surface(texture=plain(srgb(74, 56, 42), 56, contrast=0.3), size=0.5),
        "bush": Surface(texture=plain(srgb(58, 82, 42), 57, contrast=0.35), size=0.6),
        "leaf": Surface(texture=palette([srgb(66, 100, 44), srgb(98, 140, 60), srgb(146, 174, 90)], 61), size=1.0),
        "olive": Surface(texture=palette([srgb(106, 124, 84), srgb(148, 162, 116), srgb(184, 194, 156)], 62), size=1.0),
        "bract": Surface(texture=palette([srgb(186, 36, 100), srgb(222, 62, 132), srgb(240, 124, 168)], 63), size=1.0),
        "geranium": Surface(texture=palette([srgb(186, 34, 30), srgb(214, 62, 44), srgb(232, 110, 84)], 64), size=1.0),
    }


def wall(
    origin: ArrayLike, along: ArrayLike, size: tuple[float, float], material: str, holes: F64, depth: float
) -> list[Part]:
    """An upright wall with rectangular holes (n, 4) as x0, y0, x1, y1, and their reveals going `depth` inwards.

    It faces along x up (+Y).
    """
    o, a = np.asarray(origin, dtype=np.float64), np.asarray(along, dtype=np.float64)
    up = np.array([0.0, 1.0, 0.0])
    inward = -np.cross(a, up) * depth
    xs = np.unique(np.concatenate([[0, size[0]], holes[:, 0], holes[:, 2]]))
    ys = np.unique(np.concatenate([[0, size[1]], holes[:, 1], holes[:, 3]]))
    parts = []
    for x0, x1 in pairwise(xs):
        for y0, y1 in pairwise(ys):
            x, y = (x0 + x1) / 2, (y0 + y1) / 2
            if not np.any((holes[:, 0] < x) & (x < holes[:, 2]) & (holes[:, 1] < y) & (y < holes[:, 3])):
                part = rectangle(o + a * x0 + up * y0, a * (x1 - x0), up * (y1 - y0), material)
                parts.append(uv_shift(part, x0, y0))
    for x0, y0, x1, y1 in holes:
        low, high = o + a * x0 + up * y0, o + a * x1 + up * y1
        wide, tall = a * (x1 - x0), up * (y1 - y0)
        parts += [
            rectangle(low, inward, wide, material),
            rectangle(high, inward, -wide, material),
            rectangle(low, tall, inward, material),
            rectangle(high, -tall, inward, material),
        ]
    return parts


def uv_shift(part: Part, u: float, v: float) -> Part:
    return Part(
        vertices=part.vertices,
        faces=part.faces,
        uvs=part.uvs + np.array([u, v]),
        material=part.material,
        solid=part.solid,
    )


def floor() -> list[Part]:
    """Clay tiles laid square in joints, a stone border along the walls and around the well."""
    rng = np.random.default_rng(1)
    pitch = 0.34
    x, z = np.meshgrid(np.arange(LEFT + 0.17, RIGHT, pitch), np.arange(GALLERY + 0.1, FRONT, pitch))
    centre = np.stack([x.ravel(), np.full(x.size, -0.02), z.ravel()], axis=1)
    centre[:, 1] += rng.uniform(-0.003, 0.003, len(centre))
    tilt = rng.normal(0, 0.005, (len(centre), 2))
    frames = np.tile(np.eye(3), (len(centre), 1, 1))
    frames[:, 1, 0], frames[:, 0, 1] = tilt[:, 0], -tilt[:, 0]
    frames[:, 1, 2], frames[:, 2, 1] = tilt[:, 1], -tilt[:, 1]
    tiles = boxes(centre, (pitch - 0.016, 0.04, pitch - 0.016), "floor", bevel=0.006, frames=frames, seed=2)
    joints = rectangle((LEFT, -0.008, FRONT), (RIGHT - LEFT, 0, 0), (0, 0, GALLERY - FRONT), "joint", step=1.0)
    kerb_x = np.arange(STAIRS + 0.35, RIGHT, 0.7)
    kerb = np.stack([kerb_x, np.full(len(kerb_x), 0.0), np.full(len(kerb_x), ARCADE + 0.22)], axis=1)
    return [tiles, joints, boxes(kerb, (0.69, 0.09, 0.62), "tread", bevel=0.015, seed=3)]


def column(x: float, z: float) -> list[Part]:
    """A round column with base and capital, carrying the arches at the springing."""
    shaft = [
        (0.175, 0.26),
        (0.172, 0.6),
        (0.165, 1.1),
        (0.150, 1.62),
        (0.148, 1.70),
        (0.17, 1.715),
        (0.17, 1.74),
        (0.15, 1.755),
    ]
    bell = [(0.15, 1.76), (0.158, 1.80), (0.19, 1.86), (0.225, 1.895), (0.225, 1.91)]
    base = [(0.24, 0.12), (0.245, 0.145), (0.235, 0.175), (0.20, 0.185), (0.205, 0.215), (0.195, 0.24), (0.175, 0.26)]
    blocks = boxes(
        [[0, 0.07, 0], [0, 1.955, 0]], [[0.52, 0.14, 0.52], [0.50, 0.09, 0.50]], "stone", bevel=0.018, seed=4
    )
    return [part.moved(place(x, 0, z)) for part in (lathe(base + shaft + bell, "stone", 40), blocks)]


def arcade() -> list[Part]:
    """Three arches on columns, the wall above them with shuttered windows, and the gallery behind."""
    parts: list[Part] = []
    edges = (STAIRS, (BAYS[0] + BAYS[1]) / 2, (BAYS[1] + BAYS[2]) / 2, RIGHT)
    thick = 0.40
    for bay, x in enumerate(BAYS):
        turn = np.linspace(np.pi, 0, 33)
        xs = np.concatenate([[edges[bay]], x + RADIUS * np.cos(turn), [edges[bay + 1]]])
        low = np.concatenate([[SPRING], SPRING + RADIUS * np.sin(turn), [SPRING]])
        t = np.linspace(0, 1, 5)[None, :]
        ys = low[:, None] * (1 - t) + STOREY * t
        front = np.stack([np.broadcast_to(xs[:, None], ys.shape), ys, np.full(ys.shape, ARCADE)], axis=-1)
        face = sheet(front, "plaster")
        face = Part(vertices=face.vertices, faces=face.faces, uvs=face.vertices[:, :2], material="plaster")
        soffit = np.stack([front[:, 0], front[:, 0] - [0, 0, thick]], axis=1)
        back = sheet(front - [0, 0, thick], "plaster", flip=True)
        parts += [face, back, sheet(soffit, "plaster", flip=True)]
        angle = (np.arange(13) + 0.5) / 13 * np.pi
        c, s, o = np.cos(angle), np.sin(angle), np.zeros(13)
        frames = np.stack([np.stack([c, -s, o], -1), np.stack([s, c, o], -1), np.stack([o, o, o + 1], -1)], axis=1)
        ring = np.stack([x + (RADIUS + 0.10) * c, SPRING + (RADIUS + 0.10) * s, o + ARCADE - thick / 2], axis=1)
        size = (0.24, np.pi * (RADIUS + 0.08) / 13 * 0.985, thick + 0.07)
        parts.append(boxes(ring, size, "stone", bevel=0.014, frames=frames, seed=20 + bay))
    for x in edges[1:3]:
        parts += column(x, ARCADE - thick / 2)
    for x in (edges[0] + 0.09, edges[3] - 0.05):
        y = np.arange(0.2, SPRING, 0.4)
        quoins = np.stack([np.full(5, x), y, np.full(5, ARCADE - thick / 2)], axis=1)
        parts.append(boxes(quoins, (0.32, 0.39, thick + 0.04), "stone", bevel=0.015, seed=30))
    holes = np.array([[x - STAIRS - 0.42, 0.42, x - STAIRS + 0.42, 1.66] for x in BAYS])
    parts += wall((STAIRS, STOREY, ARCADE), (1, 0, 0), (RIGHT - STAIRS, EAVE - STOREY), "plaster", holes, 0.22)
    course = np.arange(STAIRS + 0.42, RIGHT, 0.84)
    moulding = np.stack([course, np.full(len(course), STOREY + 0.02), np.full(len(course), ARCADE + 0.03)], axis=1)
    parts.append(boxes(moulding, (0.832, 0.12, 0.16), "stone", bevel=0.03, seed=31))
    for k, x in enumerate(BAYS):
        parts += window(x, 60 + k)
    parts += gallery()
    return parts


def window(x: float, seed: int) -> list[Part]:
    """Louvred shutters (folded back, or closed in the middle bay), sill, frame and a flower box."""
    y, z = STOREY + 1.04, ARCADE
    frame = [
        [x, STOREY + 1.72, z + 0.01],
        [x - 0.47, y, z + 0.01],
        [x + 0.47, y, z + 0.01],
        [x, STOREY + 0.38, z + 0.06],
    ]
    sizes = [[1.10, 0.13, 0.10], [0.11, 1.26, 0.09], [0.11, 1.26, 0.09], [1.14, 0.09, 0.22]]
    parts = [boxes(frame, sizes, "stone", bevel=0.015, seed=seed)]
    parts.append(boxes((x, y, z - 0.24), (0.84, 1.24, 0.04), "wood", bevel=0.004, seed=seed + 1))
    closed = seed == 61
    for side in (-1, 1):
        turn = side * (3 if closed else 171)
        hinge = place(x + side * 0.42, y, z + (-0.05 if closed else 0.075), turn)
        inner = -side * 0.21
        rails = [[inner - 0.185, 0, 0], [inner + 0.185, 0, 0], [inner, -0.59, 0], [inner, 0.59, 0], [inner, 0, 0]]
        rail_size = [[0.05, 1.24, 0.04], [0.05, 1.24, 0.04], [0.33, 0.07, 0.04], [0.33, 0.07, 0.04], [0.33, 0.06, 0.04]]
        slats = np.array([[inner, h, 0] for h in np.arange(-0.53, 0.55, 0.062) if abs(h) > 0.05])
        lean = np.array([[1, 0, 0], [0, 0.82, -0.57], [0, 0.57, 0.82]])
        parts.append(boxes(rails, rail_size, "shutter", bevel=0.004, seed=seed + 2).moved(hinge))
        parts.append(
            boxes(slats, (0.33, 0.010, 0.058), "shutter", bevel=0.002, frames=lean, seed=seed + 3).moved(hinge)
        )
    if closed:
        return parts
    rng = np.random.default_rng(seed)
    box = boxes((x, STOREY + 0.51, z + 0.17), (0.86, 0.17, 0.2), "pot", bevel=0.012, seed=seed)
    mound = blob((x, STOREY + 0.62, z + 0.17), (0.42, 0.12, 0.12), "bush", 0.25, seed, rings=18)
    parts += [box, mound]
    for material, count, reach, length in (("leaf", 260, 1.06, 0.07), ("geranium", 190, 1.22, 0.055)):
        d = rng.normal(size=(count, 3))
        d /= np.linalg.norm(d, axis=1, keepdims=True)
        d[:, 1] = np.abs(d[:, 1])
        at = np.array([x, STOREY + 0.60, z + 0.17]) + d * [0.42, 0.15, 0.14] * reach
        parts.append(
            leaves(at, d + rng.normal(0, 0.5, d.shape), rng.uniform(0.7, 1.2, count) * length, material, rng, width=0.8)
        )
    return parts


def gallery() -> list[Part]:
    """The covered walk behind the arches: back wall with a plank door, ceiling on beams, end walls."""
    wide, deep = RIGHT - STAIRS, ARCADE - GALLERY
    door_x = BAYS[1] - STAIRS
    hole = np.array(
        [[door_x - 0.52, 0.0, door_x + 0.52, 2.15], [BAYS[2] - STAIRS - 0.3, 0.95, BAYS[2] - STAIRS + 0.3, 1.75]]
    )
    parts = wall((STAIRS, 0, GALLERY), (1, 0, 0), (wide, STOREY), "whitewash", hole, 0.18)
    parts.append(rectangle((STAIRS, 0, ARCADE), (0, 0, -deep), (0, STOREY, 0), "whitewash"))
    parts.append(rectangle((STAIRS, STOREY - 0.02, GALLERY), (wide, 0, 0), (0, 0, deep), "whitewash"))
    beam = np.arange(STAIRS + 0.3, RIGHT, 0.62)
    at = np.stack([beam, np.full(len(beam), STOREY - 0.1), np.full(len(beam), (ARCADE + GALLERY) / 2)], axis=1)
    parts.append(boxes(at, (0.13, 0.17, deep), "wood", bevel=0.012, seed=70))
    plank = np.stack([BAYS[1] + np.linspace(-0.43, 0.43, 6), np.full(6, 1.06), np.full(6, GALLERY - 0.12)], axis=1)
    parts.append(boxes(plank, (0.166, 2.1, 0.05), "shutter", bevel=0.008, seed=71))
    frame = [
        [BAYS[1] - 0.59, 1.1, GALLERY + 0.02],
        [BAYS[1] + 0.59, 1.1, GALLERY + 0.02],
        [BAYS[1], 2.24, GALLERY + 0.02],
    ]
    parts.append(boxes(frame, [[0.16, 2.2, 0.1], [0.16, 2.2, 0.1], [1.34, 0.18, 0.12]], "stone", bevel=0.015, seed=72))
    parts.append(boxes((BAYS[2], 1.35, GALLERY - 0.2), (0.6, 0.8, 0.04), "tiles", bevel=0.003))
    dado = np.stack([np.arange(STAIRS + 0.4, RIGHT, 0.8), np.full(9, 0.4), np.full(9, GALLERY + 0.012)], axis=1)
    dado = dado[np.abs(dado[:, 0] - BAYS[1]) > 0.95]
    parts.append(boxes(dado, (0.8, 0.8, 0.02), "tiles", bevel=0.002))
    return parts


def side_walls() -> list[Part]:
    """Left and right walls with stone footing and a coping of roof tiles; the upper door over the stairs."""
    z_door = -2.15
    door = np.array([[FRONT - z_door - 0.5, 2.4, FRONT - z_door + 0.5, 4.45]])
    parts = wall((LEFT, 0, FRONT), (0, 0, -1), (FRONT - GALLERY, WALL), "whitewash", door, 0.2)
    plank = np.stack([np.full(6, LEFT - 0.14), np.full(6, 3.43), z_door + np.linspace(-0.42, 0.42, 6)], axis=1)
    parts.append(boxes(plank, (0.05, 2.05, 0.162), "shutter", bevel=0.008, seed=80))
    parts.append(rectangle((RIGHT, 0, GALLERY), (0, 0, FRONT - GALLERY), (0, 4.6, 0), "whitewash"))
    parts.append(rectangle((LEFT, 0, GALLERY), (STAIRS - LEFT, 0, 0), (0, WALL, 0), "whitewash"))
    for x in (LEFT, RIGHT):
        z = np.arange(GALLERY + 0.4, FRONT, 0.8)
        footing = np.stack([np.full(len(z), x), np.full(len(z), 0.16), z], axis=1)
        parts.append(boxes(footing, (0.12, 0.34, 0.79), "stone", bevel=0.02, seed=81))
    z = np.arange(GALLERY + 0.12, FRONT, 0.225)
    half = np.linspace(0, np.pi, 9)
    for k, zc in enumerate(z):
        ridge = np.array([[x, 4.66 + 0.25 * abs(x - RIGHT) * -1, zc] for x in np.linspace(RIGHT - 0.2, RIGHT + 0.4, 2)])
        ring = np.stack([0 * half, 0.085 * np.sin(half), 0.115 * np.cos(half)], axis=-1)
        part = sheet(ridge[:, None] + ring[None], "roof")
        parts.append(uv_shift(part, 0.37 * k, 0.61 * k))
    parts.append(boxes((RIGHT + 0.12, 4.57, (FRONT + GALLERY) / 2), (0.46, 0.09, FRONT - GALLERY), "stone", bevel=0.02))
    return parts


def roof() -> list[Part]:
    """Eave over the arcade's wall: rafters, boarding and barrel tiles."""
    parts: list[Part] = []
    slope = np.array([0, 0.36, -1.0])
    edge = np.array([0, EAVE + 0.02, ARCADE + 0.5])
    half = np.linspace(0, np.pi, 11)
    for k, x in enumerate(np.arange(STAIRS - 0.05, RIGHT + 0.2, 0.21)):
        for row in range(5):
            start = edge + slope * row * 0.40 + [x, 0.035 * (row > 0), 0]
            path = np.array([start, start + slope * 0.46 + [0, -0.03, 0]])
            radius = np.array([0.112, 0.09])[:, None]
            ring = np.stack([np.cos(half) * radius, np.sin(half) * radius * 0.9, 0 * half * radius], axis=-1)
            parts.append(uv_shift(sheet(path[:, None] + ring, "roof", flip=False), 0.53 * k, 0.29 * row + 0.7 * k))
    board = edge + np.array([STAIRS - 0.2, -0.01, 0])
    parts.append(rectangle(board, (RIGHT - STAIRS + 0.4, 0, 0), slope * 2.2, "joint", step=0.5))
    parts.append(rectangle(board - [0, 0.03, 0], slope * 2.2, (RIGHT - STAIRS + 0.4, 0, 0), "wood", step=0.5))
    x = np.arange(STAIRS + 0.15, RIGHT, 0.47)
    tilt = np.array([[1, 0, 0], [0, 1, 0.36], [0, -0.36, 1]]) / np.array([1, 1.0628, 1.0628])
    rafter = np.stack([x, np.full(len(x), EAVE - 0.01), np.full(len(x), ARCADE + 0.2)], axis=1)
    parts.append(boxes(rafter, (0.09, 0.11, 0.62), "wood", bevel=0.01, frames=tilt.T, seed=90))
    return parts
