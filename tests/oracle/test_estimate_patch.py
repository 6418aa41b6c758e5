"""A sun of which a closed box shows one white patch: so few places tell of it that hardly anything bounds it."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from mirelight.base.conventions import unit
from mirelight.estimate import Estimate, estimate, fit, sun, transport
from mirelight.estimate.transport import Places
from mirelight.estimate.tuning import TUNING
from mirelight.lighting.albedo import face_normals
from mirelight.model import Environment, Lighting, ProxyMesh, SplatCloud, SunLight

from .test_estimate import SETTINGS, boxes, painted

pytestmark = pytest.mark.usefixtures("toys")

TO_SUN = unit([0.55, 0.75, 0.2])
STRENGTH = 60.0
HEIGHT, HOLE = 3.0, 0.45  # of the box; half the width of the hole in its ceiling


@cache
def box() -> ProxyMesh:
    """Walls all around, two blocks on the floor, a small hole in a thick ceiling."""
    wall, top = [0.75, 0.75, 0.75], HEIGHT + 0.3
    return boxes(
        ([-2.2, -0.2, -2.2], [2.2, 0, 2.2], [0.45, 0.42, 0.4]),
        ([-2.2, 0, -2.2], [-2, HEIGHT, 2.2], wall),
        ([2, 0, -2.2], [2.2, HEIGHT, 2.2], wall),
        ([-2, 0, -2.2], [2, HEIGHT, -2], wall),
        ([-2, 0, 2], [2, HEIGHT, 2.2], wall),
        ([-2.2, HEIGHT, -2.2], [-HOLE, top, 2.2], wall),
        ([HOLE, HEIGHT, -2.2], [2.2, top, 2.2], wall),
        ([-HOLE, HEIGHT, -2.2], [HOLE, top, -HOLE], wall),
        ([-HOLE, HEIGHT, HOLE], [HOLE, top, 2.2], wall),
        ([-1.2, 0, -1.0], [-0.6, 1.2, -0.4], [0.5, 0.4, 0.3]),
        ([0.4, 0, 0.6], [1.0, 0.8, 1.2], [0.5, 0.5, 0.55]),
    )


@cache
def splats() -> SplatCloud:
    """On the inner faces."""
    middle = box().vertices[box().faces].astype(np.float64).mean(axis=1) - (0, HEIGHT / 2, 0)
    inside = (np.abs(middle) < (2.01, HEIGHT / 2 + 0.01, 2.01)).all(axis=1)
    inside &= (np.einsum("nk,nk->n", face_normals(box()), middle) < 0) | (np.arange(len(middle)) >= len(middle) - 24)
    light = Lighting(
        lights=(SunLight(name="sun", direction=-TO_SUN, intensity=STRENGTH),),
        environment=Environment(radiance=np.array([[(3.0, 3.4, 4.0)]], np.float32)),
    )
    return painted(box(), light, 3200, inside)


@cache
def places() -> Places:
    return transport.places_of(splats(), box(), SETTINGS)


@cache
def found() -> Estimate:
    return estimate(splats(), box(), SETTINGS)


def test_the_patch_is_small_and_white() -> None:
    lit = sun.disc(places(), TO_SUN, 0.27) > 0
    assert 0.005 < lit.mean() < 0.03
    assert (places().color[lit] >= TUNING.fit_white_out).any(axis=1).mean() > 0.5


def test_a_sun_that_lights_few_places_is_no_stronger_than_they_show() -> None:
    """Found as 2294, what is added to all light, that nothing is black, made all other places alike."""
    assert found().sun.mean() <= 1.5 * STRENGTH
    assert np.isfinite(found().radiance).all()


def test_lamps_stand_where_the_patch_sends_light_back_and_nowhere_else() -> None:
    """Its white is less than it was, so what it lights is told as by a lamp."""
    patch = np.array([-2.0, 0.42, -0.73])  # where the ray through the middle of the hole ends
    assert (np.linalg.norm(found().lamps[:, :3] - patch, axis=1) < 0.6).all()


def test_a_sun_is_not_moved_to_where_it_lights_next_to_nothing() -> None:
    own = places()
    search = sun.Search.of(own, fit.pairs_of(own.points, own.color, np.random.default_rng(0)))
    suns = sun.search(search)
    assert suns
    assert all(sun.reaches(own.facing(one.to_sun[None])[0]) for one in suns)


def test_what_places_in_the_sun_show_bounds_its_strength() -> None:
    """Half of them would be darker than the darkest under more."""
    own, seen = places(), sun.disc(places(), TO_SUN, 0.27)
    most = sun.most(own, seen, TO_SUN)
    lit = sun.lit(own, seen, TO_SUN)
    albedo = own.color[lit].max(axis=1) / (most * seen[lit])
    assert np.median(albedo) == pytest.approx(TUNING.fit_dark)
    assert STRENGTH / np.pi < most < 10 * STRENGTH
    assert sun.most(own, np.zeros(len(own)), TO_SUN) == np.inf


def test_a_fit_keeps_to_that_bound() -> None:
    own, seen = places(), sun.disc(places(), TO_SUN, 0.27)[:, None]
    pairs = fit.pairs_of(own.points, own.color, np.random.default_rng(0))
    asked = (own.color, own.open, own.met, seen, pairs, 1.0, [1000.0])
    free, bound = (fit.fit(*asked, fit.Weighing(sun_most=most)) for most in (np.inf, 2.0))
    assert free.beams.max() > 2
    assert bound.beams.max() == pytest.approx(2, abs=1e-9)
