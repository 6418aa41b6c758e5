"""The table `moved`: lights of any file at another place, names that do not exist."""

from __future__ import annotations

import numpy as np
import pytest

from mirelight.base.errors import InputError
from mirelight.io import job
from mirelight.model import AreaLight, PointLight, SpotLight

from .conftest import WriteJob

TWO = """
splats = "splats.ply"
proxy = "proxy.glb"
cameras_from = "proxy"
captured = "day"
[[lightings]]
name = "day"
lights_from = "proxy"
[[lightings]]
name = "night"
lights_from = "proxy"
[[lightings.lights]]
type = "spot"
name = "torch"
position = [0, 1, 0]
direction = [0, -1, 0]
[[lightings.lights]]
type = "area"
name = "window"
shape = "rectangle"
position = [1, 1, 0]
direction = [1, 0, 0]
up = [0, 1, 0]
size = [1, 2]
"""


def test_lights_are_elsewhere_and_else_as_they_were(write_job: WriteJob) -> None:
    plain = job.load(write_job(TWO))
    path = write_job(
        TWO + "[moved]\nlamp = [1, 2, 3]\n[moved.night]\nlamp = [4, 5, 6]\ntorch = [7, 8, 9]\nwindow = [0, 0, 9]\n"
    )
    moved = job.load(path)
    places = [{x.name: x.place for x in one.lights} for one in moved.lightings]
    np.testing.assert_array_equal(places[0]["lamp"], [1, 2, 3])
    np.testing.assert_array_equal(places[1]["lamp"], [4, 5, 6])
    for before, after in zip(plain.lightings[1].lights, moved.lightings[1].lights, strict=True):
        assert (before.name, before.intensity, type(before)) == (after.name, after.intensity, type(after))
        match before, after:
            case SpotLight(), SpotLight():
                np.testing.assert_array_equal(after.position, [7, 8, 9])
                np.testing.assert_array_equal(after.direction, before.direction)
            case AreaLight(), AreaLight():
                np.testing.assert_array_equal(after.world_from_light[:3, 3], [0, 0, 9])
                np.testing.assert_array_equal(after.world_from_light[:3, :3], before.world_from_light[:3, :3])
    assert plain.captured is not None and moved.captured is not None
    lamps = [next(x for x in one.lights if x.name == "lamp") for one in (plain.captured, moved.captured)]
    assert all(isinstance(x, PointLight) for x in lamps)
    np.testing.assert_array_equal(lamps[0].place, lamps[1].place)


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ("lamb = [0, 0, 0]", "moved.lamb: no light with a position is named 'lamb'; did you mean \"lamp\"?"),
        ("moon = [0, 0, 0]", "moved.moon: no light with a position is named 'moon'; there are lamp, torch, window"),
        ("[moved.dusk]\nlamp = [0, 0, 0]", "moved.dusk: no lighting is named 'dusk'; there are day, night"),
        (
            "[moved.day]\ntorch = [0, 0, 0]",
            "moved.day.torch: no light with a position is named 'torch'; there are lamp",
        ),
        ("lamp = 1", "moved.lamp: 1; give [x, y, z] in world units"),
        ("lamp = [1, 2]", "moved.lamp: a list of 2; give [x, y, z] in world units"),
        ("lamp = [1, 2, nan]", "moved.lamp: a list of 3; give [x, y, z] in world units"),
        ("lamp = [1, 2, 1e30]", "moved.lamp: a list of 3; give -1e+09 to 1e+09"),
    ],
)
def test_what_is_wrong_is_one_line(write_job: WriteJob, table: str, said: str) -> None:
    with pytest.raises(InputError) as told:
        job.load(write_job(TWO + "[moved]\n" + table + "\n"))
    assert str(told.value).split(": ", 1)[1] == said
