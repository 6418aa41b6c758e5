"""First light, at once: traced for a few of a capture's splats, before a grey proxy, and spread to all of them.

What fine light needs beside it takes longer than a person waits: the colours of the proxy, and where each splat lies.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property

import numpy as np

from mirelight.apps.mixer.first_light import STAGES, StagedLight
from mirelight.base import colour, conventions
from mirelight.base.progress import ShareProgress
from mirelight.lighting.splat_light import Places, places_of
from mirelight.model import F32, I32, Deferred, EstimatedSky, Job, Lighting, ProxyMesh, SplatCloud
from mirelight.model.unit_lights import Unit
from mirelight.pipeline import requirements
from mirelight.pipeline.codecs import ARRAY
from mirelight.pipeline.scene import Scene, prepare
from mirelight.pipeline.splat_light import SplatLight

FEW = 1 << 13  # splats that are traced
SAMPLES = 16  # of each
MOST_FACES = 1 << 17
REFINING = "refining the light"  # as a page says it
NEAR = 3  # of them that another splat takes its light from


class Few:
    """A few splats of a capture, and how what is known of them is spread to all N."""

    def __init__(self, splats: SplatCloud) -> None:
        from scipy.spatial import cKDTree

        of = np.sort(np.random.default_rng(0).permutation(len(splats))[:FEW])
        parts = {name: getattr(splats, name)[of] for name in ("means", "quats", "scales", "opacities", "sh")}
        self.splats = Deferred.of(replace(splats, **parts))
        distance, index = cKDTree(parts["means"]).query(splats.means, k=min(NEAR, len(of)), workers=-1)
        size = float(np.linalg.norm(np.ptp(splats.means, axis=0))) or 1.0
        weight = 1 / (distance.reshape(len(splats), -1) + 1e-6 * size)
        self._index: I32 = index.reshape(len(splats), -1).astype(np.int32)
        self._weight: F32 = (weight / weight.sum(axis=1, keepdims=True)).astype(np.float32)

    def spread(self, values: F32) -> F32:
        """(few, 3) -> (N, 3)."""
        return np.asarray(np.einsum("nkc,nk->nc", values[self._index], self._weight), np.float32)


class _FewPlaces(SplatLight):
    @cached_property
    def places(self) -> Places:
        """By as many samples as the light, so that no other kernels are made for them."""
        scene = self._scene
        assert scene.proxy is not None and scene.splats is not None
        captured = None if scene.job.captured is None else scene.resolved(scene.job.captured)
        return places_of(scene.splats, scene.proxy, self.tracer, captured, (SAMPLES, SAMPLES))


class EarlyLight:
    """The light of unit lights on a few splats.

    Args:
        scene: of the whole capture, its mesh at hand.
        few: of its splats.
        progress: hears what is traced; what it raises ends the trace.
        mesh: in place of the scene's; None: that.
    """

    stages = (SAMPLES,)
    together = 8  # unit lights share paths

    def __init__(self, scene: Scene, few: Few, progress: ShareProgress, mesh: ProxyMesh | None = None) -> None:
        found = scene.mesh if mesh is None else mesh
        assert found is not None
        self._few, self._mesh, self._whole = few, Deferred.of(_coarse(found)), scene
        self.scene = prepare(self._thin(scene))
        self.splats: SplatLight = _FewPlaces(self.scene, SAMPLES, progress)

    def follow(self, scene: Scene) -> None:
        """Take another job's lights, whose proxy and splats' places are the same."""
        self._whole = scene
        self.scene = prepare(self._thin(scene), like=self.scene)
        self.splats = self.splats.of_scene(self.scene)

    def known(self, lighting: Lighting) -> Lighting:
        """A lighting as these few can be lit by it: they tell of no light themselves."""
        return self._whole.resolved(lighting) if isinstance(lighting.sky, EstimatedSky) else lighting

    def lights(self, units: tuple[Unit, ...], stage: int) -> Iterator[F32]:
        """(few, 3) irradiance / pi of each unit light; there is one stage."""
        return self.splats.unit_lights(units)

    def level(self, captured: F32) -> float:
        """About what `Scene.captured_level` is, by the captured light (few, 3) on the few."""
        return float((captured @ colour.REC709_LUMINANCE).mean())

    def spread(self, values: F32) -> F32:
        """(few, 3) -> (N, 3); see :meth:`Few.spread`."""
        return self._few.spread(values)

    def _thin(self, scene: Scene) -> Job:
        job = scene.job
        return replace(
            job,
            splats=self._few.splats,
            own_splats=None,
            proxy=self._mesh,
            made_proxy=None,
            albedo_from_splats=False,
            capture_cameras=(),
            capture_pictures=(),
            captured=None if job.captured is None else scene.resolved(job.captured),
        )


class FineLight(StagedLight):
    """The light of unit lights on all splats, by more and more samples."""

    together = 1  # a person waits for the next one, and sees it

    def __init__(self, scene: Scene, progress: ShareProgress) -> None:
        super().__init__(scene, STAGES, progress)

    def known(self, lighting: Lighting) -> Lighting:
        """The lighting as it is."""
        return lighting

    def lights(self, units: tuple[Unit, ...], stage: int) -> Iterator[F32]:
        """(N, 3) irradiance / pi of each unit light, as a stage has it."""
        return (self.light(unit, stage) for unit in units)

    def level(self, captured: F32) -> float:
        """Of the captured light (N, 3); see `Scene.captured_level`."""
        return self.scene.captured_level or 0.0

    def spread(self, values: F32) -> F32:
        """(N, 3), which it is."""
        return values


def _coarse(mesh: ProxyMesh) -> ProxyMesh:
    """A mesh of not many triangles: what lies in one cell of a grid is one vertex. A tracer is made of it sooner."""
    low, high = mesh.bounds
    for cells in (512, 256, 128):
        if len(mesh.faces) <= MOST_FACES:
            break
        at = ((mesh.vertices - low) * (cells / max(float((high - low).max()), 1e-30))).astype(np.int64)
        _, cell, count = np.unique(at @ [1, 1024, 1 << 20], return_inverse=True, return_counts=True)
        middle = [np.bincount(cell, mesh.vertices[:, k]) / count for k in range(3)]
        faces = cell.astype(np.int32)[mesh.faces]
        flat = (faces == np.roll(faces, 1, axis=1)).any(axis=1)
        mesh = ProxyMesh(vertices=np.stack(middle, axis=1).astype(np.float32), faces=faces[~flat])
    return mesh


def scraps(splats: SplatCloud) -> ProxyMesh:
    """A triangle in place of each of a few splats: what has kernels compiled before there is a proxy."""
    of = slice(None, None, max(len(splats) // FEW, 1))
    axes = conventions.rotation_from_quaternion(splats.quats[of])  # columns
    size = 0.01 * np.linalg.norm(np.ptp(splats.means, axis=0))
    wide = size * np.take_along_axis(axes, np.argsort(splats.scales[of], axis=1)[:, None, 1:], axis=2)
    corners = np.stack([-wide.sum(axis=2), wide[..., 0], wide[..., 1]], axis=1) + splats.means[of, None]
    faces = np.arange(3 * len(corners), dtype=np.int32).reshape(-1, 3)
    return ProxyMesh(vertices=corners.reshape(-1, 3).astype(np.float32), faces=faces)


def is_small(splats: SplatCloud) -> bool:
    """Whether what fine light takes is made in no time."""
    return len(splats) <= 4 * FEW


def knows_captured(scene: Scene) -> bool:
    """Whether the captured light is given, or was estimated before."""
    sky = None if scene.job.captured is None else scene.job.captured.sky
    return not isinstance(sky, EstimatedSky) or scene.kept.has(scene.keys.estimate(sky), ARRAY)


def at_hand(scene: Scene) -> bool:
    """Whether what fine light takes was made already, or need not be made by another process."""
    job, keys, kept = scene.job, scene.keys, scene.kept
    assert job.splats is not None
    if is_small(job.splats.value):
        return True
    wanted = [keys.splat_places, *([keys.proxy] if requirements.colors_proxy(job) else [])]
    wanted += [keys.captured_level] if requirements.compared(job) is not None else []
    return all(kept.has(x, ARRAY) for x in wanted)


def make(scene: Scene) -> None:
    """Make and keep what fine light takes. Raises RenderError where no splat lies on the proxy."""
    _ = SplatLight(scene, SAMPLES).places
    _ = scene.captured_level
