"""Places taken together: what a proxy's dents do to the light that is found."""

from __future__ import annotations

from typing import Any

import numpy as np

from mirelight.estimate import fit
from mirelight.estimate.groups import groups
from mirelight.estimate.sky import PATCHES
from mirelight.estimate.transport import Places
from mirelight.estimate.tuning import TUNING
from mirelight.model import F64

UNASKED: Any = None
EVERY = np.ones(1200, bool)
NONE = np.zeros(1200, bool)


def floor(view: F64, met: F64, seed: int) -> Places:
    """Places all over a square that have so much of an even sky in view (N,), and show a bent texture under it."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(0, 1, (len(view), 3)) * (1, 0, 1)
    open_: F64 = np.repeat(view[:, None] / PATCHES, PATCHES, axis=1)
    color = 0.3 * np.exp(0.05 * rng.standard_normal((len(view), 1))) * (view[:, None] + met)
    return Places(
        color=color,
        even=color,
        points=points,
        normals=np.tile([0.0, 1.0, 0.0], (len(view), 1)),
        spread=np.tile(0.005 * np.eye(3)[[0, 2]], (len(view), 1, 1)),
        open=open_,
        met=met,
        guessed=np.zeros(len(view)),
        named=np.zeros((len(view), 0)),
        close=UNASKED,
    )


def shaded(seed: int) -> Places:
    """A floor that sees ever less of the sky along it."""
    x = np.random.default_rng(seed).uniform(0, 1, (1200, 3))[:, 0]  # as `floor` draws them
    return floor(0.1 + 0.8 * x, np.full((1200, 3), 0.2), seed)


def test_what_is_linear_in_light_stays_so_in_groups() -> None:
    """Light that explains every place by itself explains their means, but for what is left of the texture."""
    places = shaded(3)
    beside = groups(places, EVERY, NONE)
    assert beside.sound.all()
    np.testing.assert_allclose(beside.weight.sum(axis=1), 1)
    assert ((beside.weight > 0).sum(axis=1) == TUNING.group_together).all()
    assert (beside.near[:, 0] == np.arange(1200)).all()
    light = beside.mean(places.open).sum(axis=1) + beside.mean(places.met)[:, 0]
    albedo = beside.mean(places.even)[:, 0] / light
    assert abs(albedo.mean() / 0.3 - 1) < 0.01
    assert albedo.std() / 0.3 < 0.05 / np.sqrt(TUNING.group_together) * 1.2


def test_places_in_dents_of_the_proxy_are_left_out() -> None:
    places = shaded(4)
    dents = np.arange(1200) % 15 == 0
    places.open[dents] *= 0.3
    sound = groups(places, EVERY, NONE).sound
    assert not sound[dents & (places.points[:, 0] > 0.4)].any()
    assert sound[~dents].mean() > 0.97


def test_places_that_none_lies_beside_are_left_out_unless_nearly_all_are() -> None:
    """Leaves: each faces another way, so nothing beside one says what it should see."""
    ways = np.random.default_rng(0).standard_normal((1200, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    places = shaded(5)
    leaves = places.points[:, 2] < 0.1
    places.normals[leaves] = ways[leaves]
    sound = groups(places, EVERY, NONE).sound
    assert sound[leaves].mean() < 0.2
    assert sound[~leaves].mean() > 0.95
    places.normals[:] = ways
    assert groups(places, EVERY, NONE).sound.all()


def test_places_that_face_what_no_splat_shows_are_left_out() -> None:
    places = shaded(10)
    near = places.points[:, 2] < 0.2
    places.guessed[near] = 0.5
    sound = groups(places, EVERY, NONE).sound
    assert not sound[near].any()
    assert sound[~near].mean() > 0.97


def test_places_in_the_sun_may_face_what_no_splat_shows() -> None:
    """It is little of their light, and in a room its patch of sun may face nothing else."""
    places = shaded(10)
    places.guessed[places.points[:, 2] < 0.2] = 0.5
    sunlit = places.points[:, 2] < 0.1
    assert groups(places, EVERY, sunlit).sound[sunlit].mean() > 0.97


def test_what_is_not_firm_is_in_no_group_but_its_own() -> None:
    places = shaded(6)
    firm = places.points[:, 0] > 0.5
    beside = groups(places, firm, NONE)
    assert not beside.sound[~firm].any()
    others = np.where(beside.weight[:, 1:] > 0, ~firm[beside.near[:, 1:]], False)
    assert not others.any()


def test_a_sky_that_a_rough_proxy_shows_unevenly_is_as_bright_as_it_was() -> None:
    """What each place sees of the sky is wrong by an eighth: taken one by one the sky comes out too dark."""
    found = []
    for seed in (7, 8, 9):
        places = shaded(seed)
        rng = np.random.default_rng(seed)
        places.open[:] *= np.exp(0.12 * rng.standard_normal((1200, 1)))
        pairs = fit.pairs_of(places.points, places.color, rng).farther()
        none = np.zeros((1200, 0))
        alone = fit.fit(places.even, places.open, places.met, none, pairs, 1.0, [])
        beside = groups(places, EVERY, NONE)
        even, open_, met = (beside.mean(x) for x in (places.even, places.open, places.met))
        together = fit.fit(even, open_, met, none, pairs, 1.0, [], fit.Weighing(beside.sound))
        found.append((alone.sky.mean(), together.sky.mean()))
    alone_sky, grouped_sky = np.mean(found, axis=0)
    assert alone_sky < 0.9
    assert abs(grouped_sky - 1) < 0.5 * abs(alone_sky - 1)
