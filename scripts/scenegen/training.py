"""Splats as people have them: an optimiser makes them from pictures of a scene (`train.cpp`), and not from its surface.

They are fuzzy: half transparent, off the surface, thin axes that are no normals, shadows' edges smeared.
"""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from mirelight.base.colour import srgb_encode
from mirelight.model import Camera, Environment, Lighting, SplatCloud
from scenegen.truth import Truth

SOURCE = Path(__file__).with_name("train.cpp")
COMPILER = ("g++", "-O3", "-march=native", "-fno-math-errno", "-fno-trapping-math", "-fopenmp", "-std=c++17")
ROW = 59  # numbers of a splat in the trainer's result
OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])  # the trainer's cameras: x right, y down, z ahead
START_NOISE = 0.01  # of the scene's size: where structure from motion puts its points
LOOKED_FROM = (60, 40)  # pixels of the pictures in which start points are found
TEXTURE = 0.06  # least difference of neighbouring pixels, display-encoded, where structure from motion finds points
CLEAREST = 0.985  # opacity that training goes on from: nearer to 1 it no longer moves
NEIGHBOURS = 3  # whose mean distance a start point's size is

# cloned, split and pruned (3DGS); moved to where more are needed (MCMC); grown as discs without a width (2DGS)
Trainer = Literal["grown", "moved", "flat"]

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Shooting:
    """How pictures are taken, and what is trained on them."""

    size: tuple[int, int] = (360, 240)  # px
    spp: int = 16  # then denoised
    sky: bool = False  # it is in the pictures; else they are on black
    pose_noise: float = 0.0  # px by which what a camera looks at is off, as bundle adjustment leaves it
    exposure_noise: float = 0.0  # stops, deviation from picture to picture
    iterations: int = 1100
    most: int = 45_000  # splats
    points: int = 30_000  # that training starts from
    textured: bool = False  # they lie where pictures have texture alone, as structure from motion finds them
    trainer: Trainer = "grown"


def exposed(lighting: Lighting, stops: float) -> Lighting:
    """The same light as pictures show it that were exposed longer."""
    times = 2.0**stops
    sky = lighting.environment
    return replace(
        lighting,
        lights=tuple(replace(x, intensity=x.intensity * times) for x in lighting.lights),
        environment=None if sky is None else replace(sky, intensity=sky.intensity * times),
    )


def known(cameras: Sequence[Camera], how: Shooting) -> tuple[Camera, ...]:
    """The cameras as they are known: at the pictures' size, turned away from the true ones by the noise of poses."""
    rng = np.random.default_rng(11)
    return tuple(_turned(_sized(x, how.size), how.pose_noise * rng.normal(size=2)) for x in cameras)


def _sized(camera: Camera, size: tuple[int, int]) -> Camera:
    """With pictures of that size, as high a view and square pixels, which is all that Mitsuba's cameras have."""
    height = camera.resized(camera.width * size[1] // camera.height, size[1])
    return replace(height, width=size[0], fx=height.fy, cx=size[0] / 2)


def _turned(camera: Camera, pixels: F64) -> Camera:
    """Turned about its axes so that the middle of the picture moves by so many pixels."""
    yaw, pitch = pixels / [camera.fx, camera.fy]
    turn = np.eye(4)
    turn[:3, :3] = np.array([[1, 0, yaw], [0, 1, pitch], [-yaw, -pitch, 1]])
    u, _, v = np.linalg.svd(turn[:3, :3])
    turn[:3, :3] = u @ v
    return replace(camera, world_from_camera=camera.world_from_camera @ turn)


def trained(truth: Truth, pictures: Sequence[F32], cameras: Sequence[Camera], how: Shooting) -> F32:
    """Rows (N, 59) of splats that were trained on pictures; :func:`cloud_of` reads them.

    Args:
        truth: the scene under the captured light.
        pictures: as :func:`shots` takes them.
        cameras: the pictures'.
        how: they are taken and trained on.
    """
    return train(known(cameras, how), pictures, *_start(truth, pictures, cameras, how), how)


def shots(truth: Truth, lighting: Lighting, cameras: Sequence[Camera], how: Shooting) -> list[F32]:
    """The pictures (H, W, 3), display-encoded, clipped, in steps of 8 bits."""
    stops = how.exposure_noise * np.random.default_rng(13).normal(size=len(cameras))
    made = []
    for k, (camera, more) in enumerate(zip(cameras, stops, strict=True)):
        small = _sized(camera, how.size)
        image = truth.photograph(small, how.spp, seed=100 + k)
        light = before_sky(image, lighting, small) if how.sky else image[..., :3]
        shown = srgb_encode(np.clip(light * np.float32(2.0**more), 0, 1))
        made.append((np.round(255 * np.clip(shown, 0, 1)) / 255).astype(np.float32))
    return made


def before_sky(image: F32, lighting: Lighting, camera: Camera) -> F32:
    """(H, W, 3) a true picture (H, W, 4) of a camera with the sky of its light behind it, where that has one."""
    if lighting.environment is None:
        return image[..., :3]
    sky = behind(lighting.environment, directions(camera)).astype(np.float32)
    return np.asarray(image[..., :3] + (1 - image[..., 3:]) * sky, np.float32)


def directions(camera: Camera) -> F64:
    """(H, W, 3) unit, through the pixels' centres, world space."""
    x, y = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    local = np.stack([(x - camera.cx) / camera.fx, (camera.cy - y) / camera.fy, -np.ones_like(x)], axis=-1)
    local /= np.linalg.norm(local, axis=-1, keepdims=True)
    return np.asarray(local @ camera.world_from_camera[:3, :3].T)


def behind(sky: Environment, along: F64) -> F64:
    """Radiance (..., 3) of a sky that is not turned, along unit vectors; between its pixels it is linear."""
    radiance = sky.pixels.astype(np.float64) * sky.intensity
    height, width, _ = radiance.shape
    u = (np.arctan2(along[..., 2], along[..., 0]) / (2 * np.pi) + 0.5) * width - 0.5
    v = np.clip(np.arccos(np.clip(along[..., 1], -1, 1)) / np.pi * height - 0.5, 0, height - 1)
    left, top = np.floor(u).astype(int), np.minimum(v.astype(int), max(height - 2, 0))
    right, low = (u - left)[..., None], (v - top)[..., None]
    below = np.minimum(top + 1, height - 1)
    rows = [radiance[r, left % width] * (1 - right) + radiance[r, (left + 1) % width] * right for r in (top, below)]
    return np.asarray(rows[0] * (1 - low) + rows[1] * low)


def _start(truth: Truth, pictures: Sequence[F32], cameras: Sequence[Camera], how: Shooting) -> tuple[F64, F64]:
    """Points (N, 3) on what the pictures show, with noise, and their sizes (N,)."""
    rng = np.random.default_rng(5)
    found = []
    for camera, picture in zip(cameras, pictures, strict=True):
        small = camera.resized(*LOOKED_FROM)
        along = directions(small).reshape(-1, 3)
        away = truth.distance(np.broadcast_to(camera.position, along.shape), along)
        there = np.isfinite(away)
        if how.textured:
            there &= _textured(picture).ravel()
        found.append(camera.position + along[there] * away[there, None])
    points = np.concatenate(found)
    low, high = np.quantile(points, [0.02, 0.98], axis=0)
    points = points[rng.choice(len(points), min(how.points, len(points)), replace=False)]
    points += rng.normal(size=points.shape) * START_NOISE * np.linalg.norm(high - low) / np.sqrt(3)
    return points, sizes_of(points)


def _textured(picture: F32) -> NDArray[np.bool_]:
    """(h, w) of the pixels of :data:`LOOKED_FROM`: whether a picture (H, W, 3), a multiple of them, has texture."""
    grey = picture.mean(axis=2)
    steps = np.maximum(*(np.abs(np.diff(grey, axis=k, prepend=grey[:1] if k == 0 else grey[:, :1])) for k in (0, 1)))
    width, height = LOOKED_FROM
    cells = steps.reshape(height, len(picture) // height, width, picture.shape[1] // width)
    return np.asarray(cells.max(axis=(1, 3)) > TEXTURE)


def sizes_of(points: F64) -> F64:
    """(P,) deviations that splats at points (P, 3) start with."""
    near, _ = cKDTree(points).query(points, k=NEIGHBOURS + 1)
    return np.asarray(np.maximum(near[:, 1:].mean(axis=1), 1e-3))


def _packed(camera: Camera) -> F32:
    inverse = np.linalg.inv(camera.world_from_camera @ OPENCV)
    lens = [camera.fx, camera.fy, camera.cx, camera.cy]
    return np.concatenate([inverse[:3, :3].ravel(), inverse[:3, 3], lens, camera.position]).astype("<f4")


def train(cameras: Sequence[Camera], pictures: Sequence[F32], points: F64, sizes: F64, how: Shooting) -> F32:
    """Rows (N, 59) of splats. One machine makes the same bits by any number of threads.

    Args:
        cameras: the pictures'.
        pictures: (H, W, 3) each, display-encoded, on black.
        points: (P, 3) that it starts from.
        sizes: (P,) deviations of the splats there.
        how: how long, and how many splats.
    """
    colours = np.random.default_rng(7).random((len(points), 3))
    begun = np.concatenate([points, sizes[:, None], colours], axis=1)
    return _run(cameras, pictures, _extent(cameras, points), begun, None, how)


def refined(cloud: SplatCloud, cameras: Sequence[Camera], pictures: Sequence[F32], how: Shooting) -> SplatCloud:
    """Splats of one colour each that show the pictures already, trained on them: as many at most, of one colour each.

    Args:
        cloud: what training goes on from, of degree 0.
        cameras: the pictures'.
        pictures: (H, W, 3) each, display-encoded, on black.
        how: how long, and how many splats.
    """
    opacities = np.clip(cloud.opacities.astype(np.float64), 0.01, CLEAREST)
    rows = np.zeros((len(cloud), ROW), "<f4")
    rows[:, :3], rows[:, 3:6], rows[:, 6:10] = cloud.means, np.log(cloud.scales), cloud.quats
    rows[:, 10], rows[:, 11:14] = np.log(opacities / (1 - opacities)), cloud.sh[:, 0]
    extent = _extent(cameras, cloud.means.astype(np.float64))
    made = cloud_of(_run(cameras, pictures, extent, np.zeros((0, 7)), rows, how))
    return replace(made, sh=made.sh[:, :1])


def _extent(cameras: Sequence[Camera], points: F64) -> float:
    """The length that steps are measured in."""
    eyes = np.stack([x.position for x in cameras])
    low, high = np.quantile(points, [0.02, 0.98], axis=0)
    # a person in a room hardly moves: lengths are the scene's where it is larger than the walk
    walked = float(np.linalg.norm(eyes - eyes.mean(axis=0), axis=1).max())
    return max(1.1 * walked, 0.4 * float(np.linalg.norm(high - low)))


def _run(
    cameras: Sequence[Camera], pictures: Sequence[F32], extent: float, points: F64, start: F32 | None, how: Shooting
) -> F32:
    """Rows of the program, from points (P, 7) or from rows that are there, which then stay of degree 0."""
    with tempfile.TemporaryDirectory() as folder:
        data, result = Path(folder) / "data", Path(folder) / "result"
        with data.open("wb") as out:
            out.write(np.array([*how.size, len(cameras), len(points)], "<i4").tobytes())
            out.write(np.array([extent], "<f4").tobytes())
            for camera, picture in zip(cameras, pictures, strict=True):
                out.write(_packed(camera).tobytes())
                out.write(np.ascontiguousarray(picture.transpose(2, 0, 1), "<f4").tobytes())
            out.write(points.astype("<f4").tobytes())
        limits = [str(how.iterations), str(how.most), how.trainer]
        if start is not None:
            begun = Path(folder) / "start"
            start.tofile(begun)
            limits += ["0", str(begun)]
        program = Path(folder) / "train"
        subprocess.run([*COMPILER, SOURCE, "-o", program], check=True)  # takes seconds
        subprocess.run([program, data, result, *limits], check=True, stdout=subprocess.DEVNULL)
        return np.fromfile(result, "<f4").reshape(-1, ROW)


def cloud_of(rows: F32) -> SplatCloud:
    """The splats of the trainer's rows."""
    turns = rows[:, 6:10] / np.linalg.norm(rows[:, 6:10], axis=1, keepdims=True)
    return SplatCloud(
        means=rows[:, :3],
        quats=turns,
        scales=np.exp(rows[:, 3:6]),
        opacities=(1 / (1 + np.exp(-rows[:, 10]))).astype(np.float32),
        sh=rows[:, 11:].reshape(-1, 16, 3),
    )
