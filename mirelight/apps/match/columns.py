"""One picture and what each light adds to the frame of its camera, on the same few pixels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mirelight import relighting
from mirelight.apps.match.target import Target, resized
from mirelight.apps.match.uncertain import Int, tiles
from mirelight.base.progress import CountProgress
from mirelight.model import F32, F64, Camera, LayerFactor, Lighting, LightingBuffer, SplatLayer
from mirelight.model.unit_lights import terms
from mirelight.pipeline import stages
from mirelight.pipeline.scene import Scene

ROWS = 90  # pixels are averaged in linear light to at most so many rows: noise of both sides counts less
_NO_CLAMP = 1e30


class Columns:
    """What a fit needs of one camera.

    Frames are composited at the camera's own size: the fewer pixels, the more every splat is widened, and the brighter
    or darker than their capture's photographs splats are.
    """

    counts: F64  # (P, 3) how much each pixel counts
    target: F64  # (P, 3) the picture, in linear light
    unlit: dict[bool, F64]  # (P, 3) where no light falls, with the ratio's floor (True) and without (False)
    alone: dict[str, F64]  # (P, 3) by layer: what its unit adds
    tiles: Int  # (P,) in which part of the picture each pixel lies

    def __init__(
        self, scene: Scene, camera: Camera, lighting: Lighting, target: Target, progress: CountProgress
    ) -> None:
        """Trace the lighting, whose lights are units (`units.terms`), and relight with each alone."""
        self._scene, self._lighting = scene, lighting
        splats = stages.composite(scene, camera)
        assert splats is not None
        self._splats: SplatLayer = splats
        small = min(camera.height, ROWS)
        self._size = small, max(1, round(small * camera.width / camera.height))
        light, self._inside = target.light(1 - splats.transmittance, scene.job.display)
        self.counts = resized(self._inside, self._size).astype(np.float64).reshape(-1, 3)
        self.target = self._small(light)
        lit = stages.light(scene, camera, lighting, progress=progress)
        self._new, self._captured = _light_alone(lit.new), lit.captured
        self.tiles = tiles(self._size)
        names = [x.layer for x in terms(lighting)]
        floors = (True, False) if relighting.mode_of(scene.job.relight).leaves_floor else (True,)
        self.unlit = {x: self.relit(dict.fromkeys(names, np.zeros(3)), clamped=False, floor=x) for x in floors}
        self.alone = {x: self._with_one(x, names) - self.unlit[True] for x in names}

    def relit(self, weights: Mapping[str, F64], *, clamped: bool = True, floor: bool = True) -> F64:
        """(P, 3) the frame with the unit lights times these weights."""
        settings = self._scene.job.relight
        settings = settings if clamped else replace(settings, max_ratio=_NO_CLAMP)
        settings = settings if floor else replace(settings, delta=0.0)
        level = self._scene.captured_level if self._captured is not None else None
        mix = tuple(LayerFactor(layer=name, factor=x) for name, x in weights.items())
        frame = relighting.apply(
            self._splats,
            self._new.reweighted(weights),
            settings,
            captured=self._captured,
            captured_level=level,
            far=self._scene.far(replace(self._lighting, mix=mix)),
            noise=False,
        )
        return self._small(np.asarray(frame.rgba[..., :3]))

    def _with_one(self, name: str, names: list[str]) -> F64:
        return self.relit({x: np.full(3, float(x == name)) for x in names}, clamped=False)

    def _small(self, picture: F32) -> F64:
        """(P, 3) means over what counts of each block."""
        inside = resized(picture * self._inside, self._size).astype(np.float64).reshape(-1, 3)
        return np.asarray(inside / np.maximum(self.counts, 1e-12))


def _light_alone(buffer: LightingBuffer) -> LightingBuffer:
    """Without what a match does not read."""
    layers = tuple(replace(x, variance=None, half=None, quarter=None, other_quarter=None) for x in buffer.layers)
    return replace(buffer, layers=layers, noisy=(), variance=None)
