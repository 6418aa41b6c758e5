"""cameras.json of INRIA's 3D Gaussian Splatting: written beside a trained model.

An array of {id, img_name, width, height, position, rotation, fx, fy}. `position` and `rotation` (row by row) are the
camera's place and axes in the capture: world from camera, OpenCV's axes (+Z ahead, +Y down). There is no principal
point: it is the middle.
"""

from __future__ import annotations

import ast
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from mirelight.base import conventions
from mirelight.base.errors import InputError
from mirelight.io.cameras import reading
from mirelight.io.cameras.placed import FileCamera
from mirelight.io.gltf.fields import Fields
from mirelight.io.safety import read_bytes
from mirelight.model import Camera

_ARGUMENTS = "cfg_args"
_MOST_BYTES = 64 * 2**10


def read(path: Path, data: Any) -> tuple[FileCamera, ...]:
    """The cameras in the order of the file. Raises InputError."""
    entries = reading.objects(path, "", data)
    names = reading.picture_names(
        entry.text("img_name", str(entry.values.get("id", i))) for i, entry in enumerate(entries)
    )
    return tuple(_camera(entry, name) for entry, name in zip(entries, names, strict=True))


def _camera(entry: Fields, name: str) -> FileCamera:
    size = reading.side(entry, "width"), reading.side(entry, "height")
    lens = (entry.number("fx"), entry.number("fy"), size[0] / 2, size[1] / 2)
    value = entry.values.get("rotation")
    if not isinstance(value, list) or len(value) != 3:
        raise entry.fail("rotation", "not a matrix", "3 rows of 3 numbers are expected")
    rows = [
        Fields(entry.file, entry.where, {f"rotation[{i}]": r}).vector(f"rotation[{i}]", 3) for i, r in enumerate(value)
    ]
    pose = reading.rigid(conventions.compose(entry.vector("position", 3), rows), partial(entry.fail, "rotation"))
    return FileCamera(
        name=name,
        world_from_camera=pose @ reading.FLIP,
        lens=reading.intrinsics(lens, size, partial(entry.fail, "fx")),
        picture=entry.text("img_name", ""),
    )


def trained_on(path: Path) -> tuple[Path, ...]:
    """The folder of the pictures that a training read, by `cfg_args` beside its cameras.json; none where that is gone.

    The file holds the text of an argparse.Namespace, as INRIA's train.py writes it.
    """
    try:
        text = read_bytes(path.with_name(_ARGUMENTS), _MOST_BYTES).decode()
        call = ast.parse(text.strip(), mode="eval").body
        given = {x.arg: ast.literal_eval(x.value) for x in call.keywords} if isinstance(call, ast.Call) else {}
        names = str(given["source_path"]), str(given.get("images", "images"))
        if any(name.replace("\\", "/").startswith("//") for name in names):
            return ()  # another machine's: to look there would sign in to it
        folder = path.parent.joinpath(*names)
        return (folder,) if folder.is_dir() else ()
    except (InputError, OSError, ValueError, SyntaxError, KeyError, RecursionError, MemoryError):
        return ()


def entry(camera: Camera, number: int) -> dict[str, Any]:
    """A camera as an entry of the file; what it has no place for (the principal point) is left out."""
    c = np.asarray(camera.world_from_camera) @ reading.FLIP
    return {
        "id": number,
        "img_name": camera.name,
        "width": camera.width,
        "height": camera.height,
        "position": c[:3, 3].tolist(),
        "rotation": c[:3, :3].tolist(),
        "fx": camera.fx,
        "fy": camera.fy,
    }
