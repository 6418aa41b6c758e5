"""What the pictures of a capture show of space: looked through, hidden behind the surface, or not in any of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirelight.base.together import each
from mirelight.lighting.sight import Sight
from mirelight.model import F32, F64, Camera
from mirelight.proxy.depth import DepthMap
from mirelight.proxy.tuning import TUNING
from mirelight.proxy.views import rays, turned

_CHUNK = 1 << 16  # points at once: what a core's cache holds

Bool = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Pictures:
    """Cameras and how far they see."""

    cameras: tuple[Camera, ...]
    depths: tuple[F32, ...]  # (H, W) each, along the view axis to the surface, world units; infinite: none

    @staticmethod
    def of(cameras: Sequence[Camera], sight: Sight, shown: Sequence[DepthMap] = ()) -> Pictures:
        """Of a surface, everything in its space.

        Args:
            cameras: those of the pictures.
            sight: into the surface.
            shown: depth maps by some of these cameras: what they see where the surface has a gap.
        """
        chosen = tuple(_small(camera) for camera in cameras[:: -(-len(cameras) // TUNING.seen_cameras)])
        found = zip(chosen, _maps_of(chosen, shown), strict=True)
        return Pictures(chosen, tuple(_without_gaps(_depth(x, sight), view) for x, view in found))

    @property
    def eyes(self) -> F64:
        """(C, 3) where the cameras stand."""
        return np.stack([camera.position for camera in self.cameras])

    def opaque(self, shown: Sequence[DepthMap]) -> Pictures:
        """The same, as if they ended where depth maps by these cameras show nothing: guessed ones may look farther up
        than any picture did."""
        found = zip(self.depths, _maps_of(self.cameras, shown), strict=True)
        return Pictures(self.cameras, tuple(_ended(depth, view) for depth, view in found))

    def states(self, points: F32, margin: float) -> tuple[Bool, Bool]:
        """(N,) whether a camera looked through a point, or has it less than `margin` behind the surface; and whether
        one has it in its picture at all, seen or hidden."""
        free, shown = np.zeros(len(points), bool), np.zeros(len(points), bool)

        def look(start: int) -> None:
            rows = np.arange(start, min(start + _CHUNK, len(points)))
            for camera, depth in zip(self.cameras, self.depths, strict=True):
                z, there = _at_pixels(camera, depth, points[rows])
                shown[rows[~np.isnan(there)]] = True
                free[rows[z < there + np.float32(margin)]] = True
                rows = rows[~free[rows]]

        each(look, range(0, len(points), _CHUNK))
        return free, shown


def _depth(camera: Camera, sight: Sight) -> F32:
    """(H, W) depths, cracks of the surface closed (a grey opening, which leaves silhouettes where they are)."""
    from scipy.ndimage import maximum_filter, minimum_filter

    origins, directions = rays(camera)
    starts = np.broadcast_to(origins, directions.shape).reshape(-1, 3)
    _, distance = sight.first_hits(starts, directions.reshape(-1, 3))
    near = minimum_filter(distance.reshape(directions.shape[:2]).astype(np.float32), TUNING.seen_crack)
    return np.asarray(maximum_filter(near, TUNING.seen_crack))


def _maps_of(cameras: Sequence[Camera], shown: Sequence[DepthMap]) -> list[DepthMap | None]:
    """For each camera the depth map from where it stands; None: there is none."""
    maps = {view.camera.world_from_camera.tobytes(): view for view in shown}
    return [maps.get(camera.world_from_camera.tobytes()) for camera in cameras]


def _ended(depth: F32, view: DepthMap | None) -> F32:
    """Depths (H, W), NaN where a depth map, of any size, shows nothing."""
    if view is None:
        return depth
    nothing = np.isinf(depth) & (_sampled(view.alpha, depth.shape) <= TUNING.depth_opaque)
    return np.where(nothing, np.float32(np.nan), depth)


def _sampled(picture: F32, shape: tuple[int, ...]) -> F32:
    """The nearest pixels of a picture (h, w), as many as the shape has."""
    rows, columns = (((np.arange(n) + 0.5) * m / n).astype(np.int64) for n, m in zip(shape, picture.shape, strict=True))
    return np.asarray(picture[np.ix_(rows, columns)])


def _without_gaps(depth: F32, view: DepthMap | None) -> F32:
    """Depths (H, W) with those of a depth map, of any size, where there are none; NaN where it is opaque and has
    none."""
    if view is None:
        return depth
    own = _sampled(view.depth, depth.shape)
    gap = np.isinf(depth) & (_sampled(view.alpha, depth.shape) > TUNING.depth_opaque)
    return np.where(gap, np.where(own > 0, own, np.float32(np.nan)), depth)


def _at_pixels(camera: Camera, depth: F32, at: F32) -> tuple[F32, F32]:
    """(M,) distance of points along the view axis, and the surface's at their pixels; NaN outside the picture."""
    matrix = camera.camera_from_world.astype(np.float32)
    own = turned(at, matrix[:3, :3]) + matrix[:3, 3]
    z = -own[:, 2]
    w = np.maximum(z, np.float32(1e-12)) if camera.projection == "perspective" else np.float32(1)
    x = np.floor(np.float32(camera.cx) + np.float32(camera.fx) * own[:, 0] / w)
    y = np.floor(np.float32(camera.cy) - np.float32(camera.fy) * own[:, 1] / w)
    inside = (z > 0) & (x >= 0) & (x < camera.width) & (y >= 0) & (y < camera.height)
    pixel = np.where(inside, y * camera.width + x, 0).astype(np.int64)
    return z, np.where(inside, depth.ravel()[pixel], np.float32(np.nan))


def _small(camera: Camera) -> Camera:
    return camera.scaled(min(TUNING.seen_pixels / max(camera.width, camera.height), 1.0))
