"""The layout of the TUM RGB-D benchmark: a folder a lighting, which is a sequence of all cameras in the job's order.

`rgb/NAME.png` and `depth/NAME.png` are listed in `rgb.txt` and `depth.txt` (timestamp, file); `groundtruth.txt` has
timestamp tx ty tz qx qy qz qw, world from camera with OpenCV's axes. Frame k of a sequence is at k / 30 s, so that
`associate.py`, ORB-SLAM's and Open3D's readers pair each picture with its own depth. `calibration.txt` has fx fy cx cy,
as ETH3D's sequences do.

Traps: depth is along the view axis, 16 bit, 5000 to the metre, so that beyond 13.1 m there is none (0). Loaders take
one lens for all pictures, and pixel centres at whole numbers, so cx and cy are half a pixel less than elsewhere. They
read pictures without alpha: these lie on black. The quaternion's w comes last. Worlds have Z up. Sequences know no
parts: held-out frames are in them.

Format: https://cvg.cit.tum.de/data/datasets/rgbd-dataset/file_formats
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from mirelight.base import conventions
from mirelight.base.conventions import Matrix
from mirelight.base.errors import InputError
from mirelight.dataset.layouts.files import Files
from mirelight.dataset.layouts.pictures import SAME, Picture, Shared, depth_steps, opencv_pose
from mirelight.model import Camera

STEPS = 5000.0  # of depth, in a world unit, which is a metre
FARTHEST = 65535 / STEPS
RATE = 30.0  # frames per second
_HEADS = {
    "rgb.txt": "# color images\n# timestamp filename\n",
    "depth.txt": "# depth maps\n# timestamp filename\n",
    "groundtruth.txt": "# ground truth trajectory\n# timestamp tx ty tz qx qy qz qw\n",
}


def check_tum(cameras: Sequence[Camera], shared: Shared) -> None:
    """Raises InputError: a camera that the layout cannot hold, or nothing near enough to have a depth in it."""
    for camera in cameras:
        first = cameras[0]
        if (camera.width, camera.height) != (first.width, first.height):
            found = f"is {camera.width} x {camera.height} pixels, and {first.name!r} {first.width} x {first.height}"
        elif any(abs(a - b) > SAME * first.fx for a, b in zip(_lens(camera), _lens(first), strict=True)):
            found = f"has another lens than {first.name!r}"
        else:
            continue
        remedy = "a sequence has one lens for all; render such cameras apart, or use the layout colmap"
        raise InputError(shared.source, f"camera {camera.name!r} {found}", remedy)
    if shared.near_far is not None and shared.near_far[0] > FARTHEST:
        found = f"nothing nearer than {FARTHEST:.1f}, the most that 16-bit depth of 5000 to the unit holds"
        raise InputError(shared.source, found, "give --normalize (normalize = true), or use the layout nerf or colmap")


def write_tum(files: Files, pictures: Iterable[Picture], shared: Shared) -> None:
    """Write pictures, those of a lighting in their order. Raises OutputError: a file cannot be written."""
    counts: dict[str, int] = {}  # frames of a sequence, by its folder
    lists: dict[str, list[str]] = {}  # lines, by file
    for picture in pictures:
        within, pixels = picture.within, picture.pixels
        place = counts.get(within, 0)
        counts[within] = place + 1
        time = f"{place / RATE:.6f}"
        if not place:
            files.text(f"{within}calibration.txt", _numbers(_lens(picture.camera)) + "\n")
            lists.update((f"{within}{name}", [head]) for name, head in _HEADS.items())
        image, depth = f"rgb/{picture.view}.png", f"depth/{picture.view}.png"
        files.png(within + image, picture.key, lambda pixels=pixels: pixels.rgb)  # type: ignore[misc]
        lists[f"{within}rgb.txt"].append(f"{time} {image}\n")
        if pixels.has_geometry:
            files.png(
                within + depth,
                picture.view_key,
                lambda pixels=pixels: depth_steps(shared.depth(pixels), STEPS),  # type: ignore[misc]
            )
            lists[f"{within}depth.txt"].append(f"{time} {depth}\n")
        lists[f"{within}groundtruth.txt"].append(f"{time} {_numbers(_pose(picture.camera, shared.world))}\n")
        files.frame(picture, within + image)
    for name, lines in lists.items():
        files.text(name, "".join(lines))


def _lens(camera: Camera) -> tuple[float, float, float, float]:
    """fx, fy, cx, cy with pixel centres at whole numbers."""
    return camera.fx, camera.fy, camera.cx - 0.5, camera.cy - 0.5


def _pose(camera: Camera, world: Matrix) -> list[float]:
    """tx ty tz qx qy qz qw of a camera in the data set's world."""
    pose = opencv_pose(camera, world)
    w, x, y, z = conventions.quaternion_from_rotation(pose[:3, :3]).tolist()
    return [*pose[:3, 3].tolist(), x, y, z, w]


def _numbers(values: Iterable[float]) -> str:
    return " ".join(f"{round(x, 9) + 0.0:.9f}" for x in values)  # no -0
