"""The layout of Stanford-ORB: a scene a lighting, in linear light and in 8 bits.

`blender_HDR/SCENE/` has `transforms_train.json`, `transforms_test.json` (held-out cameras) and `transforms_novel.json`
(other lightings: each frame names its scene), pictures `train/0007.exr` of three channels over black, and masks
`train_mask/0007.png`; `blender_LDR/SCENE/` the same as PNG. `ground_truth/SCENE/` has for each frame the light from far
away as that camera sees it (`env_map/0007.exr`: the middle of the map is ahead, a quarter to the right of it is right),
and for frames that nothing is trained on `surface_normal/0007.npy` (the camera's OpenGL axes) and `z_depth/0007.npy`.
Its loaders take square pictures of a multiple of 512 pixels, the benchmark 2048. Worlds have Z up.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from mirelight.dataset.layouts.files import Files
from mirelight.dataset.layouts.pictures import Picture, Shared, check_lenses, check_pinholes
from mirelight.dataset.layouts.shared import write_environments
from mirelight.dataset.surroundings import CAMERA_FROM_MAP, Surroundings
from mirelight.io.cameras.transforms import matrix_entry
from mirelight.model import F32, Camera, digest

_HDR, _LDR, _TRUTH = "blender_HDR", "blender_LDR", "ground_truth"
_MAP_ROWS = 256


def check_orb(cameras: Sequence[Camera], shared: Shared) -> None:
    """Raises InputError: a camera that the layout cannot hold."""
    check_pinholes(shared.source, cameras)
    check_lenses(shared.source, cameras, square=True)


def write_orb(files: Files, pictures: Iterable[Picture], shared: Shared) -> None:
    """Write pictures. Raises OutputError: a file cannot be written."""
    frames: dict[str, list[tuple[str, bool, dict[str, Any]]]] = {}  # by lighting: kind, whether it is held out, entry
    angle = 0.0
    for picture in pictures:
        angle = 2 * math.atan(picture.camera.width / 2 / picture.camera.fx)
        kind = "test" if picture.part in ("novel_view", "novel_both") else "train"
        path = f"{kind}/{picture.number:04d}"
        _write_frame(files, scene(shared, picture.lighting), path, picture, shared)
        entry = {
            "file_path": path,
            "scene_name": scene(shared, picture.lighting),
            "camera_angle_x": angle,
            "transform_matrix": matrix_entry(picture.camera, shared.world),
            "view": picture.view,
        }
        is_new = picture.part in ("novel_light", "novel_both")
        frames.setdefault(picture.lighting, []).append((kind, is_new, entry))
    any_new = any(is_new for ones in frames.values() for _, is_new, _ in ones)
    for lighting, ones in frames.items():
        others = [x for other, them in frames.items() if other != lighting for x in them]
        novel = [entry for kind, is_new, entry in others if (is_new if any_new else kind == "test")]
        for folder in (_HDR, _LDR) if shared.hdr else (_LDR,):
            place = f"{folder}/{scene(shared, lighting)}"
            for split in ("train", "test"):
                chosen = [_plain(entry) for kind, _, entry in ones if kind == split]
                files.json(f"{place}/transforms_{split}.json", {"camera_angle_x": angle, "frames": chosen})
            files.json(f"{place}/transforms_novel.json", {"frames": novel})
    write_environments(files, shared, ".exr")


def scene(shared: Shared, lighting: str) -> str:
    """The name of a lighting's scene."""
    return f"{shared.name}_{lighting}"


def _write_frame(files: Files, name: str, path: str, picture: Picture, shared: Shared) -> None:
    kind, number = path.split("/")
    pixels, key = picture.pixels, picture.key
    image, linear = f"{_LDR}/{name}/{path}.png", f"{_HDR}/{name}/{path}.exr"
    files.png(image, key, lambda: pixels.rgb)
    files.png(f"{_LDR}/{name}/{kind}_mask/{number}.png", picture.view_key, lambda: pixels.alpha)
    if shared.hdr:
        files.exr(linear, key, lambda: np.ascontiguousarray(pixels.linear[..., :3]))
        files.png(f"{_HDR}/{name}/{kind}_mask/{number}.png", picture.view_key, lambda: pixels.alpha)
    around = shared.surroundings.get(picture.lighting)
    if around is not None:
        turn = picture.camera.world_from_camera[:3, :3]
        own = digest("seen from the camera 1", around.parts, turn)
        files.exr(f"{_TRUTH}/{name}/env_map/{number}.exr", own, lambda: seen_by(around, picture.camera))
    if pixels.has_geometry and picture.part != "seen":
        view_key = picture.view_key
        files.npy(f"{_TRUTH}/{name}/surface_normal/{number}.npy", view_key, lambda: _normal(picture))
        files.npy(f"{_TRUTH}/{name}/z_depth/{number}.npy", view_key, lambda: shared.depth(pixels))
    files.frame(picture, image, linear if shared.hdr else "")


def seen_by(around: Surroundings, camera: Camera, rows: int = _MAP_ROWS) -> F32:
    """(rows, 2 rows, 3) the light from far away in a camera's frame."""
    return around.picture(rows, camera.world_from_camera[:3, :3] @ CAMERA_FROM_MAP)


def _normal(picture: Picture) -> F32:
    """(H, W, 3) unit, in the camera's axes: right, up, towards the eye."""
    turn = picture.camera.world_from_camera[:3, :3].astype(np.float32)
    return np.asarray(picture.pixels.geometry.normal @ turn, dtype=np.float32)


def _plain(entry: dict[str, Any]) -> dict[str, Any]:
    """An entry of a scene's own file: its loaders take `scene_name` for another scene."""
    return {key: value for key, value in entry.items() if key not in ("scene_name", "camera_angle_x")}
