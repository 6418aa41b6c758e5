"""A capture as people have it, for the film: splats trained on pictures of the courtyard, not made from its surface."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scenegen import courtyard, training
from scenegen.truth import Truth

from mirelight.io import splats
from mirelight.io.atomic import atomic_path
from mirelight.model import Camera

PICTURES = 30
SHOOTING = training.Shooting(size=(560, 315), spp=4, iterations=800, most=60_000, points=40_000)
ASIDE = 1.2 * np.array(  # of the way, metres: as a person walks who looks from several heights
    [(0, 0, 0), (-0.5, 0.25, -0.3), (0.45, -0.3, 0.2), (0.15, 0.45, -0.4), (-0.3, -0.4, 0.3), (0.5, 0.3, 0.1)]
)
AHEAD = 7.0  # metres to what is looked at


def capture(way: Sequence[Camera], folder: Path) -> Path:
    """The PLY file of splats of a walk along a way of cameras, trained once and kept in `folder`; takes a while."""
    path = folder / "capture.ply"
    if path.is_file():
        return path
    folder.mkdir(parents=True, exist_ok=True)
    recipe, cameras = courtyard.recipe(), walk(way)
    truth = Truth(recipe.looks(), recipe.captured)
    pictures = []
    for k, camera in enumerate(cameras):
        pictures += training.shots(truth, recipe.captured, [camera], SHOOTING)
        print(f"picture {k + 1} of {PICTURES}", file=sys.stderr, flush=True)
    rows = training.trained(truth, pictures, cameras, SHOOTING)
    with atomic_path(path) as fresh:
        splats.write(training.cloud_of(rows), fresh)
    return path


def walk(way: Sequence[Camera]) -> list[Camera]:
    """Where pictures are taken: along the way and beside it."""
    views = []
    for k in range(PICTURES):
        share, step = np.modf(k * (len(way) - 1) / (PICTURES - 1 + 1e-3))
        before, after = way[int(step)].world_from_camera, way[int(step) + 1].world_from_camera
        pose = before * (1 - share) + after * share
        aside = ASIDE[k % len(ASIDE)]
        target = pose[:3, 3] - AHEAD * pose[:3, 2] + 0.5 * aside * [1, -0.5, 0]
        views.append(Camera.look_at(pose[:3, 3] + aside, target, 960, 540, yfov=50, name=f"{k}"))
    return views
