"""From the blended tiles to the SplatLayer."""

from __future__ import annotations

import numpy as np

from mirelight.compositor.blend import Frame
from mirelight.model import F32, Camera, CompositorSettings, SplatLayer


def _cropped(image: F32, camera: Camera) -> F32:
    """The camera's part of an image made of whole tiles; no copy where they agree."""
    return np.ascontiguousarray(image[: camera.height, : camera.width])


def layer_of(frame: Frame, camera: Camera, settings: CompositorSettings) -> SplatLayer:
    """The frame as NumPy arrays; mean depth divided by what was blended."""
    size = (frame.height, frame.width)
    transmittance = _cropped(frame.transmittance.numpy().reshape(size), camera)
    if frame.depth is None or frame.median is None:
        mean = median = np.zeros_like(transmittance)
    else:
        covered = 1 - transmittance
        total = _cropped(frame.depth.numpy().reshape(size), camera)
        mean = np.divide(total, covered, out=np.zeros_like(total), where=covered > 0)
        median = _cropped(frame.median.numpy().reshape(size), camera)
    return SplatLayer(
        camera=camera,
        color=_cropped(frame.color.numpy().reshape(*size, 3), camera),
        transmittance=transmittance,
        depth=mean,
        median_depth=median,
        profile=settings.profile,
        linear=settings.linear and settings.profile == "playcanvas",
    )


def values_of(frame: Frame, camera: Camera) -> F32:
    """(H, W, C) of the other per-splat values."""
    assert frame.values is not None
    return _cropped(frame.values.numpy().reshape(frame.height, frame.width, frame.channels), camera)
