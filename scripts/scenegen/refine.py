"""Shipped splats, discs on the true surface at first, are trained on pictures from beside the job's cameras."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mirelight.model import Camera, SplatCloud
from scenegen import training
from scenegen.recipe import Recipe
from scenegen.truth import Truth

F32 = NDArray[np.float32]

PICTURES = 60  # the orbit's first
SPP, JOBS_SPP = 4, 8  # then denoised; the job's cameras, which come first, have more
SHOOTING = training.Shooting(size=(640, 360))
TURNED = 0.4  # share of the way aside by which what is looked at moves, too


@dataclass(frozen=True, kw_only=True)
class Beside:
    """From where pictures are taken, beside the orbit's: anywhere in a box round each of the job's cameras in turn; and
    for how long splats are trained on them."""

    low: tuple[float, float, float]  # metres from the camera
    high: tuple[float, float, float]
    ahead: float  # metres to what is looked at
    yfov: float
    steps: int


WHERE = {
    "courtyard": Beside(low=(-1.1, -0.7, -0.7), high=(1.1, 0.8, 0.3), ahead=7.0, yfov=47, steps=500),
    "stage": Beside(low=(-0.9, -0.4, -0.5), high=(0.9, 0.6, 0.3), ahead=4.0, yfov=36, steps=400),
}


def cameras(recipe: Recipe) -> tuple[Camera, ...]:
    """The orbit's, and others beside the job's, of 960x540 pixels."""
    where, rng, views = WHERE[recipe.name], np.random.default_rng(3), list(recipe.orbit)
    for k in range(PICTURES - len(views)):
        pose = recipe.cameras[k % len(recipe.cameras)].world_from_camera
        aside = rng.uniform(where.low, where.high)
        target = pose[:3, 3] - where.ahead * pose[:3, 2] + TURNED * aside * [1, -0.5, 0]
        views.append(Camera.look_at(pose[:3, 3] + aside, target, 960, 540, yfov=where.yfov, name=f"beside {k}"))
    return tuple(views)


def pictures(
    recipe: Recipe, captured: Truth, views: Sequence[Camera], kept: Path, say: Callable[[str], None]
) -> list[F32]:
    """(H, W, 3) each, display-encoded; those that an earlier run left in the file are taken."""
    made: list[F32] = [x.astype(np.float32) / np.float32(255) for x in np.load(kept)] if kept.is_file() else []
    kept.parent.mkdir(parents=True, exist_ok=True)
    for k in range(len(made), len(views)):
        how = replace(SHOOTING, spp=JOBS_SPP if k < len(recipe.cameras) else SPP)
        made += training.shots(captured, recipe.captured, [views[k]], how)
        np.save(kept, np.stack([np.round(255 * x).astype(np.uint8) for x in made]))
        say(f"picture {k + 1} of {len(views)} to train on")
    return made


def refined(cloud: SplatCloud, recipe: Recipe, captured: Truth, kept: Path, say: Callable[[str], None]) -> SplatCloud:
    """As many splats, trained for as long as WHERE says; `kept`: folder of the pictures, so that a run goes on."""
    views = cameras(recipe)
    taken = pictures(recipe, captured, views, kept / "pictures.npy", say)
    steps = WHERE[recipe.name].steps
    say(f"training for {steps} steps, some minutes")
    how = replace(SHOOTING, iterations=steps, most=len(cloud))
    return training.refined(cloud, training.known(views, how), taken, how)
