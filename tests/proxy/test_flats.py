"""Planes of depth maps: where surfaces are, not where a cut through a heap is; and fog, which is no surface."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mirelight.model import Camera
from mirelight.proxy.depth import DepthMap
from mirelight.proxy.flats import flats_of
from mirelight.proxy.labels import flattened, fog_of
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
