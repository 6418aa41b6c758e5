"""What a capture's cameras did not see: closed against light, where that is what its pictures say."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from mirelight.base.errors import InputError
from mirelight.lighting.sight import Sight
from mirelight.model import Camera, SplatCloud
from mirelight.proxy import MadeProxy, make
from mirelight.proxy.backs import connected_area
from mirelight.proxy.capture import look_at_capture, take
from mirelight.proxy.make import refuse_strangers
from mirelight.proxy.types import Soup
from mirelight.proxy.views import moved

from .clouds import ball, box_shell, on_surface, square

F64 = NDArray[np.float64]
SIDE = 4.0  # of a room about the origin, whose wall at +z, behind the cameras, nobody saw
EYES = ((-0.5, 0.3, 1.0), (0.0, -0.2, 1.2), (0.6, 0.1, 0.9))
CAMERAS = tuple(Camera.look_at(eye, (0.1 * k, 0, -2), 160, 120, yfov=90, name=f"{k}") for k, eye in enumerate(EYES))
WALLS = {"right": (1.0, 0.0, 0.0), "left": (-1.0, 0.0, 0.0), "floor": (0.0, -1.0, 0.0), "ceiling": (0.0, 1.0, 0.0)}


def in_pictures(points: F64) -> NDArray[np.bool_]:
    """By the formula of a pinhole, the whole pixels of all cameras."""
    out = np.zeros(len(points), bool)
    for camera in CAMERAS:
        own = (points - camera.position) @ camera.world_from_camera[:3, :3]
        ahead = -own[:, 2]
        x = camera.fx * own[:, 0] / np.maximum(ahead, 1e-9)
        y = camera.fy * own[:, 1] / np.maximum(ahead, 1e-9)
        out |= (ahead > 0) & (np.abs(x) < camera.width / 2) & (np.abs(y) < camera.height / 2)
    return out


@cache
def room() -> SplatCloud:
    """What the cameras saw of five walls."""
    whole = box_shell(SIDE, 0.08, thin=0.02, faces=(0, 1, 2, 3, 4))
    return take(whole, np.flatnonzero(in_pictures(whole.means.astype(np.float64))))


@cache
def made() -> tuple[MadeProxy, MadeProxy]:
    """Without and with cameras."""
    return make(room()), make(room(), cameras=CAMERAS)


def blocked(of: MadeProxy, starts: F64, way: F64) -> NDArray[np.bool_]:
    return Sight(of.mesh).first_hits(starts, np.broadcast_to(way, starts.shape))[0] >= 0


def beside_the_cameras(wall: F64) -> F64:
    """Places on a wall that no picture shows, no farther back than the cameras; looked at from the middle."""
    across = np.cross((0.0, 0.0, 1.0), wall)
    z, w = (x.ravel() for x in np.meshgrid(np.linspace(0.3, 0.9, 7), np.linspace(-1.0, 1.0, 5)))
    points = wall * SIDE / 2 + z[:, None] * (0, 0, 1) + w[:, None] * across
    return np.asarray(points[~in_pictures(points)])


@pytest.mark.parametrize("wall", WALLS)
def test_walls_go_on_beside_the_cameras(wall: str) -> None:
    points = beside_the_cameras(np.array(WALLS[wall]))
    assert len(points) > 5
    eye = np.array((0.0, 0.0, 0.6))
    open_, closed = (blocked(m, np.tile(eye, (len(points), 1)), points - eye) for m in made())
    assert closed.mean() > 0.9 > 0.3 > open_.mean()


def test_what_was_seen_is_as_it_was() -> None:
    """The same triangles come first, and no other stands before them in any picture."""
    open_, closed = made()
    assert closed.unseen > 0 and open_.unseen == 0
    count = len(open_.mesh.faces)
    np.testing.assert_array_equal(closed.mesh.faces[:count], open_.mesh.faces)
    before, behind = Sight(open_.mesh), Sight(closed.mesh)
    for camera in CAMERAS:
        x, y = np.meshgrid(np.linspace(-0.95, 0.95, 40), np.linspace(-0.95, 0.95, 30))
        own = np.stack(
            [x.ravel() * camera.width / 2 / camera.fx, y.ravel() * camera.height / 2 / camera.fy, -np.ones(x.size)],
            axis=1,
        )
        ways = own @ camera.world_from_camera[:3, :3].T
        was, now = (s.first_hits(camera.position, ways)[1] for s in (before, behind))
        assert (now < was - 0.05).mean() < 0.005


def test_the_space_behind_the_cameras_stays_open() -> None:
    """No picture shows whether there is a wall."""
    ways = np.stack([np.linspace(-0.2, 0.2, 9), np.zeros(9), np.ones(9)], axis=1)
    assert not blocked(made()[1], np.zeros((9, 3)), ways).any()


SLIT = 0.1  # half of its width, of which cells grow over most


@cache
def screen() -> tuple[MadeProxy, MadeProxy]:
    """A wall with a window and a narrow slit, seen from the front alone."""
    points, normals = square(4.0, 0.05, 2, 0.0)
    hole = (np.abs(points[:, 0] - 0.8) < 0.5) & (np.abs(points[:, 1]) < 0.6)
    hole |= np.abs(points[:, 0] + 0.5) < SLIT
    eyes = ((-2.0, 0.4, 5.0), (0.0, -0.3, 5.5), (2.0, 0.2, 5.0))
    cameras = [Camera.look_at(eye, (0, 0, -1), 160, 128, yfov=70, name=f"{k}") for k, eye in enumerate(eyes)]
    cloud = on_surface(points[~hole], normals[~hole], 0.035, thin=0.02)
    return make(cloud), make(cloud, cameras=cameras)


def test_a_crack_closes_and_a_window_stays_open_aslant_too() -> None:
    open_, closed = screen()
    y = np.linspace(-1.6, 1.6, 60)
    behind = np.stack([np.full(60, -0.5), y, np.full(60, -2.0)], axis=1)
    assert blocked(open_, behind, np.array((0.0, 0.0, 1.0))).mean() < 0.2
    assert blocked(closed, behind, np.array((0.0, 0.0, 1.0))).mean() > 0.9
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(0.55, 1.05, 6), np.linspace(-0.3, 0.3, 5)))
    window = np.stack([x, y, np.full(x.size, 0.05)], axis=1)
    for way in ((0.0, 0.0, -1.0), (-0.8, 0.2, -1.0), (0.8, 0.0, -1.0), (0.0, 1.0, -1.0)):  # as a sunbeam comes in
        assert not blocked(closed, window, np.array(way)).any()


def test_a_wall_goes_on_behind_what_hides_it() -> None:
    """A panel before a wall: no camera saw the wall there, and yet no light comes through."""
    deep, half = 1.2, 0.5
    wall, facing = square(4.0, 0.05, 2, 0.0)
    eyes = [np.array(eye) for eye in ((-0.5, 0.3, 6.0), (0.0, -0.3, 6.5), (0.5, 0.2, 6.0))]
    seen = np.zeros(len(wall), bool)
    for eye in eyes:
        passing = eye + (wall - eye) * ((eye[2] - deep) / eye[2])
        seen |= (np.abs(passing[:, :2]) > half).any(axis=1)
    panel = square(2 * half, 0.05, 2, deep)
    points, normals = np.concatenate([wall[seen], panel[0]]), np.concatenate([facing[seen], panel[1]])
    cameras = [Camera.look_at(eye, (0, 0, 0), 160, 128, yfov=45, name=f"{k}") for k, eye in enumerate(eyes)]
    cloud = on_surface(points, normals, 0.035, thin=0.02)
    amid = ~seen & (np.abs(wall[:, :2]) < 0.3).all(axis=1)  # cells grow into the rim
    starts = wall[amid] + (0, 0, deep / 2)
    assert len(starts) > 100
    open_, closed = (
        blocked(m, starts, np.array((0.0, 0.0, -1.0))) for m in (make(cloud), make(cloud, cameras=cameras))
    )
    assert closed.mean() > 0.9 > 0.1 > open_.mean()


def bars(eyes: tuple[tuple[float, float, float], ...]) -> tuple[MadeProxy, MadeProxy]:
    """The front of an upright bar, its plane z = 0 and half as wide as 0.2, looked at from places."""
    y, x = (a.ravel() for a in np.meshgrid(np.arange(-1.0, 1.0, 0.04), np.arange(-0.18, 0.2, 0.04)))
    cloud = on_surface(np.stack([x, y, 0 * x], axis=1), np.tile((0.0, 0.0, 1.0), (len(x), 1)), 0.028, thin=0.02)
    cameras = [Camera.look_at(eye, (0, 0, 0), 200, 160, yfov=50, name=f"{k}") for k, eye in enumerate(eyes)]
    return make(cloud), make(cloud, cameras=cameras)


FRONT = ((-0.4, 0.2, 3.0), (0.0, -0.2, 3.2), (0.4, 0.1, 3.0))


def test_a_bar_of_which_the_front_was_seen_has_a_depth_for_light_from_the_side() -> None:
    y = np.linspace(-0.7, 0.7, 30)
    past_the_edge = np.stack([np.full(30, 0.26), y, np.zeros(30)], axis=1)
    open_, closed = (blocked(m, past_the_edge, np.array((-1.4, 0.0, -1.0))) for m in bars(FRONT))
    assert closed.mean() > 0.9 > 0.1 > open_.mean()


def test_a_sheet_that_was_seen_from_both_sides_stays_as_thin_as_it_is() -> None:
    behind = tuple((x, y, -z) for x, y, z in FRONT)
    assert bars(FRONT)[1].unseen > 0 == bars(FRONT + behind)[1].unseen


def test_pieces_of_a_second_sheet_are_as_large_as_what_they_are_connected_with() -> None:
    """Two triangles with a common side, one that is left out between them and a third, and one alone."""
    x = np.array([(0, 0), (1, 0), (0, 1), (1, 1), (2, 1), (3, 1), (2, 4), (9, 9), (9, 7), (7, 9)], np.float64)
    faces = np.array([(0, 1, 2), (1, 3, 2), (1, 4, 3), (4, 5, 6), (7, 8, 9)])
    soup = Soup(np.column_stack([x, 0 * x[:, 0]]), faces)
    np.testing.assert_allclose(connected_area(soup, np.array([0, 1, 3, 4])), [1, 1, 1.5, 2])
    np.testing.assert_allclose(connected_area(soup, np.arange(5)), [3, 3, 3, 3, 2])


@cache
def ceilings() -> tuple[MadeProxy, MadeProxy]:
    """A ceiling that meets a wall, a beam below it, and a shelf below that which ends before the wall.

    The beam hides the ceiling up to the wall, past the shelf the wall is seen, and behind the wall there is nothing.
    """
    wide, fine = 3.0, 0.06
    ceiling, _ = square(wide, fine, 1, 2.0)
    shelf = ceiling - (0, 2.0, 0)
    shelf = shelf[shelf[:, 0] > -1.0]
    y, z = (a.ravel() for a in np.meshgrid(np.arange(1.75, 2.0, fine), np.arange(-1.48, 1.5, fine)))
    beam = np.stack([np.full(y.size, -1.1), y, z], axis=1)
    y, z = (a.ravel() for a in np.meshgrid(np.arange(-1.0, 2.0, fine), np.arange(-1.48, 1.5, fine)))
    wall = np.stack([np.full(y.size, -1.5), y, z], axis=1)
    seen = ceiling[:, 0] > -1.1
    up, ahead = (0.0, 1.0, 0.0), (1.0, 0.0, 0.0)
    points = np.concatenate([ceiling[seen], shelf, beam, wall])
    normals = np.concatenate([np.tile(n, (len(x), 1)) for n, x in ((up, ceiling[seen]), (up, shelf), (ahead, beam))])
    normals = np.concatenate([normals, np.tile(ahead, (len(points) - len(normals), 1))])
    cameras = [
        Camera.look_at((3.0, 0.9, side), (-1.2, 0.9, 0), 200, 160, yfov=70, name=f"{side}") for side in (-1.0, 0, 1.0)
    ]
    cameras.append(Camera.look_at((-4.5, 0.9, 0), (-1.5, 1.5, 0), 200, 160, yfov=70, name="behind"))
    cloud = on_surface(points, normals, 0.7 * fine, thin=0.02)
    return make(cloud), make(cloud, cameras=cameras)


def test_a_ceiling_goes_on_behind_a_beam_to_the_wall() -> None:
    z = np.linspace(-1.2, 1.2, 40)
    starts = np.stack([np.full(40, -1.3), np.full(40, 1.8), z], axis=1)
    open_, closed = (blocked(m, starts, np.array((0.0, 1.0, 0.0))) for m in ceilings())
    assert closed.mean() > 0.9 > 0.1 > open_.mean()


def test_a_plane_that_is_seen_to_end_does_not_go_on_to_the_wall() -> None:
    z = np.linspace(-1.2, 1.2, 40)
    starts = np.stack([np.full(40, -1.25), np.full(40, -0.3), z], axis=1)
    hit, far = Sight(ceilings()[1].mesh).first_hits(starts, np.tile((0.0, 1.0, 0.0), (40, 1)))
    assert (far[hit >= 0] > 1).all()


@cache
def alcove() -> MadeProxy:
    """A wall, and a smaller ceiling, seen up to where a deep beam hides how they meet; a panel far behind."""
    fine = 0.06
    z = np.arange(-1.48, 1.5, fine)

    def sheet(first: F64, second: F64, place: Callable[[F64, F64], tuple[F64, F64]]) -> F64:
        a, along = (x.ravel() for x in np.meshgrid(first, z))
        return np.stack([*place(a, second), along], axis=1)

    ceiling = sheet(np.arange(-1.1, 0.5, fine), np.array(2.0), lambda x, y: (x, np.full_like(x, y)))
    upright = [(-1.1, 1.2, 2.0), (-1.5, -1.0, 1.2), (-6.0, 0.0, 0.5)]  # beam, wall, panel
    parts = [ceiling] + [
        sheet(np.arange(a, b, fine), np.array(x), lambda y, x: (np.full_like(y, x), y)) for x, a, b in upright
    ]
    normals = [np.tile(n, (len(p), 1)) for p, n in zip(parts, [(0.0, 1.0, 0.0)] + 3 * [(1.0, 0.0, 0.0)], strict=True)]
    cameras = [Camera.look_at((3.0, 0.9, k), (-1.2, 0.9, 0), 200, 160, yfov=70, name=f"{k}") for k in (-1.0, 0.0, 1.0)]
    return make(on_surface(np.concatenate(parts), np.concatenate(normals), 0.7 * fine, thin=0.02), cameras=cameras)


def test_a_ceiling_meets_a_wall_that_nobody_saw_there_either() -> None:
    starts = np.stack([np.full(40, -1.3), np.full(40, 1.6), np.linspace(-1.2, 1.2, 40)], axis=1)
    for way in ((0.0, 1.0, 0.0), (-1.0, 0.0, 0.0)):
        assert blocked(alcove(), starts, np.array(way)).mean() > 0.9


def test_what_closes_planes_is_of_few_triangles() -> None:
    """Behind the wall with its window and its slit there is all of it once more, but not in as many pieces."""
    open_, closed = screen()
    assert 0 < closed.unseen < 0.15 * len(open_.mesh.faces)
    area = (
        np.linalg.norm(np.cross(*np.diff(closed.mesh.vertices[closed.mesh.faces], axis=1).swapaxes(0, 1)), axis=1) / 2
    )
    assert area[-closed.unseen :].sum() > 0.8 * (16 - 1.2)


def test_a_second_sheet_is_coarse_behind_round_things_too() -> None:
    """Of a half of a ball that was seen from one side: what is moved back has fewer and larger triangles."""
    k = np.arange(2500) + 0.5
    z, turn = 1 - k / len(k), k * np.pi * (3 - np.sqrt(5))
    ways = np.stack([np.sqrt(1 - z * z) * np.cos(turn), np.sqrt(1 - z * z) * np.sin(turn), z], axis=1)
    cameras = [Camera.look_at((x, 0.2, 6), (0, 0, 0), 160, 128, yfov=30, name=f"{x}") for x in (-0.3, 0.0, 0.3)]
    made = make(on_surface(ways, ways, 0.04, thin=0.02), cameras=cameras)
    seen = len(made.mesh.faces) - made.unseen
    assert 0 < made.unseen < 0.6 * seen
    back = made.mesh.vertices[np.unique(made.mesh.faces[seen:])]
    assert (np.linalg.norm(back, axis=1) < 0.95).all()


def test_cameras_of_something_else_are_refused() -> None:
    away = [Camera.look_at((0, 0, 30), (0, 0, 60), 64, 48, yfov=40, name="away")]
    with pytest.raises(InputError, match="its 1 cameras have 0% of it in their pictures"):
        make(room(), cameras=away)


def test_cameras_are_not_refused_for_floaters_past_their_pictures() -> None:
    """Ten for each splat of a ball, in a space that is twenty times as wide."""
    rng, thing = np.random.default_rng(0), ball(1000)
    n = rng.normal(size=(10_000, 3))
    far = on_surface(rng.uniform(-20, 20, n.shape), n / np.linalg.norm(n, axis=1)[:, None], 0.04, thin=0.5)
    cloud = SplatCloud(
        means=np.concatenate([thing.means, far.means]),
        quats=np.concatenate([thing.quats, far.quats]),
        scales=np.concatenate([thing.scales, far.scales]),
        opacities=np.concatenate([thing.opacities, far.opacities]),
        sh=np.concatenate([thing.sh, far.sh]),
    )
    capture = look_at_capture(cloud, "splats")
    for target, right in (((0, 0, 0), True), ((0, 0, 40), False)):
        eye = (0, 0, 5 if right else 30)
        cameras = [moved(Camera.look_at(eye, target, 96, 72, yfov=35), -capture.middle)]
        if right:
            refuse_strangers(capture, cameras, "splats")
        else:
            with pytest.raises(InputError, match="of it in their pictures"):
                refuse_strangers(capture, cameras, "splats")


def test_the_same_bits_every_time() -> None:
    again = make(room(), cameras=CAMERAS).mesh
    np.testing.assert_array_equal(again.vertices, made()[1].mesh.vertices)
    np.testing.assert_array_equal(again.faces, made()[1].mesh.faces)
