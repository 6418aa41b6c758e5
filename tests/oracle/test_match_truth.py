"""Lights of the shipped stage found from its path-traced truth: each as near as `match` says that it knows it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import mirelight
from mirelight.matching import match, read_target
from mirelight.scene import prepare

STAGE = Path(__file__).parents[2] / "scenes" / "stage"


@pytest.mark.parametrize(("lighting", "at_least"), [("spots", 3), ("gels", 4)])
def test_lights_of_the_truth_are_within_what_is_said_of_them(lighting: str, at_least: int) -> None:
    job = mirelight.load(STAGE / "job.toml", ["render.spp=64", "render.denoise=true", "resolution_scale=0.5"])
    camera = next(x for x in job.cameras if x.name == "front")
    light = next(x for x in job.lightings if x.name == lighting)
    target = read_target(STAGE / "truth" / f"front.{lighting}.png", None, job.display.tone)

    found = match(prepare(job), camera, light, target).layers

    known = 0
    for layer in found:
        assert layer.seen
        off = np.abs(layer.after - layer.before)
        assert (off <= layer.uncertainty).all(), layer.name
        near = layer.relative_uncertainty <= 0.1
        known += int(near.sum())
        assert (off <= 0.1 * layer.before)[near].all(), layer.name
    assert known >= at_least
