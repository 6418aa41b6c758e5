"""Objects of a first job: set down where the first picture looks, beside each other, in a size that shows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from mirelight.apps.first_job import view
from mirelight.apps.first_job.toml_text import Names, position
from mirelight.io import mesh

_SHOWS = (0.02, 0.5)  # of how far away it is: the size of an object that is kept as its file has it
_SIZE = 0.15  # of any other
_NEARER = 0.25  # of the way from what the picture looks at to the camera
_APART = 0.25  # of that way, from one to the next


def objects(files: Sequence[Path], seen: view.FirstView, named: Names) -> Iterator[str]:
    """The tables of objects.

    Raises:
        InputError: a file that is no mesh.
    """
    eye, target = seen.camera.position, np.asarray(seen.target)
    way = np.asarray(eye - target)
    away = float(np.linalg.norm(way))
    for i, path in enumerate(files):
        low, high = mesh.read_mesh(path).bounds
        size = float((high - low).max())
        scale = 1.0
        if size > 0 and not _SHOWS[0] * away <= size <= _SHOWS[1] * away:
            scale = float(f"{_SIZE * away / size:.2g}")
        beside = (i - (len(files) - 1) / 2) * _APART * away * seen.camera.world_from_camera[:3, 0]
        place = target + _NEARER * way + beside
        place[1] = max(float(eye[1]), float(target[1])) - scale * float(high[1])  # its top as high as the eye
        place -= scale * np.array([(low[0] + high[0]) / 2, 0, (low[2] + high[2]) / 2])
        yield ""
        if i == 0:
            yield "# They stand on whatever of the proxy lies under them; move them by x and z."
        yield "[[objects]]"
        yield f"path = {named(path)}"
        yield "drop = true"
        scaled = "" if scale == 1 else f", scale = {scale:g}"
        yield f"transform = {{ translation = {position(place, seen)}, rotation_euler = [0, 0, 0]{scaled} }}"
