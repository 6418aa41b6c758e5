"""Whole frames: the stages one after the other; through a lens or an open shutter, the mean of those of its pinholes.

What a lens blurs is the finished picture: a pinhole at each of its points, with all that is seen from there, so that
splats, lit proxy, objects and what stands behind agree wherever they are out of focus.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from mirelight.base.progress import CountProgress
from mirelight.model import F32, Camera, Frame, Job, Lighting, LightingBuffer, LightLayer
from mirelight.pipeline import requirements, stages
from mirelight.pipeline.scene import Scene

_OPAQUE = np.float32(1e-6)  # light behind a frame that lets less through does not count
_LEAST_COMPARED = 8  # samples of a pinhole, where light is divided by captured light: docs/benchmarks/relighting.md
_SAMPLES_OF_MIDDLE = 4  # one part in so many of a pixel's samples, for what is said of the middle of the lens


def frame(scene: Scene, camera: Camera, lighting: Lighting | None, *, progress: CountProgress | None = None) -> Frame:
    """One frame as `mirelight render` makes it.

    Args:
        scene: a prepared job.
        camera: one of the job's, or any other.
        lighting: one of the job's, or any other; None: the splats as captured.
        progress: called with (samples done, samples in all) while something is traced.

    Returns:
        The frame. Through a lens or an open shutter its light is the mean over its pinholes: `rgba`, `unlit`, `factor`,
        `shadow`, layers, coverage. What is no light (depth, positions, normals, albedo, mattes) is that of the pinhole
        in the lens's middle.

    Raises:
        Stopped, BackendError, RenderError: as :func:`mirelight.pipeline.stages.light`.
    """
    if camera.exposure is None:
        return stages.frame(scene, camera, lighting, progress=progress)
    inner, count = scene.for_pinholes, scene.job.render.lens_samples
    middle = replace(camera.pinhole, share=(count, min(count, _SAMPLES_OF_MIDDLE)))
    whole = _Mean(count)
    shares = _shares(scene.job, lighting, count)
    for number, pinhole in enumerate(camera.pinholes(count)):
        one = replace(pinhole, share=(number, shares))
        report = None if progress is None else partial(_part, progress, number, count + 1)
        whole.add(stages.frame(inner, one, lighting, progress=report))
    report = None if progress is None else partial(_part, progress, count, count + 1)
    made = whole.of(stages.frame(inner, middle, lighting, progress=report), camera)
    key = scene.keys.frame(camera, lighting)
    return made if made.made_by is None else replace(made, made_by=replace(made.made_by, fingerprint=key))


def effort(job: Job, camera: Camera, lighting: Lighting | None) -> tuple[int, float]:
    """How many pinholes a frame is made from, and how often all of a pixel's samples are taken for it."""
    if camera.exposure is None:
        return 1, 1.0
    count = job.render.lens_samples
    return count + 1, count / _shares(job, lighting, count) + 1 / min(count, _SAMPLES_OF_MIDDLE)


def _shares(job: Job, lighting: Lighting | None, count: int) -> int:
    """Into how many shares a pixel's samples go: one for each pinhole, unless too few were left of them.

    A quotient of two lights is too bright where both are noisy, and the mean over pinholes is, too.
    """
    compared = lighting is not None and requirements.compared_in(job, lighting) is not None
    return min(count, max(job.render.spp // _LEAST_COMPARED, 1)) if compared else count


def _part(progress: CountProgress, number: int, count: int, done: int, total: int) -> None:
    progress(number * total + done, count * total)


class _Mean:
    """Adds up the light of frames of one size, and puts the mean of so many in the place of one frame's."""

    def __init__(self, count: int) -> None:
        self._count = np.float32(count)
        self._sums: dict[str, F32] = {}
        self._spp = 0

    def add(self, frame: Frame) -> None:
        """One of them."""
        self._spp += 0 if frame.lighting is None else frame.lighting.spp
        for name, values in _light_of(frame).items():
            self._sums[name] = self._sums[name] + values if name in self._sums else values

    def of(self, middle: Frame, camera: Camera) -> Frame:
        """The mean, as a camera's frame; all that is no light is the middle one's."""
        mean = {name: values / self._count for name, values in self._sums.items()}
        background, rgba = mean.get("behind"), mean["rgba"]
        if background is not None and middle.background is not None:
            let_through = 1 - rgba[..., 3:]
            seen = let_through > _OPAQUE
            background = np.where(seen, background / np.where(seen, let_through, 1), middle.background)
        lit = middle.lighting
        return replace(
            middle,
            camera=camera,
            rgba=rgba,
            unlit=mean.get("unlit"),
            factor=mean.get("factor"),
            shadow=mean.get("shadow"),
            noise=np.sqrt(mean["noise"] / self._count) if "noise" in mean else None,
            background=background,
            lighting=None if lit is None else self._lighting(lit, mean, "lighting"),
        )

    def _lighting(self, lit: LightingBuffer, mean: dict[str, F32], at: str) -> LightingBuffer:
        def layers(of: tuple[LightLayer, ...], name: str) -> tuple[LightLayer, ...]:
            found = []
            for k, layer in enumerate(of):
                mine = f"{at} {name} {k}"
                variance = mean[f"{mine} variance"] / self._count if f"{mine} variance" in mean else None
                light = {part: mean[f"{mine} {part}"] for part in ("direct", "indirect")}
                found.append(LightLayer(name=layer.name, variance=variance, **light))
            return tuple(found)

        variance, samples = mean.get(f"{at} variance"), mean.get(f"{at} samples")
        return replace(
            lit,
            coverage=mean[f"{at} coverage"],
            layers=layers(lit.layers, "layers"),
            noisy=layers(lit.noisy, "noisy"),
            variance=None if variance is None else variance / self._count,
            samples=None if samples is None else samples * self._count,
            spp=self._spp,
            objects=None if lit.objects is None else self._lighting(lit.objects, mean, f"{at} objects"),
        )


def _light_of(frame: Frame) -> dict[str, F32]:
    """What of a frame is averaged, by name; noise and variances as variances."""
    found = {"rgba": frame.rgba, "unlit": frame.unlit, "factor": frame.factor, "shadow": frame.shadow}
    if frame.noise is not None:
        found["noise"] = frame.noise**2
    if frame.background is not None:
        found["behind"] = frame.background * (1 - frame.rgba[..., 3:])
    if frame.lighting is not None:
        found |= _light_in(frame.lighting, "lighting")
    return {name: values for name, values in found.items() if values is not None}


def _light_in(lit: LightingBuffer, at: str) -> dict[str, F32 | None]:
    found: dict[str, F32 | None] = {f"{at} {name}": getattr(lit, name) for name in ("coverage", "variance", "samples")}
    for name, layers in (("layers", lit.layers), ("noisy", lit.noisy)):
        for k, layer in enumerate(layers):
            found |= {f"{at} {name} {k} {x}": getattr(layer, x) for x in ("direct", "indirect", "variance")}
    if lit.objects is not None:
        found |= _light_in(lit.objects, f"{at} objects")
    return found
