"""Pots, clipped box, agaves, an olive tree and the bougainvillea of the courtyard."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from scenegen.courtyard_geometry import ARCADE, GALLERY, LEFT, RIGHT
from scenegen.geometry import F64, Part, blob, lathe, leaves, place, sheet, spline, tube


def pot(radius: float, height: float, material: str) -> list[Part]:
    """A rimmed pot with soil, standing at the origin."""
    r, h = radius, height
    profile = [
        (0.0, 0.0),
        (0.62 * r, 0.0),
        (0.68 * r, 0.03 * h),
        (0.86 * r, 0.45 * h),
        (0.96 * r, 0.80 * h),
        (0.97 * r, 0.84 * h),
    ]
    profile += [(1.06 * r, 0.85 * h), (1.08 * r, 0.97 * h), (1.05 * r, h), (0.93 * r, h), (0.91 * r, 0.90 * h)]
    return [
        lathe(profile, material, 40),
        lathe([(0.92 * r, 0.92 * h), (0.4 * r, 0.94 * h), (0.0, 0.94 * h)], "soil", 24),
    ]


def jar(radius: float, height: float, material: str) -> list[Part]:
    """A tall oil jar, standing at the origin."""
    profile = np.array(
        [(0.42, 0.0), (0.5, 0.02), (0.85, 0.35), (1.0, 0.60), (0.92, 0.80), (0.62, 0.93), (0.56, 0.95), (0.66, 1.0)]
    )
    curve = spline(profile, 40)
    inside = np.array([(0.58, 1.0), (0.5, 0.95), (0.5, 0.8)])
    return [lathe(np.concatenate([[[0, 0]], curve, inside]) * [radius, height], material, 48)]


def _on_sphere(count: int, rng: np.random.Generator) -> F64:
    d = rng.normal(size=(count, 3))
    return np.asarray(d / np.linalg.norm(d, axis=1, keepdims=True))


def clipped(centre: ArrayLike, radius: float, seed: int, material: str = "leaf") -> list[Part]:
    """A ball of box hedge: a rough core with leaves all over."""
    rng = np.random.default_rng(seed)
    d = _on_sphere(int(5200 * radius / 0.35 * radius / 0.35 * 0.45), rng)
    at = np.asarray(centre) + d * radius * rng.uniform(0.93, 1.03, (len(d), 1))
    foliage = leaves(at, d + rng.normal(0, 0.7, d.shape), rng.uniform(0.03, 0.055, len(d)), material, rng, width=0.65)
    return [blob(centre, (radius * 0.97,) * 3, "bush", 0.06, seed, rings=30), foliage]


def agave(seed: int, size: float) -> list[Part]:
    """A rosette of thick pointed leaves at the origin."""
    rng = np.random.default_rng(seed)
    parts = []
    for k in range(26):
        turn, lift = k * 2.39996, 1.35 - 1.05 * k / 26
        out = np.array([np.sin(turn), 0, np.cos(turn)])
        reach = size * (0.75 + 0.3 * k / 26) * rng.uniform(0.9, 1.1)
        tip = out * np.cos(lift) + np.array([0, np.sin(lift), 0])
        path = spline([np.zeros(3), tip * reach * 0.5, tip * reach + [0, -0.12 * reach * (k / 26), 0]], 10)
        t = np.linspace(0, 1, 10)
        wide = size * 0.17 * np.sin(np.pi * (0.18 + 0.82 * t)) ** 0.8
        side = np.cross(out, [0, 1.0, 0])
        cross = np.array([[-1, 0.16], [0, -0.10], [1, 0.16], [0, 0.18]])
        up = np.cross(side, tip)
        ring = cross[[0, 1, 2, 3, 0], :1] * side + cross[[0, 1, 2, 3, 0], 1:] * up
        rows = path[:, None] + ring[None] * wide[:, None, None]
        part = sheet(rows, "olive", flip=True)
        parts.append(
            Part(
                vertices=part.vertices,
                faces=part.faces,
                uvs=np.full((len(part.vertices), 2), rng.random()),
                material="olive",
            )
        )
    return parts


def olive_tree(seed: int) -> list[Part]:
    """A small olive tree, foot at the origin."""
    rng = np.random.default_rng(seed)
    trunk = spline([[0, 0, 0], [0.05, 0.5, 0.03], [-0.05, 0.95, -0.02], [0.03, 1.35, 0.04]], 24)
    parts = [tube(trunk, np.linspace(0.075, 0.045, 24), "wood", 12)]
    for _ in range(9):
        turn, reach = rng.uniform(0, 2 * np.pi), rng.uniform(0.3, 0.55)
        foot = trunk[rng.integers(15, 24)]
        tip = foot + np.array([np.sin(turn) * reach, rng.uniform(0.15, 0.75), np.cos(turn) * reach])
        branch = spline([foot, (foot + tip) / 2 + [0, 0.08, 0], tip], 12)
        parts.append(tube(branch, np.linspace(0.03, 0.012, 12), "wood", 8))
        parts.append(blob(tip, (0.22, 0.17, 0.22), "bush", 0.35, int(rng.integers(1000)), rings=16))
        d = _on_sphere(420, rng)
        at = tip + d * [0.29, 0.23, 0.29] * rng.uniform(0.75, 1.1, (420, 1))
        parts.append(leaves(at, d + rng.normal(0, 0.7, d.shape), rng.uniform(0.06, 0.11, 420), "olive", rng, width=0.3))
    return parts


def bougainvillea(seed: int) -> list[Part]:
    """A climber on the right wall in the corner by the arcade: stems, foliage clumps, magenta bracts."""
    rng = np.random.default_rng(seed)
    parts = []
    foot = np.array([RIGHT - 0.16, 0.0, ARCADE + 0.55])
    for _ in range(5):
        top = np.array([RIGHT - 0.12, rng.uniform(2.6, 3.8), ARCADE + rng.uniform(0.3, 2.3)])
        stem = spline(
            [
                foot,
                foot + np.array([0, 0.9, rng.uniform(-0.1, 0.2)]),
                (foot + top) / 2 + [0, 0.5, rng.normal(0, 0.15)],
                top,
            ],
            30,
        )
        parts.append(tube(stem, np.linspace(0.03, 0.012, 30), "wood", 8))
    for _ in range(34):
        z = ARCADE + 0.1 + 2.3 * rng.beta(1.2, 1.6)
        y = 2.35 + 0.55 * np.cos((z - ARCADE - 0.9) * 1.3) + rng.uniform(-0.75, 1.15)
        centre = np.array([RIGHT - rng.uniform(0.08, 0.16), y, z])
        size = np.array([0.15, 0.21, 0.23]) * rng.uniform(0.8, 1.25)
        parts.append(blob(centre, size, "bush", 0.35, int(rng.integers(1000)), rings=14))
        for material, count, length in (("leaf", 110, 0.085), ("bract", 290, 0.065)):
            d = _on_sphere(count, rng)
            d[:, 0] = -np.abs(d[:, 0])
            at = centre + d * size * rng.uniform(0.95, 1.35, (count, 1))
            parts.append(
                leaves(
                    at,
                    d + rng.normal(0, 0.6, d.shape),
                    rng.uniform(0.7, 1.2, count) * length,
                    material,
                    rng,
                    width=0.75,
                )
            )
    return parts


def planting() -> list[Part]:
    """All pots and plants in their places."""
    parts: list[Part] = bougainvillea(7)
    placed = [
        (pot(0.34, 0.56, "pot"), (2.05, 0, -1.75), clipped((0, 0.86, 0), 0.40, 11)),
        (pot(0.27, 0.44, "pot"), (-2.45, 0, -1.75), clipped((0, 0.68, 0), 0.31, 12)),
        (pot(0.22, 0.32, "glazed"), (2.72, 0, -1.45), agave(13, 0.42)),
        (pot(0.38, 0.52, "pot"), (3.50, 0, 2.0), olive_tree(14)),
        (pot(0.20, 0.30, "pot"), (-2.55, 0, 2.85), agave(15, 0.40)),
        (pot(0.16, 0.26, "glazed"), (-2.35, 0, -1.1), clipped((0, 0.40, 0), 0.17, 16)),
    ]
    for container, (x, y, z), plant in placed:
        at = place(x, y, z, 30 * x)
        lift = place(
            0, max(p.vertices[:, 1].max() for p in container) * 0.93 if plant[0].vertices[:, 1].min() < 0.05 else 0
        )
        parts += [p.moved(at) for p in container] + [p.moved(lift).moved(at) for p in plant]
    parts += [p.moved(place(-2.52, 0, 0.6)) for p in jar(0.30, 0.86, "pot")]
    parts += [p.moved(place(-2.35, 0, 1.28)) for p in jar(0.22, 0.58, "glazed")]
    parts += [p.moved(place(1.45, 0, GALLERY + 0.45)) for p in jar(0.28, 0.8, "pot")]
    parts += [p.moved(place(LEFT + 0.3, 2.4, -2.4)) for p in pot(0.2, 0.34, "pot") + clipped((0, 0.5, 0), 0.22, 18)]
    return parts
