"""Depth maps that put each other right: planes whose pictures and depth are known in closed form."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from mirelight.base.progress import quiet
from mirelight.model import F64, Camera
from mirelight.proxy.depth import DepthMap
from mirelight.proxy.stereo import agreed, neighbours
from mirelight.proxy.types import ProxySettings
from mirelight.proxy.views import rays

WIDTH, HEIGHT = 96, 72
SETTINGS = ProxySettings()
WALL, FLOOR = -2.0, -0.8  # the plane z = WALL, and y = FLOOR before it
Bool = np.ndarray


def cameras(count: int = 7) -> list[Camera]:
    """Side by side, looking at one point."""
    eyes = [((k - (count - 1) / 2) * 0.25, 0.1 * (k % 3), 1.0) for k in range(count)]
    return [Camera.look_at(eye, (0, -0.3, WALL), WIDTH, HEIGHT, yfov=45, name=f"{k}") for k, eye in enumerate(eyes)]


def texture(p: F64) -> F64:
    """(..., 3) display values of points: waves of several lengths, of no symmetry."""
    total = np.zeros((*p.shape[:-1], 3))
    chance = np.random.default_rng(7)
    for _ in range(24):
        way, shift = chance.normal(size=3) * chance.uniform(4, 22), chance.uniform(0, 6.3, 3)
        total += np.sin((p @ way)[..., None] + shift)
    return np.clip(0.5 + 0.07 * total, 0, 1)


def seen(camera: Camera) -> tuple[F64, F64, F64]:
    """(H, W) true depth, (H, W, 3) normal and (H, W, 3) display values, a pixel each the mean of nine points."""
    origin, directions = rays(camera)
    fine = camera.resized(camera.width * 3, camera.height * 3)
    depth, floor = _met(origin, directions)
    there, _ = _met(origin, rays(fine)[1])
    color = texture(origin + rays(fine)[1] * there[..., None])
    small = color.reshape(camera.height, 3, camera.width, 3, 3).mean(axis=(1, 3))
    return depth, np.where(floor[..., None], (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)), small


def _met(origin: F64, directions: F64) -> tuple[F64, Bool]:
    wall = (WALL - origin[2]) / directions[..., 2]
    with np.errstate(divide="ignore"):
        floor = (FLOOR - origin[1]) / directions[..., 1]
    on_floor = (floor > 0) & (floor < wall)
    return np.where(on_floor, floor, wall), on_floor


def capture(off: Callable[[F64], F64]) -> tuple[list[DepthMap], list[F64]]:
    """Depth maps that are off, and the true depths."""
    views, depths = [], []
    for camera in cameras():
        depth, normal, color = seen(camera)
        ones = np.ones(depth.shape, np.float32)
        views.append(
            DepthMap(
                camera,
                color.astype(np.float32),
                ones,
                off(depth).astype(np.float32),
                normal.astype(np.float32),
                0.01 * ones,
                ones,
            )
        )
        depths.append(depth)
    return views, depths


def errors(views: list[DepthMap], depths: list[F64]) -> F64:
    """By how many pixels' sides depths are off, of all pixels that show something."""
    return np.concatenate(
        [np.abs(v.depth / d - 1)[v.depth > 0] * v.camera.fx for v, d in zip(views, depths, strict=True)]
    )


def test_depths_that_are_off_everywhere_come_right() -> None:
    """2.4 sides of a pixel before the surface: of splats that were trained it is one to three."""
    views, depths = capture(lambda d: d * (1 - 2.4 / cameras()[0].fx))
    found = agreed(views, SETTINGS, 0.03, quiet)
    assert np.median(errors(views, depths)) == pytest.approx(2.4, rel=1e-3)
    assert np.median(errors(found, depths)) < 0.4
    assert np.mean(errors(found, depths) > 1.2) < 0.15


def floating(depth: F64) -> F64:
    """A tenth of the pixels, in patches, at half their depth: neither their plane nor one beside it is theirs."""
    rows, columns = np.indices(depth.shape)
    return np.where((rows // 8 % 3 == 1) & (columns // 8 % 3 == 1), 0.5 * depth, depth)


def test_what_hangs_before_the_surface_is_moved_onto_it_or_left_out() -> None:
    views, depths = capture(floating)
    found = agreed(views, SETTINGS, 0.03, quiet)
    before, after = (np.mean(errors(x, depths) > 5) for x in (views, found))
    assert before > 0.1
    assert after < 0.1 * before


def test_what_guessed_views_look_through_stays() -> None:
    """No picture was taken there: what they show behind it may be the fog between the places of those."""

    views, _ = capture(floating)
    assert all((x.depth > 0).all() for x in agreed(views, SETTINGS, 0.03, quiet, guessed=True))


def test_views_of_nothing_common_change_nothing() -> None:
    """Noise, as captures show whose poses are off: what splats tell stays, to the bit."""
    views, _ = capture(lambda d: d * 0.97)
    chance = np.random.default_rng(1)
    noise = [replace(x, color=0.8 * chance.random(x.color.shape, np.float32)) for x in views]
    assert all(a is b for a, b in zip(agreed(noise, SETTINGS, 0.03, quiet), noise, strict=True))


def test_white_pixels_stay() -> None:
    """They tell where windows are."""
    views, _ = capture(lambda d: d * 0.97)
    white = [replace(x, color=np.where(np.arange(WIDTH)[:, None] < WIDTH // 2, x.color, np.float32(1))) for x in views]
    found = agreed(white, SETTINGS, 0.03, quiet)
    half = slice(None), slice(WIDTH // 2, None)
    for a, b in zip(white, found, strict=True):
        assert all((getattr(a, x)[half] == getattr(b, x)[half]).all() for x in ("depth", "trust"))
    assert (found[3].depth[:, : WIDTH // 2] != white[3].depth[:, : WIDTH // 2]).mean() > 0.9


def test_twice_the_same_bits() -> None:
    views, _ = capture(lambda d: d * 0.98)
    once, again = (agreed(views, replace(SETTINGS, threads=n), 0.03, quiet) for n in (1, 2))
    for a, b in zip(once, again, strict=True):
        assert (a.depth == b.depth).all() and (a.normal == b.normal).all()


def test_views_of_other_places_are_no_neighbours() -> None:
    views, _ = capture(lambda d: d)
    away = replace(views[0], camera=Camera.look_at((0, 0, 1), (0, 0, 5), WIDTH, HEIGHT, yfov=45))
    near = neighbours([*views, away])
    assert near[-1] == []
    assert all(len(views) not in others and k not in others for k, others in enumerate(near))
    assert all(len(others) > 3 for others in near[:-1])
