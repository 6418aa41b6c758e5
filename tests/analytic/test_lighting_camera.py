"""Cameras and AOVs against closed forms: silhouettes to a fraction of a pixel, depth, position, normals, albedo."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mirelight.base import conventions
from mirelight.lighting import Tracer
from mirelight.model import Camera, DirectionalLight, Lighting, Material, ProxyMesh, RenderSettings, Wraps

from .lighting_scenes import Array, quad, render, sphere

POSE = conventions.look_at([0.4, 0.7, 5.0], [0.1, 0.2, 0.0])
CAMERAS = {
    "off-centre, non-square pixels": Camera(
        world_from_camera=POSE, width=90, height=60, fx=150.0, fy=110.0, cx=30.25, cy=41.75
    ),
    "far off-centre": Camera(world_from_camera=POSE, width=64, height=48, fx=300.0, fy=300.0, cx=-20.0, cy=70.0),
    "orthographic": Camera(
        world_from_camera=POSE,
        width=80,
        height=70,
        fx=30.0,
        fy=22.0,
        cx=33.5,
        cy=29.0,
        projection="orthographic",
    ),
    "very wide": Camera(world_from_camera=POSE, width=64, height=48, fx=16.0, fy=16.0, cx=32.0, cy=24.0),
}


def project(camera: Camera, points: Array) -> Array:
    """model.Camera's own words: (cx + fx x / w, cy - fy y / w)."""
    local = (points - camera.position) @ camera.world_from_camera[:3, :3]
    w = -local[:, 2:] if camera.projection == "perspective" else np.ones((len(points), 1))
    return np.concatenate([camera.cx + camera.fx * local[:, :1] / w, camera.cy - camera.fy * local[:, 1:2] / w], axis=1)


def polygon_coverage(corners: Array, width: int, height: int, grid: int = 16) -> Array:
    """(H, W) share of each pixel inside a convex polygon, on grid x grid points a pixel."""
    steps = (np.arange(grid) + 0.5) / grid
    x = (np.arange(width)[:, None] + steps).ravel()[None, :]
    y = (np.arange(height)[:, None] + steps).ravel()[:, None]
    edges = [
        (b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])
        for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)
    ]
    inside = np.all(np.stack(edges) > 0, axis=0) | np.all(np.stack(edges) < 0, axis=0)
    return np.asarray(inside.reshape(height, grid, width, grid).mean(axis=(1, 3)))


@pytest.mark.parametrize("name", CAMERAS)
def test_a_squares_silhouette_lands_on_its_pixels(name: str) -> None:
    camera = CAMERAS[name]
    on_ray = np.linalg.inv(camera.world_from_camera)  # a square in front of whatever the camera looks at
    centre = np.array([(camera.width / 2 - camera.cx) / camera.fx, (camera.cy - camera.height / 2) / camera.fy, -1.0])
    if camera.projection == "perspective":
        centre *= 5
    else:
        centre[2] = -5
    size = 0.3 * camera.width / camera.fx * (5 if camera.projection == "perspective" else 1)
    middle = camera.world_from_camera[:3, :3] @ centre + camera.position
    plate = quad(middle, [size, 0.1 * size, 0.2 * size], [-0.1 * size, 0.6 * size, 0])
    assert on_ray.shape == (4, 4)
    buffer = render(plate, camera, spp=256)
    truth = polygon_coverage(project(camera, plate.vertices.astype(np.float64)), camera.width, camera.height)
    assert 0.1 < truth.mean() < 0.9
    np.testing.assert_allclose(buffer.coverage, truth, atol=0.03)
    assert buffer.coverage.mean() == pytest.approx(truth.mean(), abs=3e-4)
    shift = [np.sum((buffer.coverage - truth) * k) for k in np.indices(truth.shape)]
    assert np.all(np.abs(shift) / truth.sum() < 0.02)  # the centre of gravity, in pixels


@pytest.mark.parametrize("name", CAMERAS)
def test_aovs_are_those_of_the_surface(name: str) -> None:
    """On a plane: position on it, depth along the view axis, both normals turned to the viewer."""
    camera = CAMERAS[name]
    normal = conventions.unit([0.2, 0.3, 1.0])
    x = conventions.unit(np.cross([0, 1, 0], normal))
    plane = quad([0, 0, -1], 500 * x, 500 * np.cross(normal, x))
    for proxy in (plane, replace(plane, faces=np.ascontiguousarray(plane.faces[:, ::-1]))):
        buffer = render(proxy, camera, spp=16)
        seen = buffer.coverage == 1
        position = buffer.position[seen].astype(np.float64)
        np.testing.assert_allclose((position - [0, 0, -1]) @ normal, 0, atol=2e-4)
        depth = (camera.position - position) @ camera.world_from_camera[:3, 2]
        np.testing.assert_allclose(buffer.depth[seen], depth, rtol=2e-5)
        pixel = project(camera, position)
        rows, columns = np.nonzero(seen)
        assert np.abs(pixel - np.stack([columns, rows], axis=1) - 0.5).max() < 0.3  # the mean of a pixel's samples
        side = np.sign(np.sum((camera.position - position) * normal, axis=1, keepdims=True))
        if camera.projection == "orthographic":
            side[:] = np.sign(camera.world_from_camera[:3, 2] @ normal)
        np.testing.assert_allclose(buffer.normal[seen], side * normal, atol=1e-5)
        np.testing.assert_allclose(buffer.geometric_normal[seen], side * normal, atol=1e-5)
        np.testing.assert_allclose(buffer.albedo[seen], 0.5)


def test_smooth_and_flat_normals_of_a_ball() -> None:
    camera = Camera.look_at([0, 0, 4], [0, 0, 0], 48, 48)
    buffer = render(sphere(smooth=True, rings=40), camera, spp=16)
    seen = buffer.coverage == 1
    outward = buffer.position[seen] / np.linalg.norm(buffer.position[seen], axis=1, keepdims=True)
    np.testing.assert_allclose(buffer.normal[seen], outward, atol=0.005)
    assert np.abs(buffer.geometric_normal[seen] - outward).max() > 0.01
    assert not buffer.normal[buffer.coverage == 0].any()


def test_near_and_far_planes_cut_the_proxy() -> None:
    wall = quad([0, 0, 0], [5, 0, 0], [0, 5, 0])
    camera = Camera.look_at([0, 0, 4], [0, 0, 0], 16, 16)
    for near, far, seen in ((0.1, np.inf, 1), (3.9, 4.1, 1), (4.1, 9.0, 0), (0.1, 3.9, 0)):
        for projection in ("perspective", "orthographic"):
            cut = replace(camera, near=near, far=far, projection=projection)
            assert np.all(render(wall, cut, spp=4).coverage == seen)


def test_the_files_own_colours_are_the_albedo() -> None:
    """Colour factor times texture times vertex colour; the texture's first row at v = 0, repeated beyond 1."""
    texture = np.zeros((2, 2, 3), np.float32)
    texture[0, 0], texture[0, 1], texture[1, 0], texture[1, 1] = (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)
    plate = quad([0, 0, 0], [1, 0, 0], [0, 1, 0])  # corners (-1,-1) (1,-1) (1,1) (-1,1)
    proxy = replace(
        plate,
        uvs=np.array([[-0.0, 2], [1, 2], [1, 1], [0, 1]], np.float32),
        vertex_colors=np.full((4, 3), 0.5, np.float32),
        materials=(Material(base_color=np.array([0.8, 0.6, 0.4]), base_color_texture=texture),),
        albedo=None,
    )
    camera = Camera.look_at([0, 0, 4], [0, 0, 0], 40, 40, yfov=float(np.degrees(2 * np.arctan(1 / 4))))
    albedo = render(proxy, camera, spp=16).albedo
    factor = 0.5 * np.array([0.8, 0.6, 0.4])
    for row, column, texel in ((10, 10, (1, 0, 0)), (10, 30, (0, 1, 0)), (30, 10, (0, 0, 1)), (30, 30, (1, 1, 1))):
        np.testing.assert_allclose(
            albedo[row - 1 : row + 1, column - 1 : column + 1].mean(axis=(0, 1)), factor * texel, atol=0.03
        )
    gray = render(replace(proxy, albedo=np.full(3, 0.25)), camera, spp=4).albedo
    np.testing.assert_allclose(gray[gray > 0], 0.25)


WRAPS: list[Wraps] = [("repeat", "mirror"), ("mirror", "clamp"), ("clamp", "repeat")]


def wrapped(texel: int, size: int, wrap: str) -> int:
    """The texel of an image that stands for one outside it (glTF §3.8.4)."""
    if wrap == "clamp":
        return min(max(texel, 0), size - 1)
    around = texel % (2 * size)
    return texel % size if wrap == "repeat" else min(around, 2 * size - 1 - around)


@pytest.mark.parametrize("wraps", WRAPS)
def test_each_axis_of_a_texture_wraps_in_its_own_way(wraps: Wraps) -> None:
    """A 3 x 2 image over u in -1..3 and v in -1..2, 10 x 10 pixels a texel, read in the middle of each."""
    texture = np.array([[[k & 1, k >> 1 & 1, k >> 2] for k in row] for row in ((1, 2, 3), (4, 5, 6))], np.float32)
    proxy = replace(
        quad([0, 0, 0], [1, 0, 0], [0, 1, 0]),
        uvs=np.array([[-1, 2], [3, 2], [3, -1], [-1, -1]], np.float32),
        materials=(Material(base_color_texture=texture, base_color_wrap=wraps),),
        albedo=None,
    )
    camera = Camera.look_at([0, 0, 4], [0, 0, 0], 120, 60, yfov=float(np.degrees(2 * np.arctan(1 / 4))))
    albedo = render(proxy, replace(camera, fx=2 * camera.fx), spp=64).albedo
    found = albedo.reshape(6, 10, 12, 10, 3)[:, 4:6, :, 4:6].mean(axis=(1, 3))
    rows = [wrapped(row - 2, 2, wraps[1]) for row in range(6)]
    columns = [wrapped(column - 3, 3, wraps[0]) for column in range(12)]
    np.testing.assert_allclose(found, texture[rows][:, columns], atol=0.12)  # half a pixel off the centre


def test_the_terminator_of_a_coarse_ball_is_smooth() -> None:
    """Sixteen facets round, smooth normals, light from the side: the lit half is lit like a sphere, without the dark
    saw-teeth that facets cast on their neighbours."""
    sun = DirectionalLight(name="sun", direction=np.array([-1.0, 0, 0]), intensity=np.pi)
    camera = Camera.look_at([0, 0, 6], [0, 0, 0], 64, 64, yfov=22)
    buffer = render(sphere(smooth=True, rings=16), camera, sun, spp=16)
    seen = buffer.coverage == 1
    cosine = np.maximum(buffer.normal[seen][:, 0], 0)
    np.testing.assert_allclose(buffer.beauty[seen][:, 0], 0.5 * cosine, atol=0.02)
    faceted = render(sphere(smooth=False, rings=16), camera, sun, spp=16)
    assert faceted.beauty[seen].mean() == pytest.approx(buffer.beauty[seen].mean(), rel=0.02)


def test_tiny_and_huge_scenes_are_lit_alike() -> None:
    """Offsets against self-shadowing scale with the scene: from a millimetre to ten kilometres nothing changes."""
    pictures = []
    for scale in (1e-3, 1.0, 1e4):
        ball = sphere(scale, rings=24)
        floor = quad([0, -scale, 0], [3 * scale, 0, 0], [0, 0, 3 * scale])
        vertices = np.concatenate([ball.vertices, floor.vertices])
        faces = np.concatenate([ball.faces, floor.faces + np.int32(len(ball.vertices))])
        camera = Camera.look_at(np.array([0, 2, 5]) * scale, [0, 0, 0], 48, 32, near=1e-3 * scale)
        sun = DirectionalLight(name="sun", direction=np.array([0.5, -1, -0.3]), intensity=3.0)
        pictures.append(render(ProxyMesh(vertices=vertices, faces=faces), camera, sun, spp=64, max_depth=1).beauty)
    for picture in pictures[::2]:
        assert picture.mean() == pytest.approx(pictures[1].mean(), rel=1e-3)
        assert np.mean(np.abs(picture - pictures[1]) > 0.02) < 0.005


def test_a_far_away_scene_does_not_shadow_itself() -> None:
    """A floor 100 km from the origin, lit at 3 degrees: no acne."""
    offset = np.array([1e5, 0, 1e5])
    floor = quad(offset, [40, 0, 0], [0, 0, 40])
    sun = DirectionalLight(name="sun", direction=np.array([1, -0.05, 0]), intensity=1.0)
    camera = Camera.look_at(offset + np.array([0, 20, 30]), offset, 48, 32)
    buffer = render(floor, camera, sun, spp=16)
    lit = buffer.beauty[buffer.coverage == 1]
    np.testing.assert_allclose(lit, 0.5 / np.pi * 0.05 / np.hypot(1, 0.05), rtol=1e-3)


def test_a_frame_is_a_frame_whatever_the_tracer_did_before() -> None:
    """A tracer keeps no state between frames."""
    ball = sphere(rings=12)
    camera = Camera.look_at([0, 1, 4], [0, 0, 0], 32, 24)
    sun = Lighting(lights=(DirectionalLight(name="sun", direction=np.array([0.5, -1, -0.3]), intensity=3.0),))
    tracer = Tracer(ball, RenderSettings(spp=8))
    first = tracer.trace(sun, camera)
    tracer.trace(Lighting(), Camera.look_at([3, 1, 4], [0, 0, 0], 10, 24))
    assert np.array_equal(first.beauty, tracer.trace(sun, camera).beauty)
