"""Cameras of no use are told from useful ones, against shapes whose answer is known."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import trimesh

from mirelight.model import Camera, ProxyMesh, SplatCloud
from mirelight.viewing import View, views


def mesh(shape: Any, flipped: bool = False) -> ProxyMesh:
    faces = np.asarray(shape.faces, dtype=np.int32)
    return ProxyMesh(
        vertices=np.asarray(shape.vertices, dtype=np.float32), faces=faces[:, ::-1].copy() if flipped else faces
    )


BOX = trimesh.creation.box((2, 2, 2))
BALL = trimesh.creation.icosphere(subdivisions=4, radius=1.0)
GROUND = ProxyMesh(
    vertices=np.array([[-50, 0, -50], [50, 0, -50], [50, 0, 50], [-50, 0, 50]], dtype=np.float32),
    faces=np.array([[0, 2, 1], [0, 3, 2]], dtype=np.int32),
)


def cloud(means: np.ndarray) -> SplatCloud:
    n = len(means)
    return SplatCloud(
        means=means.astype(np.float32),
        quats=np.tile(np.array([1, 0, 0, 0], dtype=np.float32), (n, 1)),
        scales=np.full((n, 3), 0.1, dtype=np.float32),
        opacities=np.ones(n, dtype=np.float32),
        sh=np.zeros((n, 1, 3), dtype=np.float32),
    )


def look(position: Any, target: Any, **more: Any) -> Camera:
    return Camera.look_at(position, target, 160, 120, **more)


def one(camera: Camera, proxy: ProxyMesh | None = None, splats: SplatCloud | None = None) -> View:
    (found,) = views([camera], proxy=proxy, splats=splats)
    return found


@pytest.mark.parametrize("shape", [BOX, BALL], ids=["box", "ball"])
def test_inside_and_outside_of_a_solid(shape: Any) -> None:
    inside = one(look((0.3, 0.1, -0.2), (5, 0, 0)), mesh(shape))
    assert inside.inside and inside.problem == "stands inside the proxy"
    outside = one(look((0, 0, 4), (0, 0, 0)), mesh(shape))
    assert not outside.inside and outside.problem == ""
    room = one(look((0.3, 0.1, -0.2), (5, 0, 0)), mesh(shape, flipped=True))
    assert not room.inside and room.seen > 0.97


def test_solid_within_a_scene() -> None:
    """A box on a ground plane: inside the box, beside it, and under the ground, which encloses nothing."""
    box = BOX.copy()
    box.apply_translation([0, 1, 0])
    both = ProxyMesh(
        vertices=np.concatenate([GROUND.vertices, box.vertices.astype(np.float32)]),
        faces=np.concatenate([GROUND.faces, box.faces.astype(np.int32) + 4]),
    )
    found = [one(look(p, (9, 1, 0)), both).inside for p in ((0, 1, 0), (1.5, 1, 0), (6, -2, 0), (0.9, 0.2, 0.9))]
    assert found == [True, False, False, True]


def test_a_mesh_without_order_says_nothing() -> None:
    faces = BALL.faces.astype(np.int32).copy()
    faces[::2] = faces[::2, ::-1]
    assert not one(look((0, 0, 0), (1, 0, 0)), ProxyMesh(vertices=BALL.vertices.astype(np.float32), faces=faces)).inside


def test_share_of_the_picture() -> None:
    """A ball of radius 1 at distance 5 covers a disc of radius tan(asin(1/5)) on the plane one unit ahead."""
    camera = look((0, 0, 5), (0, 0, 0), yfov=60)
    found = one(camera, mesh(BALL))
    height = 2 * math.tan(math.radians(30))
    radius, cell = math.tan(math.asin(0.2)), height / 18 * math.sqrt(2)  # every cell counts that the disc touches
    least, most = (math.pi * r**2 / (height * height * 160 / 120) for r in (radius, radius + cell))
    assert least < found.seen < most
    assert one(look((0, 0, 5), (0, 0, 9)), mesh(BALL)).problem == "sees nothing"
    assert one(look((0, 0, 5), (0, 0, 0), near=7), mesh(BALL)).seen == 0
    assert one(look((0, 0, 5), (0, 0, 0), far=3.5), mesh(BALL)).seen == 0


def test_next_to_a_wall() -> None:
    """Where no surface point lies in view, rays do: one triangle larger than the view, one centimetre ahead."""
    camera = look((3.123, 0.01, 4.567), (3.123, -1, 4.567), near=0.001)
    found = one(camera, GROUND)
    assert found.seen == 1.0
    assert found.nearest == pytest.approx(0.01, abs=1e-6)


def test_nearest_surface_and_splat() -> None:
    assert one(look((0, 0, 3.5), (9, 9, 9)), mesh(BOX)).nearest == pytest.approx(2.5, abs=1e-6)
    assert one(look((3, 3, 0), (9, 9, 9)), mesh(BOX)).nearest == pytest.approx(math.sqrt(8), abs=1e-6)
    both = one(look((0, 0, 3.5), (9, 9, 9)), mesh(BOX), cloud(np.array([[0, 0.5, 3.5]])))
    assert both.nearest == pytest.approx(0.5)
    assert one(look((0, 0, 3), (0, 0, 0))) == View("camera", 0.0, math.inf, False)


def test_splats_alone() -> None:
    points = np.random.default_rng(0).normal(size=(20_000, 3))
    assert one(look((0, 0, 12), (0, 0, 0), yfov=20), splats=cloud(points)).seen > 0.5
    assert one(look((0, 0, 12), (0, 0, 24)), splats=cloud(points)).problem == "sees nothing"
    little = one(look((0, 0, 300), (0, 0, 0)), splats=cloud(points))
    assert 0 < little.seen < 0.01 and little.problem.startswith("sees hardly anything (0.")


def test_orthographic() -> None:
    def flat(z: float) -> Camera:
        pose = np.eye(4)
        pose[2, 3] = z
        return Camera(
            world_from_camera=pose, width=100, height=100, fx=25, fy=25, cx=50, cy=50, projection="orthographic"
        )

    assert one(flat(3), mesh(BOX)).seen == pytest.approx(0.25, abs=0.05)  # whole cells
    assert one(flat(-3), mesh(BOX)).seen == 0


def test_degenerate_triangles_and_empty_meshes() -> None:
    flat = ProxyMesh(vertices=np.zeros((3, 3), dtype=np.float32), faces=np.array([[0, 1, 2]], dtype=np.int32))
    assert one(look((0, 0, 2), (0, 0, 0)), flat).nearest == pytest.approx(2)
    none = ProxyMesh(vertices=np.zeros((0, 3), dtype=np.float32), faces=np.zeros((0, 3), dtype=np.int32))
    assert one(look((0, 0, 2), (0, 0, 0)), none).problem == "sees nothing"
