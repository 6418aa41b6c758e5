"""Where splats lie on a proxy: also those that lie exactly on the edges of its triangles."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from mirelight.lighting import splat_light
from mirelight.model import DirectionalLight, Lighting, ProxyMesh, RenderSettings, SplatCloud

PARTS = 8  # squares along a side of the sheet, of two triangles each


def sheet(welded: bool) -> tuple[ProxyMesh, Any]:
    """A slanting sheet away from the origin, and its unit normal."""
    along, across = np.array([2.3, 0.4, 0.7]), np.array([0.3, 0.2, -2.1])
    steps = np.arange(PARTS + 1) / PARTS
    grid = np.array([7.1, -3.2, 9.3]) + steps[:, None, None] * along + steps[:, None] * across
    a, b, c, d = (grid[i : i + PARTS, j : j + PARTS].reshape(-1, 3) for i, j in ((0, 0), (1, 0), (1, 1), (0, 1)))
    corners = np.concatenate([np.stack(x, axis=1) for x in ((a, b, c), (a, c, d))])
    vertices, faces = corners.reshape(-1, 3).astype(np.float32), np.arange(corners.size // 3).reshape(-1, 3)
    if welded:
        vertices, place = np.unique(vertices, axis=0, return_inverse=True)
        faces = place.reshape(-1, 3)
    normal = np.cross(along, across)
    return ProxyMesh(vertices=vertices, faces=faces.astype(np.int32)), normal / np.linalg.norm(normal)


def splats_at(means: Any, normal: Any) -> SplatCloud:
    """Flat splats that face along a normal; the quaternion turns z onto it."""
    turn = np.array([1 + normal[2], -normal[1], normal[0], 0])
    return SplatCloud(
        means=means.astype(np.float32),
        quats=np.tile(turn / np.linalg.norm(turn), (len(means), 1)).astype(np.float32),
        scales=np.tile(np.array([0.02, 0.02, 0.001], np.float32), (len(means), 1)),
        opacities=np.full(len(means), 0.9, np.float32),
        sh=np.zeros((len(means), 1, 3), np.float32),
    )


@pytest.mark.parametrize("welded", [True, False])
def test_splats_on_edges_take_the_light_there(welded: bool) -> None:
    """A ray to a point exactly on an edge, shared or the sheet's own, may slip past: no light, or the other side's."""
    proxy, normal = sheet(welded)
    share = np.random.default_rng(2).dirichlet([1, 1], (len(proxy.faces), 3, 16))
    edge = proxy.vertices[np.stack([proxy.faces, np.roll(proxy.faces, -1, axis=1)], axis=2)].astype(np.float64)
    means = np.einsum("fenk,fekx->fenx", share, edge).reshape(-1, 3)
    tracer = splat_light.tracer_for(proxy, RenderSettings())
    found = splat_light.places_of(splats_at(means, normal), proxy, tracer, None)
    np.testing.assert_allclose(found.normals, np.tile(normal, (len(means), 1)), atol=1e-5)
    sun = Lighting(lights=(DirectionalLight(name="sun", direction=-normal, intensity=2.0),))
    light = tracer.point_layers(sun, found.points, found.normals, 1).total
    np.testing.assert_allclose(light, 2, rtol=1e-4)


def test_it_is_told_how_far_it_is_and_ends_where_a_listener_raises() -> None:
    proxy, normal = sheet(welded=True)
    splats = splats_at(proxy.vertices[proxy.faces].mean(axis=1), normal)
    tracer = splat_light.tracer_for(proxy, RenderSettings())
    heard: list[float] = []
    splat_light.places_of(splats, proxy, tracer, None, progress=lambda what, done: heard.append(done))
    assert heard[0] == 0 and len(heard) > 1 and heard == sorted(heard) and heard[-1] <= 1

    def stop(what: str, done: float) -> None:
        if done:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        splat_light.places_of(splats, proxy, tracer, None, progress=stop)


def test_splats_of_a_room_behind_a_mirror_take_the_light_of_what_it_mirrors() -> None:
    """A board before a mirror in z = 0, and its splats; and those of its picture, behind the mirror and turned over."""
    board = np.array([[-0.5, -0.5, 1.0], [0.5, -0.5, 1.4], [0.5, 0.5, 1.4], [-0.5, 0.5, 1.0]], np.float32)
    pane = np.array([[-2, -2, 0], [2, -2, 0], [2, 2, 0], [-2, 2, 0]], np.float32)
    quad = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    proxy = ProxyMesh(vertices=np.concatenate([board, pane]), faces=np.concatenate([quad[:, ::-1], quad + 4]))
    proxy = proxy.with_mirrors(np.array([False, False, True, True]))
    normal = np.array([0.4, 0.0, -1.0]) / np.hypot(0.4, 1.0)  # of the board, to the mirror
    means = np.random.default_rng(4).uniform(-0.4, 0.4, (50, 3))
    means[:, 2] = 1.2 + 0.4 * means[:, 0]
    over = np.array([1.0, 1.0, -1.0])
    tracer = splat_light.tracer_for(proxy, RenderSettings())
    true, seen = (
        splat_light.places_of(splats_at(m, n), proxy, tracer, None)
        for m, n in ((means, normal), (means * over, normal * over))
    )
    assert seen.near == 1
    np.testing.assert_allclose(seen.points, true.points, atol=1e-5)
    np.testing.assert_allclose(seen.normals, true.normals, atol=1e-5)
