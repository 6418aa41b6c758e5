"""Tables of cameras as the model's cameras, and a camera for jobs that name none."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol

import numpy as np

from mirelight import conventions
from mirelight.conventions import Matrix
from mirelight.io.job.camera_tables import (
    AnyCamera,
    CamerasFromTable,
    CameraTable,
    OrthographicTable,
    PerspectiveTable,
    PosedCamera,
    TurntableTable,
)
from mirelight.io.job.lighting import FreeNames, choose
from mirelight.io.job.mistakes import Mistake
from mirelight.io.job.placing import matrix
from mirelight.io.job.positions import Path
from mirelight.model import Camera, ProxyMesh, SplatCloud

if TYPE_CHECKING:
    from mirelight.io.gltf.cameras import GltfCamera

_YFOV = 45.0  # degrees
_VIEW = (0.45, 0.35, 1.0)  # where the camera that sees all stands, from the middle of the scene
_STRAYS = 1.0  # percent of splats at each end of each axis that do not count for the scene's size
_MOST_SAMPLES = 500_000  # splats looked at for that


class CameraFiles(Protocol):
    """Reads the cameras that a job names."""

    def gltf_cameras(self, path: str) -> tuple[tuple[GltfCamera, ...], Matrix]:
        """The cameras of a glTF file ("proxy": the proxy's), and the transform that they have by default."""

    def sampled(self, path: str, name: str, fps: float | None, frames: int | None) -> tuple[Matrix, ...]:
        """Poses (4, 4) of an animated camera."""


@dataclass(frozen=True, slots=True, eq=False)
class Extent:
    """The sphere that holds what is to be seen."""

    center: Matrix  # (3,)
    radius: float

    def distance(self, yfov: float, width: int, height: int) -> float:
        """How far a camera must be to have all of it in view."""
        half = math.radians(yfov) / 2
        across = math.atan(math.tan(half) * width / height)
        return self.radius / math.sin(min(half, across))


def extent(splats: SplatCloud | None, proxy: ProxyMesh | None) -> Extent:
    """Where the scene is; strays among the splats do not count."""
    low, high = np.zeros(3), np.ones(3)
    if splats is not None and len(splats):
        means = splats.means[:: max(1, len(splats) // _MOST_SAMPLES)]
        low, high = np.percentile(means, (_STRAYS, 100 - _STRAYS), axis=0)
    elif proxy is not None and len(proxy.vertices):
        low, high = (np.asarray(corner, dtype=np.float64) for corner in proxy.bounds)
    return Extent((low + high) / 2, max(float(np.linalg.norm(high - low)) / 2, 1e-6))


def cameras(tables: list[AnyCamera], resolution: tuple[int, int], scene: Extent) -> list[Camera]:
    """The cameras that stand in the job file; a turntable gives one for each of its frames."""
    out: list[Camera] = []
    names = FreeNames(x.name for x in tables if x.name)
    for table in tables:
        name = table.name or names.take("camera")
        size = table.width or resolution[0], table.height or resolution[1]
        if isinstance(table, TurntableTable):
            out += _turntable(table, name, size, scene)
        else:
            out.append(_camera(table, name, size))
    return out


def frame_name(name: str, frame: int) -> str:
    """One frame of a sequence, counted from 1: orbit.0001."""
    return f"{name}.{frame:04d}"


def cameras_from(
    table: CamerasFromTable, at: Path, resolution: tuple[int, int], files: CameraFiles, wrong: list[Mistake]
) -> list[Camera]:
    """Cameras of a glTF file; what is wrong is added to `wrong`."""
    found, default = files.gltf_cameras(table.path)
    m = matrix(table.transform) if table.transform else default
    out: list[Camera] = []
    for i in choose([x.name for x in found], table.names, at, "camera", table.path, wrong):
        if table.fps is None and table.frames is None:
            out.append(found[i].to_camera(*resolution, m @ found[i].world))
            continue
        poses = files.sampled(table.path, found[i].name, table.fps, table.frames)
        still = [found[i].to_camera(*resolution, m @ pose) for pose in poses]
        out += [replace(x, name=frame_name(x.name, n)) for n, x in enumerate(still, start=1)]
    return out


def uniquely_named(found: list[Camera]) -> tuple[Camera, ...]:
    """The cameras with a number on names that are taken."""
    names = FreeNames()
    return tuple(x if (name := names.take(x.name)) == x.name else replace(x, name=name) for x in found)


def seeing_all(scene: Extent, resolution: tuple[int, int]) -> Camera:
    """A camera that has the whole scene in view."""
    distance = scene.distance(_YFOV, *resolution)
    position = scene.center + distance * conventions.unit(_VIEW)
    return Camera.look_at(position, scene.center, *resolution, yfov=_YFOV, near=distance / 1000)


def scaled(camera: Camera, factor: float) -> Camera:
    """The camera with its image scaled; at least one pixel is left."""
    if factor == 1:
        return camera
    return camera.resized(max(1, round(camera.width * factor)), max(1, round(camera.height * factor)))


def _camera(table: PerspectiveTable | OrthographicTable, name: str, size: tuple[int, int]) -> Camera:
    width, height = size
    cx, cy = width / 2, height / 2
    if isinstance(table, OrthographicTable):
        fx = fy = height / (2 * table.ymag)
    else:
        fx = table.fx or height / (2 * math.tan(math.radians(table.yfov or _YFOV) / 2))
        fy = table.fy or fx
        cx = cx if table.cx is None else table.cx
        cy = cy if table.cy is None else table.cy
    return Camera(
        name=name,
        world_from_camera=_pose(table),
        width=width,
        height=height,
        fx=fx,
        fy=fy,
        cx=cx,
        cy=cy,
        projection=table.type,
        near=table.near,
        far=_far(table),
    )


def _pose(table: PosedCamera) -> Matrix:
    if table.matrix is not None:
        return conventions.rigid_part(table.matrix)
    assert table.position is not None and table.target is not None
    return conventions.look_at(table.position, table.target, table.up or (0.0, 1.0, 0.0))


def _far(table: CameraTable) -> float:
    return table.far or math.inf


def _turntable(table: TurntableTable, name: str, size: tuple[int, int], scene: Extent) -> list[Camera]:
    target = scene.center if table.target is None else np.asarray(table.target)
    away = scene.distance(table.yfov, *size)
    radius = table.radius or math.sqrt(max(away**2 - table.elevation**2, (0.1 * away) ** 2))
    out = []
    for frame in range(table.frames):
        angle = math.radians(table.start) + 2 * math.pi * frame / table.frames
        position = target + np.array([radius * math.sin(angle), table.elevation, radius * math.cos(angle)])
        out.append(
            Camera.look_at(
                position,
                target,
                *size,
                yfov=table.yfov,
                name=frame_name(name, frame + 1),
                near=table.near,
                far=_far(table),
            )
        )
    return out
