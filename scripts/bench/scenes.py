"""The scenes of the parts on light: procedural, lit by what Blender and Mitsuba have too."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench.common import Array
from mirelight.model import (
    Camera,
    Environment,
    Light,
    Lighting,
    PointLight,
    ProxyMesh,
    SpotLight,
    SunLight,
    triangles,
)

BOUNCES = 8


@dataclass(frozen=True, slots=True)
class BenchScene:
    """What is rendered."""

    name: str
    proxy: ProxyMesh
    lighting: Lighting
    camera: Camera


def box(low: list[float], high: list[float]) -> tuple[Array, Array]:
    """Vertices (8, 3) and faces (12, 3) of an axis-aligned box."""
    a, b = np.array(low, float), np.array(high, float)
    v = np.array([[(a, b)[i][0], (a, b)[j][1], (a, b)[k][2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return v, np.array([t for q in quads for t in ((q[0], q[1], q[2]), (q[0], q[2], q[3]))])


def ground(size: float, cells: int, bump: float) -> tuple[Array, Array]:
    """A gently uneven square of 2 cells² triangles."""
    t = np.linspace(-size, size, cells + 1)
    x, z = np.meshgrid(t, t)
    y = bump * (np.sin(3.1 * x) * np.cos(2.3 * z) + 0.5 * np.sin(9.7 * x + 1) * np.sin(8.3 * z))
    i = np.arange((cells + 1) ** 2).reshape(cells + 1, cells + 1)
    a, b, c, d = (q.ravel() for q in (i[:-1, :-1], i[:-1, 1:], i[1:, :-1], i[1:, 1:]))
    return np.stack([x, y, z], -1).reshape(-1, 3), np.concatenate([np.stack([a, c, b], 1), np.stack([b, c, d], 1)])


def ball(centre: list[float], radius: float, rings: int) -> tuple[Array, Array]:
    """A sphere of facets."""
    t, f = np.meshgrid(np.linspace(0, np.pi, rings + 1), np.arange(2 * rings) * np.pi / rings, indexing="ij")
    v = np.stack([np.sin(t) * np.cos(f), np.cos(t), np.sin(t) * np.sin(f)], -1).reshape(-1, 3)
    n = 2 * rings
    i, j = (q.ravel() for q in np.meshgrid(np.arange(rings), np.arange(n), indexing="ij"))
    a, b = i * n + j, i * n + (j + 1) % n
    faces = np.concatenate([np.stack([a, b, a + n], 1), np.stack([b, b + n, a + n], 1)])
    return v * radius + np.array(centre), faces[triangles.areas(v[faces]) > 1e-9]


def merged(parts: list[tuple[Array, Array]]) -> ProxyMesh:
    """One proxy of many pieces."""
    starts = np.cumsum([0] + [len(v) for v, _ in parts[:-1]])
    return ProxyMesh(
        vertices=np.concatenate([v for v, _ in parts]).astype(np.float32),
        faces=np.concatenate([f + s for (_, f), s in zip(parts, starts, strict=True)]).astype(np.int32),
    )


def sky(sun: float) -> Environment:
    """A bright horizon, a blue zenith, dark ground and a glow round the sun, 512 x 1024."""
    v, u = np.meshgrid((np.arange(512) + 0.5) / 512, (np.arange(1024) + 0.5) / 1024, indexing="ij")
    theta, phi = np.pi * v, 2 * np.pi * (u - 0.5)
    way = np.stack([np.cos(phi) * np.sin(theta), np.cos(theta), np.sin(phi) * np.sin(theta)], -1)
    up = way[..., 1:2]
    color = np.where(up > 0, np.array([0.5, 0.7, 1.0]) * (0.4 + 0.8 * np.exp(-4 * np.maximum(up, 0))), 0.08)
    toward = np.array([0.55, 0.65, 0.52])
    glow = sun * np.exp(400 * (way @ (toward / np.linalg.norm(toward)) - 1))
    return Environment(radiance=(color + glow[..., None] * np.array([1.0, 0.9, 0.7])).astype(np.float32))


def courtyard_mesh(cells: int) -> ProxyMesh:
    """Walls round a square, columns, balls."""
    parts = [ground(6, cells, 0.03)]
    parts += [box([-6, 0, -6.3], [6, 4, -6]), box([-6.3, 0, -6], [-6, 4, 6]), box([6, 0, -6], [6.3, 3, 6])]
    parts += [box([x - 0.25, 0, z - 0.25], [x + 0.25, 3, z + 0.25]) for x in (-4, -1.5, 1.5, 4) for z in (-4, 0)]
    parts += [box([-4.6, 3, -4.6], [4.6, 3.3, -3.4])]
    parts += [ball([x, 0.6, z], 0.6, 48) for x, z in ((-2.5, 2), (0.5, 1.5), (2.8, 2.6))]
    return merged(parts)


def scenes(width: int, height: int, cells: int) -> list[BenchScene]:
    """Courtyard by day, interior through windows, courtyard by night."""
    yard = courtyard_mesh(cells)
    view = Camera.look_at([4.5, 3.2, 7.5], [-0.6, 0.9, 0], width, height, yfov=50, name="yard")
    towards = np.array([-0.55, -0.65, -0.52])
    lamp = PointLight(name="lamp", position=np.array([-2.5, 2.4, 0.8]), color=np.array([1.0, 0.7, 0.4]), intensity=6.0)
    spot = SpotLight(
        name="spot",
        position=np.array([3.0, 3.5, 3.0]),
        direction=np.array([-0.4, -1.0, -0.3]),
        intensity=25.0,
        inner_cone_angle=0.49,
        outer_cone_angle=0.5,
    )
    day: tuple[Light, ...] = (SunLight(name="sun", direction=towards, intensity=4.0), lamp, spot)
    rng = np.random.default_rng(5)
    spots = [[x, 1.9 + 0.5 * rng.random(), z] for x in (-5, -2.8, 0.2, 2.8) for z in (-2.0, 1.0, 4.0)]
    lamps = tuple(
        PointLight(name=f"lamp {k}", position=np.array(p), color=0.4 + 0.6 * rng.random(3), intensity=2.0)
        for k, p in enumerate(spots)
    )
    room = merged(
        [
            ground(4, cells, 0.0),
            box([-4, 3, -4], [4, 3.2, 4]),
            box([-4.2, 0, -4], [-4, 3, 4]),
            box([-4, 0, -4.2], [4, 3, -4]),
            box([-4, 0, 4], [4, 3, 4.2]),
            *(box([4, a, c], [4.2, b, d]) for a, b, c, d in ((0, 1, -4, 4), (2.4, 3, -4, 4))),
            *(box([4, 1, c], [4.2, 2.4, d]) for c, d in ((-4, -3), (-1.6, -0.4), (1.0, 1.6), (3, 4))),
            box([-1.5, 0, -1.5], [0.5, 0.8, -0.5]),
            *(ball([x, 0.5, z], 0.5, 32) for x, z in ((-2.5, 1.5), (1.5, 0.8))),
        ]
    )
    inside = Camera.look_at([-3.4, 1.7, 3.4], [0.8, 0.8, -0.6], width, height, yfov=60, name="room")
    through = SunLight(name="sun", direction=np.array([-0.75, -0.5, -0.25]), intensity=6.0)
    return [
        BenchScene("courtyard", yard, Lighting(lights=day, environment=sky(30.0)), view),
        BenchScene("interior", room, Lighting(lights=(through,), environment=sky(5.0)), inside),
        BenchScene("night", yard, Lighting(lights=lamps), view),
    ]


def crowd(yard: BenchScene, count: int, reach: float) -> BenchScene:
    """The courtyard under many small lamps that light up to `reach`, together about as bright whatever their number."""
    rng = np.random.default_rng(count)
    places = rng.uniform([-5.8, 0.4, -5.8], [5.8, 2.9, 5.8], (count, 3))
    colors = 0.4 + 0.6 * rng.random((count, 3))
    lamps = tuple(
        PointLight(name=f"lamp {k}", position=p, color=c, intensity=40.0 / count, range=reach)
        for k, (p, c) in enumerate(zip(places, colors, strict=True))
    )
    name = f"{count} lamps" + (", endless" if np.isinf(reach) else "")
    return BenchScene(name, yard.proxy, Lighting(lights=lamps), yard.camera)


def crowds(yard: BenchScene) -> list[BenchScene]:
    """A hundred and a thousand lamps, each point in reach of one to two dozen; and a hundred that reach everywhere."""
    return [crowd(yard, 100, 3.0), crowd(yard, 1000, 1.5), crowd(yard, 100, np.inf)]


def panorama(seed: int) -> Environment:
    """A noisy map of 2048 x 1024."""
    return Environment(radiance=np.random.default_rng(seed).random((1024, 2048, 3), dtype=np.float32) ** 8)
