"""Planes of depth maps: where surfaces are, not where a cut through a heap is; and fog, which is no surface."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mirelight.model import Camera
from mirelight.proxy.depth import DepthMap
from mirelight.proxy.flats import flats_of
from mirelight.proxy.labels import flattened, fog_of
from mirelight.proxy.squared import squared
from mirelight.proxy.views import rays

SPACING = 0.05


def view(x: float) -> DepthMap:
    """A floor from above, and over a part of it a heap of leaves that face anywhere."""
    camera = Camera.look_at((x, 3, 0.1), (0, 0, 0), 160, 120, yfov=50)
    origins, ways = rays(camera)
    rng = np.random.default_rng(int(10 * x) + 50)
    floor = -origins[..., 1] / ways[..., 1]
    at = origins + ways * floor[..., None]
    heap = np.hypot(at[..., 0], at[..., 2]) < 0.5
    height = np.where(heap, rng.uniform(0.2, 1.0, heap.shape), 0)
    normal = np.where(heap[..., None], np.array([0.0, 1, 0]) + rng.normal(size=(*heap.shape, 3)), [0.0, 1, 0])
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    one = np.ones(heap.shape, np.float32)
    depth = (floor - height / -ways[..., 1]).astype(np.float32)
    return DepthMap(camera, np.zeros((*heap.shape, 3), np.float32), one, depth, normal.astype("f4"), 0 * one, one)


def test_the_floor_is_a_plane_and_no_cut_through_the_heap_is() -> None:
    (floor,) = flats_of([view(x) for x in (-1.0, 0.0, 1.0)], SPACING, 10.0)
    assert abs(floor.normal[1]) == pytest.approx(1, abs=1e-3)
    assert floor.offset == pytest.approx(0, abs=0.01)


def test_a_sky_shows_no_surface_unless_a_plane_lies_there() -> None:
    seen = view(0.0)
    left = np.arange(160) < 40
    sky = replace(seen, trust=np.where(left, 0.01, seen.trust).astype(np.float32), spread=seen.depth * left)
    fog = fog_of([sky, seen])
    assert fog_of([seen]) == 0 < fog
    np.testing.assert_array_equal(flattened(sky, [], SPACING, fog).depth, seen.depth * ~left)
    (floor,) = flats_of([view(x) for x in (-1.0, 0.0, 1.0)], SPACING, 10.0)
    kept = np.abs(flattened(sky, [floor], SPACING, fog).depth - seen.depth)[10:-10, 10:40] < 0.02
    assert kept.mean() > 0.95


def before(x: float, low: float, up: float = 0.0) -> DepthMap:
    """A floor, and a wall behind it that leans by `up` radians; its lowest metre stands at z = `low`."""
    camera = Camera.look_at((x, 1.2, 3.0), (0, 1, -2), 160, 120, yfov=50)
    origins, ways = rays(camera)
    floor = np.where(ways[..., 1] < 0, -origins[..., 1] / np.minimum(ways[..., 1], -1e-9), np.inf)
    facing = np.array([0, np.sin(up), np.cos(up)])
    near, far = ((z - origins @ facing) / (ways @ facing) for z in (low, -2.0))
    wall = np.where((origins + ways * near[..., None])[..., 1] < 1.0, near, far)
    normal = np.where((floor < wall)[..., None], [0.0, 1, 0], facing)
    one = np.ones(wall.shape, np.float32)
    color = np.zeros((*wall.shape, 3), np.float32)
    return DepthMap(camera, color, one, np.minimum(floor, wall).astype("f4"), normal.astype("f4"), 0 * one, one)


def test_a_wall_with_a_plinth_stands_upright() -> None:
    """A plane through both parts leans by about a degree."""
    flats = flats_of([before(x, low=-1.94) for x in (-1.0, 0.0, 1.0)], SPACING, 10.0)
    floor, wall = (max(flats, key=lambda flat: abs(flat.normal[k])) for k in (1, 2))
    assert abs(floor.normal @ wall.normal) < 1e-9
    np.testing.assert_allclose(np.abs(wall.normal), [0, 0, 1], atol=1e-3)
    assert 1.93 < abs(wall.offset) < 2.01


def test_planes_stand_at_right_angles_where_they_nearly_do() -> None:
    def way(*angles: float) -> np.ndarray:
        """Out of z, turned about x and then about y, degrees."""
        a, b = np.radians(angles)
        return np.array([np.sin(b) * np.cos(a), np.sin(a), np.cos(b) * np.cos(a)])

    floor, leaning, behind, roof = way(90.0, 0), way(1.7, 0.0), way(-2.0, 181.0), way(40.0, 0.0)
    out = squared([floor, leaning, behind, roof])
    np.testing.assert_allclose(out[:3], [[0, 1, 0], [0, 0, 1], [0, 0, -1]], atol=1e-9)
    np.testing.assert_allclose(out[3], roof)  # 40 degrees from the wall


def test_a_wall_that_leans_stays() -> None:
    """By 2 degrees over 3 metres, 120 spacings: upright, most of it would stand off itself."""
    flats = flats_of([before(x, low=-2.0, up=np.radians(2)) for x in (-1.0, 0.0, 1.0)], SPACING / 2, 10.0)
    wall = max(flats, key=lambda flat: abs(flat.normal[2]))
    assert abs(wall.normal[1]) == pytest.approx(np.sin(np.radians(2)), abs=2e-3)
