"""Cameras of no use are told from useful ones, against shapes whose answer is known."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import trimesh

from mirelight.model import AreaLight, Camera, Lighting, PointLight, ProxyMesh, SplatCloud, SunLight
from mirelight.model.camera_checks import View, remarks, views


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
    radius, cell = math.tan(math.asin(0.2)), height / 9 * math.sqrt(2)  # every cell counts that the disc touches
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
    assert 0 < little.seen < 0.02 and little.problem.startswith("sees hardly anything (1.")


def test_orthographic() -> None:
    def flat(z: float) -> Camera:
        pose = np.eye(4)
        pose[2, 3] = z
        return Camera(
            world_from_camera=pose, width=100, height=100, fx=25, fy=25, cx=50, cy=50, projection="orthographic"
        )

    assert one(flat(3), mesh(BOX)).seen == pytest.approx(0.25, abs=0.1)  # whole cells
    assert one(flat(-3), mesh(BOX)).seen == 0


def test_degenerate_triangles_and_empty_meshes() -> None:
    flat = ProxyMesh(vertices=np.zeros((3, 3), dtype=np.float32), faces=np.array([[0, 1, 2]], dtype=np.int32))
    assert one(look((0, 0, 2), (0, 0, 0)), flat).nearest == pytest.approx(2)
    none = ProxyMesh(vertices=np.zeros((0, 3), dtype=np.float32), faces=np.zeros((0, 3), dtype=np.int32))
    assert one(look((0, 0, 2), (0, 0, 0)), none).problem == "sees nothing"


def lit(*places: tuple[float, float, float]) -> list[Lighting]:
    return [
        Lighting(name=f"l{i}", lights=(PointLight(name="key", position=np.array(x)),)) for i, x in enumerate(places)
    ]


def test_remarks_name_and_count_what_is_of_no_use() -> None:
    """A box on a ground: cameras in it and away from it, lamps in it."""
    box = BOX.copy()
    box.apply_translation([0, 1, 0])
    both = ProxyMesh(
        vertices=np.concatenate([GROUND.vertices, box.vertices.astype(np.float32)]),
        faces=np.concatenate([GROUND.faces, box.faces.astype(np.int32) + 4]),
    )
    good = [look((6, 2, z), (0, 1, 0), name=f"good{z}") for z in range(6)]
    assert remarks(good, lit((0, 5, 0), (3, 1, 0)), both) == ()
    bad = [look((0, 1, 0), (9, 1, 0), name="in"), look((6, 2, 0), (9, 90, 0), name="up")]
    assert remarks([*good, *bad], lit((0, 5, 0), (0.5, 1, 0), (9, 2, 2)), both) == (
        "camera in stands inside the proxy",
        "camera up stands where nothing of the proxy is in view",
        "light key of l1 stands inside the proxy",
    )
    many = [look((0, 1, z / 100), (9, 1, 0), name=f"in{z}") for z in range(6)]
    (line,) = remarks([*good, look((7, 2, 0), (0, 1, 0)), *many], [], both)
    assert line == "6 of 13 cameras stand inside the proxy: in0, in1, in2, in3, in4, …"


def test_a_room_that_is_wound_outwards_holds_its_cameras_and_lamps() -> None:
    inside = [look((0.3, 0.1, z / 10), (5, 0, 0), name=f"c{z}") for z in range(5)]
    assert remarks(inside, lit((0, 0, 0)), mesh(BOX)) == ()
    assert remarks(inside[:1], [], mesh(BOX)) == ("camera c0 stands inside the proxy",)


def test_a_lamp_in_many_lightings_is_said_once() -> None:
    camera = look((0, 0, 4), (0, 0, 0))
    assert remarks([camera], lit((0, 0, 0), (0, 0, 0)), mesh(BALL)) == ("light key of l0 stands inside the proxy",)
    area = AreaLight(name="panel", shape="sphere", world_from_light=np.eye(4), size=(0.1, 0.1))
    sun = SunLight(name="sun", direction=np.array([0.0, -1.0, 0.0]))
    (line,) = remarks([camera], [Lighting(name="a", lights=(sun, area))], mesh(BALL))
    assert line == "light panel of a stands inside the proxy"
