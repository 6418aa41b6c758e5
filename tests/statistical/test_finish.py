"""Materials told by how pictures change with the view: a glazed and a matt board under a lamp and a sky."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mirelight.estimate import finish
from mirelight.lighting import Tracer
from mirelight.model import Camera, Environment, Lighting, Material, PointLight, ProxyMesh, RenderSettings, SplatLayer

SETTINGS = RenderSettings(spp=32)
TRUE = (0.4, 0.6)  # roughness of the first board; none of those that are tried
LIGHT = Lighting(
    lights=(PointLight(name="lamp", position=np.array([0.0, 1.2, -0.6]), intensity=1.0),),
    environment=Environment(name="sky", radiance=np.full((1, 1, 3), 0.1, np.float32)),
)


def boards(roughness: float = TRUE[0], n: int = 12) -> ProxyMesh:
    """Two boards side by side, from x = -1 to 0 and from 0 to 1, in two materials."""
    s, t = np.meshgrid(np.linspace(-1, 1, 2 * n + 1), np.linspace(-0.6, 0.6, n + 1), indexing="ij")
    vertices = np.stack([s, 0 * s, t], axis=-1).reshape(-1, 3).astype(np.float32)
    k = (np.arange(2 * n)[:, None] * (n + 1) + np.arange(n)).ravel()
    faces = np.concatenate([np.stack([k, k + 1, k + n + 1], 1), np.stack([k + 1, k + n + 2, k + n + 1], 1)])
    right = vertices[faces].mean(axis=1)[:, 0] > 0
    return ProxyMesh(
        vertices=vertices,
        faces=faces.astype(np.int32),
        vertex_colors=np.full((len(vertices), 3), 0.3, np.float32),
        face_materials=right.astype(np.int32),
        materials=(Material(name="glazed", roughness=roughness), Material(name="matt")),
        albedo=None,
    )


def views(roughness: float) -> list[SplatLayer]:
    """What six cameras saw: the matt light, and what the glaze adds to it."""
    mesh, out = boards(roughness), list[SplatLayer]()
    matt = Tracer(mesh, SETTINGS, layers=False, aovs=False)
    lobes = Tracer(mesh, SETTINGS, layers=False, aovs=False, lobes=True)
    for k in range(6):
        turn = np.pi * k / 3
        eye = (1.3 * np.sin(turn), 1.0, 1.3 * np.cos(turn))
        camera = Camera.look_at(eye, (0, 0, 0), 48, 32, yfov=50, name=f"{k}")
        plain, shine = matt.trace(LIGHT, camera), lobes.trace(LIGHT, camera)
        out.append(
            SplatLayer(
                camera=camera,
                color=plain.beauty + shine.beauty,
                transmittance=1 - plain.coverage,
                depth=plain.depth,
                median_depth=plain.depth,
                linear=True,
            )
        )
    return out


@pytest.mark.parametrize("true", TRUE)
def test_a_glaze_is_told_from_what_is_matt(true: float) -> None:
    mesh = boards()
    assert mesh.face_materials is not None
    bare = replace(mesh, materials=(Material(), Material()))
    glazed, matt = finish.finishes(bare, mesh.face_materials, ("glazed", "matt"), LIGHT, views(true), SETTINGS)
    assert abs(glazed.roughness - true) < 0.05 and glazed.metallic == 0 and glazed.is_told
    assert matt.roughness == 1 and not matt.is_told
    dressed = finish.finished(bare, mesh.face_materials, (glazed, matt))
    assert dressed.face_materials is not None
    np.testing.assert_array_equal(
        [dressed.materials[k].roughness < 1 for k in dressed.face_materials], mesh.face_materials == 0
    )


def test_parts_are_alike_in_colour_and_place() -> None:
    """A mesh of one material in two colours falls into parts that each have one."""
    mesh = boards()
    right = mesh.vertices[:, 0] > 1e-6
    colors = np.where(right[:, None], (0.8, 0.1, 0.1), (0.1, 0.1, 0.8))
    one = replace(mesh, materials=(Material(),), face_materials=None, vertex_colors=colors.astype(np.float32))
    regions, names = finish.regions_of(one)
    side = mesh.face_materials
    assert side is not None and len(regions) == len(mesh.faces) and regions.max() == len(names) - 1
    mixed = [0 < side[regions == k].mean() < 1 for k in range(len(names))]
    assert np.mean(mixed) < 0.2  # those along the border alone
