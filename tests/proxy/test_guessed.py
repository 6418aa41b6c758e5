"""Where a capture was taken from, told by view-dependent colours whose cameras are known, and without such colours."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mirelight.apps.first_job import job_for
from mirelight.apps.first_job.view import best
from mirelight.base import sh
from mirelight.base.conventions import compose, rotation_from_euler, rotation_from_quaternion
from mirelight.compositor import Compositor
from mirelight.io import job as jobs
from mirelight.io import splats
from mirelight.lighting.sight import Sight
from mirelight.model import F64, Camera, Deferred, OwnSplats, SplatCloud, digest
from mirelight.pipeline import guesses, provenance
from mirelight.pipeline.cache import UserCache
from mirelight.pipeline.codecs import Codec
from mirelight.pipeline.scene import prepare
from mirelight.proxy import ProxySettings, make
from mirelight.proxy.capture import Capture, look_at_capture, take
from mirelight.proxy.clear import ClearSplats
from mirelight.proxy.guess_tuning import GUESS
from mirelight.proxy.guessed import guessed, taken_from
from mirelight.proxy.views import lattice, moved

from .clouds import ball, box_shell, joined, on_surface, sphere_points, square

SETTINGS = ProxySettings()
FEW = replace(GUESS, guess_sample=600)
RING = np.stack(
    [2.2 * np.sin(np.arange(24) * np.pi / 12), np.full(24, 1.0), 2.2 * np.cos(np.arange(24) * np.pi / 12)], 1
)

WALLS = box_shell(8.0, 0.4, thin=0.3, faces=(0, 1, 4, 5))  # what stands round it


@pytest.fixture(autouse=True)
def fewer(monkeypatch: pytest.MonkeyPatch) -> None:
    """A seventh of the splats is asked: these scenes have little noise."""
    monkeypatch.setattr("mirelight.proxy.guessed.GUESS", FEW)


def thing() -> SplatCloud:
    """A ball on a floor."""
    floor, up = square(5.0, 0.1, 1, 0.0)
    ball = sphere_points(1500)
    points = np.concatenate([floor, 0.5 * ball + np.array([0, 0.5, 0])])
    return on_surface(points, np.concatenate([up, ball]), 0.05, thin=0.3)


def coloured(cloud: SplatCloud, eyes: F64, *, closed: bool = True) -> SplatCloud:
    """With colours that steps down a gradient from none give, each camera pulling in its own direction by chance.

    Of what is `closed`, splats that turn their backs to a camera are not seen by it.
    """
    normals = rotation_from_quaternion(cloud.quats)[:, :, 2]
    chance = np.random.default_rng(3)
    rest = np.zeros((len(cloud), 15, 3))
    for eye in eyes:
        way = cloud.means - eye
        way /= np.linalg.norm(way, axis=1, keepdims=True)
        seen = np.where(closed & ((way * normals).sum(axis=1) > 0), 0.0, 1.0)[:, None, None]
        rest += seen * sh.basis(way, 3)[:, 1:, None] * chance.normal(size=(len(cloud), 1, 3))
    return replace(cloud, sh=np.concatenate([cloud.sh[:, :1], 0.02 * rest], axis=1).astype(np.float32))


def found(cloud: SplatCloud) -> tuple[Capture, tuple[Camera, ...]]:
    capture = look_at_capture(cloud, "here")
    return capture, tuple(moved(x, capture.middle) for x in guessed(cloud, capture, SETTINGS))


def test_a_ring_about_a_thing_is_found_again() -> None:
    _, cameras = found(coloured(thing(), RING))
    eyes = np.array([x.position for x in cameras])
    away = np.linalg.norm(eyes[:, None] - RING, axis=2).min(axis=1)
    assert len(cameras) > 20
    assert eyes[:, 1].min() > 0.3  # none beneath the floor
    assert np.median(away) < 0.8  # of a ring 2.2 wide
    turn = np.degrees(np.arctan2(eyes[:, 0], eyes[:, 2])) % 360
    assert len(np.unique(turn // 45)) >= 7  # from all around
    down = np.array([-x.world_from_camera[1, 2] for x in cameras])
    assert np.mean(down < 0) > 0.8


def test_a_thing_alone_is_looked_at_as_a_whole() -> None:
    """How far off people stood is not told where nothing stands round it; on which sides they stood is."""
    whole = thing()
    cut = take(whole, np.flatnonzero(np.linalg.norm(whole.means - (0, 0.5, 0), axis=1) < 0.8))
    capture, cameras = found(coloured(cut, RING))
    eyes = np.array([x.position for x in cameras]) - capture.middle
    away = np.linalg.norm(eyes, axis=1)
    sides = RING - (0, 0.5, 0)
    cosine = eyes / away[:, None] @ (sides / np.linalg.norm(sides, axis=1, keepdims=True)).T
    assert np.abs(away / capture.radius - GUESS.guess_away[-1]).max() < 1e-6
    assert np.degrees(np.arccos(np.median(cosine.max(axis=1)))) < 20


def test_a_room_is_looked_at_from_inside() -> None:
    shell = box_shell(4.0, 0.08, thin=0.3)
    inside = np.random.default_rng(5).uniform(-0.8, 0.8, (30, 3))
    _, cameras = found(coloured(shell, inside, closed=False))
    assert cameras
    assert np.abs([x.position for x in cameras]).max() < 1.8


def test_one_side_alone_is_looked_at_from_there() -> None:
    front = RING[RING[:, 2] > 0.5]
    _, cameras = found(coloured(thing(), front))
    assert np.median([x.position[2] for x in cameras]) > 0.8


def junk(points: F64) -> SplatCloud:
    """Large faint splats where no picture told an optimiser what there is."""
    faint = on_surface(points, np.tile([0.0, 0.0, 1.0], (len(points), 1)), 0.3, thin=1.0, opacity=0.4)
    return replace(faint, quats=np.tile(np.array([1, 0, 0, 0], np.float32), (len(points), 1)))


def test_where_colours_tell_nothing_it_is_told_by_how_clear_things_look(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mirelight.proxy.guessed.GUESS", replace(FEW, clear_grid=7, clear_fewest=0, guess_tried=48))
    ground = junk(np.random.default_rng(2).uniform((-2.4, -0.6, -2.4), (2.4, -0.1, 2.4), (800, 3)))
    _, cameras = found(joined(thing(), ground))
    eyes = np.array([x.position for x in cameras])
    assert len(cameras) > 20
    assert eyes[:, 1].min() > 0.1  # none beneath the floor
    assert np.linalg.norm(eyes - [0, 0.5, 0], axis=1).min() > 0.5  # nor in the ball


def flat(step: float) -> SplatCloud:
    """Four rooms in a row, with walls of their own."""
    room = box_shell(1.9, step, thin=0.3)
    return joined(*(replace(room, means=room.means + np.array([x, 0, 0], np.float32)) for x in (-3, -1, 1, 3)))


def test_rooms_of_many_splats_look_clear_inside_and_their_walls_do_not(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mirelight.proxy.clear.GUESS", replace(GUESS, clear_splats=12_000))
    capture = look_at_capture(flat(0.03), "flat")
    clear = ClearSplats(capture, ProxySettings())
    for place in ((1, 0, 0), (3, 0.3, 0.2)):
        assert clear.worth(np.array(place) - capture.middle) > 0.9
    for place in ((0, 0, 0), (1, 1.3, 0), (-3, 0, -1.4)):  # in a wall, above the ceiling, outside
        assert clear.worth(np.array(place) - capture.middle) < 0.2


def test_colours_that_are_as_large_in_all_directions_tell_nothing() -> None:
    plain = thing()
    noise = np.random.default_rng(1).normal(size=(len(plain), 15, 3))
    even = replace(plain, sh=np.concatenate([plain.sh, 0.05 * noise], axis=1).astype(np.float32))
    assert digest(found(even)[1]) == digest(found(plain)[1])


def test_a_room_of_plain_colours_is_looked_at_from_inside(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mirelight.proxy.guessed.GUESS", replace(FEW, clear_grid=5, clear_fewest=0))
    sides = np.random.default_rng(4).uniform(-2.5, 2.5, (6000, 3))
    room = joined(box_shell(4.0, 0.16, thin=0.3), junk(sides[np.abs(sides).max(axis=1) > 2.15]))
    _, cameras = found(room)
    assert cameras
    assert np.abs([x.position for x in cameras]).max() < 1.9
    assert best(room, "here", guess=lambda: cameras).camera.position in np.array([x.position for x in cameras])


def test_a_hollow_thing_of_plain_colours_is_not_looked_at_from_inside() -> None:
    """All directions are filled there, by layers that blend what lies far apart."""
    inner = np.random.default_rng(6).normal(size=(600, 3))
    inner *= np.random.default_rng(7).uniform(0.2, 0.8, (600, 1)) / np.linalg.norm(inner, axis=1, keepdims=True)
    assert not found(joined(ball(), junk(inner)))[1]


def test_no_camera_stands_inside_of_a_thing() -> None:
    """A ring so near that its middle is told as well as the ring."""
    near = RING * [0.45, 0.5, 0.45]
    _, cameras = found(coloured(thing(), near))
    inside = [np.linalg.norm(x.position - [0, 0.5, 0]) < 0.45 for x in cameras]
    assert len(cameras) > 10
    assert not any(inside)


def test_twice_the_same_bits_by_any_number_of_threads() -> None:
    cloud = coloured(thing(), RING)
    capture = look_at_capture(cloud, "here")
    once, again = (guessed(cloud, capture, replace(SETTINGS, threads=n)) for n in (1, 2))
    assert all((a.world_from_camera == b.world_from_camera).all() for a, b in zip(once, again, strict=True))


def test_the_same_is_seen_wherever_a_capture_is_placed() -> None:
    """Guessed in the splats' own axes, and carried with them."""
    cloud, kept = coloured(thing(), RING), UserCache()
    m = compose((3, -1, 2), rotation_from_euler((20, 50, -70)), 2.5)
    own, world = (
        guesses.guessed(OwnSplats(Deferred.of(cloud), at), SETTINGS, kept.get, kept.put) for at in (np.eye(4), m)
    )
    assert digest(own) == digest(taken_from(cloud, SETTINGS))
    assert np.allclose([x.position for x in world], [m[:3, :3] @ x.position + m[:3, 3] for x in own])
    assert np.isclose(world[0].near, 2.5 * own[0].near)
    seen = [Compositor(c).composite(x[0]).color for c, x in ((cloud, own), (splats.transform(cloud, m), world))]
    assert np.abs(seen[0] - seen[1]).max() < 2e-3


def test_what_decides_a_guess_is_in_its_key(monkeypatch: pytest.MonkeyPatch) -> None:
    """Splats, variant and version are; how a job places the splats and its threads are not."""
    cloud, asked = thing(), list[str]()

    def find(key: str, codec: Codec[tuple[Camera, ...]]) -> tuple[Camera, ...]:
        asked.append(key)
        return ()

    def key(own: OwnSplats, settings: ProxySettings = SETTINGS) -> str:
        guesses.guessed(own, settings, find, UserCache().put)
        return asked[-1]

    own, moved_on = (OwnSplats.of_world(Deferred.of(replace(cloud, means=cloud.means + x))) for x in (0, 1))
    first = key(own)
    assert key(own, replace(SETTINGS, threads=1)) == key(replace(own, world_from_own=compose((1, 2, 3)))) == first
    others = {key(moved_on), key(own, replace(SETTINGS, variant="cuda_ad_rgb"))}
    known = provenance.versions()
    for package in ("mirelight", "drjit"):
        monkeypatch.setattr(provenance, "versions", lambda at=package: {**known, at: "99"})
        others.add(key(own))
    assert len(others) == 4 and first not in others


def test_one_guess_serves_all_that_is_made_of_a_capture(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its first job, and proxy and colours of jobs that place it otherwise."""
    asked: list[SplatCloud] = []

    def counted(cloud: SplatCloud, settings: ProxySettings) -> tuple[Camera, ...]:
        asked.append(cloud)
        return (Camera.look_at((0, 1, 2.2), (0, 0.5, 0), 64, 64, yfov=60, name="guessed-0"),)

    monkeypatch.setattr(guesses, "taken_from", counted)
    splats.write(coloured(thing(), RING), tmp_path / "a.ply")
    first = job_for(tmp_path / "a.ply", tmp_path).text
    for turn in ("", "transform = { rotation_euler = [0, 90, 0], scale = 2 }"):
        text = f'splats = {{ path = "a.ply", {turn} }}\nproxy = "splats"' if turn else first
        scene = prepare(jobs.load_text(text, tmp_path / "job.toml"))
        assert scene.mesh is not None and scene.views
    assert scene.views[0].camera.position == pytest.approx([4.4, 2, 0])
    assert len(asked) == 1


def test_a_first_picture_is_taken_from_there() -> None:
    """Where colours tell nothing, from within the walls."""
    cloud = coloured(joined(thing(), WALLS), RING)
    told, untold = (best(x, "here").camera.position for x in (cloud, replace(cloud, sh=cloud.sh[:, :1])))
    assert np.linalg.norm(RING - told, axis=1).min() < 1.3
    assert np.abs(untold[[0, 2]]).max() < 4


def test_a_first_picture_has_things_whole() -> None:
    """A floor shows more than a ball above it, so more of the floor is to be seen where the ball is cut off."""
    cloud = thing()
    chequered = np.where((np.floor(4 * cloud.means[:, [0, 2]]).sum(axis=1) % 2 > 0) & (cloud.means[:, 1] < 0.01), 1, 0)
    sh = np.pad((cloud.sh + chequered[:, None, None]).astype(np.float32), ((0, 0), (0, 3), (0, 0)))
    points, ahead = square(2.0, 0.1, 2, 2.4)  # behind both: else all is shown from farther off
    behind = on_surface(points + np.array([0, 1.5, 0]), ahead, 0.05, thin=0.3)
    behind = replace(behind, sh=np.pad(behind.sh, ((0, 0), (0, 3), (0, 0))))
    cloud = joined(replace(cloud, sh=sh), behind)  # plain colours do not tell what was aimed at
    eye, at = (0, 1.5, 2), {"cut": (0, -0.6, 0), "whole": (0, 0.2, 0)}
    cut, whole = (Camera.look_at(eye, where, 64, 36, yfov=60, name=name) for name, where in at.items())
    assert best(cloud, "here", (cut, whole)).camera.name == "cut"
    assert best(cloud, "here", guess=lambda: (cut, whole)).camera.name == "whole"


def test_a_proxy_is_made_from_there(monkeypatch: pytest.MonkeyPatch) -> None:
    """The walls of a room stand where they are, seen from inside."""
    monkeypatch.setattr("mirelight.proxy.guessed.GUESS", replace(FEW, guess_views=24, guess_pixels=80))
    shell = box_shell(4.0, 0.16, thin=0.3)
    inside = np.random.default_rng(5).uniform(-0.8, 0.8, (30, 3))
    cloud = coloured(replace(shell, opacities=np.full(len(shell), 0.8, np.float32)), inside, closed=False)
    made = make(cloud)
    assert made.guessed == 24
    _, away = Sight(made.mesh).first_hits(np.zeros((200, 3)), lattice(200))
    assert np.abs(away * np.abs(lattice(200)).max(axis=1) - 2.0).max() < 0.16
