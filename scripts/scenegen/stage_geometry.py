"""A still life on a theatre stage: a knot of glazed clay on a marble plinth, an amphora, fruit, books, linen drapes."""

from __future__ import annotations

import numpy as np

from scenegen.geometry import F64, Part, blob, boxes, lathe, leaves, noise, place, sheet, spline, tube
from scenegen.textures import F32, Surface, clouds, mix, palette, plain, srgb, stone, terracotta, wood

BACK, WING = -1.55, 2.75  # z of the back drape, x of the side drapes


def amphora_paint(size: int = 768) -> F32:
    """Black-figure bands along the columns (foot to lip): rays, meander, waves, on orange clay."""
    clay = terracotta(srgb(200, 118, 70), 5, size, spread=0.06).astype(np.float64)
    ink = srgb(38, 30, 27) + np.zeros_like(clay)
    key = np.array(
        [
            [int(c) for c in row]
            for row in ("11111111", "10000001", "10111101", "10100101", "10110101", "10000101", "11111101", "00000001")
        ]
    )
    u, v = np.meshgrid((np.arange(size) + 0.5) / size, (np.arange(size) + 0.5) / size)
    dark = (u < 0.09) | (np.abs(u - 0.40) < 0.045) & (
        key[(v * 26 * 8).astype(int) % 8, ((u - 0.355) / 0.09 * 8).clip(0, 7).astype(int)] > 0
    )
    dark |= (u > 0.13) & (u < 0.30) & (np.abs((v * 22) % 1 - 0.5) < 0.42 * (0.30 - u) / 0.17)
    for at in (0.335, 0.345, 0.455, 0.465, 0.66, 0.70):
        dark |= np.abs(u - at) < 0.003
    wave = 0.58 + 0.045 * np.sin(2 * np.pi * 9 * v) * np.abs(np.sin(2 * np.pi * 9 * v)) ** 0.2
    dark |= (u > 0.50) & (u < 0.645) & (np.abs(u - wave) < 0.020)
    dark |= (u > 0.72) & (u < 0.80) & (np.abs((v * 30) % 1 - 0.5) < 0.28)
    dark |= u > 0.83
    return mix(clay, ink, dark.astype(np.float64)).clip(0.02, 0.8).astype(np.float32)


def linen(size: int = 1024) -> F32:
    """Natural linen with slubs along both threads."""
    warp = clouds(size, 91, slope=0.7, low=20, stretch=(0.04, 1.0))
    weft = clouds(size, 92, slope=0.7, low=20, stretch=(1.0, 0.04))
    broad = clouds(size, 93, slope=1.7, low=1)
    tone = 1 + 0.035 * warp + 0.035 * weft + 0.05 * broad
    return np.clip(srgb(208, 196, 176) * tone[..., None], 0.05, 0.8).astype(np.float32)


def surfaces() -> dict[str, Surface]:
    """Every material of the stage."""
    return {
        "linen": Surface(texture=linen(), size=1.6),
        "boards": Surface(texture=wood(srgb(150, 108, 74), srgb(84, 56, 38), 71, size=1024), size=2.4),
        "gap": Surface(texture=plain(srgb(40, 32, 28), 72), size=1.0),
        "marble": Surface(texture=stone(srgb(226, 220, 210), srgb(140, 134, 132), 73), size=1.3),
        "glaze": Surface(texture=stone(srgb(58, 128, 122), srgb(212, 168, 84), 74), size=0.9, roughness=0.22),
        "amphora": Surface(texture=amphora_paint(), size=1.42),
        "cloth": Surface(texture=plain(srgb(142, 38, 44), 75, contrast=0.12), size=0.8),
        "brass": Surface(texture=plain(srgb(206, 160, 84), 76), size=0.5, roughness=0.2),
        "wax": Surface(texture=plain(srgb(234, 224, 200), 77, contrast=0.04), size=0.3),
        "fruit": Surface(texture=stone(srgb(170, 44, 40), srgb(206, 130, 62), 78), size=0.5, roughness=0.25),
        "lemon": Surface(texture=plain(srgb(226, 182, 58), 79, contrast=0.08), size=0.3),
        "leather": Surface(texture=plain(srgb(44, 72, 96), 80, contrast=0.2), size=0.4),
        "leather 2": Surface(texture=plain(srgb(122, 74, 42), 81, contrast=0.2), size=0.4),
        "pages": Surface(texture=wood(srgb(226, 212, 182), srgb(190, 170, 136), 82), size=0.3),
        "bowl": Surface(texture=plain(srgb(222, 218, 208), 83, contrast=0.05), size=0.5, roughness=0.2),
        "wood": Surface(texture=wood(srgb(134, 92, 58), srgb(76, 48, 30), 52), size=1.2),
        "olive": Surface(texture=palette([srgb(96, 116, 76), srgb(138, 154, 108), srgb(178, 188, 150)], 62), size=1.0),
    }


def boards() -> list[Part]:
    """Planks running towards the viewer, staggered."""
    rng = np.random.default_rng(3)
    centres, sizes = [], []
    for x in np.arange(-3.2, 3.2, 0.19):
        z, end = BACK - 0.6 - rng.uniform(0, 1.5), 4.0
        while z < end:
            length = rng.uniform(1.3, 2.2)
            centres.append([x + 0.095, -0.02 + rng.uniform(-0.0015, 0.0015), z + length / 2])
            sizes.append([0.184, 0.04, length - 0.006])
            z += length
    planks = boxes(np.array(centres), np.array(sizes), "boards", bevel=0.004, seed=4)
    bed = boxes((0, -0.06, 1.0), (6.6, 0.05, 7.0), "gap", bevel=0.001)
    return [planks, bed]


def drape(width: float, height: float, pleats: float, depth: float, seed: int) -> Part:
    """A hanging pleated cloth facing +Z, its foot at the origin; the pleats open and wander towards the floor."""
    x = np.linspace(-0.5, 0.5, int(pleats * 22))
    y = np.linspace(0.004, 1, 40)
    s, t = np.meshgrid(x, y, indexing="ij")
    wander = 0.35 * noise(np.stack([s * 7, t * 1.2, 0 * s], -1), seed, octaves=2)
    phase = 2 * np.pi * pleats * s + 1.6 * wander
    fold = (
        np.sin(phase)
        + 0.25 * np.sin(2 * phase + 0.7)
        + 0.5 * noise(np.stack([s * pleats * 0.7, t * 2, 0 * s + 3], -1), seed + 1, octaves=2)
    )
    amount = depth * (1.0 - 0.35 * t)
    p = np.stack([s * width + 0.4 * amount * np.cos(phase), t * height, amount * fold], axis=-1)
    return sheet(p, "linen")


def drapes() -> list[Part]:
    """The back drape and two side drapes, slightly turned in."""
    back = drape(6.4, 4.3, 21, 0.095, 11).moved(place(0, 0, BACK))
    left = drape(3.4, 4.3, 11, 0.10, 12).moved(place(-WING, 0, 0.1, 66))
    right = drape(3.4, 4.3, 11, 0.10, 13).moved(place(WING, 0, 0.1, -66))
    return [back, left, right]


def plinth() -> list[Part]:
    """A fluted marble drum with base and cap, 0.95 m high."""
    base = boxes((0, 0.05, 0), (0.78, 0.10, 0.78), "marble", bevel=0.012)
    torus = [(0.36, 0.10), (0.375, 0.125), (0.36, 0.155), (0.33, 0.165), (0.325, 0.18), (0.30, 0.20)]
    cap = [(0.30, 0.80), (0.325, 0.82), (0.33, 0.835), (0.36, 0.85), (0.365, 0.87)]
    drum = lathe([(0.295, h) for h in np.linspace(0.20, 0.80, 13)], "marble", 160, ribs=20)
    top = boxes((0, 0.91, 0), (0.80, 0.08, 0.80), "marble", bevel=0.014)
    return [base, lathe(torus, "marble", 64), drum, lathe(cap, "marble", 64), top]


def knot() -> list[Part]:
    """A (2, 3) torus knot standing on the plinth."""
    t = np.linspace(0, 2 * np.pi, 361)[:-1]
    ring = 2 + np.cos(3 * t)
    path = np.stack([ring * np.cos(2 * t), ring * np.sin(2 * t), -1.25 * np.sin(3 * t)], axis=1) * 0.150
    body = tube(path @ _turn_z(90).T, 0.083 + 0.012 * np.sin(5 * np.append(t, t[0])), "glaze", 28, closed=True)
    foot = lathe([(0.14, 0.95), (0.14, 0.965), (0.10, 0.985), (0.05, 1.0), (0.045, 1.06), (0.0, 1.07)], "brass", 48)
    return [body.moved(place(0, 1.48, 0, -24)), foot]


def _turn_z(degrees: float) -> F64:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])


def amphora() -> list[Part]:
    """A painted amphora with two handles and olive branches, standing at the origin."""
    outline = [
        (0.0, 0.0),
        (0.13, 0.0),
        (0.135, 0.02),
        (0.085, 0.06),
        (0.16, 0.20),
        (0.255, 0.42),
        (0.27, 0.54),
        (0.22, 0.66),
    ]
    outline += [(0.12, 0.74), (0.088, 0.80), (0.085, 0.90), (0.13, 0.965), (0.14, 0.98)]
    body = lathe(
        np.concatenate([[[0.0, 0.0]], spline(outline[1:], 90), [[0.12, 0.98], [0.075, 0.92], [0.07, 0.8]]]),
        "amphora",
        72,
    )
    parts = [body]
    for side in (-1, 1):
        arc = spline(
            [[side * 0.10, 0.90, 0], [side * 0.24, 0.93, 0], [side * 0.27, 0.80, 0], [side * 0.215, 0.655, 0]], 30
        )
        parts.append(tube(arc, 0.022, "leather 2", 12))
    rng = np.random.default_rng(8)
    for k in range(9):
        turn, lean = k * 2.39996, rng.uniform(0.12, 0.55)
        out = np.array([np.sin(turn), 0, np.cos(turn)])
        stem = spline([[0, 0.85, 0], out * lean * 0.35 + [0, 1.1, 0], out * lean + [0, rng.uniform(1.25, 1.6), 0]], 20)
        parts.append(tube(stem, np.linspace(0.009, 0.004, 20), "wood", 6, solid=False))
        at = stem[rng.integers(6, 20, 46)] + rng.normal(0, 0.006, (46, 3))
        away = out * 0.5 + rng.normal(0, 0.6, (46, 3)) + [0, 0.5, 0]
        parts.append(leaves(at, away, rng.uniform(0.07, 0.125, 46), "olive", rng, width=0.27))
        parts.append(blob(stem[-4], (0.06, 0.09, 0.06), "olive", 0.3, k, rings=10))
    return parts


def draped_block(size: float, height: float) -> list[Part]:
    """A marble block with a red cloth hanging over it."""
    n = 120
    s, t = np.meshgrid(np.linspace(-1, 1, n), np.linspace(-1, 1, n), indexing="ij")
    half, cloth = size / 2 + 0.012, size * 0.86
    c, k = np.cos(0.5), np.sin(0.5)
    x, z = (c * s - k * t) * cloth, (k * s + c * t) * cloth
    inside_x, inside_z = np.clip(x, -half, half), np.clip(z, -half, half)
    hang = np.hypot(x - inside_x, z - inside_z)
    angle = np.arctan2(z, x)
    away = np.stack([x - inside_x, z - inside_z], -1) / np.maximum(hang, 1e-6)[..., None]
    fold = 0.020 * np.sin(13 * angle + 2 * np.sin(3 * angle)) + 0.012 * np.sin(29 * angle)
    out = (np.minimum(hang, 0.03) + hang * (0.10 + 2.2 * fold)) * (hang > 0)
    crease = 0.004 * noise(np.stack([x * 6, z * 6, 0 * x], -1), 9, octaves=3)
    y = height + 0.012 + crease - np.maximum(hang - 0.02, 0) * 0.96
    p = np.stack([inside_x + away[..., 0] * out, np.maximum(y, 0.008), inside_z + away[..., 1] * out], axis=-1)
    block = boxes((0, height / 2, 0), (size, height, size), "marble", bevel=0.012, seed=2)
    return [block, sheet(p, "cloth", flip=True)]


def fruit(radius: float, material: str) -> list[Part]:
    """A pomegranate with its crown, or (lemon) a pointed fruit, standing at the origin."""
    a = np.linspace(-np.pi / 2, np.pi / 2, 25)
    if material == "lemon":
        profile = np.stack([radius * np.cos(a), radius * (1.25 * np.sin(a) + 0.12 * np.sin(a) ** 7 + 1.37)], axis=1)
        return [lathe(profile, material, 32).moved(place())]
    profile = np.stack([radius * np.cos(a) * (1 + 0.03 * np.cos(6 * a)), radius * (0.92 * np.sin(a) + 0.92)], axis=1)
    crown = [(0.16, 1.78), (0.14, 1.95), (0.24, 2.14), (0.20, 2.13), (0.08, 1.92)]
    return [lathe(profile, material, 40, ribs=0), lathe(np.array(crown) * radius, material, 12, ribs=6)]


def bowl() -> list[Part]:
    """A footed bowl of pomegranates and lemons, standing at the origin."""
    outside = [
        (0.0, 0.0),
        (0.09, 0.0),
        (0.095, 0.012),
        (0.06, 0.035),
        (0.07, 0.05),
        (0.17, 0.10),
        (0.225, 0.165),
        (0.23, 0.178),
    ]
    inside = [(0.22, 0.176), (0.165, 0.115), (0.06, 0.075), (0.0, 0.07)]
    parts = [lathe(outside + inside, "bowl", 56)]
    heap = [
        (-0.09, 0.11, 0.05, "fruit"),
        (0.085, 0.115, 0.06, "fruit"),
        (0.0, 0.11, -0.10, "lemon"),
        (0.0, 0.205, 0.02, "fruit"),
    ]
    rng = np.random.default_rng(6)
    for k, (x, y, z, material) in enumerate(heap):
        tip = _turn_z(float(rng.uniform(-35, 35)))
        for part in fruit(0.075 if material == "fruit" else 0.055, material):
            tilted = Part(
                vertices=part.vertices @ tip.T, faces=part.faces, uvs=part.uvs, material=material, solid=part.solid
            )
            parts.append(tilted.moved(place(x, y - 0.02, z, 80 * k)))
    return parts


def books() -> list[Part]:
    """Two books, the upper one askew, standing at the origin."""
    parts: list[Part] = []
    for k, (w, h, d, turn, material) in enumerate(
        ((0.30, 0.055, 0.22, 14, "leather"), (0.26, 0.045, 0.19, -12, "leather 2"))
    ):
        y = 0.055 * k
        covers = [[0, y + 0.004, 0], [0, y + h - 0.004, 0], [-w / 2 + 0.005, y + h / 2, 0]]
        size = [[w, 0.008, d], [w, 0.008, d], [0.010, h, d]]
        parts.append(boxes(covers, size, material, bevel=0.002, seed=k).moved(place(0, 0, 0, turn)))
        block = boxes((0.002, y + h / 2, 0), (w - 0.016, h - 0.016, d - 0.014), "pages", bevel=0.001, seed=k)
        parts.append(block.moved(place(0, 0, 0, turn)))
    return parts


def candlestick(height: float) -> list[Part]:
    """Turned brass with a candle, standing at the origin."""
    h = height
    outline = [
        (0.0, 0.0),
        (0.095, 0.0),
        (0.10, 0.012),
        (0.07, 0.035),
        (0.028, 0.06),
        (0.022, 0.12 * h),
        (0.036, 0.2 * h),
    ]
    outline += [
        (0.018, 0.30 * h),
        (0.016, 0.6 * h),
        (0.034, 0.72 * h),
        (0.020, 0.80 * h),
        (0.055, 0.96 * h),
        (0.056, 0.985 * h),
        (0.0, h),
    ]
    candle = [(0.021, h - 0.01), (0.020, h + 0.16), (0.014, h + 0.172), (0.0, h + 0.17)]
    curve = np.concatenate([outline[:2], spline(outline[2:-1], 80), outline[-1:]])
    return [lathe(curve, "brass", 48), lathe(candle, "wax", 28)]


def stage() -> list[Part]:
    """Everything in its place."""
    parts = boards() + drapes() + plinth() + knot()
    groups = [
        (amphora(), place(-1.18, 0, 0.12, 25)),
        (draped_block(0.62, 0.46), place(1.02, 0, 0.30, 12)),
        (bowl(), place(1.05, 0.475, 0.28, 0)),
        (books(), place(-0.60, 0, 0.72, 20)),
        (candlestick(0.52), place(0.50, 0, 0.80)),
        (candlestick(0.36), place(0.68, 0, 1.02)),
        (fruit(0.08, "fruit"), place(-0.20, 0, 0.82, 30)),
        (fruit(0.055, "lemon"), place(-0.59, 0.10, 0.72, 30)),
    ]
    for items, matrix in groups:
        parts += [p.moved(matrix) for p in items]
    return parts
