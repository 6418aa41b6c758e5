"""The cameras of the files that a job names: chosen, placed in the world, on the job's pixel grid."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING

import numpy as np

from mirelight.base import conventions
from mirelight.base.conventions import Matrix
from mirelight.io.job.assets import Assets
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
from mirelight.model import F64, Camera, SplatWorld

if TYPE_CHECKING:
    from mirelight.io.cameras import CameraFile, FileCamera
    from mirelight.io.cameras.pictures import Picture
    from mirelight.io.job.assets import SceneCamera

# The kinds of file that an option is for; the others refuse it.
_FOR = {
    "axes": ("transforms.json", "CSV"),
    "world": ("COLMAP", "transforms.json", "camera_path.json"),
    "fps": ("glTF", "OpenUSD", "SuperSplat"),
    "frames": ("glTF", "OpenUSD", "SuperSplat"),
    "time": ("glTF", "OpenUSD"),
    "distortion": ("COLMAP", "transforms.json"),
    "shutter": ("glTF", "OpenUSD", "SuperSplat", "camera_path.json"),
}


def frame_name(name: str, frame: int) -> str:
    """One frame of a sequence, counted from 1: orbit.0001."""
    return f"{name}.{frame:04d}"


@dataclass(frozen=True, slots=True, eq=False)
class FromFiles:
    """Takes cameras from the files that a job names."""

    resolution: tuple[int, int]  # width and height in pixels of cameras that neither their file nor a picture gives one
    splats: Sequence[SplatsTable]  # the job's, whose transform places a capture's cameras
    files: Assets
    wrong: list[Mistake]  # gets what is wrong

    def cameras(self, table: CamerasFromTable, at: Path) -> list[Camera]:
        """The cameras of the file that the job names at a place."""
        scene = table.path == PROXY or table.path.lower().endswith(SCENES)
        found = self._of_scene(table, at) if scene else self._captured(table, at)
        return [table.exposed(camera, None).scaled(table.resolution_scale) for camera in found]

    def with_pictures(self, table: ProxyTable) -> tuple[list[Camera], tuple[Picture | None, ...]]:
        """The cameras of a capture's pictures, and what those took that are looked from; None where it is not known.

        Args:
            table: that names the cameras, and perhaps the folder of their pictures.
        """
        from mirelight.io.cameras.pictures import find_all

        assert table.cameras is not None
        at, wanted = ("proxy", "cameras"), table.pictures
        if table.cameras == PROXY or table.cameras.lower().endswith(SCENES):
            named = CamerasFromTable.model_construct({"path"}, path=table.cameras, transform="splats")
            scene = self._of_scene(named, at)
            return scene, (None,) * len(scene)
        file = self.files.camera_file(table.cameras)
        folder = self.files.folder / wanted if isinstance(wanted, str) else None
        found = file.read(world=self._world(file, None, at), centres=self._centres)
        pictures = find_all(file, found, folder) if wanted else (None,) * len(found)
        if isinstance(wanted, str) and not any(pictures):
            remedy = f"name the folder in which {shown_path(found[0].picture or 'a picture')} lies"
            said = f"{shown_path(wanted)}, without a picture of these cameras"
            self.wrong.append(Mistake(("proxy", "pictures"), said, remedy))
        m = self._placing("splats", at)
        cameras = list[Camera]()
        for one, picture in zip(found, pictures, strict=True):
            size = picture.lens.size if picture is not None else one.size(self.resolution)
            cameras.append(one.to_camera(size, conventions.rigid_part(m @ one.world_from_camera)))
        return cameras, pictures

    def _of_scene(self, table: CamerasFromTable, at: Path) -> list[Camera]:
        kind = "OpenUSD" if table.path.lower().endswith(USD) else "glTF"
        if not self._fitting(table, at, kind):
            return []
        found, default = self.files.scene_cameras(table.path)
        m = default if table.transform is None else self._placing(table.transform, at)
        size = (table.resolution[0], table.resolution[1]) if table.resolution else self.resolution
        out: list[Camera] = []
        moving = table.fps is not None or table.frames is not None
        timed = moving or table.time is not None
        if table.shutter and not moving:
            said = "a shutter, but no frames that follow each other"
            self.wrong.append(Mistake((*at, "shutter"), said, "give fps or frames"))
        for i in self._chosen([x.name for x in found], table, at, every=1 if moving else table.every):
            if not timed:
                out.append(found[i].to_camera(*size, m @ found[i].world))
                continue
            moments = self.files.sampled(table.path, found[i].name, table.fps, table.frames, table.time)
            still = [replace(one.to_camera(*size, m @ one.world), time=time) for time, one in moments]
            if not moving:
                out += still
                continue
            still = _exposed(still, [one for _, one in moments], table)
            out += [replace(x, name=frame_name(x.name, n)) for n, x in enumerate(still, start=1)][:: table.every]
        return out

    def _captured(self, table: CamerasFromTable, at: Path) -> list[Camera]:
        file = self.files.camera_file(table.path)
        if not self._fitting(table, at, file.kind):
            return []
        world = self._world(file, table.world, at)
        found = file.read(axes=table.axes, world=world, centres=self._centres, fps=table.fps, frames=table.frames)
        m = self._placing(table.transform or "splats", at)
        chosen = [found[i] for i in self._chosen([x.name for x in found], table, at, table.every)]
        if table.distortion == "error":
            self._refuse_bent(chosen, table, at)
        out = []
        for camera in chosen:
            size = (table.resolution[0], table.resolution[1]) if table.resolution else camera.size(self.resolution)
            out.append(camera.to_camera(size, conventions.rigid_part(m @ camera.world_from_camera)))
        half = (table.shutter or 0.0) / 2
        return open_between(out, -half, half)

    def _fitting(self, table: CamerasFromTable, at: Path, kind: str) -> bool:
        """True where every option that is set is one for this kind of file."""
        others = [name for name, kinds in _FOR.items() if name in table.model_fields_set and kind not in kinds]
        for name in others:
            found = f"{name} for {shown_path(table.path)}, which is {kind}"
            self.wrong.append(Mistake((*at, name), found, f"leave it out; it is for {' and '.join(_FOR[name])}"))
        return not others

    def _chosen(self, names: list[str], table: CamerasFromTable, at: Path, every: int) -> list[int]:
        """Indices of the cameras that the table wants, each once, in the order that it wants them."""
        if table.names is None:
            found = list(choose(names, None, at, "camera", table.path, self.wrong))
        else:
            found = list(dict.fromkeys(self._named(names, table.names, at, table.path)))
        return found[::every]

    def _named(self, names: list[str], wanted: list[str], at: Path, file: str) -> Iterator[int]:
        exact = set(names)
        for i, name in enumerate(wanted):
            is_pattern = name not in exact and any(c in name for c in "*?")
            matches = [n for n, x in enumerate(names) if is_pattern and fnmatchcase(x, name.replace("[", "[[]"))]
            if matches:
                yield from matches
                continue
            misses: list[Mistake] = []
            yield from choose(names, [name], at, "camera", file, misses)
            self.wrong.extend(replace(mistake, path=(*at, "names", i)) for mistake in misses)

    def _placing(self, transform: Transform | str, at: Path) -> Matrix:
        if isinstance(transform, Transform):
            return matrix(transform)
        if transform == "none" or not self.splats:
            return np.eye(4)
        placed = [matrix(table.transform) for table in self.splats]
        if any(not np.array_equal(m, placed[0]) for m in placed[1:]):
            remedy = 'give a table, or "none"; these cameras cannot follow several captures'
            self.wrong.append(Mistake((*at, "transform"), "the job's splats have different transforms", remedy))
        return placed[0]

    def _world(self, file: CameraFile, wanted: SplatWorld | None, at: Path) -> SplatWorld:
        """The world that a file's cameras are brought to: the wanted one, or else that of the splats, where its format
        leads there; others lie in it as they are."""
        known, splats = file.worlds(), {table.world for table in self.splats}
        if wanted is not None and wanted not in known:
            said = f"{wanted} for {shown_path(str(file.path.name))}, which is {file.kind}"
            remedy = f"give {' or '.join(known)}"
            self.wrong.append(Mistake((*at, "world"), said, remedy))
            return "capture"
        found = wanted or (splats.pop() if len(splats) == 1 else "capture")
        if found == "gsplat" and found in known:
            self.files.points(file)
        return found if found in known else "capture"

    def _centres(self) -> F64:
        """(N, 3) of the first file's splats, in its own axes."""
        return self.files.centres(self.splats[0]) if self.splats else np.zeros((0, 3))

    def _refuse_bent(self, cameras: list[FileCamera], table: CamerasFromTable, at: Path) -> None:
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
        said = f"{shown_path(table.path)}, camera {worst.name!r}{more}: {lens}"
        self.wrong.append(Mistake((*at, "path"), said, remedy))


def _exposed(cameras: list[Camera], of: Sequence[SceneCamera], table: CamerasFromTable) -> list[Camera]:
    """The frames of an animated camera with its shutter, the job's or else the file's own."""
    if table.shutter is not None:
        return open_between(cameras, -table.shutter / 2, table.shutter / 2)
    first, second = (x.time for x in cameras[:2]) if len(cameras) > 1 else (None, None)
    if first is None or second is None:
        return cameras
    opens, closes = (x / (second - first) for x in of[0].shutter)
    return open_between(cameras, opens, closes)
