"""Rooms whose pictures end below their ceiling: one is guessed; not over a yard, whose walls are seen to end."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mirelight.apps.first_job import view
from mirelight.base.progress import quiet
from mirelight.lighting.sight import Sight
from mirelight.model import Camera
from mirelight.proxy import make
from mirelight.proxy.beyond import box_of
from mirelight.proxy.capture import take
from mirelight.proxy.ceiling import Ceiling, ceiling_of
from mirelight.proxy.depth import DepthMap
from mirelight.proxy.pictures import Pictures
from mirelight.proxy.planes import planes_of
from mirelight.proxy.types import ProxySettings, Soup
from mirelight.proxy.unseen import closing
from mirelight.proxy.views import rays

from .clouds import box_shell

HALF, CELL = 2.0, 0.1  # a floor at y = 0, 4 x 4, its walls as high as they are seen


def wall(low: np.ndarray, along: np.ndarray, up: np.ndarray) -> Soup:
    """A rectangle in cells of about 0.1."""
    n, m = (round(float(np.linalg.norm(x)) / 0.1) for x in (along, up))
    s, t = np.meshgrid(np.linspace(0, 1, n + 1), np.linspace(0, 1, m + 1), indexing="ij")
    i = np.arange((n + 1) * (m + 1)).reshape(n + 1, m + 1)
    a, b, c, d = i[:-1, :-1], i[1:, :-1], i[1:, 1:], i[:-1, 1:]
    faces = np.concatenate([np.stack(x, -1).reshape(-1, 3) for x in ((a, b, c), (a, c, d))])
    return Soup(low + s.reshape(-1, 1) * along + t.reshape(-1, 1) * up, faces)


def room(high: float, sides: int = 4) -> Soup:
    """A floor and walls around it, fronts inwards."""
    x, y, z = np.eye(3)
    out = wall(-HALF * x + HALF * z, 2 * HALF * x, -2 * HALF * z)
    for k in range(sides):
        turn = np.round(np.array([[np.cos(a), 0, np.sin(a)] for a in (k * np.pi / 2, (k + 1) * np.pi / 2)]))
        out = out.beside(wall(HALF * turn[0] - HALF * turn[1], 2 * HALF * turn[1], high * y))
    return out


def looking_down(aim: float) -> list[Camera]:
    """A walk round a table."""
    turns = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    return [
        Camera.look_at((1.2 * np.cos(a), 1.5, 1.2 * np.sin(a)), (0, aim, 0), 120, 80, yfov=50, name=f"{k}")
        for k, a in enumerate(turns)
    ]


def guessed(soup: Soup, cameras: list[Camera]) -> Ceiling | None:
    pictures = Pictures.of(cameras, Sight(soup.mesh()))
    return ceiling_of(soup, planes_of(soup, CELL, 0.1), pictures, CELL)


def test_a_room_gets_a_ceiling_a_third_higher_than_its_cameras() -> None:
    found = guessed(room(1.8), looking_down(0.8))
    assert found is not None
    np.testing.assert_allclose(found.up, [0, 1, 0], atol=1e-6)
    assert found.height == pytest.approx(4 / 3 * 1.5, abs=0.05)
    assert len(found.walls) == 4


@pytest.mark.parametrize(
    ("soup", "aim"),
    [
        pytest.param(room(1.3), 1.3, id="walls that end in the pictures"),
        pytest.param(room(1.8, sides=3), 0.8, id="a side without a wall"),
        pytest.param(room(0.0, sides=0), 0.8, id="a floor alone"),
        pytest.param(room(3.0), 2.6, id="cameras that look up"),
        pytest.param(room(3.4), 0.8, id="a courtyard: walls twice as high as the cameras"),
    ],
)
def test_others_get_none(soup: Soup, aim: float) -> None:
    assert guessed(soup, looking_down(aim)) is None


def test_no_light_comes_from_above_and_the_window_stays_open() -> None:
    """A window that the pictures show from 1.0 to 1.6; above it they end, and there the wall is closed."""
    soup = room(1.8)
    middle = soup.vertices[soup.faces].mean(axis=1)
    pane = (middle[:, 0] > HALF - 0.01) & (np.abs(middle[:, 2]) < 0.5) & (middle[:, 1] > 1.0)
    soup = Soup(soup.vertices, soup.faces[~pane])
    added = closing(soup, Sight(soup.mesh()), looking_down(1.0), 0.03, quiet)
    assert added.ceiling is not None
    sight = Sight(soup.beside(added.soup).mesh())
    rng = np.random.default_rng(2)
    ways = rng.normal(size=(2000, 3))
    ways[:, 1] = np.abs(ways[:, 1]) + 0.5 * np.hypot(ways[:, 0], ways[:, 2])
    assert sight.blocked(np.array([0.0, 1.0, 0.0]), ways).all()
    through = np.array([[HALF, y, z] for y in (1.1, 1.3) for z in (-0.3, 0.0, 0.3)]) - (0, 1.2, 0)
    assert not sight.blocked(np.array([0.0, 1.2, 0.0]), through).any()
    over = np.array([[HALF, y, z] for y in (1.85, 1.95) for z in (-0.3, 0.0, 0.3)]) - (0, 1.0, 0)
    assert sight.blocked(np.array([0.0, 1.0, 0.0]), over).all()


def test_no_slit_is_left_where_pictures_end() -> None:
    """They end within cells of the walls above them: all that no picture shows of a wall is closed."""
    soup, cameras = room(1.8), looking_down(0.8)
    planes, pictures = planes_of(soup, CELL, 0.1), Pictures.of(cameras, Sight(soup.mesh()))
    found = ceiling_of(soup, planes, pictures, CELL)
    assert found is not None
    above = found.soup(planes, *found.box(*box_of(soup, pictures.eyes)), CELL, pictures)
    at = np.random.default_rng(3).uniform((HALF, 0.5, -1.9), (HALF, 1.75, 1.9), (4000, 3))
    _, shown = pictures.states(at.astype(np.float32), 0.0)
    assert 0.1 < shown.mean() < 0.9
    sight, out = Sight(above.mesh()), np.array([[1.0, 0, 0]])
    assert all(sight.blocked(point - (0.05, 0, 0), out).all() for point in at[~shown][:500])


def test_nothing_was_seen_through_a_gap_where_splats_show_something() -> None:
    soup = room(1.8)
    middle = soup.vertices[soup.faces].mean(axis=1)
    gap = (middle[:, 0] > HALF - 0.01) & (np.hypot(middle[:, 1] - 1.0, middle[:, 2]) < 0.3)
    camera = Camera.look_at((0, 1, 0), (1, 1, 0), 120, 80, yfov=50)
    whole, pierced = (Sight(x.mesh()) for x in (soup, Soup(soup.vertices, soup.faces[~gap])))
    behind = np.array([[3.0, 1.0, 0.0]], np.float32)
    assert Pictures.of([camera], pierced).states(behind, 0.0)[0].all()
    origins, ways = rays(camera)
    _, far = whole.first_hits(np.broadcast_to(origins, ways.shape).reshape(-1, 3), ways.reshape(-1, 3))
    one = np.ones((80, 120), np.float32)
    three = np.zeros((80, 120, 3), np.float32)
    seen = DepthMap(camera, three, one, far.reshape(80, 120).astype(np.float32), three, one, one)
    free, shown = Pictures.of([camera], pierced, [seen]).states(behind, 0.0)
    assert shown.all() and not free.any()
    nothing = replace(seen, depth=np.zeros_like(seen.depth))  # opaque, and nobody knows how far away
    free, shown = Pictures.of([camera], pierced, [nothing]).states(behind, 0.0)
    assert not shown.any() and not free.any()


def test_a_proxy_of_splats_says_how_high_and_can_go_without() -> None:
    """Discs on a floor and four walls, as far up as pictures show them."""
    whole = box_shell(4.0, 0.08, thin=0.02, faces=(0, 1, 2, 4, 5))
    cloud = take(whole, np.flatnonzero(whole.means[:, 1] < -0.3))
    cameras = [replace(x, world_from_camera=lowered(x.world_from_camera)) for x in looking_down(0.8)]
    made, without = (make(cloud, ProxySettings(ceiling=x), cameras=cameras) for x in (True, False))
    assert made.ceiling == pytest.approx(4 / 3 * 1.5, abs=0.1)
    assert without.ceiling is None
    up = np.array([[0.0, 1, 0]])
    assert [bool(Sight(x.mesh).blocked(np.array([0.5, -1, 0.5]), up)[0]) for x in (made, without)] == [True, False]


def lowered(matrix: np.ndarray) -> np.ndarray:
    """By two, as the shell's floor lies there."""
    out = matrix.copy()
    out[1, 3] -= 2
    return out


def test_a_first_job_takes_walls_all_round_for_a_room() -> None:
    """Not where a side is open, nor where a picture shows what is above."""
    whole = box_shell(4.0, 0.08, thin=0.02, faces=(0, 1, 2, 4, 5))
    open_ = box_shell(4.0, 0.08, thin=0.02, faces=(0, 2, 4))
    low, up = (
        [replace(x, world_from_camera=lowered(x.world_from_camera)) for x in looking_down(y)] for y in (0.8, 3.0)
    )
    seen = [view.best(cloud, "room.ply", cameras).room for cloud, cameras in ((whole, low), (open_, low), (whole, up))]
    assert seen == [True, False, False]


def test_no_side_is_closed_as_a_ceiling() -> None:
    """Three walls, a floor and a roof before cameras that look at the middle wall: behind them it stays open."""
    roof = wall(np.array([-HALF, 1.8, -HALF]), np.array([2 * HALF, 0, 0]), np.array([0, 0, 2 * HALF]))
    cameras = [Camera.look_at((0.4 * k, 1.0, -1.5), (0.2 * k, 0.8, 2), 120, 80, yfov=50) for k in range(-2, 3)]
    assert guessed(room(1.8, sides=3).beside(roof), cameras) is None


def test_guessed_views_end_where_splats_show_nothing() -> None:
    camera = Camera.look_at((0, 1, 0), (1, 2, 0), 120, 80, yfov=50)
    above = np.array([[1.0, 2.0, 0.0]], np.float32)
    pictures = Pictures.of([camera], Sight(room(1.3).mesh()))
    assert pictures.states(above, 0.0)[1].all()
    none, three = np.zeros((40, 60), np.float32), np.zeros((40, 60, 3), np.float32)
    seen = DepthMap(camera.scaled(0.5), three, none, none, three, none, none)
    assert not np.any(pictures.opaque([seen]).states(above, 0.0))
