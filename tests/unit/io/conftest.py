"""A frame with every field filled."""

from __future__ import annotations

import numpy as np
import pytest

from mirelight.base import colour
from mirelight.model import Camera, Frame, LightingBuffer, LightLayer, Provenance, SplatLayer

WIDTH, HEIGHT = 20, 12


def make_frame(lights: tuple[str, ...] = ("key", "Lampe über Tür", "environment"), seed: int = 0) -> Frame:
    """Random pictures; the unlit one is an INRIA-style composite blended in display space, then decoded."""
    rng = np.random.default_rng(seed)

    def plane(*more: int) -> np.ndarray[tuple[int, ...], np.dtype[np.float32]]:
        return rng.random((HEIGHT, WIDTH, *more), dtype=np.float32)

    camera = Camera(
        name="front",
        world_from_camera=Camera.look_at((1, 2, 3), (0, 0.5, 0), 4, 4).world_from_camera,
        width=WIDTH,
        height=HEIGHT,
        fx=30,
        fy=25,
        cx=7,
        cy=8,
        near=0.1,
    )
    transmittance = plane()
    transmittance[0], transmittance[1] = 0, 1
    alpha = (1 - transmittance)[..., None]
    blended = plane(3) * alpha
    own = blended / np.where(alpha > 0, alpha, np.float32(1))
    unlit = np.concatenate([colour.srgb_decode(own) * alpha, alpha], axis=-1)
    layers = tuple(LightLayer(name=name, direct=plane(3), indirect=plane(3)) for name in lights)
    tiny = np.float32(1e-9)
    noisy = tuple(LightLayer(name=n, direct=plane(3), indirect=plane(3), variance=plane(3) * tiny) for n in lights)
    lighting = LightingBuffer(
        camera=camera,
        coverage=plane(),
        layers=layers,
        depth=plane(),
        position=plane(3),
        normal=plane(3),
        geometric_normal=plane(3),
        albedo=plane(3),
        sun_visibility=plane(),
        ambient_occlusion=plane(),
        variance=plane(3) * tiny,
        samples=np.round(plane() * 64),
        noisy=noisy,
    )
    splats = SplatLayer(camera=camera, color=blended, transmittance=transmittance, depth=plane(), median_depth=plane())
    made_by = Provenance(
        mirelight="0.1.0",
        versions={"mitsuba": "3.9.1"},
        job="courtyard.toml",
        inputs={"splats.ply": "ab" * 32},
        settings={"render": {"spp": 64, "noise": None}},
        lighting="night",
        fingerprint="f" * 64,
    )
    return Frame(
        camera=camera,
        rgba=np.concatenate([plane(3) * 3 * alpha, alpha], axis=-1),
        unlit=unlit,
        factor=plane(3),
        lighting=lighting,
        splats=splats,
        made_by=made_by,
        noise=plane(3) * tiny,
    )


@pytest.fixture
def frame() -> Frame:
    """A frame with every field filled."""
    return make_frame()
