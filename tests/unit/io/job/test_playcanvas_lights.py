"""Lights that a job writes in the real-time engine's own units."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from mirelight.base.errors import InputError, ManyInputsError
from mirelight.io import job
from mirelight.model import DirectionalLight, Job, PointLight, SpotLight

HEAD = """
proxy = "floor.obj"
[[lights]]
type = "playcanvas"
"""


def load(folder: Path, light: str, profile: str = "playcanvas") -> Job:
    (folder / "floor.obj").write_text("v 0 0 0\nv 0 0 1\nv 1 0 0\nf 1 2 3\n")
    (folder / "job.toml").write_text(f'profile = "{profile}"\n{HEAD}{light}\n')
    return job.load(folder / "job.toml")


@pytest.mark.parametrize("profile", ["playcanvas", "physical"])
def test_an_omni_light_with_the_components_defaults(tmp_path: Path, profile: str) -> None:
    loaded = load(tmp_path, 'kind = "omni"\nposition = [1, 2, 3]\ncolor = [1, 0.5, 0.5]', profile)
    assert loaded.render.profile == profile
    (light,) = loaded.lightings[0].lights
    assert isinstance(light, PointLight)
    assert (light.name, light.range, light.falloff, light.shadows) == ("omni", 10.0, "linear", False)
    np.testing.assert_allclose(light.color, [1, 0.5**2.2, 0.5**2.2])
    # L = 1 at half of the range: candela / 5² (1 - 1/16) / pi = 1 / 2
    assert light.intensity == pytest.approx(math.pi * 25 / 2 * 16 / 15)


def test_a_spot_and_a_directional_light(tmp_path: Path) -> None:
    loaded = load(tmp_path, 'kind = "spot"\nname = "key"\ngroup = "lamps"\nposition = [0, 4, 0]\ntarget = [0, 0, 0]')
    (spot,) = loaded.lightings[0].lights
    assert isinstance(spot, SpotLight)
    assert (spot.name, spot.group) == ("key", "lamps")
    np.testing.assert_allclose(spot.direction, [0, -1, 0])
    assert math.degrees(spot.outer_cone_angle) == pytest.approx(45 * 0.99)
    loaded = load(tmp_path, 'kind = "directional"\ndirection = [0, -1, 0]\nintensity = 3\ncast_shadows = true')
    (sun,) = loaded.lightings[0].lights
    assert isinstance(sun, DirectionalLight)
    assert sun.shadows
    assert sun.intensity == pytest.approx(3 * math.pi)


@pytest.mark.parametrize(
    ("light", "said"),
    [
        ('kind = "omni"', "without position"),
        ('kind = "omni"\nposition = [0, 1, 0]\ndirection = [0, -1, 0]', "leave it out"),
        ('kind = "directional"', "without direction"),
        ('kind = "directional"\ndirection = [0, -1, 0]\nposition = [0, 1, 0]', "leave it out"),
        ('kind = "spot"\nposition = [0, 1, 0]', "add direction"),
        ('kind = "spot"\nposition = [0, 1, 0]\ntarget = [0, 0, 0]\ninner_cone_angle = 50', "inner angle"),
        ('kind = "omni"\nposition = [0, 1, 0]\ncolor = [2, 0, 0]', "color"),
        ('kind = "omni"\nposition = [0, 1, 0]\nfalloff = "cubic"', "falloff"),
        ('kind = "bulb"', "kind"),
    ],
)
def test_what_a_component_cannot_be_is_one_line(tmp_path: Path, light: str, said: str) -> None:
    with pytest.raises((InputError, ManyInputsError), match=said) as raised:
        load(tmp_path, light)
    assert "\n" not in str(raised.value)
