"""The capture's own cameras: found beside it, or given, and brought to the world that its splats lie in."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mirelight.apps.first_job.beside import Misfit, why
from mirelight.apps.first_job.pictured import alike
from mirelight.base import conventions
from mirelight.base.errors import InputError, printable
from mirelight.io.cameras import DATAPARSER, worlds
from mirelight.io.cameras.pictures import find_all
from mirelight.io.splats.training import NERFSTUDIO, data_of, folder_of
from mirelight.model import F64, Camera, Deferred, SplatCloud, SplatLayer, SplatWorld

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mirelight.io.cameras import CameraFile, FileCamera

_NAMES = ("sparse/0", "sparse", "transforms.json", "cameras.json")
_POINTS = 5_000
_SHARE = 0.002  # of the splats, that a camera of theirs has in its picture at the least
_LOOKED_AT = 20  # cameras
_SIZE = (960, 540)  # pixels of cameras whose file gives none
_CLEARLY = 0.2  # more alike are pictures in the right world: 0.5 to 0.7, in others 0 to 0.1


@dataclass(frozen=True, slots=True, eq=False)
class Cameras:
    """A file or folder of the capture's cameras, in the splats' own axes."""

    path: Path
    cameras: tuple[FileCamera, ...]  # at least one
    world: SplatWorld = "capture"  # that they were brought to

    def placed(self, turn: F64) -> tuple[Camera, ...]:
        """The cameras in the world, as pinholes: `turn` (3, 3) is from the splats' axes to the world."""
        m = conventions.compose(rotation=turn)
        return tuple(one.to_camera(one.size(_SIZE), m @ one.world_from_camera) for one in self.cameras)

    def views(self, world: SplatCloud, turn: F64) -> tuple[SplatLayer, ...]:
        """What they see, in the colours of their pictures where those lie there.

        Args:
            world: the splats, in world space.
            turn: (3, 3) rotation from the splats' axes to the world.
        """
        from mirelight.io.cameras import open_file
        from mirelight.proxy.capture_views import capture_views

        pictures = find_all(open_file(self.path), self.cameras)
        m = conventions.compose(rotation=turn)
        cameras = [
            one.to_camera(one.size(_SIZE) if picture is None else picture.lens.size, m @ one.world_from_camera)
            for one, picture in zip(self.cameras, pictures, strict=True)
        ]
        taken = [None if x is None else Deferred("", x.read, keep=False) for x in pictures]
        return capture_views(world, cameras, taken)


def find(capture: Path, cloud: SplatCloud, given: Path | None = None) -> tuple[Cameras | None, Misfit | None]:
    """The capture's cameras and None, or None and why the first file of them cannot be used.

    They are given, or in its own file, beside it, or where its training says.

    Args:
        capture: the splat file.
        cloud: as the file has it.
        given: a file or folder of cameras, which must be right.

    Raises:
        InputError: what is given is not.
    """
    from mirelight.io.cameras import one_picture, open_file

    if given is not None:
        file = open_file(given)
        return _brought(file, capture, cloud), None
    if one_picture.is_of(capture):
        return Cameras(capture, open_file(capture).read()), None
    misfit: Misfit | None = None
    for path in _places(capture):
        if path.exists():
            try:
                return _brought(open_file(path), capture, cloud), None
            except InputError as refused:
                misfit = misfit or Misfit(path, why(refused), "a camera is placed without")
    return None, misfit


def _places(capture: Path) -> list[Path]:
    """Where cameras may lie, the likeliest first."""
    training = folder_of(capture)
    places = [capture.parent / name for name in _NAMES]
    if training is not None:
        places.append(training / "cameras.json")
    data = data_of(capture)
    if data is None or data.is_file():
        return places if data is None else [*places, data]
    return [*places, *(data / name for name in (*_NAMES[:2], "colmap/sparse/0", *_NAMES[2:]))]


def _brought(file: CameraFile, capture: Path, cloud: SplatCloud) -> Cameras:
    """A file's cameras in the splats' world, which what their pictures showed tells, or else what they see.

    Raises:
        InputError: neither points nor pictures lie where these splats are.
    """
    centres = cloud.means[cloud.opaque].astype(np.float64)

    def in_world(world: SplatWorld) -> Cameras:
        return Cameras(file.path, file.read(world=world, centres=lambda: centres), world)

    plain = in_world("capture")
    world = file.world_of(plain.cameras, centres) or _by_nerfstudio(file, capture, plain.cameras)
    if world is not None:
        return in_world(world)
    tried = [plain, *(in_world(x) for x in file.worlds() if x == "nerfstudio")]
    if len(tried) == 1:
        return plain
    pictures = find_all(file, plain.cameras)
    shown = [alike(x.cameras, pictures, cloud) for x in tried]
    told = [x for x in shown if x is not None]
    if told and max(told) - min(told) > _CLEARLY:
        return tried[int(np.argmax(told))]
    if told and max(told) < _CLEARLY and file.points() is not None:
        remedy = "give those of this capture, as its splats lie: an editor may have turned or scaled them"
        raise InputError(file.path, "neither its points nor its pictures lie where these splats are", remedy)
    return next((x for x in tried if look_at(x, cloud)), plain)


def _by_nerfstudio(file: CameraFile, capture: Path, cameras: Sequence[FileCamera]) -> SplatWorld | None:
    """nerfstudio's world where a capture lies in a training of its, and moved by its defaults.

    Raises:
        InputError: the training moved it otherwise.
    """
    said = capture.absolute().parent.parent / DATAPARSER
    if capture.absolute().parent.name != NERFSTUDIO or "nerfstudio" not in file.worlds():
        return None
    # what nerfstudio's viewer wrote lies in that world as it is
    if file.kind != "camera_path.json" and file.dataparser is None and said.is_file():
        own, ours = worlds.said_by_nerfstudio(said), file.to_world(cameras, "nerfstudio", None)
        if not np.allclose(own, ours, atol=1e-3 * np.abs(own).max()):
            found = (
                f"nerfstudio moved its world by other rules than its defaults: copy {printable(str(said))} beside it"
            )
            raise InputError(file.path, found, "then run this again")
    return "nerfstudio"


def around(found: Cameras, cloud: SplatCloud) -> bool:
    """Whether most cameras stand outside the box that holds the splats but strays: then it is no room.

    Args:
        found: the cameras.
        cloud: as the file has it.
    """
    solid = cloud.means[cloud.opacities > 0.1].astype(np.float64)
    if not len(solid):
        return False
    low, high = np.quantile(solid, [0.01, 0.99], axis=0)
    places = np.array([one.world_from_camera[:3, 3] for one in found.cameras])
    return float(((places < low) | (places > high)).any(axis=1).mean()) > 0.5


def look_at(found: Cameras, cloud: SplatCloud) -> bool:
    """Whether most cameras have splats before them: those of another scene, or in other axes or units, mostly do not.

    Args:
        found: the cameras.
        cloud: as the file has it.
    """
    solid = cloud.means[cloud.opaque].astype(np.float64)
    means = solid[:: max(1, len(solid) // _POINTS)]
    sees = []
    for one in found.cameras[:: -(-len(found.cameras) // _LOOKED_AT)]:
        camera = one.to_camera(one.size(_SIZE))
        local = (means - camera.position) @ camera.world_from_camera[:3, :3]
        away = np.maximum(-local[:, 2], 1e-9)
        x = np.abs(local[:, 0] / away * camera.fx) < camera.width / 2
        y = np.abs(local[:, 1] / away * camera.fy) < camera.height / 2
        sees.append(bool((x & y & (local[:, 2] < 0)).sum() > _SHARE * len(means)))
    return float(np.mean(sees)) > 0.5
