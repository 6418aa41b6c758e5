"""Plain walls: a box stands in for the room of which pictures tell little; a sky and a street are none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from mirelight.model import F64, Camera
from mirelight.proxy.depth import DepthMap
from mirelight.proxy.flats import Flat
from mirelight.proxy.labels import flattened, labelled
from mirelight.proxy.openings import Window
from mirelight.proxy.skies import Sky
from mirelight.proxy.tuning import TUNING
from mirelight.proxy.views import rays
from mirelight.proxy.walls import Room, hung, room_of

UP = np.array([0.0, 1.0, 0.0])
LOW, HIGH = np.array([-2.5, 0.0, -2.0]), np.array([2.5, 2.6, 2.0])  # of the true room
SPACING = 0.03
Colors = Callable[[F64, F64], F64]


def by_place(place: F64, way: F64) -> F64:
    """(H, W) of a wall that light falls off along."""
    return np.asarray(0.5 + 0.1 * place[..., 0] + 0.05 * place[..., 2])


def by_direction(place: F64, way: F64) -> F64:
    """(H, W) of a sky."""
    return np.asarray(0.5 + 0.3 * way[..., 0] + 0.2 * way[..., 1])


def walked(aim: float, count: int = 16, eye: float = 1.5) -> list[Camera]:
    """Round the middle, looking across it."""
    turns = np.linspace(0, 2 * np.pi, count, endpoint=False)
    return [
        Camera.look_at((1.2 * np.cos(a), eye, 1.2 * np.sin(a)), (0, aim, 0), 96, 64, yfov=60, name=f"{k}")
        for k, a in enumerate(turns)
    ]


def shown(camera: Camera, colors: Colors, high: float = 0.4, seed: int = 0) -> DepthMap:
    """A room whose floor, skirting, so high, and cornice are sure; all else hangs anywhere."""
    origins, directions = rays(camera)
    ahead = np.where(np.abs(directions) > 1e-9, directions, 1e-9)
    depth = (np.where(ahead > 0, HIGH, LOW) - origins) / ahead
    depth = depth.min(axis=-1)
    place = origins + directions * depth[..., None]
    sure = (place[..., 1] < high) | (place[..., 1] > HIGH[1] - 0.1) & (place[..., 1] < HIGH[1] - 1e-6)
    rng = np.random.default_rng(seed)
    hangs = depth * rng.uniform(0.4, 1.6, depth.shape)
    way = directions / np.linalg.norm(directions, axis=-1, keepdims=True)
    grey = colors(place, way) + rng.normal(0, 0.01, depth.shape)
    shape = depth.shape
    return DepthMap(
        camera=camera,
        depth=np.where(sure, depth, hangs).astype(np.float32),
        normal=(-way).astype(np.float32),
        spread=np.where(sure, 0.01, 1.0).astype(np.float32),
        trust=np.where(sure, 1.0, 0.005).astype(np.float32),
        alpha=np.ones(shape, np.float32),
        color=np.repeat(np.clip(grey, 0, 0.8)[..., None], 3, axis=2).astype(np.float32),
    )


def found_in(colors: Colors, aim: float = 1.0, high: float = 0.4) -> tuple[Room | None, list[DepthMap]]:
    views = [shown(camera, colors, high, k) for k, camera in enumerate(walked(aim))]
    return room_of(views, [], UP), views


def test_a_room_with_plain_walls_is_as_large_as_its_skirting_tells() -> None:
    room, views = found_in(by_place)
    assert room is not None
    corners = np.sort(np.stack([(room.low @ room.axes + room.middle), (room.high @ room.axes + room.middle)]), axis=0)
    np.testing.assert_allclose(corners[:, [0, 2]], [LOW[[0, 2]], HIGH[[0, 2]]], atol=0.1)
    assert corners[0, 1] == pytest.approx(0.0, abs=0.02)

    # what hangs goes onto its walls, and what is sure stays
    flats = room.flats(views, SPACING)
    assert len(flats) == 5 and all(flat.off(room.middle) > 0 for flat in flats)
    there = shown(views[0].camera, by_place, high=9.0)
    moved = flattened(views[0], flats, TUNING.plane_tolerance * SPACING, Sky(0.0))
    off = np.abs(moved.depth / there.depth - 1)
    assert np.median(np.abs(views[0].depth / there.depth - 1)[views[0].trust < 0.1]) > 0.2
    assert np.quantile(off, 0.9) < 0.06


def test_a_ceiling_that_pictures_show_is_where_the_walls_end() -> None:
    room, views = found_in(by_place, aim=1.6)
    assert room is not None and room.roofed
    floor, *walls, ceiling = room.flats(views, SPACING)
    assert len(walls) == 4 and ceiling.normal @ floor.normal == pytest.approx(-1)
    assert -ceiling.offset - floor.offset == pytest.approx(HIGH[1] - LOW[1], abs=0.1)


def test_a_sky_is_no_room_where_it_has_one_colour_in_one_direction() -> None:
    assert found_in(by_direction)[0] is None


def test_pictures_that_end_at_the_horizon_may_show_a_room_or_what_is_far_away() -> None:
    assert found_in(by_place, aim=0.6)[0] is not None
    assert found_in(by_direction, aim=0.6)[0] is None


def test_a_street_is_higher_than_a_room() -> None:
    views = found_in(by_place)[1]
    # half of what is above is sure, and high up
    high = [replace(x, trust=np.where(np.arange(96) % 2 == 0, 1, x.trust).astype(np.float32)) for x in views]
    lifted = [replace(x, depth=np.where(x.trust == 1, 3 * x.depth, x.depth)) for x in high]
    assert room_of(lifted, [], UP) is None


def test_a_hall_is_higher_than_most_rooms_and_shows_its_ceiling() -> None:
    """Eyes a quarter as high as the ceiling, of which every second pixel is sure; fronts of a street end anywhere."""
    views = [shown(camera, by_place, seed=k) for k, camera in enumerate(walked(0.9, eye=0.6))]

    def ceiled(view: DepthMap, uneven: float) -> DepthMap:
        origins, directions = rays(view.camera)
        depth = (HIGH[1] - origins[..., 1]) / np.where(directions[..., 1] > 1e-9, directions[..., 1], 1e-9)
        at = origins + directions * depth[..., None]
        over = (np.abs(at[..., 0]) < HIGH[0]) & (np.abs(at[..., 2]) < HIGH[2]) & (np.arange(96) % 2 == 0)
        depth = depth * (1 + uneven * np.random.default_rng(1).uniform(-1, 1, depth.shape))
        return replace(
            view,
            depth=np.where(over, depth, view.depth).astype(np.float32),
            trust=np.where(over, 1, view.trust).astype(np.float32),
        )

    assert room_of([ceiled(x, 0.3) for x in views], [], UP) is None
    room = room_of([ceiled(x, 0.0) for x in views], [], UP)
    assert room is not None and room.roofed
    assert room.high[1] - room.low[1] == pytest.approx(HIGH[1] - LOW[1], abs=0.1)


def test_what_hangs_before_a_wall_and_looks_like_it_is_on_it() -> None:
    """A post, plain and dark, hangs as well, and stays."""
    room, views = found_in(by_place)
    assert room is not None
    flats = room.flats(views, SPACING)
    labels = [labelled(x, flats, TUNING.plane_tolerance * SPACING) for x in views]
    free, post = (slice(10, 20), slice(40, 60)), (slice(10, 20), slice(50, 55))
    plane, color = labels[0].plane.copy(), views[0].color.copy()
    before = plane[free].copy()
    assert (before < len(flats)).all() and (views[0].trust[free] < TUNING.fog).all()
    plane[free], color[post] = len(flats), 0.05
    views[0] = replace(views[0], color=color)
    settled = hung(views, [replace(labels[0], plane=plane), *labels[1:]], flats, range(len(flats)))
    is_post = np.zeros(plane.shape, bool)
    is_post[post] = True
    assert (settled[0].plane[post] == len(flats)).all()
    put = settled[0].plane[free][~is_post[free]]
    assert (put == before[~is_post[free]]).mean() > 0.95


def test_walls_that_pictures_end_below_tell_of_no_ceiling() -> None:
    room, views = found_in(by_place, aim=1.4)
    assert room is not None and room.is_shown_level(views)
    assert not room.is_shown_level([shown(camera, by_place) for camera in walked(0.1)])


def test_what_is_white_and_low_in_a_guessed_wall_is_a_patch_of_sun() -> None:
    room, views = found_in(by_place)
    assert room is not None
    wall = room.flats(views, SPACING)[1]

    def between(low: float, high: float) -> Window:
        at = wall.middles[:, 1].reshape(wall.there.shape)
        there = (at > low) & (at < high)
        return Window(wall, replace(wall, there=there), there, 1.0)

    assert room.lets_in(between(0.8, 2.0)) and not room.lets_in(between(0.2, 1.3))


def test_where_up_is_not_known_or_all_is_sure_there_is_no_guess() -> None:
    views = found_in(by_place)[1]
    assert room_of(views, [], None) is None
    assert room_of([replace(x, trust=np.ones_like(x.trust)) for x in views], [], UP) is None


def test_what_shines_in_a_wall_is_put_behind_it() -> None:
    room, views = found_in(by_place)
    assert room is not None
    depth, _, wall = room.left(views[0])
    white = replace(views[0], color=np.where(wall[..., None], 1, views[0].color).astype(np.float32))
    white = replace(white, depth=(0.9 * depth).astype(np.float32))
    shone = room.shone(white)
    assert (shone.depth[wall] > depth[wall]).all()
    np.testing.assert_array_equal(shone.depth[~wall], white.depth[~wall])


def test_a_patch_of_sun_that_hangs_before_a_wall_is_on_it_and_what_is_sure_stays() -> None:
    room, views = found_in(by_place)
    assert room is not None
    depth, _, wall = room.left(views[0])
    sure = wall & (np.arange(wall.shape[1]) < 40)
    near = replace(views[0], depth=(0.9 * depth).astype(np.float32), trust=np.where(sure, 1, 0.005).astype(np.float32))
    white = replace(near, color=np.where(wall[..., None], 1, near.color).astype(np.float32))
    lit = room.sunlit(white)
    np.testing.assert_allclose(lit.depth[wall & ~sure], depth[wall & ~sure], rtol=1e-6)
    np.testing.assert_array_equal(lit.depth[sure | ~wall], white.depth[sure | ~wall])


def test_walls_end_where_pictures_do_that_only_look_down() -> None:
    """Whoever looks down at a table sees what stands around it, and the sun may come in above that."""
    up = [shown(camera, by_place, seed=k) for k, camera in enumerate(walked(1.0))]
    down = [shown(camera, by_place, seed=k) for k, camera in enumerate(walked(0.35))]
    whole, room = room_of(up, [], UP), room_of(down, [], UP)
    assert whole is not None and not whole.cut and whole.top is None
    assert room is not None and room.cut and room.top is not None
    way, high = room.top
    np.testing.assert_allclose(way, UP)
    tops = []  # of the true walls, as pictures show them
    for view in down:
        origins, directions = rays(view.camera)
        ahead = np.where(np.abs(directions) > 1e-9, directions, 1e-9)
        depth = ((np.where(ahead > 0, HIGH, LOW) - origins) / ahead).min(axis=-1)
        place = (origins + directions * depth[..., None])[..., 1]
        tops.append(place.max())
    assert high == pytest.approx(max(tops), abs=0.05)
    assert high < 1.5
    for wall in room.flats(down, SPACING)[1:5]:
        assert wall.middles[wall.there.ravel(), 1].max() < high + wall.cell


def test_a_floor_that_is_seen_is_the_rooms_own_and_goes_on_to_its_walls() -> None:
    _, views = found_in(by_place)
    seen = Flat(UP, 0.03, np.array([[1.0, 0, 0], [0, 0, 1]]), 0.06, np.array([-8, -8]), np.ones((16, 16), bool))
    table = replace(seen, offset=0.7)
    room = room_of(views, [table, seen], UP)
    assert room is not None
    walls = room.flats(views, SPACING)
    (floor, kept), sides = room.floored([table, seen], walls)
    assert kept is table
    assert len(sides) == len(walls) - 1
    assert floor.normal @ UP == pytest.approx(1)
    assert floor.offset == pytest.approx(0.03)
    assert floor.inside(np.array([[2.2, 0.03, 1.7], [-2.2, 0.03, -1.7]])).all()
    planes, same = room.floored([table], walls)
    assert planes == [table] and same == walls
