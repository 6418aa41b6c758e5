"""COLMAP's layout: images/NAME.png, and a sparse model in sparse/0 as text and binary.

Read by INRIA's 3D Gaussian Splatting, gsplat, nerfstudio and most trainers of splats. They hold out every 8th of the
sorted names themselves, so splits have no place here.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from mirelight import conventions
from mirelight.conventions import Matrix
from mirelight.dataset.layouts.pictures import Picture, folder_for, named, write_pixels
from mirelight.dataset.layouts.points import moved
from mirelight.io.cameras import colmap_write
from mirelight.io.cameras.colmap_write import Points
from mirelight.io.cameras.transforms import Z_UP
from mirelight.model import Camera


def write_colmap(
    folder: Path, pictures: Iterable[Picture], *, points: Points | None = None, world: Matrix = Z_UP
) -> None:
    """Write one lighting's pictures.

    Args:
        folder: made where it is missing.
        pictures: taken one by one, so that they need not be in memory together. Depth and mask have no place here.
        points: in mirelight's world; INRIA's trainer needs some (:func:`mirelight.dataset.layouts.points_of`).
        world: from mirelight's world (Y up) to the data set's, see :func:`mirelight.dataset.layouts.world_of`.

    Raises:
        InputError: an orthographic camera.
        OutputError: a file cannot be written.
    """
    images, sparse = folder / "images", folder / "sparse" / "0"
    folder_for(images, sparse)
    cameras: list[Camera] = []
    names: list[str] = []
    for name, picture in named(pictures, folder):
        write_pixels(images / f"{name}.png", picture.rgba)
        pose = conventions.rigid_part(world @ picture.camera.world_from_camera)
        cameras.append(replace(picture.camera, world_from_camera=pose))
        names.append(f"{name}.png")
    colmap_write.write(sparse, cameras, names, None if points is None else moved(points, world))
