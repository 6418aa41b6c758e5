"""The splats of a ladder: as trained, and as the real-time engine draws them. Each composite is made once."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mirelight.apps.realtime.captures import HeldSplats, held
from mirelight.base import colour
from mirelight.compositor import Compositor
from mirelight.compositor.engine import EngineDrawing, engine_rank
from mirelight.model import Camera, CompositorSettings, Job, SplatCloud, SplatLayer, rules_of


class SplatPictures:
    """What one camera sees of a cloud, by whatever settings."""

    def __init__(self, job: Job, splats: SplatCloud, camera: Camera) -> None:
        self._job, self._render = job, job.render
        self._radial = job.compositor.sort == "radial" and rules_of(job.compositor.profile).splats.pipelines
        self._splats = splats
        self._camera = camera
        self._made: dict[CompositorSettings, SplatLayer] = {}

    def composite(self, settings: CompositorSettings) -> SplatLayer:
        """The cloud in exact order."""
        if settings not in self._made:
            self._made[settings] = self._exposed(self._splats, settings, None)
        return self._made[settings]

    def drawn(
        self, settings: CompositorSettings, *, bucketed: bool = True, corner_bits: int | None = None
    ) -> SplatLayer:
        """The cloud from the engine's textures.

        Args:
            settings: of the profile playcanvas.
            bucketed: sorted as the engine sorts, else exactly.
            corner_bits: of the sub-pixels that corners are snapped to; None: they are not.
        """
        drawing = EngineDrawing(self._rank if bucketed else None, corner_bits)
        return self._exposed(self._held.textures, settings, drawing)

    @cached_property
    def _held(self) -> HeldSplats:
        return held(self._job, self._splats)

    @cached_property
    def _rank(self) -> NDArray[np.uint32]:
        return engine_rank(self._splats, self._camera, radial=self._radial, loaded=self._held.loaded)

    def _exposed(self, splats: SplatCloud, settings: CompositorSettings, drawing: EngineDrawing | None) -> SplatLayer:
        """A composite. A bare exposure of the engine is applied here: the compositor has it within curves only."""
        compositor = Compositor(splats, settings, variant=self._render.variant, threads=self._render.threads)
        layer = compositor.composite(self._camera, depth=False, drawing=drawing)
        exposes = rules_of(settings.profile).splats.pipelines and settings.exposure != 1
        if not exposes or settings.linear or settings.tone != "none":
            return layer
        gain = np.float32(settings.exposure ** (1 / colour.ENGINE_GAMMA))
        return replace(layer, color=layer.color * gain)
