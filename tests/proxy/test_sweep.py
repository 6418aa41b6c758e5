"""Planes where pictures agree: a wall whose fog is seen before it, with something drawn on it, and without."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mirelight.model import F64, Camera
from mirelight.proxy.depth import DepthMap
from mirelight.proxy.flats import Flat
from mirelight.proxy.sweep import Sweep
from mirelight.proxy.views import rays

SPACING = 0.05
BEFORE = 1.5 * SPACING  # how far before the wall its fog is seen
EYES = tuple((x, y, 2.0 + 0.2 * y) for x in (-1.2, -0.4, 0.5, 1.3) for y in (-0.5, 0.6))


def drawn(at: F64, often: float) -> F64:
    """Display values of strokes on the wall z = 0 at points (..., 3), by how many there are."""
    return np.asarray(0.5 + 0.1 * np.sin(often * at[..., 0]) * np.cos(0.7 * often * at[..., 1] + at[..., 0]))


def view(eye: tuple[float, float, float], contrast: float = 1.0, often: float = 11.0, noise: float = 0.003) -> DepthMap:
    """The wall's picture, and the depth of its fog."""
    camera = Camera.look_at(eye, (0, 0, 0), 160, 120, yfov=50)
    origins, ways = rays(camera)
    true, fog = ((z - origins[..., 2]) / ways[..., 2] for z in (0.0, BEFORE))
    light = 0.5 + contrast * (drawn(origins + ways * true[..., None], often) - 0.5)
    light = light + np.random.default_rng(int(abs(100 * eye[0]))).normal(scale=noise, size=light.shape)
    color = np.repeat(light[..., None], 3, axis=2).astype(np.float32)
    normal = np.broadcast_to(np.array([0, 0, 1], np.float32), color.shape)
    one = np.ones(light.shape, np.float32)
    return DepthMap(camera, color, one, fog.astype(np.float32), normal, np.float32(SPACING) * one, one)


def wall(offset: float = BEFORE) -> Flat:
    """As it is found."""
    axes = np.array([[1.0, 0, 0], [0, 1, 0]])
    return Flat(np.array([0.0, 0, 1]), offset, axes, 0.1, np.array([-6, -6]), np.ones((12, 12), bool))


def test_a_wall_is_where_what_is_drawn_on_it_is_to_all_pictures() -> None:
    sweep = Sweep.of([view(eye) for eye in EYES], [wall()], SPACING)
    assert sweep.flats[0].offset == pytest.approx(0, abs=0.1 * SPACING)


def test_a_wall_without_a_pattern_or_without_cells_stays() -> None:
    nowhere = replace(wall(), there=np.zeros((12, 12), bool))
    assert Sweep.of([view(eye) for eye in EYES], [nowhere], SPACING).steps == (0.0,)
    assert Sweep.of([view(eye, contrast=0.0) for eye in EYES], [wall()], SPACING).steps == (0.0,)


def test_a_wall_that_is_alike_everywhere_is_as_far_off_as_others() -> None:
    """What is on it changes so slowly that it is the same wherever it is read."""
    slow = [view(eye, often=0.5, noise=0.0) for eye in EYES]
    assert Sweep.of(slow, [wall()], SPACING).steps == (0.0,)  # there are no others
    sharp = [view(eye) for eye in EYES]
    left, right = (replace(wall(), low=np.array([k, -6]), there=np.ones((6, 12), bool)) for k in (-6, 4))
    for k, one in enumerate(sharp):
        origins, ways = rays(one.camera)
        past = (origins + ways * one.depth[..., None])[..., 0] > 0.05  # where the strokes end
        sharp[k] = replace(one, color=np.where(past[..., None], slow[k].color, one.color))
    first, second = Sweep.of(sharp, [left, right], SPACING).steps
    assert first == second == pytest.approx(-BEFORE, abs=0.1 * SPACING)


def test_a_wall_that_is_right_stays() -> None:
    right = [replace(x, depth=(x.depth + BEFORE * _slant(x)).astype("f4")) for x in (view(eye) for eye in EYES)]
    assert Sweep.of(right, [wall(0.0)], SPACING).steps == (0.0,)


def test_what_is_seen_of_a_wall_is_moved_with_it_and_what_stands_before_it_is_not() -> None:
    seen = view(EYES[3])
    thing = np.arange(160) < 40
    depth = np.where(thing, seen.depth - 0.6, seen.depth).astype(np.float32)
    moved = Sweep((wall(),), (-BEFORE,), SPACING).moved(replace(seen, depth=depth))
    origins, ways = rays(seen.camera)
    at = origins + ways * moved.depth[..., None]
    on = wall().inside(at) & ~thing
    assert at[on][:, 2] == pytest.approx(0, abs=1e-5)
    np.testing.assert_array_equal(moved.depth[:, :40], depth[:, :40])


def test_a_mirror_is_moved_with_its_wall_alone() -> None:
    floor = Flat(np.array([0.0, 1, 0]), -1.0, np.array([[1.0, 0, 0], [0, 0, 1]]), 0.1, np.zeros(2, int), wall().there)
    sweep = Sweep((floor, wall()), (0.5, -BEFORE), SPACING)
    assert sweep.along(wall()).offset == pytest.approx(0)
    assert sweep.along(wall(0.6)).offset == 0.6  # another one, before it


def _slant(view: DepthMap) -> F64:
    """(H, W) depth that makes up one unit towards the wall."""
    return np.asarray(-1 / rays(view.camera)[1][..., 2])
