"""Files that a job names: read by those names, and a digest kept of each."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from mirelight import model
from mirelight.base.conventions import Matrix
from mirelight.base.errors import InputError
from mirelight.io.job import inserted, placing
from mirelight.io.job.fields import PROXY
from mirelight.io.job.hashing import digest, digest_of_all, digest_of_splats, file_digest
from mirelight.io.job.light_tables import LightUnit
from mirelight.io.job.scene_tables import ObjectTable, ProxyTable, SplatsTable, Transform
from mirelight.io.safety import open_binary
from mirelight.io.suffixes import GLTF, USD
from mirelight.model import F32, F64, Camera, Deferred, Inserted, Light, OwnSplats, ProxyMesh, SplatCloud, SplatFile

if TYPE_CHECKING:
    from mirelight.io.cameras import CameraFile
    from mirelight.io.cameras.pictures import Picture
    from mirelight.io.gltf.cameras import GltfCamera
    from mirelight.io.gltf.moving_lights import Shot
    from mirelight.io.ies import IesFile
    from mirelight.io.usd.cameras import UsdCamera

    SceneCamera: TypeAlias = GltfCamera | UsdCamera  # of a file with a world of its own

_ASPECT = 0.02  # by which a mask's shape may differ from its camera's: sides are rounded


@dataclass(slots=True)
class Assets:
    """Reads files by the names that the job gives them, and keeps a digest of each."""

    folder: Path
    proxy: ProxyTable | None
    engine: model.EngineSettings  # what lights in its terms count on
    digests: dict[str, str] = field(default_factory=dict)
    shots: dict[Path, Shot] = field(default_factory=dict)  # open glTF files whose lights move
    notes: dict[str, None] = field(default_factory=dict)  # lines about what the files hold, each once

    def path(self, named: str) -> Path:
        """The file of a name in the job; its digest is taken now."""
        path = self.folder / named
        if named not in self.digests:
            self.digests[named] = digest(path)
            if path.suffix.lower() in USD:
                from mirelight.io.usd.files import notes_of

                self.notes |= dict.fromkeys(f"{path.name}: {note}" for note in notes_of(path))
        return path

    def splat_files(self, tables: list[SplatsTable]) -> tuple[SplatFile, ...]:
        """The splat files, and how the job places them."""
        return tuple(
            SplatFile(
                path=self.path(t.path),
                world_from_file=placing.matrix(t.transform),
                lod=t.lod,
                color_space=t.color_space,
            )
            for t in tables
        )

    def splats(self, tables: list[SplatsTable], files: tuple[SplatFile, ...]) -> Deferred[SplatCloud]:
        """All splat files in world space, as one cloud."""
        known = [(self.digests[t.path], x) for t, x in zip(tables, files, strict=True)]
        return Deferred(digest_of_splats(known), partial(_cloud, files))

    def centres(self, table: SplatsTable) -> F64:
        """(N, 3) of a file's solid splats, in its own axes."""
        from mirelight.io import splats

        cloud = splats.read(self.path(table.path), lod=table.lod)
        return cloud.means[cloud.opaque].astype(np.float64)

    def own_splats(self, tables: list[SplatsTable] | None, files: tuple[SplatFile, ...]) -> OwnSplats | None:
        """Those of one file in its own axes; None where they lie in the world as they do there, or in several."""
        if not tables or len(files) != 1 or placing.is_identity(files[0].world_from_file):
            return None
        bare = replace(files[0], world_from_file=np.eye(4))
        known = digest_of_splats([(self.digests[tables[0].path], bare)])
        return OwnSplats(Deferred(known, partial(_cloud, (bare,)), keep=False), files[0].world_from_file)

    def mesh(self, table: ProxyTable, *, finish: bool = False) -> Deferred[ProxyMesh]:
        """The proxy in world space; gray where its colours come from the splats. `finish`: with textures of metallic
        and roughness, which matt light does not see."""
        path, m = self.path(table.path), placing.matrix(table.transform)
        if path.suffix.lower() in GLTF:
            from mirelight.io.gltf.decoders import refuse_without_decoder

            refuse_without_decoder(path)
        albedo = "gray" if table.albedo == "splats" else table.albedo
        return Deferred(
            model.digest("proxy", self.digests[table.path], m, albedo), partial(_mesh, path, m, albedo, finish)
        )

    def inserted(self, table: ObjectTable) -> Inserted:
        """An object in world space, before it is dropped."""
        return inserted.of_table(table, self.path(table.path), self.digests[table.path])

    def scene_lights(
        self, path: str, unit: LightUnit | None = None, time: float | None = None
    ) -> tuple[tuple[Light, ...], Matrix]:
        """The lights of a glTF file or a stage ("proxy": the proxy's) in physical units, at a time (s) of its
        animation, and the transform that they have by default."""
        from mirelight.io.gltf import blender
        from mirelight.io.gltf.moving_lights import Shot
        from mirelight.io.gltf.scene import read_lights_of

        file, default = self._scene(path)
        if file.suffix.lower() in USD:
            return self._stage_lights(file, time), default
        if time is not None and file not in self.shots:
            self.shots[file] = Shot.of(file)
        found = read_lights_of(file) if time is None else self.shots[file].at(time)
        if unit == "blender":
            return tuple(blender.as_in_blender(light) for light in found.lights), default
        if unit is None and found.blender and found.lights:
            remedy = f'lights_from = {{ path = "{path}", unit = "blender" }} takes that out, unit = "khr" keeps it'
            self.notes[blender.note(file.name, found.blender, remedy)] = None
        return found.lights, default

    def _stage_lights(self, file: Path, time: float | None) -> tuple[Light, ...]:
        from mirelight.io.usd.lights import read_lights

        found = read_lights(file, time)
        self.notes |= dict.fromkeys(f"{file.name}: {note}" for note in found.notes)
        return found.lights

    def light_times(self, path: str, fps: float | None, frames: int | None) -> list[float]:
        """Moments (s) from the first key that changes a light of a file to the last one."""
        file, _ = self._scene(path)
        if file.suffix.lower() in USD:
            from mirelight.io.usd.lights import light_times as stage_times

            return stage_times(file, fps, frames)
        from mirelight.io.gltf.moving_lights import light_times

        return [float(t) for t in light_times(file, fps=fps, count=frames)]

    def scene_cameras(self, path: str) -> tuple[tuple[SceneCamera, ...], Matrix]:
        """The cameras of a glTF file or a stage ("proxy": the proxy's), and the transform that they have by default."""
        file, default = self._scene(path)
        if file.suffix.lower() in USD:
            from mirelight.io.usd.cameras import read_cameras as stage_cameras

            return stage_cameras(file), default
        from mirelight.io.gltf.scene import read_cameras

        return read_cameras(file), default

    def sampled(
        self, path: str, name: str, fps: float | None, frames: int | None, time: float | None = None
    ) -> tuple[tuple[float, SceneCamera], ...]:
        """Times (s) of an animated camera, and the camera then: at a rate, so many, or at one time."""
        file, _ = self._scene(path)
        if file.suffix.lower() in USD:
            from mirelight.io.usd.cameras import sample_cameras as sampled_stage

            return sampled_stage(file, name, fps=fps, count=frames, time=time)
        from mirelight.io.gltf.animation import sample_cameras
        from mirelight.io.gltf.scene import read_cameras

        poses = sample_cameras(file, name, fps=fps, count=frames, time=time)  # says where there is no such camera
        camera = next(x for x in read_cameras(file) if x.name == name)
        return tuple((moment, replace(camera, world=pose)) for moment, pose in poses)

    def camera_file(self, path: str) -> CameraFile:
        """A file or folder of cameras of any other format; of a folder, digests are of the files that are read."""
        from mirelight.io.cameras import open_file

        found = open_file(self.folder / path)
        if len(found.files) > 2:  # one for each picture
            self.digests[path] = digest_of_all(found.files, found.files[0].parent)
        else:
            named = {os.path.relpath(file, self.folder): file for file in found.files}
            self.digests |= {name: file_digest(file) for name, file in named.items()}
        return found

    def points(self, file: CameraFile) -> None:
        """Keep a digest of the points by which a file's cameras are moved, too."""
        if (path := file.points_file()) is not None:
            self.digests[os.path.relpath(path, self.folder)] = file_digest(path)

    def pictures(self, found: Sequence[Picture | None]) -> tuple[Deferred[F32] | None, ...]:
        """What a capture's cameras took, (H, W, 3) each; () where nothing is known. The job keeps one digest of all."""
        files = sorted({file for one in found if one is not None for file in one.files})
        if not files:
            return ()
        root = Path(os.path.commonpath([file.parent for file in files]))
        self.digests[os.path.relpath(root, self.folder)] = digest_of_all(files, root)
        return tuple(None if one is None else _picture(one) for one in found)

    def ies(self, path: str) -> IesFile:
        """A luminaire's measured light."""
        from mirelight.io.ies import read_ies

        return read_ies(self.path(path))

    def panorama(self, path: str) -> Deferred[F32]:
        """A panorama (H, W, 3), linear, read when it is first asked for."""
        file = self.path(path)
        return Deferred(
            model.digest("picture", self.digests[path]), partial(_panorama, file, self.digests[path]), keep=False
        )

    def painted(self, path: str, camera: Camera) -> Deferred[F32]:
        """(H, W) how much of each pixel is painted in a picture over a camera's frame, read when it is asked for."""
        file = self.path(path)
        return Deferred(model.digest("painted", self.digests[path]), partial(_painted, file, camera))

    def _scene(self, path: str) -> tuple[Path, Matrix]:
        if path == PROXY and self.proxy is not None:
            return self.path(self.proxy.path), placing.matrix(self.proxy.transform)
        return self.path(path), placing.matrix(Transform())


def _picture(picture: Picture) -> Deferred[F32]:
    known = [file_digest(file) for file in picture.files]
    return Deferred(
        model.digest("capture's picture", known, picture.lens, picture.distortion), picture.read, keep=False
    )


def _painted(path: Path, camera: Camera) -> F32:
    from mirelight.io.ldr import decode_with_alpha

    with open_binary(path) as stream:
        rgb, alpha = decode_with_alpha(stream, path)
    height, width = rgb.shape[:2]
    if abs(width * camera.height / (height * camera.width) - 1) > _ASPECT:
        found = f"a mask of {width} x {height} pixels for a camera of {camera.width} x {camera.height}"
        raise InputError(path, found, "paint it over one of that camera's frames")
    return np.asarray(rgb.mean(axis=2) if alpha is None else alpha, np.float32)


def _cloud(files: tuple[SplatFile, ...]) -> SplatCloud:
    from mirelight.io import splats

    clouds = []
    for file in files:
        cloud, m = splats.read(file.path, lod=file.lod), file.world_from_file
        cloud = replace(cloud, color_space=file.color_space or cloud.color_space)
        clouds.append(cloud if placing.is_identity(m) else splats.transform(cloud, m))
    return clouds[0] if len(clouds) == 1 else splats.merge(clouds)


def _mesh(path: Path, m: Matrix, albedo: list[float] | str, finish: bool) -> ProxyMesh:
    from mirelight.io import mesh

    found = mesh.read_mesh(path, textures=albedo == "file", finish=finish)
    found = found if placing.is_identity(m) else mesh.transform(found, m)
    if albedo == "gray":
        return found
    return replace(found, albedo=None if albedo == "file" else np.asarray(albedo))


@lru_cache(maxsize=2)  # neighbouring frames share theirs; a job may name hundreds
def _panorama(path: Path, sha256: str) -> F32:
    if path.suffix.lower() in USD:
        from mirelight.io.usd.lights import read_domes

        return read_domes(path)
    from mirelight.io.environment import read_environment

    return read_environment(path)
