"""Which splats lie off the proxy: distances in closed form, and what a camera sees of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mirelight.base.colour import srgb_decode
from mirelight.base.sh import C0
from mirelight.compositor import Compositor
from mirelight.model import Camera, CompositorSettings, ProxyMesh, SplatCloud
from mirelight.pipeline import beyond

SQUARE = ProxyMesh(
    vertices=np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float32),
    faces=np.array([[0, 1, 2], [0, 2, 3]], np.int32),
)


def test_distances_are_those_of_a_square() -> None:
    points = np.random.default_rng(0).uniform(-3, 3, (500, 3))
    off = np.maximum(np.abs(points[:, :2]) - 1, 0)
    true = np.sqrt((off**2).sum(axis=1) + points[:, 2] ** 2)
    found = beyond.distances(points.astype(np.float32), SQUARE)
    assert (found <= true + 1e-5).all() and (found >= true - 0.01).all()


def test_in_a_mirror_it_is_as_far_as_from_what_it_mirrors() -> None:
    """A square at 1.5 before a mirror in z = 0: behind that, points count as turned over; before it as they are."""
    both = np.concatenate([SQUARE.vertices * 4, SQUARE.vertices + np.array([0, 0, 1.5], np.float32)])
    room = ProxyMesh(vertices=both, faces=np.concatenate([SQUARE.faces, SQUARE.faces + 4]))
    mirror = room.with_mirrors(np.array([True, True, False, False]))
    points = np.array([[0, 0, -1.5], [0.3, 0.2, -1.2], [0, 0, -4.0], [0, 0, 0.7]], np.float32)
    np.testing.assert_allclose(beyond.distances(points, mirror), [0, 0.3, 2.5, 0.7], atol=0.02)
    np.testing.assert_allclose(beyond.distances(points, room), [1.5, 1.2, 4.0, 0.7], atol=0.02)


def test_everything_is_off_a_proxy_without_area() -> None:
    flat = ProxyMesh(vertices=np.zeros((3, 3), np.float32), faces=np.array([[0, 1, 2]], np.int32))
    assert np.isinf(beyond.distances(np.ones((2, 3), np.float32), flat)).all()


@pytest.mark.parametrize("linear", [False, True])
def test_what_is_white_past_a_room_is_its_windows(linear: bool) -> None:
    """Gray splats on the left half of the square, white ones beside it in its plane, none of them off it."""
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(-1, 1, 40), np.linspace(-1, 1, 40)))
    means = np.concatenate([np.stack([x - 1, y, 0 * x], axis=1), np.stack([x + 1, y, 0 * x], axis=1)])
    shown = np.repeat(np.array([0.5, 1.0], np.float32), len(x))
    cloud = SplatCloud(
        means=means.astype(np.float32),
        quats=np.tile(np.array([1, 0, 0, 0], np.float32), (len(means), 1)),
        scales=np.full((len(means), 3), 0.05, np.float32),
        opacities=np.full(len(means), 0.95, np.float32),
        sh=((srgb_decode(shown) if linear else shown)[:, None, None] - 0.5).repeat(3, axis=2) / np.float32(C0),
        color_space="lin_rec709_display" if linear else "srgb_rec709_display",
    )
    camera = Camera.look_at((0, 0, 4), (0, 0, 0), 32, 24, yfov=20)
    compositor, away = Compositor(cloud), np.zeros(len(means), np.float32)
    room, yard = (beyond.composite(compositor, camera, away, depth=False, room=x) for x in (True, False))
    np.testing.assert_array_equal(room.color, yard.color)
    assert room.beyond is not None and yard.beyond is not None
    assert not yard.beyond[..., 0].any()
    assert room.beyond[:, :14, 0].max() == 0
    assert room.beyond[:, 18:, 0].min() == 1
    np.testing.assert_allclose(
        room.beyond[:, 18:, 1], 4, rtol=1e-3
    )  # where they are: before a wall they are the wall's


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
@pytest.mark.parametrize("supersampling", [1, 2])
def test_a_wall_before_a_sky(projection: str, supersampling: int) -> None:
    """Splats of the left half lie on the square, those of the right half far behind it, as seen past its edge."""
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(-1, 1, 40), np.linspace(-1, 1, 40)))
    wall, sky = np.stack([x - 1, y, 0 * x], axis=1), np.stack([8 * (x + 1), 8 * y, 0 * x - 30], axis=1)
    means = np.concatenate([wall, sky]).astype(np.float32)
    cloud = SplatCloud(
        means=means,
        quats=np.tile(np.array([1, 0, 0, 0], np.float32), (len(means), 1)),
        scales=np.repeat(np.array([0.05, 0.4], np.float32), len(x))[:, None].repeat(3, axis=1),
        opacities=np.full(len(means), 0.9, np.float32),
        sh=np.zeros((len(means), 1, 3), np.float32),
    )
    camera = Camera.look_at((0, 0, 4), (0, 0, 0), 32, 24, yfov=20)
    if projection == "orthographic":
        camera = replace(camera, projection="orthographic", fx=24 / 1.4, fy=24 / 1.4)
    mesh = ProxyMesh(vertices=SQUARE.vertices - np.array([1, 0, 0], np.float32), faces=SQUARE.faces)
    compositor = Compositor(cloud, CompositorSettings(supersampling=supersampling))
    made = beyond.composite(compositor, camera, beyond.distances(means, mesh), depth=True)
    plain, share = compositor.composite(camera), made.beyond
    for name in ("color", "transmittance", "depth", "median_depth"):
        np.testing.assert_array_equal(getattr(made, name), getattr(plain, name))
    assert share is not None and share.dtype == np.float32 and share.shape == (24, 32, 2)
    assert share[:, :12, 0].max() < 0.05 and share[:, 20:, 0].min() > 0.95
    np.testing.assert_allclose(share[:, 20:, 1], 34, rtol=0.02)


@pytest.mark.parametrize("linear", [False, True])
def test_what_looks_as_the_sky_beside_it_is_off_the_proxy_above_the_horizon(linear: bool) -> None:
    """Across: a wall, splats in its plane past its edge, of which the second half has the sky's colour, and the sky."""
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(-1, 0.34, 54), np.linspace(-0.8, 0.8, 64)))
    means = np.concatenate([np.stack([x, y, 0 * x], axis=1), np.stack([12 * x + 8, 9 * y, 0 * x - 30], axis=1)])
    sky = np.concatenate([x > 0.2, np.ones(len(x), bool)])
    shown = np.where(sky[:, None], [0.5, 0.65, 0.9], [0.5, 0.45, 0.4]).astype(np.float32)
    cloud = SplatCloud(
        means=means.astype(np.float32),
        quats=np.tile(np.array([1, 0, 0, 0], np.float32), (len(means), 1)),
        scales=np.repeat(np.array([0.02, 0.2], np.float32), len(x))[:, None].repeat(3, axis=1),
        opacities=np.full(len(means), 0.99, np.float32),
        sh=((srgb_decode(shown) if linear else shown)[:, None] - 0.5) / np.float32(C0),
        color_space="lin_rec709_display" if linear else "srgb_rec709_display",
    )
    camera = Camera.look_at((0.6, 0, 4), (0.6, 0, 0), 160, 90, yfov=20)
    away = np.where(means[:, 2] < -1, 30, 0).astype(np.float32)  # as of a proxy that is too wide, or near enough
    share = beyond.composite(Compositor(cloud), camera, away, depth=False).beyond
    assert share is not None
    column = {edge: round(80 + (edge - 0.6) / 4 * camera.fx) for edge in (-0.6, 0.2, 0.34)}
    house, shreds = slice(column[-0.6], column[0.2] - 2), slice(column[0.2] + 4, column[0.34] - 2)
    assert share[:, house, 0].max() < 0.01
    assert share[:34, shreds, 0].min() > 0.95
    assert share[47:, shreds, 0].max() < 0.01
    np.testing.assert_allclose(share[:34, shreds, 1], 4, rtol=0.05)  # where they are: before a wall they are the wall's
