"""Where the surface is in a view of splats: depth and normal of each pixel, by blending the splats' planes of peak."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mirelight.compositor import Compositor
from mirelight.model import F32, F64, Camera, CompositorSettings, SplatCloud
from mirelight.proxy.axes import axes_of
from mirelight.proxy.capture import Capture
from mirelight.proxy.tuning import TUNING
from mirelight.proxy.types import ProxySettings
from mirelight.proxy.views import rays, turned


@dataclass(frozen=True, slots=True, eq=False)
class DepthMap:
    """One view. Pixels without a surface have depth 0."""

    camera: Camera
    color: F32  # (H, W, 3) as the splats show it, display values, not premultiplied
    alpha: F32  # (H, W)
    depth: F32  # (H, W) along the view axis, world units
    normal: F32  # (H, W, 3) unit, world space, facing the eye
    spread: F32  # (H, W) standard deviation in depth of what is blended, world units
    trust: F32  # (H, W) how much the depth counts where views differ, 0..1


class DepthMaps:
    """Makes depth maps of one capture.

    A splat seen along rays through v = mean - eye is brightest where r t meets the plane through its mean with normal
    Σ⁻¹ v. Normals n and plane distances n·v blend; the depth is Σ n·v / Σ n·r. They are weighed by the splats' optical
    depths alone at first, not by what is left of the light: so the layer that an optimiser makes of many faint splats
    is found, whatever hangs before it. The surface is what is seen of that layer: in captures that were trained well it
    is opaque, and splats that lie in it unseen, up to a spacing deep, would draw a thing's sides inwards. Small splats
    count more, by the square of their area: an optimiser makes them where pictures tell the place, and leaves large
    ones as a fog where they do not (depths of a room are off by 0.021 instead of 0.053 in the median). What stands
    behind the layer has no say: splats whose middle lies farther behind the surface at their pixel than they reach,
    which is told again as the surface is known better.
    """

    def __init__(self, capture: Capture, settings: ProxySettings, *, middle: bool = False) -> None:
        """`middle`: depths are those of the layers' middles, which vary less from view to view."""
        splats = capture.splats
        self._splats, self._settings, self._middle = splats, settings, middle
        self._shown = Compositor(splats, variant=settings.variant, threads=settings.threads)
        self._thinned = Compositor(
            layered(splats, TUNING.depth_thinner),
            CompositorSettings(alpha_clip=TUNING.depth_clip),
            variant=settings.variant,
            threads=settings.threads,
        )
        self._means, self._noise = splats.means, np.float32(TUNING.depth_noise * capture.spacing)
        axes, scales = axes_of(splats)
        self._reach = (TUNING.depth_typical * np.median(scales[:, 1]) + TUNING.depth_reach * scales[:, 1]).astype(
            np.float32
        )
        # columns: axis / scale
        whitening = axes / np.maximum(scales, scales[:, 2:] * TUNING.depth_thinnest)[:, None, :]
        # Normals of planes do not depend on a splat's size: by a power of two, which changes no other bit, it comes to
        # about 1, or squares of tiny ones overflow.
        _, size = np.frexp(scales[:, 2])
        typical = np.median(scales[:, 1:], axis=0)
        fine = np.minimum(typical / np.maximum(scales[:, 1:], 1e-30), TUNING.depth_finest)
        self._fine = (fine[:, 0] * fine[:, 1]).astype(np.float32) ** 2
        self._whitening = np.ldexp(whitening, size[:, None, None]).astype(np.float32)

    def of(self, camera: Camera) -> DepthMap:
        """The map of one camera, in the capture's own space."""
        with self._shown.holding(camera) as some, self._thinned.holding(camera) as others:
            seen = np.zeros(len(self._means), bool)
            seen[some] = seen[others] = True
            return self._mapped(camera, np.flatnonzero(seen))

    def _mapped(self, camera: Camera, rows: NDArray[np.int64]) -> DepthMap:
        """By the splats (M,) that the camera can see."""
        layer = self._shown.composite(camera)
        values = self._planes(camera, rows)
        z, pixel = self._places(camera, rows)
        reach, surface = self._reach[rows], layer.median_depth
        for _ in range(TUNING.depth_rounds):
            there = np.where(pixel >= 0, surface.ravel()[np.maximum(pixel, 0)], 0)
            part = rows, values, (there == 0) | (z <= there + reach)
            surface, sums = self._blended(self._thinned, camera, *part)
        if not self._middle:
            # all of the layer tells where it is, what is seen of it where the surface is; what hangs before it counts
            # for nothing
            there = np.where(pixel >= 0, surface.ravel()[np.maximum(pixel, 0)], 0)
            part = rows, values, (there == 0) | (np.abs(z - there) <= reach)
            front, seen = self._blended(self._shown, camera, *part)
            surface = np.where((front > 0) & (seen[..., 4] > TUNING.depth_least), front, surface)
        weight = np.maximum(sums[..., 4], 1e-30)
        mean = sums[..., 5] / weight
        spread = np.sqrt(np.maximum(sums[..., 6] / weight - mean * mean, 0))
        alpha = 1 - layer.transmittance
        sound = (
            (alpha > TUNING.depth_opaque)
            & (layer.median_depth > 0)
            & (sums[..., 4] > TUNING.depth_least)
            & (surface > 0)
        )
        sound &= np.abs(surface - mean) < TUNING.depth_astray * spread + self._reach.min()
        normal = -sums[..., :3] / np.maximum(np.linalg.norm(sums[..., :3], axis=-1, keepdims=True), 1e-30)
        return DepthMap(
            camera,
            (layer.color / np.maximum(alpha, np.float32(1e-3))[..., None]).astype(np.float32),
            alpha,
            np.where(sound, surface, 0).astype(np.float32),
            np.where(sound[..., None], normal, 0).astype(np.float32),
            spread.astype(np.float32),
            (1 / (1 + (spread / self._noise) ** 2)).astype(np.float32),
        )

    def _blended(
        self, compositor: Compositor, camera: Camera, rows: NDArray[np.int64], values: F32, part: NDArray[np.bool_]
    ) -> tuple[F32, F32]:
        """(H, W) depths at which rays meet the planes blended of a part (M,) of some splats, and (H, W, 7) what is
        blended of their :meth:`_planes` (M, 7)."""
        origins, directions = rays(camera)
        blended = np.zeros((len(self._means), values.shape[1]), np.float32)
        blended[rows[part]] = values[part]
        _, sums = compositor.composite_with(camera, blended, depth=False)
        slope = np.einsum("hwi,hwi->hw", sums[..., :3], directions.astype(np.float32))
        across = np.einsum(
            "hwi,hwi->hw", sums[..., :3], (origins - camera.position).astype(np.float32) + 0 * sums[..., :3]
        )
        sees = slope > TUNING.depth_behind * sums[..., 4]
        return (sums[..., 3] - across) / np.where(sees, slope, np.inf), sums

    def blended_over(self, camera: Camera) -> F32:
        """(P,) standard deviations of the distances that opaque pixels blend, world units: of a fog they are large.

        A surface lets a few percent through, and with it its far side: so splats are as opaque as `SHARPER` of them.
        """
        away = np.linalg.norm(self._means - camera.position.astype(np.float32), axis=1)
        away = (away - np.linalg.norm(camera.position)).astype(np.float32)
        layer, sums = self._sharp.composite_with(camera, np.stack([away, away * away], axis=1), depth=False)
        alpha = 1 - layer.transmittance
        opaque = alpha > TUNING.depth_opaque
        mean, square = (sums[..., k][opaque] / alpha[opaque] for k in (0, 1))
        return np.asarray(np.sqrt(np.maximum(square - mean * mean, 0)), np.float32)

    @cached_property
    def _sharp(self) -> Compositor:
        settings = self._settings
        sharp = layered(self._splats, TUNING.depth_sharper)
        return Compositor(sharp, variant=settings.variant, threads=settings.threads)

    def _planes(self, camera: Camera, rows: NDArray[np.int64]) -> F32:
        """(M, 7) what is blended: normal and distance of a splat's plane, 1, its depth and the square of that."""
        whitening, v = self._whitening[rows], self._means[rows] - camera.position.astype(np.float32)
        ahead = -camera.world_from_camera[:3, 2].astype(np.float32)
        along = v if camera.projection == "perspective" else ahead + 0 * v
        n = np.einsum("nik,nk->ni", whitening, np.einsum("nik,ni->nk", whitening, along))
        n /= np.maximum(np.linalg.norm(n, axis=1, keepdims=True), np.float32(1e-30))
        z = np.einsum("ni,i->n", v, ahead)
        more = np.stack([np.einsum("ni,ni->n", n, v), np.ones_like(z), z, z * z], axis=1)
        planes = np.concatenate([n, more], axis=1).astype(np.float32) * self._fine[rows, None]
        return np.asarray(np.nan_to_num(planes), np.float32)

    def _places(self, camera: Camera, rows: NDArray[np.int64]) -> tuple[F32, NDArray[np.int64]]:
        """(M,) depth of the splats' middles, and the pixel that each lies in; -1: none."""
        own = turned(
            self._means[rows] - camera.position.astype(np.float32), camera.camera_from_world[:3, :3].astype("f4")
        )
        return -own[:, 2], pixels_of(camera, own)


def layered(splats: SplatCloud, layers: float) -> SplatCloud:
    """The splats, each as opaque as so many of it one behind the other."""
    opacities = 1 - (1 - np.clip(splats.opacities, 0, 0.999)) ** layers
    return replace(splats, opacities=opacities.astype(np.float32))


def shows(camera: Camera, points: F32) -> NDArray[np.bool_]:
    """(N,) whether points (N, 3) are in a camera's picture, whatever stands before them."""
    own = turned(points - camera.position.astype(np.float32), camera.camera_from_world[:3, :3].astype("f4"))
    return pixels_of(camera, own) >= 0


def pixels_of(camera: Camera, own: F32) -> NDArray[np.int64]:
    """(N,) flat index of the pixel that shows points (N, 3) in the camera's space; -1: none."""
    z = -own[:, 2]
    w = np.maximum(z, np.float32(1e-12)) if camera.projection == "perspective" else np.float32(1)
    x = np.floor(np.float32(camera.cx) + np.float32(camera.fx) * own[:, 0] / w)
    y = np.floor(np.float32(camera.cy) - np.float32(camera.fy) * own[:, 1] / w)
    seen = (z > camera.near) & (x >= 0) & (x < camera.width) & (y >= 0) & (y < camera.height)
    return np.where(seen, y * camera.width + x, -1).astype(np.int64)


def footprint(cameras: Sequence[Camera], points: F32) -> float:
    """Side of a camera's pixel where points (N, 3) lie: the median over both, world units; 0: no camera has any."""
    few = points[:: max(len(points) // TUNING.depth_few, 1)]
    sides = []
    for camera in cameras:
        own = turned(few - camera.position.astype(np.float32), camera.camera_from_world[:3, :3].astype("f4"))
        away = -own[pixels_of(camera, own) >= 0, 2] if camera.projection == "perspective" else np.ones(1)
        if len(away):
            sides.append(float(np.median(away)) / camera.fx)
    return float(np.median(sides)) if sides else 0.0


def points_of(view: DepthMap, step: int = 1) -> tuple[F64, F64, F32]:
    """(N, 3) points of the surface that a view sees, every `step`-th pixel both ways, their normals (N, 3), and trust
    (N,)."""
    depth = view.depth[::step, ::step]
    seen = depth > 0
    origins, directions = rays(view.camera)
    starts = np.broadcast_to(origins, directions.shape)[::step, ::step][seen]
    points = starts + directions[::step, ::step][seen] * depth[seen][:, None]
    return points, view.normal[::step, ::step][seen].astype(np.float64), view.trust[::step, ::step][seen]


def sure_points(view: DepthMap, least: float = TUNING.sure) -> F64:
    """(N, 3) points of the surface that a view is sure of: trusted more than `least`."""
    points, _, trust = points_of(view, TUNING.sure_step)
    return points[trust > least]
