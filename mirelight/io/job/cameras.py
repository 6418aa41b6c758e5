"""Tables of cameras as the model's cameras, and a camera for jobs that name none."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from mirelight.base import conventions
from mirelight.base.conventions import Matrix
from mirelight.base.names import FreeNames
from mirelight.io.job import sampling
from mirelight.io.job.assets import Assets
from mirelight.io.job.camera_file_tables import SENSOR_WIDTH, ShutterTable
from mirelight.io.job.camera_files import FromFiles, frame_name
from mirelight.io.job.camera_tables import (
    YFOV,
    AnyCamera,
    AroundTable,
    CameraTable,
    DomeTable,
    LensTable,
    OrbitTable,
    OrthographicTable,
    PerspectiveTable,
    PosedCamera,
    RandomTable,
    SphereTable,
    TurntableTable,
)
from mirelight.io.job.fields import PROXY
from mirelight.io.job.mistakes import Mistake
from mirelight.io.job.positions import Path
from mirelight.io.job.sampling import Stand
from mirelight.io.job.shutters import MOMENTS, on_path, opened
from mirelight.io.job.tables import JobTable
from mirelight.io.suffixes import SCENES
from mirelight.model import Camera, Deferred, ProxyMesh, SplatCloud
from mirelight.model.camera_checks import Judge, is_room

_VIEW = (0.45, 0.35, 1.0)  # where the camera that sees all stands, from the middle of the scene
_STRAYS = 1.0  # percent of splats at each end of each axis that do not count for the scene's size
_MOST_SAMPLES = 500_000  # splats looked at for that
_FIRST = 8  # random cameras that tell whether the mesh is a room
_MOST_DRAWS = 20  # of one random camera


class Extent:
    """The sphere that holds what is to be seen; strays among the splats do not count. Reads files when it is asked.

    Args:
        splats: the job's.
        proxy: the job's.
        there: the proxy is a file, so that cameras may be held against it.
    """

    def __init__(
        self, splats: Deferred[SplatCloud] | None, proxy: Deferred[ProxyMesh] | None, there: bool = True
    ) -> None:
        self._splats, self._proxy, self._there = splats, proxy, there

    @cached_property
    def judge(self) -> Judge | None:
        """Says whether cameras are of use; None without a mesh."""
        mesh = self._mesh
        return Judge(mesh) if mesh is not None and len(mesh.faces) else None

    @property
    def _mesh(self) -> ProxyMesh | None:
        return self._proxy.value if self._proxy is not None and self._there else None

    @cached_property
    def _corners(self) -> tuple[Matrix, Matrix]:
        splats = None if self._splats is None else self._splats.value
        if splats is not None and len(splats):
            means = splats.means[:: max(1, len(splats) // _MOST_SAMPLES)]
            low, high = np.percentile(means, (_STRAYS, 100 - _STRAYS), axis=0)
            return low, high
        proxy = self._mesh
        if proxy is not None and len(proxy.vertices):
            low, high = (np.asarray(corner, dtype=np.float64) for corner in proxy.bounds)
            return low, high
        return np.zeros(3), np.ones(3)

    @property
    def low(self) -> Matrix:
        """(3,) lowest corner, world units."""
        return self._corners[0]

    @property
    def high(self) -> Matrix:
        """(3,) highest corner, world units."""
        return self._corners[1]

    @property
    def center(self) -> Matrix:
        """(3,) middle of the scene, in world units."""
        return np.asarray((self.low + self.high) / 2)

    @property
    def radius(self) -> float:
        """How far the scene reaches from its middle, in world units, above 0."""
        return max(float(np.linalg.norm(self.high - self.low)) / 2, 1e-6)

    def distance(self, yfov: float, width: int, height: int) -> float:
        """How far a camera must be to have all of it in view; `yfov` in degrees."""
        half = math.radians(yfov) / 2
        across = math.atan(math.tan(half) * width / height)
        return self.radius / math.sin(min(half, across))


def of_job(table: JobTable, files: Assets, scene: Extent, wrong: list[Mistake]) -> tuple[Camera, ...]:
    """All cameras of a job, all names different; what is wrong is added to `wrong`.

    A job that names none has those of the proxy's file (glTF, OpenUSD), else one that sees everything.
    """
    resolution = table.resolution[0], table.resolution[1]
    from_files = FromFiles(resolution, table.splats or [], files, wrong)
    captured: list[Camera] = []
    moves = any(x.keys for x in table.objects)
    for i, one in enumerate(table.cameras_from):
        own = from_files.cameras(one, ("cameras_from", i))
        captured += on_path(own, one.shutter, one.every) if moves else own
    around = _Around(captured, from_files)
    found = _inline(table.cameras, resolution, scene, around, moves=moves) + captured
    if not table.cameras and not table.cameras_from:
        if table.proxy is not None and table.proxy.path.lower().endswith(SCENES):
            placed, m = files.scene_cameras(PROXY)
            found = [camera.to_camera(*resolution, m @ camera.world) for camera in placed]
        found = found or [_seeing_all(scene, resolution)]
    _check_frames(table, found, wrong)
    names = FreeNames()
    found = [camera.scaled(table.resolution_scale) for camera in found]
    return tuple(x if (name := names.take(x.name)) == x.name else replace(x, name=name) for x in found)


def _check_frames(table: JobTable, cameras: list[Camera], wrong: list[Mistake]) -> None:
    """What frames of things that move need, and cameras that stand still do not."""
    moving = next((i for i, x in enumerate(table.objects) if x.keys), None)
    if moving is not None and cameras and not any((x.frame or 0) > 1 for x in cameras):
        remedy = "give one frames = 48, or take an orbit or an animated file"
        wrong.append(Mistake(("objects", moving, "keys"), "keys, and cameras of one picture each", remedy))
    for i, one in enumerate(table.cameras):
        if isinstance(one, PerspectiveTable) and moving is None:
            for name in ("frames", "shutter"):
                if name in one.model_fields_set:
                    found = f"{name} of a camera that stands still, and nothing moves"
                    wrong.append(Mistake(("cameras", i, name), found, "leave it out, or give an object keys"))


def _seeing_all(scene: Extent, resolution: tuple[int, int]) -> Camera:
    distance = scene.distance(YFOV, *resolution)
    position = scene.center + distance * conventions.unit(_VIEW)
    return Camera.look_at(position, scene.center, *resolution, yfov=YFOV, near=distance / 1000)


def _inline(
    tables: list[AnyCamera], resolution: tuple[int, int], scene: Extent, around: _Around, *, moves: bool
) -> list[Camera]:
    """The cameras that stand in the job file; an orbit gives one for each of its frames, by which things may move."""
    out: list[Camera] = []
    names = FreeNames(x.name for x in tables if x.name)
    for i, table in enumerate(tables):
        name = table.name or names.take("camera")
        size = table.width or resolution[0], table.height or resolution[1]
        match table:
            case PerspectiveTable() | OrthographicTable():
                own = _repeated(table, _camera(table, name, size))
            case AroundTable():
                own = _standing(table, name, size, around.stands(table, ("cameras", i)))
            case RandomTable():
                own = _scattered(table, name, size, scene)
            case TurntableTable() | OrbitTable():
                own = _turning(table, name, size, scene)
            case _:
                own = _standing(table, name, size, _stands(table, size, scene))
        out += on_path(own, table.shutter if isinstance(table, ShutterTable) else None) if moves else own
    return out


def _repeated(table: PerspectiveTable | OrthographicTable, camera: Camera) -> list[Camera]:
    """The pictures from one place; itself where it is one."""
    count = table.frames if isinstance(table, PerspectiveTable) else 1
    return [camera] if count == 1 else [replace(camera, name=frame_name(camera.name, k + 1)) for k in range(count)]


def _turning(table: TurntableTable | OrbitTable, name: str, size: tuple[int, int], scene: Extent) -> list[Camera]:
    """The frames of a circle; while a shutter is open, the camera goes on along it."""
    found = _standing(table, name, size, _stands(table, size, scene))
    if not table.shutter:
        return found
    turns = np.linspace(-0.5, 0.5, MOMENTS) * table.shutter * 360 / table.frames
    moments = [
        _standing(table, name, size, _stands(table.model_copy(update={"start": table.start + turn}), size, scene))
        for turn in turns
    ]
    return [opened(x, [one[k].world_from_camera for one in moments]) for k, x in enumerate(found)]


def _camera(table: PerspectiveTable | OrthographicTable, name: str, size: tuple[int, int]) -> Camera:
    width, height = size
    cx, cy = width / 2, height / 2
    if isinstance(table, OrthographicTable):
        fx = fy = height / (2 * table.ymag)
    else:
        fx = table.fx or table.focal(width, height)
        fy = table.fy or fx
        cx = cx if table.cx is None else table.cx
        cy = cy if table.cy is None else table.cy
    camera = Camera(
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
    if isinstance(table, OrthographicTable):
        return camera
    away = None if table.target is None else math.dist(table.position or (), table.target)
    return table.exposed(camera, away, table.sensor_width or SENSOR_WIDTH)


def _pose(table: PosedCamera) -> Matrix:
    if table.matrix is not None:
        return conventions.rigid_part(table.matrix)
    assert table.position is not None and table.target is not None
    return conventions.look_at(table.position, table.target, table.up or (0.0, 1.0, 0.0))


def _far(table: CameraTable) -> float:
    return table.far or math.inf


# --- many cameras from one table --------------------------------------------------------------------------------------


def _stands(
    table: TurntableTable | OrbitTable | SphereTable | DomeTable, size: tuple[int, int], scene: Extent
) -> Iterable[Stand]:
    target = scene.center if table.target is None else np.asarray(table.target)
    yfov = 2 * math.degrees(math.atan(size[1] / 2 / table.focal(*size)))
    away = scene.distance(yfov, *size)
    match table:
        case TurntableTable():
            flat = table.radius or math.sqrt(max(away**2 - table.elevation**2, (0.1 * away) ** 2))
            slope = math.degrees(math.atan2(table.elevation, flat))
            return sampling.orbit(target, math.hypot(flat, table.elevation), slope, table.start, table.frames)
        case OrbitTable():
            return sampling.orbit(target, table.radius or away, table.elevation, table.start, table.frames)
        case SphereTable():
            return sampling.band(target, table.radius or away, -90, 90, table.seed, table.count)
        case DomeTable():
            low, high = table.elevation
            return sampling.band(target, table.radius or away, low, high, table.seed, table.count)


def _scattered(table: RandomTable, name: str, size: tuple[int, int], scene: Extent) -> list[Camera]:
    """Random cameras, each drawn until it stands outside the mesh and sees some of it. Where no draw does, the first
    one stays, for the render to say so."""
    target = scene.center if table.target is None and table.target_bounds is None else np.asarray(table.target)
    bounds, targets = table.bounds or (scene.low, scene.high), table.target_bounds or (target, target)

    def drawn(number: int, again: int = 0) -> Camera:
        stand = sampling.scattered(bounds, targets, table.seed, number, again)
        return _standing(table, name, size, [stand], number + 1)[0]

    judge = scene.judge
    if judge is None:
        return [drawn(number) for number in range(table.count)]
    judge.room = is_room([judge.inside(drawn(number)) for number in range(_FIRST)])  # whatever the count is
    out = []
    for number in range(table.count):
        draws = (drawn(number, again) for again in range(_MOST_DRAWS))
        out.append(next((camera for camera in draws if judge.approves(camera)), None) or drawn(number))
    return out


def _standing(
    table: LensTable, name: str, size: tuple[int, int], stands: Iterable[Stand], first: int = 1
) -> list[Camera]:
    out = []
    for number, stand in enumerate(stands, start=first):
        f = table.focal(*size, *([stand.yfov] if stand.yfov else []))
        camera = Camera(
            name=frame_name(name, number),
            world_from_camera=conventions.look_at(stand.position, stand.target),
            width=size[0],
            height=size[1],
            fx=f,
            fy=f,
            cx=size[0] / 2,
            cy=size[1] / 2,
            near=table.near,
            far=_far(table),
        )
        away = float(np.linalg.norm(stand.target - stand.position))
        out.append(table.exposed(camera, away, table.sensor_width or SENSOR_WIDTH))
    return out


@dataclass(frozen=True, slots=True, eq=False)
class _Around:
    """Places cameras around a capture."""

    captured: Sequence[Camera]  # of cameras_from
    files: FromFiles

    def stands(self, table: AroundTable, at: Path) -> Iterable[Stand]:
        """The places; none, and a mistake, where the capture has no cameras or no middle."""
        captured, wrong = self.captured, self.files.wrong
        if table.capture is not None:
            captured = self.files.cameras(table.capture, (*at, "capture"))
        captured = [camera for camera in captured if camera.projection == "perspective"]
        if not captured:
            if table.capture is None:
                remedy = 'add capture = "sparse/0", or another file of the capture\'s cameras, or cameras_from'
                wrong.append(Mistake(at, "no cameras of the capture to stand around", remedy))
            return ()
        target = sampling.focus(captured) if table.target is None else np.asarray(table.target, dtype=np.float64)
        if target is None:
            found = "the capture's cameras do not look at one place"
            wrong.append(Mistake(at, found, "add target = [x, y, z]"))
            return ()
        apart = [camera for camera in captured if np.linalg.norm(camera.position - target) > 1e-9]
        if not apart:
            wrong.append(Mistake((*at, "target"), "the only captured camera's own position", "give another point"))
            return ()
        return sampling.around(apart, target, table.seed, table.count)
