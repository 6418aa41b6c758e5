"""A job with `orientation = "playcanvas"` shows a panorama where the engine's own frame shows it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mirelight.io.exr import read_exr

from .conftest import Run

JOB = """\
proxy = {{ path = "{assets}/sphere.glb", albedo = 0.2176 }} # 0.5 to the power of 2.2, as the engine decodes it
environment = {{ path = "{assets}/sky.hdr", orientation = "{orientation}" }}
resolution = [200, 150]
cameras = [{{ position = [1, 2.5, 5], target = [0, -0.4, 0], yfov = 45, near = 0.1, far = 100 }}]
render = {{ spp = 64, max_depth = 1 }}
"""


@pytest.mark.parametrize(("orientation", "agrees"), [("playcanvas", True), ("blender", False)])
def test_sky_of_the_engine(run: Run, tmp_path: Path, data: Path, orientation: str, agrees: bool) -> None:
    assets = data / "realtime" / "assets"
    (tmp_path / "job.toml").write_text(JOB.format(assets=assets.as_posix(), orientation=orientation))
    assert run("render", "job.toml", "--set", "output.png=false").returncode == 0
    channels = read_exr(tmp_path / "out" / "camera.lighting.exr").channels
    with np.load(data / "realtime" / "sphere_sky" / "buffers.npz") as buffers:
        engine = buffers["relight"].reshape(150, 2, 200, 2, 4).mean(axis=(1, 3))
    covered = (channels["A"] > 0.999) & (engine[..., 3] > 0.999)
    assert covered.sum() > 3000
    ratio = np.stack([channels[c] for c in "RGB"], axis=-1)[covered] / engine[..., :3][covered]
    # the engine's small RGBP8 ambient map costs it 2 to 5 %
    assert (abs(ratio.mean() - 1) < 0.05 and ratio.std() < 0.05) == agrees
    assert agrees or ratio.std() > 0.5
