"""Cameras of a stage, in its world: metres, Y up."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mirelight.base import conventions
from mirelight.base.conventions import Matrix
from mirelight.base.errors import InputError
from mirelight.io.gltf.names import unique_names
from mirelight.io.usd.process import ask
from mirelight.io.usd.rows import CameraRow, Request
from mirelight.model import Camera, Exposure

_MOST_MOMENTS = 100_000


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class UsdCamera:
    """A camera as the stage has it, placed; a job adds the image size."""

    name: str
    world: Matrix  # (4, 4) world_from_camera, with whatever scale the hierarchy has
    row: CameraRow

    @property
    def aspect(self) -> float:
        """Width / height of its aperture."""
        return self.row.apertures[0] / self.row.apertures[1]

    @property
    def shutter(self) -> tuple[float, float]:
        """Seconds after a frame's moment that it opens and closes."""
        return self.row.shutter[0], self.row.shutter[1]

    def to_camera(self, width: int, height: int, world: Matrix | None = None) -> Camera:
        """The camera on a pixel grid: what is seen from top to bottom stays, and pixels are square; offsets of the
        aperture move the picture's centre.

        Args:
            width: px.
            height: px.
            world: another pose (4, 4).
        """
        row = self.row
        scale = height / row.apertures[1]  # px a tenth of a unit on the film
        focal = scale / row.unit if row.orthographic else scale * row.focal
        placed = self.world if world is None else world
        size = np.cbrt(abs(np.linalg.det(placed[:3, :3]) / np.linalg.det(self.world[:3, :3])))
        lens = row.aperture_radius * size, row.focus_distance * size
        return Camera(
            name=self.name,
            world_from_camera=_rigid(placed),
            width=width,
            height=height,
            fx=focal,
            fy=focal,
            cx=width / 2 - row.offsets[0] * scale,
            cy=height / 2 + row.offsets[1] * scale,
            projection="orthographic" if row.orthographic else "perspective",
            near=max(row.clipping[0], 1e-6),
            far=row.clipping[1],
            exposure=Exposure(aperture_radius=lens[0], focus_distance=lens[1]) if lens[0] > 0 else None,
        )


def _rigid(pose: Matrix) -> Matrix:
    """The pose without scale; one that has none stays, bit for bit."""
    turn = pose[:3, :3]
    is_rigid = np.allclose(turn @ turn.T, np.eye(3), rtol=0, atol=1e-14) and np.linalg.det(turn) > 0
    return pose if is_rigid else conventions.rigid_part(pose)


def read_cameras(path: str | Path) -> tuple[UsdCamera, ...]:
    """The cameras of a stage. Raises InputError."""
    with ask(path, Request(path=str(path), part="cameras")) as read:
        return _cameras(Path(path), read.answer.cameras)


def sample_cameras(
    path: str | Path, name: str, *, fps: float | None = None, count: int | None = None, time: float | None = None
) -> tuple[tuple[float, UsdCamera], ...]:
    """An animated camera, lens and place, from the stage's first time code to its last (or from key to key).

    Args:
        path: the stage.
        name: which camera.
        fps: pictures a second, or
        count: so many pictures, or
        time: one, at that moment (s).

    Returns:
        (time in s, the camera then) each.

    Raises:
        InputError: no such camera, or nothing moves.
    """
    with ask(path, Request(path=str(path), part="cameras")) as read:
        ends, whole = read.answer.times, _cameras(Path(path), read.answer.cameras)
    names = [camera.name for camera in whole]
    if name not in names:
        raise InputError(path, f"no camera {name!r}", f"its cameras: {', '.join(names) or 'none'}")
    if not ends:
        raise InputError(path, f"nothing moves the camera {name!r}", "leave fps and frames out, or animate it")
    times = moments(path, ends, fps, count) if time is None else [time]
    with ask(path, Request(path=str(path), part="cameras", times=times)) as read:
        rows = read.answer.cameras[names.index(name) :: len(names)]
        return tuple((moment, _camera(Path(path), row, name)) for moment, row in zip(times, rows, strict=True))


def moments(path: str | Path, ends: list[float], fps: float | None, count: int | None) -> list[float]:
    """Times (s) from a first to a last one. Raises InputError: too many."""
    first, last = ends
    most = count if count is not None else 1 + (last - first) * (fps or 24.0)
    if not most <= _MOST_MOMENTS:
        raise InputError(path, f"{most:,.0f} moments", f"at most {_MOST_MOMENTS:,} are taken")
    if count is not None:
        return [float(x) for x in np.linspace(first, last, count)]
    steps = int(np.floor((last - first) * (fps or 24.0) + 1e-6)) + 1
    return [float(first + k / (fps or 24.0)) for k in range(steps)]


def _cameras(path: Path, rows: list[CameraRow]) -> tuple[UsdCamera, ...]:
    names = unique_names([(row.name, row.prim, "camera") for row in rows])
    return tuple(_camera(path, row, name) for row, name in zip(rows, names, strict=True))


def _camera(path: Path, row: CameraRow, name: str) -> UsdCamera:
    lens = row.focal, row.aperture_radius, row.focus_distance
    numbers = [*row.apertures, *row.offsets, *lens, *row.shutter, *row.clipping]
    if not np.isfinite(numbers[:-1]).all() or min(row.apertures) <= 0 or (row.focal <= 0 and not row.orthographic):
        found = f"a lens of focal length {row.focal:g} and apertures {row.apertures[0]:g}, {row.apertures[1]:g}"
        raise InputError(path, found, "give positive lengths", field=row.prim)
    if not row.clipping[1] > max(row.clipping[0], 1e-6):
        found = f"clippingRange {row.clipping[0]:g} to {row.clipping[1]:g} (m)"
        raise InputError(path, found, "the second must be above the first", field=row.prim)
    world = np.array(row.world)
    try:
        conventions.rigid_part(world)
    except ValueError:
        raise InputError(path, "a camera that is scaled to zero", "give it a scale", field=row.prim) from None
    return UsdCamera(name=name, world=world, row=row)
