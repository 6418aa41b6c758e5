"""Inserted objects that move: where keys put them at each frame, and how long a streak an open shutter gets of them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import mirelight
from mirelight.base.errors import InputError
from mirelight.io.gltf.write import write_glb
from mirelight.model import Camera, Job
from mirelight.pipeline.frames import effort, frame
from mirelight.pipeline.inserted import _along
from tests.analytic.lighting_scenes import join, quad

SIDE = 0.3  # of the tile, world units
JOB = """
proxy = "wall.glb"
lights = [{{ type = "point", name = "lamp", position = [0, 1, 3], intensity = 10 }}]
resolution = [48, 32]
render = {{ spp = 128, lens_samples = 32, max_depth = 2 }}

[[cameras]]
name = "still"
position = [0, 0, 3]
target = [0, 0, 0]
frames = 3
{shutter}

[[objects]]
path = "tile.glb"
transform = {{ translation = [0, 0, 0], scale = 1.0 }}
{keys}
"""
KEYS = """
[[objects.keys]]
frame = 1
translation = [-0.8, 0, 0]
[[objects.keys]]
frame = 3
translation = [0.8, 0, 0]
rotation_euler = [0, 0, 90]
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A wall, and a tile to move before it."""
    here = tmp_path_factory.mktemp("motion")
    write_glb(here / "wall.glb", quad((0, 0, -3), (6, 0, 0), (0, 6, 0)), (), ())
    write_glb(here / "tile.glb", join(quad((0, 0, 0), (SIDE / 2, 0, 0), (0, SIDE / 2, 0))), (), ())
    return here


def job(folder: Path, keys: str = KEYS, shutter: str = "", *more: str) -> Job:
    (folder / "job.toml").write_text(JOB.format(keys=keys, shutter=shutter))
    return mirelight.load(folder / "job.toml", list(more))


def seen(made: Job, camera: Camera) -> np.ndarray:
    """(H, W) how much of each pixel the tile takes."""
    lit = frame(mirelight.prepare(made), camera, made.lightings[0]).lighting
    assert lit is not None and lit.objects is not None
    return lit.objects.coverage.astype(np.float64)


def test_objects_are_where_their_keys_say(folder: Path) -> None:
    made = job(folder)
    assert [x.name for x in made.cameras] == ["still.0001", "still.0002", "still.0003"]
    assert all(x.exposure is None for x in made.cameras) and made.output.store == "frames"
    x = np.arange(48) + 0.5 - made.cameras[0].cx
    for camera, place in zip(made.cameras, (-0.8, 0, 0.8), strict=True):
        found = seen(made, camera)
        assert (found.sum(axis=0) * x).sum() / found.sum() == pytest.approx(place / 3 * camera.fx, abs=0.15)
    (one,) = made.objects
    turn = one.at(2).world_from_object[:3, :3]
    np.testing.assert_allclose(turn[:, 0], [np.sqrt(0.5), np.sqrt(0.5), 0], atol=1e-9)  # half of a quarter turn
    np.testing.assert_allclose(one.at(0).world_from_object, one.at(1).world_from_object)
    np.testing.assert_allclose(one.at(9).world_from_object[:3, 3], [0.8, 0, 0], atol=1e-12)


def test_a_shutter_leaves_a_streak_as_long_as_the_tile_goes_meanwhile(folder: Path) -> None:
    made = job(folder, KEYS.replace("rotation_euler = [0, 0, 90]", ""), "shutter = 0.6")
    camera = made.cameras[1]
    assert camera.exposure is not None and effort(made, camera, made.lightings[0])[0] == 33
    blurred, sharp = seen(made, camera), seen(made, camera.pinhole)
    assert blurred.sum() == pytest.approx(sharp.sum(), rel=0.04)
    x = np.arange(48) + 0.5 - camera.cx

    def spread(share: np.ndarray) -> float:
        return float((share.sum(axis=0) * x**2).sum() / share.sum())

    length = 0.8 * 0.6 / 3 * camera.fx  # world units a frame, frames, pixels
    assert spread(blurred) - spread(sharp) == pytest.approx(length**2 / 12, rel=0.05)  # of an even line
    assert (blurred.sum(axis=0) * x).sum() / blurred.sum() == pytest.approx(0, abs=0.15)


def test_a_frame_knows_the_motion_of_what_it_shows(folder: Path) -> None:
    slow, fast = (
        job(folder, KEYS.replace("0.8", reach).replace("rotation_euler = [0, 0, 90]", ""), "shutter = 0.5")
        for reach in ("0.4", "0.8")
    )
    keys = [mirelight.prepare(x).keys for x in (slow, fast)]
    middle = [k.frame(x.cameras[1], x.lightings[0]) for k, x in zip(keys, (slow, fast), strict=True)]
    assert middle[0] != middle[1]  # it is at one place in both
    sharp = [k.frame(x.cameras[1].pinhole, x.lightings[0]) for k, x in zip(keys, (slow, fast), strict=True)]
    assert sharp[0] == sharp[1]


def test_a_mirror_that_moves_has_one_look_at_the_capture_for_all_of_its_way(folder: Path) -> None:
    made = job(folder)
    (one,) = made.objects
    moved = [one.at(x) for x in (1.0, 2.5)]
    for there in moved:
        box = there.world_from_object @ np.diag([2.0, 2.0, 2.0, 1.0])
        ways = np.array([x[:3, 3] for x in _along(there, box)])
        np.testing.assert_allclose(ways, np.array([[-0.8, 0, 0], [0, 0, 0], [0.8, 0, 0]]), atol=1e-9)
    keys = mirelight.prepare(made).keys
    assert keys.mirrored((moved[0],)) == keys.mirrored((moved[1],))
    assert keys.object_boxes((moved[0],)) != keys.object_boxes((moved[1],))


def test_still_objects_are_themselves_at_every_frame(folder: Path) -> None:
    made = job(folder)
    still = tuple(replace(x, motion=None) for x in made.objects)
    one = replace(made, objects=still)
    assert all(one.objects_of(x, c) is still for x in one.lightings for c in one.cameras)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("frame = 3", "frame = 1", "let frames rise"),
        ("frames = 3", "", "give one frames = 48"),
        (KEYS, "", "nothing moves"),
        ("scale = 1.0 }", "scale = 1.0 }\nscatter = { center = [0, 0, 0], radius = 1 }", "keep one of them"),
        ("resolution", 'output = { store = "layers" }\nresolution', 'output.store = "layers"'),
    ],
)
def test_what_cannot_move_is_said(folder: Path, old: str, new: str, said: str) -> None:
    text = JOB.format(keys=KEYS, shutter="")
    assert old in text
    (folder / "wrong.toml").write_text(text.replace(old, new, 1))
    with pytest.raises(InputError, match=said):
        mirelight.prepare(mirelight.load(folder / "wrong.toml"))
