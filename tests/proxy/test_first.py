"""First jobs: up is found however a capture lies, the camera looks in from the open side, bad captures are a line."""

from __future__ import annotations

import json
import shutil
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from mirelight import cli
from mirelight.apps.first_job import Wish, beside, job_for, objects, up, view
from mirelight.apps.first_job.lighting import _candela
from mirelight.apps.inspect.facts import MeshFacts, SplatFacts
from mirelight.apps.inspect.inspect import inspect, of_job
from mirelight.base import conventions
from mirelight.base.errors import InputError
from mirelight.cli.report import lines
from mirelight.estimate import Confidence, Estimate
from mirelight.io import job, splats
from mirelight.io.cameras import inria
from mirelight.io.exr import write_exr
from mirelight.io.gltf import document
from mirelight.io.gltf.write import write_glb, write_lights
from mirelight.model import AreaLight, Camera, PointLight, ProxyMesh, SplatCloud
from mirelight.pipeline.scene import prepare
from mirelight.proxy import make
from mirelight.proxy.capture import take
from mirelight.proxy.guess_tuning import GUESS

from .clouds import ball, box_shell, fog, joined, on_surface, square

SCENES = Path(__file__).resolve().parents[2] / "scenes"
FEW = replace(GUESS, clear_grid=5, clear_fewest=0, clear_judged=8, guess_tried=24)


@pytest.fixture(autouse=True, scope="module")
def _guessed_of_few() -> Iterator[None]:
    """Where a capture was taken from is guessed of few places: `test_guessed.py` tests how well."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("mirelight.proxy.guessed.GUESS", FEW)
        yield


def held(eye: tuple[float, float, float], up_there: tuple[float, float, float]) -> Camera:
    return Camera.perspective(conventions.look_at(eye, (0, 0, 0), up_there), 8, 8, yfov=45)


@pytest.fixture(scope="module", params=["courtyard", "stage"])
def cloud(request: pytest.FixtureRequest) -> SplatCloud:
    return splats.read(SCENES / request.param / "splats.compressed.ply")


@pytest.mark.parametrize("turn", [(0, 0, 0), (0, 0, 180), (90, 0, 0), (-90, 0, 0), (0, 0, 90), (20, 30, 40)])
def test_up_is_found_however_it_lies(cloud: SplatCloud, turn: tuple[float, float, float]) -> None:
    m = np.eye(4)
    m[:3, :3] = conventions.rotation_from_euler(turn)
    found = up.find(splats.transform(cloud, m), Path("a.ply"))
    assert not found.guessed
    assert found.way @ m[:3, 1] > np.cos(np.radians(0.2))


def test_turning_by_what_is_found_brings_it_up() -> None:
    rng = np.random.default_rng(3)
    for way in [*np.eye(3), *-np.eye(3), *rng.normal(size=(100, 3))]:
        found = up.Up(conventions.unit(way), "", False)
        np.testing.assert_allclose(conventions.rotation_from_euler(found.euler) @ found.way, (0, 1, 0), atol=5e-4)


def test_a_thing_without_a_floor_is_a_guess_and_cameras_are_not() -> None:
    found = up.find(ball(), Path("a.ply"))
    assert found.guessed and found.way[1] == -1
    taken = [held((5 * np.sin(a), 5 * np.cos(a), 2.0), (0, 0, 1)) for a in range(6)]
    found = up.find(ball(), Path("a.ply"), taken)
    assert not found.guessed and found.way[2] == 1


def test_guessed_views_tell_which_end_of_a_thing_is_up() -> None:
    for high, way in ((1.0, 1), (-1.0, -1), (0.05, -1)):  # who looks level tells nothing
        eyes = [(2 * np.sin(a), high, 2 * np.cos(a)) for a in range(6)]
        views = [Camera.look_at(x, (0, 0, 0), 8, 8) for x in eyes]
        found = up.find(ball(), Path("a.ply"), (), partial(tuple, views))
        assert found.guessed and found.way[1] == way


@pytest.mark.parametrize("turn", [(0, 0, 0), (0, 0, 180), (90, 0, 0), (20, 30, 40)])
@pytest.mark.parametrize("bare", [False, True])
def test_a_closed_room_stands_on_the_side_that_things_stand_on(turn: tuple[float, float, float], bare: bool) -> None:
    """Its ceiling is as large as its floor, which a table hides a part of; walls are lower than it is wide."""
    sides = [square(4, 0.1, axis, offset) for axis in (0, 2) for offset in (-2, 2)]
    sides = [(p[np.abs(p[:, 1]) < 1.2], n[np.abs(p[:, 1]) < 1.2]) for p, n in sides]
    (floor, up_there), ceiling = square(4, 0.1, 1, -1.2), square(4, 0.1, 1, 1.2)
    free = (np.abs(floor[:, [0, 2]]) > (-1 if bare else 0.5)).any(axis=1)
    parts = [*sides, (floor[free], up_there[free]), ceiling]
    if not bare:
        legs = square(0.7, 0.1, 2, 0.0)
        parts += [square(1.0, 0.1, 1, -0.5), (legs[0] - [0, 0.85, 0], legs[1])]
    points, normals = (np.concatenate(x) for x in zip(*parts, strict=True))
    cloud = on_surface(points, normals, 0.07, thin=0.05)
    m = np.eye(4)
    m[:3, :3] = conventions.rotation_from_euler(turn)
    found = up.find(splats.transform(cloud, m), Path("a.ply"))
    if bare:
        assert found.guessed
    else:
        assert not found.guessed and found.way @ m[:3, 1] > 0.999
        assert "things stand" in found.why


def test_cameras_that_do_not_agree_with_the_floor_are_a_guess(cloud: SplatCloud) -> None:
    for up_there, doubted in (((0, 1, 0), False), ((1, 0, 0), True)):
        ways = [np.roll((np.sin(a), 0, np.cos(a)), up_there[0]) for a in range(6)]
        taken = [held(tuple(5 * way), up_there) for way in ways]
        found = up.find(cloud, Path("a.ply"), taken)
        assert found.guessed == doubted and found.way @ up_there == 1


def test_a_wall_that_things_stand_on_is_not_sure_to_be_the_floor() -> None:
    """A cube of equal sides, with things along one wall as along the floor."""
    room, thing = box_shell(4, 0.1, thin=0.05), box_shell(0.8, 0.1, thin=0.05)
    beside = replace(thing, means=thing.means - np.array([1.5, 1.5, 0], np.float32))
    amid = replace(thing, means=thing.means - np.array([0, 1.5, 0], np.float32))
    for things, guessed in ((amid, False), (beside, True)):
        parts = (room, things)
        names = ("means", "quats", "scales", "opacities", "sh")
        both: dict[str, Any] = {n: np.concatenate([getattr(x, n) for x in parts]) for n in names}
        found = up.find(replace(room, **both), Path("a.glb"))
        assert found.guessed == guessed and found.way[1] == 1


def test_a_room_with_a_skylight_is_a_room_and_a_yard_is_none() -> None:
    room = box_shell(4, 0.1, thin=0.05)
    for wide, is_room in ((1.6, True), (2.0, False)):
        roofed = (room.means[:, 1] < 1.9) | (np.abs(room.means[:, [0, 2]]) > wide).any(axis=1)
        assert view.best(take(room, np.flatnonzero(roofed)), "a.ply").room == is_room


def test_a_street_under_a_white_sky_is_no_room() -> None:
    """An optimiser hangs splats of the sky over it."""
    room = box_shell(4, 0.1, thin=0.05)
    above = room.means[:, 1] > 1.9
    for shade, is_room in ((0.5, True), (1.0, False)):
        sh = room.sh.copy()
        sh[above, 0] = (shade - 0.5) / 0.28209479
        assert view.best(replace(room, sh=sh), "a.ply").room == is_room


def test_a_hall_is_a_room_though_a_thing_fills_its_middle() -> None:
    """Told from where cameras stood; not where what is above is open. Lamps hang in the air before the thing."""
    hall = joined(box_shell(4, 0.1, thin=0.05), box_shell(0.8, 0.1, thin=0.05))
    round_it = [Camera.look_at((np.sin(a), 0, np.cos(a)), (0, 0, 0), 64, 36, yfov=60) for a in np.arange(0, 6, 0.5)]
    open_ = take(hall, np.flatnonzero(hall.means[:, 1] < 1.9))
    first, second = (view.best(x, "a.ply", round_it) for x in (hall, open_))
    assert (first.room, second.room) == (True, False)
    assert np.abs(first.target).max() > 0.4 and np.linalg.norm(first.target) < 1


def test_what_a_camera_shows_is_ahead_of_it_though_the_most_lies_behind() -> None:
    thing, rest = ball(600), ball(2400)
    cloud = joined(thing, replace(rest, means=rest.means + np.array([0, 0, 14], np.float32)))
    shown = [Camera.look_at((x, 0.5, 3), (0, 0, 0), 64, 36, yfov=50) for x in (-1.0, 0.0, 1.0)]
    found = view.best(cloud, "a.ply", shown)
    assert not found.room and np.linalg.norm(found.target) < 1.2
    few = take(cloud, np.arange(0, len(cloud), 200))  # hardly anything is hidden by them
    faint = replace(few, opacities=np.full(len(few), 0.11, np.float32))
    assert np.isfinite(view.best(faint, "a.ply", shown).target).all()


def test_a_first_picture_is_from_the_side_that_most_pictures_show() -> None:
    """One of them, alone behind the thing, shows most: what is behind is hardly known."""
    bare = ball(900)
    rich = np.where(bare.means[:, 2] < 0, 1.5, 0.9)[:, None, None]
    cloud = replace(bare, sh=(rich * np.random.default_rng(1).uniform(-1, 1, bare.sh.shape)).astype(np.float32))
    front = [Camera.look_at((x, 0.5, 3), (0, 0, 0), 64, 36, yfov=50, name=f"f{x}") for x in (-0.6, -0.2, 0.2, 0.6)]
    back = [Camera.look_at((x, 0.5, -3), (0, 0, 0), 64, 36, yfov=50, name=f"b{x}") for x in (-0.4, 0.0, 0.4)]
    assert view.best(cloud, "a.ply", [*front, *back]).camera.name[0] == "b"
    assert view.best(cloud, "a.ply", [*front, back[1]]).camera.name[0] == "f"


@pytest.mark.parametrize("size", [(1920, 1080), (1080, 1920)])
def test_a_land_that_a_drone_maps_lies_level_and_is_shown_from_above(tmp_path: Path, size: tuple[int, int]) -> None:
    """In axes in which all its cameras look along +Z, as many a tool leaves them; in pictures of their shape."""
    points, normals = square(12, 0.15, 2, 5.0)
    things = [ball(300, centre=(x, y, 4.5)) for x, y in ((-2, 1), (1.5, -1), (0, 3))]
    splats.write(joined(on_surface(points, normals, 0.1, thin=0.1), *things), tmp_path / "land.ply")
    places = [(x, y, 0.0) for y in (-2.0, 0.0, 2.0) for x in (-3.0, -1.0, 1.0, 3.0)]
    turn = conventions.look_at((0, 0, 0), (0, 0, 1), (0, -1, 0))[:3, :3]
    taken = [
        Camera.perspective(conventions.compose(translation=x, rotation=turn), *size, yfov=45, name=f"a{k}")
        for k, x in enumerate(places)
    ]
    (tmp_path / "cameras.json").write_text(json.dumps([inria.entry(x, k) for k, x in enumerate(taken)]))
    found = job_for(tmp_path / "land.ply", tmp_path, Wish(cameras=tmp_path / "cameras.json"))
    assert "Up, which is +Y in a job: from 12 cameras of the capture" in found.text
    first = next(x for x in job.load_text(found.text, tmp_path / "job.toml").cameras if x.name == "first")
    assert first.world_from_camera[1, 2] > 0.999  # straight down
    assert any(np.allclose(first.position, [x, 0, y], atol=1e-3) for x, y, _ in places)
    assert first.world_from_camera[:3, 1] @ [0, 0, -1] > 0.999  # as it was held
    assert (first.width, first.height) == (size[0] // 2, size[1] // 2) and "resolution_scale = 0.5 }" in found.text
    assert np.isclose(first.fy, taken[0].fy / 2, rtol=1e-3)


@pytest.mark.parametrize("cut_out", [True, False])
def test_what_is_cut_out_of_its_place_is_shown_whole(cut_out: bool) -> None:
    """From a side that it was seen from; with the place round it, cameras stand where they did."""
    thing, place = ball(1500), box_shell(6, 0.25, thin=0.05, faces=(0, 1, 2, 4, 5))
    cloud = thing if cut_out else joined(thing, place)
    cloud = replace(cloud, sh=np.pad(cloud.sh, ((0, 0), (0, 3), (0, 0))))  # of degree 1: places of cameras are told
    eyes = [1.6 * np.array([np.sin(a), 0.3, np.cos(a)]) for a in np.arange(0, 3, 0.3)]
    near = [Camera.look_at(eye, (0, 0, 0), 64, 36, yfov=60) for eye in eyes]
    found = view.best(cloud, "a.ply", guess=lambda: near)
    assert (view._share(thing.means.astype(np.float64), found.camera) == 1) == cut_out
    assert (np.linalg.norm(found.camera.position - eyes, axis=1).min() < 1e-6) != cut_out
    assert found.camera.position[0] > -0.1


def test_a_floor_and_nothing_else() -> None:
    """From the side there is no layer with splats that face that way."""
    rng = np.random.default_rng(0)
    floor = SplatCloud(
        means=rng.uniform((-3, -1, -3), (3, -1, 3), (900, 3)).astype(np.float32),
        quats=np.tile(np.array([1, 0, 0, 0], np.float32), (900, 1)),
        scales=np.tile(np.array([0.2, 0.005, 0.2], np.float32), (900, 1)),
        opacities=np.full(900, 0.9, np.float32),
        sh=np.zeros((900, 1, 3), np.float32),
    )
    assert up.find(floor, Path("a.ply")).way.shape == (3,)


@pytest.mark.parametrize("name", ["courtyard", "stage"])
def test_a_shipped_capture_alone(name: str, tmp_path: Path) -> None:
    capture = tmp_path / "capture.compressed.ply"
    shutil.copy(SCENES / name / "splats.compressed.ply", capture)
    text = job_for(capture, tmp_path).text
    table = tomllib.loads(text)
    assert table["proxy"] == "splats" and table["splats"] == capture.name
    work = job.load_text(text, tmp_path / "job.toml")
    (camera,) = work.cameras
    assert -camera.world_from_camera[2, 2] < -0.5  # both scenes are open towards +Z
    assert camera.position[1] > 0 and [x.name for x in work.lightings] == ["sun"]
    light = tomllib.loads(job_for(capture, tmp_path, Wish(light="point")).text)["lightings"][0]["lights"][0]
    assert light["type"] == "point" and light["position"][1] > 0


def test_objects_stand_before_the_camera_in_the_captures_own_light(tmp_path: Path) -> None:
    square = ProxyMesh(
        vertices=np.array([[-90, 0, -90], [90, 0, -90], [90, 90, 90], [-90, 90, 90]], np.float32),
        faces=np.array([[0, 2, 1], [0, 3, 2]], np.int32),
    )
    write_glb(tmp_path / "large.glb", square)
    capture = SCENES / "stage" / "splats.compressed.ply"
    shutil.copy(capture, tmp_path / "capture.compressed.ply")
    wish = Wish(objects=((tmp_path / "large.glb", None), (tmp_path / "large.glb", None)))
    work = job.load_text(job_for(tmp_path / "capture.compressed.ply", tmp_path, wish).text, tmp_path / "job.toml")
    assert [x.name for x in work.objects] == ["large", "large 2"] and all(x.drop for x in work.objects)
    assert work.captured is not None and [x.name for x in work.lightings] == ["captured"]
    (camera,) = work.cameras
    first, second = ((low + high) / 2 for low, high in (x.mesh.value.bounds for x in work.objects))
    for middle in (first, second):
        at = np.linalg.inv(camera.world_from_camera) @ np.append(middle, 1)
        assert at[2] < 0 and abs(at[0] / at[2]) < 0.4
    low, high = work.objects[0].mesh.value.bounds
    assert 0.05 < np.max(high - low) / np.linalg.norm(camera.position) < 0.3 < 90  # scaled to what shows


def test_a_set_of_things_has_the_size_of_its_largest(tmp_path: Path) -> None:
    """Parts that touch are one thing; what stands apart is told, and counts for no size."""

    def box(x: float, size: float) -> list[list[float]]:
        return [[x, 0, 0], [x + size, 0, 0], [x, size, 0], [x, 0, size]]

    vertices = np.array([*box(0, 40), *box(40, 30), *box(300, 20)], np.float32)
    sides = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], np.int32)
    parts = [trimesh.Trimesh(vertices[4 * k : 4 * k + 4], sides, process=False) for k in range(3)]
    trimesh.Scene(dict(zip(("seat", "leg", "mug"), parts, strict=True))).export(tmp_path / "set.glb")
    file = objects.MeshFile.read(tmp_path / "set.glb")
    assert [(x.name, x.size) for x in file.things] == [("seat", 70), ("mug", 20)]
    assert file.said.startswith("set.glb holds 2 things, 3.2e+02 units across: seat (70), mug (20); ")
    shutil.copy(SCENES / "stage" / "splats.compressed.ply", tmp_path / "capture.compressed.ply")
    found = job_for(tmp_path / "capture.compressed.ply", tmp_path, Wish(objects=((tmp_path / "set.glb", None),)))
    assert file.said in found.notes and f"# {file.said}." in found.text
    work = job.load_text(found.text, tmp_path / "job.toml")
    seat = work.objects[0].mesh.value.vertices[:8]
    (camera,) = work.cameras
    assert 0.05 < np.ptp(seat, axis=0).max() / np.linalg.norm(camera.position) < 0.3
    assert file.said.endswith("; --object set.glb#seat takes that alone")
    text = job_for(tmp_path / "capture.compressed.ply", tmp_path, Wish(objects=((tmp_path / "set.glb", "mug"),))).text
    (mug,) = job.load_text(text, tmp_path / "job.toml").objects
    assert mug.name == "mug" and len(mug.mesh.value.faces) == 4
    away = np.linalg.inv(camera.world_from_camera) @ np.append(np.mean(mug.mesh.value.bounds, axis=0), 1)
    assert away[2] < 0 and abs(away[0] / away[2]) < 0.4


@pytest.mark.parametrize("node", [None, "square"])
def test_an_object_s_file_is_opened_once(tmp_path: Path, node: str | None, monkeypatch: pytest.MonkeyPatch) -> None:
    square = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [1, 0, 1]], [[0, 1, 2]], process=False)
    trimesh.Scene({"square": square}).export(tmp_path / "square.glb")
    opened: list[Path] = []
    own = document.map_file

    def counted(path: Path, *given: Any) -> Any:
        opened.append(path)
        return own(path, *given)

    monkeypatch.setattr(document, "map_file", counted)
    assert [x.name for x in objects.MeshFile.read(tmp_path / "square.glb", node).things] == ["square"]
    assert opened == [tmp_path / "square.glb"]


def test_a_light_that_is_none_is_refused_before_the_capture_is_read(tmp_path: Path) -> None:
    write_lights(tmp_path / "none.glb", [PointLight(name="off", position=np.zeros(3), intensity=0)])
    write_exr(tmp_path / "flat.exr", {"": np.ones((2, 6, 3), np.float32)})
    refused = {
        "none.glb": "no light in it; give sun, point",
        "missing.hdr": "no such file; give sun",
        "flat.exr": "6 x 2 pixels, and a panorama is twice as wide as high; give sun",
    }
    for name, found in refused.items():
        with pytest.raises(InputError, match=f"{name}: {found}"):
            job_for(tmp_path / "not-there.ply", tmp_path, Wish(light=str(tmp_path / name)))


def cameras_beside(folder: Path, count: int, width: int, **lens: float | str) -> None:
    """A transforms.json of cameras around the capture, in its own axes."""
    frames = [
        {
            "file_path": f"{k:03}.png",
            "transform_matrix": conventions.look_at((6 * np.sin(k), 6 * np.cos(k), 2.0), (0, 0, 0), (0, 0, 1)).tolist(),
        }
        for k in range(count)
    ]
    size = {"w": width, "h": width * 9 // 16, "fl_x": width, "fl_y": width, "cx": width / 2, "cy": width * 9 / 32}
    (folder / "transforms.json").write_text(json.dumps(size | lens | {"frames": frames}), encoding="utf-8")


@pytest.mark.parametrize(("count", "width", "lens"), [(2, 640, {}), (50, 3840, {"k1": 0.01, "k2": 0.0})])
def test_cameras_beside_a_capture_are_rendered_too(
    tmp_path: Path, count: int, width: int, lens: dict[str, float]
) -> None:
    """A few of them, no wider than the first picture; they say which way is up; bent lenses become pinholes."""
    splats.write(ball(), tmp_path / "capture.ply")
    cameras_beside(tmp_path, count, width, **lens)
    text = job_for(tmp_path / "capture.ply", tmp_path, Wish(light="sun")).text
    work = job.load_text(text, tmp_path / "job.toml")
    assert work.cameras[0].name == "first" and len(work.cameras) == 1 + min(count, 3)
    assert np.linalg.norm(work.cameras[0].position) == pytest.approx(np.sqrt(40), rel=0.01)  # where one of them stood
    assert all(x.width == min(width, 960) for x in work.cameras[1:])
    assert work.compositor.supersampling == (2 if width > 960 else 1)  # pictures are finer than frames
    if lens:
        assert all(x.position[1] == pytest.approx(2.0, abs=0.1) for x in work.cameras[1:])
        assert 'every = 17, resolution_scale = 0.25, distortion = "ignore"' in text
        assert "# Cameras: one in 17 of the capture's 50, as pinholes, beside the one below." in text


def test_panoramas_beside_a_capture_are_looked_through_to_all_sides(tmp_path: Path) -> None:
    """Up is theirs, though two sides of each look along it; a few are rendered ahead."""
    splats.write(box_shell(16, 0.5, thin=0.05), tmp_path / "capture.ply")
    cameras_beside(tmp_path, 7, 640, camera_model="EQUIRECTANGULAR", h=320)
    text = job_for(tmp_path / "capture.ply", tmp_path, Wish(light="sun")).text
    assert 'names = ["*_front"], every = 3 }' in text
    assert "# Cameras: one in 3 of the capture's 7 panoramas, ahead, beside the one below." in text
    assert "# The pictures' cameras tell where surfaces lie" in text
    work = job.load_text(text, tmp_path / "job.toml")
    assert [x.name for x in work.cameras[1:]] == ["000_front", "003_front", "006_front"]
    assert all(x.world_from_camera[1, 1] > 0.9 for x in work.cameras[1:])


@pytest.mark.parametrize("where", ["outside", "in a room", "elsewhere"])
def test_cameras_beside_a_capture_close_its_proxy(tmp_path: Path, where: str) -> None:
    """But not where they look past the splats."""
    cloud = box_shell(16, 0.5, thin=0.05) if where == "in a room" else ball()
    splats.write(cloud, tmp_path / "capture.ply")
    cameras_beside(tmp_path, 6, 640)
    if where == "elsewhere":
        away = splats.transform(cloud, np.array([[1.0, 0, 0, 60], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]))
        splats.write(away, tmp_path / "capture.ply")
    text = job_for(tmp_path / "capture.ply", tmp_path, Wish(light="sun")).text
    line = 'proxy = { path = "splats", cameras = "transforms.json" }'
    if where != "elsewhere":
        assert line in text.splitlines()
        work = job.load_text(text, tmp_path / "job.toml")
        assert work.made_proxy is not None
        without = job.load_text(text.replace(line, 'proxy = "splats"'), tmp_path / "job.toml").made_proxy
        assert without is not None and work.made_proxy.digest != without.digest
    else:
        assert tomllib.loads(text)["proxy"] == "splats"
    assert ("captured" in tomllib.loads(text)) == (where != "in a room")  # no light comes in from all around


@pytest.mark.parametrize("cameras", [True, False])
def test_light_is_estimated_where_cameras_tell_the_surface(tmp_path: Path, cameras: bool) -> None:
    splats.write(ball(), tmp_path / "capture.ply")
    if cameras:
        cameras_beside(tmp_path, 6, 640)
    assert cli.main(["new", str(tmp_path / "capture.ply"), "-o", str(tmp_path / "job.toml")]) == 0
    made = tomllib.loads((tmp_path / "job.toml").read_text(encoding="utf-8"))
    if cameras:
        assert made["captured"] == "estimate"
        assert made["proxy"] == {"path": "splats", "cameras": "transforms.json", "albedo": "splats"}
        assert job.load(tmp_path / "job.toml").relight.follows_sky
    else:
        assert made.get("captured") != "estimate" and made["proxy"] == "splats" and "relight" not in made


def test_a_lamp_lights_a_capture_as_brightly_as_it_was_captured() -> None:
    """In a ball's middle every splat has candela / r^2 lux, and pi lux are what 1 cd/m² all around gives."""
    cloud = ball()
    lit = replace(cloud, sh=np.full_like(cloud.sh, -0.5))  # 0.36 of white, 0.1 in linear light
    at = conventions.unit((1, 2, 3))
    middle = _candela(lit, np.zeros(3))
    assert middle == pytest.approx(0.9 * np.pi, rel=1e-3)
    assert _candela(replace(lit, means=5 * lit.means), np.zeros(3)) == pytest.approx(25 * middle)
    white = replace(cloud, sh=np.full_like(cloud.sh, 1.7))  # nearly white
    near = _candela(white, 0.9 * at)
    assert near < 0.5 * _candela(lit, 0.9 * at)  # most would have as much, the nearest be white


@pytest.mark.parametrize("doubted", [False, True])
def test_what_lies_beside_it_is_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, doubted: bool) -> None:
    """What is estimated is not looked at here: new light is as bright as it, and the job loads."""
    cameras_beside(tmp_path, 6, 640)
    for file in ("splats.compressed.ply", "proxy.glb", "sunset.hdr", "spots.glb"):
        shutil.copy(SCENES / "stage" / file, tmp_path / file)
    shutil.copy(tmp_path / "sunset.hdr", tmp_path / "spots.hdr")  # names of lightings differ all the same
    sure = Confidence(
        places=5000,
        blocked=0.4,
        scale_known=True,
        sun_gain=0.1,
        sun_apart=1.0,
        sun_beaten=6.0 if doubted else -3.0,
        sun_disc=(0.53, 0.53),
        halves_apart=0.05,
        held_out=0.1,
        lamps_gain=(),
        albedo=(0.1, 0.3, 0.7),
    )
    light = Estimate(
        to_sun=np.array([0.0, 1, 0]),
        sun=np.full(3, 4 * np.pi),
        sun_diameter=1.0,
        named=(),
        lamps=np.zeros((0, 6)),
        radiance=np.full((48, 96, 3), 4.0),
        confidence=sure,
    )
    monkeypatch.setattr("mirelight.estimate.estimate", lambda *_, **__: light)
    monkeypatch.setattr("mirelight.lighting.captured_level", lambda *_: 4.0)
    text = job_for(tmp_path / "splats.compressed.ply", tmp_path).text
    table = tomllib.loads(text)
    work = job.load_text(text, tmp_path / "job.toml")
    if doubted:
        assert table["captured"] == {"environment": {"radiance": 1.0}} and "albedo" not in table["proxy"]
        assert table["lightings"][0]["lights"][0]["intensity"] == 3.2
    else:
        assert table["captured"] == "estimate" and table["proxy"]["albedo"] == "splats"
        assert "a sun 90° above the horizon, and a sky" in text
        assert table["lightings"][0]["lights"][0]["intensity"] == 12.8
    assert table["proxy"]["path"] == "proxy.glb" and table["proxy"]["cameras"] == "transforms.json"
    assert [x.name for x in work.lightings] == ["sun", "spots", "spots-2", "sunset"]


@pytest.mark.parametrize("case", ["two", "nothing shows", "far away", "one place", "too far for a proxy"])
def test_a_capture_that_shows_nothing_is_a_line(case: str, tmp_path: Path) -> None:
    whole = ball()
    bad = {
        "two": replace(whole, **{n: getattr(whole, n)[:2] for n in ("means", "quats", "scales", "opacities", "sh")}),
        "nothing shows": replace(whole, opacities=np.zeros_like(whole.opacities)),
        "far away": replace(whole, means=whole.means + np.float32(1e6)),
        "one place": replace(whole, means=np.zeros_like(whole.means)),
        "too far for a proxy": replace(whole, means=whole.means + np.float32(1e3)),
    }[case]
    path = tmp_path / "bad.ply"
    splats.write(bad, path)
    said = {"two": "2 splats, too few for a surface; ", "far away": "it lies 1e.06 units from the origin"}
    with pytest.raises(InputError, match=said.get(case)):
        job_for(path, tmp_path)


def test_fog_is_refused_by_the_line_of_the_proxys_maker(tmp_path: Path) -> None:
    """Splats that blend nearly as deep, of which it makes one, are not."""
    path = tmp_path / "capture.glb"  # whose axes are the world's
    splats.write(fog(0.5), path)
    with pytest.raises(InputError) as made:
        make(splats.read(path), source=path)
    with pytest.raises(InputError) as found:
        job_for(path, tmp_path)
    assert made.value.found.startswith("no surface: splats blend over a depth of 13% of its radius")
    assert str(found.value) == f"{made.value}; put a mesh beside it: proxy.glb"
    splats.write(fog(0.9), path)
    assert make(splats.read(path)).mesh.faces.size
    assert tomllib.loads(job_for(path, tmp_path, Wish(light="sun")).text)["proxy"] == "splats"


@pytest.mark.parametrize(("opacity", "refused"), [(0.05, True), (0.5, False)])
def test_splats_that_blend_as_deep_as_a_white_room_are_no_fog_by_their_own_cameras(
    opacity: float, refused: bool
) -> None:
    cameras = [
        Camera.look_at((6 * np.cos(a), 1.0, 6 * np.sin(a)), (0, 0, 0), 96, 72, yfov=60, near=0.01)
        for a in np.arange(8) * np.pi / 4
    ]
    if refused:
        with pytest.raises(InputError, match="splats blend over a depth of 21% of its radius"):
            make(fog(opacity), cameras=cameras)
    else:
        assert make(fog(opacity), cameras=cameras).mesh.faces.size


def flat(mesh: ProxyMesh) -> ProxyMesh:
    return replace(mesh, vertices=mesh.vertices * np.array([1, 0, 0], np.float32))


def moved(mesh: ProxyMesh) -> ProxyMesh:
    return replace(mesh, vertices=mesh.vertices + np.array([0, 20, 0], np.float32))


def grown(mesh: ProxyMesh) -> ProxyMesh:
    """With a wall six times as large as the ball."""
    wall = 6 * np.array([[-1, -1, 0], [1, -1, 0], [0, 1, 0]], np.float32) - np.array([0, 0, 30], np.float32)
    faces = np.concatenate([mesh.faces, len(mesh.vertices) + np.array([[0, 1, 2]])])
    return replace(mesh, vertices=np.concatenate([mesh.vertices, wall]), faces=faces.astype(np.int32))


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (moved, "does not fit it: 100% of the splats lie off it, half of all 19 units and more (`mirelight proxy"),
        (grown, "does not fit it: 85% of it has no splats near"),
        (flat, "cannot be used: a mesh without area"),
    ],
)
def test_a_mesh_beside_a_capture_that_is_not_taken_is_said_with_why(
    tmp_path: Path, change: Callable[[ProxyMesh], ProxyMesh], why: str
) -> None:
    splats.write(ball(), tmp_path / "capture.ply")
    made = trimesh.creation.icosphere(subdivisions=3)
    mesh = ProxyMesh(vertices=made.vertices.astype(np.float32), faces=made.faces.astype(np.int32))
    write_glb(tmp_path / "proxy.glb", change(mesh))
    text = job_for(tmp_path / "capture.ply", tmp_path).text
    assert tomllib.loads(text)["proxy"] == "splats"
    (line,) = [x for x in text.splitlines() if "proxy.glb" in x]
    assert line.startswith(f"# proxy.glb beside the capture {why}") and line.endswith("; one is made in its place.")


def test_cameras_beside_a_capture_that_cannot_be_used_are_said_with_why(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """In the job, and by the command, between what it says of the splats."""
    splats.write(ball(), tmp_path / "capture.ply")
    (tmp_path / "transforms.json").write_text('{"frames": 3}', encoding="utf-8")
    assert cli.main(["new", str(tmp_path / "capture.ply"), "-o", str(tmp_path / "job.toml")]) == 0
    text = (tmp_path / "job.toml").read_text(encoding="utf-8")
    assert "cameras_from" not in tomllib.loads(text) and len(tomllib.loads(text)["cameras"]) == 1
    which_way, line, brightness, _ = capsys.readouterr().out.splitlines()
    assert line.startswith("transforms.json beside the capture cannot be used: frames: ")
    assert line.endswith("; a camera is placed without.")
    assert which_way.startswith("4,000 splats. Up, which is ") and brightness.startswith("As captured, the splats' ")
    assert {f"# {x}" for x in (which_way, line, brightness)} <= set(text.splitlines())


def test_lights_beside_a_capture_that_cannot_be_used_are_said_with_why(tmp_path: Path) -> None:
    """Not of splats in glTF, of a mesh, or of what another system keeps beside a file; and of a few only."""
    splats.write(ball(), tmp_path / "capture.ply")
    splats.write(ball(), tmp_path / "capture.glb")
    needs = {"asset": {"version": "2.0"}, "extensionsRequired": ["KHR_gaussian_splatting"]}
    (tmp_path / "a.gltf").write_text(json.dumps(needs), encoding="utf-8")
    made = trimesh.creation.box()
    mesh = ProxyMesh(vertices=made.vertices.astype(np.float32), faces=made.faces.astype(np.int32))
    write_glb(tmp_path / "box.glb", mesh)
    for name in ("proxy.glb", "a.glb", "b.hdr", "._b.hdr", "x.hdr", "y.hdr"):
        (tmp_path / name).write_bytes(b"nothing of the kind")
    write_exr(tmp_path / "c.exr", {"": np.ones((2, 6, 3), np.float32)})
    shutil.copy(SCENES / "stage" / "spots.glb", tmp_path / "spots.glb")
    found = job_for(tmp_path / "capture.ply", tmp_path)
    work = job.load_text(found.text, tmp_path / "job.toml")
    assert [x.name for x in work.lightings] == ["lamp", "spots"]
    of_mesh, *of_lights = found.notes
    assert of_mesh.startswith("proxy.glb beside the capture cannot be used: no glTF file")
    assert of_lights == [
        f"{name} beside the capture cannot be used: {why}; no light is taken from it."
        for name, why in (
            ("a.glb", "no glTF file: there is no JSON in it"),
            ("b.hdr", "neither OpenEXR, Radiance HDR, PNG, JPEG nor WebP"),
            ("c.exr", "6 x 2 pixels, and a panorama is twice as wide as high"),
        )
    ]
    assert {f"# {line}" for line in found.notes} <= set(found.text.splitlines())
    assert not job_for(tmp_path / "capture.ply", tmp_path, Wish(light="sun")).notes[1:]  # none is looked at


def test_the_same_splats_in_another_format_are_no_mesh_that_is_not_taken(tmp_path: Path) -> None:
    splats.write(ball(), tmp_path / "capture.compressed.ply")
    splats.write(ball(), tmp_path / "capture.ply")
    assert "beside the capture " not in job_for(tmp_path / "capture.compressed.ply", tmp_path).text


def test_names_of_files_stay_within_their_comments(tmp_path: Path) -> None:
    splats.write(ball(), tmp_path / "a\nb = 1.ply")
    assert "b" not in tomllib.loads(job_for(tmp_path / "a\nb = 1.ply", tmp_path).text)


def test_a_name_that_no_job_can_hold(tmp_path: Path) -> None:
    path = tmp_path / "\udcff.ply"
    splats.write(ball(), path)
    with pytest.raises(InputError, match=r"\\udcff\.ply: a name that is not UTF-8, which no job can hold; rename it"):
        job_for(path, tmp_path)


@pytest.mark.parametrize(("away", "size", "told"), [(1e6, 1, True), (0, 1, False), (1e6, 1e4, False)])
def test_what_is_too_far_for_single_precision_is_said(tmp_path: Path, away: float, size: float, told: bool) -> None:
    """With frames and by inspect, of splats, a mesh, and a job. A job may go on; the same at the origin, and larger
    there, has nothing to say."""
    m = np.diag([size, size, size, 1.0])
    m[0, 3] = away
    splats.write(splats.transform(ball(), m), tmp_path / "capture.ply")
    made = trimesh.creation.icosphere().apply_transform(m)
    sphere = ProxyMesh(vertices=made.vertices.astype(np.float32), faces=made.faces.astype(np.int32))
    write_glb(tmp_path / "proxy.glb", sphere)
    work = job.load_text('splats = "capture.ply"\nproxy = "proxy.glb"', tmp_path / "job.toml")
    lines: list[str] = []
    scene = prepare(work, report=lines.append)
    assert scene.splats is not None and scene.mesh is not None
    coarse = "single precision is too coarse there; move capture, mesh and cameras to the origin before they are saved"
    said = [
        f"the {what} lies 1e+06 units from the origin and is {across} in size: {coarse}" if told else ""
        for what, across in (("capture", 3.42), ("mesh", 3.46))
    ]
    assert lines == [x for x in said if x]
    for name, its in (("capture.ply", said[:1]), ("proxy.glb", said[1:])):
        facts = inspect(tmp_path / name)
        assert isinstance(facts, SplatFacts | MeshFacts) and list(facts.notes) == [x for x in its if x]
    assert of_job(work, tmp_path / "job.toml").notes == tuple(lines)


def test_the_same_view_and_light_at_any_scale(tmp_path: Path) -> None:
    """Also where the capture lies beside the origin."""

    def made(scale: float) -> tuple[Camera, PointLight]:
        m = np.diag([scale, scale, scale, 1.0])
        m[:3, 3] = 20 * scale
        splats.write(splats.transform(ball(), m), tmp_path / "capture.ply")
        text = job_for(tmp_path / "capture.ply", tmp_path, Wish(light="point")).text
        work = job.load_text(text, tmp_path / "job.toml")
        (lamp,) = work.lightings[0].lights
        assert isinstance(lamp, PointLight)
        return work.cameras[0], lamp

    camera, lamp = made(1.0)
    for scale in (1e-3, 1e4):
        small, its = made(scale)
        np.testing.assert_allclose(small.position / scale, camera.position, atol=2e-4)
        np.testing.assert_allclose(small.world_from_camera[:3, :3], camera.world_from_camera[:3, :3], atol=1e-3)
        np.testing.assert_allclose(its.position / scale, lamp.position, atol=2e-4)
        assert its.intensity / scale**2 == pytest.approx(lamp.intensity, rel=0.01)


def test_a_panel_in_a_file_counts_by_what_arrives_of_it(tmp_path: Path) -> None:
    """As a lamp of the same candela on its axis does, not by its radiance."""
    place = np.eye(4)
    place[2, 3] = 4.0
    write_lights(
        tmp_path / "panel.glb",
        [AreaLight(name="a", shape="disk", world_from_light=place, size=(0.2, 0.2), intensity=50)],
    )
    found = beside.of_file(tmp_path / "panel.glb", np.zeros(3))
    assert found is not None
    assert found.intensity == pytest.approx(3.5 / (50 * np.pi * 0.1**2 / 4.0**2))


def test_splats_that_are_left_out_are_said_everywhere(tmp_path: Path) -> None:
    whole = ball()
    means = whole.means.copy()
    means[::4, 1] = np.nan
    splats.write(replace(whole, means=means), tmp_path / "capture.ply")
    text = job_for(tmp_path / "capture.ply", tmp_path).text
    assert "# 3,000 splats (1,000 more with NaN, infinite or absurd values are left out). Up, which" in text
    work = job.load_text(text, tmp_path / "job.toml")
    told: list[str] = []
    assert prepare(work, report=told.append).splats is not None
    assert told == ["1,000 splats with NaN, infinite or absurd values are left out"]
    shown = lines(of_job(work, tmp_path / "job.toml"))
    lost = "3,000, SH degree 0 (1,000 more with NaN, infinite or absurd values are left out)"
    assert any(lost in line for line in shown)
