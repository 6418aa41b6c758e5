"""Which splats lie off the proxy, as those of a sky do, and how much of each pixel they are.

At silhouettes splats of a thing that reach past its proxy blend with those behind it. The former take the factor of the
surface beside them, the latter that of the sky; both are told apart by how far they lie from the proxy in space.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mirelight.base.colour import srgb_encode
from mirelight.base.progress import ShareProgress, passed, quiet
from mirelight.lighting.mirrors import planes_of
from mirelight.model import F32, F64, Camera, ProxyMesh, SplatLayer, triangles

if TYPE_CHECKING:
    from mirelight.compositor import Compositor
    from mirelight.lighting import EngineTracer, Tracer

_ROWS = 1 << 17  # points at a time
_MARKS = 400_000  # points on the proxy that distances are measured to
_ENCLOSED = 0.15  # of the sky, that a room's surface sees at most: own proxies of rooms 0.04 to 0.12, a courtyard 0.17
_BRIGHT, WHITE = 0.8, 0.9  # display values: a room's pixels past the proxy are no sky below, and are from here on
_FAR = 0.9  # off the proxy, that a pixel of a sky is
_ALIKE, _OTHER = 0.08, 0.16  # display values, in any channel: up to here pixels look as the sky does, from here not
_ON, _OFF = 0.01, 0.04  # distance as it would be seen, share of the picture's longer side: up to here on, from here off


def distances(points: F32, mesh: ProxyMesh, threads: int | None = None, progress: ShareProgress = quiet) -> F32:
    """(N,) distance of points (N, 3) to a mesh, or in its mirrors to what it shows there, world units, at most as much
    too small as points on it lie apart.

    Args:
        points: anywhere.
        mesh: of any area; without any all is infinitely far.
        threads: that may be used; None: all.
        progress: hears how many are known.
    """
    from scipy.spatial import cKDTree

    from mirelight.proxy.sampling import spread

    corners = mesh.vertices[mesh.faces].astype(np.float64)
    area = float(triangles.areas(corners).sum())
    if not area > 0:
        return np.full(len(points), np.inf, np.float32)
    marks = spread(mesh.vertices.astype(np.float64), mesh.faces.astype(np.int64), _MARKS)
    tree, apart, planes = cKDTree(marks), np.sqrt(area / len(marks)), planes_of(mesh)
    out = np.empty(len(points), np.float32)
    for first in passed(range(0, len(points), _ROWS), progress, "looking how far splats lie from the proxy"):
        rows = slice(first, first + _ROWS)
        at = points[rows].astype(np.float64)
        away, _ = tree.query(at, workers=threads or -1)
        for plane in planes:
            behind = plane.behind(at)
            seen, _ = tree.query(plane.points(at[behind]), workers=threads or -1)
            away[behind] = np.minimum(away[behind], seen)
        out[rows] = np.maximum(away - apart, 0)
    return out


def off_proxy(seen: F64) -> F64:
    """(N,) 0..1 whether splats are off the proxy, by their distance to it as shares of a picture's longer side."""
    t = np.clip((seen - _ON) / (_OFF - _ON), 0, 1)
    return np.asarray(t * t * (3 - 2 * t))


def composite(
    compositor: Compositor, camera: Camera, away: F32, *, depth: bool, diffuse: bool = False, room: bool = False
) -> SplatLayer:
    """The splats as a camera sees them, with those told apart that lie off the proxy (`beyond`).

    A room's walls are behind all that is in it, so past its proxy are windows alone. Splats of a white sky hang before
    and between the bars, as nothing tells how far it is: what is white counts as off the proxy there. Outdoors they
    hang along roofs and trees, too: above the horizon what looks as the sky around it counts as off the proxy.

    Args:
        compositor: of N splats.
        camera: that sees them.
        away: (N,) their distance to the proxy.
        depth: as for :meth:`mirelight.compositor.Compositor.composite`.
        diffuse: as there.
        room: whether the proxy is one.

    Raises:
        RenderError: as there.
    """
    ahead = (camera.position - compositor.splats.means.astype(np.float64)) @ camera.world_from_camera[:3, 2]
    unit = 1.0 if camera.projection == "orthographic" else np.maximum(ahead, 1e-9)
    off = off_proxy(away * max(camera.fx, camera.fy) / unit / max(camera.width, camera.height))
    depths = np.maximum(ahead, 0)
    values = np.stack([off, off * depths, depths], axis=1).astype(np.float32)
    layer, sums = compositor.composite_with(camera, values, depth=depth, diffuse=diffuse)
    alpha = 1 - layer.transmittance
    share = np.where(alpha > 0, np.clip(sums[..., 0] / np.maximum(alpha, 1e-6), 0, 1), 1)
    depth_off = sums[..., 1] / np.maximum(sums[..., 0], 1e-9)
    more = np.maximum((_white(layer) if room else _as_sky(layer, share, camera)) - share, 0)
    mean = sums[..., 2] / np.maximum(alpha, 1e-6)
    depth_off = (share * depth_off + more * mean) / np.maximum(share + more, 1e-9)
    return replace(layer, beyond=np.stack([share + more, depth_off], axis=-1).astype(np.float32))


def above_horizon(camera: Camera) -> NDArray[np.bool_]:
    """(H, W) which pixels of a camera look upwards."""
    _, ways = camera.rays()
    return np.asarray(ways[..., 1] > 0)


def is_room(tracer: Tracer | EngineTracer) -> bool:
    """Whether a proxy is a room, as the path tracer sees it; by the engine's light it is not asked."""
    from mirelight.lighting import Tracer

    return isinstance(tracer, Tracer) and tracer.openness < _ENCLOSED


def _white(layer: SplatLayer) -> F32:
    """(H, W) 0..1 how white pixels are."""
    return np.asarray(np.clip((_shown(layer).min(axis=-1) - _BRIGHT) / (WHITE - _BRIGHT), 0, 1), np.float32)


def _as_sky(layer: SplatLayer, share: F64, camera: Camera) -> F32:
    """(H, W) 0..1 how much pixels above the horizon look as those around them do of which that `share` (H, W) is off
    the proxy."""
    from mirelight.proxy.skies import large, unlike

    above = above_horizon(camera)
    apart = unlike(_shown(layer), large(above & (share > _FAR)))
    return np.asarray(above * np.clip((_OTHER - apart) / (_OTHER - _ALIKE), 0, 1), np.float32)


def _shown(layer: SplatLayer) -> F32:
    """(H, W, 3) display values of the splats alone."""
    color = layer.color / np.maximum(1 - layer.transmittance, np.float32(1e-6))[..., None]
    return np.asarray(srgb_encode(np.clip(color, 0, 1)) if layer.linear else color, np.float32)
