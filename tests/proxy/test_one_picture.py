"""Splats that a network set on the pixels of one picture are looked at from where it was taken."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mirelight.apps.first_job import Wish, job_for
from mirelight.io import splats
from mirelight.model import SplatCloud
from mirelight.proxy import make
from mirelight.proxy.guessed import taken_from
from mirelight.proxy.one_picture import takers
from mirelight.proxy.types import ProxySettings

from .clouds import ball

WIDE, HIGH, FOCAL = 200, 120, 150.0  # pixels
GLTF = np.diag([1.0, -1.0, -1.0, 1.0])  # to a world with Y up, looked at along -Z


def of_one_picture() -> SplatCloud:
    """A floor before a wall, 4 units off, in OpenCV's axes: a splat a pixel, and one behind it."""
    u, v = np.meshgrid(np.arange(WIDE) + 0.5, np.arange(HIGH) + 0.5)
    ray = np.stack([(u - WIDE / 2) / FOCAL, (v - HIGH / 2) / FOCAL, np.ones_like(u)], axis=-1)
    depth = np.minimum(4.0, 1.2 / np.maximum(ray[..., 1], 1e-9))  # the floor lies 1.2 below the eye
    means = np.concatenate([(ray * (k * depth)[..., None]).reshape(-1, 3) for k in (1.0, 1.01)])
    n = len(means)
    size = 0.6 * means[:, 2] / FOCAL
    colour = 0.4 * np.sin(9 * means)  # something to look at
    return SplatCloud(
        means=means.astype(np.float32),
        quats=np.tile(np.array([1, 0, 0, 0], np.float32), (n, 1)),
        scales=np.repeat(size[:, None], 3, axis=1).astype(np.float32),
        opacities=np.full(n, 0.95, np.float32),
        sh=colour[:, None].astype(np.float32),
    )


@pytest.mark.parametrize("axes", [np.eye(4), GLTF])
def test_its_camera_stands_at_the_origin_and_has_its_lens(axes: np.ndarray) -> None:
    (camera,) = takers(splats.transform(of_one_picture(), axes))
    np.testing.assert_allclose(axes[:3, :3] @ GLTF[:3, :3], camera.world_from_camera[:3, :3], atol=1e-12)
    np.testing.assert_array_equal(camera.position, 0)
    assert camera.width == pytest.approx(WIDE, rel=0.02) and camera.height == pytest.approx(HIGH, rel=0.02)
    assert camera.fx == pytest.approx(FOCAL, rel=0.02) and camera.fy == camera.fx
    assert camera.cx == pytest.approx(WIDE / 2, rel=0.02) and camera.cy == pytest.approx(HIGH / 2, rel=0.02)


def test_hidden_splats_may_have_been_thrown_away() -> None:
    cloud = of_one_picture()
    kept = (np.arange(len(cloud)) < len(cloud) // 2) | (cloud.means[:, 0] < 0)  # those behind the right half are gone
    few = replace(cloud, **{k: getattr(cloud, k)[kept] for k in ("means", "quats", "scales", "opacities", "sh")})
    (camera,) = takers(few)
    assert camera.width / camera.height == pytest.approx(WIDE / HIGH, rel=0.02)


def test_other_splats_were_not_made_of_one_picture() -> None:
    cloud, rng = of_one_picture(), np.random.default_rng(0)
    assert not takers(ball(30_000))
    assert not takers(replace(cloud, means=cloud.means + np.array([0.5, 0, -2], np.float32)))  # moved
    sides = rng.choice(np.array([-1, 1], np.float32), (len(cloud), 1))
    assert not takers(replace(cloud, means=cloud.means * sides))  # behind the eye as well
    dense = rng.choice(len(cloud), len(cloud), p=(w := np.exp(-4 * np.abs(cloud.means[:, 0]))) / w.sum())
    assert not takers(replace(cloud, means=cloud.means[dense]))  # as dense as detail, as trained splats are
    assert not takers(replace(cloud, means=np.full_like(cloud.means, 1)))


def panorama(kind: str) -> SplatCloud:
    """A room of 4 x 3 x 5 about the eye, a splat a pixel: of a cube's sides, or of rows and columns."""
    if kind == "sides":
        u, v = (x.ravel() for x in np.meshgrid(*2 * [(np.arange(64) + 0.5) / 32 - 1]))
        ways = np.concatenate([np.roll(np.stack([s + 0 * u, u, v], 1), k, axis=1) for k in range(3) for s in (1, -1)])
    else:
        turn, height = (x.ravel() for x in np.meshgrid((np.arange(256) + 0.5) / 256, (np.arange(128) + 0.5) / 128))
        turn, height = 2 * np.pi * turn, np.pi * (height - 0.5)
        flat = np.cos(height)
        ways = np.stack([flat * np.sin(turn), np.sin(height), flat * np.cos(turn)], axis=1)
    means = ways * np.min([2, 1.5, 2.5] / np.maximum(np.abs(ways), 1e-9), axis=1, keepdims=True)
    one, n = of_one_picture(), len(means)
    return replace(
        one,
        means=means.astype(np.float32),
        **{k: getattr(one, k)[:n] for k in ("quats", "scales", "opacities", "sh")},
    )


@pytest.mark.parametrize("kind", ["sides", "rows"])
def test_a_panorama_is_looked_at_all_round(kind: str) -> None:
    cameras = takers(panorama(kind))
    assert len(cameras) == 6 and all(not x.position.any() for x in cameras)
    poses = [x.world_from_camera for x in cameras]
    np.testing.assert_allclose(np.sum(poses, axis=0)[:3, 2], 0, atol=1e-12)  # each side, and that across from it
    moved = replace(panorama(kind), means=panorama(kind).means + np.array([0.6, 0, 0], np.float32))
    assert not takers(moved)


def test_what_is_made_of_it_is_made_from_there() -> None:
    (camera,) = taken_from(of_one_picture(), ProxySettings())
    np.testing.assert_allclose(camera.position, 0, atol=1e-6)


def test_a_first_job_shows_what_the_picture_showed(tmp_path: Path) -> None:
    path = tmp_path / "photo.spz"
    splats.write(of_one_picture(), path)
    job = job_for(path, tmp_path, Wish()).text
    assert "position = [0, 0, 0]" in job
    assert "rotation_euler = [0, 0, 180]" in job  # most of what it shows is a wall, which is no floor
    (yfov,) = re.findall(r"yfov = ([\d.]+)", job)
    assert float(yfov) == pytest.approx(np.degrees(2 * np.arctan(WIDE / 2 / FOCAL * 9 / 16)), abs=0.5)


def test_a_sky_that_is_believed_to_be_anywhere_is_no_part_of_the_proxy() -> None:
    cloud = of_one_picture()
    sky = cloud.means[:, 1] < -0.3 * cloud.means[:, 2]  # the upper part of the picture
    far = np.where(sky, np.exp(np.random.default_rng(2).uniform(4, 7, len(sky))), 1).astype(np.float32)[:, None]
    cloud = replace(cloud, means=cloud.means * far, scales=cloud.scales * far)
    mesh = make(cloud).mesh
    assert len(mesh.faces) > 1000
    assert np.abs(mesh.vertices).max() < 12
