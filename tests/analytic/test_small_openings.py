"""Rooms into which little light comes: few samples of a place find any, and yet it was seen, and in its own light."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from mirelight.lighting import Tracer, captured_level, colored_by
from mirelight.lighting.splat_light import places_of
from mirelight.model import (
    F32,
    F64,
    Camera,
    Environment,
    Lighting,
    ProxyMesh,
    RenderSettings,
    SplatCloud,
    SplatLayer,
)

ALBEDO, HALF = 0.6, 0.15  # of all walls; half the side of the hole in the ceiling of a room that is 2 units wide
SETTINGS = RenderSettings(seed=1)
SKY = Lighting(name="day", environment=Environment(radiance=np.full((1, 1, 3), 20, np.float32)))
EYES = (((0.7, 0.0, 0.7), (-1, -0.2, -1)), ((-0.7, 0.1, 0.6), (1, 0.1, -0.5)), ((0, -0.5, 0), (0.1, 1, 0.1)))
CAMERAS = tuple(
    Camera.look_at(eye, np.add(eye, way), 60, 40, yfov=80, name=f"{k}") for k, (eye, way) in enumerate(EYES)
)


def wall(corner: F64, along: F64, across: F64, parts: int) -> F64:
    """(F, 3, 3) triangles of a parallelogram in so many steps, which face along x across."""
    line = np.linspace(0, 1, parts + 1)
    s, t = (x[..., None] for x in np.meshgrid(line, line, indexing="ij"))
    at = corner + s * along + t * across
    a, b, c, d = at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]
    return np.concatenate([np.stack([a, b, c], axis=2), np.stack([a, c, d], axis=2)]).reshape(-1, 3, 3)


@cache
def room() -> ProxyMesh:
    """Single sheets that face inwards, a hole in the middle of the ceiling; their backs lie in the open sky."""
    sides = []
    for axis in range(3):
        for way in (-1.0, 1.0):
            inward, along = np.zeros(3), np.roll(np.eye(3)[axis], 1)
            inward[axis] = -way
            across = np.cross(inward, along)
            sides.append(wall(-inward - along - across, 2 * along, 2 * across, 40))
    corners = np.concatenate(sides)
    middle = corners.mean(axis=1)
    hole = (middle[:, 1] > 0.99) & (np.abs(middle[:, 0]) < HALF) & (np.abs(middle[:, 2]) < HALF)
    vertices, faces = np.unique(corners[~hole].reshape(-1, 3).round(6), axis=0, return_inverse=True)
    return ProxyMesh(
        vertices=vertices.astype(np.float32),
        faces=faces.reshape(-1, 3).astype(np.int32),
        albedo=np.full(3, ALBEDO),
    )


@cache
def pictures() -> tuple[SplatLayer, ...]:
    """What cameras in the room see, nearly without noise."""
    settings = RenderSettings(seed=7, spp=1024, max_depth=12)
    tracer = Tracer(room(), settings, layers=False)
    out = []
    for camera in CAMERAS:
        frame = tracer.trace(SKY, camera)
        color: F32 = frame.beauty[..., :3]
        assert frame.depth is not None and frame.coverage is not None
        out.append(
            SplatLayer(
                camera=camera,
                color=color,
                transmittance=1 - frame.coverage,
                depth=frame.depth,
                median_depth=frame.depth,
                linear=True,
            )
        )
    return tuple(out)


def nothing() -> SplatCloud:
    """Pictures stand for the splats."""
    one, quats = np.zeros((1, 3), np.float32), np.array([[1, 0, 0, 0]], np.float32)
    return SplatCloud(means=one, quats=quats, scales=one + 0.1, opacities=one[:, 0] + 0.5, sh=one[:, None])


def test_walls_have_their_colours() -> None:
    found = colored_by(nothing(), room(), SKY, SETTINGS, pictures())
    assert found.vertex_colors is not None
    assert float(found.vertex_colors.mean()) == pytest.approx(ALBEDO, rel=0.1)


def test_the_level_is_that_of_the_inside() -> None:
    """Not that of the walls' backs, which the open sky lights a hundred times as brightly."""
    seen = np.concatenate([x.color[..., 1][x.transmittance < 0.5] for x in pictures()]) / ALBEDO
    level = captured_level(nothing(), room(), SKY, SETTINGS, pictures())
    assert 0.5 * float(seen.mean()) < level < 2 * float(seen.mean())


def test_splats_take_the_light_inside() -> None:
    """On walls' faces, as a capture from inside has them: hardly any is taken
    for one on the back."""
    chance = np.random.default_rng(3)
    corners = room().vertices[room().faces[chance.choice(len(room().faces), 3000)]].astype(np.float64)
    points = corners.mean(axis=1).astype(np.float32)
    many = np.ones(len(points), np.float32)
    quats = np.tile(np.array([1, 0, 0, 0], np.float32), (len(points), 1))
    sizes = np.full((len(points), 3), 0.01, np.float32)
    splats = SplatCloud(
        means=points, quats=quats, scales=sizes, opacities=many, sh=np.zeros((len(points), 1, 3), np.float32)
    )
    found = places_of(splats, room(), Tracer(room(), SETTINGS, layers=False, aovs=False), SKY)
    assert ((found.normals * found.points).sum(axis=1) < 0).mean() > 0.97
