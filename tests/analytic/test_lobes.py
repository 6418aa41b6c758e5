"""What a proxy's materials mirror: their lobes alone, against glTF's formulas; nothing where they are matt."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mirelight.base.errors import InputError
from mirelight.lighting import Tracer
from mirelight.model import Camera, DirectionalLight, Lighting, LightingBuffer, Material, RenderSettings
from mirelight.model.dressing import Dress, dressed

from .lighting_scenes import FLOOR, constant_sky, overhead
from .test_objects import BASE, DOWN, brdf

CAMERA = overhead(12, 8, extent=6.0)


def lobes(lighting: Lighting, spp: int = 16, **finish: float) -> LightingBuffer:
    floor = replace(FLOOR, albedo=BASE, materials=(Material(**finish),))  # type: ignore[arg-type]
    return Tracer(floor, RenderSettings(spp=spp, max_depth=2), aovs=False, lobes=True).trace(lighting, CAMERA)


def mean(buffer: LightingBuffer) -> np.ndarray:
    return np.asarray(buffer.beauty.sum((0, 1)) / buffer.coverage.sum())


def f0(metallic: float) -> np.ndarray:
    """The base colour of the metal whose whole reflection is that lobe."""
    return 0.04 + (BASE - 0.04) * metallic


@pytest.mark.parametrize(("metallic", "roughness"), [(0.0, 0.4), (1.0, 0.7), (0.5, 0.25)])
def test_a_lobe_is_that_of_gltf_without_its_base(metallic: float, roughness: float) -> None:
    to_light = np.array([np.sin(np.radians(20)), np.cos(np.radians(20)), 0.0])
    key = Lighting(lights=(DirectionalLight(name="key", direction=-to_light, intensity=3.0),))
    buffer = lobes(key, metallic=metallic, roughness=roughness)
    truth = 3 * to_light[1] * brdf(f0(metallic), 1.0, roughness, -DOWN, -DOWN, to_light[None])[0]
    np.testing.assert_allclose(mean(buffer), truth, rtol=2e-4)
    np.testing.assert_allclose(buffer.albedo[buffer.coverage > 0], metallic, atol=1e-6)


def test_a_mirror_of_metal_shows_the_sky_in_its_colour_and_matt_parts_show_nothing() -> None:
    sky = Lighting(environment=constant_sky(2.0))
    np.testing.assert_allclose(mean(lobes(sky, metallic=1.0, roughness=0.0)), 2 * BASE, rtol=1e-3)
    assert not lobes(sky, metallic=0.0, roughness=1.0).beauty.any()
    glowing = replace(FLOOR, materials=(Material(roughness=0.3, emissive=np.ones(3)),))
    tracer = Tracer(glowing, RenderSettings(spp=4), aovs=False, lobes=True)
    assert not tracer.trace(Lighting(), CAMERA).beauty.any()  # what it sends out itself is no reflection


@pytest.mark.parametrize("metallic", [0.0, 1.0])
@pytest.mark.parametrize("roughness", [0.1, 0.4, 0.9])
def test_nothing_glossy_is_brighter_than_a_white_furnace(metallic: float, roughness: float) -> None:
    """A white surface in light of 1 from everywhere: (1 - m)(1 - S') + S, of captured and new light of other noise."""
    white = replace(FLOOR, albedo=np.ones(3), materials=(Material(metallic=metallic, roughness=roughness),))
    sky, slanted = Lighting(environment=constant_sky(1.0)), Camera.look_at((0, 1, 3), (0, 0, 0), 12, 8, yfov=20)
    new, captured = (
        mean(Tracer(white, RenderSettings(spp=64, max_depth=2, seed=k), lobes=True, aovs=False).trace(sky, slanted))
        for k in (1, 2)
    )
    assert ((1 - metallic) * (1 - captured) + new <= 1.01).all()


def test_a_job_dresses_faces_by_name_and_by_box() -> None:
    mesh = replace(FLOOR, materials=(Material(name="wood"),))
    count = len(mesh.faces)
    low, high = (tuple(float(v) for v in x) for x in mesh.bounds)
    left = ((low[0], low[1] - 1, low[2]), (low[0] / 6, high[1] + 1, high[2]))
    half = Dress(name="wood", box=left, roughness=0.2)
    chosen = half.faces(mesh)
    assert 0 < chosen.sum() <= count
    made = dressed(mesh, [half, Dress(emission=(1.0, 2.0, 3.0))])
    assert made.face_materials is not None
    for face in range(count):
        material = made.materials[made.face_materials[face]]
        assert material.roughness == (0.2 if chosen[face] else 1.0)
        assert tuple(material.emissive) == (1, 2, 3) and material.name == "wood"
    assert dressed(mesh, []) is mesh
    with pytest.raises(InputError, match="no faces of a material 'glass'; its materials are wood"):
        dressed(mesh, [Dress(name="glass", roughness=0.1)])
