"""The layout of detectors (COCO): pictures, and where inserted objects are in them: annotations/instances_SPLIT.json.

A picture's annotations have the box [x, y, width, height] and the run-length mask of what is seen of each object, and
`box_3d`: centre, size, axes and corners of the least box along the object's own axes, in the camera's frame (x right, y
down, z forward, the data set's units), whatever hides it. masks/NAME.png has 0 and one more than the place of the
object in `lists.objects`. What covers half of a pixel counts as seen.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirelight.base import conventions
from mirelight.base.conventions import Matrix
from mirelight.base.errors import InputError
from mirelight.dataset.layouts.files import Files
from mirelight.dataset.layouts.pictures import Picture, Shared, opencv_pose
from mirelight.model import F32, Camera


def check_coco(cameras: Sequence[Camera], shared: Shared) -> None:
    """Raises InputError: nothing to be found in pictures."""
    if not shared.objects:
        remedy = "put some into the job ([[objects]]), or leave the layout coco out"
        raise InputError(shared.source, "no inserted objects to find in pictures", remedy)


def write_coco(files: Files, pictures: Iterable[Picture], shared: Shared) -> None:
    """Write pictures and what is seen in them. Raises OutputError: a file cannot be written."""
    kinds: dict[str, int] = {}  # ids of categories
    whole: dict[str, dict[str, Any]] = {
        split: {
            "info": {"description": shared.name},
            "images": [],
            "annotations": [],
            "categories": [],
            "objects": list(shared.objects),
        }
        for split in ("train", "val")
    }
    views: dict[str, list[dict[str, Any]]] = {}
    for number, picture in enumerate(pictures, 1):
        mask = _mask(picture)
        if mask not in views:
            for one in picture.objects:
                kinds.setdefault(one.category, len(kinds) + 1)
            places = np.array([0, *(shared.objects.index(x.name) + 1 for x in picture.objects)], np.uint16)
            index = _index(picture.pixels.shares)
            files.bytes(mask, _png(places[index]))
            views[mask] = _seen(index, picture, shared, kinds)
        image = f"images/{picture.within}{picture.view}.png"
        files.png(image, picture.key, lambda picture=picture: picture.pixels.rgb)  # type: ignore[misc]
        own = whole["train" if picture.split == "train" else "val"]
        own["images"].append({"id": number, "file_name": image, **_camera(picture, shared)})
        for row in views[mask]:
            own["annotations"].append({"id": len(own["annotations"]) + 1, "image_id": number, **row})
        files.frame(picture, image)
    for split, content in whole.items():
        content["categories"] = [{"id": i, "name": name} for name, i in kinds.items()]
        files.json(f"annotations/instances_{split}.json", content)


def _mask(picture: Picture) -> str:
    """The file that tells the objects of a picture apart; pictures of them as they stand in others share it."""
    within = "" if picture.arrangement is None else f"{picture.arrangement:05d}/"
    return f"masks/{within}{picture.view}.png"


def _index(shares: F32) -> NDArray[np.uint16]:
    """(H, W) one more than the place of the object that covers most of a pixel, and half of it; 0 elsewhere."""
    best = shares.argmax(axis=0)
    there = np.take_along_axis(shares, best[None], axis=0)[0] >= 0.5
    return np.where(there, best + 1, 0).astype(np.uint16)


def _png(index: NDArray[np.uint16]) -> bytes:
    from io import BytesIO

    from mirelight.dataset.layouts.files import write_pixels

    out = BytesIO()
    write_pixels(out, index.astype(np.uint8) if index.max(initial=0) < 256 else index)
    return out.getvalue()


def _camera(picture: Picture, shared: Shared) -> dict[str, Any]:
    camera = picture.camera
    return {
        "width": camera.width,
        "height": camera.height,
        "lighting": picture.lighting,
        "mask": _mask(picture),
        "K": [[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]],
        "world_from_camera": opencv_pose(camera, shared.world).tolist(),
    }


def _seen(
    index: NDArray[np.uint16], picture: Picture, shared: Shared, kinds: Mapping[str, int]
) -> list[dict[str, Any]]:
    """What a view's annotations say, but for their numbers."""
    back = np.linalg.inv(opencv_pose(picture.camera, shared.world)) @ shared.world
    out: list[dict[str, Any]] = []
    for place, one in enumerate(picture.objects, 1):
        mask = index == place
        if not mask.any():
            continue
        (top, bottom), (left, right) = (np.flatnonzero(mask.any(axis=axis))[[0, -1]].tolist() for axis in (1, 0))
        out.append(
            {
                "category_id": kinds[one.category],
                "object": one.name,
                "bbox": [left, top, right - left + 1, bottom - top + 1],
                "area": int(mask.sum()),
                "iscrowd": 0,
                "segmentation": {"size": list(mask.shape), "counts": _runs(mask)},
                "box_3d": _box(back @ one.box),
            }
        )
    return out


def _box(box: Matrix) -> dict[str, Any]:
    """Of a box (4, 4) from the cube of side 1 about 0; its axes are the rows of `axes`."""
    size = np.linalg.norm(box[:3, :3], axis=0)
    axes = box[:3, :3] / np.maximum(size, 1e-12)
    return {
        "center": box[:3, 3].tolist(),
        "size": size.tolist(),
        "axes": axes.T.tolist(),
        "corners": conventions.box_corners(box).tolist(),
    }


def _runs(mask: NDArray[np.bool_]) -> str:
    """A mask as COCO packs it: lengths of runs down the columns, the first of zeros, from the fourth on less the one
    two before, each in groups of five bits, the least first, as letters from "0" on."""
    flat = np.concatenate([[False], mask.ravel(order="F")])
    ends = np.append(np.flatnonzero(flat[1:] != flat[:-1]), mask.size)
    lengths = np.diff(ends, prepend=0).tolist()
    out: list[str] = []
    for i, length in enumerate(lengths):
        value, more = length - (lengths[i - 2] if i > 2 else 0), True
        while more:
            low, value = value & 0x1F, value >> 5
            more = value != (-1 if low & 0x10 else 0)
            out.append(chr(48 + (low | (0x20 if more else 0))))
    return "".join(out)
