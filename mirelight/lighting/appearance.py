"""What points of the proxy show by their albedo, for what looks at light on a surface without a camera."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mirelight.base.progress import CountProgress
from mirelight.model import F32, F64, Lighting

if TYPE_CHECKING:
    from mirelight.lighting.trace import Tracer


def shown(
    tracer: Tracer,
    lighting: Lighting,
    points: F64,
    normals: F64,
    spp: int,
    progress: CountProgress | None = None,
) -> F32:
    """What points of the proxy show by their albedo, (N, 3) linear: irradiance / pi, and what they send out themselves
    over their albedo. Arguments as for `Tracer.point_layers`."""
    made = tracer.point_layers(lighting, points, normals, spp, progress=progress).total * np.float32(1 / np.pi)
    return made + own_glow(tracer, points, normals) if tracer.emissive else made


def own_glow(tracer: Tracer, points: F64, normals: F64) -> F32:
    """(N, 3) what points send out themselves over their albedo."""
    albedo, emission = tracer.materials_at(points, normals)
    return np.asarray(emission / np.maximum(albedo, np.float32(1e-4)), np.float32)
