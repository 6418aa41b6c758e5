"""Captures that are trained on pictures: the trainer and mirelight's own compositor mean the same by a splat."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scenegen import training
from scenegen.skies import directions
from scenegen.training import Shooting

from mirelight.compositor import Compositor
from mirelight.model import Camera, Environment, Lighting, SplatCloud, SunLight

COUNT = 60
SIZE = (40, 30)


def _cloud() -> SplatCloud:
    """Coloured blobs of all shapes."""
    rng = np.random.default_rng(3)
    quats = rng.normal(size=(COUNT, 4))
    return SplatCloud(
        means=rng.uniform(-0.7, 0.7, (COUNT, 3)).astype(np.float32),
        quats=quats / np.linalg.norm(quats, axis=1, keepdims=True),
        scales=np.exp(rng.uniform(-3.2, -1.6, (COUNT, 3))),
        opacities=rng.uniform(0.4, 0.95, COUNT).astype(np.float32),
        sh=np.concatenate([rng.uniform(-1.2, 1.2, (COUNT, 1, 3)), rng.normal(0, 0.15, (COUNT, 15, 3))], axis=1),
    )


def _cameras() -> list[Camera]:
    turns = np.linspace(0, 2 * np.pi, 11)[:-1]
    eyes = [(2.6 * np.sin(t), 0.9 * np.cos(2 * t), 2.6 * np.cos(t)) for t in turns]
    return [Camera.look_at(eye, (0, 0, 0), *SIZE, yfov=45) for eye in eyes]


def _picture(cloud: SplatCloud, camera: Camera) -> NDArray[np.float32]:
    return np.clip(Compositor(cloud).composite(camera, depth=False).color, 0, 1)


def test_trained_splats_show_their_pictures_and_threads_change_no_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    true, cameras = _cloud(), _cameras()
    pictures = [_picture(true, x) for x in cameras]
    rng = np.random.default_rng(4)
    points = true.means.astype(np.float64) + rng.normal(0, 0.03, (COUNT, 3))
    how = Shooting(size=SIZE, iterations=400, most=400)
    monkeypatch.setattr(training, "COMPILER", (*training.COMPILER[:1], "-O1", *training.COMPILER[2:]))
    made = []
    for threads in ("1", "3"):
        monkeypatch.setenv("OMP_NUM_THREADS", threads)
        made.append(training.train(cameras[1:], pictures[1:], points, np.full(COUNT, 0.1), how))
    np.testing.assert_array_equal(made[0], made[1])
    assert COUNT < len(made[0]) <= how.most  # it has split and cloned
    errors = [
        np.mean((_picture(training.cloud_of(made[0]), x) - y) ** 2) for x, y in zip(cameras, pictures, strict=True)
    ]
    assert np.mean(errors[1:]) < 10**-2.4  # 24 dB: what it was trained on
    assert errors[0] < 10**-1.5  # a view that it was not given


def test_noise_of_poses_is_in_pixels() -> None:
    camera = _cameras()[2]
    how = Shooting(size=(200, 150), pose_noise=0.5)
    moved = []
    for noisy in training.known([camera] * 40, how):
        local = noisy.camera_from_world[:3, :3] @ -camera.world_from_camera[:3, 2]
        moved.append(noisy.fx * local[:2] / -local[2])
    assert np.std(moved) == pytest.approx(0.5, rel=0.25)
    still = training.known([camera], Shooting(size=(200, 150)))[0]
    np.testing.assert_allclose(still.world_from_camera, camera.world_from_camera, atol=1e-12)


def test_the_sky_behind_pictures_is_where_the_light_comes_from() -> None:
    along = directions(32)
    radiance = np.stack([1 + along[..., 0], 1 + along[..., 1], 1 + along[..., 2]], axis=-1).astype(np.float32)
    sky = Environment(radiance=radiance, intensity=2.0)
    seen = np.random.default_rng(2).normal(size=(200, 3))
    seen /= np.linalg.norm(seen, axis=1, keepdims=True)
    np.testing.assert_allclose(training.behind(sky, seen), 2 * (1 + seen), atol=0.03)


def test_a_longer_exposure_is_a_stronger_light() -> None:
    sun = SunLight(name="sun", direction=np.array([0.0, -1, 0]), color=np.ones(3), intensity=3.0)
    light = Lighting(name="day", lights=(sun,), environment=Environment(radiance=np.ones((1, 1, 3), np.float32)))
    made = training.exposed(light, 1.0)
    assert made.environment is not None
    assert (made.lights[0].intensity, made.environment.intensity) == (6.0, 2.0)
