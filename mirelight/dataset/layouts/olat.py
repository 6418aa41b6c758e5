"""The layout of point-light data sets (NRHints, GS³ and gs-relight, BiGS): Blender-NeRF's files with a lamp a frame.

transforms_SPLIT.json has `camera_angle_x`, `camera_intrinsics` [cx, cy, fx, fy] and the range of depths at the top, and
in each frame `pl_pos` (world), `pl_intensity` and `file_ext`. NRHints wants train, val and test, and a PNG beside each
EXR; `hdr/` holds the same files with ".exr": linear, four channels, straight alpha, as both loaders blend it. Worlds
have Z up.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

from mirelight.dataset.layouts.files import Files
from mirelight.dataset.layouts.pictures import SPLITS, Picture, Shared
from mirelight.dataset.layouts.shared import write_geometry
from mirelight.io.cameras.transforms import matrix_entry


def write_olat(files: Files, pictures: Iterable[Picture], shared: Shared) -> None:
    """Write pictures, each under one lamp of `shared.lamps`. Raises OutputError: a file cannot be written."""
    frames: dict[str, list[dict[str, Any]]] = {"train": [], "test": []}
    views: set[str] = set()
    top: dict[str, Any] = {}
    for picture in pictures:
        camera, lamp = picture.camera, shared.lamps[picture.lighting]
        if picture.view not in views:
            views.add(picture.view)
            write_geometry(files, picture, shared)
        name = f"{picture.lighting}__{picture.view}"  # no name of either has two in a row
        _write_frame(files, name, picture, shared)
        top = top or {
            "camera_angle_x": 2 * math.atan(camera.width / 2 / camera.fx),
            "camera_intrinsics": [camera.cx, camera.cy, camera.fx, camera.fy],
        }
        frames[picture.split].append(
            {
                "file_path": f"./images/{name}",
                "file_ext": ".png",
                "transform_matrix": matrix_entry(camera, shared.world),
                "pl_pos": lamp.position.tolist(),
                "pl_intensity": lamp.candela.tolist(),
                "part": picture.part,
            }
        )
    if shared.near_far is not None:
        top |= {"camera_near": shared.near_far[0], "camera_far": shared.near_far[1]}
    for split in SPLITS:
        chosen = frames["train" if split == "train" else "test"]
        files.json(f"transforms_{split}.json", {**top, "frames": chosen})
        if shared.hdr:
            linear = [{**x, "file_path": f"../{x['file_path'][2:]}", "file_ext": ".exr"} for x in chosen]
            files.json(f"hdr/transforms_{split}.json", {**top, "frames": linear})


def _write_frame(files: Files, name: str, picture: Picture, shared: Shared) -> None:
    image, linear = f"images/{name}.png", f"images/{name}.exr"
    files.png(image, picture.key, lambda: picture.pixels.rgba)
    if shared.hdr:
        files.exr(linear, picture.key, lambda: picture.pixels.straight)
    files.frame(picture, image, linear if shared.hdr else "")
