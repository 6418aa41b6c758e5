"""A thing amid its surroundings, whose splats lie much closer than theirs, has cells of its own."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from mirelight.base.progress import ShareProgress
from mirelight.model import Camera, SplatCloud
from mirelight.proxy import make
from mirelight.proxy.capture import look_at_capture
from mirelight.proxy.depth import DepthMap
from mirelight.proxy.detail import Core, core_of, with_core, without_fog
from mirelight.proxy.flats import Flat
from mirelight.proxy.skies import Sky
from mirelight.proxy.tuning import TUNING
from mirelight.proxy.types import ProxySettings, Soup
from mirelight.proxy.views import moved, rays

from .clouds import F64, ball, box_shell, joined, on_surface, square

RADIUS = 0.3  # of the thing
STEP = 0.14  # of the ground's splats, 9 x 9
SETTINGS = ProxySettings(method="depth")


def small_ball(count: int) -> SplatCloud:
    """It touches the ground at y = 0."""
    big = ball(count)
    means = (RADIUS * big.means + np.array([0, RADIUS, 0])).astype(np.float32)
    return replace(big, means=means, scales=RADIUS * big.scales)


def yard(count: int) -> SplatCloud:
    points, normals = square(9.0, STEP, 1, 0.0)
    return joined(on_surface(points, normals, 0.7 * STEP, thin=0.3), small_ball(count))


def walk() -> list[Camera]:
    """Round the ball; the ground's ends are in some pictures each."""
    turns = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    return [
        Camera.look_at((1.6 * np.cos(a), 0.9, 1.6 * np.sin(a)), (0, RADIUS, 0), 180, 120, yfov=45, name=f"{k}")
        for k, a in enumerate(turns)
    ]


def core(cloud: SplatCloud, cameras: list[Camera], coarser: float = 1) -> tuple[Core | None, F64]:
    capture = look_at_capture(cloud, "test")
    there = [moved(x, -capture.middle) for x in cameras]
    return core_of(capture, there, coarser * capture.spacing), capture.middle


def test_what_most_pictures_show_is_found_with_its_spacing() -> None:
    found, middle = core(yard(3000), walk())
    assert found is not None
    ball_ = small_ball(3000).means - middle
    assert found.holds(ball_.astype(np.float64), 0.02).all()
    assert (found.high - found.low)[[0, 2]].max() < 4.5  # of 9
    assert found.spacing < 0.5 * STEP


@pytest.mark.parametrize(
    ("cloud", "cameras"),
    [
        pytest.param(yard(60), walk(), id="a thing no finer than its surroundings"),
        pytest.param(
            box_shell(4.0, 0.1, thin=0.3),
            [Camera.look_at((0, 0, 0), (np.cos(a), 0, np.sin(a)), 120, 80, yfov=50) for a in np.arange(0, 6.2, 0.4)],
            id="a room from its midst",
        ),
    ],
)
def test_nothing_is_looked_at_closer_where_all_is_as_fine(cloud: SplatCloud, cameras: list[Camera]) -> None:
    assert core(cloud, cameras)[0] is None


def test_a_thing_is_looked_at_closer_where_the_grid_is_coarse() -> None:
    """As it is where stray splats lie far off all round: the thing's splats need not be closer than others."""
    points, normals = square(9.0, 0.5 * STEP, 1, 0.0)
    even = joined(on_surface(points, normals, 0.35 * STEP, thin=0.3), small_ball(230))
    assert core(even, walk())[0] is None
    there, _ = core(even, walk(), coarser=4)
    assert there is not None and there.spacing == look_at_capture(even, "test").spacing


def test_what_all_turn_to_is_looked_at_closer_before_a_wall(monkeypatch: pytest.MonkeyPatch) -> None:
    """Cameras on one side of a thing all show the wall behind it, too, whose splats lie apart."""
    points, normals = square(20.0, STEP, 2, -8.0)
    scene = joined(on_surface(points, normals, 0.7 * STEP, thin=0.3), small_ball(3000))
    turns = np.linspace(-0.6, 0.6, 12)
    front = [Camera.look_at((1.6 * np.sin(a), 0.5, 1.6 * np.cos(a)), (0, RADIUS, 0), 180, 120, yfov=45) for a in turns]
    found, middle = core(scene, front)
    assert found is not None
    assert found.holds(small_ball(3000).means - middle, 0.02).all()
    assert found.low[2] + middle[2] > -1.0  # the wall is left out
    assert found.spacing < 0.5 * STEP
    monkeypatch.setattr(sys.modules["mirelight.proxy.detail"], "_turned_to", lambda _: None)
    assert core(scene, front)[0] is None


def test_planes_go_on_beside_a_core() -> None:
    """Where it has none of their cells, so that fog before them there is known for theirs."""
    axes = np.array([[1.0, 0, 0], [0, 0, 1]])
    flat = Flat(np.array([0.0, 1, 0]), 0.0, axes, 0.5, np.array([-8, -8]), np.ones((16, 16), bool))
    box = Core(np.array([-1.0, -1, -2]), np.array([1.0, 1, 2]), (), 0.1)
    left = box.beside(flat)
    inside = (np.abs(flat.middles[:, [0, 2]]) < [1, 2]).all(axis=1).reshape(16, 16)
    assert inside.sum() == 32 and (left.there == ~inside).all()
    up = np.array([0.0, 2, 0])
    assert Core(box.low + up, box.high + up, (), 0.1).beside(flat).there.all()


def test_what_hangs_in_the_air_and_is_not_sure_is_fog() -> None:
    """Two squares apart, of the same views: one that they are sure of at a rim alone, one that they are not."""
    points, _ = square(1.0, 0.02, 1, 0.0)
    camera = Camera.look_at((0, 3, 0.1), (0, 0, 0), 200, 200, yfov=40)
    origins, ways = rays(camera)
    depth = (-origins[..., 1] / ways[..., 1]).astype(np.float32)
    at = origins + ways * depth[..., None]
    trust = np.where((at[..., 0] > 0.4) & (at[..., 0] < 0.5), 1, 0.01).astype(np.float32)
    up = np.broadcast_to(np.array([0, 1, 0], np.float32), (200, 200, 3))
    one = np.ones((200, 200), np.float32)
    view = DepthMap(camera=camera, depth=depth, normal=up, trust=trust, spread=0 * one, color=up, alpha=one)
    i = np.arange(len(points)).reshape(50, 50)
    corners = (i[:-1, :-1], i[1:, :-1], i[1:, 1:]), (i[:-1, :-1], i[1:, 1:], i[:-1, 1:])
    faces = np.concatenate([np.stack(c, -1).reshape(-1, 3) for c in corners])
    sure, fog = Soup(points, faces), Soup(points + np.array([0, 0.5, 0]), faces)
    left = without_fog(sure.beside(fog), [view], 0.02)
    assert len(left.faces) == len(faces) and (left.vertices[:, 1] == 0).all()


def test_a_core_takes_the_place_of_what_was_there() -> None:
    x = np.linspace(-2, 2, 41)
    u, v = np.meshgrid(x, x, indexing="ij")
    i = np.arange(41 * 41).reshape(41, 41)
    faces = np.concatenate(
        [
            np.stack(c, -1).reshape(-1, 3)
            for c in ((i[:-1, :-1], i[1:, :-1], i[1:, 1:]), (i[:-1, :-1], i[1:, 1:], i[:-1, 1:]))
        ]
    )
    whole, fine = (Soup(np.stack([u.ravel(), np.full(u.size, h), v.ravel()], -1), faces) for h in (0.0, 0.01))
    made = with_core(whole, fine, Core(np.full(3, -1.0), np.full(3, 1.0), (), 0.05), 0.1)
    middle = made.vertices[made.faces].mean(axis=1)
    inside, fine_ = (np.abs(middle[:, [0, 2]]) < 0.85).all(axis=1), middle[:, 1] > 0.005
    assert fine_[inside].all() and not fine_[(np.abs(middle[:, [0, 2]]) > 1).any(axis=1)].any()
    for k in range(2):  # along a line through the middle nothing is missing
        on = np.abs(middle[:, 2 * (1 - k)]) < 0.1
        assert np.diff(np.sort(middle[on, 2 * k])).max() < 0.1


def test_a_small_thing_is_round_on_a_wide_ground(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its radius, where the surface stands free of the ground: off by a third of what it was off, and less."""
    off = []
    for found in (True, False):
        with monkeypatch.context() as patch:
            if not found:
                patch.setattr(sys.modules["mirelight.proxy.make"], "core_of", lambda *_: None)
            made = make(yard(3000), SETTINGS, cameras=walk())
        at = made.mesh.vertices[np.unique(made.mesh.faces[: len(made.mesh.faces) - made.unseen])].astype(np.float64)
        away = np.linalg.norm(at - [0, RADIUS, 0], axis=1)
        near = (away < 2 * RADIUS) & (at[:, 1] > 0.25)
        off.append(float(np.median(np.abs(away[near] - RADIUS))))
    assert off[0] < off[1] / 3


def test_what_most_pictures_show_has_no_sky(monkeypatch: pytest.MonkeyPatch) -> None:
    """Smooth plastic tells no place, as a sky does: under one, pixels of it are left out of the whole surface alone."""
    made_of = sys.modules["mirelight.proxy.make"]
    found = []
    flattened = made_of._on_planes

    def heard(
        views: list[DepthMap],
        flats: list[Flat],
        spacing: float,
        sky: Sky,
        report: ShareProgress,
        walls: Sequence[int] = (),
    ) -> object:
        found.append(sky.fog)
        return flattened(views, flats, spacing, sky, report, walls)

    monkeypatch.setattr(made_of, "_on_planes", heard)
    monkeypatch.setattr(made_of, "fog_of", lambda *_: TUNING.fog)
    make(yard(3000), SETTINGS, cameras=walk())
    assert found == [TUNING.fog, 0.0]
