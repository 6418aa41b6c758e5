"""What is seen in a mirror of the proxy: the other room's light, as far off as it seems to be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mirelight.lighting import Tracer
from mirelight.model import Camera, Lighting, LightingBuffer, PointLight, ProxyMesh, RenderSettings

from .lighting_scenes import join

CAMERA = Camera.look_at((0.2, 0.1, 3.0), (0.0, 0.0, 0.0), 48, 32, yfov=30)
OVER = np.diag([1.0, 1.0, -1.0])  # the mirror lies in z = 0
PANE = ProxyMesh(
    vertices=np.array([[-4, -4, 0], [4, -4, 0], [4, 4, 0], [-4, 4, 0]], np.float32),
    faces=np.array([[0, 1, 2], [0, 2, 3]], np.int32),
)


def things() -> ProxyMesh:
    """A slanted board and a post before it, behind the camera."""
    board = np.array([[-3, -0.8, 5.0], [3, -0.6, 6.5], [3, 2, 6.5], [-3, 2, 5.2]], np.float32)
    post = np.array([[0.2, -0.8, 4.4], [0.5, -0.8, 4.4], [0.5, 0.6, 4.5], [0.2, 0.6, 4.5]], np.float32)
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    return join(ProxyMesh(vertices=board, faces=faces), ProxyMesh(vertices=post, faces=faces))


def mirrored(mesh: ProxyMesh) -> ProxyMesh:
    return replace(mesh, vertices=(mesh.vertices @ OVER).astype(np.float32), faces=mesh.faces[:, ::-1])


def with_mirror(mesh: ProxyMesh, *, mirror: bool = True) -> ProxyMesh:
    both = join(mesh, PANE)
    return both.with_mirrors(mirror & (np.arange(len(both.faces)) >= len(mesh.faces)))


def lit(mesh: ProxyMesh, lamp: tuple[float, float, float]) -> LightingBuffer:
    lamps = Lighting(lights=(PointLight(name="lamp", position=np.array(lamp), intensity=9.0),))
    return Tracer(mesh, RenderSettings(spp=64, max_depth=1), aovs=False).trace(lamps, CAMERA)


def test_a_mirror_shows_the_light_of_what_it_mirrors_where_that_seems_to_lie() -> None:
    """The truth is a second room behind the pane, turned over, with a lamp of its own."""
    seen = lit(with_mirror(things()), (0.6, 1.2, 3.9))
    truth = lit(mirrored(things()), (0.6, 1.2, -3.9))
    np.testing.assert_allclose(seen.coverage, truth.coverage, atol=1.01 / 64)  # a sample may graze an edge
    assert 0.3 < truth.coverage.mean() < 0.9  # past the board nothing is mirrored
    whole = (seen.coverage == 1) & (truth.coverage == 1)
    np.testing.assert_allclose(seen.beauty[whole], truth.beauty[whole], rtol=2e-3)
    np.testing.assert_allclose(seen.depth[whole], truth.depth[whole], rtol=1e-4)


def test_inserted_objects_are_seen_in_it() -> None:
    """The post as an object, its faces last, and many times as there."""
    board, post = things(), things()
    board, post = replace(board, faces=board.faces[:2]), replace(post, faces=np.tile(post.faces[2:], (40, 1)))
    lamp = PointLight(name="lamp", position=np.array([0.6, 1.2, 3.9]), intensity=9.0)
    seen, truth = (
        Tracer(
            join(room, thing).with_mirrors(np.arange(len(room.faces) + 80) // 2 == (1 if mirror else -1)),
            RenderSettings(spp=64, max_depth=1),
            aovs=False,
            first_inserted=len(room.faces),
        ).trace(Lighting(lights=(replace(lamp, position=lamp.position * (1, 1, side)),)), CAMERA)
        for room, thing, mirror, side in (
            (join(board, PANE), post, True, 1),
            (mirrored(board), mirrored(post), False, -1),
        )
    )
    assert seen.objects is not None and truth.objects is not None
    np.testing.assert_allclose(seen.objects.coverage, truth.objects.coverage, atol=1.01 / 64)
    whole = (seen.objects.coverage == 1) & (truth.objects.coverage == 1)
    assert whole.sum() > 5
    np.testing.assert_allclose(seen.objects.beauty[whole], truth.objects.beauty[whole], rtol=2e-3)
    np.testing.assert_allclose(seen.objects.depth[whole], truth.objects.depth[whole], rtol=1e-4)


def test_a_pane_that_is_no_mirror_is_a_wall() -> None:
    seen = lit(with_mirror(things(), mirror=False), (0.6, 1.2, 3.9))
    assert seen.coverage.min() == 1
    assert seen.depth.max() < 3.2


def test_two_mirrors_that_face_each_other_end_as_walls() -> None:
    other = replace(PANE, vertices=PANE.vertices + np.array([0, 0, 4], np.float32), faces=PANE.faces[:, ::-1])
    both = join(PANE, other)
    seen = lit(both.with_mirrors(np.ones(len(both.faces), bool)), (0.6, 1.2, 2.0))
    assert np.isfinite(seen.beauty).all()
    whole = seen.coverage == 1
    assert whole.mean() > 0.5
    assert seen.depth[whole].min() == pytest.approx(11.0, abs=0.6)  # three to the first, four to each of the next two
