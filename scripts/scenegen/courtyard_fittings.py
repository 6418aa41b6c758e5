"""Stairs, well, wall fountain and lanterns of the courtyard."""

from __future__ import annotations

import numpy as np

from scenegen.courtyard_geometry import ARCADE, FOUNTAIN, GALLERY, LANTERNS, LEFT, RIGHT, STAIRS
from scenegen.geometry import Part, boxes, lathe, place, spline, tube


def stairs() -> list[Part]:
    """Twelve steps with painted risers along the left wall, up to a landing; an iron handrail."""
    count, rise, run, start = 12, 0.2, 0.34, 2.55
    wide = STAIRS - LEFT
    x = (STAIRS + LEFT) / 2
    k = np.arange(count)
    tread = np.stack([np.full(count, x), rise * (k + 1) - 0.025, start - run * (k + 0.5) + 0.012], axis=1)
    parts = [boxes(tread, (wide + 0.04, 0.05, run + 0.04), "tread", bevel=0.012, seed=100)]
    riser = np.stack([np.full(count, x), rise * (k + 0.5) - 0.02, start - run * k - 0.008], axis=1)
    parts.append(boxes(riser, (wide, rise - 0.04, 0.02), "tiles", bevel=0.002))
    body = np.stack([np.full(count, x), rise * (k + 1) / 2 - 0.03, start - run * (k + 0.5)], axis=1)
    sizes = np.stack([np.full(count, wide - 0.02), rise * (k + 1) - 0.05, np.full(count, run)], axis=1)
    parts.append(boxes(body, sizes, "whitewash", bevel=0.0005, seed=None))
    end = start - run * count
    landing = [[x, rise * count / 2 - 0.03, (end + GALLERY) / 2], [x, rise * count - 0.03, (end + GALLERY) / 2]]
    parts.append(boxes(landing[0], (wide - 0.02, rise * count - 0.06, end - GALLERY), "whitewash", bevel=0.002))
    parts.append(boxes(landing[1], (wide + 0.06, 0.06, end - GALLERY + 0.04), "tread", bevel=0.012))
    rail_x = STAIRS - 0.06
    top = spline(
        [
            [rail_x, 0.95, start + 0.12],
            [rail_x, 1.12, start - 0.2],
            [rail_x, 3.25, end + 0.1],
            [rail_x, 3.32, end - 0.4],
        ],
        40,
    )
    parts.append(tube(top, 0.022, "iron", 10))
    steps = np.stack([np.full(count, rail_x), rise * (k + 1), start - run * (k + 0.5)], axis=1)
    for foot in steps:
        height = float(np.interp(-foot[2], -top[:, 2], top[:, 1]))
        parts.append(tube([foot, [foot[0], height, foot[2]]], 0.012, "iron", 8))
    return parts


def well() -> list[Part]:
    """An octagonal stone well on a step, water inside, and an iron hoop with a pulley and a bucket."""
    at = place(0.35, 0, 1.15, 22.5)
    step = lathe([(1.16, 0.0), (1.16, 0.11), (1.13, 0.14), (0.70, 0.14)], "tread", 8)
    wall_outer = [(0.80, 0.14), (0.80, 0.18), (0.76, 0.22), (0.74, 0.26), (0.74, 0.74), (0.77, 0.78), (0.84, 0.82)]
    rim = [(0.86, 0.83), (0.86, 0.93), (0.84, 0.95), (0.58, 0.95), (0.56, 0.93), (0.56, 0.1)]
    drum = lathe(wall_outer + rim, "stone", 8)
    water = lathe([(0.57, 0.66), (0.3, 0.66), (0.001, 0.66)], "water", 24)
    angle = np.linspace(0, np.pi, 33)
    hoop = np.stack([0.70 * np.cos(angle), 0.95 + 1.25 * np.sin(angle) ** 0.8, 0 * angle], axis=1)
    pulley = lathe([(0.02, -0.04), (0.10, -0.035), (0.075, 0.0), (0.10, 0.035), (0.02, 0.04)], "wood", 24)
    upright = np.array([[1, 0, 0, 0], [0, 0, -1, 2.06], [0, 1, 0, 0], [0, 0, 0, 1.0]])
    rope = tube([[0.09, 2.06, 0], [0.09, 1.45, 0.01], [0.085, 1.30, 0.0]], 0.012, "brass", 8)
    bucket = lathe(
        [(0.0, 0.0), (0.12, 0.0), (0.15, 0.24), (0.16, 0.25), (0.145, 0.25), (0.12, 0.03), (0.0, 0.03)], "wood", 24
    )
    band = lathe([(0.147, 0.18), (0.152, 0.18), (0.156, 0.21), (0.15, 0.21)], "iron", 24)
    parts = [step, drum, water, tube(hoop, 0.022, "iron", 10), pulley.moved(upright), rope]
    hook = place(0.085, 1.0, 0)
    parts += [bucket.moved(hook), band.moved(hook)]
    angle = np.linspace(0, np.pi, 17)
    handle = np.stack([0.085 + 0.155 * np.cos(angle), 1.24 + 0.07 * np.sin(angle), 0 * angle], axis=1)
    parts.append(tube(handle, 0.008, "iron", 6))
    return [p.moved(at) for p in parts]


def wall_fountain() -> list[Part]:
    """A painted tile panel in a stone frame on the right wall, with a spout and a half-round basin."""
    z, x = FOUNTAIN, RIGHT
    panel = boxes((x - 0.02, 1.42, z), (0.05, 1.6, 1.6), "tiles", bevel=0.003)
    frame = [[x - 0.03, 2.28, z], [x - 0.03, 1.4, z - 0.87], [x - 0.03, 1.4, z + 0.87]]
    stones = boxes(frame, [[0.13, 0.14, 1.9], [0.12, 1.64, 0.13], [0.12, 1.64, 0.13]], "stone", bevel=0.02, seed=110)
    profile = [
        (0.20, 0.0),
        (0.24, 0.05),
        (0.20, 0.12),
        (0.30, 0.28),
        (0.62, 0.48),
        (0.70, 0.54),
        (0.72, 0.60),
        (0.70, 0.63),
    ]
    profile += [(0.62, 0.63), (0.58, 0.60), (0.50, 0.50), (0.0, 0.47)]
    basin = lathe(profile, "stone", 48, turns=0.5).moved(place(x - 0.02, 0, z, 180))
    water = lathe([(0.62, 0.585), (0.3, 0.585), (0.001, 0.585)], "water", 32, turns=0.5).moved(
        place(x - 0.03, 0, z, 180)
    )
    spout = tube(spline([[x, 1.22, z], [x - 0.14, 1.24, z], [x - 0.22, 1.16, z]], 16), 0.028, "brass", 12)
    rose = boxes((x - 0.06, 1.22, z), (0.05, 0.2, 0.2), "stone", bevel=0.04)
    return [panel, stones, basin, water, spout, rose]


def lanterns() -> list[Part]:
    """Iron lanterns on brackets: an open cage around each lamp of `LANTERNS`."""
    parts: list[Part] = []
    for x, y, z in LANTERNS:
        cap = lathe([(0.12, 0.135), (0.125, 0.14), (0.05, 0.21), (0.03, 0.22), (0.03, 0.23), (0.0, 0.24)], "iron", 6)
        ring = np.linspace(0, 2 * np.pi, 13)[:-1]
        foot = tube(
            np.stack([0.08 * np.sin(ring), 0 * ring - 0.14, 0.08 * np.cos(ring)], axis=1),
            0.012,
            "brass",
            8,
            closed=True,
            solid=False,
        )
        neck = tube(
            np.stack([0.112 * np.sin(ring), 0 * ring + 0.13, 0.112 * np.cos(ring)], axis=1),
            0.012,
            "brass",
            8,
            closed=True,
            solid=False,
        )
        turn = np.arange(6) / 6 * 2 * np.pi
        posts = [
            tube(
                [[0.08 * np.sin(a), -0.14, 0.08 * np.cos(a)], [0.112 * np.sin(a), 0.13, 0.112 * np.cos(a)]],
                0.006,
                "iron",
                6,
                solid=False,
            )
            for a in turn
        ]
        wall_x, wall_z = (x, ARCADE) if z < -2 else (np.sign(x) * RIGHT, z)
        towards = np.array([wall_x - x, 0, wall_z - z])
        arm = spline(
            [
                [0, 0.24, 0],
                towards * 0.1 + [0, 0.36, 0],
                towards * 0.6 + [0, 0.40, 0],
                towards + np.array([0, 0.26, 0]),
            ],
            24,
        )
        plate = boxes(towards * 0.97 + [0, 0.22, 0], np.abs(towards) * 0.08 + [0.09, 0.26, 0.09], "iron", bevel=0.01)
        parts += [p.moved(place(x, y, z)) for p in (cap, foot, neck, *posts, tube(arm, 0.014, "iron", 8), plate)]
    return parts
