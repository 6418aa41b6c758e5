"""The layout of nerfstudio, instant-ngp and Blender-NeRF: a folder a lighting, transforms.json beside images/NAME.png.

nerfstudio ignores a lens in a frame where one stands at the top, wants masks and depths for all frames or none, lists
of file names for all splits or none, and 8-bit pictures. Blender-NeRF's readers take transforms_SPLIT.json, add ".png"
themselves and know nothing but `camera_angle_x`. instant-ngp takes EXR, premultiplied: transforms_hdr.json. Depth is
along the view axis, 16-bit millimetres: nerfstudio's default, and instant-ngp's by `integer_depth_scale`. Worlds have
Z up. A scaled world's scale stands in `applied_transform`: by `applied_scale` nerfstudio multiplies points and depths,
and not the poses, whereas all of them lie in one world here.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from mirelight.dataset.layouts.files import Files
from mirelight.dataset.layouts.pictures import SPLITS, Part, Picture, Shared
from mirelight.dataset.layouts.points import moved, ply_bytes
from mirelight.dataset.layouts.shared import ENVIRONMENTS, GEOMETRY, write_environments, write_geometry
from mirelight.io.cameras.transforms import lens_entry, matrix_entry
from mirelight.model import Camera, digest

_POINTS = "points.ply"


@dataclass(frozen=True, slots=True)
class _Written:
    """A picture whose files are there."""

    name: str
    camera: Camera
    split: str
    part: Part
    out: str  # to the data set's folder
    has_depth: bool

    @property
    def image(self) -> str:
        return f"images/{self.name}.png"


def write_nerf(files: Files, pictures: Iterable[Picture], shared: Shared, *, blender: bool = True) -> None:
    """Write pictures and cameras in the layout `nerf`.

    Args:
        files: of the data set.
        pictures: taken one by one, so that they need not be in memory together.
        shared: what they have in common.
        blender: write transforms_SPLIT.json, too, which hold one centred angle of view alone (:func:`check_lenses`).

    Raises:
        OutputError: a file cannot be written.
    """
    written: dict[str, list[_Written]] = {}
    outs: dict[str, str] = {}
    views: set[str] = set()
    for picture in pictures:
        if picture.view not in views:
            views.add(picture.view)
            write_geometry(files, picture, shared)
        within, outs[picture.within] = picture.within, picture.out
        _write_frame(files, picture, shared)
        has_depth = picture.pixels.has_geometry
        one = _Written(picture.view, picture.camera, picture.split, picture.part, picture.out, has_depth)
        written.setdefault(within, []).append(one)
    points = shared.points
    if points is not None:
        placed = moved(points, shared.world)
        key = digest("points 1", placed.positions, placed.colors)
        files.put(_POINTS, key, lambda path: path.write_bytes(ply_bytes(placed)))
    write_environments(files, shared, ".exr")
    for within, ones in written.items():
        whole = _transforms(ones, shared, outs[within], within.rstrip("/"))
        files.json(f"{within}transforms.json", whole)
        if shared.hdr:
            files.json(f"{within}transforms_hdr.json", _in_hdr(whole))
        for split in SPLITS if blender else ():
            chosen = [one for one in ones if one.split == ("test" if split == "val" else split)]
            files.json(f"{within}transforms_{split}.json", _blender(chosen, ones[0].camera, shared))


def _write_frame(files: Files, picture: Picture, shared: Shared) -> None:
    image, linear = f"{picture.within}images/{picture.view}.png", f"{picture.within}hdr/{picture.view}.exr"
    files.png(image, picture.key, lambda: picture.pixels.rgba)
    if shared.hdr:
        files.exr(linear, picture.key, lambda: picture.pixels.linear)
    files.frame(picture, image, linear if shared.hdr else "")


def _transforms(written: list[_Written], shared: Shared, out: str, lighting: str) -> dict[str, Any]:
    lenses = [{k: x for k, x in lens_entry(one.camera).items() if k != "camera_model"} for one in written]
    same = len(lenses) > 0 and all(lens == lenses[0] for lens in lenses)
    whole: dict[str, Any] = {"camera_model": "PINHOLE", **(lenses[0] if same else {})}
    whole |= {"applied_transform": shared.world[:3].tolist(), "orientation_override": "none"}
    if shared.points is not None:
        whole["ply_file_path"] = f"{out}{_POINTS}"
    if any(one.has_depth for one in written):
        whole["integer_depth_scale"] = 0.001
    if lighting in shared.surroundings:
        whole["environment"] = f"{out}{ENVIRONMENTS}/{lighting}.exr"
    of_split = {split: [one.image for one in written if one.split == split] for split in SPLITS}
    if of_split["test"]:
        of_split["val"] = of_split["test"]
        whole |= {f"{split}_filenames": names for split, names in of_split.items()}
    whole["frames"] = [_frame(one, shared, {} if same else lens) for one, lens in zip(written, lenses, strict=True)]
    return whole


def _frame(one: _Written, shared: Shared, lens: dict[str, Any]) -> dict[str, Any]:
    out: dict[str, Any] = {"file_path": one.image, "transform_matrix": matrix_entry(one.camera, shared.world), **lens}
    if one.has_depth:
        depth = f"{one.out}{GEOMETRY}/depth/{one.name}.png"
        out |= {"depth_file_path": depth, "depth_path": depth}
    out |= {"mask_path": f"{one.out}{GEOMETRY}/masks/{one.name}.png", "part": one.part}
    return out


def _in_hdr(whole: dict[str, Any]) -> dict[str, Any]:
    """The same of linear pictures, for instant-ngp: nerfstudio's lists have no place in it."""
    frames = [
        {**frame, "file_path": frame["file_path"].replace("images/", "hdr/").replace(".png", ".exr")}
        for frame in whole["frames"]
    ]
    return {key: value for key, value in whole.items() if not key.endswith("_filenames")} | {"frames": frames}


def _blender(written: list[_Written], first: Camera, shared: Shared) -> dict[str, Any]:
    frames = [
        {
            "file_path": f"./images/{one.name}",
            "transform_matrix": matrix_entry(one.camera, shared.world),
            "part": one.part,
        }
        for one in written
    ]
    return {"camera_angle_x": 2 * math.atan(first.width / 2 / first.fx), "frames": frames}
