"""A dome of sky about things is told from the walls of a room, from a ball, and from things alone."""

from __future__ import annotations

import numpy as np
import pytest

from mirelight.base.errors import InputError
from mirelight.model import F64
from mirelight.proxy.capture import look_at_capture
from mirelight.proxy.dome import on_dome

from .clouds import ball, on_surface, sphere_points, square

GROUND, _ = square(20.0, 0.25, 1, 0.0)
THING = sphere_points(1500) * 0.5 + np.array([1.0, 0.5, 0])
DOME = 40 * sphere_points(12_000)


@pytest.mark.parametrize("half", [False, True])
@pytest.mark.parametrize("middle", [(0, 0, 0), (300, -20, 5)])
def test_a_dome_or_half_of_one_is_told(half: bool, middle: tuple[float, float, float]) -> None:
    dome = DOME[DOME[:, 1] > 0] if half else DOME
    points = np.concatenate([GROUND, THING, dome]) + np.array(middle)
    found = on_dome(points)
    assert not found[: -len(dome)].any() and found[-len(dome) :].all()


def box(half: tuple[float, float, float], count: int = 20_000) -> F64:
    """Points on the walls of a room."""
    points = np.random.default_rng(0).uniform(-1, 1, (count, 3))
    points[np.arange(count), np.arange(count) % 3] = np.sign(points[np.arange(count), np.arange(count) % 3])
    return np.asarray(points * np.array(half))


@pytest.mark.parametrize(
    "points",
    [
        np.concatenate([GROUND, THING]),
        np.concatenate([box((2, 1.5, 2.5)), THING]),  # a room
        np.concatenate([box((15, 20, 40)), THING]),  # a nave
        sphere_points(5000),  # a ball
        np.concatenate([GROUND, THING, 40 * sphere_points(12_000)[:1500]]),  # a cap of cloud
        np.concatenate([GROUND * 3, THING, 40 * np.random.default_rng(1).normal(size=(12_000, 3))]),  # fog
    ],
)
def test_nothing_else_is_one(points: F64) -> None:
    assert not on_dome(points).any()


def test_a_capture_is_what_lies_within() -> None:
    points = np.concatenate([GROUND, THING, DOME])
    cloud = on_surface(points, np.tile([0.0, 1.0, 0.0], (len(points), 1)), 0.1, thin=0.3)
    assert look_at_capture(cloud, "world").radius < 20
    with pytest.raises(InputError, match="too few"):
        look_at_capture(ball(40), "ball")
