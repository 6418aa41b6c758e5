"""A noise target where light is read from the surface: what the surface's own light leaves counts, and is paid for."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import mirelight
from mirelight.model import Camera, Deferred, Job, Lighting, LightingBuffer, RenderSettings, SpotLight, SunLight

from ..analytic.test_surface_cache import room, stage

TARGET = 0.06
SEEDS = 2


def spot_in_a_room() -> Job:
    """A spot's small light has no noise in a picture's samples; what walls have of it is found by few rays."""
    spot = SpotLight(
        name="spot",
        position=np.array([0, 1.5, 0]),
        direction=np.array([0.3, -1, 0.2]),
        intensity=20.0,
        inner_cone_angle=0.2,
        outer_cone_angle=0.3,
    )
    view = Camera.look_at([-1.7, 1.6, 1.7], [0.5, 0.6, 0], 24, 18, yfov=70, name="front")
    return Job(
        source=Path("job.toml"),
        splats=None,
        proxy=Deferred.of(room((-2, 0, -2), (2, 2, 2))),
        cameras=(view,),
        lightings=(Lighting(name="spot", lights=(spot,)),),
        render=RenderSettings(spp=32, noise=TARGET, indirect="surface"),
    )


def under_a_sky() -> Job:
    """Outdoors the surface's light is smooth, and a wide sun's shadow needs samples."""
    proxy, lighting, view = stage()
    wide = SunLight(name="sun", direction=np.array([-0.4, -1, -0.5]), intensity=2.0, angular_diameter=40.0)
    return replace(
        spot_in_a_room(),
        proxy=Deferred.of(proxy),
        cameras=(replace(view.resized(24, 18), name="front"),),
        lightings=(Lighting(name="sky", lights=(wide,), environment=lighting.environment),),
        render=RenderSettings(spp=32, noise=0.01, indirect="surface"),
    )


def made(job: Job, seed: int, said: list[str]) -> LightingBuffer:
    scene = mirelight.prepare(replace(job, render=replace(job.render, seed=seed)), None, said.append)
    return mirelight.light(scene, job.cameras[0], job.lightings[0]).new


@pytest.mark.parametrize(("job", "most_rays"), [(spot_in_a_room(), None), (under_a_sky(), 256)])
def test_the_target_is_met_whatever_the_noise_is_of(job: Job, most_rays: int | None) -> None:
    """By what frames say of themselves, and by how far frames of independent seeds are apart."""
    assert job.render.noise is not None
    said: list[str] = []
    frames = [made(job, seed, said) for seed in range(SEEDS)]
    for x in frames:
        assert x.relative_noise is not None and x.relative_noise < 1.1 * job.render.noise
        assert x.cell_rays > 256 if most_rays is None else x.cell_rays == most_rays
    pictures = np.stack([x.beauty for x in frames]).astype(np.float64)
    mean, seen = pictures.mean(axis=0), frames[0].coverage > 0
    error = pictures.var(axis=0, ddof=1) / (mean**2 + 0.01 * mean[seen].mean() ** 2)
    assert np.sqrt(error[seen].mean()) < 1.2 * job.render.noise
    chosen = [x for x in said if "rays of each piece" in x]
    assert len(chosen) == SEEDS and f"along {frames[0].cell_rays:,} rays" in chosen[0]
    if most_rays is not None:
        assert max(float(np.max(x.samples)) for x in frames if x.samples is not None) > 32


def test_the_choice_is_in_the_file(tmp_path: Path) -> None:
    job = spot_in_a_room()
    scene = mirelight.prepare(job)
    lit = mirelight.light(scene, job.cameras[0], job.lightings[0])
    frame = mirelight.relight(scene, None, lit)
    mirelight.write(frame, tmp_path / "frame.exr", job)
    read = mirelight.io.image.read(tmp_path / "frame.exr").lighting
    assert read is not None and read.cell_rays == lit.new.cell_rays > 256
