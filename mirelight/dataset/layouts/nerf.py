"""The layout of nerfstudio, instant-ngp and Blender-NeRF: transforms.json beside images/NAME.png.

nerfstudio ignores a lens in a frame where one stands at the top, wants masks and depths for all frames or none, and
lists of file names for all splits or none. Blender-NeRF's readers take transforms_SPLIT.json, add ".png" themselves and
know nothing but `camera_angle_x`. Depth is along the view axis, 16-bit millimetres: nerfstudio's default, and
instant-ngp's by `integer_depth_scale`. Worlds have Z up.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mirelight.conventions import Matrix
from mirelight.dataset.layouts.pictures import (
    SPLITS,
    Picture,
    Split,
    folder_for,
    millimetres,
    named,
    write_pixels,
)
from mirelight.dataset.layouts.points import moved, ply_bytes
from mirelight.dataset.layouts.world import scale_of
from mirelight.errors import InputError
from mirelight.io.atomic import atomic_path
from mirelight.io.cameras.colmap_write import Points
from mirelight.io.cameras.transforms import Z_UP, lens_entry, matrix_entry
from mirelight.model import Camera

_SAME = 1e-6  # relative, of lenses


@dataclass(frozen=True, slots=True)
class _Written:
    """A picture whose files are there."""

    name: str
    camera: Camera
    split: Split
    has_depth: bool
    has_mask: bool

    @property
    def image(self) -> str:
        return f"images/{self.name}.png"


def write_nerf(
    folder: Path,
    pictures: Iterable[Picture],
    *,
    points: Points | None = None,
    world: Matrix = Z_UP,
    blender: bool = True,
) -> None:
    """Write one lighting's pictures.

    Args:
        folder: made where it is missing.
        pictures: taken one by one, so that they need not be in memory together.
        points: in mirelight's world, for methods that start from some.
        world: from mirelight's world (Y up) to the data set's, see :func:`mirelight.dataset.layouts.world_of`.
        blender: write transforms_SPLIT.json, too.

    Raises:
        InputError: a camera that the layout cannot hold; masks or depths for some pictures only.
        OutputError: a file cannot be written.
    """
    folder_for(folder / "images")
    scale = scale_of(world)
    written: list[_Written] = []
    for name, picture in named(pictures, folder):
        if blender:
            _fits_blender(folder, picture.camera, written[0].camera if written else picture.camera)
        one = _Written(name, picture.camera, picture.split, picture.depth is not None, picture.mask is not None)
        write_pixels(folder / one.image, picture.rgba)
        if picture.depth is not None:
            folder_for(folder / "depth")
            write_pixels(folder / "depth" / f"{name}.png", millimetres(picture.depth * scale))
        if picture.mask is not None:
            folder_for(folder / "masks")
            write_pixels(folder / "masks" / f"{name}.png", picture.mask.astype("uint8") * 255)
        written.append(one)
    if points is not None:
        with atomic_path(folder / "points.ply") as path:
            path.write_bytes(ply_bytes(moved(points, world)))
    _write_json(folder / "transforms.json", _transforms(written, world, points is not None))
    for split in SPLITS if blender else ():
        chosen = [one for one in written if one.split == split]
        if chosen:
            _write_json(folder / f"transforms_{split}.json", _blender(chosen, world))


def _transforms(written: list[_Written], world: Matrix, has_points: bool) -> dict[str, Any]:
    lenses = [_lens(one.camera) for one in written]
    shared = len(lenses) > 0 and all(lens == lenses[0] for lens in lenses)
    out: dict[str, Any] = {"camera_model": "PINHOLE", **(lenses[0] if shared else {})}
    scale = scale_of(world)
    out |= {"applied_transform": (world[:3] / scale).tolist(), "orientation_override": "none"}
    if abs(scale - 1) > _SAME:
        out["applied_scale"] = scale
    if has_points:
        out["ply_file_path"] = "points.ply"
    if any(one.has_depth for one in written):
        out["integer_depth_scale"] = 0.001
    of_split = {split: [one.image for one in written if one.split == split] for split in SPLITS}
    if of_split["val"] or of_split["test"]:
        of_split["val"] = of_split["val"] or of_split["test"]
        of_split["test"] = of_split["test"] or of_split["val"]
        out |= {f"{split}_filenames": names for split, names in of_split.items()}
    out["frames"] = [_frame(one, world, {} if shared else lens) for one, lens in zip(written, lenses, strict=True)]
    return out


def _lens(camera: Camera) -> dict[str, Any]:
    return {key: value for key, value in lens_entry(camera).items() if key != "camera_model"}


def _frame(one: _Written, world: Matrix, lens: dict[str, Any]) -> dict[str, Any]:
    out: dict[str, Any] = {"file_path": one.image, "transform_matrix": matrix_entry(one.camera, world), **lens}
    if one.has_depth:
        out |= {"depth_file_path": f"depth/{one.name}.png", "depth_path": f"depth/{one.name}.png"}
    if one.has_mask:
        out["mask_path"] = f"masks/{one.name}.png"
    return out


def _blender(written: list[_Written], world: Matrix) -> dict[str, Any]:
    camera = written[0].camera
    frames = [
        {"file_path": f"./images/{one.name}", "transform_matrix": matrix_entry(one.camera, world)} for one in written
    ]
    return {"camera_angle_x": 2 * math.atan(camera.width / 2 / camera.fx), "frames": frames}


def _fits_blender(folder: Path, camera: Camera, first: Camera) -> None:
    """Raises InputError: a lens that Blender-NeRF's files cannot say."""
    centered = camera.cx == camera.width / 2 and camera.cy == camera.height / 2
    if not centered:
        found = "has its principal point off the middle"
    elif not math.isclose(camera.fx, camera.fy, rel_tol=_SAME):
        found = "has different focal lengths along x and y"
    elif not math.isclose(camera.fx / camera.width, first.fx / first.width, rel_tol=_SAME):
        found = f"has another field of view than {first.name!r}"
    else:
        return
    remedy = "leave Blender-NeRF's files out (blender=False); transforms.json holds it"
    raise InputError(folder, f"camera {camera.name!r} {found}", remedy)


def _write_json(path: Path, value: dict[str, Any]) -> None:
    with atomic_path(path) as temporary:
        temporary.write_text(json.dumps(value, indent=1, allow_nan=False) + "\n", encoding="utf-8", newline="\n")
