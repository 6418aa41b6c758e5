"""A plain thing on a plain table: neither tells a place, but where it stands and what it looks like do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mirelight.model import F64, Camera
from mirelight.proxy.depth import DepthMap
from mirelight.proxy.flats import Flat, seen_through
from mirelight.proxy.foot import foot_of
from mirelight.proxy.labels import labelled
from mirelight.proxy.looks import Look
from mirelight.proxy.thing_tuning import THINGS
from mirelight.proxy.things import Things, _heights
from mirelight.proxy.tuning import TUNING
from mirelight.proxy.views import rays

SPACING, UP = 0.02, np.array([0.0, 1, 0])
LOW, HIGH = np.array([-0.5, 0, -0.4]), np.array([0.5, 0.6, 0.4])  # of a block, which stands on the ground
WHITE, LILAC = (0.78, 0.78, 0.76), (0.5, 0.5, 0.75)
EYES = [(2.4 * np.cos(a), high, 2.4 * np.sin(a)) for high in (0.9, 1.6) for a in np.arange(8) * np.pi / 4]


def met(starts: F64, ways: F64) -> F64:
    """(H, W) depths at which rays meet the block, infinite where they do not."""
    near, far = ((x - starts) / np.where(np.abs(ways) > 1e-12, ways, 1e-12) for x in (LOW, HIGH))
    first, last = np.minimum(near, far).max(axis=-1), np.maximum(near, far).min(axis=-1)
    return np.where((first < last) & (first > 0), first, np.inf)


def view(k: int, floater: float | None = None) -> DepthMap:
    """A lilac block, of which one end and the foot are surely seen and the rest as fog, on a white table that is fog,
    too; and something sure that hangs so high."""
    camera = Camera.look_at(EYES[k], (0, 0.2, 0), 128, 96, yfov=45)
    origins, ways = rays(camera)
    block = met(np.broadcast_to(origins, ways.shape), ways)
    at = origins + ways * np.where(np.isfinite(block), block, 0)[..., None]
    on = np.isfinite(block)
    sure = on & ((at[..., 0] > 0.15) | (at[..., 1] < 0.2))
    rng = np.random.default_rng(k)
    fog = rng.uniform(0.5, 4, block.shape)
    depth = np.where(sure, block, np.where(on, block + rng.normal(0, 0.04, block.shape), fog))
    trust = np.where(sure, 1, 0.02)
    if floater is not None:
        away = (floater - origins[..., 1]) / np.where(np.abs(ways[..., 1]) > 1e-9, ways[..., 1], 1e-9)
        place = origins + ways * away[..., None]
        hangs = (away > 0) & (np.abs(place[..., 0] + 1.2) < 0.15) & (np.abs(place[..., 2]) < 0.15) & (away < depth)
        depth, trust = np.where(hangs, away, depth), np.where(hangs, 1, trust)
    color = np.where(on[..., None], LILAC, WHITE).astype(np.float32)
    one = np.ones(depth.shape, np.float32)
    normal = np.broadcast_to(UP.astype(np.float32), (*depth.shape, 3))
    spread = np.where(trust < 0.5, 1, 0).astype(np.float32)
    return DepthMap(camera, color, one, depth.astype(np.float32), normal, spread, trust.astype(np.float32))


def views(floater: float | None = None) -> list[DepthMap]:
    return [view(k, floater) for k in range(len(EYES))]


@pytest.mark.parametrize("lean", [0.0, 0.08])
def test_a_table_that_nothing_tells_lies_at_the_foot_of_what_stands_on_it(lean: float) -> None:
    """Also where cameras were not held level: their up is not the table's."""
    up = np.array([lean, 1, -lean])
    ground = foot_of(views(), SPACING, 10.0, up / np.linalg.norm(up))
    assert ground is not None
    assert not ground.told
    side = np.sign(ground.normal[1])
    assert side * ground.normal == pytest.approx(UP, abs=0.03)
    corners = np.array([[-0.5, 0, -0.4], [0.5, 0, -0.4], [0.5, 0, 0.4], [-0.5, 0, 0.4]])
    assert np.abs(ground.off(corners)).max() < 1.5 * SPACING


def test_no_ground_is_guessed_where_little_is_unknown_or_a_camera_stands_lower() -> None:
    told = [replace(x, trust=np.ones_like(x.trust)) for x in views()]
    assert foot_of(told, SPACING, 10.0, UP) is None
    below = Camera.look_at((2.0, -0.5, 0), (0, 0.2, 0), 128, 96, yfov=45)
    assert foot_of([*views(), replace(view(0), camera=below)], SPACING, 10.0, UP) is None


def test_a_guessed_ground_reaches_to_where_its_cameras_stand_but_not_past_an_edge_that_is_seen() -> None:
    ground = foot_of(views(), SPACING, 1.0, UP)
    assert ground is not None
    places = np.array(EYES) * (0.99, 0, 0.99)
    assert ground.inside(places).all()
    below = []  # a floor, surely seen to the right of the table
    for one in views():
        origins, ways = rays(one.camera)
        table = origins + ways * np.where(ways[..., 1] < 0, -origins[..., 1] / ways[..., 1], 0)[..., None]
        floor = (table[..., 0] > 0.8) & (ways[..., 1] < 0) & (one.trust < 0.5)
        deep = np.where(floor, (-0.7 - origins[..., 1]) / ways[..., 1], one.depth)
        below.append(replace(one, depth=deep.astype("f4"), trust=np.where(floor, 1, one.trust).astype("f4")))
    ended = replace(ground, there=~seen_through(ground, below, SPACING, THINGS.foot_through))
    shown = np.array([(1.0, 0, 0), (-1.0, 0, 0)])
    assert ended.inside(shown).tolist() == [False, True]


def test_house_and_ground_seen_level_leave_the_ground_to_its_foot() -> None:
    """Of level pictures little is ground, though nothing is known of it."""
    eyes = [(2.4 * np.sin(a), 0.3, 2.4 * np.cos(a)) for a in np.linspace(-1, 1, 8)]
    level = []
    for k, eye in enumerate(eyes):
        camera = Camera.look_at(eye, (0, 0.45, 0), 128, 96, yfov=40)
        origins, ways = rays(camera)
        block = met(np.broadcast_to(origins, ways.shape), ways)
        there = np.isfinite(block)
        fog = np.random.default_rng(k).uniform(0.5, 4, block.shape)
        one = np.ones(block.shape, np.float32)
        depth, trust = np.where(there, block, fog).astype("f4"), np.where(there, 1, 0.02).astype("f4")
        color = np.broadcast_to(np.float32(0.5), (*block.shape, 3))
        normal = np.broadcast_to(UP.astype("f4"), (*block.shape, 3))
        level.append(DepthMap(camera, color, one, depth, normal, 1 - trust, trust))
    ground = foot_of(level, SPACING, 10.0, UP)
    assert ground is not None
    assert abs(ground.off(np.array([[0.0, 0, 0.6]]))[0]) < 2 * SPACING


def test_a_spire_stands_though_most_of_its_house_is_lower() -> None:
    ground = Flat(UP, 0.0, np.eye(3)[[0, 2]], 0.1, np.full(2, -20), np.ones((40, 40), bool), np.zeros((40, 40)))
    house = np.stack([x.ravel() for x in np.meshgrid(np.linspace(-1, 1, 41), np.linspace(0, 1, 21))], axis=1)
    tip = np.stack([x.ravel() for x in np.meshgrid(np.linspace(-0.2, 0.2, 21), np.linspace(1, 1.6, 21))], axis=1)
    points = np.concatenate(
        [
            np.stack([xy[:, 0], xy[:, 1], np.full(len(xy), z)], axis=1)
            for xy, deep in ((house, 1.0), (tip, 0.1))
            for z in np.arange(-deep, deep + 0.01, 0.05)
        ]
        + [np.array([[0.75, 2.5, 0.0]])]  # a stray
    )
    things = Things.of(ground, 1.0, points, SPACING)
    assert things.hold(np.array([[0.0, 1.6, 0.0], [0.75, 1.0, 0.0]])).all()
    assert not things.hold(np.array([[0.75, 2.5, 0.0], [0.75, 1.6, 0.0]])).any()


def kept(seen: list[DepthMap], ground: Flat, k: int) -> tuple[DepthMap, np.ndarray]:
    """A view as it is fused, and which of its pixels lie on the ground."""
    things = Things.on(ground, seen, SPACING)
    look = Look.of(ground, seen, SPACING).with_hidden(things.hidden)
    labels = labelled(seen[k], [ground], SPACING, [look])
    after, found = things.kept((seen[k], labels), look, 0, 1)
    return after, found.plane == 0


def test_a_plain_thing_is_not_the_ground_behind_it_and_no_sky() -> None:
    seen = views()
    ground = foot_of(seen, SPACING, 10.0, UP)
    assert ground is not None
    without = labelled(seen[12], [ground], SPACING, [Look.of(ground, seen, SPACING)]).plane == 0
    origins, ways = rays(seen[12].camera)
    block = np.isfinite(met(np.broadcast_to(origins, ways.shape), ways)) & (seen[12].trust < 0.5)
    after, on = kept(seen, ground, 12)
    assert block.sum() > 1000
    assert (without & block).sum() > 0.3 * block.sum()  # all views show the block there, so that looks like the ground
    assert not (on & block).any()
    assert (after.trust[block] >= TUNING.fog).mean() > 0.95  # no sky
    assert (after.depth[block] > 0).mean() > 0.95


def test_what_shines_in_a_thing_looks_like_the_ground_and_is_not() -> None:
    seen = views()
    ground = foot_of(seen, SPACING, 10.0, UP)
    assert ground is not None
    origins, ways = rays(seen[11].camera)
    block = np.isfinite(met(np.broadcast_to(origins, ways.shape), ways)) & (seen[11].trust < 0.5)
    row, column = (int(x) for x in np.argwhere(block).mean(axis=0))
    color = seen[11].color.copy()
    color[row - 3 : row + 3, column - 3 : column + 3] = WHITE
    _, on = kept([*seen[:11], replace(seen[11], color=color), *seen[12:]], ground, 11)
    assert not on[row - 3 : row + 3, column - 3 : column + 3].any()


def test_a_gap_between_walls_that_nothing_is_seen_of_is_no_thing_of_its_own() -> None:
    """The ground is surely seen on both its sides."""
    ground = Flat(UP, 0.0, np.eye(3)[[0, 2]], 0.1, np.zeros(2, int), np.ones((7, 20), bool), np.zeros((7, 20)))
    along = np.arange(20)
    cells = np.concatenate([np.stack([np.full(20, k), along], axis=1) for k in (0, 6, 1, 2, 4, 5)])
    high = np.repeat([1.0, 1.0, 0, 0, 0, 0], 20)
    cells, high = np.concatenate([cells, cells[:40]]), np.concatenate([high, np.full(40, 0.1)])  # the walls' feet
    height, _ = _heights(ground, cells, high, 0.02)
    np.testing.assert_array_equal(height[[0, 6]], 1.0)
    assert not height[1:6].any()


def test_what_hangs_above_a_guessed_ground_is_fog_and_above_one_that_is_seen_is_not() -> None:
    seen = views(floater=0.9)
    ground = foot_of(seen, SPACING, 10.0, UP)
    assert ground is not None
    hangs = (seen[12].trust == 1) & (view(12).trust < 1)
    assert hangs.sum() > 20
    after, _ = kept(seen, ground, 12)
    assert not after.depth[hangs].any()
    after, _ = kept(seen, replace(ground, told=True), 12)
    assert (after.depth[hangs] > 0).all()
