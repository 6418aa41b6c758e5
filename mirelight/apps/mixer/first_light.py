"""The light of a lamp on splats at once: for a page that shows it while it is dragged.

Direct light is sampled on every splat. Light that surfaces send each other is traced from a few of them and taken over
by their neighbours that look the same way: it is smooth, so that what is wrong with this is small, and it is traced
anew when the lamp rests.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mirelight.base.progress import ShareProgress
from mirelight.lighting import Tracer
from mirelight.lighting.splat_light import Places
from mirelight.model import F32, F64, I32, Lighting
from mirelight.model.unit_lights import LightSet, Unit
from mirelight.pipeline.prepared import Prepared
from mirelight.pipeline.splat_light import SplatLight

SAMPLES = 8  # of direct light on each splat
FEW = 1 << 14  # splats that indirect light is traced from
FEW_SAMPLES = 16  # from each of them
STAGES = (SAMPLES, 64, 256)  # samples a splat, one after another; the first is quick whatever it says
NEAR = 4  # of those that a splat takes its indirect light from
_TURNED = 0.1  # of the bounds' diagonal: how far away a splat counts whose normal differs by 1


class FirstLight:
    """Few samples of any lamps.

    Args:
        tracer: from `splat_light.tracer_for`.
        places: of N splats.
    """

    def __init__(self, tracer: Tracer, places: Places) -> None:
        self._whole, self._places = tracer, places
        self._direct = tracer.tuned(replace(tracer.settings, max_depth=1), layers=True, aovs=False)
        count = len(places.points)
        self._few = np.sort(np.random.default_rng(0).permutation(count)[:FEW])
        self._near, self._weights = self._neighbours()

    def light(self, lighting: Lighting) -> F32:
        """(N, 3) irradiance / pi of lamps alone."""
        points, normals = self._places.points, self._places.normals
        direct = self._direct.point_layers(lighting, points, normals, SAMPLES, emission=False).direct.sum(axis=0)
        few = self._whole.point_layers(
            lighting, points[self._few], normals[self._few], FEW_SAMPLES, emission=False
        ).indirect.sum(axis=0)
        if len(self._few) < len(points):
            few = np.einsum("nkc,nk->nc", few[self._near], self._weights)
        return np.asarray((direct + few) / np.pi, np.float32)

    def _neighbours(self) -> tuple[I32, F32]:
        """(N, k) of the few, and their weights, which sum to 1."""
        from scipy.spatial import cKDTree

        points, normals = self._places.points, self._places.normals
        if not len(points):
            return np.zeros((0, 1), np.int32), np.zeros((0, 1), np.float32)
        size = float(np.linalg.norm(np.ptp(points, axis=0))) or 1.0
        where: F64 = np.concatenate([points, normals * (_TURNED * size)], axis=1)
        k = min(NEAR, len(self._few))
        distance, index = cKDTree(where[self._few]).query(where, k=k)
        weight = 1 / (distance.reshape(-1, k) + 1e-6 * size)
        weight /= weight.sum(axis=1, keepdims=True)
        return np.asarray(index, np.int32).reshape(-1, k), np.asarray(weight, np.float32)


class StagedLight:
    """The light of unit lights on splats, by more and more samples.

    Args:
        scene: whose splats are lit.
        stages: samples a splat; the first stage is :class:`FirstLight`.
        progress: hears what is traced; what it raises ends the trace.
    """

    def __init__(self, scene: Prepared, stages: tuple[int, ...], progress: ShareProgress) -> None:
        self.scene, self.splats = scene, SplatLight(scene, stages[0], progress)
        self.stages = stages
        self._first = FirstLight(self.splats.tracer, self.splats.places)
        self._finer: dict[int, SplatLight] = {}

    def follow(self, scene: Prepared) -> None:
        """Take another job's lights, whose proxy and splats' places are the same."""
        self.scene, self.splats = scene, self.splats.of_scene(scene)
        self._finer = {spp: one.of_scene(scene) for spp, one in self._finer.items()}

    def light(self, unit: Unit, stage: int) -> F32:
        """(N, 3) irradiance / pi of a unit light, as a stage has it."""
        if stage == 0:
            return self.splats.with_sky(self._first.light(self.scene.lighting_of(LightSet((unit,)))), unit)
        spp = self.stages[stage]
        if spp not in self._finer:
            self._finer[spp] = self.splats.with_samples(spp)
        return next(self._finer[spp].unit_lights((unit,)))
