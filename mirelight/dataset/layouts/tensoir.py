"""The layout of TensoIR and NeRFactor: a folder a camera, a picture a lighting in it.

`train_007/metadata.json` has the camera: `cam_transform_mat`, 16 numbers in one text, world from camera in OpenGL's
axes, and `cam_angle_x`. Beside it stand `rgba_LIGHTING.png`, `rgba.png` (the lighting to train on, for NeRFactor),
`normal.png` (world, n 0.5 + 0.5) and `albedo.png` (sRGB). Maps are `environments/LIGHTING.hdr`, for both of TensoIR's
options of a folder of maps. The loaders lay pictures over white, take square ones alone and have near 2, far 6 and a
box of ±1.5 built in. `transforms_SPLIT.json` is NeRFactor's. Worlds have Z up.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np

from mirelight.base import colour
from mirelight.dataset.layouts.files import Files
from mirelight.dataset.layouts.pictures import U8, Picture, Pixels, Shared, with_alpha
from mirelight.dataset.layouts.shared import ENVIRONMENTS, write_environments
from mirelight.io.cameras.transforms import matrix_entry


def write_tensoir(files: Files, pictures: Iterable[Picture], shared: Shared) -> None:
    """Write pictures, camera by camera. Raises OutputError: a file cannot be written."""
    frames: dict[str, list[dict[str, Any]]] = {"train": [], "test": []}
    angle = 0.0
    folders: set[str] = set()
    for picture in pictures:
        kind = "test" if picture.part in ("novel_view", "novel_both") else "train"
        folder = f"{kind}_{picture.number:03d}"
        if folder not in folders:
            folders.add(folder)
            angle = 2 * math.atan(picture.camera.width / 2 / picture.camera.fx)
            pose = matrix_entry(picture.camera, shared.world)
            _write_view(files, folder, picture, shared, angle, pose)
            frames[kind].append({"file_path": f"./{folder}/rgba", "transform_matrix": pose})
        _write_frame(files, folder, picture, shared)
    for split, chosen in (("train", "train"), ("val", "test"), ("test", "test")):
        files.json(f"transforms_{split}.json", {"camera_angle_x": angle, "frames": frames[chosen]})
    write_environments(files, shared, ".hdr")
    for name, lamp in shared.lamps.items():
        files.json(f"{ENVIRONMENTS}/{name}.json", {"point_location": lamp.position.tolist()})


def _write_frame(files: Files, folder: str, picture: Picture, shared: Shared) -> None:
    image = f"{folder}/rgba_{picture.lighting}.png"
    files.png(image, picture.key, lambda: picture.pixels.rgba)
    if picture.lighting == shared.training:
        files.png(f"{folder}/rgba.png", picture.key, lambda: picture.pixels.rgba)
    files.frame(picture, image)


def _write_view(
    files: Files, folder: str, picture: Picture, shared: Shared, angle: float, pose: list[list[float]]
) -> None:
    if picture.pixels.has_geometry:
        key, pixels = picture.view_key, picture.pixels
        files.png(f"{folder}/albedo.png", key, lambda: albedo_rgba(pixels))
        files.png(f"{folder}/normal.png", key, lambda: normal_rgba(shared, pixels))
        files.npy(f"{folder}/depth.npy", key, lambda: shared.depth(pixels))
    about = {
        "scene": shared.name,
        "view": picture.view,
        "cam_transform_mat": ",".join(repr(x) for row in pose for x in row),
        "cam_angle_x": angle,
        "envmap": shared.training if shared.training in shared.surroundings else "",
        "envmap_inten": 1.0,
        "imh": picture.camera.height,
        "imw": picture.camera.width,
        "spp": shared.spp,
    }
    files.json(f"{folder}/metadata.json", about)


def albedo_rgba(pixels: Pixels) -> U8:
    """(H, W, 4) sRGB, with what the proxy covers as alpha."""
    return with_alpha(colour.encode(pixels.geometry.albedo, "srgb"), pixels.geometry.coverage)


def normal_rgba(shared: Shared, pixels: Pixels) -> U8:
    """(H, W, 4) n 0.5 + 0.5 in the data set's world."""
    return with_alpha(shared.normal(pixels) * np.float32(0.5) + np.float32(0.5), pixels.geometry.coverage)
