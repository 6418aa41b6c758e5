"""Light read from the surface through the stages: the same frame alone and among others, near the traced one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

import mirelight
from mirelight.model import Camera, Deferred, Job, RenderSettings

from ..analytic.test_surface_cache import stage


def job() -> Job:
    proxy, lighting, view = stage()
    other = Camera.look_at([-1, 2.5, 3], [0, 0.5, 0], 24, 18, name="other")
    lamp, sun = lighting.lights
    dimmed = replace(lighting, name="dimmed", lights=(replace(lamp, intensity=0.5 * lamp.intensity), sun))
    return Job(
        source=Path("job.toml"),
        splats=None,
        proxy=Deferred.of(proxy),
        cameras=(replace(view, name="front"), other),
        lightings=(replace(lighting, name="whole"), dimmed),
        render=RenderSettings(spp=16, indirect="surface"),
    )


def test_a_frame_alone_is_that_among_others() -> None:
    one = job()
    among = mirelight.prepare(one)
    every = {(c.name, x.name): mirelight.light(among, c, x) for c in one.cameras for x in one.lightings}
    alone = mirelight.light(mirelight.prepare(one), one.cameras[1], one.lightings[1])
    found = every["other", "dimmed"]
    assert np.array_equal(alone.new.beauty, found.new.beauty)
    for layer, other in zip(alone.new.layers, found.new.layers, strict=True):
        assert layer.variance is not None and other.variance is not None
        assert np.array_equal(layer.variance, other.variance)

    traced = mirelight.prepare(replace(one, render=replace(one.render, indirect="traced", spp=256, max_depth=16)))
    for lighting in one.lightings:
        truth = mirelight.light(traced, one.cameras[0], lighting).new
        for layer, own in zip(truth.layers, every["front", lighting.name].new.layers, strict=True):
            assert layer.name == own.name
            np.testing.assert_allclose(own.indirect.mean(), layer.indirect.mean(), rtol=0.04)
            np.testing.assert_allclose(own.direct.mean(), layer.direct.mean(), rtol=0.03)
