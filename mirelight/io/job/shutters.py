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


def opened(camera: Camera, poses: Sequence[F64], seconds: tuple[float, float] | None = None) -> Camera:
    """A camera that takes poses (4, 4) at equal steps while its shutter is open, which is `seconds` after its time."""
    if all(np.array_equal(x, poses[0]) for x in poses):
        return camera
    return replace(camera, exposure=replace(camera.exposure or Exposure(), poses=np.stack(poses), shutter=seconds))


def _seconds(cameras: Sequence[Camera], opens: float, closes: float) -> tuple[float, float] | None:
    first, second = cameras[0].time, cameras[1].time
    return None if first is None or second is None else (opens * (second - first), closes * (second - first))
