"""Light from far away on the splats that show it: those of a sky, which lie off the proxy.

A splat off the proxy is part of no surface. What it shows is the light from its own direction, as where frames look
past the proxy (`mirelight.relighting.far`); so that is its light, in place of what falls on the proxy. So are white
splats in a room's windows, between the bars, wherever they hang.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mirelight.base.colour import srgb_decode
from mirelight.base.conventions import unit
from mirelight.base.sh import mean_display
from mirelight.lighting.sight import Sight
from mirelight.model import F32, F64, Camera, SplatCloud
from mirelight.pipeline.beyond import WHITE, off_proxy
from mirelight.relighting.far import ROWS
from mirelight.relighting.surroundings import Lookup


class FarSplats:
    """The light of N splats, those of the sky told apart.

    Args:
        splats: in world space.
        away: (N,) their distances to the proxy.
        cameras: from where they were captured; none: directions are from the splats' middle.
        room: into the proxy, where that is a room; else None.
    """

    def __init__(self, splats: SplatCloud, away: F32, cameras: Sequence[Camera], room: Sight | None = None) -> None:
        eyes = np.stack([x.position for x in cameras]) if cameras else splats.means
        way: F64 = splats.means.astype(np.float64) - np.median(eyes, axis=0)
        distance = np.maximum(np.linalg.norm(way, axis=1), 1e-9)
        off = off_proxy(away / distance)
        if room is not None:
            off = np.where(_in_windows(splats, way, room), 1.0, off)
        self._rows = np.flatnonzero(off > 0)
        self._share = off[self._rows, None].astype(np.float32)
        self._look = Lookup(unit(way[self._rows]), ROWS)

    def on(self, light: F32, far: F32 | None) -> F32:
        """(N, 3) light, irradiance / pi, on the proxy, with its radiance where splats are of the sky: that of a far map
        (128, 256, 3); None: of what glows, which no sky does."""
        out = light.copy()
        seen = np.float32(0) if far is None else self._look(far).astype(np.float32)
        out[self._rows] += self._share * (seen - light[self._rows])
        return out


def _in_windows(splats: SplatCloud, way: F64, room: Sight) -> NDArray[np.bool_]:
    """(N,) which splats are white and seen where nothing of a room is, along ways (N, 3) from one place in it."""
    out = splats.light(mean_display(splats.sh)).min(axis=1) > srgb_decode(WHITE)
    some = np.flatnonzero(out)
    eye = splats.means[some].astype(np.float64) - way[some]
    out[some] = ~room.blocked(eye, way[some])
    return np.asarray(out)
