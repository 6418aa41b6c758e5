"""The layout of point-light data sets (NRHints, GS³ and gs-relight, BiGS): Blender-NeRF's files with a lamp a frame.

transforms_SPLIT.json has `camera_angle_x` and `camera_intrinsics` [cx, cy, fx, fy] at the top, and in each frame
`pl_pos` (world), `pl_intensity` and `file_ext`. Worlds have Z up.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mirelight.conventions import Matrix
from mirelight.dataset.layouts.pictures import SPLITS, Picture, folder_for, named, write_pixels
from mirelight.errors import InputError
from mirelight.io.atomic import atomic_path
from mirelight.io.cameras.transforms import Z_UP, matrix_entry
from mirelight.model import Camera


@dataclass(frozen=True, slots=True, eq=False)
class Lamp:
    """A point light in the data set's world."""

    position: Matrix  # (3,)
    candela: Matrix  # (3,) linear


def write_olat(folder: Path, pictures: Iterable[tuple[Picture, Lamp]], world: Matrix = Z_UP) -> None:
    """Write pictures, each under one lamp.

    Args:
        folder: made where it is missing.
        pictures: taken one by one; lamps are in the data set's world already.
        world: from mirelight's world (Y up) to the data set's.

    Raises:
        InputError: a camera that is orthographic, off-centre, or has two focal lengths; cameras of several lenses.
        OutputError: a file cannot be written.
    """
    folder_for(folder / "images")
    frames: dict[str, list[dict[str, Any]]] = {split: [] for split in SPLITS}
    lamps: list[Lamp] = []

    def plain() -> Iterable[Picture]:
        for picture, lamp in pictures:
            lamps.append(lamp)
            yield picture

    first: Camera | None = None
    for name, picture in named(plain(), folder):
        camera = picture.camera
        first = first or camera
        _check(folder, camera, first)
        write_pixels(folder / "images" / f"{name}.png", picture.rgba)
        frames[picture.split].append(
            {
                "file_path": f"./images/{name}",
                "file_ext": ".png",
                "transform_matrix": matrix_entry(camera, world),
                "pl_pos": lamps[-1].position.tolist(),
                "pl_intensity": lamps[-1].candela.tolist(),
            }
        )
    for split in SPLITS:
        if frames[split] and first is not None:
            top = {
                "camera_angle_x": 2 * math.atan(first.width / 2 / first.fx),
                "camera_intrinsics": [first.cx, first.cy, first.fx, first.fy],
            }
            with atomic_path(folder / f"transforms_{split}.json") as temporary:
                text = json.dumps({**top, "frames": frames[split]}, indent=1, allow_nan=False) + "\n"
                temporary.write_text(text, encoding="utf-8", newline="\n")


def _check(folder: Path, camera: Camera, first: Camera) -> None:
    if camera.cx != camera.width / 2 or camera.cy != camera.height / 2:
        found = "has its principal point off the middle"
    elif not math.isclose(camera.fx, camera.fy, rel_tol=1e-6):
        found = "has different focal lengths along x and y"
    elif (camera.width, camera.height) != (first.width, first.height) or not math.isclose(camera.fx, first.fx):
        found = f"has another lens or size than {first.name!r}"
    else:
        return
    raise InputError(folder, f"camera {camera.name!r} {found}", "the layout has one centred lens for all")
