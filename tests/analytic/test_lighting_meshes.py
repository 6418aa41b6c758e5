"""Meshes as captures have them: doubled, torn, turned, touching themselves. No light leaks and nothing goes black."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mirelight.base import conventions
from mirelight.lighting import Tracer
from mirelight.lighting.sight import Sight
from mirelight.model import (
    Camera,
    DirectionalLight,
    Lighting,
    Material,
    PointLight,
    ProxyMesh,
    RenderSettings,
    SunLight,
)

from .lighting_scenes import Array, constant_sky, join, quad, render, seeds, sphere

GRAY = 0.5 / np.pi
VIEW = Camera.look_at([0, 3, 0.5], [0, 0, 0], 48, 48)


def grid(cells: int, half: float = 2.0) -> ProxyMesh:
    """A floor of cells x cells squares."""
    x, z = np.meshgrid(np.linspace(-half, half, cells + 1), np.linspace(-half, half, cells + 1))
    vertices = np.stack([x, np.zeros_like(x), z], axis=-1).reshape(-1, 3)
    a = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).ravel()
    faces = np.concatenate([np.stack([a, a + cells + 1, a + 1], 1), np.stack([a + 1, a + cells + 1, a + cells + 2], 1)])
    return ProxyMesh(vertices=vertices.astype(np.float32), faces=faces.astype(np.int32))


FLOOR = grid(8)
TURNED = np.random.default_rng(2).random(len(FLOOR.faces)) < 0.5


def turned_here_and_there() -> ProxyMesh:
    faces = FLOOR.faces.copy()
    faces[TURNED] = faces[TURNED][:, ::-1]
    return replace(FLOOR, faces=faces)


def doubled() -> ProxyMesh:
    """Every face twice in the same place, the second one turned."""
    return replace(FLOOR, faces=np.concatenate([FLOOR.faces, FLOOR.faces[:, ::-1]]))


def with_degenerate_faces() -> ProxyMesh:
    """Points and lines among the triangles, and vertices that no face uses."""
    points, lines = (
        np.repeat(np.arange(40), 3).reshape(-1, 3),
        np.stack([np.arange(40), np.arange(40), np.arange(1, 41)]),
    )
    extra = np.concatenate([points, lines.T]).astype(np.int32)
    unused = np.full((5, 3), 1e6, np.float32)
    vertices = np.concatenate([FLOOR.vertices, unused])
    return ProxyMesh(vertices=vertices, faces=np.concatenate([extra, FLOOR.faces]))


def unwelded() -> ProxyMesh:
    """No two faces share a vertex."""
    faces = np.arange(3 * len(FLOOR.faces), dtype=np.int32).reshape(-1, 3)
    return ProxyMesh(vertices=FLOOR.vertices[FLOOR.faces].reshape(-1, 3), faces=faces)


def fins_below() -> ProxyMesh:
    """Three and more faces at an edge: walls that hang from the floor's edges, out of sight."""
    hanging = FLOOR.vertices + np.array([0, -1, 0], np.float32)
    start = len(FLOOR.vertices)
    a, b = FLOOR.faces[:, 0], FLOOR.faces[:, 1]
    fins = np.stack([a, b, b + start], axis=1)
    faces = np.concatenate([FLOOR.faces, fins, fins[::3]])
    return ProxyMesh(vertices=np.concatenate([FLOOR.vertices, hanging]), faces=faces.astype(np.int32))


MESHES = {
    "turned here and there": turned_here_and_there(),
    "doubled": doubled(),
    "degenerate faces": with_degenerate_faces(),
    "unwelded": unwelded(),
    "fins": fins_below(),
    "touching sheets": join(FLOOR, replace(FLOOR, vertices=FLOOR.vertices - np.array([0, 1e-7, 0], np.float32))),
}


@pytest.mark.parametrize("name", MESHES)
def test_a_floor_of_bad_topology_is_lit_like_a_good_one(name: str) -> None:
    """Everywhere, with grazing light too: no acne, no holes, no face dark because it is turned or doubled."""
    lights = (
        DirectionalLight(name="grazing", direction=np.array([1.0, -0.02, 0.3]), intensity=10.0),
        PointLight(name="low", position=np.array([0.3, 0.05, 0.2]), intensity=0.1),
        SunLight(name="sun", direction=np.array([0.2, -1, 0.1]), intensity=1.0),
    )
    settings = RenderSettings(spp=64, max_depth=3)
    lighting = Lighting(lights=lights, environment=constant_sky(1.0))
    good = Tracer(FLOOR, settings).trace(lighting, VIEW)
    bad = Tracer(MESHES[name], settings).trace(lighting, VIEW)
    assert bad.coverage.min() == 1
    for a, b in zip(good.layers, bad.layers, strict=True):
        np.testing.assert_allclose(b.direct, a.direct, rtol=0.02, atol=0.002 * a.direct.max(), err_msg=a.name)
        assert b.total.mean() == pytest.approx(a.total.mean(), rel=1e-3)


@pytest.mark.parametrize("smooth", [False, True])
def test_a_closed_body_turned_inside_out_looks_the_same(smooth: bool) -> None:
    ball = sphere(smooth=smooth, rings=24)
    inside_out = replace(ball, faces=np.ascontiguousarray(ball.faces[:, ::-1]))
    if smooth and ball.normals is not None:
        inside_out = replace(inside_out, normals=-ball.normals)
    lamp = PointLight(name="lamp", position=np.array([1.5, 1.5, 1.5]), intensity=5.0)
    camera = Camera.look_at([0, 0, 4], [0, 0, 0], 48, 48)
    a, b = (render(p, camera, lamp, environment=constant_sky(0.3), spp=64) for p in (ball, inside_out))
    np.testing.assert_allclose(a.beauty, b.beauty, atol=0.02 * float(a.beauty.max()))
    assert a.beauty.mean() == pytest.approx(b.beauty.mean(), rel=1e-3)


def test_light_does_not_leak_where_walls_only_meet() -> None:
    """A room of separate walls whose edges coincide but share no vertex: black inside."""
    box = join(
        quad([0, 0, 0], [1, 0, 0], [0, 0, 1]),
        quad([0, 2, 0], [1, 0, 0], [0, 0, 1]),
        quad([-1, 1, 0], [0, 1, 0], [0, 0, 1]),
        quad([1, 1, 0], [0, 1, 0], [0, 0, 1]),
        quad([0, 1, -1], [1, 0, 0], [0, 1, 0]),
        quad([0, 1, 1], [1, 0, 0], [0, 1, 0]),
    )
    tilt = conventions.rotation_from_euler([13, 29, 7]).astype(np.float32)  # edges that no float hits exactly
    room = replace(box, vertices=np.ascontiguousarray(box.vertices @ tilt.T))
    eye, target = tilt @ np.array([-0.8, 0.3, 0.8]), tilt @ np.array([0.9, 1.8, -0.9])
    camera = Camera.look_at(eye, target, 96, 64, yfov=95)
    suns = tuple(
        SunLight(name=str(k), direction=d, intensity=100.0)
        for k, d in enumerate(np.random.default_rng(0).normal(size=(8, 3)))
    )
    buffer = render(room, camera, *suns, environment=constant_sky(100.0), spp=64, max_depth=4)
    assert buffer.coverage.min() > 0.99  # a primary ray may slip through a seam: it is a handful of samples
    lit = buffer.beauty.max(axis=-1)
    assert lit.mean() < 1e-4 * 50  # 50: a wall in that sky


def wall_of(form: str) -> tuple[ProxyMesh, Camera]:
    """A floor, a wall of the same size beside or above it, and a camera that sees just the wall."""
    floor = quad([0.5, 0, 0.5], [0.5, 0, 0], [0, 0, 0.5])
    if form == "perpendicular":
        wall, eye, up = quad([0.5, 0.5, 0], [0.5, 0, 0], [0, 0.5, 0]), [0.5, 0.5, 0.4], [0, 1, 0]
        target: list[float] = [0.5, 0.5, 0]
    else:
        wall, eye, up = quad([0.5, 1, 0.5], [0.5, 0, 0], [0, 0, 0.5]), [0.5, 0.5, 0.5], [0, 0, 1]
        target = [0.5, 1, 0.5]
    pose = conventions.look_at(eye, target, up)
    camera = Camera(world_from_camera=pose, width=32, height=32, fx=32, fy=32, cx=16, cy=16, projection="orthographic")
    return join(floor, wall), camera


@pytest.mark.parametrize(("form", "factor"), [("perpendicular", 0.20004), ("parallel", 0.19982)])
def test_two_unit_squares_exchange_light_by_their_published_form_factor(form: str, factor: float) -> None:
    """Howell's catalogue of factors, C-14 and C-11, with a common edge and one apart; the floor glows evenly."""
    proxy, camera = wall_of(form)
    glow = (Material(emissive=np.ones(3)), Material())
    proxy = replace(proxy, materials=glow, face_materials=np.array([0, 0, 1, 1], np.int32))
    once = render(proxy, camera, spp=256, max_depth=1)
    assert once.coverage.min() == 1
    assert once.layers[0].direct.mean() == pytest.approx(0.5 * factor, rel=2e-3)  # radiance: albedo E / pi, E = pi F


def test_random_soups_never_give_back_more_light_than_they_get() -> None:
    """White triangles in a white sky show at most 1 on average, whatever their topology, smooth normals or not."""
    rng = np.random.default_rng(6)
    camera = Camera.look_at([0, 0, 4], [0, 0, 0], 32, 32)
    for count, smooth in ((30, False), (300, False), (300, True)):
        centres = rng.uniform(-1, 1, (count, 1, 3))
        vertices: Array = (centres + rng.normal(scale=0.3, size=(count, 3, 3))).reshape(-1, 3)
        normals = rng.normal(size=vertices.shape)
        soup = ProxyMesh(
            vertices=vertices.astype(np.float32),
            faces=np.arange(3 * count, dtype=np.int32).reshape(-1, 3),
            normals=(normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32) if smooth else None,
            albedo=np.ones(3),
        )
        tracer = Tracer(soup, RenderSettings(spp=64, max_depth=64))
        pictures = seeds(tracer, Lighting(environment=constant_sky(1.0)), camera, 8)
        shown = pictures[:, tracer.trace(Lighting(), camera).coverage == 1].mean(axis=(1, 2))
        error = shown.std(ddof=1) / np.sqrt(len(shown))
        assert 0.98 < shown.mean() < 1 + 4 * error and error < 0.003


def test_what_lies_on_a_ray_blocks_it() -> None:
    """A square of side 2 under random points: it blocks rays straight down inside of it alone, and none that go up."""
    corners = np.array([(-1, 0, -1), (1, 0, -1), (1, 0, 1), (-1, 0, 1)], np.float32)
    square = ProxyMesh(vertices=corners, faces=np.array([(0, 2, 1), (0, 3, 2)], np.int32))
    starts = np.random.default_rng(0).uniform(-2, 2, (1000, 3)) * (1, 0, 1) + (0, 1, 0)
    sight, down = Sight(square), np.tile((0.0, -3.0, 0.0), (1000, 1))
    np.testing.assert_array_equal(sight.blocked(starts, down), np.abs(starts[:, [0, 2]]).max(axis=1) < 1)
    assert not sight.blocked(starts, -down).any()
    assert not Sight(ProxyMesh(vertices=corners, faces=np.zeros((0, 3), np.int32))).blocked(starts, down).any()
