"""Doorways into the dark: closed where splats stand for nothing there, beside a window that stays open."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from mirelight.model import Camera
from mirelight.proxy.depth import DepthMap
from mirelight.proxy.flats import Flat
from mirelight.proxy.lids import closed_by, covered, lids_of
from mirelight.proxy.views import rays

SPACING, FAR = 0.06, 50.0
DOOR, WINDOW = (-0.9, 0.4, 0.7), (0.9, 0.4, 0.4)  # x of the middle, half the width, half the height; about y = 0
F64 = NDArray[np.float64]
EYES = [(x, y, 4.0) for x in (-1.5, -0.5, 0.5, 1.5) for y in (-0.5, 0.6)]


def within(at: F64, opening: tuple[float, float, float], margin: float = 0.0) -> NDArray[np.bool_]:
    """(...,) whether places (..., 2) on the wall lie in it."""
    x, wide, high = opening
    return np.asarray((np.abs(at[..., 0] - x) < wide + margin) & (np.abs(at[..., 1]) < high + margin))


def places(camera: Camera) -> F64:
    """(H, W, 2) where its rays meet the wall."""
    _, ways = rays(camera)
    eye = camera.position
    return np.asarray(eye[:2] + ways[..., :2] * (-eye[2] / ways[..., 2])[..., None])


def view(eye: tuple[float, float, float], level: float = 0.1, opaque: float = 0.25, ends: float = np.inf) -> DepthMap:
    """A wall across z with a window, before which the sky is white and far away, and a doorway: its pixels show so
    much light in the picture, by splats of that alpha; the wall ends so far from the middle, before black."""
    camera = Camera.look_at(eye, (0.2 * eye[0], 0, 0), 150, 100, yfov=60)
    at = places(camera)
    door, window, out = within(at, DOOR), within(at, WINDOW), (np.abs(at) > ends).any(axis=-1)
    alpha = np.where(out, 0.0, np.where(door, opaque, 1.0))
    shown = np.where(out, 0.0, np.where(door, level, np.where(window, 1.0, 0.5)))
    depth = np.where(window, FAR, np.where(door, eye[2] + 1.0, eye[2])) / -rays(camera)[1][..., 2]
    color = np.repeat((shown / np.maximum(alpha, 1e-3))[..., None], 3, axis=2)
    normal = np.tile(np.array([0, 0, 1], np.float32), (*depth.shape, 1))
    half = np.full(depth.shape, 0.5, np.float32)
    seen = np.where(alpha > 0.5, depth, 0).astype(np.float32)
    return DepthMap(camera, color.astype(np.float32), alpha.astype(np.float32), seen, normal, half, half)


def wall() -> Flat:
    there = np.ones((40, 40), bool)
    return Flat(np.array([0.0, 0, 1]), 0.0, np.eye(3)[:2], 2 * SPACING, np.array([-20, -20]), there)


def lids(**shown: float) -> list[Flat]:
    return list(lids_of([view(eye, **shown) for eye in EYES], [wall()], SPACING).values())


def test_a_dark_doorway_is_closed_and_a_window_is_not() -> None:
    (lid,) = lids()
    at = lid.middles[:, :2]
    closed = lid.there.ravel()
    assert closed[within(at, DOOR)].all()
    assert not closed[~within(at, DOOR, 2.5 * lid.cell)].any()


def test_pixels_of_the_doorway_lie_on_its_lid_and_no_others_change() -> None:
    for eye in EYES:
        before = view(eye)
        after = covered(before, lids(), SPACING)
        door = within(places(before.camera), DOOR)
        depth = eye[2] / -rays(before.camera)[1][..., 2]
        np.testing.assert_allclose(after.depth[door], depth[door], rtol=1e-5)
        assert (after.normal[door] == (0, 0, 1)).all() and (after.alpha[door] == 1).all()
        assert (after.trust[door] == 1).all() and (after.spread[door] == 0).all()
        for name in ("color", "alpha", "depth", "normal", "spread", "trust"):
            np.testing.assert_array_equal(getattr(after, name)[~door], getattr(before, name)[~door])


def test_what_stands_before_the_doorway_is_not_moved() -> None:
    before = view(EYES[0])
    post = np.zeros(before.depth.shape, bool)
    post[:, 40:60] = True
    before = replace(before, depth=np.where(post, np.float32(2.0), before.depth))
    assert (covered(before, lids(), SPACING).depth[post] == 2.0).all()


def test_the_plane_of_the_wall_has_the_cells_of_its_lid() -> None:
    holed = replace(wall(), there=~lids()[0].there)
    floor = replace(wall(), normal=np.array([0.0, 1, 0]))
    other, whole = closed_by([floor, holed], {1: lids()[0]})
    assert whole.there.all() and other is floor


@pytest.mark.parametrize(
    "shown",
    [
        {"level": 0.5},  # a sky that is as faint
        {"opaque": 0.9},  # splats stand for the dark room
        {"ends": 1.5},  # black outside of masks
    ],
)
def test_other_openings_stay_as_they_are(shown: dict[str, float]) -> None:
    assert lids(**shown) == []


def test_a_wall_that_was_seen_from_behind_stays_open() -> None:
    behind = view((0.0, 0.0, 4.0))
    turned = Camera.look_at((0, 0, -4.0), (0, 0, 0), 150, 100, yfov=60)
    views = [*(view(eye) for eye in EYES), replace(behind, camera=turned)]
    assert lids_of(views, [wall()], SPACING) == {}
