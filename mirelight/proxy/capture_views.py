"""The splats as the cameras of their capture see them: what was photographed, where single splats do not tell it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mirelight.model import Camera, SplatCloud, SplatLayer, Variant
from mirelight.model.scene import SOLID
from mirelight.proxy.capture import SURFEL

MOST_VIEWS = 64  # of the cameras, evenly taken
MOST_PIXELS = 320 * 216  # of each view
_SAMPLE = 20_000  # splats that tell their kind


def are_discs(splats: SplatCloud) -> bool:
    """Whether splats lie on the surface as thin discs, each with the surface's own colour."""
    solid = np.flatnonzero(splats.opacities >= SOLID)
    shape = np.sort(splats.scales[solid[:: max(len(solid) // _SAMPLE, 1)]].astype(np.float64), axis=1)
    return bool(np.median(shape[:, 0] / np.maximum(shape[:, 1], 1e-30)) < SURFEL) if len(shape) else True


def capture_views(
    splats: SplatCloud, cameras: Sequence[Camera], variant: Variant = "llvm_ad_rgb", threads: int | None = None
) -> tuple[SplatLayer, ...]:
    """Composites at the cameras of the capture, none of discs.

    Args:
        splats: world space.
        cameras: of the pictures that the splats were made from.
        variant: where they are composited.
        threads: worker threads, process-wide; None: as they are.
    """
    if not cameras or are_discs(splats):
        return ()
    from mirelight.compositor import Compositor

    compositor = Compositor(splats, variant=variant, threads=threads)
    step = -(-len(cameras) // MOST_VIEWS)
    return tuple(compositor.composite(_small(camera)) for camera in cameras[::step])


def _small(camera: Camera) -> Camera:
    scale = min((MOST_PIXELS / (camera.width * camera.height)) ** 0.5, 1.0)
    return camera.resized(max(round(camera.width * scale), 1), max(round(camera.height * scale), 1))
