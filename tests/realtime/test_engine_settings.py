"""What a job sets in the engine itself: physical units, clustered lighting, penumbras, the linear pipeline's pixels."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

import mirelight
from mirelight.apps import realtime
from mirelight.base.errors import InputError
from mirelight.lighting import trace
from mirelight.model import Job, RenderSettings
from mirelight.model.playcanvas_lights import engine_diffuse, to_engine
from mirelight.pipeline.plan import plan, warnings

from .engine_cases import texture

JOB = """
profile = "playcanvas"
proxy = "stage.glb"
resolution = [160, 120]
cameras = [{ position = [1, 2.5, 5], target = [0, -0.4, 0], yfov = 45 }]
"""
SPOT = """
[[lights]]
name = "torch"
type = "playcanvas"
kind = "spot"
position = [2, 3, 2]
target = [0, -0.5, 0]
range = 20
inner_cone_angle = 10
outer_cone_angle = 14
"""
OMNI = """
[[lights]]
name = "bulb"
type = "playcanvas"
kind = "omni"
position = [-1, 1.5, 1]
"""
SUN = """
[[lights]]
name = "sun"
type = "playcanvas"
kind = "directional"
direction = [-0.4, -1, -0.3]
cast_shadows = true
"""


def load(data: Path, folder: Path, *tables: str) -> Job:
    shutil.copyfile(data / "realtime" / "assets" / "stage.glb", folder / "stage.glb")
    (folder / "job.toml").write_text("\n".join((JOB, *tables)))
    return mirelight.load(folder / "job.toml")


def test_luminance_and_exact_cones_light_as_the_table_says(data: Path, tmp_path: Path) -> None:
    """One run for all: without clustered lighting cones have their own angles, luminance is what the model makes of it,
    and the linear pipeline blends in the pixels that the job names."""
    engine = '[engine]\nclustered = false\nphysical_units = true\nhdr_format = "RGBA16F"\n[compositor]\nlinear = true\n'
    job = load(data, tmp_path, engine, SPOT, "luminance = 60", OMNI, "luminance = 40", 'falloff = "inverse-squared"')
    camera, lighting = job.cameras[0], job.lightings[0]
    frames = realtime.render(job, camera, lighting, tmp_path / "page")
    assert frames.meta["clusteredLighting"] is False
    assert frames.meta["hdrFormat"] == "RGBA16F"
    assert job.proxy is not None
    proxy, theirs = job.proxy.value, frames.relight

    lights, _ = to_engine(lighting, proxy, clustered=False)
    assert lights.lights[0].cone[1] == pytest.approx(np.radians(14))
    ours = texture(proxy, camera, lights, engine_diffuse(0.5))
    both = (ours[..., 3] > 0.5) & (theirs[..., 3] > 0.5)
    assert np.percentile(np.abs(ours - theirs)[both] / theirs[..., :3].max(), 99) < 2e-3
    narrow = load(data, tmp_path, SPOT).lightings[0]
    assert to_engine(narrow, proxy)[0].lights[0].cone[1] == pytest.approx(np.radians(14 * 0.99))
    traced = trace(proxy, lighting, camera, RenderSettings(profile="playcanvas")).beauty
    covered = theirs[..., 3] > 0.5
    error = np.abs(traced - theirs[..., :3])[covered] / theirs[..., :3].max()
    assert np.percentile(error, 99) < 2e-3


def test_a_penumbra_softens_the_engines_shadows_and_a_line_says_that_it_is_its_own(data: Path, tmp_path: Path) -> None:
    job = load(data, tmp_path, SUN, "penumbra_size = 0.15", "penumbra_falloff = 1.5")
    assert len([line for line in warnings(plan(job)) if "penumbra" in line]) == 1
    frames = realtime.render(job, job.cameras[0], job.lightings[0], tmp_path / "page")
    light = frames.meta["lights"][0]
    assert (light["penumbraSize"], light["penumbraFalloff"]) == (pytest.approx(0.15), 1.5)
    assert job.proxy is not None
    open_, _ = to_engine(job.lightings[0], job.proxy.value, shadows=False)
    full = texture(job.proxy.value, job.cameras[0], open_, engine_diffuse(0.5))[..., 1]
    lit = (full > 0.05 * full.max()) & (frames.relight[..., 3] > 0.5)
    hard = trace(job.proxy.value, job.lightings[0], job.cameras[0], RenderSettings(profile="playcanvas")).beauty

    def partly(light: np.ndarray) -> float:
        share = light[..., 1][lit] / full[lit]
        return float(np.mean((share > 0.1) & (share < 0.9)))

    assert (hard[..., 1][lit] == 0).any()
    assert partly(hard) < 0.002 < 0.02 < partly(frames.relight)


@pytest.mark.parametrize(
    ("tables", "said"),
    [
        ((OMNI, "luminance = 5"), r"lights\[0\]\.luminance: luminance, which the engine counts with physicalUnits"),
        (("[engine]\nphysical_units = true", OMNI), r"lights\[0\]: no luminance"),
        (("[engine]\nphysical_units = true", OMNI, "luminance = 5\nintensity = 1"), r"lights\[0\]\.intensity"),
        ((OMNI, "cast_shadows = true\npenumbra_size = 0.1"), "clustered = false"),
        ((SPOT, "penumbra_size = 0.1"), "cast_shadows = true"),
        ((SUN, "penumbra_falloff = 2"), "add penumbra_size"),
        ((OMNI, "cast_shadows = true\npenumbra_size = 1\npenumbra_falloff = 2"), "directional"),
        (('[engine]\nhdr_format = "RGBA8"', OMNI), "engine.hdr_format"),
    ],
)
def test_what_the_engine_would_not_count_is_a_mistake(
    data: Path, tmp_path: Path, tables: tuple[str, ...], said: str
) -> None:
    with pytest.raises(InputError, match=said):
        load(data, tmp_path, *tables)
