"""The ground goes on beneath fog; a table does not go on above a floor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mirelight.model import Camera, triangles
from mirelight.proxy.depth import DepthMap
from mirelight.proxy.detail import closer
from mirelight.proxy.flats import Flat, flats_of
from mirelight.proxy.ground import carried_on, ground_of, outside
from mirelight.proxy.labels import flattened
from mirelight.proxy.skies import Sky
from mirelight.proxy.tuning import TUNING
from mirelight.proxy.views import rays

SPACING = 0.05
SURE = 1.0  # from the middle: how far the plane at height 0 is seen surely


def view(x: float, beyond: float | None) -> DepthMap:
    """A plane that is sure around the middle; beyond there is fog, or another plane at that height."""
    camera = Camera.look_at((x, 1.5, 2.5), (0, 0, 0), 120, 90, yfov=50)
    origins, ways = rays(camera)
    near = np.linalg.norm((origins - ways * (origins[..., 1:2] / ways[..., 1:2]))[..., [0, 2]], axis=-1) < SURE
    depth = np.where(near, 0, 0.0 if beyond is None else beyond) - origins[..., 1]
    depth /= ways[..., 1]
    fog = ~near & (beyond is None)
    depth = np.where(fog, depth * np.random.default_rng(5).uniform(0.3, 3, depth.shape), depth)
    one = np.ones(depth.shape, np.float32)
    up = np.broadcast_to(np.array([0, 1, 0], np.float32), (*depth.shape, 3))
    spread, trust = np.where(fog, 1, 0), np.where(fog, 0.003, 1)
    return DepthMap(camera, 0 * up, one, depth.astype("f4"), up, spread.astype("f4"), trust.astype("f4"))


@pytest.mark.parametrize("beyond", [None, -0.8])
def test_ground_is_what_nothing_lies_below(beyond: float | None) -> None:
    views = [view(x, beyond) for x in (-1.0, 0.0, 1.0)]
    flats = flats_of(views, SPACING, 10.0)
    plane = next(x for x in flats if abs(x.offset) < 0.1)
    assert ground_of([plane], views, SPACING) == (0 if beyond is None else None)
    if beyond is not None:
        return
    (whole,) = carried_on([plane], 0, views, SPACING)
    assert not plane.there.all()
    assert whole.there.all()
    before, after = views[0], flattened(views[0], [whole], SPACING, Sky(TUNING.fog))
    origins, ways = rays(before.camera)
    true = -origins[..., 1] / ways[..., 1]
    over = whole.inside(origins + ways * true[..., None]) & (before.trust < 1)
    assert over.sum() > 1000
    assert np.quantile(np.abs(after.depth - true)[over], 0.95) < 1e-3


def test_a_ground_reaches_out_of_the_grid_that_holds_the_capture() -> None:
    ground = Flat(np.array([0.0, 1, 0]), 0.5, np.eye(3)[[0, 2]], 0.1, np.full(2, -20), np.ones((40, 40), bool))
    rising = replace(ground, lift=0.1 * np.add.outer(np.arange(40) + 0.5, np.zeros(40)) - 2.0)  # by 1 for 1 along x
    soup = outside(rising, np.array([1.0, 9, 1.0]))
    corners = soup.vertices[soup.faces]
    assert triangles.areas(corners).sum() == pytest.approx((16 - 1.8**2) * 2**0.5, rel=0.02)  # a cell within
    assert (np.abs(corners.mean(axis=1)[:, [0, 2]]) > 0.9).any(axis=1).all()
    inner = np.abs(soup.vertices[:, 0]) < 1.9  # it is level past the middle of its last cells
    assert soup.vertices[inner, 1] == pytest.approx(0.5 + soup.vertices[inner, 0], abs=1e-9)


def test_what_hangs_beneath_a_ground_that_is_guessed_is_no_pit_of_it() -> None:
    """A lawn that is trusted a little, twice as deep as a plane's thickness; a ground that views tell of has pits."""
    seen = view(0.0, -4 * SPACING)
    lawn = replace(seen, trust=np.where(seen.trust > 0, np.float32(0.6), 0))
    told = Flat(np.array([0.0, 1, 0]), 0.0, np.eye(3)[[0, 2]], 0.2, np.full(2, -40), np.ones((80, 80), bool))
    origins, ways = rays(seen.camera)
    for ground, low in ((told, -4 * SPACING), (replace(told, told=False, lift=np.zeros((80, 80))), 0.0)):
        at = origins + ways * flattened(lawn, [ground], SPACING, Sky(TUNING.fog)).depth[..., None]
        away = np.linalg.norm(at[..., [0, 2]], axis=-1)
        beneath = (away > SURE + 0.5) & ground.inside(at)
        assert beneath.sum() > 500
        assert np.quantile(np.abs(at[beneath, 1] - low), 0.95) < 0.25 * SPACING


def test_a_wall_along_a_street_is_no_ground_though_nothing_lies_behind_it() -> None:
    views = [view(x, None) for x in (-1.0, 0.0, 1.0)]
    plane = next(x for x in flats_of(views, SPACING, 10.0) if abs(x.offset) < 0.1)
    wall = replace(plane, normal=np.array([0.0, 0, 1]), offset=-20.0, axes=np.eye(3)[:2])
    at = ground_of([wall, plane], views, SPACING, np.array([0.0, 1, 0]))
    assert at == 1
    kept, ground = carried_on([wall, plane], at, views, SPACING)
    assert kept is wall
    assert ground.there.all()


def test_a_lawn_lies_lower_than_the_paving_in_it() -> None:
    spacing = 0.4 * SPACING
    lower = -2.4 * spacing  # nearer than a second plane may be
    views = [view(x, lower) for x in (-1.0, 0.0, 1.0)]
    paving = next(x for x in flats_of([view(x, None) for x in (-1.0, 0.0, 1.0)], spacing, 10.0) if abs(x.offset) < 0.1)
    (ground,) = carried_on([paving], 0, views, spacing)
    after = flattened(views[0], [ground], spacing, Sky(TUNING.fog))
    origins, ways = rays(after.camera)
    at = origins + ways * after.depth[..., None]
    away = np.linalg.norm(at[..., [0, 2]], axis=-1)
    assert np.abs(at[away < SURE - 0.6, 1]).max() < 1e-6  # paving is flat
    lawn = (away > SURE + 0.5) & ground.inside(at)
    assert lawn.sum() > 500
    assert np.quantile(np.abs(at[lawn, 1] - lower), 0.95) < 0.25 * spacing
    rising = np.stack([np.zeros(50), np.zeros(50), -np.linspace(SURE - 0.6, SURE + 0.6, 50)], axis=1)
    assert (np.diff(ground.lifted(rising)) <= 1e-9).all()  # a slope between them, no step


def test_a_ground_is_seen_closer_within_a_box_and_as_before_at_its_sides() -> None:
    """A hump of two fine tolerances that the whole's cells did not tell."""
    fine, high, half = 0.4 * SPACING, 0.8 * SPACING, 1.2
    flat = next(x for x in flats_of([view(x, None) for x in (-1.0, 0.0, 1.0)], SPACING, 10.0) if abs(x.offset) < 0.1)
    everywhere = np.ones_like(flat.there)
    level = replace(flat, there=everywhere, lift=np.zeros(everywhere.shape))
    views = []
    for x in (-1.0, 0.0, 1.0):
        origins, ways = rays((seen := view(x, None)).camera)
        depth = (high - origins[..., 1]) / ways[..., 1]
        at = origins + ways * depth[..., None]
        there = np.linalg.norm(at[..., [0, 2]], axis=-1) < SURE
        views.append(replace(seen, depth=np.where(there, depth, 0).astype("f4"), trust=np.ones_like(seen.trust)))
    corner = np.array([half, 0.5, half])
    found = closer(level, -corner, corner, 2 * fine, views, fine)
    side = np.sign(flat.normal[1])
    ring = half * np.stack([np.cos(np.arange(8)), np.zeros(8), np.sin(np.arange(8))], axis=1)
    assert side * found.lifted(0.4 * ring) == pytest.approx(high, abs=0.1 * high)
    rim = np.array([[half, 0, 0], [-half, 0, 0.3], [0.2, 0, half], [0, 0, -half]])
    np.testing.assert_allclose(found.lifted(rim), 0, atol=0.1 * high)
    unknown = replace(flat, told=False)
    assert closer(unknown, -corner, corner, 2 * fine, views, fine) is unknown


def test_a_plane_ends_where_a_closer_look_sees_past_it() -> None:
    """A round table's rim, amid coarse cells that reach beyond it; what stands on it leaves no hole."""
    fine, radius, floor = 0.4 * SPACING, 0.7, -0.8
    flat = next(x for x in flats_of([view(x, None) for x in (-1.0, 0.0, 1.0)], SPACING, 10.0) if abs(x.offset) < 0.1)
    wide = replace(flat, there=np.ones_like(flat.there))
    views = []
    for x in (-1.0, 0.0, 1.0):
        origins, ways = rays((seen := view(x, None)).camera)
        high = np.zeros(seen.depth.shape)
        for there, level in ((radius, 0.0), (0.1, 0.3)):
            met = origins + ways * ((level - origins[..., 1:2]) / ways[..., 1:2])
            inside = np.linalg.norm(met[..., [0, 2]], axis=-1) < there
            high = np.where(inside, level, floor if there == radius else high)
        depth = ((high - origins[..., 1]) / ways[..., 1]).astype("f4")
        views.append(
            replace(seen, depth=depth, trust=np.full_like(seen.trust, 0.05), spread=np.zeros_like(seen.spread))
        )
    corner = np.array([1.0, 0.5, 1.0])
    found = closer(wide, -corner, corner, 2 * fine, views, fine)
    away = np.linalg.norm(found.middles[:, [0, 2]], axis=1).reshape(found.there.shape)
    assert found.there[away < radius - 0.08].all()
    ahead = found.middles[:, 2].reshape(found.there.shape) > -0.2  # beyond, the table hides the floor
    assert not found.there[(away > radius + 0.08) & (away < 0.9) & ahead].any()
