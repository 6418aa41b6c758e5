"""camera_path.json: a path drawn in nerfstudio's viewer.

`camera_path[]` holds `camera_to_world`, 16 numbers row by row in OpenGL's axes, and `fov`, the vertical angle in
degrees; `render_width` and `render_height` give the picture. The world is the one that nerfstudio trained in, which
splats that `ns-export` writes are in, too; the training's dataparser_transforms.json leads back to the capture's.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from mirelight.io.cameras import reading, worlds
from mirelight.io.cameras.placed import Angle, FileCamera
from mirelight.io.gltf.fields import Fields


def read(path: Path, data: dict[str, Any], dataparser: Path | None) -> tuple[FileCamera, ...]:
    """The cameras along the path, one for each frame.

    Args:
        path: the file.
        data: what is in it.
        dataparser: the training's dataparser_transforms.json, to have the cameras in the capture's axes; None: they
            stay in the training's world.

    Raises:
        InputError: what is wrong, with its field.
    """
    top = Fields(path, "", data)
    kind = top.text("camera_type", "perspective")
    if kind != "perspective":
        raise top.fail("camera_type", f"{kind[:40]!r}, which no pinhole stands for", "choose perspective in the viewer")
    size = reading.side(top, "render_width"), reading.side(top, "render_height")
    world = np.eye(4) if dataparser is None else np.linalg.inv(worlds.said_by_nerfstudio(dataparser))
    out = []
    for i, entry in enumerate(reading.objects(path, "camera_path", data.get("camera_path")), start=1):
        fail = partial(entry.fail, "camera_to_world")
        matrix = entry.vector("camera_to_world", 16).reshape(4, 4)
        degrees = reading.field_of_view(entry.number("fov"), partial(entry.fail, "fov"))
        out.append(
            FileCamera(
                name=f"path.{i:04d}",
                world_from_camera=reading.rigid(world @ reading.rigid(matrix, fail), fail),
                lens=Angle(degrees=degrees, side="vertical", size=size),
            )
        )
    return tuple(out)
