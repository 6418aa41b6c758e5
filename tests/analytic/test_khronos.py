"""Against the frames of the Khronos glTF Sample Renderer, the reference implementation of KHR_lights_punctual."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mirelight.io.gltf.scene import read_scene
from mirelight.lighting import Tracer
from mirelight.model import Lighting, RenderSettings

FRAMES = Path(__file__).parent.parent / "data" / "khronos"


@pytest.mark.parametrize("name", ["dir_nested", "spot_default_range"])
def test_the_reference_renderer_makes_the_same_frame(name: str) -> None:
    """Direct light, the file's own colours. The reference samples pixel centres; the comparison is away from edges, and
    from the lights' own kinks, where a centre is not a pixel's mean."""
    gltf = read_scene(FRAMES / f"{name}.glb")
    assert gltf.mesh is not None
    with np.load(FRAMES / f"{name}.npz") as frame:
        reference, covered = frame["radiance"], frame["coverage"] > 0
    h, w = covered.shape
    camera = gltf.cameras[0].to_camera(w, h)
    tracer = Tracer(replace(gltf.mesh, albedo=None), RenderSettings(spp=64, max_depth=1))
    buffer = tracer.trace(Lighting(lights=gltf.lights), camera)

    inside = covered & (buffer.coverage == 1)
    assert np.mean(covered != (buffer.coverage > 0.5)) < 0.002
    bright = inside & (reference.max(axis=-1) > 0.02 * reference.max())
    ratio = buffer.beauty[bright].mean(axis=-1) / reference[bright].mean(axis=-1)
    assert buffer.beauty[inside].mean() == pytest.approx(reference[inside].mean(), rel=1e-3)
    low, high = np.percentile(ratio, [1, 99])
    assert low > 1 - 0.015 and high < 1 + 0.015, (low, high)
