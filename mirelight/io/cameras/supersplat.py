"""SuperSplat's projects (.ssproj): the keys of its camera, or what it films between them.

A ZIP file whose document.json holds `poseSets[0].poses[]` {name, frame, position, target, fov} and `timeline` {frames,
frameRate, smoothness, loop}. `fov` is the angle over the picture's longer side, in degrees; +Y is up, there is no roll.
SuperSplat shows a PLY turned by 180 degrees about Z: cameras are turned back into the PLY's axes. A capture that was
moved in SuperSplat fits once it is exported. Read from SuperSplat 2.32 (camera-poses.ts, anim/spline.ts, camera.ts).
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np

from mirelight.base import conventions
from mirelight.base.errors import InputError
from mirelight.io.cameras import reading, spline
from mirelight.io.cameras.placed import Angle, FileCamera
from mirelight.io.gltf.fields import Fields
from mirelight.io.splats.archive import ZipFiles
from mirelight.model import F64

_LARGEST_DOCUMENT = 1 << 24  # bytes
_PLY_FROM_WORLD = np.diag([-1.0, -1.0, 1.0, 1.0])
_FOV = 60.0  # degrees, where the document does not say


def read(path: Path, fps: float | None = None, frames: int | None = None) -> tuple[FileCamera, ...]:
    """The keys in the order of time; or with `fps` or `frames`, pictures along the timeline.

    Args:
        path: a .ssproj file.
        fps: pictures in each second of the timeline.
        frames: pictures over the whole timeline, at equal steps; as many as the timeline has are SuperSplat's own.

    Raises:
        InputError: damaged, or without keys.
    """
    raw = reading.load_json(path, ZipFiles(path).load("document.json", _LARGEST_DOCUMENT, ""))
    if not isinstance(raw, dict):
        raise InputError(path, "the JSON is not an object", field="document.json")
    top = Fields(path, "", raw)
    sets = top.children("poseSets")
    if not sets or not sets[0].values.get("poses"):
        raise InputError(path, "the project has no camera keys", "set keys on SuperSplat's timeline", field="poseSets")
    line = top.child("timeline")
    rate = line.number("frameRate", 30.0)
    keys = reading.objects(path, "poseSets[0].poses", sets[0].values["poses"])
    fov = top.child("camera").number("fov", _FOV)
    times = np.array([key.number("frame", i * rate) for i, key in enumerate(keys)])
    points = np.array([[*x.vector("position", 3), *x.vector("target", 3), x.number("fov", fov)] for x in keys])
    order = np.argsort(times, kind="stable")
    if fps is None and frames is None:
        names = reading.picture_names(keys[i].text("name", "camera") for i in order)
        return tuple(_camera(path, name, points[i]) for name, i in zip(names, order, strict=True))
    length = line.number("frames", 180.0)
    if not (1 <= length <= 1e7 and 1e-3 <= rate <= 1e5):
        raise line.fail("frames", f"{length:g} frames at {rate:g} a second", "the project is damaged")
    if frames is None:
        assert fps is not None
        frames = max(1, round(length / rate * fps))
    reading.limited(path, frames)
    at = np.arange(frames, dtype=np.float64) * (length / frames if fps is None else rate / fps)
    order = order[times[order] < length]
    if not len(order):
        raise InputError(path, "every camera key lies beyond the timeline's end", "make the timeline longer")
    smoothness = line.number("smoothness", 1.0)
    looping = line.values.get("loop", True) is not False
    flown = _flown(path, length, times[order], points[order], smoothness, looping, at)
    return tuple(_camera(path, f"camera.{n:04d}", point) for n, point in enumerate(flown, start=1))


def _flown(path: Path, length: float, times: F64, points: F64, smoothness: float, looping: bool, at: F64) -> F64:
    if len(times) == 1:
        return np.repeat(points, len(at), axis=0)
    if looping:
        times, points = spline.looped(length, times, points)
    if np.any(np.diff(times) <= 0):
        raise InputError(
            path, "two camera keys at the same frame", "move or delete one in SuperSplat", field="poseSets"
        )
    return spline.evaluate(times, points, smoothness, at)


def _camera(path: Path, name: str, values: F64) -> FileCamera:
    fail = partial(InputError, path, field=f"camera {name!r}")
    position, target, fov = values[:3], values[3:6], float(values[6])
    if not np.all(np.abs(values) <= 1e9):
        raise fail("a position beyond all scenes", "the project is damaged")
    if np.linalg.norm(target - position) < 1e-9:
        raise fail("a camera that looks at its own position", "the project is damaged")
    pose = _PLY_FROM_WORLD @ conventions.look_at(position, target)
    return FileCamera(
        name=name,
        world_from_camera=pose,
        lens=Angle(degrees=reading.field_of_view(fov, fail), side="longer"),
    )
