"""The captured light found again from splats whose light is known: a small yard, painted under a sun and a sky."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from mirelight.base import colour
from mirelight.base.conventions import frame_around, quaternion_from_rotation, unit
from mirelight.base.errors import RenderError
from mirelight.estimate import Estimate, descent, edges, estimate, fit, lighting_of, sun, transport, which_sun
from mirelight.estimate.describe import described, doubted, unknown
from mirelight.estimate.fit import Pairs
from mirelight.estimate.sky import ABOVE, PATCHES, RING_OF, RINGS, as_map, glow, ground_under, patch_of, sphere
from mirelight.estimate.tuning import TUNING
from mirelight.lighting import Tracer
from mirelight.lighting.albedo import face_normals
from mirelight.model import F64, Environment, Lighting, ProxyMesh, RenderSettings, SplatCloud, SunLight

from .toy_estimate import of_toys

pytestmark = pytest.mark.usefixtures("toys")

SETTINGS = RenderSettings(seed=3)
NO_EDGES: Any = None
NOTHING_SAID = edges.Spoken(np.zeros((0, 3)), np.zeros(0), NO_EDGES, np.ones(3))
TO_SUN = unit([0.5, 0.8, 0.3])
SKY = (0.3, 0.4, 0.6)
LIGHT = Lighting(
    lights=(SunLight(name="sun", direction=-TO_SUN, color=np.array([1, 0.9, 0.8]), intensity=2.5),),
    environment=Environment(radiance=np.array([[SKY]], np.float32)),
)


def boxes(*sizes: Sequence[ArrayLike]) -> ProxyMesh:
    """Boxes, each of six squares with vertices of their own: (lowest corner, highest corner, colour)."""
    vertices: list[F64] = []
    faces: list[list[int]] = []
    colors: list[F64] = []
    for size in sizes:
        low, high, color = (np.asarray(x, dtype=np.float64) for x in size)
        for axis in range(3):
            for end in (0.0, 1.0):
                square = np.empty((4, 3))
                square[:, axis] = end
                square[:, [(axis + 1) % 3, (axis + 2) % 3]] = [[0, 0], [1, 0], [1, 1], [0, 1]]
                order = [0, 1, 2, 3] if end else [3, 2, 1, 0]
                first = 4 * len(vertices)
                vertices.append(low + square[order] * (np.asarray(high) - low))
                faces += [[first, first + 1, first + 2], [first, first + 2, first + 3]]
                colors.append(np.tile(color, (4, 1)))
    return ProxyMesh(
        vertices=np.concatenate(vertices).astype(np.float32),
        faces=np.array(faces, np.int32),
        vertex_colors=np.concatenate(colors).astype(np.float32),
        albedo=None,
    )


@cache
def yard() -> ProxyMesh:
    """A floor, walls on two sides, and blocks that cast shadows."""
    floor = ([-3, -0.2, -3], [3, 0, 3], [0.45, 0.4, 0.35])
    walls = ([-3.2, 0, -3], [-3, 2, 3], [0.6, 0.55, 0.5]), ([-3, 0, -3.2], [3, 2, -3], [0.5, 0.55, 0.6])
    corners = [
        (x, z, 0.6 + 0.25 * ((3 * i + k) % 4)) for i, x in enumerate((-2, 0, 2)) for k, z in enumerate((-2, 0, 2))
    ]
    blocks = [([x - 0.35, 0, z - 0.35], [x + 0.35, h, z + 0.35], [0.5, 0.35, 0.3]) for x, z, h in corners]
    return boxes(floor, *walls, *blocks)


def painted(mesh: ProxyMesh, light: Lighting, count: int, shown: NDArray[np.bool_] | None = None) -> SplatCloud:
    """Discs all over a mesh that show it under a light, its texture uneven by a tenth."""
    rng = np.random.default_rng(1)
    chosen = mesh.faces if shown is None else mesh.faces[shown]
    v = mesh.vertices[chosen].astype(np.float64)
    areas = np.linalg.norm(np.cross(v[:, 1] - v[:, 0], v[:, 2] - v[:, 0]), axis=1)
    face = rng.choice(len(v), count, p=areas / areas.sum())
    points = (v[face] * rng.dirichlet((1, 1, 1), count)[:, :, None]).sum(axis=1)
    points = np.where(points[:, 1:2] < 0, np.abs(points) * [1, 0, 1], points)  # the floor's underside shows nothing
    normals = (face_normals(mesh) if shown is None else face_normals(mesh)[shown])[face]
    light_there = Tracer(mesh, SETTINGS, layers=False, aovs=False).point_layers(light, points, normals, 64).total
    assert mesh.vertex_colors is not None
    albedo = mesh.vertex_colors[chosen[face, 0]] * np.exp(0.1 * rng.standard_normal((count, 1)))
    display = colour.srgb_encode(np.clip(albedo * light_there / np.pi, 0, 1))
    quats = np.stack([quaternion_from_rotation(frame.T) for frame in frame_around(normals)])
    return SplatCloud(
        means=points.astype(np.float32),
        quats=quats.astype(np.float32),
        scales=np.tile(np.array([0.04, 0.04, 0.002], np.float32), (count, 1)),
        opacities=np.full(count, 0.95, np.float32),
        sh=((display - 0.5) / 0.28209479177387814)[:, None].astype(np.float32),
    )


def sphere_map(rows: int) -> F64:
    """(rows, 2 rows, 3) the directions of an equirectangular map's pixels."""
    v, u = np.meshgrid((np.arange(rows) + 0.5) / rows, (np.arange(2 * rows) + 0.5) / (2 * rows), indexing="ij")
    theta, phi = np.pi * v, 2 * np.pi * (u - 0.5)
    return np.stack([np.cos(phi) * np.sin(theta), np.cos(theta), np.sin(phi) * np.sin(theta)], axis=-1)


@cache
def found() -> Estimate:
    return estimate(painted(yard(), LIGHT, 2400), yard(), SETTINGS)


def apart(a: F64, b: F64) -> float:
    return float(np.degrees(np.arccos(np.clip(a @ b, -1, 1))))


def test_the_sun_is_found() -> None:
    sun = found().lighting.lights[0]
    assert isinstance(sun, SunLight)
    assert apart(-sun.direction, TO_SUN) < 2
    assert sun.angular_diameter <= 4
    assert found().confidence.sun_apart < 6 and found().confidence.sun_beaten < 0


@cache
def spoken_of(lighting: Lighting, seed: int) -> edges.Spoken:
    """What edges say of the yard in a texture of three tenths."""
    close = transport.places_of(painted(yard(), lighting, 9600), yard(), SETTINGS).close
    noise = np.exp(0.3 * np.random.default_rng(seed).standard_normal((len(close), 1)))
    return edges.spoken(replace(close, color=close.color * noise), np.random.default_rng(0))


def test_edges_of_shadows_tell_the_sun_through_texture() -> None:
    """Texture hides what a light explains; it takes no side to the edges of a sun's shadows."""
    for seed in (1, 2):
        said = spoken_of(LIGHT, seed)
        assert said.sure
        assert apart(said.ways[0], TO_SUN) < 2
        away = unit(TO_SUN + 0.36 * unit(np.cross(TO_SUN, [0, 1, 0])))  # 20 degrees
        assert said.beaten(TO_SUN) < -2
        assert said.beaten(away) > 2


def test_shade_without_a_sun_is_taken_for_none() -> None:
    """Corners that see little of an even sky are dark as if a high sun did not reach them."""
    overcast = Lighting(environment=Environment(radiance=np.array([[SKY]], np.float32)))
    splats = painted(yard(), overcast, 9600)
    noise = np.exp(0.3 * np.random.default_rng(1).standard_normal((len(splats), 1, 1)))
    shown = np.clip(colour.srgb_decode(np.clip(0.5 + 0.28209479177387814 * splats.sh, 0, 1)) * noise, 0, 1)
    sh = ((colour.srgb_encode(shown) - 0.5) / 0.28209479177387814).astype(np.float32)
    assert not estimate(replace(splats, sh=sh), yard(), SETTINGS).sun.any()


def test_places_without_light_leave_the_figures_sound() -> None:
    light = np.array([[1.0, 2, 4], [0, 0, 0], [2, 2, 2]])
    assert fit.differ(light, 1.1 * light) == pytest.approx(0.1)
    assert fit.albedos(0.4 * light, light) == pytest.approx((0.4, 0.4, 0.4))
    dark = np.zeros((3, 3))
    assert np.isnan(fit.differ(dark, dark)) and np.isnan(fit.albedos(dark, dark)).all()
    blind = replace(found(), confidence=replace(found().confidence, halves_apart=np.nan))
    assert doubted(blind) and not doubted(found())
    assert any("disagree by more than 15 %" in line for line in unknown(blind))


def test_the_light_at_the_surface_is_found_up_to_its_scale() -> None:
    """Relighting needs the irradiance at the surface and nothing else."""
    mesh = yard()
    tracer = Tracer(mesh, SETTINGS, layers=False, aovs=False)
    v = mesh.vertices[mesh.faces].astype(np.float64).mean(axis=1)
    normals = face_normals(mesh)
    up = v[:, 1] > 0
    true, made = (tracer.point_layers(x, v[up], normals[up], 256).total for x in (LIGHT, found().lighting))
    bright = true.mean(axis=1) > 0.1 * true.mean()
    ratio = made[bright].mean(axis=1) / true[bright].mean(axis=1)
    assert 0.65 < np.median(ratio) < 1.5
    assert np.median(np.abs(np.log(ratio / np.median(ratio)))) < 0.15


@cache
def room() -> ProxyMesh:
    """A closed room with two windows and two blocks on its floor."""
    wall, low = [0.6, 0.55, 0.5], [0.5, 0.4, 0.3]
    sides = [
        ([-2.2, -0.2, -2.2], [2.2, 0, 2.2], [0.45, 0.4, 0.35]),
        ([-2.2, 2.2, -2.2], [2.2, 2.4, 2.2], [0.7, 0.7, 0.7]),
        ([-2.2, 0, -2.2], [-2, 2.2, 2.2], wall),
        ([-2.2, 0, -2.2], [2.2, 2.2, -2], wall),
        ([-2.2, 0, 2], [2.2, 2.2, 2.2], wall),
    ]
    for z0, z1 in ((-2.2, -1.4), (-0.3, 0.3), (1.4, 2.2)):
        sides.append(([2, 0, z0], [2.2, 2.2, z1], wall))
    for z0, z1 in ((-1.4, -0.3), (0.3, 1.4)):
        sides += [([2, 0, z0], [2.2, 0.4, z1], wall), ([2, 1.9, z0], [2.2, 2.2, z1], wall)]
    return boxes(*sides, ([-1.2, 0, -1.0], [-0.6, 0.7, -0.2], low), ([0.2, 0, 0.4], [0.7, 0.5, 1.0], low))


ROOMS_SUN = SunLight(name="sun", direction=-unit([0.8, 0.55, -0.25]), color=np.array([1, 0.93, 0.82]), intensity=14.0)


@cache
def painted_room() -> tuple[SplatCloud, NDArray[np.int64]]:
    """Splats on the inner faces of the room, its sun through the windows; which box each of its faces is of."""
    sky = Environment(radiance=np.array([[(1.6, 1.8, 2.1)]], np.float32))
    middle = room().vertices[room().faces].astype(np.float64).mean(axis=1) - (0, 1.1, 0)
    inside = (np.abs(middle) < (2.01, 1.11, 2.01)).all(axis=1)
    inside &= (np.einsum("nk,nk->n", face_normals(room()), middle) < 0) | (np.arange(len(middle)) >= len(middle) - 24)
    splats = painted(room(), Lighting(lights=(ROOMS_SUN,), environment=sky), 3200, inside)
    return splats, np.arange(len(middle)) // 12


def test_the_sun_through_windows_is_found_though_its_patch_shows_white() -> None:
    splats, _ = painted_room()
    white = (0.5 + 0.28209479177387814 * splats.sh[:, 0] > 0.999).any(axis=1).mean()
    assert 0.005 < white < 0.1
    lit = estimate(splats, room(), SETTINGS)
    assert apart(lit.to_sun, -ROOMS_SUN.direction) < 1
    assert lit.confidence.sun_apart < 2
    assert 0.7 < float(lit.sun.mean() / (14 * np.mean([1, 0.93, 0.82]))) < 1.4


def test_a_proxy_that_lets_light_in_where_there_was_a_wall_does_not_hide_the_sun() -> None:
    """Through the gap most directions light something, but none of them what is bright."""
    splats, box = painted_room()
    leaky = replace(room(), faces=room().faces[box != 2])
    places = transport.places_of(splats, leaky, SETTINGS)
    places = places.taken(np.arange(0, len(places), 3))
    pairs = fit.pairs_of(places.points, places.color, np.random.default_rng(0))
    (found, _) = which_sun.suns_by_half([places, places], [pairs, pairs], np.random.default_rng(1), NOTHING_SAID)
    assert found is not None
    assert apart(found.to_sun, -ROOMS_SUN.direction) < 2


def test_the_whole_fit_chooses_between_suns(monkeypatch: pytest.MonkeyPatch) -> None:
    """The search, which knows one albedo and an even sky, may like another sun better."""
    places = transport.places_of(painted(yard(), LIGHT, 2400), yard(), SETTINGS)
    pairs = fit.pairs_of(places.points, places.color, np.random.default_rng(0))
    wrong, right = (sun.Sun(way, 0.0, np.zeros(0), loss, (0.35, 0.45)) for way, loss in ((-TO_SUN, 0.0), (TO_SUN, 0.1)))
    monkeypatch.setattr(sun, "search", lambda of: (wrong, right))
    (found, _) = which_sun.suns_by_half([places, places], [pairs, pairs], np.random.default_rng(0), NOTHING_SAID)
    assert found is not None and apart(found.to_sun, TO_SUN) < 3  # moved to where the places like it best
    monkeypatch.setattr(sun, "search", lambda of: ())
    assert which_sun.suns_by_half([places, places], [pairs, pairs], np.random.default_rng(0), NOTHING_SAID) == [
        None,
        None,
    ]


def test_a_sun_that_shadows_edges_alone_tell_of_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    """As through a trellis: no place is in the sun that is not at a shadow's edge, too."""
    places = transport.places_of(painted(yard(), LIGHT, 2400), yard(), SETTINGS)
    pairs = fit.pairs_of(places.points, places.color, np.random.default_rng(0))
    given = sun.Sun(TO_SUN, 0.0, np.zeros(0), 0.0, (0.35, 0.45))
    monkeypatch.setattr(sun, "firm", lambda places, found: sun.disc(places, found.to_sun, 0.0) == 0)
    best, gain = which_sun.best_of(places, pairs, [given, None], NOTHING_SAID)
    assert gain > TUNING.least_gain
    assert 0.7 < float(np.pi * best.light.beams[0].mean() / (2.5 * np.mean([1, 0.9, 0.8]))) < 1.4


def test_a_sun_of_which_edges_are_certain_need_not_explain_more(monkeypatch: pytest.MonkeyPatch) -> None:
    """Bushes' shade and albedos can explain as much as a sun does."""
    places = transport.places_of(painted(yard(), LIGHT, 2400), yard(), SETTINGS)
    pairs = fit.pairs_of(places.points, places.color, np.random.default_rng(0))
    given = sun.Sun(TO_SUN, 0.0, np.zeros(0), 0.0, (0.35, 0.45))
    said = spoken_of(LIGHT, 1)
    for certain, there in ((said.lead - 0.1, True), (said.lead + 0.1, False)):
        monkeypatch.setattr(edges, "TUNING", replace(TUNING, least_gain=1.0, sure_gain=1.0, edge_certain=certain))
        best, _ = which_sun.best_of(places, pairs, [given, None], said)
        assert (best.sun is not None) == there


@pytest.mark.parametrize("start", [(0.6, 0.1), (0.6, 0.02)])
def test_a_sun_that_edges_surely_tell_does_not_fade_from_a_weak_start(start: tuple[float, float]) -> None:
    """Where a picture has shadow in three places of ten that the proxy has in the sun, a weak sun stays weak on its way
    down, though a strong one explains far more."""
    _, pairs, one, _, _ = known_yard()
    places, _ = misfit(0.3)
    weak, sure = (
        descent.fitted_each(places, pairs, replace(one, start=start, sure=sure)).light for sure in (False, True)
    )
    of_truth = [float(light.beams[0].mean() / beam_of_yard().mean()) for light in (weak, sure)]
    assert of_truth[0] < 0.4 and weak.loss > sure.loss + 0.03
    assert 0.8 < of_truth[1] < 1.1


@cache
def known_yard() -> tuple[transport.Places, Pairs, sun.Sun, F64, F64]:
    """Places of the yard, and its sun: its share at each, and irradiance / pi."""
    places = transport.places_of(painted(yard(), LIGHT, 2400), yard(), SETTINGS)
    pairs = fit.pairs_of(places.points, places.color, np.random.default_rng(0))
    one = sun.Sun(TO_SUN, 0.0, np.zeros(0), 0.0, (0.35, 0.45))
    seen = sun.disc(places, TO_SUN, 0.0)
    sky = np.tile(SKY, (PATCHES, 1))
    return places, pairs, one, seen, fit.light_of(places.open, places.met, seen[:, None], sky, beam_of_yard())


def beam_of_yard() -> F64:
    return np.array([[2.5, 2.25, 2.0]]) / np.pi


def misfit(share: float) -> tuple[transport.Places, NDArray[np.bool_]]:
    """The yard's places, of which so many in the sun show shadow, as behind bars that the proxy lacks; and which."""
    places, _, one, seen, light = known_yard()
    wrong = sun.lit(places, seen, one.to_sun) & (np.random.default_rng(4).uniform(0, 1, len(places)) < share)
    dark = places.color * (light - seen[:, None] * beam_of_yard()) / light
    return replace(places, color=np.where(wrong[:, None], dark, places.color)), wrong


def test_places_that_show_shadow_where_the_proxy_has_sun_are_told() -> None:
    _, pairs, one, seen, light = known_yard()
    places, wrong = misfit(0.2)
    agree = sun.agreeing(places, pairs, one, seen, light, beam_of_yard()[0])
    assert wrong.sum() > 100
    assert agree[wrong].mean() < 0.1
    assert agree[~wrong].mean() > 0.98


def test_bars_that_the_proxy_lacks_take_less_of_the_suns_strength() -> None:
    _, pairs, one, _, _ = known_yard()
    places, _ = misfit(0.65)
    every, agreeing = (
        float(light.beams[0].mean() / beam_of_yard().mean())
        for light in (descent.fitted_each(places, pairs, one).light, which_sun._agreed(places, pairs, one).light.light)
    )
    assert every < 0.3
    assert 0.5 < agreeing < 1


def test_ground_outside_reflects_at_most_all_that_comes_down() -> None:
    white = np.ones(PATCHES)
    assert ground_under(None, white, 0) @ white == pytest.approx(1)
    sun_alone = np.append(0 * white, 3.0)  # irradiance / pi of a surface that faces it
    assert ground_under(TO_SUN, white, 1) @ sun_alone == pytest.approx(TUNING.fit_ground_sun * 3 * TO_SUN[1])
    assert ground_under(-TO_SUN, white, 1) @ sun_alone == 0


def test_few_places_that_see_below_the_horizon_make_no_lamp_of_the_ground() -> None:
    """Ground is all around, and what the proxy gets wrong at its rim looks like light from below."""
    places, pairs, _, seen, _ = known_yard()
    rim = np.random.default_rng(5).uniform(0, 1, len(places)) < 0.08
    below = np.isin(RING_OF, np.arange(ABOVE, len(RINGS)))
    open_ = np.where(below, rim[:, None] * 0.3 / below.sum(), places.open)
    color = np.where(rim[:, None], 5 * places.color, places.color)
    ground = ground_under(TO_SUN, np.ones(PATCHES), 1)
    free, bounded = (
        fit.fit(color, open_, places.met, seen[:, None], pairs, float(np.mean(SKY)), [beam_of_yard().mean()], by)
        for by in (fit.Weighing(), fit.Weighing(ground=ground))
    )
    most = (ground @ np.concatenate([np.tile(SKY, (PATCHES, 1)), beam_of_yard()])).mean()
    assert free.sky[below].mean() > 4 * most
    assert bounded.sky[below].mean() < 1.5 * most
    assert abs(bounded.beams.mean() / beam_of_yard().mean() - 1) < 0.1


@pytest.mark.parametrize("open_", [True, False])
def test_ground_is_no_second_sky_in_the_open(open_: bool) -> None:
    """Some places look lit from below, by as much as comes down; through windows such light may come from anything."""
    places, pairs, one, _, _ = known_yard()
    below = np.isin(RING_OF, np.arange(ABOVE, len(RINGS)))
    rim = np.random.default_rng(5).uniform(0, 1, len(places)) < 0.3
    seen = np.where(below, rim[:, None] * 0.3 / below.sum(), places.open)
    places = replace(places, open=seen if open_ else 0.1 * seen, color=np.where(rim[:, None], 4, 1) * places.color)
    found = descent.fitted(places, pairs, one).light
    most = (ground_under(one.to_sun, np.ones(PATCHES), 1) @ np.concatenate([found.sky, found.beams])).mean()
    assert (found.sky[below].mean() < 1.2 * TUNING.fit_ground * most) == open_


def test_pictures_of_any_balance_have_sunlight_of_its_colour() -> None:
    """Nothing but what is usual tells the colour of all light as a whole; sky against sun is told by the pictures."""
    rng = np.random.default_rng(2)
    count = 600
    seen = rng.permuted(np.repeat([0.0, 0.7], count // 2))[:, None]
    open_ = rng.uniform(0.2, 0.9, (count, 1)) * np.eye(PATCHES)[:1]
    sky, beam = np.array([0.3, 0.4, 0.6]), np.array([0.9, 0.8, 0.7])
    light = open_[:, :1] * sky + seen * beam
    points = rng.uniform(0, 1, (count, 3))
    expected = sun.color_of(TO_SUN)
    for cast in ([1.0, 1.0, 1.0], [1.0, 0.8, 0.6]):
        color = 0.3 * light * cast
        pairs = fit.pairs_of(points, color, np.random.default_rng(0))
        by = fit.Weighing(sunlight=expected)
        made = fit.fit(color, open_, np.zeros((count, 3)), seen, pairs, 0.4, [0.8], by)
        np.testing.assert_allclose(made.beams[0] / made.beams[0].mean(), expected / expected.mean(), rtol=0.02)
        np.testing.assert_allclose(made.beams[0] / made.sky[0], beam / sky, rtol=0.1)


def test_sunlight_is_warmer_the_lower_it_comes() -> None:
    colors = np.stack([sun.color_of(np.array([np.cos(x), np.sin(x), 0])) for x in np.radians([90, 40, 20, 5, -10])])
    blue, green = colors[:, 2] / colors[:, 0], colors[:, 1] / colors[:, 0]
    assert (np.diff(blue) <= 0).all() and (np.diff(green) <= 0).all() and (blue < green).all()
    assert blue[1] == pytest.approx(0.84, abs=0.03)  # about 5,700 K
    np.testing.assert_array_equal(colors[3], colors[4])  # lower ones look no redder to cameras


def test_few_pairs_across_shadows_edges_outweigh_their_number() -> None:
    pairs = Pairs(
        a=np.arange(99),
        b=np.arange(99) + 1,
        nearest=np.ones(99, bool),
        clipped=np.zeros((100, 3), bool),
        worth=np.ones(99),
    )
    few, most = pairs.across(np.arange(100) >= 50), pairs.across(np.arange(100) % 2 == 0)
    assert few.worth[49] == TUNING.fit_most_worth and few.worth.sum() == 98 + TUNING.fit_most_worth
    assert (most.worth == 1).all()
    lit = np.isin(np.arange(100), np.arange(0, 100, 20))
    share = pairs.across(lit)
    across = lit[:-1] != lit[1:]
    assert share.worth[across].sum() / share.worth.sum() == pytest.approx(TUNING.fit_across)


def test_what_shows_white_is_a_lower_bound() -> None:
    """Of two places, one white: they differ only if the white one's bound lies above the other; it tells no chroma."""
    color = np.array([[1.0, 1.0, 0.4], [0.5, 0.5, 0.4], [1.0, 1.0, 1.0]])
    pairs = Pairs(
        a=np.array([0, 1, 0]), b=np.array([1, 0, 2]), nearest=np.ones(3, bool), clipped=color >= 0.98, worth=np.ones(3)
    )
    higher, lower = np.log([[0.8] * 3, [0.5] * 3, [0.9] * 3]), np.log([[0.2] * 3, [0.5] * 3, [0.9] * 3])
    np.testing.assert_allclose(np.exp(np.abs(pairs.apart(higher)[:2])), 1.6)
    np.testing.assert_allclose(np.exp(pairs.apart(lower)[:2]), [[1, 1, 0.4], [1, 1, 2.5]])
    assert not pairs.apart(higher)[2, :2].any()
    assert not pairs.weights(higher).any()


def slabs(color: float) -> tuple[ProxyMesh, SplatCloud]:
    """A roof over half of a floor, and discs on the floor's top and the roof's underside; the roof's have a colour."""
    mesh = boxes(
        ([-2, -0.1, -2], [2, 0, 2], [0.5, 0.5, 0.5]),
        ([0, 1, -2], [2, 1.1, 2], [0.5, 0.5, 0.5]),
    )
    rng = np.random.default_rng(5)
    floor, roof = rng.uniform((-2, 0, -2), (2, 0, 2), (900, 3)), rng.uniform((0, 1, -2), (2, 1, 2), (600, 3))
    points = np.concatenate([floor, roof])
    linear = np.concatenate([np.full(900, 0.3), np.full(600, color)])
    display = np.repeat(colour.srgb_encode(linear)[:, None], 3, axis=1)
    return mesh, SplatCloud(
        means=points.astype(np.float32),
        quats=np.tile(quaternion_from_rotation(frame_around(np.array([0.0, 1, 0])).T).astype(np.float32), (1500, 1)),
        scales=np.tile(np.array([0.05, 0.05, 0.001], np.float32), (1500, 1)),
        opacities=np.full(1500, 0.95, np.float32),
        sh=((display - 0.5) / 0.28209479177387814)[:, None].astype(np.float32),
    )


def test_black_splats_are_met_as_black() -> None:
    """Half of the view from under a black roof is that roof: leaving out its splats would show something brighter."""
    mesh, splats = slabs(0.0)
    places = transport.places_of(splats, mesh, SETTINGS)
    under = (places.points[:, 1] < 0.5) & (places.points[:, 0] > 0.5)
    assert under.sum() > 100
    assert places.met[under].max() < 1e-3
    brighter = transport.places_of(slabs(0.2)[1], mesh, SETTINGS)
    under = (brighter.points[:, 1] < 0.5) & (brighter.points[:, 0] > 0.5)
    seen = 1 - brighter.open[under].sum(axis=1)
    np.testing.assert_allclose(brighter.met[under], np.repeat(0.2 * seen[:, None], 3, axis=1), atol=2e-3)


def test_a_few_splats_that_are_far_too_bright_are_not_met() -> None:
    """As where a bright surface's splats bleed into a dark corner: every tenth of the roof's is white."""
    mesh, splats = slabs(0.2)
    sh = splats.sh.copy()
    sh[900::10] = (1.0 - 0.5) / 0.28209479177387814
    places = transport.places_of(replace(splats, sh=sh), mesh, SETTINGS)
    under = (places.points[:, 1] < 0.5) & (places.points[:, 0] > 0.5)
    seen = 1 - places.open[under].sum(axis=1)
    assert seen.mean() > 0.1
    np.testing.assert_allclose(places.met[under], np.repeat(0.2 * seen[:, None], 3, axis=1), atol=2e-3)


def test_what_no_splat_shows_is_guessed() -> None:
    """A wall along the open side of the floor, which is in the proxy alone."""
    _, splats = slabs(0.2)
    mesh = boxes(
        ([-2, -0.1, -2], [2, 0, 2], [0.5, 0.5, 0.5]),
        ([0, 1, -2], [2, 1.1, 2], [0.5, 0.5, 0.5]),
        ([-2.1, 0, -2], [-2, 1, 2], [0.5, 0.5, 0.5]),
    )
    places = transport.places_of(splats, mesh, SETTINGS)
    low, x = places.points[:, 1] < 0.5, places.points[:, 0]
    assert places.guessed[low & (x < -1.8)].min() > 0.8
    assert places.guessed[low & (x > 0.5)].max() < 0.1


def test_what_no_splat_shows_is_darker_where_less_light_comes() -> None:
    """Discs on the open half of the floor alone: the roof's underside gets but what the floor sends up."""
    mesh, splats = slabs(0.2)
    shown = (splats.means[:, 0] < 0) & (splats.means[:, 1] < 0.5)
    names = ("means", "quats", "scales", "opacities", "sh")
    places = transport.places_of(replace(splats, **{x: getattr(splats, x)[shown] for x in names}), mesh, SETTINGS)
    beside = places.points[:, 0] > -0.5
    seen = 1 - places.open[beside].sum(axis=1)
    assert seen.mean() > 0.1
    assert 0.02 * seen.sum() < places.met[beside].mean(axis=1).sum() < 0.65 * 0.3 * seen.sum()


def test_the_proxy_is_made_ready_for_rays_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a million triangles it takes seconds."""
    mesh, splats = slabs(0.2)
    Tracer(mesh, SETTINGS)  # the variant that the next module is imported with
    from mirelight.lighting.kernel import proxy as kernel

    made = []

    class Counted(kernel.DeviceProxy):
        def __init__(self, mesh: ProxyMesh, *rest: Any, **more: Any) -> None:
            made.append(len(mesh.faces))
            super().__init__(mesh, *rest, **more)

    monkeypatch.setattr(kernel, "DeviceProxy", Counted)
    assert len(transport.places_of(splats, mesh, SETTINGS)) > 200
    assert made == [len(mesh.faces)]


def test_a_splat_on_a_shadows_edge_is_partly_lit() -> None:
    """The roof's edge is at x = 0: light straight down reaches the part of each splat that lies on the other side."""
    mesh, splats = slabs(0.2)
    places = transport.places_of(splats, mesh, SETTINGS)
    floor = (places.points[:, 1] < 0.5) & (np.abs(places.points[:, [0, 2]]) < 1.9).all(axis=1)  # off the outer rims
    x = places.points[floor, 0] / 0.05
    lit = sun.disc(places, np.array([0.0, 1.0, 0.0]), 0.0)[floor]
    np.testing.assert_array_equal(lit[x < -1.6], 1)
    np.testing.assert_array_equal(lit[x > 1.6], 0)
    edge = np.abs(x) < 1.4
    u = x[edge] / 1.5  # share of a disc of 1.5 standard deviations beyond the chord at u of its radius
    share = (np.arccos(u) - u * np.sqrt(1 - u * u)) / np.pi
    assert edge.sum() > 20
    assert np.abs(lit[edge] - share).max() < 0.12
    assert abs(float(np.mean(lit[edge] - share))) < 0.02


def test_places_on_a_shadows_edge_are_not_firm() -> None:
    """The same roof: three standard deviations on either side of its edge, and nothing else off the rims."""
    mesh, splats = slabs(0.2)
    places = transport.places_of(splats, mesh, SETTINGS)
    floor = (places.points[:, 1] < 0.5) & (np.abs(places.points[:, [0, 2]]) < 1.8).all(axis=1)
    x = places.points[floor, 0] / 0.05
    firm = sun.firm(places, sun.Sun(np.array([0.0, 1.0, 0.0]), 0.0, np.zeros(0), 0.0, (0.35, 0.45)))[floor]
    assert not firm[np.abs(x) < 2.5].any()
    assert firm[np.abs(x) > 3.1].all()


def test_a_sun_is_as_strong_as_it_was_though_the_proxys_shadows_miss() -> None:
    """Stripes of sunlight, which the proxy has half their width beside: without their edges the sun is as it was."""
    rng = np.random.default_rng(5)
    points = rng.uniform(0, 1, (1500, 3)) * (1, 0, 1)
    phase = (points[:, 0] / 0.2) % 1
    lit, seen = (np.where((phase - moved) % 1 < 0.15, 0.8, 0.0)[:, None] for moved in (0.0, 0.08))
    firm = np.min(np.abs((phase[:, None] - (0.04, 0.19) + 0.5) % 1 - 0.5), axis=1) > 0.06
    open_: F64 = np.full((1500, PATCHES), 0.1 / PATCHES) * np.exp(0.3 * rng.standard_normal((1500, 1)))
    met = np.full((1500, 3), 0.1)
    light = fit.light_of(open_, met, lit, np.ones((PATCHES, 3)), np.full((1, 3), 2.0))
    color: F64 = 0.35 * np.exp(0.1 * rng.standard_normal((1500, 1))) * light
    pairs = fit.pairs_of(points, color, rng)
    every, without = (
        fit.fit(color, open_, met, seen, pairs, 0.5, [1.0], fit.Weighing(rows)).beams.mean() / 2
        for rows in (np.ones(1500, bool), firm)
    )
    assert abs(every - 1) > 0.1
    assert abs(without - 1) < 0.03


def test_the_suns_disc_is_the_median_of_those_that_explain_as_much() -> None:
    """Under the roof's edge a disc of 4 degrees: no far sharper one can be where the proxy fits. Where parts of
    the edge are elsewhere than the proxy has them one can, and the one that is taken is a tried one beside it."""
    mesh, splats = slabs(0.2)
    places = transport.places_of(splats, mesh, SETTINGS)
    floor = (places.points[:, 1] < 0.5) & (np.abs(places.points[:, [0, 2]]) < 1.8).all(axis=1)
    floor &= np.abs(places.points[:, 0]) < 0.5
    places = places.taken(np.flatnonzero(floor))
    pairs = fit.pairs_of(places.points, np.full((len(places), 3), 0.3), np.random.default_rng(0))
    up, sky = np.array([0.0, 1.0, 0.0]), np.full((PATCHES, 3), 0.3)
    given = sun.Sun(up, 4.0, np.zeros(0), 0.0, (0.35, 0.45))
    bent = replace(places, points=places.points + 0.09 * np.sin(9 * places.points[:, 2:]) * [1, 0, 0])
    found = []
    for true in (places, bent):
        beam = sun.disc(true, up, 2.0)[:, None]
        light = fit.light_of(places.open, places.met, beam, sky, np.ones((1, 3)))
        shown = replace(places, color=0.4 * light)
        found.append(sun.moved(shown, pairs, given, fit.Fitted(sky, np.ones((1, 3)), 0.0), NOTHING_SAID))
    fits, misfits = found
    assert 1 < fits.radius <= 4
    assert fits.radii[0] >= 1
    assert 1 <= misfits.radius <= 4
    assert misfits.radii[0] < 1 and misfits.radii[1] >= 2


def test_a_differences_error_is_what_other_places_would_give() -> None:
    """Losses that err alike within 32 blocks: the error told from one draw is the spread over 400 draws."""
    rng = np.random.default_rng(2)
    block = np.repeat(np.arange(32), 30)
    apart = np.array([0.0, 0.2, 0.4])[:, None] / len(block)  # far more than the noise, so the first is the best

    def draw() -> tuple[F64, F64]:
        noise = rng.standard_normal((3, 32))[:, block] + rng.standard_normal((3, len(block)))
        return sun._compared_to_best(1 + apart + 1e-4 * noise, block)

    more, error = (np.array(x) for x in zip(*(draw() for _ in range(400)), strict=True))
    np.testing.assert_allclose(more.mean(axis=0), [0, 0.2, 0.4], atol=0.005)
    np.testing.assert_allclose(np.sqrt((error**2).mean(axis=0))[1:], more.std(axis=0)[1:], rtol=0.12)


def test_blocks_are_compact_and_alike_in_size() -> None:
    points = np.random.default_rng(0).uniform(0, 1, (3200, 3)) * (4, 1, 2)
    block = sun._blocks(points)
    assert set(np.bincount(block)) == {100}
    assert max(np.ptp(points[block == k], axis=0).max() for k in range(32)) < 1.2
    assert set(sun._blocks(points[:3])) <= set(range(32))


def test_light_from_a_wide_patch_is_sky_and_no_sun() -> None:
    """A soft box of 40 degrees across: as a sun it would be taken for a disc, and the rest of the sky for too dark."""
    ways = sphere_map(32)
    box = np.where((ways @ TO_SUN > np.cos(np.radians(20)))[..., None], 8.0, 0.2) * np.ones(3)
    soft = Lighting(environment=Environment(radiance=box.astype(np.float32)))
    places = transport.places_of(painted(yard(), soft, 2400), yard(), SETTINGS)
    pairs = fit.pairs_of(places.points, places.color, np.random.default_rng(0))
    wide = sun.Sun(TO_SUN, 16.0, np.zeros(0), 0.0, (0.35, 0.45))
    best, _ = which_sun.best_of(places, pairs, [wide, None], NOTHING_SAID)
    assert best.sun is None
    assert best.light.sky[patch_of(TO_SUN)].mean() > 3 * np.median(best.light.sky)


def test_exposure_multiplies_all_of_the_light(monkeypatch: pytest.MonkeyPatch) -> None:
    of_toys(monkeypatch, rough=True)
    splats = painted(yard(), LIGHT, 700)
    plain, brighter = (estimate(splats, yard(), SETTINGS, *stops) for stops in ((), (1.0,)))
    np.testing.assert_array_equal(brighter.sun, 2 * plain.sun)
    np.testing.assert_allclose(brighter.radiance, 2 * plain.radiance, rtol=1e-6)
    np.testing.assert_array_equal(brighter.to_sun, plain.to_sun)


def test_packed_light_is_the_light() -> None:
    light = lighting_of(found().packed())
    assert light.environment is not None
    np.testing.assert_array_equal(light.environment.pixels, found().radiance.astype(np.float32))
    sun = light.lights[0]
    np.testing.assert_allclose(sun.color * sun.intensity, found().sun)


def test_a_lone_slab_says_that_its_scale_is_a_guess() -> None:
    """Nothing in its view is another surface: albedos are made 0.35 in the mean."""
    slab = boxes((np.array([-1.0, -0.5, -1]), np.array([1.0, 0.5, 1]), np.array([0.6, 0.6, 0.6])))
    lone = estimate(painted(slab, LIGHT, 900), slab, SETTINGS)
    assert lone.confidence.blocked < 0.02
    assert not lone.confidence.scale_known
    assert any("the scale is a guess" in line for line in unknown(lone))
    assert not any("the scale is a guess" in line for line in unknown(found()))
    assert any(line.startswith("sun ") for line in described(found()))


def test_what_cannot_be_estimated_is_said() -> None:
    splats = painted(yard(), LIGHT, 700)
    with pytest.raises(RenderError, match="too few to tell"):
        estimate(
            replace(splats, means=splats.means + np.float32(0.001), opacities=splats.opacities * 0), yard(), SETTINGS
        )
    closed = boxes((np.full(3, -4.0), np.full(3, 4.0), np.full(3, 0.5)))
    both = replace(
        yard(),
        vertices=np.concatenate([yard().vertices, closed.vertices]),
        faces=np.concatenate([yard().faces, closed.faces + len(yard().vertices)]),
        vertex_colors=None,
        albedo=np.full(3, 0.5),
    )
    with pytest.raises(RenderError, match="no light comes in from outside"):
        estimate(splats, both, SETTINGS)


def test_patches_share_the_sphere_and_the_map_has_them_where_they_are() -> None:
    ways = sphere(20_000)
    patch = patch_of(ways)
    assert set(patch) == set(range(PATCHES))
    values = np.arange(PATCHES * 3, dtype=float).reshape(-1, 3)
    made = Environment(radiance=as_map(values)).pixels
    rows, columns = made.shape[:2]
    v = np.degrees(np.arccos(ways[:, 1])) / 180 * rows
    u = (np.arctan2(ways[:, 2], ways[:, 0]) / (2 * np.pi) + 0.5) % 1 * columns
    inside = (np.abs(v - np.round(v)) > 0.01) & (np.abs(u - np.round(u)) > 0.01)
    at = made[np.minimum(v.astype(int), rows - 1), np.minimum(u.astype(int), columns - 1)]
    np.testing.assert_array_equal(at[inside], values[patch[inside]].astype(np.float32))


def test_a_glow_is_brightest_at_the_sun_and_leaves_patches_as_bright_as_they_are() -> None:
    values = 1 + np.arange(PATCHES * 3, dtype=float).reshape(-1, 3) % 7
    made, plain = as_map(values, TO_SUN).astype(float), as_map(values).astype(float)
    ways = sphere_map(len(made))
    patch, area = patch_of(ways).ravel(), np.sqrt(1 - ways[..., 1] ** 2).ravel()
    for k in range(3):
        whole = np.bincount(patch, area * made[..., k].ravel()) / np.bincount(patch, area)
        np.testing.assert_allclose(whole, values[:, k], rtol=1e-5)
    np.testing.assert_allclose(made[ways[..., 1] < 0], plain[ways[..., 1] < 0], rtol=1e-6)
    even = as_map(np.repeat(glow(TO_SUN)[:, None], 3, axis=1), TO_SUN)[..., 0]
    cosine = ways @ TO_SUN
    assert cosine.ravel()[even.argmax()] > np.cos(np.radians(3))
    across = (np.abs(cosine) < 0.01) & (ways[..., 1] > 0)  # of CIE S 011's sky 6: 1 at 90 degrees, 2.88 at 10
    np.testing.assert_allclose(even[across], 1, atol=0.01)
    near = np.abs(cosine - np.cos(np.radians(10))) < 2e-3
    np.testing.assert_allclose(even[near], 1 + 2 * (np.exp(-0.2618) - np.exp(-2.3562)) + 0.15 * 0.9698, atol=0.03)
