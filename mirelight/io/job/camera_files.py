"""The cameras of the files that a job names: chosen, placed in the world, on the job's pixel grid."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Protocol

import numpy as np

from mirelight.base import conventions
from mirelight.base.conventions import Matrix
from mirelight.io.job.camera_file_tables import CamerasFromTable
from mirelight.io.job.fields import PROXY
from mirelight.io.job.lighting import choose
from mirelight.io.job.mistakes import Mistake
from mirelight.io.job.placing import matrix
from mirelight.io.job.positions import Path
from mirelight.io.job.scene_tables import ProxyTable, SplatsTable, Transform
from mirelight.io.job.shutters import open_between
from mirelight.io.job.words import shown_path
from mirelight.io.suffixes import SCENES, USD
from mirelight.model import Camera

if TYPE_CHECKING:
    from mirelight.io.cameras import CameraFile, FileCamera
    from mirelight.io.cameras.pictures import Picture

# The kinds of file that an option is for; the others refuse it.
_FOR = {
    "axes": ("transforms.json", "CSV"),
    "world": ("transforms.json", "camera_path.json"),
    "fps": ("glTF", "OpenUSD", "SuperSplat"),
    "frames": ("glTF", "OpenUSD", "SuperSplat"),
    "time": ("glTF", "OpenUSD"),
    "distortion": ("COLMAP", "transforms.json"),
    "shutter": ("glTF", "OpenUSD", "SuperSplat", "camera_path.json"),
}


class SceneCamera(Protocol):
    """A camera of a file with a world of its own: glTF or OpenUSD."""

    @property
    def name(self) -> str:
        """As the file names it."""

    @property
    def world(self) -> Matrix:
        """(4, 4) world_from_camera, perhaps with a scale."""

    @property
    def shutter(self) -> tuple[float, float]:
        """Seconds after a frame's moment that it opens and closes; both 0 where the file says none."""

    def to_camera(self, width: int, height: int, world: Matrix | None = None) -> Camera:
        """The camera on a pixel grid, at another pose."""


class CameraFiles(Protocol):
    """Reads the cameras that a job names."""

    folder: FilePath  # the job's

    def scene_cameras(self, path: str) -> tuple[tuple[SceneCamera, ...], Matrix]:
        """The cameras of a glTF file or a stage ("proxy": the proxy's), and the transform that they have by default."""

    def sampled(
        self, path: str, name: str, fps: float | None, frames: int | None, time: float | None = None
    ) -> tuple[tuple[float, SceneCamera], ...]:
        """Times (s) of an animated camera, and the camera then: at a rate, so many, or at one time."""

    def camera_file(self, path: str) -> CameraFile:
        """A file or folder of cameras of any other format."""


def frame_name(name: str, frame: int) -> str:
    """One frame of a sequence, counted from 1: orbit.0001."""
    return f"{name}.{frame:04d}"


def cameras_from(
    table: CamerasFromTable,
    at: Path,
    resolution: tuple[int, int],
    splats: Sequence[SplatsTable],
    files: CameraFiles,
    wrong: list[Mistake],
) -> list[Camera]:
    """The cameras of one file; what is wrong is added to `wrong`.

    Args:
        table: what the job says.
        at: where it says so.
        resolution: width and height in pixels of cameras whose file gives none.
        splats: the job's, whose transform places a capture's cameras.
        files: reads them.
        wrong: gets what is wrong.
    """
    if table.path == PROXY or table.path.lower().endswith(SCENES):
        found = _of_scene(table, at, resolution, splats, files, wrong)
    else:
        found = _captured(table, at, resolution, splats, files, wrong)
    return [table.exposed(camera, None).scaled(table.resolution_scale) for camera in found]


def _of_scene(
    table: CamerasFromTable,
    at: Path,
    resolution: tuple[int, int],
    splats: Sequence[SplatsTable],
    files: CameraFiles,
    wrong: list[Mistake],
) -> list[Camera]:
    kind = "OpenUSD" if table.path.lower().endswith(USD) else "glTF"
    if not _fitting(table, at, kind, wrong):
        return []
    found, default = files.scene_cameras(table.path)
    m = default if table.transform is None else _placing(table.transform, at, splats, wrong)
    size = (table.resolution[0], table.resolution[1]) if table.resolution else resolution
    out: list[Camera] = []
    moving = table.fps is not None or table.frames is not None
    timed = moving or table.time is not None
    if table.shutter and not moving:
        wrong.append(Mistake((*at, "shutter"), "a shutter, but no frames that follow each other", "give fps or frames"))
    for i in _chosen([x.name for x in found], table, at, wrong, every=1 if moving else table.every):
        if not timed:
            out.append(found[i].to_camera(*size, m @ found[i].world))
            continue
        moments = files.sampled(table.path, found[i].name, table.fps, table.frames, table.time)
        still = [replace(one.to_camera(*size, m @ one.world), time=time) for time, one in moments]
        if not moving:
            out += still
            continue
        still = _exposed(still, [one for _, one in moments], table)
        out += [replace(x, name=frame_name(x.name, n)) for n, x in enumerate(still, start=1)][:: table.every]
    return out


def _exposed(cameras: list[Camera], of: Sequence[SceneCamera], table: CamerasFromTable) -> list[Camera]:
    """The frames of an animated camera with its shutter, the job's or else the file's own."""
    if table.shutter is not None:
        return open_between(cameras, -table.shutter / 2, table.shutter / 2)
    first, second = (x.time for x in cameras[:2]) if len(cameras) > 1 else (None, None)
    if first is None or second is None:
        return cameras
    opens, closes = (x / (second - first) for x in of[0].shutter)
    return open_between(cameras, opens, closes)


def with_pictures(
    table: ProxyTable,
    resolution: tuple[int, int],
    splats: Sequence[SplatsTable],
    files: CameraFiles,
    wrong: list[Mistake],
) -> tuple[list[Camera], tuple[Picture | None, ...]]:
    """The cameras of a capture's pictures, and what those took that are looked from; None where it is not known.

    Args:
        table: that names the cameras, and perhaps the folder of their pictures.
        resolution: width and height in pixels of cameras that neither their file nor a picture gives one.
        splats: the job's, whose transform places the cameras.
        files: reads them.
        wrong: gets what is wrong.
    """
    from mirelight.io.cameras.pictures import find_all

    assert table.cameras is not None
    at, wanted = ("proxy", "cameras"), table.pictures
    if table.cameras == PROXY or table.cameras.lower().endswith(SCENES):
        named = CamerasFromTable.model_construct({"path"}, path=table.cameras, transform="splats")
        scene = _of_scene(named, at, resolution, splats, files, wrong)
        return scene, (None,) * len(scene)
    file = files.camera_file(table.cameras)
    folder = files.folder / wanted if isinstance(wanted, str) else None
    found = file.read()
    pictures = find_all(file, found, folder) if wanted else (None,) * len(found)
    if isinstance(wanted, str) and not any(pictures):
        remedy = f"name the folder in which {shown_path(found[0].picture or 'a picture')} lies"
        wrong.append(
            Mistake(("proxy", "pictures"), f"{shown_path(wanted)}, without a picture of these cameras", remedy)
        )
    m = _placing("splats", at, splats, wrong)
    cameras = list[Camera]()
    for one, picture in zip(found, pictures, strict=True):
        size = picture.lens.size if picture is not None else one.size(resolution)
        cameras.append(one.to_camera(size, conventions.rigid_part(m @ one.world_from_camera)))
    return cameras, pictures


def _captured(
    table: CamerasFromTable,
    at: Path,
    resolution: tuple[int, int],
    splats: Sequence[SplatsTable],
    files: CameraFiles,
    wrong: list[Mistake],
) -> list[Camera]:
    file = files.camera_file(table.path)
    if not _fitting(table, at, file.kind, wrong):
        return []
    found = file.read(axes=table.axes, world=table.world, fps=table.fps, frames=table.frames)
    m = _placing(table.transform or "splats", at, splats, wrong)
    chosen = [found[i] for i in _chosen([x.name for x in found], table, at, wrong, table.every)]
    if table.distortion == "error":
        _refuse_bent(chosen, table, at, wrong)
    out = []
    for camera in chosen:
        size = (table.resolution[0], table.resolution[1]) if table.resolution else camera.size(resolution)
        out.append(camera.to_camera(size, conventions.rigid_part(m @ camera.world_from_camera)))
    half = (table.shutter or 0.0) / 2
    return open_between(out, -half, half)


def _fitting(table: CamerasFromTable, at: Path, kind: str, wrong: list[Mistake]) -> bool:
    """True where every option that is set is one for this kind of file."""
    others = [name for name, kinds in _FOR.items() if name in table.model_fields_set and kind not in kinds]
    for name in others:
        found = f"{name} for {shown_path(table.path)}, which is {kind}"
        wrong.append(Mistake((*at, name), found, f"leave it out; it is for {' and '.join(_FOR[name])}"))
    return not others


def _chosen(names: list[str], table: CamerasFromTable, at: Path, wrong: list[Mistake], every: int) -> list[int]:
    """Indices of the cameras that the table wants, each once, in the order that it wants them."""
    if table.names is None:
        found = list(choose(names, None, at, "camera", table.path, wrong))
    else:
        found = list(dict.fromkeys(_named(names, table.names, at, table.path, wrong)))
    return found[::every]


def _named(names: list[str], wanted: list[str], at: Path, file: str, wrong: list[Mistake]) -> Iterator[int]:
    exact = set(names)
    for i, name in enumerate(wanted):
        is_pattern = name not in exact and any(c in name for c in "*?")
        matches = [n for n, x in enumerate(names) if is_pattern and fnmatchcase(x, name.replace("[", "[[]"))]
        if matches:
            yield from matches
            continue
        misses: list[Mistake] = []
        yield from choose(names, [name], at, "camera", file, misses)
        wrong += [replace(mistake, path=(*at, "names", i)) for mistake in misses]


def _placing(transform: Transform | str, at: Path, splats: Sequence[SplatsTable], wrong: list[Mistake]) -> Matrix:
    if isinstance(transform, Transform):
        return matrix(transform)
    if transform == "none" or not splats:
        return np.eye(4)
    placed = [matrix(table.transform) for table in splats]
    if any(not np.array_equal(m, placed[0]) for m in placed[1:]):
        remedy = 'give a table, or "none"; these cameras cannot follow several captures'
        wrong.append(Mistake((*at, "transform"), "the job's splats have different transforms", remedy))
    return placed[0]


def _refuse_bent(cameras: list[FileCamera], table: CamerasFromTable, at: Path, wrong: list[Mistake]) -> None:
    from mirelight.io.cameras import STRAIGHT

    shifts = [(camera.shift(), camera) for camera in cameras]
    bent = [(shift, camera) for shift, camera in shifts if shift > STRAIGHT]
    if not bent:
        return
    shift, worst = max(bent, key=lambda x: x[0])
    assert worst.distortion is not None
    more = f" and {len(bent) - 1:,} more" if len(bent) > 1 else ""
    lens = f"a lens of model {worst.distortion.model} that moves pixels by up to {shift:.3g}"
    remedy = 'undistort the capture, or say distortion = "ignore" for the pinhole of the same focal length'
    wrong.append(Mistake((*at, "path"), f"{shown_path(table.path)}, camera {worst.name!r}{more}: {lens}", remedy))
