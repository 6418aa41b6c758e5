"""Lights of the shipped scenes found from their path-traced truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import mirelight
from mirelight.apps.match import LayerMatch, match, read_target
from mirelight.pipeline.scene import prepare

from .shelf import SHIPPED

SCENES = Path(__file__).parents[2] / "scenes"
SETTINGS = ["resolution=[384, 216]", "render.spp=16", "render.denoise=true", "relight.texture_scale=0.5"]


def found(
    scene: str, lighting: str, cameras: list[str], *more: str, keep_colours: bool = False
) -> tuple[LayerMatch, ...]:
    job = mirelight.load(SCENES / scene / "job.toml", [*SETTINGS, *more])
    light = next(x for x in job.lightings if x.name == lighting)
    pictures = SCENES / scene / "truth"
    shots = [
        (camera, read_target(pictures / f"{camera.name}.{lighting}.png", None, job.display.tone))
        for camera in job.cameras
        if camera.name in cameras
    ]
    return match(prepare(job, SHIPPED), shots, light, keep_colours=keep_colours).layers


def test_every_light_of_the_courtyards_night_is_within_a_tenth_in_two_pictures() -> None:
    """In one of them the fourth lantern and the uplight light next to nothing but leaves."""
    layers = found("courtyard", "night", ["front", "fountain"], "render.spp=8")
    assert [x.name for x in layers if x.seen] == [f"lantern {k}" for k in (1, 2, 3, 4)] + [
        "gallery",
        "olive uplight",
        "well lamp",
        "environment",
    ]
    for layer in layers:
        np.testing.assert_allclose(layer.after, layer.before, rtol=0.1, err_msg=layer.name)


def test_every_intensity_of_the_gels_is_within_a_tenth_in_two_pictures() -> None:
    """Their environment is a fiftieth of the pictures' light."""
    finer = ["resolution=[448, 252]", "relight.texture_scale=0.75"]
    as_traced = ["render.spp=8", "render.denoise=false"]  # cleaning costs more than it gains
    layers = found("stage", "gels", ["front", "low"], *finer, *as_traced, keep_colours=True)
    assert [x.name for x in layers if x.seen] == ["magenta", "cyan", "amber", "environment"]
    for layer in layers:
        np.testing.assert_allclose(layer.after, layer.before, rtol=0.1, err_msg=layer.name)


def test_lights_of_the_stage_are_within_what_is_said_of_them() -> None:
    """Nine of ten, all within twice that; and what is called known within a tenth is."""
    layers = [*found("stage", "spots", ["front"]), *found("stage", "gels", ["front"])]
    assert all(x.seen for x in layers)
    off = np.array([np.abs(x.after - x.before) for x in layers])
    said, true = np.array([x.uncertainty for x in layers]), np.array([x.before for x in layers])
    assert (off <= said).mean() >= 0.9
    assert (off <= 2 * said).all()
    known = np.array([x.relative_uncertainty for x in layers]) <= 0.1
    assert (off <= 0.1 * true)[known].all()
    assert known.sum() >= 10
