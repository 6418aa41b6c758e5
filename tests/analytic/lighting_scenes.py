"""Small proxies, cameras and statistics shared by the lighting tests."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mirelight.base import conventions
from mirelight.lighting import Tracer
from mirelight.model import (
    Camera,
    Environment,
    Light,
    Lighting,
    LightingBuffer,
    ProxyMesh,
    RenderSettings,
)

Array = NDArray[np.float64]

FLOOR = ProxyMesh(
    vertices=np.array([[-50, 0, -50], [-50, 0, 50], [50, 0, 50], [50, 0, -50]], np.float32),
    faces=np.array([[0, 1, 2], [0, 2, 3]], np.int32),
)


def overhead(width: int, height: int, *, extent: float) -> Camera:
    """An orthographic camera that looks down on the floor; a pixel's centre is exactly one point of it."""
    matrix = conventions.look_at([0, 100, 0], [0, 0, 0], up=[0, 0, -1])
    scale = width / extent
    return Camera(
        world_from_camera=matrix,
        width=width,
        height=height,
        fx=scale,
        fy=scale,
        cx=width / 2,
        cy=height / 2,
        projection="orthographic",
    )


def floor_mean(camera: Camera, brightness: Callable[[Array], Array], *, grid: int = 8) -> Array:
    """(H, W) mean of brightness(points (..., 3)) over each pixel of `overhead`, on grid x grid points of the floor."""
    step = (np.arange(grid) + 0.5) / grid
    x = (np.arange(camera.width)[:, None] + step - camera.cx) / camera.fx
    z = (np.arange(camera.height)[:, None] + step - camera.cy) / camera.fy
    points = np.zeros((camera.height, grid, camera.width, grid, 3))
    points[..., 0], points[..., 2] = x, z[:, :, None, None]
    return np.asarray(brightness(points).mean(axis=(1, 3)))


def join(*meshes: ProxyMesh) -> ProxyMesh:
    """One proxy of several, without normals."""
    vertices = np.concatenate([m.vertices for m in meshes])
    starts = np.cumsum([0] + [len(m.vertices) for m in meshes[:-1]])
    faces = np.concatenate([m.faces + start for m, start in zip(meshes, starts, strict=True)])
    return ProxyMesh(vertices=vertices, faces=faces.astype(np.int32), albedo=meshes[0].albedo)


def quad(centre: ArrayLike, x: ArrayLike, y: ArrayLike) -> ProxyMesh:
    """A parallelogram with half edges x and y."""
    c, x, y = (np.asarray(v, np.float64) for v in (centre, x, y))
    corners = np.array([c - x - y, c + x - y, c + x + y, c - x + y], np.float32)
    return ProxyMesh(vertices=corners, faces=np.array([[0, 1, 2], [0, 2, 3]], np.int32))


def sphere(radius: float = 1.0, *, rings: int = 32, smooth: bool = False, centre: ArrayLike = (0, 0, 0)) -> ProxyMesh:
    """A ball of `rings` x 2 `rings` facets; its vertices lie on the true sphere."""
    theta = np.linspace(0, np.pi, rings + 1)
    phi = np.linspace(0, 2 * np.pi, 2 * rings, endpoint=False)
    t, f = np.meshgrid(theta, phi, indexing="ij")
    normals = np.stack([np.sin(t) * np.cos(f), np.cos(t), np.sin(t) * np.sin(f)], axis=-1).reshape(-1, 3)
    faces = []
    for i in range(rings):
        for j in range(2 * rings):
            a, b = i * 2 * rings + j, i * 2 * rings + (j + 1) % (2 * rings)
            c, d = a + 2 * rings, b + 2 * rings
            faces += [[a, b, c]] * (i > 0) + [[b, d, c]] * (i < rings - 1)
    return ProxyMesh(
        vertices=(normals * radius + np.asarray(centre)).astype(np.float32),
        faces=np.asarray(faces, np.int32),
        normals=normals.astype(np.float32) if smooth else None,
    )


def constant_sky(radiance: float) -> Environment:
    """The same light from all around."""
    return Environment(radiance=np.full((1, 1, 3), radiance, np.float32))


def render(
    proxy: ProxyMesh,
    camera: Camera,
    *lights: Light,
    environment: Environment | None = None,
    spp: int = 16,
    max_depth: int = 1,
    seed: int = 0,
) -> LightingBuffer:
    """Trace with a fresh tracer."""
    settings = RenderSettings(spp=spp, max_depth=max_depth, seed=seed)
    return Tracer(proxy, settings).trace(Lighting(lights=lights, environment=environment), camera)


def seeds(tracer: Tracer, lighting: Lighting, camera: Camera, count: int) -> Array:
    """(count, H, W, 3) beauties of independent seeds of one tracer."""
    out = []
    first = tracer.settings
    for seed in range(count):
        tracer.settings = replace(first, seed=first.seed + 1000 + seed)
        out.append(tracer.trace(lighting, camera).beauty.astype(np.float64))
    tracer.settings = first
    return np.stack(out)
