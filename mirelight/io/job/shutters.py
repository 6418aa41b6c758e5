"""Cameras whose shutter is open for a while: where each stands meanwhile, told from the frames beside it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mirelight.base import conventions
from mirelight.model import F64, Camera, Exposure

MOMENTS = 5  # at which an open shutter knows its place


def open_between(cameras: Sequence[Camera], opens: float, closes: float) -> list[Camera]:
    """The frames of one camera, in order, with an open shutter; themselves where it is not open or there is but one.

    Args:
        cameras: its frames at equal steps of time.
        opens: frames after its own that each opens, perhaps below 0.
        closes: frames after its own that each closes.
    """
    if len(cameras) < 2 or closes <= opens:
        return list(cameras)
    poses = np.stack([x.world_from_camera for x in cameras])
    steps = np.linspace(opens, closes, MOMENTS)
    return [
        opened(camera, [conventions.pose_at(poses, k + step) for step in steps], _seconds(cameras, opens, closes))
        for k, camera in enumerate(cameras)
    ]


def on_path(cameras: Sequence[Camera], shutter: float | None, every: int = 1) -> list[Camera]:
    """The cameras of a table as frames of a path by which things move, open for as long as their shutter is.

    Args:
        cameras: in order; every so many of the path's, from the first on.
        shutter: share of the time from frame to frame; None: as their file says.
        every: see there.
    """
    out = []
    for k, camera in enumerate(cameras):
        open_for = (-shutter / 2, shutter / 2) if shutter else _frames(camera, cameras, every)
        exposure = camera.exposure
        if open_for is not None:
            exposure = replace(exposure or Exposure(), frames=open_for)
        out.append(replace(camera, frame=1.0 + k * every, exposure=exposure))
    return out


def _frames(camera: Camera, cameras: Sequence[Camera], every: int) -> tuple[float, float] | None:
    """When a camera's own shutter opens and closes, in frames; None where it has none."""
    seconds = None if camera.exposure is None else camera.exposure.shutter
    times = [x.time for x in cameras[:2]]
    if seconds is None or len(times) < 2 or times[0] is None or times[1] is None:
        return None
    step = (times[1] - times[0]) / every
    return seconds[0] / step, seconds[1] / step


def opened(camera: Camera, poses: Sequence[F64], seconds: tuple[float, float] | None = None) -> Camera:
    """A camera that takes poses (4, 4) at equal steps while its shutter is open, which is `seconds` after its time."""
    if all(np.array_equal(x, poses[0]) for x in poses):
        return camera
    return replace(camera, exposure=replace(camera.exposure or Exposure(), poses=np.stack(poses), shutter=seconds))


def _seconds(cameras: Sequence[Camera], opens: float, closes: float) -> tuple[float, float] | None:
    first, second = cameras[0].time, cameras[1].time
    return None if first is None or second is None else (opens * (second - first), closes * (second - first))
