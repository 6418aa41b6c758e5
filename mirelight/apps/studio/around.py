"""What comes from far away as a small picture, for the page's ball and strip."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mirelight.base.png import png_bytes
from mirelight.io.png import encode_display
from mirelight.model import DisplaySettings, Lighting
from mirelight.relighting.surroundings import surroundings_of

ROWS = 64


def shown(radiance: NDArray[np.floating]) -> bytes:
    """A PNG file of an equirectangular map (h, w, 3) of any unit, exposed so that all but its brightest shows."""
    top = max(float(np.quantile(radiance, 0.98)), 1e-9)
    pixels = np.concatenate([radiance / top, np.ones((*radiance.shape[:2], 1))], axis=2).astype(np.float32)
    return png_bytes(encode_display(pixels, DisplaySettings(exposure=-0.5), "physical"), {})


def picture(lighting: Lighting) -> bytes:
    """A PNG file of a resolved lighting's environment and suns as they stand in the world; empty where it has none."""
    found = surroundings_of(lighting)
    return b"" if found is None else shown(found.picture(ROWS))
