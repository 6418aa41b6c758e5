"""COLMAP's layout: a folder a lighting, with images/NAME.png and a sparse model in sparse/0 as text and binary.

Read by INRIA's 3D Gaussian Splatting, gsplat, nerfstudio and most trainers of splats. They hold out every 8th of the
sorted names themselves; INRIA's takes sparse/0/test.txt instead where it is started with llffhold = 0. Trainers read
8-bit pictures alone. Worlds have Z up.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from mirelight.base import conventions
from mirelight.dataset.layouts.files import Files
from mirelight.dataset.layouts.pictures import Picture, Shared, Split
from mirelight.dataset.layouts.points import moved
from mirelight.dataset.layouts.shared import write_environments, write_geometry
from mirelight.io.cameras import colmap_write
from mirelight.model import Camera


def write_colmap(files: Files, pictures: Iterable[Picture], shared: Shared) -> None:
    """Write pictures. INRIA's trainer needs `shared.points`. Raises OutputError: a file cannot be written."""
    written: dict[str, list[tuple[str, Camera, Split]]] = {}
    views: set[str] = set()
    for picture in pictures:
        if picture.view not in views:
            views.add(picture.view)
            write_geometry(files, picture, shared)
        _write_frame(files, picture)
        pose = conventions.rigid_part(shared.world @ picture.camera.world_from_camera)
        placed = replace(picture.camera, world_from_camera=pose)
        written.setdefault(picture.within, []).append((f"{picture.view}.png", placed, picture.split))
    points = None if shared.points is None else moved(shared.points, shared.world)
    models: dict[tuple[str, ...], list[tuple[str, bytes]]] = {}  # by names: lightings share their cameras
    for within, ones in written.items():
        names = tuple(name for name, _, _ in ones)
        if names not in models:
            cameras = [camera for _, camera, _ in ones]
            models[names] = list(colmap_write.model(shared.source, cameras, names, points))
        for file, data in models[names]:
            files.bytes(f"{within}sparse/0/{file}", data)
        for split in ("train", "test"):
            chosen = [name for name, _, own in ones if own == split]
            files.text(f"{within}sparse/0/{split}.txt", "".join(f"{name}\n" for name in chosen))
    write_environments(files, shared, ".exr")


def _write_frame(files: Files, picture: Picture) -> None:
    image = f"{picture.within}images/{picture.view}.png"
    files.png(image, picture.key, lambda: picture.pixels.rgba)
    files.frame(picture, image)
