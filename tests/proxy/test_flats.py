"""Planes of depth maps: where surfaces are, not where a cut through a heap is; and fog, which is no surface."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mirelight.model import Camera
from mirelight.proxy.depth import DepthMap
from mirelight.proxy.flats import Flat, even, flats_of, turned_outwards
from mirelight.proxy.labels import Labels, flattened
from mirelight.proxy.pieces import Points
from mirelight.proxy.skies import Sky, fog_of
from mirelight.proxy.squared import squared
from mirelight.proxy.tuning import TUNING
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


def rippled(x: float, high: float) -> DepthMap:
    """A floor from above that rises and falls by `high`, in waves as long as 24 spacings."""
    camera = Camera.look_at((x, 3, 0.1), (0, 0, 0), 160, 120, yfov=50)
    origins, ways = rays(camera)
    depth = -origins[..., 1] / ways[..., 1]
    wave = 2 * np.pi / (24 * SPACING)
    for _ in range(20):
        at = origins + ways * depth[..., None]
        depth = (high * np.sin(wave * at[..., 0]) * np.cos(wave * at[..., 2]) - origins[..., 1]) / ways[..., 1]
    at = origins + ways * depth[..., None]
    along, across = wave * at[..., 0], wave * at[..., 2]
    slope = [-np.cos(along) * np.cos(across), np.ones_like(depth), np.sin(along) * np.sin(across)]
    normal = np.stack([high * wave * slope[0], slope[1], high * wave * slope[2]], axis=-1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    one = np.ones(depth.shape, np.float32)
    color = np.zeros((*depth.shape, 3), np.float32)
    return DepthMap(camera, color, one, depth.astype("f4"), normal.astype("f4"), 0 * one, one)


def test_a_blanket_is_no_plane_and_a_rough_floor_is_one() -> None:
    for high, planes in ((0.7, 1), (3.0, 0)):
        seen = [rippled(x, high * SPACING) for x in (-1.0, 0.0, 1.0)]
        found = flats_of(seen, SPACING, 10.0)
        assert found and len(even(found, seen, SPACING, 10.0)) == planes
        risen = [replace(x, lift=np.zeros(x.there.shape)) for x in found]
        assert len(even(risen, seen, SPACING, 10.0)) == len(found)  # a ground is one all the same


def test_a_sky_shows_no_surface_unless_a_plane_lies_there() -> None:
    seen = view(0.0)
    left = np.arange(160) < 40
    sky = replace(seen, trust=np.where(left, 0.01, seen.trust).astype(np.float32), spread=seen.depth * left)
    fog = fog_of([sky, seen])
    assert fog_of([seen]) == 0 < fog
    np.testing.assert_array_equal(flattened(sky, [], SPACING, Sky(fog)).depth, seen.depth * ~left)
    (floor,) = flats_of([view(x) for x in (-1.0, 0.0, 1.0)], SPACING, 10.0)
    kept = np.abs(flattened(sky, [floor], SPACING, Sky(fog)).depth - seen.depth)[10:-10, 10:40] < 0.02
    assert kept.mean() > 0.95


def test_what_looks_as_the_sky_beside_it_is_sky_even_at_a_planes_end_and_a_window_in_it_is_none() -> None:
    """Splats of a sky hang beside outlines where they are trusted a little."""
    seen = view(0.0)
    (floor,) = flats_of([view(x) for x in (-1.0, 0.0, 1.0)], SPACING, 10.0)
    column, row = np.arange(160), np.arange(120)[:, None]
    sky, rim = column < 40, (column >= 40) & (column < 46)
    window = (abs(column - 54) < 6) & (abs(row - 60) < 6)
    blue = (sky | rim | window)[..., None]
    color = np.where(blue, (0.55, 0.7, 0.9), (0.5, 0.45, 0.4)).astype(np.float32)
    trust = np.where(sky | window, 0.01, np.where(rim, 0.2, seen.trust)).astype(np.float32)
    hanging = replace(
        seen, color=color, trust=trust * np.ones_like(seen.trust), depth=seen.depth * np.where(sky, 0.6, 1)
    )
    up = -seen.camera.world_from_camera[:3, 2]  # all of it is above the horizon
    on = np.where(sky, 1, 0) * np.ones((120, 1), int)
    shown = flattened(hanging, [floor], SPACING, Sky(TUNING.fog, up), Labels(on, np.ones(on.shape, np.float32))).depth
    whole = np.broadcast_to(rim, shown.shape)[10:-10]
    assert not shown[10:-10][whole].any()
    assert (shown[window] > 0).all()
    plain = replace(hanging, color=(0.4 + 0.3 * rim[:, None] + 0 * color).astype(np.float32))
    shown = flattened(plain, [floor], SPACING, Sky(TUNING.fog, up), Labels(on, np.ones(on.shape, np.float32))).depth
    assert (shown[10:-10][whole] > 0).all()  # what looks otherwise is the plane's


def test_what_goes_on_from_a_sky_and_looks_as_it_is_sky_and_a_house_is_wider_than_itself() -> None:
    """Columns: a sky, shreds of it that are trusted, two pixels of it that a house's splats reach, the house."""
    seen, column, row = view(0.0), np.arange(160), np.arange(120)[:, None]
    window = (abs(column - 80) < 6) & (abs(row - 60) < 6)
    color = np.where(((column < 47) | window)[..., None], (0.55, 0.7, 0.9), (0.5, 0.45, 0.4)).astype(np.float32)
    trust = np.where(column < 40, 0.01, np.where((column < 45) | window, 0.7, 1.0)).astype(np.float32)
    house = replace(seen, color=color, trust=trust * np.ones_like(seen.trust))
    up = -seen.camera.world_from_camera[:3, 2]  # all of it is above the horizon
    shown = flattened(house, [], SPACING, Sky(TUNING.fog, up)).depth > 0
    assert not shown[:, :47].any()
    assert shown[:, 47:].all()  # the window is as little sure as shreds are, and no part of the sky
    other = replace(house, color=np.where(column[:, None] < 40, color, np.float32(0.45)))
    assert (flattened(other, [], SPACING, Sky(TUNING.fog, up)).depth[:, 40:] > 0).all()


def test_what_hangs_before_a_plane_is_no_sky() -> None:
    """Walls without a pattern are as hard to place as a sky."""
    seen = view(0.0)
    left = np.arange(160) < 40
    unsure = replace(seen, trust=np.where(left, 0.01, seen.trust).astype(np.float32), depth=seen.depth - 0.8 * left)
    floor = flats_of([view(x) for x in (-1.0, 0.0, 1.0)], SPACING, 10.0)
    assert fog_of([unsure, seen], floor) == 0 < fog_of([unsure, seen])


def test_a_thing_before_a_plane_is_not_on_it_though_little_tells_where_it_is() -> None:
    """A parked car: paint without a pattern, which neighbouring views do not find. Fog before a wall blends with it."""
    seen, thing = view(0.0), np.arange(160) < 40
    (floor,) = flats_of([view(x) for x in (-1.0, 0.0, 1.0)], SPACING, 10.0)
    depth = np.where(thing, seen.depth - 0.8, seen.depth).astype("f4")
    unsure = replace(seen, depth=depth, trust=np.where(thing, 0.2, seen.trust).astype("f4"))
    inside = (slice(10, -10), slice(10, 30))
    np.testing.assert_array_equal(flattened(unsure, [floor], SPACING, Sky(0.0)).depth[inside], depth[inside])
    fog = replace(unsure, spread=(1.0 * thing).astype("f4"))
    assert flattened(fog, [floor], SPACING, Sky(0.0)).depth[inside] == pytest.approx(seen.depth[inside], abs=0.02)


def test_what_is_white_above_the_horizon_needs_more_trust() -> None:
    seen = view(0.0)
    level = Camera.look_at((0, 1.2, 2), (0, 1.2, 0), 160, 120, yfov=50)
    white = np.where(np.arange(160)[:, None] < 80, 1.0, np.array([0.3, 0.5, 0.8]))
    color = np.broadcast_to(white, seen.color.shape).astype("f4")
    half = replace(seen, camera=level, color=color, trust=np.full_like(seen.trust, 1.5 * TUNING.fog))
    shown = flattened(half, [], SPACING, Sky(TUNING.fog, np.array([0.0, 1, 0]))).depth > 0
    assert not shown[:59, :80].any()
    assert shown[61:].all()
    assert shown[:, 80:].all()
    assert (flattened(half, [], SPACING, Sky(TUNING.fog)).depth > 0).all()  # of which nobody knows what is up


def tops(x: float) -> DepthMap:
    """A table, and behind it a worktop as wide that is higher by a spacing and a half."""
    camera = Camera.look_at((x, 1.2, 1.6), (0, 0, -0.5), 160, 120, yfov=50)
    origins, ways = rays(camera)
    low, high = ((h - origins[..., 1]) / np.minimum(ways[..., 1], -1e-9) for h in (0.0, 1.5 * SPACING))
    near, far = (origins + ways * t[..., None] for t in (low, high))
    table = (np.abs(near[..., 2]) < 0.5) & (np.abs(near[..., 0]) < 0.8)
    worktop = (np.abs(far[..., 2] + 1.3) < 0.3) & (np.abs(far[..., 0]) < 0.8)
    depth = np.where(worktop, high, np.where(table, low, 0)).astype(np.float32)
    one = np.ones(depth.shape, np.float32)
    three = np.zeros((*depth.shape, 3), np.float32)
    return DepthMap(camera, three, one, depth, three + np.array([0, 1, 0], np.float32), 0 * one, one)


def test_a_table_does_not_lean_to_take_a_worktop_with_it() -> None:
    flats = flats_of([tops(x) for x in (-0.5, 0.0, 0.5)], SPACING, 10.0)
    table = min(flats, key=lambda flat: abs(flat.offset))
    np.testing.assert_allclose(np.abs(table.normal), [0, 1, 0], atol=2e-3)
    assert abs(table.offset) < 0.1 * SPACING


def strip(turn: float) -> Points:
    """Points of a strip of wall, 4 x 0.4, whose normals turn by so much from its middle to its rim, up and down."""
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(-2, 2, 200), np.linspace(-0.2, 0.2, 20)))
    up = turn * y / 0.2
    return Points(np.stack([x, y, 0 * x], 1), np.stack([0 * x, np.sin(up), np.cos(up)], 1), 0 * x + 1)


def test_a_strip_of_wall_is_asked_no_farther_than_it_reaches() -> None:
    for turn in (0.05, 0.4):
        points = strip(turn)
        told = turned_outwards(points, np.arange(len(points.at)), np.array([0.0, 0, 1]))
        assert told == pytest.approx(turn * np.sqrt(2 / 3), rel=0.1)  # at one deviation of an even strip, times sqrt 2


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


def test_a_plane_in_finer_cells_lies_where_it_lay() -> None:
    """As high as it is lifted there, which between the middles of cells is told by both."""
    there = np.ones((4, 6), bool)
    there[0, :2] = False
    slope = np.arange(4.0)[:, None] * np.full((1, 6), 0.1)  # along the first axis
    axes = np.array([[1.0, 0, 0], [0, 0, 1]])
    ground = Flat(np.array([0.0, 1, 0]), 2.0, axes, 0.5, np.array([-2, 3]), there, lift=slope)
    fine = ground.finer(3)
    at = fine.middles
    assert fine.there.sum() == 9 * there.sum()
    np.testing.assert_array_equal(fine.inside(at), ground.inside(at))
    np.testing.assert_allclose(ground.off(at), 0, atol=1e-12)
    within = (at[:, 0] > -0.75) & (at[:, 0] < 0.75)  # beyond the outermost middles it goes on level
    np.testing.assert_allclose(at[within, 1], 2 + 0.1 * (at[within, 0] / 0.5 + 1.5), atol=1e-12)


def test_a_slice_of_fog_is_no_plane() -> None:
    """The same points, of which little is sure, are one where that is asked for: plain walls are so."""
    views = [view(x) for x in (-1.0, 0.0, 1.0)]
    foggy = [replace(x, trust=(0.05 * x.trust).astype(np.float32)) for x in views]
    assert flats_of(views, SPACING, 10.0)
    assert flats_of(foggy, SPACING, 10.0) == []
    assert flats_of(foggy, SPACING, 10.0, least=0)
