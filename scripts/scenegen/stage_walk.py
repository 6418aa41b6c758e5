"""The stage as a person captures it who walks past before it, to and fro. Only for `scripts/bench truth`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mirelight.model import Camera
from scenegen import stage
from scenegen.recipe import Recipe

VIEWS = 40
TURNS = 62.0  # degrees to either side


def _walk() -> tuple[Camera, ...]:
    views = []
    for k in range(VIEWS):
        turn = np.radians(TURNS * np.sin(2 * np.pi * k / VIEWS * 2))
        away, high = (3.2, 4.3, 3.7)[k % 3], (1.0, 1.7, 1.35, 2.1)[k % 4]
        eye = np.array([away * np.sin(turn), high, away * np.cos(turn)])
        target = (0.5 * np.sin(2.1 * k), 0.85 + 0.2 * np.cos(1.3 * k), 0.0)
        views.append(Camera.look_at(eye, target, 960, 640, yfov=42, name=f"walk {k}"))
    return tuple(views)


def recipe() -> Recipe:
    """The stage's, but for the cameras."""
    return replace(stage.recipe(), name="stage_walk", orbit=_walk())
