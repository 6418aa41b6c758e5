"""The room as a person captures it who walks round in it and looks about. Only for `scripts/bench truth`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mirelight.model import Camera
from scenegen import interior
from scenegen.recipe import Recipe

STOPS = 27
MIDDLE, HALF = np.array([0.25, 1.5, -0.05]), np.array([1.35, 0.1, 1.45])  # of the way round, metres
YAWS, PITCHES = (-38, 30, -12, 55), (-24, 8, -8, -32, 14)  # degrees, away from straight across, taken in turn


def _walk() -> tuple[Camera, ...]:
    """Two looks across at each stop, turned and tilted."""
    views = []
    for k in range(2 * STOPS):
        turn = 2 * np.pi * (k // 2) / STOPS
        eye = MIDDLE + HALF * [np.cos(turn), np.sin(1.5 * k), np.sin(turn)]
        yaw = turn + np.pi + np.radians(YAWS[k % len(YAWS)])
        ahead = np.array([np.cos(yaw), np.tan(np.radians(PITCHES[k % len(PITCHES)])), np.sin(yaw)])
        views.append(Camera.look_at(eye, eye + ahead, 960, 640, yfov=60, name=f"walk {k}"))
    return tuple(views)


def recipe() -> Recipe:
    """The room's, but for the cameras."""
    return replace(interior.recipe(), name="interior_walk", orbit=_walk())
