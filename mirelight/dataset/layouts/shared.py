"""Files that several layouts have: geometry once a camera, maps of the light from far away once a lighting."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from mirelight.dataset.layouts.files import Files
from mirelight.dataset.layouts.pictures import Picture, Shared, millimetres
from mirelight.io.environment import write_environment
from mirelight.model import digest
from mirelight.relighting.surroundings import Surroundings

GEOMETRY, ENVIRONMENTS = "geometry", "environments"


def write_geometry(files: Files, picture: Picture, shared: Shared) -> None:
    """A camera's depth (16-bit millimetres along the view axis) and mask, written with the first of its frames."""
    pixels = picture.pixels
    files.png(f"{GEOMETRY}/masks/{picture.view}.png", picture.view_key, lambda: pixels.mask)
    if pixels.has_geometry:
        key = picture.view_key
        files.png(f"{GEOMETRY}/depth/{picture.view}.png", key, lambda: millimetres(shared.depth(pixels)))


def write_environments(files: Files, shared: Shared, suffix: str) -> None:
    """The light from far away of each lighting that has any: environment, sky and suns as one map, seen in a world with
    Z up as Blender has it (the middle looks along +X, a quarter from the left along +Y)."""
    for name, one in shared.surroundings.items():
        key = digest("environment 1", suffix, one.parts)
        files.put(f"{ENVIRONMENTS}/{name}{suffix}", key, partial(_write, one))


def _write(one: Surroundings, path: Path) -> None:
    write_environment(path, one.picture())
