"""The picture by which a person judges an estimate: captured | irradiance | captured / irradiance."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mirelight.base.colour import REC709_LUMINANCE, srgb_encode
from mirelight.model import F32, LightingBuffer

_FLOOR = 0.02  # of the mean light: what is darker is shown as nothing is known
WHITE = 0.9  # display value of the lights' brightest 5 %


def sheet(splats: F32, lit: LightingBuffer) -> NDArray[np.uint8]:
    """Three pictures side by side, (H, 3 W, 3) uint8, display-encoded.

    Irradiance / pi is scaled so that its brightest 5 % are nearly white; the quotient is what remains of the splats
    without that light, the albedo: left-over shadows in it mean a wrong sun or a proxy that misfits.

    Args:
        splats: (H, W, 4) the splats as captured, linear, premultiplied.
        lit: the proxy of the same view under the estimated light.
    """
    covered = lit.coverage[..., None]
    albedo = np.maximum(lit.albedo * covered, np.float32(1e-4))
    light = np.where(covered > 0, lit.beauty[..., :3] / albedo, np.float32(0))
    captured = splats[..., :3]
    seen = covered[..., 0] > 0.5
    brightness = light @ REC709_LUMINANCE
    top = float(np.quantile(brightness[seen], 0.95)) if seen.any() else 1.0
    mean = float(brightness[seen].mean()) if seen.any() else 1.0
    quotient = np.where(covered > 0, captured / (light + _FLOOR * mean), 0)
    parts: list[F32] = [captured, light * np.float32(WHITE / max(top, 1e-9)), quotient]
    return np.concatenate([_shown(part) for part in parts], axis=1)


def _shown(linear: F32) -> NDArray[np.uint8]:
    return np.asarray(np.round(srgb_encode(np.clip(linear, 0, 1)) * 255), dtype=np.uint8)
