"""The table `mix`: weights of unit lights, the same light where a lighting is traced whole, names that do not exist."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mirelight.base.errors import InputError
from mirelight.io import job
from mirelight.lighting.sunsky import resolved
from mirelight.model import Lighting
from mirelight.model.unit_lights import terms
from mirelight.pipeline.keys import Keys

from .conftest import WriteJob

HEAD = 'splats = "splats.ply"\nproxy = "proxy.glb"\ncameras_from = "proxy"\n'
TWO = (
    HEAD
    + """
captured = "day"
[[lightings]]
name = "day"
lights_from = "proxy"
environment = { radiance = [1, 1, 1], intensity = 2 }
[[lightings]]
name = "night"
lights_from = { path = "proxy", group = "both" }
environment = { radiance = [0.1, 0.1, 0.2] }
"""
)


def weights(lighting: Lighting) -> dict[str, list[float]]:
    return {t.layer: [float(x) for x in t.weight] for t in terms(lighting)}


def test_factors_multiply_weights_and_trace_nothing_anew(write_job: WriteJob) -> None:
    path = write_job(TWO)
    plain = job.load(path)
    mixed = job.load(
        write_job(TWO + "[mix]\nlamp = 0.5\nboth = [1, 0, 2]\nenvironment = 3\n[mix.night]\nenvironment = 0.5\n")
    )
    day, night = mixed.lightings
    assert weights(day)["lamp"] == [x / 2 for x in weights(plain.lightings[0])["lamp"]]
    assert weights(day)["moon"] == weights(plain.lightings[0])["moon"]
    assert weights(day)["environment"] == [6, 6, 6]
    assert weights(night) == {"both": [1, 0, 2], "environment": [1.5, 1.5, 1.5]}
    assert set(Keys(mixed).lights()) == set(Keys(plain).lights())


def test_the_captured_lighting_stays(write_job: WriteJob) -> None:
    mixed = job.load(write_job(TWO + "[mix]\nlamp = 0\n"))
    assert mixed.captured is not None
    assert weights(mixed.captured)["lamp"] == [5, 5, 5]
    assert weights(mixed.lightings[0])["lamp"] == [0, 0, 0]


def test_a_lighting_that_is_traced_whole_has_the_same_light(write_job: WriteJob) -> None:
    day, night = job.load(
        write_job(TWO + "[mix]\nlamp = [0.5, 1, 2]\nboth = 0.25\nenvironment = [1, 0, 2]\n")
    ).lightings
    for lighting in (day, night):
        baked = resolved(lighting)
        assert baked.mix == ()
        plain = replace(lighting, mix=())
        for old, new in zip(plain.lights, baked.lights, strict=True):
            factor = lighting.factors().get(old.group or old.name, np.ones(3))
            np.testing.assert_array_equal(new.color * new.intensity, old.color * old.intensity * factor)
        assert baked.environment is not None and plain.environment is not None
        np.testing.assert_allclose(baked.environment.pixels, plain.environment.pixels * np.array([1, 0, 2], np.float32))


def test_a_sky_models_two_layers(write_job: WriteJob) -> None:
    sky = HEAD + "environment = { sky = { elevation = 30, azimuth = 10 } }\n[mix]\nsun = 0.5\nsky = 2\n"
    (mixed,) = job.load(write_job(sky)).lightings
    assert weights(mixed) == {"sun": [0.5] * 3, "sky": [2] * 3}
    baked, plain = resolved(mixed), resolved(replace(mixed, mix=()))
    assert baked.environment is not None and plain.environment is not None
    np.testing.assert_allclose(baked.lights[0].color, plain.lights[0].color / 2)
    np.testing.assert_allclose(baked.environment.pixels, plain.environment.pixels * 2, rtol=1e-6)


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ("lamb = 1", "mix.lamb: no light, group or environment is named 'lamb'; did you mean \"lamp\"?"),
        ("[mix.dusk]\nlamp = 1", "mix.dusk: no lighting is named 'dusk'; there are day, night"),
        (
            "[mix.night]\nlamp = 1",
            "mix.night.lamp: no light, group or environment is named 'lamp'; there are both, environment",
        ),
        ("lamp = -1", "mix.lamp: -1; give 0 to 1e+09"),
        ("lamp = [1, 2]", "mix.lamp: a list of 2; give a number or [r, g, b], 0 or more"),
        ("lamp = nan", "mix.lamp: nan; give a number or [r, g, b], 0 or more"),
        ('lamp = "1"', "mix.lamp: '1'; give a number or [r, g, b], 0 or more"),
        ("lamp = true", "mix.lamp: true; give a number or [r, g, b], 0 or more"),
    ],
)
def test_what_is_wrong_is_one_line(write_job: WriteJob, table: str, said: str) -> None:
    path = write_job(TWO + "[mix]\n" + table + "\n")
    with pytest.raises(InputError) as told:
        job.load(path)
    assert str(told.value).split(": ", 1)[1] == said


def test_an_override_may_set_a_factor(write_job: WriteJob) -> None:
    mixed = job.load(write_job(TWO), ["mix.lamp=2"])
    assert weights(mixed.lightings[0])["lamp"] == [10, 10, 10]
    assert isinstance(mixed.source, Path)
