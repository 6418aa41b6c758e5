"""What comes from far away as a small picture, for the page's ball and strip."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mirelight.base.png import png_bytes
from mirelight.io.png import encode_display
from mirelight.model import DisplaySettings, Lighting, ParallelLight, digest
from mirelight.pipeline.scene import Scene
from mirelight.relighting.surroundings import surroundings_of

ROWS = 64


def shown(radiance: NDArray[np.floating]) -> bytes:
    """A PNG file of an equirectangular map (h, w, 3) of any unit, exposed so that all but its brightest shows."""
    top = max(float(np.quantile(radiance, 0.98)), 1e-9)
    pixels = np.concatenate([radiance / top, np.ones((*radiance.shape[:2], 1))], axis=2).astype(np.float32)
    return png_bytes(encode_display(pixels, DisplaySettings(exposure=-0.5), "physical"), {})


class Around:
    """What the shown lighting has from far away, as it changes."""

    def __init__(self) -> None:
        self.version, self.number = 0, -1  # of the picture; of the edit that it is of
        self.png = b""  # a file; empty: nothing comes from far away
        self._made_from = ""

    def look(self, scene: Scene, lighting: Lighting, number: int) -> None:
        """Take an edit's lighting."""
        suns = (x for x in lighting.lights if isinstance(x, ParallelLight))
        key = digest(lighting.environment, lighting.sky, *suns)
        if key != self._made_from:
            found = surroundings_of(scene.resolved(lighting))
            self.png = b"" if found is None else shown(found.picture(ROWS))
            self.version += 1
        self.number, self._made_from = number, key
