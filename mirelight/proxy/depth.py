"""Where the surface is in a view of splats: depth and normal of each pixel, by blending the splats' planes of peak."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mirelight.compositor import Compositor
from mirelight.model import F32, F64, Camera
from mirelight.proxy.axes import axes_of
from mirelight.proxy.capture import Capture
from mirelight.proxy.types import ProxySettings
from mirelight.proxy.views import rays, turned

OPAQUE = 0.5  # alpha from which a pixel shows a surface
SHARPER = 3  # layers of a splat that stand for it
GATE = 0.06  # of the capture's radius: how far depth may lie from where alpha passes one half, else it is a mixture
_THINNEST = 1e-3  # of the longest axis: flatter splats are taken as that flat, which their plane does not notice
_BEHIND = 1e-6
_FAR = 0.01  # of the capture's radius: how far behind the surface a splat is hidden, besides twice its own size


@dataclass(frozen=True, slots=True, eq=False)
class DepthMap:
    """One view. Pixels without a surface have depth 0."""

    camera: Camera
    alpha: F32  # (H, W)
    depth: F32  # (H, W) along the view axis, world units
    normal: F32  # (H, W, 3) unit, world space, facing the eye
    spread: float  # median over opaque pixels of the standard deviation in depth of what they blend, world units


class DepthMaps:
    """Makes depth maps of one capture.

    A splat seen along rays through v = mean - eye is brightest where r t meets the plane through its mean with normal
    Σ⁻¹ v. Normals n and plane distances n·v blend like colours; the depth is Σ n·v / Σ n·r. A surface of splats lets
    a few percent through, and would take that share of its far side's depth: so for this splats are as opaque as
    `SHARPER` of them, and those behind the surface have no say.
    """

    def __init__(self, capture: Capture, settings: ProxySettings) -> None:
        self._radius = capture.radius
        opacities = 1 - (1 - np.clip(capture.splats.opacities, 0, 0.999)) ** SHARPER
        sharp = replace(capture.splats, opacities=opacities.astype(np.float32))
        self._compositor = Compositor(sharp, variant=settings.variant, threads=settings.threads)
        self._means = capture.splats.means
        self._margin = (_FAR * capture.radius + 2 * np.median(capture.splats.scales, axis=1)).astype(np.float32)
        axes, scales = axes_of(capture.splats)
        whitening = axes / np.maximum(scales, scales[:, 2:] * _THINNEST)[:, None, :]  # columns: axis / scale
        # Normals of planes do not depend on a splat's size: by a power of two, which changes no other bit, it comes to
        # about 1, or squares of tiny ones overflow.
        _, size = np.frexp(scales[:, 2])
        self._whitening = np.ldexp(whitening, size[:, None, None]).astype(np.float32)

    def of(self, camera: Camera) -> DepthMap:
        """The map of one camera, in the capture's own space."""
        v = self._means - camera.position.astype(np.float32)
        along = v if camera.projection == "perspective" else -camera.world_from_camera[None, :3, 2].astype(np.float32)
        n = np.einsum("nik,nk->ni", self._whitening, np.einsum("nik,ni->nk", self._whitening, along + 0 * v))
        n /= np.maximum(np.linalg.norm(n, axis=1, keepdims=True), np.float32(1e-30))
        away = (np.linalg.norm(v, axis=1) - np.linalg.norm(camera.position)).astype(np.float32)
        plane = np.einsum("ni,ni->n", n, v)
        values = np.concatenate([n, np.stack([plane, away, away * away], axis=1)], axis=1)
        values[self._hidden(camera), :4] = 0
        layer, sums = self._compositor.composite_with(camera, np.nan_to_num(values))
        alpha = 1 - layer.transmittance
        origins, directions = rays(camera)
        normals = sums[..., :3].astype(np.float64)
        slope = (normals * directions).sum(axis=-1)
        depth = (sums[..., 3] - (normals * (origins - camera.position)).sum(axis=-1)) / np.where(
            slope > _BEHIND, slope, np.inf
        )
        opaque = alpha > OPAQUE
        share = np.where(opaque, alpha, 1)
        spread = np.sqrt(np.maximum(sums[..., 5] / share - (sums[..., 4] / share) ** 2, 0))
        sound = opaque & (layer.median_depth > 0) & (np.abs(depth - layer.median_depth) < GATE * self._radius)
        normal = -sums[..., :3] / np.maximum(np.linalg.norm(sums[..., :3], axis=-1, keepdims=True), 1e-30)
        return DepthMap(
            camera,
            alpha,
            np.where(sound, depth, 0).astype(np.float32),
            np.where(sound[..., None], normal, 0).astype(np.float32),
            float(np.median(spread[opaque])) if opaque.any() else 0.0,
        )

    def _hidden(self, camera: Camera) -> NDArray[np.bool_]:
        """(N,) splats whose middle lies behind the surface at its pixel."""
        front = self._compositor.composite(camera).median_depth
        own = turned(self._means - camera.position.astype(np.float32), camera.camera_from_world[:3, :3].astype("f4"))
        z = -own[:, 2]
        w = np.maximum(z, np.float32(1e-12)) if camera.projection == "perspective" else np.float32(1)
        x = np.floor(np.float32(camera.cx) + np.float32(camera.fx) * own[:, 0] / w)
        y = np.floor(np.float32(camera.cy) - np.float32(camera.fy) * own[:, 1] / w)
        seen = (z > camera.near) & (x >= 0) & (x < camera.width) & (y >= 0) & (y < camera.height)
        surface = front.ravel()[np.where(seen, y * camera.width + x, 0).astype(np.int64)]
        return np.asarray(seen & (surface > 0) & (z > surface + self._margin))


def points_of(view: DepthMap, step: int = 1) -> tuple[F64, F64]:
    """(N, 3) points of the surface that a view sees, every `step`-th pixel both ways, and their normals."""
    depth = view.depth[::step, ::step]
    seen = depth > 0
    origins, directions = rays(view.camera)
    starts = np.broadcast_to(origins, directions.shape)[::step, ::step][seen]
    points = starts + directions[::step, ::step][seen] * depth[seen][:, None]
    return points, view.normal[::step, ::step][seen].astype(np.float64)
