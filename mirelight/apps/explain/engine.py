"""The two ends of a ladder: what the engine renders of a job, and the settings of either side."""

from __future__ import annotations

import math
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

from mirelight.apps.realtime.browser import EngineFrames, render
from mirelight.compositor.engine import HARDWARE_BITS, SOFTWARE_BITS
from mirelight.model import (
    F32,
    Camera,
    CompositorSettings,
    DisplaySettings,
    Job,
    Lighting,
    RelightSettings,
    ToneCurve,
    rules_of,
)


@dataclass(frozen=True, slots=True, eq=False)
class EngineRun:
    """What the engine rendered of a job: as users see it, and its lighting texture without shadow maps."""

    frames: EngineFrames
    unshadowed: F32  # (h, w, 4)


def run_engine(job: Job, camera: Camera, lighting: Lighting, directory: Path) -> EngineRun:
    """Render with the real engine, twice where its lights cast shadows; the first run stays in `directory`.

    Raises: as :func:`mirelight.apps.realtime.browser.render`.
    """
    frames = render(job, camera, lighting, directory)
    if not lighting.lights:
        return EngineRun(frames, frames.relight)
    with tempfile.TemporaryDirectory(prefix="mirelight-") as temporary:
        return EngineRun(frames, render(job, camera, lighting, temporary, shadows=False).relight)


def corner_bits(run: EngineRun | None) -> int:
    """Bits of a pixel that the engine's rasteriser keeps of a corner; without a run, those of the software one."""
    renderer = "SwiftShader" if run is None else str(run.frames.meta.get("gl", {}).get("renderer", "SwiftShader"))
    return SOFTWARE_BITS if "SwiftShader" in renderer else HARDWARE_BITS


# --- the two sides of a job ------------------------------------------------------------------------------------------


def _is_engines(job: Job) -> bool:
    """Whether the job's splats go through the engine's pipelines anyway, so that its settings of them count."""
    return rules_of(job.compositor.profile).splats.pipelines


def engine_tone(job: Job) -> tuple[ToneCurve, float]:
    """Tone curve and linear exposure that the engine is given for a job; it has no AgX, and exposes in curves only."""
    if _is_engines(job):
        curve, exposure = job.compositor.tone, job.compositor.exposure
    else:
        curve, exposure = job.display.tone, 2.0**job.display.exposure
    return ("none", 1.0) if curve == "agx" else (curve, exposure)


def engine_compositor(job: Job) -> CompositorSettings:
    """How the engine draws a job's splats, blended in floating point."""
    theirs = job.compositor if _is_engines(job) else CompositorSettings()
    curve, exposure = engine_tone(job)
    return replace(
        theirs,
        profile="playcanvas",
        linear=job.compositor.blends_linear,
        tone=curve,
        exposure=exposure,
        eight_bit=False,
        max_memory=job.compositor.max_memory,
    )


def physical_settings(job: Job) -> RelightSettings:
    """How the last rung is relit: the job's settings by the profile physical, lighting at full size."""
    space = "linear" if rules_of(job.relight.profile).blending_space else job.relight.space
    return replace(job.relight, profile="physical", space=space, texture_scale=1.0)


def physical_display(job: Job) -> DisplaySettings:
    """How the last rung is shown: the job's display, or the engine's curve on the finished frame."""
    if not _is_engines(job):
        return job.display
    exposure = math.log2(job.compositor.exposure) if job.compositor.exposure > 0 else 0.0
    return replace(job.display, tone=job.compositor.tone, exposure=exposure)
