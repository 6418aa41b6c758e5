"""The courtyard as a person captures it who walks round in it: nearly all that casts shadows there is in a picture.

It is not shipped: `scripts/bench truth` makes it where it is needed.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mirelight.model import Camera
from scenegen import courtyard
from scenegen.courtyard_geometry import BAYS, GALLERY
from scenegen.recipe import Recipe

MIDDLE, HALF = np.array([0.35, 0.0, 2.1]), np.array([2.35, 0.0, 3.3])  # of the way round, metres
STOPS = 12  # on it


def _walk() -> tuple[Camera, ...]:
    """At each stop a look across, one ahead and up along the wall, and at every other one a look out at the wall."""
    views: list[tuple[np.ndarray, np.ndarray]] = []
    for k in range(STOPS):
        turn = 2 * np.pi * k / STOPS
        out, ahead = np.array([np.sin(turn), 0, np.cos(turn)]), np.array([np.cos(turn), 0, -np.sin(turn)])
        at = MIDDLE + HALF * out + [0, 1.55 + 0.5 * (k % 3), 0]
        across = MIDDLE - 0.8 * HALF * out + [0, 0.5 + 0.5 * (k % 2), 0]
        views += [(at, across), (at, at + ahead + 0.25 * out + [0, 0.45, 0])]
        if k % 2:
            views.append((at, at + out + [0, 0.2, 0]))
    for x in BAYS:  # behind the arches, both ways along the gallery and up at its ceiling
        at = np.array([x, 1.5, GALLERY + 0.9])
        views += [(at, at + np.array([way, 0.35, -0.15])) for way in (-1.0, 1.0)]
    return tuple(
        Camera.look_at(eye, target, 960, 540, yfov=64, name=f"walk {k}") for k, (eye, target) in enumerate(views)
    )


def recipe() -> Recipe:
    """The courtyard's, but for the cameras and how dense splats lie."""
    return replace(
        courtyard.recipe(), name="courtyard_walk", orbit=_walk(), pixels_per_splat=4.0, spacing=(0.017, 0.036)
    )
